"""Steps that last for a time: interrupted, they go on with what is left of it."""

from __future__ import annotations

import pytest
from core_builders import PERIOD, Player, shared

from artemis.states.plan import Shared, Step, TeleopStep, WaitStep
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.values import OperatorInput

STICK = (OperatorInput(source="stick", enabled=True, neutral=False, speed=0.3, age=0.01),)


def player(step: Step, done: float = 0.0) -> tuple[Player, Shared]:
    steps = shared(step, WaitStep(seconds=1.0), done=done)
    mode = TeleopMode(steps) if isinstance(step, TeleopStep) else ReadyMode(steps)
    played = Player(mode)
    played.world["inputs"] = STICK
    return played, steps


def ticks_until_done(played: Player, steps: Shared) -> int:
    """How many ticks the step still takes."""
    for number in range(1000):
        if steps.position.step:
            return number
        played.tick()
    raise AssertionError("never done")


TIMED = [WaitStep(seconds=2.0), TeleopStep(input="stick", seconds=2.0)]


@pytest.mark.parametrize("step", TIMED, ids=["wait", "teleop"])
def test_it_takes_its_time(step: Step) -> None:
    assert ticks_until_done(*player(step)) == pytest.approx(2.0 / PERIOD, abs=2.01)


@pytest.mark.parametrize("step", TIMED, ids=["wait", "teleop"])
def test_interrupted_it_goes_on_with_the_time_that_is_left(step: Step) -> None:
    played, steps = player(step)
    for _ in range(75):
        played.tick()
    assert steps.position.done == pytest.approx(74 * PERIOD)
    played.time += 30.0  # stopped, acknowledged, armed
    played.enter()
    assert ticks_until_done(played, steps) == pytest.approx(2.0 / PERIOD - 74, abs=2.01)


@pytest.mark.parametrize("step", TIMED, ids=["wait", "teleop"])
def test_what_an_earlier_run_has_done_of_it_counts(step: Step) -> None:
    assert ticks_until_done(*player(step, done=1.5)) == pytest.approx(0.5 / PERIOD, abs=2.01)


def test_the_next_wait_begins_at_its_start() -> None:
    played, steps = player(WaitStep(seconds=2.0))
    ticks_until_done(played, steps)
    assert steps.position.done == 0.0
    played.tick()
    played.tick()
    assert steps.position.step == 1
    assert steps.position.done == pytest.approx(2 * PERIOD)
