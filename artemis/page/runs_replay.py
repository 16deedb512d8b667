"""What a page replays a run from: a part of the states that a live page gets, in pieces that are read one by one.

`index.json` describes the whole run: its driven path, modes, steps, faults and log. A piece begins with everything that
holds at its beginning, so that a page that goes there needs no other. All are packed by gzip, as browsers take it.
"""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from math import hypot, inf
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from artemis.errors import ConfigError, RecordingError
from artemis.mapping.occupancy import ShownMap
from artemis.page.runs import signature
from artemis.page.view import TRAIL_STEP, PageView, is_shown, line_of, map_part
from artemis.recording.journal import Entry, Level
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.report.cross_track import routes_of
from artemis.report.known_map import known_map, made_map
from artemis.states.outline import numbered
from artemis.states.step_names import name_of
from artemis.values import LocatedPose, Pose

FORM = 3
"""Of these files; those of another number are made again."""
EVERY, MOST_STATES = 0.1, 150_000
"""Between two states [s]; in a run with more of them they are further apart."""
SCAN_EVERY, MOST_SCANS = 0.5, 4000
"""Likewise of scans, which are twenty times as large."""
IN_PIECE = 600
"""States in one piece."""
MOST_TRAIL = 6000
"""Points of the driven path."""
MOST_LINES = 4000
"""Of the log; of a longer one those that only inform are left out."""
_MADE = "made.json"
"""What the files are made of."""
_JSON = msgspec.json.Encoder().encode
_SCANS, _RESULTS, _LAST = b'"scans":[', b'"results":[', b'"finished":true'


class _Made(msgspec.Struct):
    form: int
    made_of: list[int]


def is_made(folder: Path, run: Path) -> bool:
    """Whether all of these files are in a folder, and of the run as it is now."""
    try:
        known = msgspec.json.decode((folder / _MADE).read_bytes(), type=_Made)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError):
        return False
    return known.form == FORM and known.made_of == signature(run)


def write_replay(run: Path, folder: Path, tell: Callable[[float], None] = lambda share: None) -> None:
    """Make these files of a run. `tell` is called with the share that is done: from then on this part can be shown.

    Raises:
        RecordingError: the recording cannot be read, or the files not be written.
    """
    made_of = signature(run)
    recording = Recording(run)
    try:
        with suppress(FileNotFoundError):
            shutil.rmtree(folder)
        folder.mkdir()
        _Writer(recording, folder, tell).write()
        (folder / _MADE).write_bytes(_JSON(_Made(FORM, made_of)))
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _put(file: Path, content: Any) -> None:  # noqa: ANN401 (JSON)
    """Completely or not at all: it is read at the same time."""
    part = file.with_suffix(".part")
    part.write_bytes(gzip.compress(_JSON(content), 6, mtime=0))
    part.replace(file)


MOMENTS = ("fault", "mode", "mission")
"""Kinds of entries whose ticks are shown in any case."""


