"""The angle of a wheel from edges between the steps of an analog input: finer than a step, whatever way it turns."""

from __future__ import annotations

import math
import random

import pytest

from artemis.axles import Potentiometers
from artemis.motion.potentiometers import StepEdges
from artemis.sim.epos4_objects import ANALOG_SPAN_MV, ANALOG_STEPS, millivolts

STEP = ANALOG_SPAN_MV / ANALOG_STEPS / 1000.0
POTENTIOMETERS = Potentiometers(zero_v=(2.51, 2.48), slope_deg_per_v=(72.0, -66.0))
TRUE = 0.113
"""What the encoder lacks [degrees]."""


def shown(angle_deg: float) -> tuple[float, float]:
    """Both voltages at a true angle, as an EPOS4 tells them [V]."""
    (zero, other), (slope, other_slope) = POTENTIOMETERS.zero_v, POTENTIOMETERS.slope_deg_per_v
    return millivolts(zero + angle_deg / slope) / 1000.0, millivolts(other + angle_deg / other_slope) / 1000.0


def found(angles_deg: list[float], play_deg: float = 0.0, dice: random.Random | None = None) -> float | None:
    """What is told of an encoder that goes through these angles [degrees]; the wheel lags by half of the play."""
    edges, wheel = StepEdges(POTENTIOMETERS, STEP), angles_deg[0]
    for angle in angles_deg:
        wheel = min(max(wheel, angle - play_deg / 2), angle + play_deg / 2)
        noise = dice.gauss(0.0, 0.2) if dice else 0.0
        edges.take(math.radians(angle), shown(wheel + TRUE + noise))
    return None if edges.error is None else math.degrees(edges.error)


def swept(rate_deg: float, end_deg: float = 2.0) -> list[float]:
    """To and fro between both ends, so much from reading to reading [degrees]."""
    number = round(2 * end_deg / rate_deg)
    there = [rate_deg * tick - end_deg for tick in range(number + 1)]
    return there + there[::-1]


@pytest.mark.parametrize("rate", [0.0131, 0.0217, 0.031])
def test_an_edge_tells_the_angle_to_a_fraction_of_a_step(rate: float) -> None:
    assert found(swept(rate)) == pytest.approx(TRUE, abs=rate / 5)


def test_play_between_motor_and_wheel_cancels() -> None:
    assert found(swept(0.0217), play_deg=0.8) == pytest.approx(TRUE, abs=0.01)


def test_readings_at_rest_count_for_nothing() -> None:
    way = swept(0.0217)
    assert found(way[:120] + 500 * [way[119]] + way[120:]) == found(way)


def test_noise_of_half_a_step_averages_out() -> None:
    assert found(swept(0.0217), dice=random.Random(3)) == pytest.approx(TRUE, abs=0.03)


@pytest.mark.parametrize("angles", [[], [0.0], swept(0.02)[:150], swept(0.02)[-150:], 50 * [0.1]])
def test_without_edges_in_both_directions_nothing_is_told(angles: list[float]) -> None:
    assert found([0.0, *angles][bool(angles) :]) is None
