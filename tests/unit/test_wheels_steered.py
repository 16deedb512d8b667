"""What is measured of the steered wheels and of the wish, reading by reading. Limits: test_supervisor_rows.py."""

from __future__ import annotations

import math
from math import radians
from pathlib import Path
from typing import Any

import pytest
from core_builders import PERIOD, ROBOT, STEERING, drive, volts
from msgspec.structs import replace
from supervision_rig import DRIVING, REFERENCED, STEER_LEFT, STEER_RIGHT, STOPPING, Road, road

from artemis.axles import AbsoluteEncoder
from artemis.drive_states import DriveState, Goal
from artemis.mission.loading import load_model
from artemis.supervision.steered import SteeredWheelMonitor
from artemis.supervision.wheels import Wheels
from artemis.values import DriveCommand, JobKind, JobResult, Tracking
from artemis.vehicle import RobotFile

# ---------------------------------------------------------------------------------------------- steering


@pytest.mark.parametrize(("off_by", "there"), [(0.019, False), (0.021, True), (-0.021, True), (0.5, True)])
@pytest.mark.parametrize("side", [0, 1])
def test_wheel_away_from_its_angle_is_read(off_by: float, there: bool, side: int) -> None:
    made = road(0.0, 0.3)
    made.angles[side] += off_by
    made.tick()
    assert made.value("STE-01", STEERING[side]) == (pytest.approx(abs(off_by)) if there else None)
    assert made.value("STE-01", STEERING[1 - side]) is None


@pytest.mark.parametrize("goal", [Goal.HOLD, Goal.DISABLED])
def test_wheel_that_shall_not_turn_has_no_angle_to_reach(goal: Goal) -> None:
    made = road()
    made.wish = replace(DRIVING, steering=goal)
    made.angles[0] += 0.5
    made.tick()
    assert made.value("STE-01", STEER_LEFT) is None


def test_wheel_whose_drive_is_off_has_no_angle_to_reach() -> None:
    made = road()
    made.angles[0] += 0.5
    made.ill(STEER_LEFT, state=DriveState.SWITCHED_ON)
    made.tick()
    assert made.value("STE-01", STEER_LEFT) is None


@pytest.mark.parametrize(("current", "load"), [(0.99, None), (1.01, 0.505), (-1.9, 0.95), (2.0, 1.0)])
def test_current_is_read_as_a_part_of_its_limit(current: float, load: float | None) -> None:
    made = road()
    made.ill(STEER_RIGHT, current=current)
    made.tick()
    assert made.value("STE-02", STEER_RIGHT) == (None if load is None else pytest.approx(load))


@pytest.mark.parametrize(("first", "there"), [(0.099, True), (0.1, False), (4.9, False), (4.901, True)])
def test_potentiometer_at_a_rail_is_read_and_tells_nothing_else(first: float, there: bool) -> None:
    made = road()
    made.reference()
    made.ill(STEER_LEFT, potentiometers=(first, 2.48))
    made.tick()
    assert made.value("STE-04", STEER_LEFT) == (1.0 if there else None)
    assert (made.value("STE-03", STEER_LEFT) is None) is there
    assert (made.value("STE-05", STEER_LEFT) is None) is there


@pytest.mark.parametrize(("apart", "value"), [(1.4, None), (1.6, 1.6 / 3), (-2.9, 2.9 / 3), (6.0, 2.0)])
def test_potentiometers_that_disagree_are_read_as_a_part_of_what_is_allowed(apart: float, value: float | None) -> None:
    made = road()
    first, second = volts("left", 0.0)
    made.ill(STEER_LEFT, potentiometers=(first, second - apart / 72.0))
    made.tick()
    assert made.value("STE-03", STEER_LEFT) == (None if value is None else pytest.approx(value))


def displaced(made: Road, name: str, by: float) -> None:
    """Potentiometers and encoder of a wheel differ by this [rad]."""
    side = ROBOT.drives[name].side
    made.ill(name, potentiometers=volts(side, made.angles[STEERING.index(name)] + by))


@pytest.mark.parametrize(("away", "there"), [(0.019, False), (0.021, True), (-0.1, True)])
def test_potentiometers_away_from_the_encoder_are_read_once_the_wheel_is_aligned(away: float, there: bool) -> None:
    made = road(0.0, 0.2)
    displaced(made, STEER_RIGHT, away)
    made.tick()
    assert made.value("STE-05", STEER_RIGHT) is None
    made.reference()
    assert made.value("STE-05", STEER_RIGHT) == (pytest.approx(abs(away)) if there else None)


def job(kind: JobKind, ok: bool = True) -> dict[str, Any]:
    return {"results": (JobResult(id=1, kind=kind, drive=STEER_LEFT, ok=ok),)}


