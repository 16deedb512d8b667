"""The enable button: the robot drives while it is held, and after a release only by a new press at standstill."""

from __future__ import annotations

import pytest
from core_builders import Player, shared
from msgspec.structs import replace

from artemis.states.plan import TeleopStep
from artemis.states.teleop import TeleopMode
from artemis.values import DriveCommand, OperatorInput, Wish

HELD = OperatorInput(source="stick", enabled=True, neutral=False, speed=0.3, steering=0.1, age=0.01)
UP = replace(HELD, enabled=False)
"""The button is released, the stick held forward all the same."""
DRIVES, STANDS = DriveCommand(speed=0.3, steering=0.1), DriveCommand(steering=0.0)


class Hand:
    """What it holds, tick by tick; the robot begins at rest."""

    def __init__(self) -> None:
        self._player = Player(TeleopMode(shared(TeleopStep(input="stick", seconds=None))))

    def tick(self, sample: OperatorInput, *, standing: bool) -> Wish:
        return self._player.tick(inputs=(sample,), standing=standing, set_points=None)

    def again(self) -> None:
        """The step goes on after it was interrupted: with neutral controls, and at rest."""
        self._player.enter()


def driving() -> Hand:
    hand = Hand()
    assert hand.tick(HELD, standing=True).command == DRIVES
    for _ in range(3):
        assert hand.tick(HELD, standing=False).command == DRIVES
    return hand


@pytest.mark.parametrize("ticks", [1, 3, 20])
def test_button_that_is_pressed_again_while_the_robot_rolls_moves_nothing_not_even_at_rest(ticks: int) -> None:
    hand = driving()
    for _ in range(ticks):
        assert hand.tick(UP, standing=False).phase == "hold the enable button to drive"
    for standing in [False] * 5 + [True] * 5:
        wish = hand.tick(HELD, standing=standing)
        assert wish.command == STANDS
        assert wish.phase == "release the enable button, and press it again at standstill"


def test_button_that_is_pressed_at_rest_drives_with_the_stick_where_it_is() -> None:
    hand = driving()
    hand.tick(UP, standing=False)
    hand.tick(HELD, standing=False)
    for standing in (False, True):
        assert hand.tick(UP, standing=standing).command == STANDS
    assert hand.tick(HELD, standing=True).command == DRIVES
    assert hand.tick(HELD, standing=False).command == DRIVES


def test_step_that_goes_on_after_a_stop_wants_no_second_press() -> None:
    hand = driving()
    hand.tick(UP, standing=False)
    hand.tick(HELD, standing=False)
    hand.again()
    assert hand.tick(HELD, standing=True).command == DRIVES
