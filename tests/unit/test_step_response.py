"""Step responses against closed forms and scipy's own simulation of second-order systems."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from artemis.errors import CalibrationError
from artemis.motion.arrays import Array
from artemis.motion.step_response import StepResponse, slope, step_response

BEFORE = 0.1
"""The set-point rests for so long before the step [s]."""


def second_order(
    damping: float, *, omega: float = 20.0, gain: float = 1.0, step: float = 5.0, dt: float = 1e-3, end: float = 6.0
) -> tuple[Array, Array, Array]:
    """Time, set-point and value of gain * omega² / (s² + 2 damping omega s + omega²) after a step."""
    since = np.arange(0.0, end, dt)
    system = signal.TransferFunction([gain * omega**2], [1.0, 2.0 * damping * omega, omega**2])
    _, value = signal.step(system, T=since)
    rest = np.zeros(round(BEFORE / dt))
    time: Array = np.arange(len(rest) + len(since), dtype=np.float64) * dt
    set_point: Array = np.append(rest, np.full(len(since), step))
    response: Array = np.append(rest, step * value)
    return time, set_point, response


def respond(time: Array, set_point: Array, value: Array) -> StepResponse:
    return step_response(time, set_point, value, np.zeros(len(time)))


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("step", [5.0, -0.2])
def test_overshoot_of_a_second_order_system_is_that_of_its_damping(damping: float, step: float) -> None:
    found = respond(*second_order(damping, step=step, end=2.0))
    expected = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    assert found.overshoot == pytest.approx(expected, abs=1e-3)
    assert found.step == pytest.approx(step)
    assert found.steady_error == pytest.approx(0.0, abs=1e-3 * abs(step))
    assert found.ramp == pytest.approx(1e-3)
    assert found.begin == pytest.approx(BEFORE - 1e-3)


def test_rise_and_settling_of_a_first_order_lag_are_logarithms() -> None:
    lag, since = 0.05, np.arange(0.0, 2.0, 1e-3)
    time, set_point = np.append(since, since + 2.0), np.append(np.zeros(len(since)), np.ones(len(since)))
    value = np.append(np.zeros(len(since)), 1.0 - np.exp(-since / lag))
    found = respond(time, set_point, value)
    assert found.rise == pytest.approx(lag * math.log(9.0), abs=1e-4)
    assert found.overshoot == pytest.approx(0.0, abs=1e-9)
    assert found.settled_5 == pytest.approx(lag * math.log(20.0) + 1e-3, abs=2e-4)
    assert found.settled_2 == pytest.approx(lag * math.log(50.0) + 1e-3, abs=2e-4)


@pytest.mark.parametrize("damping", [0.15, 0.3, 0.6, 1.0, 2.0])
def test_settling_is_when_the_exact_response_enters_the_band_for_good(damping: float) -> None:
    found = respond(*second_order(damping))
    fine = np.arange(0.0, 6.0, 1e-4)
    _, exact = signal.step(signal.TransferFunction([400.0], [1.0, 40.0 * damping, 400.0]), T=fine)
    for band, settled in ((0.05, found.settled_5), (0.02, found.settled_2)):
        outside = fine[np.abs(exact - 1.0) > band]
        assert settled == pytest.approx(outside[-1] + 1e-3, abs=5e-4)
    passed = [fine[np.argmax(exact >= share)] for share in (0.1, 0.9)]
    assert found.rise == pytest.approx(passed[1] - passed[0], abs=4e-4)


def test_bands_count_from_where_the_drive_rests_and_the_rest_is_a_steady_error() -> None:
    whole, less = respond(*second_order(0.4)), respond(*second_order(0.4, gain=0.9))
    assert less.steady_error == pytest.approx(0.1 * 5.0, rel=1e-6)
    assert (less.overshoot, less.settled_2, less.rise) == pytest.approx((whole.overshoot, whole.settled_2, whole.rise))


def test_a_ramp_is_followed_behind_by_its_rate_times_the_lag() -> None:
    time = np.arange(0.0, 3.0, 5e-3)
    set_point = np.clip((time - 0.5) / 0.4, 0.0, 1.0) * 0.2
    lag = signal.TransferFunction([1.0], [0.03, 1.0])
    _, value, _ = signal.lsim(lag, set_point, time)
    found = step_response(time, set_point, value, 2.0 * np.sin(time))
    assert found.ramp == pytest.approx(0.4, abs=0.012)
    assert found.largest_error == pytest.approx(0.5 * 0.03, rel=0.01)
    assert found.watched == pytest.approx(2.5, abs=0.012)
    assert found.peak_current == pytest.approx(2.0, abs=1e-4)


def test_the_way_back_is_another_step() -> None:
    time = np.arange(0.0, 4.0, 5e-3)
    set_point = np.where((time > 0.5) & (time < 2.0), 1.0, 0.0)
    found = respond(time, set_point, set_point)
    assert found.watched == pytest.approx(1.5, abs=0.011)
    assert (found.overshoot, found.steady_error) == (0.0, 0.0)


def test_a_drive_that_still_rings_has_not_settled() -> None:
    found = respond(*second_order(0.01, end=2.0))
    assert found.overshoot is not None
    assert found.overshoot > 0.9
    assert found.settled_5 is None
    assert found.settled_2 is None


@pytest.mark.parametrize("share", [0.0, 0.05, -1.0])
def test_a_drive_that_does_not_follow_has_no_response(share: float) -> None:
    time, set_point, _ = second_order(0.7)
    found = respond(time, set_point, share * set_point)
    assert (found.rise, found.overshoot, found.settled_5, found.settled_2) == (None, None, None, None)
    assert found.steady_error == pytest.approx((1.0 - share) * 5.0)


@pytest.mark.parametrize("count", [0, 5, 200])
def test_what_is_no_step_is_refused(count: int) -> None:
    with pytest.raises(CalibrationError, match="does not change"):
        respond(np.arange(float(count)), np.ones(count), np.ones(count))


def test_a_step_of_few_samples_is_refused() -> None:
    with pytest.raises(CalibrationError, match="only 5 samples"):
        respond(np.arange(5.0), np.array([0.0, 1.0, 1.0, 1.0, 1.0]), np.zeros(5))


def test_slope_of_a_parabola_is_exact_between_its_ends() -> None:
    time = np.arange(0.0, 1.0, 5e-3)
    found = slope(time, 3.0 * time**2, 0.06)
    assert found[10:-10] == pytest.approx(6.0 * time[10:-10])


def test_slope_sees_the_speed_in_coarse_counts() -> None:
    time, count = np.arange(0.0, 2.0, 5e-3), 2.1276596e-4
    position = np.floor(0.2 * time / count) * count
    found = slope(time, position, 0.06)[20:-20]
    assert np.mean(found) == pytest.approx(0.2, rel=1e-3)
    assert np.max(np.abs(found - 0.2)) < 0.02 * 0.2


def test_slope_of_one_sample_is_none() -> None:
    assert list(slope(np.array([1.0]), np.array([2.0]), 0.1)) == [0.0]
