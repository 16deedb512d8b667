"""Gains from a recorded step: the load is found that truly is there, and what is kept is better and does not swing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from servo_machines import DRIVES, DRIVES_4, Machine, Tuned, machine, tuned

from artemis.drive_schema import Drive
from artemis.errors import CalibrationError
from artemis.families import EPOS4
from artemis.families.epos1 import GAIN_SCALE
from artemis.families.family import GainScale
from artemis.motion.gain_tuning import (
    HOLD,
    ControlLoop,
    MovedLoad,
    Proposal,
    identified,
    in_order,
    loop_of,
    margins,
    obstacle,
    placed,
)
from artemis.motion.step_response import StepResponse, compared, quickness, reversals
from artemis.sim.axis import LOADS
from artemis.sim.servo import TrueLoad

RPM = 60.0 / math.tau
assert EPOS4.gain_scale is not None
EPOS4_SCALE: GainScale = EPOS4.gain_scale
LOAD = MovedLoad(inertia=6e-3, friction=0.3, delay=0.002, scale=1.0, unexplained=0.0)
ANSWER = StepResponse(
    begin=0.0,
    step=5.0,
    ramp=0.15,
    watched=2.0,
    rise=0.1,
    overshoot=0.0,
    settled_5=0.4,
    settled_2=0.5,
    steady_error=0.0,
    largest_error=0.5,
    peak_current=1.0,
)


def seeds(few: int) -> list[object]:
    """The first ones each time, all where there is time for it."""
    return [pytest.param(seed, marks=() if seed < few else pytest.mark.exhaustive) for seed in range(200)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("drives", [DRIVES, DRIVES_4], ids=["epos1", "epos4"])
@pytest.mark.parametrize("role", ["traction", "steering"])
def test_the_load_that_is_there_is_found(role: str, drives: Mapping[str, Drive]) -> None:
    load = TrueLoad(inertia_scale=3.0, friction_scale=1.3, delay_ms=0.0 if role == "steering" else 4.0)
    drive = drives[role]
    scale = drive.tables.gain_scale
    assert scale is not None
    record, _ = Machine(drive, load).moved(drive.gain_numbers)
    gains = drive.gain_numbers[4:] if role == "steering" else drive.gain_numbers[2:4]
    top = 0.9 * drive.motor.max_speed_rpm / RPM
    found = identified([record], loop_of(gains, scale, 1e-3 * drive.motor.output_current_ma, top))
    assert found.inertia == pytest.approx(3.0 * LOADS[role].inertia * 1e-3 * RPM, rel=0.05)
    assert found.friction == pytest.approx(1.3e-3 * LOADS[role].friction, rel=0.3)
    assert found.delay == pytest.approx(1e-3 * load.delay_ms, abs=1.5e-3)
    assert found.unexplained < 0.05


def test_what_no_load_explains_is_refused() -> None:
    drive = DRIVES["traction"]
    assert drive.gains is not None
    record, _ = Machine(drive, TrueLoad()).moved(drive.gains.numbers)
    loop = loop_of(drive.gains.velocity, GAIN_SCALE, 10.0, 300.0)
    wave = 20.0 * np.sin(40.0 * record.time)
    with pytest.raises(CalibrationError, match="does not explain"):
        identified([replace(record, position=record.position + wave)], loop)
    with pytest.raises(CalibrationError, match="did not move"):
        identified([replace(record, current=0.0 * record.current)], loop)


def test_margins_are_those_of_an_integrator_with_dead_time() -> None:
    loop = ControlLoop(is_position=False, p=0.6, i=1e-6, d=0.0, limit=10.0, top=300.0)
    late, crossover = LOAD.delay + HOLD * loop.period, loop.p / LOAD.inertia  # L(s) = K exp(-s late) / s
    phase, gain = margins(LOAD, loop)
    assert phase == pytest.approx(90.0 - math.degrees(crossover * late), abs=0.2)
    assert gain == pytest.approx(math.pi / (2.0 * crossover * late), rel=0.01)
    assert margins(LOAD, replace(loop, p=6.0)) == (0.0, 0.0)


def test_a_position_loop_has_a_margin_below_too() -> None:
    stiff = loop_of(placed(LOAD, 0.05, 4.0, GAIN_SCALE, is_position=True), GAIN_SCALE, 10.0, 300.0)
    assert margins(LOAD, stiff)[1] > 2.0
    assert margins(LOAD, replace(stiff, i=stiff.p * stiff.d / LOAD.inertia)) == (0.0, 0.0)  # Routh, Hurwitz


@pytest.mark.parametrize("scale", [GAIN_SCALE, EPOS4_SCALE], ids=["epos1", "epos4"])
@pytest.mark.parametrize("is_position", [False, True])
def test_poles_are_where_they_were_placed(is_position: bool, scale: GainScale) -> None:
    loop = loop_of(placed(LOAD, 0.01, 4.0, scale, is_position), scale, 10.0, 300.0)
    terms = [LOAD.inertia, loop.d, loop.p, loop.i] if is_position else [LOAD.inertia, loop.p, loop.i]
    poles = np.roots(terms)
    wanted = [-100.0, -100.0, -25.0] if is_position else [-100.0, -25.0]
    assert np.poly(poles) == pytest.approx(np.poly(wanted), rel=0.02)


def test_the_softest_is_tried_first_that_is_about_as_quick_as_any_and_none_that_is_slower_than_now() -> None:
    def proposal(settled: float) -> Proposal:
        return Proposal(gains=(1, 1), phase_margin=60.0, gain_margin=3.0, settled=settled)

    found = [proposal(settled) for settled in (0.44, 0.40, 0.41, 0.43, 0.5, 0.6, 0.9)]
    assert [each.settled for each in in_order(found, [0.8, 0.7])] == [0.43, 0.6, 0.40]
    assert [each.settled for each in in_order(found, [0.8, None])] == [0.43, 0.6, 0.40]
    assert in_order(found, [0.3]) == []


def test_only_what_is_better_each_time_and_steady_is_kept() -> None:
    quick, slow = replace(ANSWER, settled_5=0.2), replace(ANSWER, settled_5=0.5)
    lost = replace(ANSWER, settled_5=None)
    assert compared([ANSWER, ANSWER], [quick, quick], [0, 1]) == ""
    assert compared([ANSWER, lost], [slow, slow], [0, 0]) == ""  # now it does not settle each time
    assert "no better" in compared([ANSWER, slow], [quick, ANSWER], [0, 0])
    assert "did not settle" in compared([ANSWER], [quick, lost], [0, 0])
    assert "oscillates" in compared([ANSWER], [quick, quick], [0, 4])
    assert "overshoots by 12%" in compared([ANSWER], [replace(quick, overshoot=0.12)], [0])


def test_a_prediction_has_a_reserve() -> None:
    assert quickness(ANSWER) == 0.4
    assert quickness(replace(ANSWER, overshoot=0.045)) == 0.5
    assert quickness(replace(ANSWER, steady_error=0.1)) is None
    assert quickness(replace(ANSWER, settled_5=None)) is None


def test_why_it_is_not_sooner() -> None:
    assert "ramp" in obstacle(ANSWER, 0.16, 10.0)
    assert "1.0 A" in obstacle(ANSWER, 0.4, 1.0)
    assert "margins" in obstacle(ANSWER, 0.4, 10.0)


def test_reversals_count_only_what_is_large_enough() -> None:
    wave = np.sin(np.linspace(0.0, 4.0 * math.tau, 400))
    assert reversals(wave, 0.5) == 8
    assert reversals(0.2 * wave, 0.5) == 0
    assert reversals(np.linspace(0.0, 1.0, 20), 0.1) == 0


def assert_sound(found: Tuned) -> None:
    """What is kept is quicker, settles each time, does not swing; and a reason is told where it is not much quicker."""
    if not found.new:
        assert found.why
        return
    slowest = max(each.settled_5 or math.inf for each in found.new)
    before = [each.settled_5 for each in found.now if each.settled_5 is not None]
    if not found.why and len(before) == len(found.now):
        assert slowest <= 0.6 * max(before)
    assert max(each.overshoot or 0.0 for each in found.new) <= 0.1
    assert found.resting < 0.02


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", seeds(3))
def test_driven_wheels_with_hidden_loads_settle_much_sooner(seed: int) -> None:
    found = tuned(machine(seed, "traction"), seed)
    assert_sound(found)
    assert found.new


@pytest.mark.parametrize("seed", seeds(5))
def test_driven_wheels_of_an_epos4_settle_much_sooner(seed: int) -> None:
    found = tuned(machine(seed, "traction", DRIVES_4), seed)
    assert_sound(found)
    assert found.new


@pytest.mark.parametrize("seed", seeds(5))
def test_steered_wheels_of_an_epos4_settle_sooner_or_it_is_told_why_not(seed: int) -> None:
    assert_sound(tuned(machine(seed, "steering", DRIVES_4), seed))


@pytest.mark.parametrize("seed", seeds(3))
def test_steered_wheels_with_hidden_loads_settle_sooner_or_it_is_told_why_not(seed: int) -> None:
    assert_sound(tuned(machine(seed, "steering"), seed))