def test_alignment_counts_until_the_drive_is_configured_anew() -> None:
    made = road()
    displaced(made, STEER_LEFT, 0.1)
    made.tick(**job(JobKind.REFERENCE, ok=False))
    assert made.value("STE-05", STEER_LEFT) is None
    made.tick(**job(JobKind.REFERENCE))
    made.tick(**job(JobKind.CLEAR_TARGET))
    assert made.value("STE-05", STEER_LEFT) == pytest.approx(0.1)
    made.tick(**job(JobKind.CONFIGURE))
    assert made.value("STE-05", STEER_LEFT) is None
    made.tick(**job(JobKind.CONFIGURE))
    assert made.value("STE-05", STEER_LEFT) is None


def test_results_of_jobs_count_also_while_nothing_is_exchanged() -> None:
    made = road()
    displaced(made, STEER_LEFT, 0.1)
    made.wish = replace(DRIVING, exchange=False)
    made.tick(results=REFERENCED)
    made.wish = DRIVING
    made.tick()
    assert made.value("STE-05", STEER_LEFT) == pytest.approx(0.1)


@pytest.mark.parametrize("stuck", [0, 1])
def test_potentiometer_that_stays_while_the_wheel_turns_is_read(stuck: int) -> None:
    made = road()
    made.reference()
    frozen = volts("left", 0.0)[stuck]
    for turned in (0.02, 0.049, 0.051, 0.2):
        made.angles[0] = turned
        pair = list(volts("left", turned))
        pair[stuck] = frozen
        made.ill(STEER_LEFT, potentiometers=tuple(pair))
        made.tick()
        assert made.value("STE-07", STEER_LEFT) == (pytest.approx(turned) if turned > 0.05 else None)
    made.well()
    made.tick()
    assert made.value("STE-07", STEER_LEFT) is None, "it moved"


def test_potentiometers_without_a_calibration_tell_no_angle_and_still_show_that_they_are_torn_off_or_stay() -> None:
    made = road()
    made.wheels = Wheels(ROBOT, PERIOD, blind=True)
    made.reference()
    made.ill(STEER_LEFT, potentiometers=(1.0, 2.0))
    made.ill(STEER_RIGHT, potentiometers=(0.0, 2.5))
    made.tick()
    assert made.seen == {("STE-04", STEER_RIGHT): 1.0}
    made.well()
    made.ill(STEER_LEFT, potentiometers=(1.0, 2.0))
    made.angles[0] = 0.06
    made.tick()
    assert made.value("STE-07", STEER_LEFT) == pytest.approx(0.06)


def test_new_reference_is_no_turn() -> None:
    made = road()
    made.reference()
    pair = volts("left", 0.0)
    made.ill(STEER_LEFT, potentiometers=pair)
    made.angles[0] = 0.3
    made.tick(**job(JobKind.REFERENCE))
    assert made.value("STE-07", STEER_LEFT) is None
    made.ill(STEER_RIGHT, potentiometers=volts("right", 0.0))
    made.angles[1] = 0.3
    made.tick(**job(JobKind.REFERENCE))
    assert made.value("STE-07", STEER_RIGHT) == pytest.approx(0.3), "of the other wheel nothing was forgotten"


@pytest.mark.parametrize("trouble", [{"age": None}, {"age": 0.0801}], ids=str)
@pytest.mark.parametrize("name", STEERING)
def test_nothing_is_said_of_a_steered_wheel_that_is_not_heard(name: str, trouble: dict[str, Any]) -> None:
    made = road()
    made.reference()
    made.ill(name, **trouble, potentiometers=(0.0, 0.0), current=9.0, position=0.01)
    made.tick()
    assert made.seen == {}


@pytest.mark.parametrize(("apart", "there"), [(0.019, False), (0.021, True), (-0.3, True)])
def test_wheels_that_are_no_pair_are_read(apart: float, there: bool) -> None:
    made = road(0.0, 0.4)
    made.reference()
    made.angles[1] += apart
    made.tick()
    assert made.value("STE-06") == (pytest.approx(abs(apart)) if there else None)


@pytest.mark.parametrize("missing", STEERING)
def test_wheels_need_be_a_pair_only_once_both_are_aligned(missing: str) -> None:
    made = road()
    made.angles[1] = 0.3
    made.tick(results=tuple(result for result in REFERENCED if result.drive != missing))
    assert made.value("STE-06") is None


def test_wheels_need_be_a_pair_only_where_the_robot_may_drive() -> None:
    made = road()
    made.reference()
    made.wish = replace(DRIVING, traction=Goal.DISABLED)
    made.angles[1] = 0.3
    made.tick()
    assert made.value("STE-06") is None


# ---------------------------------------------------------------------------------------------- the wish itself


