"""How faults are forgotten: by themselves, by an acknowledgment, or never."""

from __future__ import annotations

from math import inf

import pytest
from core_builders import PERIOD, STEERING
from supervision_rig import STOPPED, WATCHED_ROWS, Watch, at_rest, happen, lasts, of_kind, standing

from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind, Row
from artemis.values import Fault, Mode, Severity, Verdict

SICK, OTHER = STEERING

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


def test_second_acknowledgment_counts_from_two_seconds_on() -> None:
    watch = at_rest()
    watch.tick(after=1.0, faults=(catalogue.fault("DRV-25"),))
    watch.acknowledge(after=1.0)
    watch.tick(after=1.0, faults=(catalogue.fault("DRV-25"),))
    assert watch.acknowledge(after=1.0) == Verdict()


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

NEVER = [id for id, row in WATCHED_ROWS.items() if row.recovery.kind is Kind.NEVER]
TWICE = {id: row for id, row in WATCHED_ROWS.items() if row.recovery.final}


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


def test_second_time_at_the_end_of_the_window_is_a_first_again() -> None:
    watch = at_rest()
    watch.tick(after=1.0, faults=(catalogue.fault("DRV-02", SICK),))
    watch.acknowledge(after=3.0)
    watch.tick(after=597.0, faults=(catalogue.fault("DRV-02", SICK),))
    assert watch.time == 601.0
    assert not watch.verdict.final


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


def test_fault_that_is_no_fault_of_the_table_is_a_bug_of_ours() -> None:
    with pytest.raises(KeyError, match="ABC-01"):
        Watch().tick(faults=(Fault(id="ABC-01", severity=Severity.CONTROLLED_STOP, text=""),))
