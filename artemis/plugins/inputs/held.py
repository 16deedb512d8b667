"""A device in somebody's hand, from its plugging in to its loss: what is held, and whether the hand is still there.

Silence is normal for most devices: a stick that is held still says nothing. There the open handle counts as alive, and
a robot that drives under a silent hand slows down and stops. Whatever was lost, the robot goes on only when everything
was released and the enable button is pressed anew.
"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from artemis.errors import HidError
from artemis.plugins.inputs.controls import Controls
from artemis.plugins.inputs.hands import Hands
from artemis.values import OperatorInput, Request

STALE = 0.15
"""Silence of this length [s] of a device that always reports: it is frozen (INP-03)."""
REST = 0.5
"""So long everything has to be released [s] after a device was plugged in or lost, before enable counts (INP-02)."""
DOUBT, GONE = 2.0, 4.0
"""A device that reports changes alone is silent for so long [s] while the robot drives: slow, then stop (INP-04)."""
SLOW = 0.3
"""Speed in doubt whether a hand is still there [m/s]."""
STUCK = 60.0
"""No axis has changed for so long [s] while the robot drives: stop (INP-15)."""


class HeldDevice:
    """One device, of one plugging in."""

    def __init__(self, generation: int, controls: Controls, hands: Hands, reports: str, deadman: bool) -> None:
        self.generation = generation
        self.heard: float | None = None
        """Run time of its last news [s]."""
        self.bad = False
        """It has just sent what it cannot mean."""
        self._controls, self._hands, self._reports, self._deadman = controls, hands, reports, deadman
        self._last_report, self._raw = b"", controls.raw
        self._released = False
        self._changed = 0.0
        self._resting: float | None = None

    def take(self, reports: Iterable[bytes], now: float) -> list[Request]:
        """Take what it has said until now [s], oldest first; what that asks for."""
        requests: list[Request] = []
        self.bad = False
        for report in reports:
            try:
                is_state = self._controls.take(report)
            except HidError:
                self.bad = True
                continue
            is_news = self._reports != "counted" or report != self._last_report
            if is_state and is_news:
                self._last_report, self.heard = report, now
                requests += self._grasp(now)
        return requests

    def _grasp(self, now: float) -> list[Request]:
        controls = self._controls
        if not controls.known:
            return []
        if not self._raw:
            self._hands.hold(controls.down)
        if controls.raw != self._raw:
            self._raw, self._changed = controls.raw, now
        return self._hands.grasp(controls.axes, controls.down)

    def sample(self, now: float) -> OperatorInput | None:
        """What it wishes at `now` [s]; None before every axis was heard of."""
        if not self._raw or self.heard is None:
            return None
        controls, wish = self._controls, self._hands.wish(now)
        age = 0.0 if self._reports == "on_change" else now - self.heard
        held = "enable" in controls.down if self._deadman else not wish.neutral
        neutral = wish.neutral and not held
        rested = self._has_rested(neutral and age <= STALE, now)
        self._released = age <= STALE and (self._released or rested)
        enabled = held and self._released and self._still_there(wish.speed, now)
        self._released = self._released and (enabled or not held)
        in_doubt = self._reports == "on_change" and now - self.heard > DOUBT
        return replace(
            wish,
            speed=min(max(wish.speed, -SLOW), SLOW) if in_doubt else wish.speed,
            enabled=enabled,
            neutral=neutral,
            age=age,
            raw=controls.raw,
            buttons=tuple(role in controls.down for role in controls.roles),
        )

    def _has_rested(self, resting: bool, now: float) -> bool:
        """Whether everything has been released for a while."""
        if not resting:
            self._resting = None
        elif self._resting is None:
            self._resting = now
        return self._resting is not None and now - self._resting >= REST

    def _still_there(self, speed: float, now: float) -> bool:
        """Whether a hand is still at the controls of a robot that drives."""
        assert self.heard is not None
        silent = self._reports == "on_change" and now - self.heard > GONE
        return speed == 0 or not (silent or now - self._changed > STUCK)

    def stops(self, report: bytes) -> bool:
        """Whether a report has the stop button, or the brake, pressed."""
        try:
            self._controls.take(report)
        except HidError:
            return False
        return self._hands.asks_to_stop(self._controls.axes, self._controls.down)
