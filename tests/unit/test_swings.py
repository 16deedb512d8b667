"""When a steered wheel swings: how often its error has turned back."""

from __future__ import annotations

import math

import pytest

from artemis.states.gains import MOST_TURNS, OSCILLATION_S, TURN, OscillationCounter

TICK = 0.02


def most(error: list[float]) -> int:
    """The largest count of an error in degrees at each tick."""
    swings = OscillationCounter(TURN)
    return max(swings.count(index * TICK, math.radians(each)) for index, each in enumerate(error))


def sine(degrees: float, frequency: float, seconds: float = 4.0, offset: float = 0.0) -> list[float]:
    times = [index * TICK for index in range(round(seconds / TICK))]
    return [offset + degrees * math.sin(2.0 * math.pi * frequency * time) for time in times]


@pytest.mark.parametrize("offset", [0.0, 2.0, -2.0])
def test_each_swing_turns_back_twice_wherever_it_is(offset: float) -> None:
    assert most(sine(1.0, 3.0, offset=offset)) == pytest.approx(2 * 3.0 * OSCILLATION_S, abs=1)
    assert most(sine(1.0, 1.7, offset=offset)) > MOST_TURNS


def test_what_is_smaller_than_a_degree_from_end_to_end_counts_nothing() -> None:
    assert most(sine(0.49, 3.0, offset=0.2)) == 0
    assert most([0.4, -0.4, 0.3, -0.5] * 50) == 0


def test_slow_swings_are_forgotten() -> None:
    assert most(sine(3.0, 1.0, seconds=20.0)) <= MOST_TURNS


def test_a_step_that_trails_overshoots_and_rests_turns_back_twice() -> None:
    step = [0.5 * index for index in range(10)] + [2.0, -1.0, 0.2] + [0.0] * 100
    assert most(step) == 2


def test_a_turn_counts_from_the_place_where_it_is_large_enough_until_it_is_old() -> None:
    swings, size = OscillationCounter(TURN), TURN + 1e-9
    errors = {0.0: size, 0.5: 0.5 * size, 1.0: 0.0, 1.5: size, 1.0 + OSCILLATION_S: size, 1.5 + OSCILLATION_S: size}
    assert [swings.count(time, error) for time, error in errors.items()] == [0, 0, 1, 2, 1, 0]
