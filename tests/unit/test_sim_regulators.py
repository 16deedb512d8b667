"""Gains of the simulated drives: nominal ones change nothing, bad ones show as such."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from sim_epos_rig import STEERING, TRACTION, Rig

from artemis.drive_schema import Drive, Gains
from artemis.motion.arrays import Array
from artemis.motion.step_response import StepResponse, step_response
from artemis.sim.axis import Axis, Regulation
from artemis.sim.epos_parameters import SAVE
from artemis.sim.regulators import Loop, regulators_for

NOMINAL = (500, 150, 1000, 100, 150, 10, 200)
OBJECTS = [(0x60F6, 1), (0x60F6, 2), (0x60F9, 1), (0x60F9, 2), (0x60FB, 1), (0x60FB, 2), (0x60FB, 3)]
DT = 0.002


def with_gains(**changes: int) -> tuple[int, ...]:
    names = ("current_p", "current_i", "velocity_p", "velocity_i", "position_p", "position_i", "position_d")
    return tuple(changes.get(name, gain) for name, gain in zip(names, NOMINAL, strict=True))


def axis_with(drive: Drive, gains: Sequence[int]) -> Axis:
    axis = Axis(drive)
    axis.continuous_current, axis.output_current, axis.thermal_time = 5000.0, 10000.0, 52.6
    axis.fail(regulators=regulators_for(gains, NOMINAL))
    return axis


def speeds(gains: Sequence[int], target: float = 800.0, seconds: float = 4.0) -> StepResponse:
    """A traction drive ramps to a speed [rpm] in 0.4 s."""
    axis = axis_with(TRACTION, gains)
    axis.acceleration = target / 0.4
    axis.regulate(Regulation.VELOCITY, target)
    rows = []
    for _ in range(round(seconds / DT)):
        rows.append((axis.demand_velocity, axis.velocity, axis.current))
        axis.step(DT)
    return response(rows)


def angles(gains: Sequence[int], target: float = 26000.0, seconds: float = 2.0) -> StepResponse:
    """A steering drive is led to a place [counts] in 0.15 s."""
    axis = axis_with(STEERING, gains)
    axis.regulate(Regulation.POSITION, 0.0)
    rows = []
    for index in range(round(seconds / DT)):
        axis.regulate(Regulation.POSITION, min(target, target * index * DT / 0.15))
        axis.step(DT)
        rows.append((axis.target, axis.position, axis.current))
    return response(rows)


def response(rows: Sequence[tuple[float, float, float]]) -> StepResponse:
    table: Array = np.array(rows, dtype=np.float64)
    time: Array = np.arange(len(table), dtype=np.float64) * DT
    return step_response(time, table[:, 0], table[:, 1], table[:, 2] / 1000.0)


def test_nominal_gains_are_no_loops_of_their_own() -> None:
    assert regulators_for(NOMINAL, NOMINAL) is None
    axis = axis_with(TRACTION, NOMINAL)
    assert axis.failure is None


def test_a_stiffer_speed_loop_trails_less() -> None:
    nominal, half, double = (
        speeds(with_gains(velocity_p=p, velocity_i=i)) for p, i in ((1000, 100), (500, 50), (2000, 100))
    )
    assert nominal.largest_error == pytest.approx(2000.0 * 0.003 / 1.4, rel=0.1)  # steps of 2 ms are coarse
    assert half.largest_error > 1.8 * nominal.largest_error
    assert double.largest_error < 0.6 * nominal.largest_error


def test_a_stiffer_position_loop_trails_less() -> None:
    nominal, half, double = (
        angles(with_gains(position_p=p, position_d=d)) for p, d in ((150, 200), (75, 200), (300, 400))
    )
    assert half.largest_error > 1.4 * nominal.largest_error
    assert double.largest_error < 0.7 * nominal.largest_error


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_too_much_integral_part_overshoots_and_more_of_it_swings_longer(factor: int) -> None:
    less, more = (speeds(with_gains(velocity_i=100 * factor * k)) for k in (1, 2))
    assert less.overshoot is not None
    assert more.overshoot is not None
    assert 0.02 < less.overshoot < more.overshoot
    assert more.settled_5 is None or (less.settled_5 is not None and more.settled_5 > less.settled_5)


@pytest.mark.parametrize("name", ["position_p", "position_i"])
def test_a_position_loop_without_enough_damping_swings(name: str) -> None:
    fine = angles(with_gains())
    found = angles(with_gains(**{name: 4 * NOMINAL[4 if name == "position_p" else 5]}))
    assert fine.overshoot == pytest.approx(0.0, abs=1e-3)
    assert found.overshoot is not None
    assert found.overshoot > 0.03


def test_more_than_four_times_the_nominal_p_of_the_speed_swings() -> None:
    still = speeds(with_gains(velocity_p=3900, velocity_i=390))
    found = speeds(with_gains(velocity_p=12000, velocity_i=1200))
    assert still.overshoot is not None
    assert found.overshoot is not None
    assert still.overshoot < 0.01 < found.overshoot


@pytest.mark.parametrize("gains", [with_gains(velocity_p=0), with_gains(current_p=0, current_i=0)])
def test_without_p_or_current_nothing_turns(gains: tuple[int, ...]) -> None:
    found = speeds(gains)
    assert found.rise is None
    assert found.steady_error == pytest.approx(800.0)
    assert found.peak_current == 0.0


def test_without_p_a_position_is_not_reached_and_a_shaft_that_turns_rolls_out() -> None:
    assert angles(with_gains(position_p=0)).rise is None
    axis = axis_with(TRACTION, with_gains(velocity_p=0))
    axis.velocity = 800.0
    axis.regulate(Regulation.VELOCITY, 0.0)
    axis.step(DT)
    assert 790.0 < axis.velocity < 800.0


def test_without_any_d_the_loop_swings_and_stays_bounded() -> None:
    found = angles(with_gains(position_d=0))
    assert found.overshoot is not None
    assert 0.05 < found.overshoot < 1.5
    assert found.settled_5 is None


def test_loop_begins_where_the_shaft_is_each_time() -> None:
    axis = axis_with(STEERING, with_gains(position_p=600))
    axis.regulate(Regulation.POSITION, 1000.0)
    for _ in range(1000):
        axis.step(DT)
    axis.regulate(Regulation.OFF, 0.0)
    axis.position = 50000.0
    axis.step(DT)
    axis.regulate(Regulation.POSITION, 50000.0)
    axis.step(DT)
    assert axis.position == pytest.approx(50000.0, abs=1.0)


@pytest.mark.parametrize("ratio", [1.5, 3.0, 10.0])
def test_a_loop_is_a_second_order_system_of_its_damping(ratio: float) -> None:
    loop, dt = Loop(1.0, ratio, 10.0), 1e-4
    values = [loop.shaped(1.0, 0.0, dt) for _ in range(round(3.0 / dt))]
    damping = 1.0 / ratio
    assert max(values) == pytest.approx(1.0 + math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)), abs=0.01)


# ---------------------------------------------------------------------------------------------- in the whole drive


def gains_drive() -> Rig:
    gains = Gains(current=NOMINAL[:2], velocity=NOMINAL[2:4], position=NOMINAL[4:])
    return Rig(TRACTION.model_copy(update={"gains": gains}))


def write(rig: Rig, gains: Sequence[int]) -> None:
    for (index, sub), gain in zip(OBJECTS, gains, strict=True):
        rig.write(index, sub, "h", gain)


def test_a_drive_from_the_factory_is_as_good_as_tuned() -> None:
    rig = gains_drive()
    assert rig.node.axis.failure is None
    rig = Rig(TRACTION)
    assert rig.node.axis.failure is None


def test_gains_act_as_they_are_written_and_nominal_ones_undo_it() -> None:
    rig = gains_drive()
    write(rig, with_gains(velocity_i=1000))
    assert rig.node.axis.failure is not None
    write(rig, NOMINAL)
    assert rig.node.axis.failure is None


def test_gains_that_are_not_stored_are_lost_with_the_power() -> None:
    rig = gains_drive()
    write(rig, with_gains(velocity_i=1000))
    rig.node.power_on(rig.now)
    rig.run(0.06)
    assert rig.node.axis.failure is None  # as from the factory
    write(rig, with_gains(velocity_i=1000))
    rig.write(0x1010, 1, "I", SAVE)
    rig.node.power_on(rig.now)
    rig.run(0.06)
    assert rig.node.axis.failure is not None
