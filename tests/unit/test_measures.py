"""What is measured of the drives, reading by reading. Limits and times: test_supervisor_rows.py."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, drive, drives, sensed
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from supervision_rig import DRIVING, OFF

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.mission.loading import load_model
from artemis.supervision.measures import DriveMeasures, Rate, Reading
from artemis.values import DriveFeedback, Wish
from artemis.vehicle import RobotFile

SICK = "steer-left"
EPOS4 = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_epos4.yaml", RobotFile)
FAULTS = [DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED]

# ---------------------------------------------------------------------------------------------- rates


def test_rate_is_the_sum_over_the_window() -> None:
    rate = Rate(1.0)
    counted = [rate.count("a", times, now) for times, now in [(2, 0.0), (0, 0.5), (3, 0.75), (1, 0.875)]]
    assert counted == [2, 2, 5, 6]
    assert rate.count("a", 0, 1.0) == 4, "a window long ago is over"
    assert rate.count("a", 0, 1.5) == 4
    assert rate.count("a", 0, 1.75) == 1
    assert rate.count("a", 0, 9.0) == 0


def test_rates_of_different_names_are_different() -> None:
    rate = Rate(1.0)
    rate.count("a", 3, 0.0)
    assert rate.count("b", 0, 0.0) == 0
    assert rate.count("b", 1, 0.0) == 1
    assert rate.count("a", 0, 0.0) == 3


@given(
    window=st.floats(0.05, 2.0),
    events=st.lists(st.tuples(st.floats(0.0, 0.5), st.integers(0, 5)), min_size=1, max_size=30),
)
def test_rate_agrees_with_its_definition(window: float, events: list[tuple[float, int]]) -> None:
    rate, now, happened = Rate(window), 0.0, []
    for after, times in events:
        now += after
        happened.append((now, times))
        assert rate.count("", times, now) == sum(n for time, n in happened if time > now - window)


# ---------------------------------------------------------------------------------------------- drives


def read(
    *ill: DriveFeedback, tick: float = PERIOD, wish: Wish = DRIVING, explained: set[str] | None = None
) -> set[Any]:
    """Row, device and value of the readings, when these drives are ill and the others well."""
    measures = DriveMeasures(ROBOT, tick)
    readings = measures.read(sensed(drives=drives(*ill)), wish, explained or set())
    return {(id, device, value) for id, device, value, _ in readings}


def test_healthy_drives_give_no_reading() -> None:
    assert read() == set()


@pytest.mark.parametrize("name", NAMES)
def test_readings_name_their_drive(name: str) -> None:
    assert read(drive(name, boots=2)) == {("COM-26", name, 1.0)}
    assert read(drive(name, disordered=3)) == {("COM-16", name, 1.0)}
    assert read(drive(name, jumps=3)) == {("RUN-10", name, 3.0)}


@pytest.mark.parametrize("nmt", [*(state for state in Nmt if state is not Nmt.OPERATIONAL), None])
def test_every_nmt_state_but_operational_is_read(nmt: Nmt | None) -> None:
    assert read(drive(SICK, nmt=nmt)) == {("COM-27", SICK, 1.0)}


@pytest.mark.parametrize(("frames", "value"), [(0, None), (1, None), (2, None), (3, 3.0), (7, 7.0)])
def test_more_than_two_frames_in_a_tick_are_a_burst(frames: int, value: float | None) -> None:
    assert read(drive(SICK, frames=frames)) == (set() if value is None else {("COM-15", SICK, value)})


@pytest.mark.parametrize(("tick", "stale"), [(0.005, 0.08), (0.02, 0.08), (0.032, 0.08), (0.04, 0.1), (0.1, 0.25)])
def test_age_is_given_as_if_ticks_were_fast(tick: float, stale: float) -> None:
    assert read(drive(SICK, age=stale), tick=tick) == set()
    ((id, device, value),) = read(drive(SICK, age=stale + 0.01), tick=tick)
    assert (id, device) == ("COM-11", SICK)
    assert value == pytest.approx(0.09)


def test_age_does_not_count_what_we_are_late_ourselves() -> None:
    def ids(late: float, *ages: float) -> set[str]:
        seen = sensed(late=late, drives=drives(*(drive(n, age=a) for n, a in zip(NAMES, ages, strict=False))))
        return {id for id, _, _, _ in DriveMeasures(ROBOT, PERIOD).read(seen, DRIVING, set())}

    assert ids(0.1, 0.18) == set()
    assert ids(0.1, 0.1801) == {"COM-11"}
    assert ids(0.1, 0.18, 0.18, 0.18, 0.18) == set()
    assert ids(0.1, 0.1801, 0.1801, 0.1801, 0.1801) == {"COM-29"}


def test_age_is_given_less_what_we_are_late() -> None:
    seen = sensed(late=0.1, drives=drives(drive(SICK, age=0.3)))
    ((_, _, value, words),) = DriveMeasures(ROBOT, PERIOD).read(seen, DRIVING, set())
    assert value == pytest.approx(0.2)
    assert words == "300 ms old"


def test_drive_that_was_never_heard_is_older_than_anything_and_has_no_state() -> None:
    silent = drive(SICK, age=None, state=DriveState.UNKNOWN, mode=0, heartbeat_age=None)
    assert read(silent) == {("COM-11", SICK, inf), ("COM-28", SICK, inf)}


@pytest.mark.parametrize(("age", "there"), [(0.1, False), (0.1001, True), (0.3, True)])
def test_heartbeat_is_read_once_it_is_late(age: float, there: bool) -> None:
    assert read(drive(SICK, heartbeat_age=age)) == ({("COM-28", SICK, age)} if there else set())


def all_of_age(*ages: float | None) -> set[Any]:
    return read(*(drive(name, age=age) for name, age in zip(NAMES, ages, strict=True)))


def test_silence_of_all_drives_is_one_thing() -> None:
    assert all_of_age(0.09, 0.2, None, 1.0) == {("COM-29", "", 1.0)}
    assert all_of_age(None, None, None, None) == {("COM-29", "", 1.0)}
    assert {id for id, _, _ in all_of_age(0.08, 0.2, None, 1.0)} == {"COM-11"}


def test_silence_says_how_old_the_newest_is() -> None:
    def words(*ages: float | None) -> str:
        seen = sensed(drives=drives(*(drive(name, age=age) for name, age in zip(NAMES, ages, strict=True))))
        return next(iter(DriveMeasures(ROBOT, PERIOD).read(seen, DRIVING, set())))[3]

    assert words(0.2, 0.09, None, 1.0) == "90 ms old"
    assert words(9.0, 9.0, 9.0, 9.0) == "9000 ms old"
    assert words(None, None, None, None) == "never heard"


# ---------------------------------------------------------------------------------------------- states


@pytest.mark.parametrize("name", NAMES)
def test_wrong_operating_mode_is_read(name: str) -> None:
    assert read(drive(name, mode=1)) == {("COM-04", name, 1.0)}


def test_unknown_statusword_is_read_alone() -> None:
    assert read(drive(SICK, state=DriveState.UNKNOWN, mode=9), wish=OFF) == {("COM-05", SICK, 1.0)}


@pytest.mark.parametrize("state", FAULTS)
def test_fault_state_is_read_unless_it_is_explained(state: DriveState) -> None:
    ill = drive(SICK, state=state, mode=9)
    assert read(ill, wish=OFF) == {("COM-01", SICK, 1.0)}
    assert read(ill, wish=OFF, explained={"steer-right"}) == {("COM-01", SICK, 1.0)}
    assert read(ill, wish=OFF, explained={SICK}) == set()
    assert read(replace(ill, emergencies=(0x2310,)), wish=OFF) == set()


class Enabling:
    """The measures of one drive, tick by tick."""

    def __init__(self, name: str = SICK) -> None:
        self.measures, self.name = DriveMeasures(ROBOT, PERIOD), name

    def readings(self, state: DriveState, wish: Wish = DRIVING) -> list[Reading]:
        ill = drive(self.name, state=state, emergencies=(0x2310,) if state in FAULTS else ())
        return list(self.measures.read(sensed(drives=drives(ill)), wish, set()))

    def read(self, state: DriveState, wish: Wish = DRIVING) -> list[str]:
        return [id for id, _, _, _ in self.readings(state, wish)]


NOT_ON = [state for state in DriveState if state not in (DriveState.OPERATION_ENABLE, DriveState.UNKNOWN, *FAULTS)]


@pytest.mark.parametrize("state", [*NOT_ON, *FAULTS])
def test_drive_that_is_to_be_enabled_and_was_not_yet_is_not_there_yet(state: DriveState) -> None:
    enabling = Enabling()
    assert [enabling.read(state) for _ in range(3)] == [["COM-03"]] * 3
    assert enabling.readings(state) == [("COM-03", SICK, 1.0, f"stuck in {state.value}")]


def test_a_drive_has_as_long_as_its_family_allows_to_be_enabled_and_the_row_s_time_is_the_end_of_it() -> None:
    """An EPOS4 is allowed 1.5 s, the row alone 1 s."""
    measures = DriveMeasures(EPOS4, PERIOD)

    def found(time: float, state: DriveState = DriveState.READY, wish: Wish = DRIVING) -> list[str]:
        told = [replace(each, mode=EPOS4.drives[each.name].operating_mode) for each in drives(drive(SICK, state=state))]
        return [id for id, *_ in measures.read(sensed(time, drives=tuple(told)), wish, set())]

    assert [found(time) for time in (2.0, 2.48)] == [[], []]
    assert [found(time) for time in (2.5, 2.52)] == [["COM-03"], ["COM-03"]]
    assert found(2.54, wish=OFF) == []
    assert found(2.56) == [], "a new order"
    assert found(2.58, DriveState.OPERATION_ENABLE) == []
    assert found(2.6) == ["COM-02"], "to leave it takes no time"
    measures.forget()
    assert [found(time) for time in (4.0, 4.48, 4.5)] == [[], [], ["COM-03"]]


@pytest.mark.parametrize("state", NOT_ON)
def test_drive_that_was_enabled_has_left_it_by_itself(state: DriveState) -> None:
    enabling = Enabling()
    assert enabling.read(DriveState.OPERATION_ENABLE) == []
    assert [enabling.read(state) for _ in range(3)] == [["COM-02"]] * 3
    assert enabling.readings(state) == [("COM-02", SICK, 1.0, f"now {state.value}")]
    assert enabling.read(DriveState.OPERATION_ENABLE) == []


@pytest.mark.parametrize("state", FAULTS)
def test_fault_state_is_no_switching_off(state: DriveState) -> None:
    enabling = Enabling()
    enabling.read(DriveState.OPERATION_ENABLE)
    assert enabling.read(state) == []


@pytest.mark.parametrize("goal", [goal for goal in Goal if goal is not Goal.ENABLED])
def test_drive_that_need_not_be_enabled_may_be_as_it_likes_and_begins_anew(goal: Goal) -> None:
    enabling = Enabling()
    enabling.read(DriveState.OPERATION_ENABLE)
    assert enabling.read(DriveState.READY, Wish(traction=goal, steering=goal)) == []
    assert enabling.read(DriveState.READY) == ["COM-03"]


@pytest.mark.parametrize(("name", "wanted"), [("traction-left", "traction"), ("steer-right", "steering")])
def test_each_role_is_judged_by_its_own_goal(name: str, wanted: str) -> None:
    for role in ("traction", "steering"):
        wish = replace(OFF, **{role: Goal.ENABLED})
        assert Enabling(name).read(DriveState.READY, wish) == (["COM-03"] if role == wanted else [])


def test_what_was_enabled_is_forgotten_while_nobody_watches() -> None:
    enabling = Enabling()
    enabling.read(DriveState.OPERATION_ENABLE)
    enabling.measures.forget()
    assert enabling.read(DriveState.READY) == ["COM-03"]
