"""The devices in somebody's hands, from plugging in to loss: what is held, and whether the hand is still there.

Silence is normal for most devices: a stick that is held still says nothing. There the open handle counts as alive, and
a robot that drives under a silent hand slows down and stops. Whatever was lost, the robot continues only when
everything was released and the enable button is pressed anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec.structs import replace

from artemis.devices.hid.descriptor import Descriptor
from artemis.errors import HidError
from artemis.plugins.inputs.controls import Controls, values_of
from artemis.plugins.inputs.hands import Hands
from artemis.plugins.stated import STALE
from artemis.values import OperatorInput, Request

REST = 0.5
"""So long everything has to be released [s] after a device was plugged in or lost, before enable counts (INP-02)."""
DOUBT, GONE = 2.0, 4.0
"""A device that reports changes alone is silent for so long [s] while the robot drives: slow, then stop (INP-04)."""
SLOW = 0.3
"""Speed in doubt whether a hand is still there [m/s]."""
STUCK = 60.0
"""No axis has changed for so long [s] while the robot drives: stop (INP-15)."""


class HeldDevice:
    """The devices of one profile, mostly one, of one plugging in."""

    def __init__(
        self,
        generations: tuple[int, ...],
        controls: Controls,
        hands: Hands,
        parts: Mapping[str, tuple[str, Descriptor]],
        deadman: bool,
    ) -> None:
        """`parts`: how each device reports, and what, by its name in the profile."""
        self.generations = generations
        self.heard: dict[str, float] = {}
        """Run time of the last news of each device [s]."""
        self.bad = False
        """One has just sent what it cannot mean."""
        self._controls, self._hands, self._deadman = controls, hands, deadman
        self._reports = {part: reports for part, (reports, _) in parts.items()}
        self._descriptors = {part: descriptor for part, (_, descriptor) in parts.items()}
        self._last_report, self._raw = dict.fromkeys(parts, b""), controls.raw
        self._released = self._stopping = False
        self._changed = 0.0
        self._resting: float | None = None

    @property
    def news(self) -> float | None:
        """Run time since which all have been heard [s]; None: one was not heard at all."""
        return min(self.heard.values()) if len(self.heard) == len(self._reports) else None

    def take(self, reports: Iterable[tuple[str, bytes]], now: float) -> list[Request]:
        """Take what they have said until now [s], oldest first, each with the device's name; what that asks for."""
        requests: list[Request] = []
        self.bad = False
        for part, report in reports:
            try:
                is_state = self._understand(part, report)
            except HidError:
                self.bad = True
                continue
            is_news = self._reports[part] != "counted" or report != self._last_report[part]
            if is_state and is_news:
                self._last_report[part], self.heard[part] = report, now
                requests += self._grasp(now)
        return requests

    def _understand(self, part: str, report: bytes) -> bool:
        """Whether a report was one of this state: others carry the battery, or answers.

        Raises:
            HidError: it cannot be read.
        """
        values = values_of(part, self._descriptors[part], report)
        if values is not None:
            self._controls.take(values)
        return values is not None

    def _grasp(self, now: float) -> list[Request]:
        controls = self._controls
        if not controls.known:  # no axis may drive yet, but a stop button stops
            stopping, self._stopping = self._stopping, "quickstop" in controls.down
            return [Request.QUICKSTOP] if self._stopping and not stopping else []
        if not self._raw:
            self._hands.hold(controls.down)
        if controls.raw != self._raw:
            self._raw, self._changed = controls.raw, now
        return self._hands.grasp(controls.axes, controls.down)

    def sample(self, now: float) -> OperatorInput | None:
        """What is wished at `now` [s]; None before every axis was heard of."""
        if not self._raw or self.news is None:
            return None
        controls, wish = self._controls, self._hands.wish(now)
        age = max(0.0 if self._is_sparse(part) else now - heard for part, heard in self.heard.items())
        held = "enable" in controls.down if self._deadman else not wish.neutral
        neutral = wish.neutral and not held and "quickstop" not in controls.down
        rested = self._has_rested(neutral and age <= STALE, now)
        self._released = age <= STALE and (self._released or rested)
        enabled = held and self._released and self._still_there(wish.speed, now)
        self._released = self._released and (enabled or not held)
        in_doubt = self._silence(now) > DOUBT
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
        return speed == 0 or not (self._silence(now) > GONE or now - self._changed > STUCK)

    def _is_sparse(self, part: str) -> bool:
        return self._reports[part] == "on_change"

    def _silence(self, now: float) -> float:
        """How long a device that reports changes alone has said nothing [s], of several the longest."""
        return max((now - heard for part, heard in self.heard.items() if self._is_sparse(part)), default=0.0)

    def stops(self, part: str, report: bytes) -> bool:
        """Whether a report has the stop button, or the brake, pressed."""
        try:
            self._understand(part, report)
        except HidError:
            return False
        return self._hands.asks_to_stop(self._controls.axes, self._controls.down)
