"""Wheels, couplings and potentiometers, and what can be wrong with them."""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest
import yaml

from artemis.devices.epos_objects import Units
from artemis.sim.axis import Axis
from artemis.sim.wheels import DrivenWheel, PotentiometerFailure, SteeredWheel
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
ROBOT = RobotFile.model_validate(yaml.safe_load((ROBOTS / "artemis.yaml").read_text()))
TURN = 2000 * 946
"""Counts of a turn of a steered wheel."""


def steered(name: str = "steer-left") -> tuple[SteeredWheel, Axis]:
    axis = Axis(ROBOT.drives[name])
    return SteeredWheel(ROBOT, name, axis, start=0.0, zero_deg=0.0), axis


def shown(wheel: SteeredWheel, axis: Axis, now: float = 0.0) -> tuple[float, float]:
    wheel.turn()
    wheel.feel(random.Random(1), 0.0, now)
    return axis.analog


def degrees(wheel: SteeredWheel) -> float:
    return math.degrees(wheel.turn())


def test_motor_turns_its_wheel_and_the_potentiometers() -> None:
    wheel, axis = steered()
    axis.position = TURN / 12
    assert degrees(wheel) == pytest.approx(30.0)
    assert shown(wheel, axis) == pytest.approx((2.51 + 30 / 72, 2.48 - 30 / 72))


@pytest.mark.parametrize(
    ("stop", "travel", "ends"),
    [
        (47.0, None, (-47.0, 47.0)),
        (-47.0, None, (-47.0, 47.0)),
        (47.0, 90.0, (-43.0, 47.0)),
        (-47.0, 90.0, (-47.0, 43.0)),
    ],
)
def test_motor_turns_from_one_stop_to_the_other(stop: float, travel: float | None, ends: tuple[float, float]) -> None:
    words = yaml.safe_load((ROBOTS / "small_car.yaml").read_text())
    words["calibration"]["steering"]["middle"] = {"angle": "hard_stop", "stop_deg": stop, "travel_deg": travel}
    robot = RobotFile.model_validate(words)
    axis = Axis(robot.drives["steering"])
    wheel = SteeredWheel(robot, "steering", axis, start=0.0, zero_deg=0.5)
    found = []
    for turned in (-0.4, 0.4):
        axis.position = turned * 2000 * 500
        wheel.turn()
        found.append(math.degrees(wheel.angle) - 0.5)
    assert found == pytest.approx(ends)


@pytest.mark.parametrize("number", [0, 1])
def test_one_potentiometer_is_off_and_drifts(number: int) -> None:
    wheel, axis = steered()
    true = shown(wheel, axis)
    wheel.failures[number] = PotentiometerFailure(since=2.0, offset=0.1, drift=0.01)
    found = shown(wheel, axis, 5.0)
    assert found[number] == pytest.approx(true[number] + 0.13)
    assert found[1 - number] == true[1 - number]
    wheel.failures.clear()
    assert shown(wheel, axis, 6.0) == true


def test_potentiometer_at_a_rail_does_not_move() -> None:
    wheel, axis = steered()
    wheel.failures[1] = PotentiometerFailure(stuck=5.0)
    axis.position = TURN / 12
    assert shown(wheel, axis) == pytest.approx((2.51 + 30 / 72, 5.0))


def test_frozen_potentiometers_show_what_they_showed() -> None:
    wheel, axis = steered()
    axis.position = TURN / 36
    before = shown(wheel, axis)
    wheel.freeze()
    axis.position = TURN / 12
    wheel.feel(random.Random(1), 0.1, 1.0)
    assert axis.analog == before


def test_slipping_coupling_turns_the_wheel_without_its_motor() -> None:
    wheel, axis = steered("steer-right")
    wheel.slip_coupling(math.radians(6.0))
    assert degrees(wheel) == pytest.approx(6.0)
    assert axis.position == 0.0
    axis.position = -TURN / 12  # mirrored
    assert degrees(wheel) == pytest.approx(36.0)


