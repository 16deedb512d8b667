"""Which faults are forgotten without a person, how often, and whether the robot then goes on."""

from __future__ import annotations

from math import inf

import pytest
from core_builders import PERIOD, STEERING
from supervision_rig import STOPPED, WATCHED_ROWS, at_rest, happen, lasts, of_kind, standing

from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind, Row
from artemis.supervision.policy import Policy
from artemis.supervision.supervisor import ALL_RECOVERIES
from artemis.values import Mode, Severity, Verdict

SICK, OTHER = STEERING
S2 = Severity.CONTROLLED_STOP

# ---------------------------------------------------------------------------------------------- automatic


@of_kind(Kind.AUTOMATIC)
@pytest.mark.parametrize("mode", STOPPED)
def test_automatic_row_recovers_as_often_as_it_may_and_then_waits_for_a_person(id: str, row: Row, mode: Mode) -> None:
    watch = standing(mode=mode)
    for _ in range(row.recovery.times):
        verdict = happen(watch, id)
        assert verdict.recovers
        assert (verdict.resumes, verdict.final) == (False, False)
        assert lasts(watch) == pytest.approx(row.recovery.settle, abs=PERIOD + 1e-9)
        assert watch.verdict == Verdict()
    assert not happen(watch, id).recovers
    assert lasts(watch, longest=5.0) == inf
    assert watch.acknowledge(mode) == Verdict()
    assert not happen(watch, id).recovers, "an acknowledgment gives no budget back"


@of_kind(Kind.AUTOMATIC)
def test_budget_comes_back_when_its_window_has_passed(id: str, row: Row) -> None:
    watch = standing()
    for _ in range(row.recovery.times):
        happen(watch, id)
        lasts(watch)
    assert not happen(watch, id).recovers
    watch.acknowledge(after=1.0)
    watch.tick(after=min(row.recovery.window, 1e6) + 1.0)
    assert happen(watch, id).recovers is (row.recovery.window < inf and row.recovery.times < ALL_RECOVERIES)


def test_budget_comes_back_at_the_end_of_its_window() -> None:
    watch = at_rest()
    watch.tick(after=1.0, faults=(catalogue.fault("DRV-18"),))
    assert watch.tick(after=0.5) == Verdict()
    watch.tick(after=600.0, faults=(catalogue.fault("DRV-18"),))
    assert watch.time == 601.5
    assert watch.verdict.recovers


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in STOPPED])
def test_nothing_recovers_before_the_robot_was_stopped(mode: Mode) -> None:
    watch = standing(mode=mode)
    assert happen(watch, "INP-03").recovers, "it will"
    assert lasts(watch, longest=5.0) == inf
    watch.mode = Mode.QUICKSTOP
    watch.tick()
    assert watch.verdict == Verdict()


@pytest.mark.parametrize(("speed", "recovered"), [(0.0101, False), (-0.0101, False), (0.0099, True)])
def test_nothing_recovers_while_the_robot_moves(speed: float, recovered: bool) -> None:
    watch = standing()
    watch.speeds = 0.0, speed
    watch.ticks(0.2)
    happen(watch, "INP-03")
    assert (lasts(watch, longest=3.0) < inf) is recovered


def test_a_centimetre_in_a_second_counts_as_standing() -> None:
    watch = at_rest()
    watch.speeds = 0.0, 0.01
    watch.tick(after=1.0, faults=(catalogue.fault("INP-03"),))
    assert watch.tick(after=1.0) == Verdict()


def test_nothing_recovers_while_its_cause_is_there() -> None:
    watch = standing()
    for _ in range(100):
        assert happen(watch, "INP-03").stops
    assert lasts(watch) == pytest.approx(0.5, abs=PERIOD + 1e-9)


def test_cause_that_comes_and_goes_does_not_recover() -> None:
    watch = standing()
    for _ in range(20):
        happen(watch, "INP-03")
        watch.ticks(0.4)
        assert watch.ids() == ["INP-03"]


def test_all_that_stops_the_robot_recovers_together_or_not_at_all() -> None:
    watch = standing()
    happen(watch, "INP-03")
    watch.ticks(0.3)
    assert happen(watch, "SYS-01").recovers
    assert lasts(watch) == pytest.approx(0.5, abs=PERIOD + 1e-9), "the later of both"
    assert not happen(watch, "INP-03", "DRV-25").recovers
    assert lasts(watch, longest=5.0) == inf
    assert watch.ids() == ["DRV-25", "INP-03"]


