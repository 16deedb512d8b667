"""What a mission may say about single rows: stricter is accepted and acts, milder is refused; row by row."""

from __future__ import annotations

import math

import pytest

from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import SHORT, Found, Kind, Row
from artemis.supervision.policy import LONG, WATCHED, Policy, problems_of, stricter
from artemis.values import Severity

SEEN = {id: row for id, row in ROWS.items() if row.found in WATCHED}
UNSEEN = {id: row for id, row in ROWS.items() if row.found not in WATCHED}
TIMED = {id: row for id, row in SEEN.items() if row.stages}
AUTOMATIC = {id: row for id, row in SEEN.items() if row.recovery.kind is Kind.AUTOMATIC}


def cases(rows: dict[str, Row]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize(("id", "row"), rows.items(), ids=list(rows))


def test_short_names_go_both_ways() -> None:
    assert {LONG[SHORT[severity]] for severity in SHORT} == set(Severity) - {Severity.NONE}
    assert set(LONG) == {"W", "L", "S2", "S1", "S0"}


def test_rows_that_are_noticed_in_a_run_take_a_policy() -> None:
    assert {row.found for row in UNSEEN.values()} == {
        Found.LOADING,
        Found.COMMAND,
        Found.ELSEWHERE,
        Found.DESIGN,
        Found.ABSENT,
    }


@cases(UNSEEN)
@pytest.mark.parametrize("policy", [Policy(), Policy(reaction=Severity.OFF), Policy(after_s=0.0), Policy(retries=0)])
def test_row_that_is_never_noticed_takes_no_policy(id: str, row: Row, policy: Policy) -> None:
    (problem,) = problems_of(id, policy)
    assert problem == f"{id} ({row.name}) is never noticed in a run: {row.found.value}; it cannot have a policy"


@cases(SEEN)
def test_empty_policy_changes_nothing(id: str, row: Row) -> None:
    assert problems_of(id, Policy()) == []
    assert stricter({id: Policy()}) == ROWS


def test_robot_waits_after_a_recovery_unless_a_policy_says_otherwise() -> None:
    assert Policy().resume == "wait"


def test_no_policy_is_the_table() -> None:
    assert stricter({}) == ROWS


@cases(SEEN)
def test_reaction_may_be_more_severe_and_is_never_milder(id: str, row: Row) -> None:
    for severity in Severity:
        policy = Policy(reaction=severity)
        if severity is Severity.NONE:
            continue
        problems = problems_of(id, policy)
        if severity < row.severity:
            assert problems == [f"reaction: {SHORT[severity]} is milder than {id} allows ({SHORT[row.severity]})"]
        else:
            assert problems == []
            changed = stricter({id: policy})
            assert changed.pop(id) == row._replace(severity=severity)
            assert changed == {other: row for other, row in ROWS.items() if other != id}


@cases(TIMED)
def test_time_may_be_shorter_and_is_never_longer(id: str, row: Row) -> None:
    last = row.stages[-1]
    for seconds in (0.0, last.hold / 2, last.hold):
        assert problems_of(id, Policy(after_s=seconds)) == []
        stages = stricter({id: Policy(after_s=seconds)})[id].stages
        assert stages == (*row.stages[:-1], last._replace(hold=seconds))
    for seconds in (math.nextafter(last.hold, math.inf), last.hold + 1.0, -1e-9, -math.inf, math.inf, math.nan):
        (problem,) = problems_of(id, Policy(after_s=seconds))
        assert problem == f"after_s: {seconds:g} s is not within 0 and the {last.hold:g} s of {id}"


@cases({id: row for id, row in SEEN.items() if not row.stages})
def test_row_that_is_noticed_at_once_has_no_time(id: str, row: Row) -> None:
    assert problems_of(id, Policy(after_s=0.0)) == [f"after_s: {id} is noticed at once, it has no time to shorten"]


@cases(AUTOMATIC)
def test_retries_may_be_fewer_and_are_never_more(id: str, row: Row) -> None:
    times = row.recovery.times
    for retries in range(times + 1):
        assert problems_of(id, Policy(retries=retries)) == []
        assert stricter({id: Policy(retries=retries)})[id].recovery == row.recovery._replace(times=retries)
    for retries in (times + 1, -1):
        (problem,) = problems_of(id, Policy(retries=retries))
        assert problem == f"retries: {retries} is not within 0 and the {times} of {id}"


@cases({id: row for id, row in SEEN.items() if id not in AUTOMATIC})
def test_row_that_is_not_automatic_does_not_become_so(id: str, row: Row) -> None:
    for retries in (0, 1):
        assert problems_of(id, Policy(retries=retries)) == [
            f"retries: {id} recovers only by: {row.recovery.kind.value}"
        ]
    assert problems_of(id, Policy(resume="continue")) == [
        f"resume: {id} does not recover by itself, so the run cannot continue"
    ]
    assert problems_of(id, Policy(resume="wait")) == []


@cases(AUTOMATIC)
def test_robot_may_go_on_after_an_automatic_recovery_if_there_is_one(id: str, row: Row) -> None:
    assert problems_of(id, Policy(resume="continue")) == []
    assert problems_of(id, Policy(resume="continue", retries=1)) == []
    assert problems_of(id, Policy(resume="continue", retries=0)) == [
        f"resume: {id} does not recover by itself, so the run cannot continue"
    ]
    assert stricter({id: Policy(resume="continue")}) == ROWS, "the supervisor keeps it"


def test_every_problem_of_a_policy_is_told_at_once() -> None:
    problems = problems_of("RUN-01", Policy(reaction=Severity.WARN, after_s=9.0, retries=2, resume="continue"))
    assert [problem.split(":")[0] for problem in problems] == ["reaction", "after_s", "retries", "resume"]


def test_policies_of_several_rows_act_together() -> None:
    policies = {"SYS-01": Policy(reaction=Severity.QUICK_STOP, retries=1), "STE-01": Policy(after_s=0.1)}
    changed = stricter(policies)
    assert (changed["SYS-01"].severity, changed["SYS-01"].recovery.times) == (Severity.QUICK_STOP, 1)
    assert changed["STE-01"].stages[-1].hold == 0.1
    assert {id for id, row in changed.items() if row != ROWS[id]} == set(policies)


def test_unknown_row_is_a_mistake_of_the_caller() -> None:
    with pytest.raises(KeyError, match="RUN-99"):
        problems_of("RUN-99", Policy())
