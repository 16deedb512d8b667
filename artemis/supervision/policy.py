"""What a mission may say about single rows: stricter than the table, never milder. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import SHORT, Found, Kind, Row
from artemis.values import Severity

LONG = {short: severity for severity, short in SHORT.items()}
"""Reactions by their short names."""
WATCHED = (Found.EMERGENCY, Found.MEASURED, Found.MODE, Found.BRING_UP, Found.EDGE)
"""Only rows that are noticed in a run have a policy."""


class Policy(NamedTuple):
    """What a mission says about one row. None: as the table says."""

    reaction: Severity | None = None
    after_s: float | None = None
    """How long a measured row's last limit must be exceeded [s]."""
    retries: int | None = None
    """Automatic recoveries in the row's window."""
    resume: Literal["wait", "continue"] = "wait"
    """What follows an automatic recovery: wait for arm, or continue where the robot stopped."""


Policies = Mapping[str, Policy]


def problems_of(id: str, policy: Policy) -> list[str]:
    """What is wrong with a policy, one sentence each: the row, the key, what it says, what the table allows."""
    row = ROWS[id]
    if row.found not in WATCHED:
        return [f"{id} ({row.name}) is never noticed in a run: {row.found.value}; it cannot have a policy"]
    problems = []
    if policy.reaction is not None and policy.reaction < row.severity:
        problems.append(f"reaction: {SHORT[policy.reaction]} is milder than {id} allows ({SHORT[row.severity]})")
    if policy.after_s is not None:
        if not row.stages:
            problems.append(f"after_s: {id} is noticed at once, it has no time to shorten")
        elif not 0.0 <= policy.after_s <= row.stages[-1].hold:
            problems.append(f"after_s: {policy.after_s:g} s is not within 0 and the {row.stages[-1].hold:g} s of {id}")
    automatic = row.recovery.kind is Kind.AUTOMATIC
    if policy.retries is not None:
        if not automatic:
            problems.append(f"retries: {id} recovers only by: {row.recovery.kind.value}")
        elif not 0 <= policy.retries <= row.recovery.times:
            problems.append(f"retries: {policy.retries} is not within 0 and the {row.recovery.times} of {id}")
    if policy.resume == "continue" and not (automatic and policy.retries != 0):
        problems.append(f"resume: {id} does not recover by itself, so the run cannot continue")
    return problems


def stricter(policies: Policies) -> dict[str, Row]:
    """The table with a mission's policies."""
    return {**ROWS, **{id: _stricter(ROWS[id], policy) for id, policy in policies.items()}}


def _stricter(row: Row, policy: Policy) -> Row:
    if policy.reaction is not None:
        row = row._replace(severity=policy.reaction)
    if policy.after_s is not None:
        row = row._replace(stages=(*row.stages[:-1], row.stages[-1]._replace(hold=policy.after_s)))
    if policy.retries is not None:
        row = row._replace(recovery=row.recovery._replace(times=policy.retries))
    return row
