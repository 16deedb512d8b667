"""Regulators that compute with their gains, on a load with inertia, friction, play and dead time."""

from __future__ import annotations

import math

import pytest
from servo_machines import DRIVES, ROBOT

from artemis.families.epos1 import GAIN_SCALE
from artemis.sim.axis import LOADS, Axis, Regulation
from artemis.sim.servo import ServoAxis, TrueLoad
from artemis.sim.world import PlantParameters, World

DRIVE = DRIVES["traction"]


def turned(axis: ServoAxis, target: float, seconds: float) -> list[float]:
    """Velocities after each millisecond [rpm]."""
    axis.acceleration = axis.deceleration = 1e9
    axis.regulate(Regulation.VELOCITY, target)
    found = []
    for _ in range(round(1e3 * seconds)):
        axis.step(1e-3)
        found.append(axis.velocity)
    return found


def test_the_loop_is_the_one_of_its_gains() -> None:
    axis = ServoAxis(DRIVE, TrueLoad(friction_scale=0.0))
    axis.tune((400, 120, 12000, 0, 150, 10, 200), None)
    p = 1e3 * GAIN_SCALE.velocity[0] * 12000 * math.tau / 60.0  # [mA/rpm]
    lag = LOADS["traction"].inertia / p  # first order, without I and friction
    assert turned(axis, 100.0, lag)[-1] == pytest.approx(100.0 * (1.0 - math.exp(-1.0)), rel=0.03)


def test_more_inertia_is_slower_and_friction_leaves_an_error_without_i() -> None:
    light, heavy = (ServoAxis(DRIVE, TrueLoad(inertia_scale=scale, friction_scale=2.0)) for scale in (1.0, 4.0))
    for axis in (light, heavy):
        axis.tune((400, 120, 12000, 0, 150, 10, 200), None)
    assert turned(heavy, 300.0, 0.02)[-1] < 0.4 * turned(light, 300.0, 0.02)[-1]
    error = 300.0 - turned(light, 300.0, 1.0)[-1]
    assert error == pytest.approx((600.0 + 0.1 * 300.0) / (12000 * 20e-3 * math.tau / 60.0), rel=0.05)


def test_what_is_measured_late_swings() -> None:
    def largest(delay: float) -> float:
        axis = ServoAxis(DRIVE, TrueLoad(delay_ms=delay))
        axis.tune((400, 120, 12000, 100, 150, 10, 200), None)
        return max(turned(axis, 300.0, 1.0))

    assert largest(0.0) < 310.0
    assert largest(40.0) > 400.0


def test_a_motor_in_its_play_turns_alone() -> None:
    axis = ServoAxis(DRIVE, TrueLoad(play_deg=3.0, rotor_share=0.2))
    whole = ServoAxis(DRIVE, TrueLoad())
    alone, together = turned(axis, 300.0, 0.01)[-1], turned(whole, 300.0, 0.01)[-1]
    assert alone > 2.0 * together


def test_without_gains_there_is_no_torque_and_a_blocked_shaft_stands() -> None:
    axis = ServoAxis(DRIVE, TrueLoad())
    axis.tune((400, 120, 0, 0, 0, 0, 0), None)
    assert set(turned(axis, 300.0, 0.1)) == {0.0}
    blocked = ServoAxis(DRIVE, TrueLoad())
    blocked.fail(blocked=True)
    assert set(turned(blocked, 300.0, 0.1)) == {0.0}
    assert blocked.current > 0.0


def test_only_the_role_that_is_named_is_simulated_so() -> None:
    world = World(ROBOT, PlantParameters.model_validate({"loads": {"traction": {"inertia_scale": 2.0}}}))
    kinds = {name: type(node.axis) for name, node in zip(ROBOT.drives, world.nodes, strict=True)}
    assert kinds == {"traction-left": ServoAxis, "traction-right": ServoAxis, "steer-left": Axis, "steer-right": Axis}
