"""A device's clock on ours: drift, late arrivals, turns of its counter, and a clock that is set back."""

from __future__ import annotations

import random

import pytest

from artemis.devices.lms1xx.device_clock import WRAP, DeviceClock

PERIOD, LEAST = 0.02, 0.001


def errors(
    drift: float, seconds: float, *, first_us: int = 0, lateness: float = 0.003, seed: int = 1, back: float = 0.0
) -> list[float]:
    """How far mapped times are from the truth [s], but for the least delay; the clock is set `back` after half."""
    dice, clock, found = random.Random(seed), DeviceClock(), []
    for number in range(round(seconds / PERIOD)):
        true = 100.0 + number * PERIOD
        shown = first_us + round((true - 100.0) * (1 + drift) * 1e6)
        if true - 100.0 > seconds / 2:
            shown -= round(back * 1e6)
        arrived = true + LEAST + dice.expovariate(1 / lateness)
        found.append(clock.to_ours(shown % WRAP, arrived) - LEAST - true)
    return found


@pytest.mark.parametrize("drift", [-100e-6, 0.0, 100e-6])
@pytest.mark.parametrize("first_us", [0, WRAP - 30_000_000])
def test_mapped_times_are_exact_to_a_millisecond_whatever_the_drift(drift: float, first_us: int) -> None:
    found = errors(drift, 600.0, first_us=first_us)[50:]
    assert max(map(abs, found)) < 0.001


def test_ten_hours_have_eight_turns_of_the_counter() -> None:
    clock, period = DeviceClock(), 60.0
    found = [clock.to_ours(round(n * period * 1e6) % WRAP, n * period) - n * period for n in range(600)]
    assert max(map(abs, found)) < 1e-6


def test_a_telegram_that_comes_late_is_put_where_it_belongs() -> None:
    clock = DeviceClock()
    for number in range(100):
        clock.to_ours(number * 20_000, number * PERIOD)
    assert clock.to_ours(100 * 20_000, 100 * PERIOD + 0.3) == pytest.approx(100 * PERIOD, abs=1e-4)


def test_no_time_is_later_than_its_arrival() -> None:
    dice, clock = random.Random(3), DeviceClock()
    for _ in range(2000):
        arrived = dice.uniform(0.0, 1e4)
        assert clock.to_ours(dice.randrange(WRAP), arrived) <= arrived + 1e-6


def test_a_clock_that_is_set_back_is_followed_after_some_seconds() -> None:
    found = errors(0.0, 20.0, lateness=0.001, back=1.0)
    assert max(map(abs, found[50:490])) < 0.001
    assert found[510] == pytest.approx(-1.0, abs=0.01)
    assert max(map(abs, found[-250:])) < 0.01


def test_a_clock_that_is_set_forward_is_followed_at_once() -> None:
    found = errors(0.0, 20.0, lateness=0.001, back=-1.0)
    assert max(map(abs, found[600:])) < 0.002
    assert max(found) < 0.01


def test_a_busy_line_is_not_taken_for_a_clock_that_was_set_back() -> None:
    """For ten seconds everything comes 0.2 to 0.4 s late."""
    dice, clock = random.Random(5), DeviceClock()
    for number in range(1500):
        true = number * PERIOD
        late = dice.uniform(0.2, 0.4) if 500 < number < 1000 else 0.0
        mapped = clock.to_ours(number * 20_000, true + late)
        assert mapped == pytest.approx(true, abs=0.003), number
