from __future__ import annotations

from math import inf, isfinite, nan, radians
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.motion.ackermann import Ackermann
from artemis.motion.limits import LONGEST_STEP, Gate, is_sane
from artemis.values import Action, DriveCommand, SetPoints
from artemis.vehicle import RobotFile

SETTINGS = settings(derandomize=True, deadline=None, max_examples=max(200, settings().max_examples))
FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
ARTEMIS = RobotFile.model_validate(yaml.safe_load(FILE.read_text(encoding="utf-8")))
DT_MAX = 0.1
TOLERANCE = 1e-9


def variant(geometry: dict[str, object], **limits: float) -> RobotFile:
    return ARTEMIS.model_copy(
        update={
            "geometry": ARTEMIS.geometry.model_copy(update=geometry),
            "limits": ARTEMIS.limits.model_copy(update=limits),
        }
    )


ROBOTS = [
    ARTEMIS,
    variant({}, wheel_speed_m_s=0.5),  # slower wheels than the vehicle's limit
    variant({}, deceleration_m_s2=0.1, steering_rate_wheel_deg_s=200.0),  # steers faster than it can slow down
    variant({}, wheel_speed_m_s=0.02, steering_deg=79.0),  # a steered wheel rolls faster than it may
    variant({"driven_axle": "rear"}, wheel_speed_m_s=0.5),
    variant({"scrub_radius_m": 0.0, "track_m": 1.5}, acceleration_m_s2=5.0),
]

wild = st.sampled_from([nan, inf, -inf, 0.0, -0.0, 1e308, -1e308, 5e-324])
tame = st.floats(-1.5, 1.5)
numbers = st.one_of(tame, tame, wild, st.floats())
commands = st.builds(
    DriveCommand,
    speed=numbers,
    steering=numbers,
    action=st.sampled_from([Action.RUN] * 8 + [Action.QUICKSTOP, Action.DISABLE]),
)
durations = st.one_of(
    st.floats(0.0, 0.12), st.just(0.02), st.sampled_from([0.0, 1e-9, 1e-6, 1e-5, 30.0, inf, nan, -1.0])
)
ceilings = st.one_of(st.just(inf), st.just(inf), st.floats(0.0, 1.0), st.floats())
steps = st.tuples(commands, durations, ceilings, st.sampled_from([False, False, False, True]))
angles = st.floats(-1.5, 1.5)


def counted(dt: float) -> float:
    """The time that a step of `dt` stands for."""
    return min(dt, DT_MAX) if dt > 0.0 else 0.0


def check_limits(robot: RobotFile, command: DriveCommand, last: SetPoints, made: SetPoints, dt: float) -> None:
    """Everything that must hold from one tick to the next."""
    limits = robot.limits
    assert all(isfinite(getattr(made, name)) for name in SetPoints.__struct_fields__ if name != "clearance")
    assert abs(made.speed) <= limits.speed_m_s + TOLERANCE
    assert max(abs(made.speed_left), abs(made.speed_right)) <= limits.wheel_speed_m_s + TOLERANCE
    assert abs(made.steering) <= max(radians(limits.steering_deg), abs(last.steering)) + TOLERANCE
    rate = radians(limits.steering_rate_wheel_deg_s) * counted(dt) + TOLERANCE
    assert abs(made.steering_left - last.steering_left) <= rate
    assert abs(made.steering_right - last.steering_right) <= rate
    if command.action is Action.RUN:
        faster = abs(made.speed) > abs(last.speed)
        bound = limits.acceleration_m_s2 if faster else limits.deceleration_m_s2
        assert abs(made.speed - last.speed) <= bound * counted(dt) + TOLERANCE
        assert made.speed * last.speed >= 0.0


@SETTINGS
@given(st.sampled_from(ROBOTS), st.lists(steps, min_size=1, max_size=60))
def test_limits_hold_for_any_sequence(
    robot: RobotFile, sequence: list[tuple[DriveCommand, float, float, bool]]
) -> None:
    gate, car, last = Gate(robot, DT_MAX / LONGEST_STEP), Ackermann(robot.geometry), SetPoints()
    for command, dt, ceiling, stop in sequence:
        made = gate.limit(command, last, dt, ceiling, stop)
        check_limits(robot, command, last, made, dt)
        assert (made.steering_left, made.steering_right) == pytest.approx(car.wheel_angles(made.steering), abs=1e-9)
        last = made