class _Writer:
    """Sees those ticks of a recording that are shown."""

    def __init__(self, recording: Recording, folder: Path, tell: Callable[[float], None]) -> None:
        self._recording, self._folder, self._tell = recording, folder, tell
        mission = recording.mission
        routes = {number: route for number, (route, _) in routes_of(recording).items()}
        self._view = PageView(recording.robot, mission, routes)
        self._names = [name_of(word, body) for _, word, body in numbered(mission.get("steps"))]
        self._every = max(EVERY, recording.duration / MOST_STATES)
        self._scan_every = max(SCAN_EVERY, recording.duration / MOST_SCANS)
        self._next = self._next_scan = -inf
        self._versions: dict[str, int] = {}
        self._begins: list[float] = []
        self._states: list[tuple[float, dict[str, Any]]] = []
        self._parts: list[tuple[float, dict[str, Any]]] = []
        self._state: dict[str, Any] = {}
        self._time = 0.0
        self._steps: list[tuple[float, int]] = []
        self._trail = _Trail()
        self._entries = recording.events()
        self._moments = sorted((entry.time for entry in self._entries if entry.kind in MOMENTS), reverse=True)
        self._has_map = False

    def write(self) -> None:
        """Write the pieces, and the index when there are 1, 2, 4 ... of them, and at the end."""
        for tick in self._recording.chosen_ticks(self._is_shown):
            if len(self._states) >= IN_PIECE:
                self._end_piece()
                if (number := len(self._begins)) & (number - 1) == 0:
                    self._write_index(whole=False)
                self._tell(min(1.0, self._time / max(self._recording.duration, 1e-3)))
            self._see(tick)
        self._end_piece()
        self._write_index(whole=True)

    def _write_index(self, *, whole: bool) -> None:
        recording, entries = self._recording, self._entries
        self._has_map = self._has_map or self._write_map()
        begin = self._begins[0] if self._begins else 0.0
        index = {
            "whole": whole,
            "about": self._view.about(),
            "start": recording.start.isoformat(),
            "begin": begin,
            "end": round(begin + recording.duration, 3),
            "known": self._time,
            "pieces": self._begins,
            "modes": [[entry.time, _mode_of(entry)] for entry in entries if entry.kind == "mode"],
            "steps": [[time, step, self._name(step)] for time, step in self._steps],
            "faults": [[entry.time, entry.text, entry.level] for entry in entries if entry.kind == "fault"],
            "log": _log(entries),
            "trail": self._trail.points,
            "map": self._has_map,
            "outcome": recording.outcome,
            "problem": recording.missing or "",
            "versions": {name: text for name, text in recording.versions.items() if not name.startswith("start")},
        }
        _put(self._folder / "index.json.gz", index)

    def _name(self, step: int) -> str:
        return self._names[step] if 0 <= step < len(self._names) else ""

    def _is_shown(self, time: float, record: bytes) -> bool:
        """Whether a tick is: when it is time for a state or a scan, at one of the `MOMENTS`, or where a job ended."""
        while self._moments and time >= self._moments[-1] - 1e-6:
            self._moments.pop()
            self._next = -inf
        if time >= self._next or _RESULTS in record or _LAST in record:
            return True
        return time >= self._next_scan and _SCANS in record

    def _see(self, tick: TickRecord) -> None:
        view, snapshot = self._view, tick.snapshot
        time = self._time = round(snapshot.time, 3)
        view.show(tick)
        if not self._states:
            self._begins.append(time)
            self._versions.clear()
            self._state = {}
        for name, (version, content) in view.parts.items():
            if self._versions.get(name) == version or (name == "scan" and self._states and time < self._next_scan):
                continue
            self._versions[name] = version
            self._parts.append((time, {name: content}))
            if name == "scan":
                self._next_scan = time + self._scan_every
        if time >= self._next or tick.wish.finished or not self._states:
            self._next = time + self._every - 1e-3
            state = view.state(tick)
            new = {name: value for name, value in state.items() if self._state.get(name, self) != value}
            self._states.append((time, new))
            self._state = state
        if not self._steps or self._steps[-1][1] != tick.position.step:
            self._steps.append((time, tick.position.step))
        if not snapshot.pose.lost:
            self._trail.see(time, snapshot.pose)

    def _end_piece(self) -> None:
        if self._states:
            _put(self._folder / f"{len(self._begins) - 1}.json.gz", {"states": self._states, "parts": self._parts})
            self._states, self._parts = [], []

    def _write_map(self) -> bool:
        """The map on which the robot was localised, or that it made; whether there is one."""
        content, first = known_map(self._recording), self._trail.first
        if content is None and first is not None:
            with suppress(ConfigError):
                time, pose = first
                at = np.array([[pose.x, pose.y, pose.heading]])
                content = made_map(self._recording.path.parent, np.array([time]), at)
        if content is not None:
            _put(self._folder / "map.json.gz", map_part(ShownMap(content=content)))
        return content is not None


class _Trail:
    """The driven path: time, x and y of points that are apart; None between two frames of the poses."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float] | None] = []
        self.first: tuple[float, Pose] | None = None
        self._frame, self._apart = "", TRAIL_STEP

    def see(self, time: float, located: LocatedPose) -> None:
        """Where the robot is then."""
        self.first = self.first or (time, located.pose)
        x, y, points = located.pose.x, located.pose.y, self.points
        if located.frame != self._frame:
            self._frame = located.frame
            points += [None] if points else []
        elif (last := points[-1]) is not None and hypot(x - last[1], y - last[2]) < self._apart:
            return
        points.append((time, round(x, 3), round(y, 3)))
        if len(points) > MOST_TRAIL:
            self._apart *= 2
            self.points = [point for number, point in enumerate(points) if number % 2 == 0 or _is_end(points, number)]


def _is_end(points: Sequence[object], number: int) -> bool:
    """Whether a point begins or ends a frame."""
    return None in points[max(number - 1, 0) : number + 2] or number == len(points) - 1


def _mode_of(entry: Entry) -> str:
    """A log has the text alone: `follow -> fault: why`."""
    return str(entry.data.get("to") or entry.text.split(": ", 1)[0].rsplit(" -> ", 1)[-1])


def _log(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    shown = [entry for entry in entries if is_shown(entry)]
    if len(shown) > MOST_LINES:
        shown = [entry for entry in shown if entry.level > Level.INFO][:MOST_LINES]
    return [line_of(entry) for entry in shown]
