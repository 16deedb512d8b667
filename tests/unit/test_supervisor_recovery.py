"""How faults are forgotten: by themselves, by an acknowledgment, automatically within budgets, or never."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest
from core_builders import PERIOD, STEERING
from supervision_rig import OFF, Watch

from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind, Row
from artemis.supervision.policy import WATCHED, Policies, Policy
from artemis.values import Fault, Mode, Severity, Verdict

SICK, OTHER = STEERING
S2 = Severity.CONTROLLED_STOP
ROWS = {id: row for id, row in catalogue.ROWS.items() if row.found in WATCHED}
STOPPED = (Mode.FAULT, Mode.QUICKSTOP)


def of_kind(*kinds: Kind, stops: bool = True) -> pytest.MarkDecorator:
    chosen = {id: row for id, row in ROWS.items() if row.recovery.kind in kinds and (row.severity >= S2) is stops}
    assert chosen
    return pytest.mark.parametrize(("id", "row"), chosen.items(), ids=list(chosen))


def standing(policies: Policies | None = None, mode: Mode = Mode.FAULT) -> Watch:
    """A robot that stands, its drives off, in a mode where faults are forgotten; it sends no heartbeat to be late."""
    watch = Watch(policies)
    watch.wish, watch.mode = replace(OFF, heartbeat=False), mode
    watch.ticks(0.1)
    return watch


def happen(watch: Watch, *ids: str, device: str = "") -> Verdict:
    """Faults, once."""
    return watch.tick(faults=tuple(catalogue.fault(id, device) for id in ids))


def lasts(watch: Watch, longest: float = 60.0) -> float:
    """How long the robot has to stop for, though nothing is wrong any more [s]; without end: inf."""
    begun = watch.time
    while watch.verdict.stops:
        watch.tick()
        if watch.time - begun > longest:
            return inf
    return watch.time - begun


# ---------------------------------------------------------------------------------------------- by itself


@of_kind(Kind.ITSELF, stops=False)
@pytest.mark.parametrize("mode", [Mode.FOLLOW, Mode.FAULT])
def test_mild_fault_is_over_some_time_after_its_cause(id: str, row: Row, mode: Mode) -> None:
    watch = standing(mode=mode)
    for _ in range(3):
        verdict = happen(watch, id)
        assert verdict.severity is row.severity
        assert (verdict.recovers, verdict.resumes) == (False, False)
    since = watch.time
    while watch.ids() and watch.time < since + 60.0:
        assert watch.ids() == [id]
        watch.tick()
    assert watch.time - since == pytest.approx(row.recovery.settle, abs=PERIOD + 1e-9)


def test_cause_that_is_there_keeps_a_mild_fault() -> None:
    watch = Watch()
    for _ in range(200):
        happen(watch, "COM-20")
        assert watch.ids() == ["COM-20"]


def test_cause_that_comes_and_goes_keeps_a_mild_fault() -> None:
    watch = Watch()
    for number in range(200):
        watch.tick(faults=(catalogue.fault("COM-09", SICK),) if number % 20 == 0 else ())
        assert watch.ids() == ["COM-09"]


# ---------------------------------------------------------------------------------------------- acknowledged


@of_kind(Kind.ACKNOWLEDGED, Kind.CALIBRATED, Kind.CONFIGURED)
def test_fault_that_needs_a_person_never_goes_by_itself(id: str, row: Row) -> None:
    watch = standing()
    verdict = happen(watch, id)
    assert (verdict.recovers, verdict.resumes, verdict.final) == (False, False, False)
    assert lasts(watch, longest=2.0) == inf
    watch.tick(after=row.recovery.settle + 3600.0)
    assert watch.acknowledge() == Verdict()


@pytest.mark.parametrize("mode", Mode)
def test_acknowledgment_counts_only_where_somebody_is_asked_for_it(mode: Mode) -> None:
    watch = Watch()
    happen(watch, "DRV-25")
    watch.acknowledge(mode)
    assert watch.ids() == ([] if mode in STOPPED else ["DRV-25"])


def test_acknowledgment_of_a_mode_that_does_not_count_does_not_use_up_the_next() -> None:
    watch = Watch()
    happen(watch, "DRV-25")
    watch.acknowledge(Mode.FOLLOW)
    assert watch.acknowledge(Mode.FAULT) == Verdict()


def test_acknowledgment_leaves_what_is_still_there() -> None:
    watch = Watch()
    watch.ill(SICK, heartbeat_age=1.0)
    happen(watch, "DRV-25", device=SICK)
    watch.acknowledge()
    assert watch.found() == [("COM-28", SICK)]


def test_acknowledgment_does_not_hide_what_comes_with_it() -> None:
    watch = Watch()
    happen(watch, "DRV-25")
    watch.acknowledge(faults=(catalogue.fault("DRV-02"),))
    assert watch.ids() == ["DRV-02"]
    happen(watch, "DRV-02")
    assert watch.ids() == ["DRV-02"], "nor does it count for later"


def test_acknowledgment_in_the_tick_of_the_cause_is_too_early() -> None:
    watch = standing()
    watch.acknowledge(faults=(catalogue.fault("DRV-25"),))
    assert watch.ids() == ["DRV-25"]


def test_stuck_button_acknowledges_once_in_two_seconds() -> None:
    watch = standing()
    happen(watch, "DRV-25")
    watch.acknowledge()
    acknowledged = watch.time
    happen(watch, "DRV-25")
    while watch.ids():
        watch.acknowledge()
    assert watch.time - acknowledged == pytest.approx(2.0, abs=PERIOD + 1e-9)


@pytest.mark.parametrize(("id", "seconds"), [("DRV-06", 300.0), ("DRV-25", 0.0)])
def test_cause_has_to_be_gone_for_the_rows_time(id: str, seconds: float) -> None:
    watch = standing()
    happen(watch, id)
    if seconds:
        watch.acknowledge(after=seconds - 0.1)
        assert watch.ids() == [id]
    watch.acknowledge(after=2.1)
    assert watch.ids() == []


def test_time_begins_anew_with_the_cause() -> None:
    watch = standing()
    happen(watch, "DRV-06")
    watch.tick(after=200.0)
    happen(watch, "DRV-06")
    watch.acknowledge(after=200.0)
    assert watch.ids() == ["DRV-06"]


# ---------------------------------------------------------------------------------------------- never

NEVER = [id for id, row in ROWS.items() if row.recovery.kind is Kind.NEVER]
TWICE = {id: row for id, row in ROWS.items() if row.recovery.final}


@pytest.mark.parametrize("id", NEVER)
def test_fault_that_is_never_forgotten_is_final(id: str) -> None:
    watch = standing()
    verdict = happen(watch, id)
    assert verdict.final
    assert (verdict.recovers, verdict.resumes) == (False, False)
    for _ in range(3):
        assert watch.acknowledge(after=1000.0).final


@pytest.mark.parametrize(("id", "row"), TWICE.items(), ids=list(TWICE))
def test_second_time_on_one_device_is_the_last(id: str, row: Row) -> None:
    watch = standing()
    for device, final in ((SICK, False), (OTHER, False), (SICK, True)):
        assert happen(watch, id, device=device).final is final
        watch.acknowledge(after=3.0)
        assert watch.found() == ([(id, SICK)] if final else [])


@pytest.mark.parametrize(("id", "row"), TWICE.items(), ids=list(TWICE))
def test_second_time_long_after_the_first_is_a_first_again(id: str, row: Row) -> None:
    for apart, final in ((min(row.recovery.window, 5000.0) - 10.0, True), (row.recovery.window + 10.0, False)):
        if apart < inf:
            watch = standing()
            happen(watch, id, device=SICK)
            watch.acknowledge(after=3.0)
            watch.tick(after=apart - 3.0)
            assert happen(watch, id, device=SICK).final is final


def test_fault_that_goes_on_is_one_occurrence() -> None:
    watch = standing()
    for _ in range(50):
        happen(watch, "RUN-01", device=SICK)
    assert not watch.verdict.final
    watch.tick()
    assert watch.acknowledge() == Verdict()


def test_final_fault_beside_others_keeps_only_itself() -> None:
    watch = standing()
    happen(watch, "DRV-05", "DRV-25")
    watch.acknowledge()
    assert watch.ids() == ["DRV-05"]


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
    assert happen(watch, id).recovers is (row.recovery.window < inf)


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in STOPPED])
def test_nothing_recovers_before_the_robot_was_stopped(mode: Mode) -> None:
    watch = standing(mode=mode)
    assert happen(watch, "INP-03").recovers, "it will"
    assert lasts(watch, longest=5.0) == inf
    watch.mode = Mode.QUICKSTOP
    watch.tick()
    assert watch.verdict == Verdict()


@pytest.mark.parametrize(("speed", "recovered"), [(0.011, False), (-0.011, False), (0.009, True)])
def test_nothing_recovers_while_the_robot_moves(speed: float, recovered: bool) -> None:
    watch = standing()
    watch.speeds = 0.0, speed
    watch.ticks(0.2)
    happen(watch, "INP-03")
    assert (lasts(watch, longest=3.0) < inf) is recovered


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


UNLESS = [(id, other) for id, row in ROWS.items() for other in row.recovery.unless]


@pytest.mark.parametrize(("id", "other"), UNLESS)
def test_row_does_not_recover_while_another_of_its_device_is_there(id: str, other: str) -> None:
    watch = standing()
    assert not happen(watch, id, other, device=SICK).recovers
    assert lasts(watch, longest=3.0) == inf
    watch = standing()
    happen(watch, other, device=OTHER)
    verdict = happen(watch, id, device=SICK)
    assert verdict.recovers is (ROWS[other].recovery.kind is Kind.AUTOMATIC), "another drive's is its own matter"


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
    assert recovered == ROWS["COM-14"].recovery.times


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
        assert happen(watch, "INP-03").recovers
        lasts(watch)
    assert not happen(watch, "INP-03").recovers


def test_policy_that_makes_a_mild_row_stop_the_robot_leaves_how_it_is_forgotten() -> None:
    watch = standing({"COM-20": Policy(reaction=S2)})
    verdict = happen(watch, "COM-20")
    assert (verdict.severity, verdict.recovers) == (S2, True)
    assert lasts(watch) == pytest.approx(5.0, abs=PERIOD + 1e-9)


def test_fault_that_is_no_fault_of_the_table_is_a_bug_of_ours() -> None:
    with pytest.raises(KeyError, match="ABC-01"):
        Watch().tick(faults=(Fault(id="ABC-01", severity=S2, text=""),))
