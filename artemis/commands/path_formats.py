"""Points of a path from files of others: tables, GPX, waypoints of ROS navigation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeGuard
from xml.parsers import expat

import numpy as np

from artemis.errors import ConfigError, shown
from artemis.motion.geodesy import local_metres
from artemis.motion.spline import Array
from artemis.motion.table import MAX_PROBLEMS, Table
from artemis.yaml_file import Data, Document, KeyPath, survey

CSV_NAMES = (
    {name: "x" for name in ("x", "x_m")}
    | {name: "y" for name in ("y", "y_m")}
    | {name + unit: "heading" for name in ("heading", "yaw", "theta") for unit in ("", "_rad")}
    | {name: "speed" for name in ("speed", "speed_m_s", "v", "velocity")}
    | {name + unit: "heading_deg" for name in ("heading", "yaw", "theta") for unit in ("_deg",)}
    | {name: "z" for name in ("z", "z_m")}
    | {name: "time" for name in ("time", "time_s", "t", "timestamp")}
)
UNUSED = ("z", "time")
"""Columns that are known, and mean nothing for a path."""
IGNORED = ("header", "frame_id", "name", "id", "stamp")
"""Keys of waypoint files that are known, and mean nothing for a path."""


@dataclass(slots=True, kw_only=True)
class Given:
    """The points of a file, in its own frame."""

    x: Array
    """[m], like `y`, shape (n,)."""
    y: Array
    heading: Array | None = None
    """Of the robot [rad]."""
    speed: Array | None = None
    """[m/s]."""
    places: list[str]
    """Of each point: file:line:column."""
    notes: list[str] = field(default_factory=list)
    """What was understood in which way."""


def text_of(raw: bytes, source: str) -> str:
    """A table's text; ConfigError with line and column where it is not UTF-8."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8")
        line, column = before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
        problem = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        raise ConfigError(f"{source}:{line}:{column}: {problem}: save the table as UTF-8 text") from None


def read_csv(raw: bytes, source: str) -> Given:
    """A table with columns x and y [m], and if they are there heading (or yaw, theta; `_deg`: in degrees) and speed.

    Raises:
        ConfigError: every problem found, with file:line:column.
    """
    table = Table(text_of(raw, source), source, CSV_NAMES, required=("x", "y"))
    columns = {name: np.array(values) for name, values in table.columns.items()}
    if "heading" in columns and "heading_deg" in columns:
        table.report_file("a heading both in rad and in degrees; keep one of them, and name every column")
    table.raise_problems()
    if "heading_deg" in columns:
        columns["heading"] = np.radians(columns["heading_deg"])
    unused = [name for name in UNUSED if name in columns]
    return Given(
        x=columns["x"],
        y=columns["y"],
        heading=columns.get("heading"),
        speed=columns.get("speed"),
        places=[f"{source}:{line}:1" for line in table.lines],
        notes=[f"not used: {', '.join(unused)}"] if unused else [],
    )


# -------------------------------------------------------------------------------------------------------------- GPX


