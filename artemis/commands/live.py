"""The live view of a run: what happens, line by line; in a terminal also where the robot is, in a line that changes."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from math import degrees
from typing import ClassVar

from artemis.clock import stopwatch
from artemis.commands.terminal import lose_output
from artemis.config import Config
from artemis.devices.can_bus import Traffic, most_bits
from artemis.drive_states import DriveState
from artemis.families.family import Errors
from artemis.plugins.guard import Problem
from artemis.recording.asked_poses import AskedPoses
from artemis.recording.disk import FULL
from artemis.recording.event_log import by_key, happened, values_of
from artemis.recording.journal import Level
from artemis.report.fault_words import explained_now
from artemis.report.mission_times import MissionTimes
from artemis.states.modes import RUNNING
from artemis.states.requests import accepted, ignored
from artemis.values import Fault, JobKind, Mode, OperatorInput, Request, Severity, Snapshot, Tick, Verdict

REFRESH = 0.1
"""Seconds on the wall between two refreshes of the changing line."""
LOAD_TIME = 0.5
"""Over so long the bus load is averaged [s]."""
LONGEST_BAR = 30
"""Characters."""

_RED, _YELLOW, _GREEN, _DIM, _BOLD = "31", "33", "32", "2", "1"  # SGR parameters (ECMA-48, 8.3.117)
_MODE_COLOURS = {Mode.FAULT: _RED, Mode.QUICKSTOP: _YELLOW}
_LABELS = {JobKind.READ_HISTORY: "history", JobKind.CLEAR_TARGET: "target"}
"""What jobs brought back that people should see."""
_MARGIN = 21
"""Characters before the text of a line."""
_WIPE = "\r\x1b[2K"


class LiveView:
    """An observer that tells people what changed.

    Nobody may read any more (`| head`, a closed window): then `on_lost` is called once, and what is still to be said
    goes nowhere.
    """

    Config: ClassVar[type[Config]] = Config

    def __init__(
        self,
        title: str,
        hint: str,
        on_lost: Callable[[], None],
        bitrate: int,
        errors: Errors,
        mission: MissionTimes | None = None,
    ) -> None:
        """Say the title.

        Args:
            title: What runs.
            hint: Names the keys that work.
            on_lost: Is called at a tick.
            bitrate: Of the bus [bit/s].
            errors: What the drives' error codes mean.
            mission: Knows where it is, of a mission with words; None: it is a list of steps.
        """
        self._mission, self._errors = mission, errors
        self._terminal = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
        self._coloured = self._terminal and not os.environ.get("NO_COLOR")
        self._on_lost = on_lost
        self._lost = False
        self._poses = AskedPoses()
        self._load = _BusLoad(bitrate)
        self._shown: tuple[Mode | None, str] = (None, "")
        self._requested: dict[Request, str | None] = {}
        """At the tick before; why each was ignored, if it was."""
        self._verdict = Verdict()
        self._refreshed = -REFRESH
        self._lines = [self._styled(title, _BOLD), *([self._styled(hint, _DIM)] if hint else [])]
        self._write("")

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Say what is new in a tick, and where the robot is."""
        if self._terminal:
            self._load.count(tick.snapshot.time, traffic)
        if self._mission is not None:
            self._mission.see(tick)
        sensed = tick.snapshot.sensed
        for answer in (*sensed.answers, *(typed.text for typed in sensed.typed)):
            self._say(sensed.time, "answer", answer)
        self._point(tick)
        if sensed.requests or self._requested:
            self._request(tick)
        if tick.snapshot.verdict is not self._verdict:
            self._compare(sensed.time, tick.snapshot.verdict)
        for result in sensed.results:
            if result.values and (label := _LABELS.get(result.kind)):
                self._say(sensed.time, label, f"{result.drive}: {values_of(result, self._errors)}", _YELLOW)
        for event in tick.events:
            told = event.kind == "said"
            text = event.text if told else happened(event, tick.mode)
            self._say(sensed.time, "mission", text, _BOLD if told else _DIM)
        if tick.wish.phase and (tick.mode, tick.wish.phase) != self._shown:
            self._shown = tick.mode, tick.wish.phase
            self._say(sensed.time, tick.mode.value, tick.wish.phase, _MODE_COLOURS.get(tick.mode))
        if self._lines or (self._terminal and stopwatch() - self._refreshed >= REFRESH):
            self._write(self._status(tick))
        if self._lost:
            self._lost = False
            self._on_lost()

    def _request(self, tick: Tick) -> None:
        """What was asked for, once where an input repeats it at every tick."""
        before, self._requested = self._requested, {}
        for request in tick.snapshot.sensed.requests:
            reason = self._requested[request] = ignored(request, tick)
            if request not in before or before[request] != reason:
                told = f"ignored, {reason}" if reason else accepted(request, tick, self._verdict)
                text = f"{request.value}: {told}" if told else request.value
                self._say(tick.snapshot.sensed.time, "request", text, _YELLOW if reason else None)

    def _point(self, tick: Tick) -> None:
        """Goals and initial poses that somebody gave."""
        for sample in tick.snapshot.sensed.inputs:
            for entry in self._poses.entries(tick, sample):
                colour = _YELLOW if entry.level is Level.WARNING else None
                self._say(entry.time, entry.kind, entry.text, colour)

    def take_problems(self) -> list[Problem]:
        """None: a lost terminal ends the run."""
        return []

    def close(self) -> None:
        """Leave no changing line behind."""
        self._write("")

    def _compare(self, time: float, verdict: Verdict) -> None:
        before, self._verdict = self._verdict, verdict
        old, new = by_key(before), by_key(verdict)
        for key, fault in new.items():
            if key not in old or fault.severity > old[key].severity:
                self._explain(time, fault)
        for key, fault in old.items():
            if key not in new:
                self._say(time, "cleared", f"{fault.id} {fault.device}".rstrip(), _GREEN)
        if verdict.alarm and not before.alarm:
            self._say(time, "ALARM", "the robot does not stop: PRESS THE EMERGENCY STOP", _RED)

    def _explain(self, time: float, fault: Fault) -> None:
        """What failed, where to look, what artemis did, what to do next."""
        self._say(time, "FAULT", f"{fault.id} {fault.text}", _severity_colour(fault))
        for label, text in explained_now(fault).items():
            if text:
                self._lines.append(self._styled(f"{label:>{_MARGIN}}  {text}", _DIM))

    def _say(self, time: float, kind: str, text: str, colour: str | None = None) -> None:
        self._lines.append(self._styled(f"{time:8.2f} s  {kind:9}  {text}", colour))

    def _styled(self, text: str, colour: str | None) -> str:
        return f"\x1b[{colour}m{text}\x1b[0m" if colour and self._coloured else text

    def _write(self, status: str) -> None:
        """Write the lines, in a terminal with the changing line below."""
        text = "".join(f"{line}\n" for line in self._lines)
        self._lines.clear()
        if self._terminal:
            text, self._refreshed = _WIPE + text + status, stopwatch()
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError as error:
            lose_output()
            self._lost = error.errno not in FULL
            then = "the run ends" if self._lost else "the run continues, its journal shows the rest"
            sys.stderr.write(f"artemis: standard output cannot be written: {error.strerror}; {then}\n")

    def _status(self, tick: Tick) -> str:
        """The changing line, no longer than the terminal is wide."""
        width = shutil.get_terminal_size().columns - 1
        mission = self._mission if tick.mode in RUNNING else None
        where, before = (mission.here, mission.before) if mission is not None else ("", "")
        return self._styled(status(tick, width, self._load.share, where, before), _MODE_COLOURS.get(tick.mode))


