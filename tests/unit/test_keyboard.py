"""Driving by the keys of a terminal: what counts as held, with and without a terminal that tells releases."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from core_builders import ROBOT
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.answers import is_in_range, is_whole_input
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.keyboard import KeyboardConfig, KeyboardInput, Keys
from artemis.values import OperatorInput, Request

UP, DOWN, RIGHT, LEFT = b"\x1b[A", b"\x1b[B", b"\x1b[C", b"\x1b[D"
THERE, TELLS_RELEASE = b"\x1b[0n", b"\x1b[?2u"
REPEATED, RELEASED = b"\x1b[1;1:2%c", b"\x1b[1;1:3%c"
FOCUS_LOST, FOCUS = b"\x1b[O", b"\x1b[I"


class Desk:
    """A keyboard input, its terminal, and a clock."""

    def __init__(self, *, there: bool = True, **options: float) -> None:
        self.now, self._listeners = 100.0, list[Callable[[bytes], None]]()
        context = PluginContext(name="keys", robot=ROBOT, folder=Path(), typed=self._typed)
        self._there = there
        self.input = KeyboardInput(KeyboardConfig(**options), context)

    def _typed(self, listener: Callable[[bytes], None]) -> bool:
        self._listeners.append(listener)
        return self._there

    def press(self, data: bytes, after: float = 0.02) -> OperatorInput:
        self.now += after
        for listener in self._listeners:
            listener(data)
        return self.input.read(self.now)

    def wait(self, seconds: float, data: bytes = THERE) -> OperatorInput:
        """The terminal sends the same at every tick."""
        for _ in range(round(seconds / 0.02)):
            sample = self.press(data)
        return sample

    def hold(self, key: bytes) -> OperatorInput:
        """A key of a plain terminal, until it repeats."""
        self.press(key)
        self.wait(0.3)
        return self.press(key)


def test_a_tap_in_a_plain_terminal_moves_nothing() -> None:
    desk = Desk()
    assert not desk.press(UP).enabled
    assert not desk.wait(0.3).enabled


def test_a_held_key_drives_from_its_first_repetition_until_it_stops_coming() -> None:
    desk = Desk()
    sample = desk.hold(UP)
    assert sample.enabled
    assert sample.speed == pytest.approx(0.4 * ROBOT.limits.speed_m_s)
    assert desk.wait(0.1).enabled
    sample = desk.wait(0.08)
    assert (sample.enabled, sample.neutral, sample.speed) == (False, True, 0.0)


def test_two_presses_of_a_second_are_two_taps() -> None:
    desk = Desk()
    desk.press(UP)
    assert not desk.press(UP, after=0.8).enabled


def test_another_key_ends_the_first_in_a_plain_terminal() -> None:
    desk = Desk()
    desk.hold(UP)
    sample = desk.hold(LEFT)
    assert sample.axes == (-1.0, 0.0)


@pytest.mark.parametrize(("key", "axes"), [(UP, (0, 1)), (DOWN, (0, -1)), (RIGHT, (1, 0)), (LEFT, (-1, 0))])
def test_terminal_that_tells_releases_needs_no_repetition(key: bytes, axes: tuple[float, float]) -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE)
    sample = desk.press(key)
    assert (sample.enabled, sample.axes) == (True, axes)
    assert desk.wait(5.0).enabled
    assert not desk.press(RELEASED % key[-1]).enabled


def test_two_keys_at_once() -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE + UP + LEFT)
    sample = desk.wait(1.0)
    assert sample.axes == (-1.0, 1.0)
    assert sample.steering == pytest.approx(math.radians(30))
    assert desk.press(RELEASED % b"D").axes == (0.0, 1.0)
    assert desk.wait(2.0).steering == 0.0


def test_opposite_keys_cancel_out() -> None:
    desk = Desk()
    assert desk.press(TELLS_RELEASE + UP + DOWN).speed == 0.0


def test_lost_focus_is_a_release() -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE + UP)
    assert not desk.press(FOCUS_LOST).enabled
    assert not desk.press(FOCUS).enabled
    assert desk.press(REPEATED % b"A").enabled  # it is still held


def test_terminal_that_does_not_answer_makes_the_sample_old() -> None:
    desk = Desk()
    assert desk.input.read(100.0).age is None
    desk.press(TELLS_RELEASE + UP)
    assert desk.input.read(desk.now + 0.3).age == pytest.approx(0.3)


def test_closed_terminal_is_a_lost_device() -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE + UP)
    with pytest.raises(DeviceLost, match="closed"):
        desk.press(b"")
    with pytest.raises(DeviceLost, match="closed"):
        desk.press(THERE)


def test_without_a_terminal_there_is_no_device() -> None:
    with pytest.raises(DeviceLost, match="run artemis in one"):
        Desk(there=False).press(UP)


def test_direction_changes_once_the_robot_can_stand() -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE + UP)
    desk.wait(1.0)
    assert desk.press((RELEASED % b"A") + DOWN).speed == 0.0
    assert desk.wait(0.4).speed < 0.0


def test_speed_range_and_requests_of_single_keys() -> None:
    desk = Desk()
    assert desk.press(TELLS_RELEASE + UP + b"++").speed == pytest.approx(0.6 * ROBOT.limits.speed_m_s)
    assert desk.press(b"p-d").requests == (Request.RECORD, Request.DONE)
    assert desk.press(THERE).requests == ()


def test_sequences_may_come_in_pieces() -> None:
    desk = Desk()
    desk.press(TELLS_RELEASE)
    for number in range(2):
        desk.press(UP[number : number + 1])
    assert desk.press(UP[2:]).enabled


def test_alt_and_other_keys_are_no_requests() -> None:
    desk = Desk()
    assert desk.press(b"\x1bp\x1b[1;5P\x1bOP\x1b[200~").requests == ()


def test_more_speed_than_the_robot_has_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"max_speed_m_s: 9; the robot's limit is 0\.7"):
        Desk(max_speed_m_s=9.0)


@given(st.lists(st.tuples(st.binary(max_size=12), st.floats(0, 1)), max_size=20))
def test_whatever_is_typed_gives_whole_samples(typed: list[tuple[bytes, float]]) -> None:
    desk = Desk()
    for data, after in typed:
        sample = desk.press(data or THERE, after)
        assert is_whole_input(sample)
        assert is_in_range(sample)


@given(st.lists(st.binary(min_size=1, max_size=12), max_size=20))
def test_rest_of_an_unfinished_sequence_is_bounded(typed: list[bytes]) -> None:
    keys = Keys()
    for data in typed:
        keys.type(b"\x1b[" + b"1;" * 50 + data, 0.0)
    assert len(keys._rest) <= 64
