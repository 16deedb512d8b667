"""Lines through readings of potentiometers: zero, slope, play, spread, and what is no line."""

from __future__ import annotations

import math
import random

import pytest

from artemis.axles import Potentiometers
from artemis.motion.potentiometers import memory_numbers, memory_words
from artemis.motion.steering_fit import Pass, fitted, lines_through, shown_straight

KNOWN = Potentiometers(zero_v=(2.51, 2.48), slope_deg_per_v=(72.0, -72.0), scale=1.01)
ZEROS, SLOPES = (2.53, 2.45), (73.5, -70.0)
STEP = 0.00488
"""Of an analog input [V]."""


def passes(
    *,
    play_deg: float = 0.0,
    noise: float = 0.0,
    coarse: bool = False,
    seed: int = 1,
    drift: float = 0.0,
    around: tuple[float, ...] = (0.0, 45.0, -45.0, 0.0),
) -> list[Pass]:
    """Readings of a wheel with ZEROS and SLOPES whose encoder is right; `drift` of the first one [V per pass]."""
    dice = random.Random(seed)
    found: list[Pass] = []
    for centre in around:
        for direction in (1.0, -1.0):
            readings = []
            for number in range(50):
                motor = centre + direction * (number - 24.5) * 0.08
                wheel = motor - direction * play_deg / 2.0
                volts = [
                    zero + wheel / slope + dice.gauss(0.0, noise) for zero, slope in zip(ZEROS, SLOPES, strict=True)
                ]
                volts[0] += drift * len(found)
                if coarse:
                    volts = [round(volt / STEP) * STEP for volt in volts]
                readings.append((math.radians(motor), volts[0], volts[1]))
            found.append(Pass(direction, readings))
    return found


def test_zero_and_slope_of_exact_readings_are_exact() -> None:
    fit = fitted(lines_through(passes()), 0.0, 0.0, KNOWN)
    assert fit.calibration == Potentiometers(zero_v=ZEROS, slope_deg_per_v=SLOPES, scale=1.01)
    assert fit.backlash_deg == pytest.approx(0.0, abs=1e-9)
    assert fit.misfit_deg == pytest.approx(0.0, abs=1e-9)
    assert max(fit.zero_std_v) < 1e-9


def test_what_is_not_fitted_is_kept() -> None:
    known = KNOWN.model_copy(update={"supply_v": 10.0})
    fit = fitted(lines_through(passes()), 0.0, 0.0, known)
    assert fit.calibration == known.model_copy(update={"zero_v": ZEROS, "slope_deg_per_v": SLOPES})


def test_play_is_told_and_does_not_move_the_zero() -> None:
    fit = fitted(lines_through(passes(play_deg=0.6)), 0.0, 0.0, KNOWN)
    assert fit.backlash_deg == pytest.approx(0.6)
    assert fit.calibration.zero_v == ZEROS


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_wheel_that_came_straight_from_one_side_is_half_the_play_off_its_encoder(direction: float) -> None:
    straight = math.radians(2.0 + direction * 0.3)  # of the encoder, where the wheel stands at 2 degrees
    fit = fitted(lines_through(passes(play_deg=0.6)), straight, direction, KNOWN)
    expected = [zero + 2.0 / slope for zero, slope in zip(ZEROS, SLOPES, strict=True)]
    assert fit.calibration.zero_v == pytest.approx(expected, abs=6e-5)


def test_shown_straight_is_where_the_mean_of_the_known_calibration_says_zero() -> None:
    lines = lines_through(passes())
    angle = shown_straight(lines, KNOWN)
    shown = [
        slope * (line.at(angle) - zero)
        for line, zero, slope in zip(lines, KNOWN.zero_v, KNOWN.slope_deg_per_v, strict=True)
    ]
    assert sum(shown) == pytest.approx(0.0, abs=1e-9)
    assert math.degrees(angle) == pytest.approx(-1.8, abs=0.02)  # zeros 1.44 and 2.16 degrees off


def test_spread_is_how_far_off_results_are() -> None:
    """Of a hundred machines with noise and coarse inputs."""
    off, slopes = [], []
    for seed in range(100):
        fit = fitted(lines_through(passes(noise=0.003, coarse=True, seed=seed)), 0.0, 0.0, KNOWN)
        off += [(v - z) / s for v, z, s in zip(fit.calibration.zero_v, ZEROS, fit.zero_std_v, strict=True)]
        slopes += [
            (found - true) / spread
            for found, true, spread in zip(
                fit.calibration.slope_deg_per_v, SLOPES, fit.slope_std_deg_per_v, strict=True
            )
        ]
    for ratios in (off, slopes):
        assert math.sqrt(sum(ratio**2 for ratio in ratios) / len(ratios)) == pytest.approx(1.0, abs=0.2)


def test_a_drift_is_no_line() -> None:
    lines = lines_through(passes(drift=0.003))
    assert math.degrees(lines[0].misfit) > 0.3
    assert math.degrees(lines[1].misfit) < 1e-6


def test_a_voltage_that_never_changes_follows_no_wheel() -> None:
    stuck = [Pass(one.direction, [(angle, 2.5, second) for angle, _, second in one.readings]) for one in passes()]
    assert abs(lines_through(stuck)[0].per_radian) < 1e-9


def test_a_wheel_that_did_not_turn_tells_no_line() -> None:
    stood = [Pass(one.direction, [(0.2, first, second) for _, first, second in one.readings]) for one in passes()]
    for line in lines_through(stood):
        assert (line.per_radian, line.misfit) == (0.0, math.inf)


def test_numbers_for_the_drive_are_whole_and_tell_the_calibration() -> None:
    assert memory_numbers(KNOWN) == (2_510_000, 2_480_000, 72_000_000, -72_000_000)
    assert memory_words(memory_numbers(KNOWN)) == "zero 2.5100 and 2.4800 V, slope 72.000 and -72.000 deg/V"
    assert memory_words((0, 0, 0, 0)) == "nothing"


def test_rounded_results_are_the_same_in_the_drive_and_in_the_robot_file() -> None:
    """What is written to a file and read again gives the same numbers."""
    for seed in range(20):
        found = fitted(lines_through(passes(noise=0.003, seed=seed)), 0.0, 0.0, KNOWN).calibration
        again = Potentiometers.model_validate_json(found.model_dump_json(), strict=False)
        assert memory_numbers(again) == memory_numbers(found)
        assert [number % 100 for number in memory_numbers(found)[:2]] == [0, 0]