class _BusLoad:
    """How busy the bus is, over the last half second."""

    def __init__(self, bitrate: int) -> None:
        self._bitrate, self._begun, self._bits = bitrate, 0.0, 0
        self.share = 0.0

    def count(self, time: float, traffic: Traffic) -> None:
        self._bits += sum(most_bits(len(frame.data)) for _, frame in traffic)
        if time - self._begun >= LOAD_TIME:
            self.share = self._bits / ((time - self._begun) * self._bitrate)
            self._begun, self._bits = time, 0


def status(tick: Tick, width: int, load: float = 0.0, where: str = "", before: str = "") -> str:
    """Where the robot is, in at most `width` characters: the distance along the path, or what it does.

    `where` it is in the mission stands behind the mode; how the step `before` ended, at the end.
    By hand also what the wheels and the hand do, which drives are not on, and the share `load` of the bus in use.
    """
    odometry, tracking = tick.snapshot.odometry, tick.wish.tracking
    mode = tick.mode.value
    doing = where if where.startswith(mode) else f"{mode:9}  {where}" if where else f"{mode:9}"
    line = f"{tick.snapshot.time:8.2f} s  {doing}"
    line += f"  {odometry.speed:+.2f} m/s  {degrees(odometry.steering):+5.1f}°"
    if tick.mode is Mode.TELEOP:
        line += _by_hand(tick.snapshot, load)
    after = f"  after {before}" if before else ""
    if tracking is None:
        return f"{line}  {tick.wish.phase}{after}"[:width]
    line += (
        f"  cross-track {tracking.cross_track * 1000:+4.0f} mm  {tracking.arc_length:5.1f} of {tracking.length:.1f} m"
    )
    line += after
    bar = min(LONGEST_BAR, width - len(line) - 2)
    if bar > 0:
        done = min(max(tracking.arc_length / tracking.length, 0.0), 1.0) if tracking.length else 1.0
        line += "  " + ("█" * round(bar * done)).ljust(bar, "░")
    return line[:width]


def _by_hand(snapshot: Snapshot, load: float) -> str:
    points = snapshot.set_points
    wheels = f"{degrees(points.steering_left):+.0f}° {degrees(points.steering_right):+.0f}°"
    off = [drive.name for drive in snapshot.sensed.drives if drive.state is not DriveState.OPERATION_ENABLE]
    hands = "".join(f"  {sample.source} {hand_words(sample)}" for sample in snapshot.sensed.inputs)
    drives = f"NOT ON: {', '.join(off)}" if off else "drives on"
    return f"  wheels {wheels}  {drives}  bus {load:.0%}{hands}"


def hand_words(sample: OperatorInput) -> str:
    """What a hand does at its device."""
    if sample.age is None:
        return "silent"
    state = "held" if sample.enabled else "released" if sample.neutral else "not neutral"
    return f"{sample.speed:+.2f} m/s {degrees(sample.steering):+.0f}° {state}"


def _severity_colour(fault: Fault) -> str:
    return _RED if fault.severity >= Severity.CONTROLLED_STOP else _YELLOW
