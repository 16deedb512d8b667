"""What an operator far away sees: what changes, line by line; in a terminal also a line about robot and link."""

from __future__ import annotations

import os
import shutil
import sys

from artemis.bridges.operator.status import RobotStatus
from artemis.clock import stopwatch

REFRESH = 0.1
_WIPE = "\r\x1b[2K"


class OperatorView:
    """Writes to standard output."""

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
        self._before: RobotStatus | None = None
        self._written = -REFRESH
        self._device = ""

    def say(self, kind: str, text: str) -> None:
        """A line."""
        sys.stdout.write(f"{_WIPE * self._terminal}{kind:9}  {text}\n")
        sys.stdout.flush()

    def device(self, problem: str) -> None:
        """What is wrong with the operator's own device; empty: nothing."""
        if problem != self._device:
            self.say("device", problem or "it is there again")
            self._device = problem

    def forget(self) -> None:
        """The link is lost: what comes next is news."""
        self._before = None

    def see(self, status: RobotStatus) -> None:
        """What the robot does: what is new of it."""
        before, self._before = self._before, status
        if before is None or (before.mode, before.phase) != (status.mode, status.phase):
            counts = "your commands count" if status.counts else "your commands do not count"
            self.say("robot", f"{status.mode}: {status.phase or 'as the mission says'} ({counts})")
        known = {fault.id for fault in before.faults} if before else set()
        for fault in status.faults:
            if fault.id not in known:
                self.say("FAULT" if fault.stops else "warning", f"{fault.id} {fault.text}")
        for id in known - {fault.id for fault in status.faults}:
            self.say("cleared", id)

    def refresh(self, status: RobotStatus | None, age: float | None, round_trip: float | None, hand: str) -> None:
        """The line that changes, in a terminal; not too often.

        Args:
            status: Of the robot.
            age: Of the newest command that counted, as the robot sees it [s].
            round_trip: Of that command [s].
            hand: What the operator's device wishes.
        """
        now = stopwatch()
        if not self._terminal or now - self._written < REFRESH:
            return
        self._written = now
        line = link_line(status, age, round_trip, hand)
        sys.stdout.write(_WIPE + line[: shutil.get_terminal_size().columns - 1])
        sys.stdout.flush()

    def close(self) -> None:
        """Leave no changing line behind."""
        if self._terminal:
            sys.stdout.write(_WIPE)
            sys.stdout.flush()


def link_line(status: RobotStatus | None, age: float | None, round_trip: float | None, hand: str) -> str:
    """Robot and link in one line."""
    parts = []
    if status is not None:
        drives = "DRIVING" if status.counts else "not driving"
        parts += [f"{status.mode:9}", f"{status.speed:+.2f} m/s", f"{status.steering:+5.1f}°", drives]
    parts.append("no command yet" if age is None else f"age {age * 1e3:3.0f} ms")
    if round_trip is not None:
        parts.append(f"round trip {round_trip * 1e3:.1f} ms")
    return "  ".join([*parts, hand])
