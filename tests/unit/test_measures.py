"""What is measured of drives, bus, schedule and inputs, reading by reading. Limits and times: test_supervisor.py."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, drive, drives, sensed
from hypothesis import given
from hypothesis import strategies as st
from supervision_rig import DRIVING, OFF

from artemis.supervision.measures import DriveMeasures, HostMeasures, Rate, Reading
from artemis.values import BusHealth, DriveFeedback, DriveState, Goal, Nmt, OperatorInput, Wish

SICK = "steer-left"
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


def test_drive_that_was_never_heard_is_older_than_anything_and_has_no_state() -> None:
    silent = drive(SICK, age=None, state=DriveState.UNKNOWN, mode=0, heartbeat_age=None)
    assert read(silent) == {("COM-11", SICK, 9e9), ("COM-28", SICK, 9e9)}


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

    def read(self, state: DriveState, wish: Wish = DRIVING) -> list[str]:
        ill = drive(self.name, state=state, emergencies=(0x2310,) if state in FAULTS else ())
        return [id for id, _, _, _ in self.measures.read(sensed(drives=drives(ill)), wish, set())]


NOT_ON = [state for state in DriveState if state not in (DriveState.OPERATION_ENABLE, DriveState.UNKNOWN, *FAULTS)]


@pytest.mark.parametrize("state", [*NOT_ON, *FAULTS])
def test_drive_that_is_to_be_enabled_and_was_not_yet_is_not_there_yet(state: DriveState) -> None:
    enabling = Enabling()
    assert [enabling.read(state) for _ in range(3)] == [["COM-03"]] * 3


@pytest.mark.parametrize("state", NOT_ON)
def test_drive_that_was_enabled_has_left_it_by_itself(state: DriveState) -> None:
    enabling = Enabling()
    assert enabling.read(DriveState.OPERATION_ENABLE) == []
    assert [enabling.read(state) for _ in range(3)] == [["COM-02"]] * 3
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
        wish = replace(OFF, **{role: Goal.ENABLED})  # type: ignore[arg-type]
        assert Enabling(name).read(DriveState.READY, wish) == (["COM-03"] if role == wanted else [])


def test_what_was_enabled_is_forgotten_while_nobody_watches() -> None:
    enabling = Enabling()
    enabling.read(DriveState.OPERATION_ENABLE)
    enabling.measures.forget()
    assert enabling.read(DriveState.READY) == ["COM-03"]


# ---------------------------------------------------------------------------------------------- bus and messages


class Host:
    """The measures of everything that is not one drive's state, tick by tick."""

    def __init__(self) -> None:
        self.measures, self.time = HostMeasures(ROBOT.host_node_id), 0.0

    def read(self, wish: Wish = DRIVING, after: float = PERIOD, **changes: Any) -> list[Reading]:
        self.time += after
        return list(self.measures.read(sensed(self.time, **changes), wish))

    def values(self, id: str, **changes: Any) -> list[float]:
        return [value for row, _, value, _ in self.read(**changes) if row == id]


def test_well_host_gives_no_reading() -> None:
    host = Host()
    assert [host.read() for _ in range(10)] == [[]] * 10


def test_frames_of_a_second_master_are_shown_the_first_four() -> None:
    health = BusHealth(foreign=(0x201, 0x000, 0x603, 0x080, 0x301))
    assert Host().read(bus=health) == [("COM-17", "", 1.0, "0x201, 0x000, 0x603, 0x080")]


def test_our_own_heartbeat_from_somebody_else_is_a_second_artemis() -> None:
    assert Host().read(bus=BusHealth(foreign=(0x201, 0x77F))) == [("COM-18", "", 1.0, "0x201, 0x77F")]


def test_refused_frames_are_counted_in_their_tick() -> None:
    host = Host()
    assert [host.values("COM-25", bus=BusHealth(refused=number)) for number in (3, 0, 1)] == [[3.0], [], [1.0]]


def test_every_frame_that_was_held_back_is_told() -> None:
    assert Host().read(bus=BusHealth(blocked=("one", "two"))) == [
        ("PLG-07", "", 1.0, "one"),
        ("PLG-07", "", 1.0, "two"),
    ]


def test_error_frames_are_those_of_a_tenth_of_a_second() -> None:
    host = Host()
    assert host.values("COM-20", bus=BusHealth(error_frames=2)) == [2.0]
    assert [host.values("COM-20") for _ in range(4)] == [[2.0]] * 4
    assert host.values("COM-20", after=PERIOD + 1e-9) == []


def test_stray_answers_are_those_of_a_second_of_each_drive() -> None:
    host = Host()
    assert host.values("COM-19", drives=drives(drive(SICK, stray=2), drive("traction-left", stray=1))) == [1.0, 2.0]
    assert host.values("COM-19", drives=drives(drive(SICK, stray=1)), after=0.9) == [1.0, 3.0]
    assert host.values("COM-19", after=0.2) == [1.0]
    assert host.values("COM-19", after=1.0) == []


