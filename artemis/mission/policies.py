"""The key `recovery` of a mission: what it says about single faults, held against the fault table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from artemis.mission.problems import nearest
from artemis.mission.schema import RecoveryPolicy
from artemis.supervision.catalogue import ROWS
from artemis.supervision.policy import LONG, Policies, Policy, problems_of


def policies_from(recovery: Mapping[str, RecoveryPolicy]) -> Policies:
    """The policies as the supervisor takes them."""
    return {id: _policy(said) for id, said in recovery.items()}


def check_policy(id: str, said: RecoveryPolicy) -> Iterator[tuple[str, str]]:
    """What is wrong with a row's policy: the key below the row (empty: the row itself), and the problem."""
    if id not in ROWS:
        yield "", f"no such fault{nearest(id, ROWS, 'faults')}"
        return
    for problem in problems_of(id, _policy(said)):
        key, found, text = problem.partition(": ")
        yield (key, text) if found and key in RecoveryPolicy.model_fields else ("", problem)


def _policy(said: RecoveryPolicy) -> Policy:
    reaction = None if said.reaction is None else LONG[said.reaction]
    return Policy(reaction=reaction, after_s=said.after_s, retries=said.retries, resume=said.resume)