def wished(speed: float, steering_deg: float = 0.0, tracking: Tracking | None = None) -> Road:
    made = Road()
    made.wish = replace(DRIVING, command=DriveCommand(speed=speed, steering=radians(steering_deg)), tracking=tracking)
    made.tick()
    return made


@pytest.mark.parametrize(
    ("speed", "steering_deg", "beyond"),
    [(0.7, 60.0, None), (0.77, 0.0, 0.1), (-0.77, 0.0, 0.1), (0.0, 66.0, 0.1), (0.0, -66.0, 0.1), (1.4, 66.0, 1.0)],
)
def test_command_beyond_the_limits_is_read_as_the_part_beyond(
    speed: float, steering_deg: float, beyond: float | None
) -> None:
    value = wished(speed, steering_deg).value("RUN-12")
    assert value is None or value > 1e-9
    assert (value or 0.0) == pytest.approx(beyond or 0.0, abs=1e-9)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_command_that_is_not_a_number_is_no_trouble_here(number: float) -> None:
    for made in (wished(number), wished(0.0, number)):
        assert made.rows() <= {"RUN-12"}


def test_numbers_of_a_stop_are_not_judged() -> None:
    made = Road()
    made.wish = replace(STOPPING, command=replace(STOPPING.command, speed=9.0))
    made.tick()
    assert made.seen == {}


def along(arc_length: float, cross_track: float = 0.0) -> Tracking:
    return Tracking(arc_length=arc_length, length=9.0, cross_track=cross_track)


@pytest.mark.parametrize(("away", "there"), [(0.2, False), (0.21, True), (-0.21, True)])
def test_robot_away_from_its_path_is_read(away: float, there: bool) -> None:
    made = wished(0.3, tracking=along(0.9))
    made.wish = replace(made.wish, tracking=along(1.0, away))
    made.tick()
    assert made.value("PTH-06") == (abs(away) if there else None)


def test_robot_that_was_not_on_its_path_yet_is_not_away_from_it() -> None:
    made = wished(0.3, tracking=along(0.0, 0.5))
    assert made.value("PTH-06") is None
    for cross_track in (0.2, 0.5):
        made.wish = replace(made.wish, tracking=along(1.0, cross_track))
        made.tick()
    assert made.value("PTH-06") == 0.5
    for tracking in (None, along(0.0, 0.5)):
        made.wish = replace(made.wish, tracking=tracking)
        made.tick()
    assert made.value("PTH-06") is None


def progress(*steps: tuple[float, float | None]) -> list[bool]:
    """Ticks with these commanded speeds and arc lengths; whether each was one without progress."""
    made, told = Road(), []
    for speed, arc_length in steps:
        tracking = None if arc_length is None else along(arc_length)
        made.wish = replace(DRIVING, command=DriveCommand(speed=speed), tracking=tracking)
        made.tick()
        told.append(made.value("PTH-07") == 1.0)
    return told


def test_way_along_the_path_is_progress() -> None:
    assert progress((0.3, 1.0), (0.3, 1.005), (0.3, 1.0099), (0.3, 1.02), (0.3, 1.02)) == [
        False,
        True,
        True,
        False,
        True,
    ]
    assert progress((0.3, 1.0), (0.3, 0.98), (0.3, 0.98)) == [False, False, True], "backwards, too"


def test_robot_that_shall_stand_or_follows_nothing_makes_no_progress() -> None:
    assert progress((0.3, 1.0), (0.0, 1.0), (0.3, 1.0), (0.3, 1.0)) == [False, False, False, True]
    assert progress((0.3, 1.0), (0.3, None), (0.3, 1.0)) == [False] * 3
    assert progress((-0.3, 1.0), (-0.3, 1.0)) == [False, True]


@pytest.mark.parametrize(("away", "there"), [(0.019, False), (-0.021, True), (0.1, True)])
def test_an_absolute_encoder_is_held_against_the_motor_once_the_wheel_is_aligned(away: float, there: bool) -> None:
    robot = load_model(Path(__file__).parents[2] / "missions/robots/artemis_absolute.yaml", RobotFile)
    monitor, known = SteeredWheelMonitor(robot, "right", blind=False), robot.angle_source("right")
    assert isinstance(known, AbsoluteEncoder)
    shows = round((known.zero_deg - math.degrees(0.3)) / 360.0 * (1 << known.bits))  # it is mirrored
    said = drive(STEER_RIGHT, position=0.3 + away, angle_sensor=shows, potentiometers=(0.0, 0.0))
    assert monitor.read(said, 0.3 + away, turns=False) == []
    monitor.learn(JobResult(id=1, kind=JobKind.REFERENCE, drive=STEER_RIGHT, ok=True))
    found = {row: value for row, _, value, _ in monitor.read(said, 0.3 + away, turns=False)}
    assert found == ({"STE-05": pytest.approx(abs(away), abs=1e-4)} if there else {})
