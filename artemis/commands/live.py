"""The live view of a run in the terminal: one line that changes, or plain lines where there is no terminal."""

from __future__ import annotations

import sys
from math import degrees
from types import TracebackType
from typing import Self

from artemis.clock import stopwatch
from artemis.values import Fault, Mode, Tick

REFRESH = 0.1
"""Seconds on the wall between two refreshes of the changing line."""


class LiveView:
    """Shows each change of mode and each fault as a line of its own, and where the robot is as a changing line."""

    def __init__(self, mission: str) -> None:
        self._mission = mission
        self._terminal = sys.stdout.isatty()
        self._mode: Mode | None = None
        self._phase = ""
        self._faults: set[Fault] = set()
        self._refreshed = 0.0

    def __enter__(self) -> Self:
        self._say(f"mission {self._mission}")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._wipe()

    def show(self, tick: Tick) -> None:
        """Show a tick."""
        time = tick.snapshot.time
        if tick.mode is not self._mode or tick.wish.phase != self._phase:
            self._mode, self._phase = tick.mode, tick.wish.phase
            self._say(f"{time:8.2f} s  {tick.mode.value:9}  {tick.wish.phase}")
        new = set(tick.snapshot.verdict.faults) - self._faults
        for fault in sorted(new, key=lambda fault: -fault.severity):
            self._say(f"{time:8.2f} s  FAULT      {fault.id} {fault.text}")
        self._faults |= new
        for result in tick.snapshot.sensed.results:
            if result.values:
                codes = ", ".join(f"0x{code:04X}" for code in result.values)
                self._say(f"{time:8.2f} s  history    {result.drive}: {codes}")
        if self._terminal and stopwatch() - self._refreshed > REFRESH:
            self._refreshed = stopwatch()
            self._wipe()
            sys.stdout.write(_line(tick))
            sys.stdout.flush()

    def _say(self, line: str) -> None:
        self._wipe()
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    def _wipe(self) -> None:
        if self._terminal:
            sys.stdout.write("\r\x1b[2K")


def _line(tick: Tick) -> str:
    odometry, tracking = tick.snapshot.odometry, tick.wish.tracking
    line = f"{tick.snapshot.time:8.2f} s  {tick.mode.value:9}  {odometry.speed:+.2f} m/s  {degrees(odometry.steering):+5.1f}°"
    if tracking is None:
        return line
    done = tracking.arc_length / tracking.length if tracking.length else 1.0
    bar = "█" * round(20 * done)
    return f"{line}  {bar:░<20} {tracking.arc_length:5.1f} of {tracking.length:.1f} m  off {tracking.cross_track * 1000:+4.0f} mm"
