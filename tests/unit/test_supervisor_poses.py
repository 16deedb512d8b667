"""What is measured of a localizer: each row at its limit and below it, where it matters and where it does not."""

from __future__ import annotations

import pytest
from core_builders import PERIOD
from supervision_rig import Watch

from artemis.motion.localisation import KEPT
from artemis.supervision.catalogue.row import Found
from artemis.supervision.catalogue.surroundings import SURROUNDINGS
from artemis.values import Mode, Pose, PoseFix, Request, Severity

W, L, S2 = Severity.WARN, Severity.LIMIT, Severity.CONTROLLED_STOP


def fix(time: float, doubt: float = 0.0) -> PoseFix:
    return PoseFix(time=time, pose=Pose(), covariance=(), source="map", quality=0.5, doubt=doubt)


def told(watch: Watch, seconds: float, doubt: float) -> list[Severity]:
    """A fix in each tick, as doubtful as that."""
    found = []
    for _ in range(round(seconds / PERIOD)):
        watch.tick(fixes=(fix(watch.time, doubt),))
        found.append(watch.severity("LOC-03"))
    return found


def test_the_rows_measured_are_those_tested_here() -> None:
    measured = {id for id, row in SURROUNDINGS.items() if row.found is Found.MEASURED and id.startswith("LOC")}
    assert measured == {"LOC-03", "LOC-05"}


def test_a_sure_localizer_is_no_fault() -> None:
    watch = Watch()
    assert set(told(watch, 1.0, 0.0)) == {Severity.NONE}
    assert watch.found() == []


def test_doubt_slows_the_robot_after_a_second_and_stops_it_at_once_when_it_is_lost() -> None:
    assert set(told(Watch(), 3.0, 0.5)) == {Severity.NONE}
    found = told(Watch(), 2.0, 0.51)
    assert (found.index(L), max(found)) == (50, L)
    watch = Watch()
    assert told(watch, 0.1, 1.0)[0] is S2
    assert "50 % of what it sees fits the map" in watch.text("LOC-03")


def test_what_was_told_last_holds_until_it_is_told_otherwise() -> None:
    watch = Watch()
    told(watch, 0.1, 0.6)
    watch.ticks(2.0)
    assert watch.severity("LOC-03") is L
    watch.tick(fixes=(fix(watch.time - 1.9),))
    assert watch.severity("LOC-03") is L, "an older fix tells nothing"
    watch.tick(fixes=(fix(watch.time + PERIOD),))
    watch.ticks(1.0)
    assert watch.found() == []


@pytest.mark.parametrize("mode", [Mode.INIT, Mode.READY, Mode.TELEOP, Mode.CALIBRATE])
def test_where_the_robot_does_not_drive_by_its_pose_it_does_not_matter(mode: Mode) -> None:
    watch = Watch()
    watch.mode = mode
    for _ in range(100):
        watch.tick(fixes=(fix(watch.time - 3.0, 1.0), fix(watch.time, 1.0)))
    assert watch.found() == []
    watch.mode = Mode.ACT
    watch.tick()
    assert watch.ids() == ["LOC-03", "LOC-05"]


def test_a_stopped_robot_goes_on_once_it_is_found_or_a_person_has_looked() -> None:
    for request, found in (((), True), ((Request.ACKNOWLEDGE,), False)):
        watch = Watch()
        told(watch, 0.1, 1.0)
        watch.mode = Mode.QUICKSTOP
        watch.ticks(5.0)
        assert watch.severity("LOC-03") is S2
        watch.tick(fixes=(fix(watch.time),) if found else (), requests=request)
        watch.ticks(1.0)
        assert watch.found() == []


def test_a_stop_for_another_reason_is_not_held_by_doubt() -> None:
    watch = Watch()
    watch.mode = Mode.QUICKSTOP
    assert set(told(watch, 1.0, 1.0)) == {Severity.NONE}


@pytest.mark.parametrize("off", [-KEPT - PERIOD, 2.5 * PERIOD])
def test_impossible_times_are_a_warning_and_many_stop_the_robot(off: float) -> None:
    watch = Watch()
    severities = []
    for number in range(10):
        watch.tick(fixes=(fix(watch.time + PERIOD + off) if number >= 4 else fix(watch.time),))
        severities.append(watch.severity("LOC-05"))
    assert severities == [Severity.NONE] * 4 + [W] * 5 + [S2]
    for _ in range(60):
        watch.tick(fixes=(fix(watch.time),))
    watch.mode = Mode.QUICKSTOP
    watch.tick(fixes=(fix(watch.time),))
    assert watch.found() == []


def test_a_fix_of_the_future_does_not_keep_later_ones_from_being_heard() -> None:
    watch = Watch()
    watch.tick(fixes=(fix(1e6),))
    assert told(watch, 0.1, 1.0)[-1] is S2