def test_damaged_frames_are_those_of_a_second_of_all_drives() -> None:
    host = Host()
    assert host.values("COM-14", drives=drives(drive(SICK, malformed=2), drive("traction-left", malformed=1))) == [3.0]
    assert host.values("COM-14", drives=drives(drive(SICK, malformed=1)), after=0.9) == [4.0]
    assert host.values("COM-14", after=0.2) == [1.0]
    assert host.values("COM-14", after=1.0) == []


def test_stray_answer_is_told_in_its_tick() -> None:
    host = Host()
    assert host.values("COM-09", drives=drives(drive(SICK, stray=3))) == [1.0]
    assert host.values("COM-09") == []


def test_emergencies_are_those_of_a_second_of_each_drive() -> None:
    host = Host()
    assert host.values("DRV-33", drives=drives(drive(SICK, emergencies=(0x2310, 0x0000)))) == [2.0]
    assert host.values("DRV-33", drives=drives(drive(SICK, emergencies=(0x8611,))), after=0.9) == [3.0]
    assert host.values("DRV-33", after=0.2) == [1.0]


UNDER_VOLTAGE = 0x3220


def test_drives_without_supply_are_counted_each_once() -> None:
    host = Host()
    lost = {name: drive(name, emergencies=(UNDER_VOLTAGE,)) for name in NAMES}
    assert host.values("EST-01", drives=drives(drive(NAMES[0], emergencies=(UNDER_VOLTAGE, UNDER_VOLTAGE)))) == [1.0]
    assert host.values("EST-01", drives=drives(lost[NAMES[0]])) == [1.0], "twice the same"
    assert host.values("EST-01", drives=drives(lost[NAMES[1]], lost[NAMES[2]])) == [3.0]
    assert host.values("EST-01", after=0.03) == [2.0]
    assert host.values("EST-01", after=0.03) == []
    assert host.values("EST-01", drives=drives(drive(SICK, emergencies=(0x2310,)))) == []


# ---------------------------------------------------------------------------------------------- schedule


def test_lateness_is_read_as_it_is() -> None:
    readings = Host().read(late=0.123)
    assert readings == [("SYS-01", "", 0.123, "123 ms"), ("SYS-03", "", 0.123, "for 123 ms")]


def test_gap_between_two_heartbeats_is_read_above_a_tenth_of_a_second() -> None:
    host = Host()
    host.read()
    assert host.values("COM-31", after=0.1 - 1e-9) == []
    assert host.values("COM-31", after=0.12) == [pytest.approx(0.12)]


def test_heartbeat_that_is_withheld_is_not_late() -> None:
    host = Host()
    host.read()
    withheld = replace(DRIVING, heartbeat=False)
    host.read(withheld)
    assert host.values("COM-31", after=0.5, wish=withheld) == []
    assert host.values("COM-31", after=0.5, wish=DRIVING) == []
    assert host.values("COM-31", after=0.5, wish=DRIVING) == [pytest.approx(0.5)]


def test_extra_tick_is_neither_late_nor_a_heartbeat() -> None:
    host = Host()
    host.read()
    assert host.read(late=0.5, urgent=True, after=0.06) == []
    assert host.values("COM-31", after=0.06) == [pytest.approx(0.12)]


# ---------------------------------------------------------------------------------------------- inputs


def stick(*axes: float, source: str = "stick") -> OperatorInput:
    return OperatorInput(source=source, axes=axes)


def jumps(*samples: OperatorInput | None, after: float = PERIOD) -> list[float]:
    """How many jumps were read after each sample."""
    host = Host()
    told = []
    for sample in samples:
        found = host.values("INP-08", inputs=() if sample is None else (sample,), after=after)
        told.append(found[0] if found else 0.0)
    return told


def test_axis_that_jumps_further_than_a_hand_moves_it_is_read() -> None:
    assert jumps(stick(0.0), stick(1.0), stick(-0.2), stick(1.0)) == [0.0] * 4
    assert jumps(stick(-0.5, 0.0), stick(0.7001, 0.0), stick(0.7001, 0.0), stick(0.7, -1.0)) == [0.0, 1.0, 1.0, 1.0]
    assert jumps(stick(0.0, -1.0), stick(0.0, 1.0), stick(0.0, -1.0)) == [0.0, 1.0, 2.0]


def test_jumps_are_those_of_half_a_second() -> None:
    assert jumps(stick(-1.0), stick(1.0), stick(1.0), stick(1.0), after=0.2) == [0.0, 1.0, 1.0, 1.0]
    assert jumps(stick(-1.0), stick(1.0), stick(1.0), stick(1.0), after=0.3) == [0.0, 1.0, 1.0, 0.0]


def test_first_sample_and_other_axes_are_no_jump() -> None:
    assert jumps(stick(1.0), None, stick(1.0), stick(), stick(-1.0), stick(-1.0, 1.0)) == [0.0] * 6


def test_each_input_has_its_own_axes() -> None:
    host = Host()
    for _ in range(3):
        both = (stick(-1.0), stick(1.0, source="wheel"))
        assert host.values("INP-08", inputs=both) == []