@pytest.mark.parametrize(("name", "sign"), [("steer-left", 1), ("steer-right", -1)])
def test_wheel_turns_as_far_as_its_scale_says_and_the_robot_file_knows_a_part_of_it(name: str, sign: int) -> None:
    described = ROBOT.model_dump()
    for side in ("left", "right"):
        described["calibration"]["steering"][side]["scale"] = 1.02
    robot = RobotFile.model_validate(described)
    axis = Axis(robot.drives[name])
    wheel = SteeredWheel(robot, name, axis, start=0.0, zero_deg=0.0, scale=0.99)
    axis.position = sign * TURN / 12
    assert degrees(wheel) == pytest.approx(30.0 * 1.02 * 0.99)
    assert Units(robot, robot.drives[name]).counts == pytest.approx(sign * TURN / math.tau / 1.02)


def test_wheel_moves_once_the_play_is_taken_up_and_its_potentiometers_with_it() -> None:
    axis = Axis(ROBOT.drives["steer-left"])
    wheel = SteeredWheel(ROBOT, "steer-left", axis, start=0.0, zero_deg=0.0, backlash=math.radians(2.0))
    found = []
    for turned in (0.5, 5.0, 4.0, 2.5, 3.5, -3.0):
        axis.position = TURN * turned / 360
        assert math.degrees(wheel.turn()) == pytest.approx(degrees(wheel))
        found.append(degrees(wheel))
    assert found == pytest.approx([0.0, 4.0, 4.0, 3.5, 3.5, -2.0])
    assert shown(wheel, axis)[0] == pytest.approx(2.51 - 2.0 / 72)
    wheel.slip_coupling(math.radians(6.0))
    assert degrees(wheel) == pytest.approx(4.0)
    wheel.couple(False)
    axis.position = 0.0
    assert math.degrees(wheel.turn()) == pytest.approx(4.0)


def test_detached_wheel_stays_and_turns_on_from_there() -> None:
    wheel, axis = steered()
    axis.position = TURN / 36
    wheel.couple(False)
    axis.position = TURN / 12
    assert degrees(wheel) == pytest.approx(10.0)
    wheel.couple(True)
    assert degrees(wheel) == pytest.approx(10.0)
    axis.position += TURN / 36
    assert degrees(wheel) == pytest.approx(20.0)


def driven(name: str) -> tuple[DrivenWheel, Axis]:
    axis = Axis(ROBOT.drives[name])
    return DrivenWheel(ROBOT, name, axis, scale=1.0), axis


@pytest.mark.parametrize(("name", "sign"), [("traction-left", 1.0), ("traction-right", -1.0)])
def test_spinning_wheel_turns_faster_and_gets_as_far(name: str, sign: float) -> None:
    wheel, axis = driven(name)
    wheel.spin(0.4)
    assert axis.failure is not None
    assert axis.failure.gain == pytest.approx(1 / 0.6)
    axis.position = sign * 1000.0 / 0.6
    assert wheel.roll() == pytest.approx(1000.0 * ROBOT.metres_per_count("left"))
    wheel.spin(0.0)
    assert axis.failure is None
    axis.position += sign * 1000.0
    assert wheel.roll() == pytest.approx(1000.0 * ROBOT.metres_per_count("left"))


@pytest.mark.parametrize(("name", "sign"), [("traction-left", 1.0), ("traction-right", -1.0)])
def test_push_accelerates_forward_whatever_way_the_motor_turns(name: str, sign: float) -> None:
    wheel, axis = driven(name)
    wheel.push(1.0)
    for _ in range(20):
        axis.step(0.005)
    assert axis.velocity * sign > 0.0
    metres_per_second = abs(axis.velocity) / 60.0 * axis.counts_per_turn * ROBOT.metres_per_count("left")
    assert metres_per_second == pytest.approx(0.1 * (1.0 - 0.122), rel=0.02)