@SETTINGS
@given(
    st.sampled_from(ROBOTS),
    st.lists(st.tuples(tame, tame), min_size=1, max_size=8),
    st.sampled_from([0.005, 0.02, 0.1]),
)
def test_limits_hold_for_commands_that_last(robot: RobotFile, wishes: list[tuple[float, float]], dt: float) -> None:
    gate, last = Gate(robot, DT_MAX / LONGEST_STEP), SetPoints()
    for speed, steering in wishes:
        command = DriveCommand(speed=speed, steering=steering)
        for _ in range(40):
            made = gate.limit(command, last, dt)
            check_limits(robot, command, last, made, dt)
            last = made


@SETTINGS
@given(st.sampled_from(ROBOTS), st.lists(steps, max_size=20), commands, st.floats(0.001, 0.1), ceilings)
def test_stops_are_never_slowed(
    robot: RobotFile,
    before: list[tuple[DriveCommand, float, float, bool]],
    command: DriveCommand,
    dt: float,
    ceiling: float,
) -> None:
    gate, last = Gate(robot, DT_MAX / LONGEST_STEP), SetPoints()
    for step in before:
        last = gate.limit(step[0], last, *step[1:])
    made = gate.limit(command, last, dt, ceiling, stop=True)
    expected = (
        0.0 if command.action is not Action.RUN else max(0.0, abs(last.speed) - robot.limits.deceleration_m_s2 * dt)
    )
    assert abs(made.speed) == pytest.approx(expected, abs=1e-12)
    assert (made.steering_left, made.steering_right) == (last.steering_left, last.steering_right)
    if not is_sane(command):
        assert gate.limit(command, last, dt, ceiling) == made


@SETTINGS
@given(
    st.sampled_from(ROBOTS),
    st.lists(st.tuples(tame, tame), max_size=5),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
    st.sampled_from([0.01, 0.02, 0.04]),
)
def test_feasible_command_is_reached_exactly(
    robot: RobotFile, before: list[tuple[float, float]], speed_share: float, steering_share: float, dt: float
) -> None:
    gate, car, last = Gate(robot, DT_MAX / LONGEST_STEP), Ackermann(robot.geometry), SetPoints()
    for speed, steering in before:
        for _ in range(20):
            last = gate.limit(DriveCommand(speed=speed, steering=steering), last, dt)
    steering = steering_share * radians(robot.limits.steering_deg)
    feasible = min(robot.limits.speed_m_s, robot.limits.wheel_speed_m_s / max(map(abs, car.speed_ratios(steering))))
    command = DriveCommand(speed=speed_share * feasible, steering=steering)
    for _ in range(int(25.0 / dt)):
        made = gate.limit(command, last, dt)
        if made == last:
            break
        last = made
    assert (last.speed, last.steering) == pytest.approx((command.speed, command.steering), abs=1e-12)
    assert (last.steering_left, last.steering_right) == car.wheel_angles(last.steering)
    assert (last.speed_left, last.speed_right) == pytest.approx(car.wheel_speeds(last.speed, last.steering), abs=1e-12)


@SETTINGS
@given(st.sampled_from(ROBOTS), angles, angles, st.lists(st.tuples(commands, st.floats(0.001, 0.1)), max_size=20), tame)
def test_limits_hold_and_wheels_align_from_any_angles(
    robot: RobotFile, left: float, right: float, sequence: list[tuple[DriveCommand, float]], target: float
) -> None:
    gate, car = Gate(robot, DT_MAX / LONGEST_STEP), Ackermann(robot.geometry)
    last = SetPoints(steering=car.steering_from_wheel_angles(left, right), steering_left=left, steering_right=right)
    for command, dt in sequence:
        made = gate.limit(command, last, dt)
        assert max(abs(made.speed_left), abs(made.speed_right)) <= robot.limits.wheel_speed_m_s + TOLERANCE
        rate = radians(robot.limits.steering_rate_wheel_deg_s) * dt + TOLERANCE
        assert abs(made.steering_left - last.steering_left) <= rate
        assert abs(made.steering_right - last.steering_right) <= rate
        last = made
    for _ in range(1000):
        last = gate.limit(DriveCommand(steering=target), last, 0.1)
    bound = radians(robot.limits.steering_deg)
    assert last.steering == pytest.approx(min(max(target, -bound), bound), abs=1e-12)
    assert (last.steering_left, last.steering_right) == car.wheel_angles(last.steering)