class _Gpx:
    """Collects the points of tracks (`trkpt`) and of routes (`rtept`) while the parser reads.

    A document type is refused before any entity could be declared in it, let alone expanded.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self.points: dict[str, list[tuple[float, float, str]]] = {"trkpt": [], "rtept": []}
        self.counts = dict.fromkeys(("trk", "trkseg", "rte"), 0)
        self.problems: list[str] = []
        self._root = True
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._start
        self._parser.StartDoctypeDeclHandler = self._doctype

    def read(self, raw: bytes) -> None:
        try:
            self._parser.Parse(raw, True)
        except expat.ExpatError as error:
            words = expat.ErrorString(error.code)
            raise ConfigError(f"{self.source}:{error.lineno}:{error.offset + 1}: not XML: {words}") from None
        except (LookupError, ValueError) as error:  # an encoding that Python does not know, or cannot use here
            raise ConfigError(f"{self._place()}: not XML that can be read: {error}") from None

    def _place(self) -> str:
        return f"{self.source}:{self._parser.CurrentLineNumber}:{self._parser.CurrentColumnNumber + 1}"

    def _doctype(self, *_: object) -> None:
        raise ConfigError(f"{self._place()}: a document type (<!DOCTYPE) is refused: GPX has none; remove it")

    def _start(self, element: str, attributes: dict[str, str]) -> None:
        name = element.rpartition(" ")[2]
        if self._root and name != "gpx":
            raise ConfigError(f"{self._place()}: expected a GPX file, which begins with <gpx>; found <{shown(name)}>")
        self._root = False
        if name in self.counts:
            self.counts[name] += 1
        elif name in self.points:
            latitude, longitude = self._angle(attributes, "lat", 90.0), self._angle(attributes, "lon", 180.0)
            if latitude is not None and longitude is not None:
                self.points[name].append((latitude, longitude, self._place()))

    def _angle(self, attributes: dict[str, str], name: str, bound: float) -> float | None:
        written = attributes.get(name)
        try:
            value = float(written) if written is not None else math.nan
        except ValueError:
            value = math.nan
        if abs(value) <= bound:
            return value
        found = "none" if written is None else shown(written)
        self.problems.append(f"{self._place()}: {name}: expected -{bound:g} to {bound:g} degrees, found {found}")
        return None


def read_gpx(raw: bytes, source: str) -> Given:
    """The only track of a GPX file, else its only route: metres to the east (x) and north (y) of its first point.

    Raises:
        ConfigError: no GPX, a document type, no points or several tracks; with file:line:column.
    """
    gpx = _Gpx(source)
    gpx.read(raw)
    tracks, routes = gpx.counts["trk"], gpx.counts["rte"]
    points = gpx.points["trkpt"] or gpx.points["rtept"]
    problems = gpx.problems
    if len(problems) > MAX_PROBLEMS:
        problems = [*problems[:MAX_PROBLEMS], f"{source}: and {len(problems) - MAX_PROBLEMS} more problems"]
    elif not points and not problems:
        problems = [f"{source}:1:1: no track and no route with points (<trkpt>, <rtept>)"]
    elif (tracks if gpx.points["trkpt"] else routes) > 1:
        what = f"{tracks} tracks" if gpx.points["trkpt"] else f"{routes} routes"
        problems = [*problems, f"{source}:1:1: {what}: one file becomes one path; leave one in it"]
    if problems:
        raise ConfigError(problems)
    x, y = local_metres(np.radians([point[0] for point in points]), np.radians([point[1] for point in points]))
    notes = [f"x is east and y north of {points[0][0]:.7f}, {points[0][1]:.7f} (WGS 84)"]
    if tracks and gpx.counts["trkseg"] > 1:
        notes.append(f"{gpx.counts['trkseg']} segments were joined")
    return Given(x=x, y=y, places=[point[2] for point in points], notes=notes)


# ------------------------------------------------------------------------------------------------------------- YAML


class _Poses:
    """Reads poses as messages of ROS are written in YAML: `{position: {x, y}, orientation: {x, y, z, w}}`."""

    def __init__(self, document: Document, problems: list[str]) -> None:
        self.document = document
        self.problems = problems
        self.ignored: list[str] = []

    def read(self) -> list[tuple[KeyPath, float, float, float | None]]:
        """Key path, x, y [m] and heading [rad] of each pose."""
        data, at = self._list()
        poses = []
        for index, item in enumerate(data):
            path: KeyPath = (*at, index)
            if self._mapping(item, path):
                poses.append((path, *self._pose(item, path)))
        return poses

    def _complain(self, path: KeyPath, text: str) -> None:
        if not any(path[: len(damaged)] == damaged for damaged in self.document.damaged):
            self.problems.append(self.document.problem(path, text))

    def _mapping(self, data: Data, path: KeyPath) -> TypeGuard[dict[str, Data]]:
        if not isinstance(data, dict):
            self._complain(path, f"expected keys and values, found {shown(data)}")
        return isinstance(data, dict)

    def _list(self) -> tuple[list[Data], KeyPath]:
        data = self.document.data
        if isinstance(data, list):
            return data, ()
        if not self._mapping(data, ()):
            return [], ()
        self._check_keys(data, (), ("poses", "waypoints"))
        found = [key for key in ("poses", "waypoints") if key in data]
        if len(found) != 1:
            self._complain((), "expected a list of poses, under `poses:` or `waypoints:`")
            return [], ()
        items = data[found[0]]
        if not isinstance(items, list):
            self._complain((found[0],), f"expected a list of poses, found {shown(items)}")
            return [], ()
        return items, (found[0],)

    def _check_keys(self, data: Mapping[str, Data], path: KeyPath, known: tuple[str, ...]) -> None:
        for key in data:
            if key in IGNORED:
                self.ignored.append(key)
            elif key not in known:
                self._complain((*path, key), f"unknown key; known are {', '.join(known)}")

    def _pose(self, item: dict[str, Data], path: KeyPath) -> tuple[float, float, float | None]:
        if "pose" in item:
            self._check_keys(item, path, ("pose",))
            inner = item["pose"]
            path = (*path, "pose")
            if not self._mapping(inner, path):
                return 0.0, 0.0, None
            item = inner
        if "position" not in item:
            self._check_keys(item, path, ("x", "y", "z", "yaw"))
            return self._number(item, path, "x"), self._number(item, path, "y"), self._yaw(item, path)
        self._check_keys(item, path, ("position", "orientation", "yaw"))
        position, at = item["position"], (*path, "position")
        if not self._mapping(position, at):
            return 0.0, 0.0, None
        self._check_keys(position, at, ("x", "y", "z"))
        return self._number(position, at, "x"), self._number(position, at, "y"), self._heading(item, path)

    def _heading(self, item: dict[str, Data], path: KeyPath) -> float | None:
        orientation, at = item.get("orientation"), (*path, "orientation")
        if "orientation" not in item:
            return self._yaw(item, path)
        if "yaw" in item:
            self._complain((*path, "yaw"), "a yaw and an orientation; keep one of them")
        if not self._mapping(orientation, at):
            return None
        if "yaw" in orientation:
            self._check_keys(orientation, at, ("yaw",))
            return self._yaw(orientation, at)
        self._check_keys(orientation, at, ("x", "y", "z", "w"))
        x, y = (self._number(orientation, at, key, 0.0) for key in "xy")
        z, w = (self._number(orientation, at, key) for key in "zw")
        length = math.hypot(x, y, z, w)
        if length == 0.0:  # what a message holds that nobody filled in
            return None
        if abs(length - 1.0) > 0.05:
            self._complain(at, f"expected a quaternion of length 1, found {length:.3g}")
        return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)

    def _yaw(self, item: dict[str, Data], path: KeyPath) -> float | None:
        return self._number(item, path, "yaw") if "yaw" in item else None

    def _number(self, item: dict[str, Data], path: KeyPath, key: str, default: float | None = None) -> float:
        value: Any = item.get(key, default)
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12:
            return float(value)
        found = "none" if key not in item else shown(value)
        self._complain((*path, key), f"expected a number, found {found}")
        return 0.0


def read_nav2(raw: bytes, source: str) -> Given:
    """A list of poses in YAML, also under `poses:` or `waypoints:`, each also under `pose:`; frame ids are ignored.

    A pose has `position: {x, y}` and `orientation: {x, y, z, w}` (a quaternion) or `yaw` [rad], or x, y and yaw itself.

    Raises:
        ConfigError: everything wrong, with file:line:column and key.
    """
    document, problems = survey(raw, source)
    reader = _Poses(document, problems)
    poses = reader.read()
    if not poses and not reader.problems:
        reader.problems.append(document.problem((), "no poses"))
    without = [path for path, _, _, heading in poses if heading is None]
    if poses and 0 < len(without) < len(poses) and not reader.problems:
        reader.problems.append(document.problem(without[0], "no orientation, but other poses have one; all or none"))
    if problems := reader.problems:
        more = [f"{source}: and {len(problems) - MAX_PROBLEMS} more problems"] if len(problems) > MAX_PROBLEMS else []
        raise ConfigError([*problems[:MAX_PROBLEMS], *more])
    positions = [document.position(path) for path, *_ in poses]
    ignored = sorted(set(reader.ignored))
    return Given(
        x=np.array([x for _, x, _, _ in poses]),
        y=np.array([y for _, _, y, _ in poses]),
        heading=None if without else np.array([heading for *_, heading in poses], dtype=float),
        places=[f"{source}:{line}:{column}" for line, column in positions],
        notes=[f"not used: {', '.join(ignored)}"] if ignored else [],
    )


READERS: Mapping[str, Callable[[bytes, str], Given]] = {"csv": read_csv, "gpx": read_gpx, "nav2": read_nav2}
SUFFIXES = {".csv": "csv", ".txt": "csv", ".gpx": "gpx", ".yaml": "nav2", ".yml": "nav2"}