def test_mild_faults_do_not_hold_a_recovery_up() -> None:
    watch = standing()
    happen(watch, "INP-03", "COM-20")
    assert watch.verdict.recovers
    assert lasts(watch) == pytest.approx(0.5, abs=PERIOD + 1e-9)
    assert watch.ids() == ["COM-20"]


UNLESS = [(id, other) for id, row in WATCHED_ROWS.items() for other in row.recovery.unless]


@pytest.mark.parametrize(("id", "other"), UNLESS)
def test_row_does_not_recover_while_another_of_its_device_is_there(id: str, other: str) -> None:
    watch = standing()
    assert not happen(watch, id, other, device=SICK).recovers
    assert lasts(watch, longest=3.0) == inf
    watch = standing()
    happen(watch, other, device=OTHER)
    verdict = happen(watch, id, device=SICK)
    assert verdict.recovers is (WATCHED_ROWS[other].recovery.kind is Kind.AUTOMATIC), (
        "another drive's is its own matter"
    )


@of_kind(Kind.ITSELF)
def test_stop_that_goes_by_itself_needs_no_person_as_long_as_there_is_a_budget(id: str, row: Row) -> None:
    watch = standing()
    for _ in range(5):
        assert happen(watch, id, device=SICK).recovers
        assert lasts(watch) == pytest.approx(row.recovery.settle, abs=PERIOD + 1e-9)
    assert not happen(watch, id, device=SICK).recovers
    assert lasts(watch, longest=5.0) == inf
    assert watch.acknowledge() == Verdict()


def test_five_recoveries_in_a_run_are_all() -> None:
    watch = standing()
    for id in ("INP-03", "INP-01", "SYS-01", "COM-07", "PLG-02"):
        assert happen(watch, id).recovers
        assert lasts(watch) < inf
    for id in ("INP-06", "COM-11"):
        assert not happen(watch, id).recovers
        assert lasts(watch, longest=5.0) == inf
        assert watch.acknowledge() == Verdict()
    watch.tick(after=1e6)
    assert not happen(watch, "INP-03").recovers, "this budget never comes back"


def test_flapping_cause_spends_its_budget_and_is_then_left_to_a_person() -> None:
    watch, recovered = standing(), 0
    for _ in range(20):
        stopped = watch.verdict.stops
        happen(watch, "COM-14", device=SICK)
        watch.ticks(1.0)
        recovered += not watch.verdict.stops
        assert not (stopped and not watch.verdict.stops), "nothing gives budget back"
    assert recovered == WATCHED_ROWS["COM-14"].recovery.times


# ---------------------------------------------------------------------------------------------- going on by itself

GO_ON = Policy(resume="continue")


def test_robot_goes_on_by_itself_where_the_mission_says_so() -> None:
    watch = standing({"INP-03": GO_ON})
    verdict = happen(watch, "INP-03")
    assert (verdict.recovers, verdict.resumes) == (True, True)


@pytest.mark.parametrize(("other", "recovers"), [("INP-06", True), ("DRV-25", False)])
def test_robot_goes_on_only_if_every_cause_may(other: str, recovers: bool) -> None:
    watch = standing({"INP-03": GO_ON})
    verdict = happen(watch, "INP-03", other)
    assert (verdict.recovers, verdict.resumes) == (recovers, False)


def test_mild_faults_do_not_hold_the_robot_up() -> None:
    assert happen(standing({"INP-03": GO_ON}), "INP-03", "COM-20").resumes


def test_robot_no_longer_goes_on_when_the_budget_is_spent() -> None:
    watch = standing({"INP-03": GO_ON})
    for _ in range(3):
        assert happen(watch, "INP-03").resumes
        lasts(watch)
    verdict = happen(watch, "INP-03")
    assert (verdict.recovers, verdict.resumes) == (False, False)


@pytest.mark.parametrize("retries", [0, 1])
def test_policy_allows_fewer_recoveries(retries: int) -> None:
    watch = standing({"INP-03": Policy(retries=retries)})
    for _ in range(retries):
        verdict = happen(watch, "INP-03")
        assert (verdict.recovers, verdict.resumes) == (True, False)
        lasts(watch)
    assert not happen(watch, "INP-03").recovers


def test_policy_that_makes_a_mild_row_stop_the_robot_leaves_how_it_is_forgotten() -> None:
    watch = standing({"COM-20": Policy(reaction=S2)})
    verdict = happen(watch, "COM-20")
    assert (verdict.severity, verdict.recovers) == (S2, True)
    assert lasts(watch) == pytest.approx(5.0, abs=PERIOD + 1e-9)
