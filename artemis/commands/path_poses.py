"""Points of a path from poses as ROS writes them in YAML: messages one after the other, or a list of waypoints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeGuard

import numpy as np

from artemis.commands.path_given import Given, from_places, heading_of
from artemis.errors import ConfigError, shown
from artemis.motion.table import raise_first
from artemis.yaml_file import Data, Document, KeyPath, dotted, survey

IGNORED = (
    *("header", "frame_id", "child_frame_id", "name", "id", "seq", "stamp", "twist", "covariance", "altitude"),
    *("status", "position_covariance", "position_covariance_type"),
)
"""Keys of messages and waypoint files that are known, and mean nothing for a path."""


class _Poses:
    """Reads poses as messages of ROS are written in YAML: `{position: {x, y}, orientation: {x, y, z, w}}`."""

    def __init__(self, document: Document, problems: list[str]) -> None:
        self.document = document
        self.problems = problems
        self.ignored: list[str] = []
        self.geographic = False
        """x and y are longitude and latitude [deg]."""

    def read(self) -> list[tuple[KeyPath, float, float, float | None]]:
        """Key path, x, y [m] and heading [rad] of each pose."""
        poses: list[tuple[KeyPath, float, float, float | None]] = []
        for path, item in self._items():
            if isinstance(item, list):
                poses.append((path, *self._pair(item, path), None))
            elif self._mapping(item, path):
                poses.append((path, *self._pose(item, path)))
        return poses

    def complain(self, path: KeyPath, text: str) -> None:
        """Note a problem; `path` begins with the number of the document, which its line tells."""
        key = path[1:]
        if not any(key[: len(damaged)] == damaged for damaged in self.document.damaged):
            line, column = self.document.position(path)
            words = f"{dotted(key)}: {text}" if key else text
            self.problems.append(f"{self.document.source}:{line}:{column}: {words}")

    def _mapping(self, data: Data, path: KeyPath) -> TypeGuard[dict[str, Data]]:
        if not isinstance(data, dict):
            self.complain(path, f"expected keys and values, found {shown(data)}")
        return isinstance(data, dict)

    def _items(self) -> Iterable[tuple[KeyPath, Data]]:
        """Every pose of every document, and where it is."""
        documents = self.document.data if isinstance(self.document.data, list) else []
        if not documents:
            self.complain((), "expected keys and values, found None")
        for number, data in enumerate(documents):
            yield from self._of_document(data, (number,))

    def _of_document(self, data: Data, at: KeyPath) -> Iterable[tuple[KeyPath, Data]]:
        """A list of poses, a mapping with one, or a message with one pose."""
        if isinstance(data, list):
            yield from (((*at, index), item) for index, item in enumerate(data))
            return
        if not self._mapping(data, at):
            return
        if {"pose", "position", "x", "latitude"} & data.keys():
            yield at, data
            return
        self._check_keys(data, at, ("poses", "waypoints"))
        found = [key for key in ("poses", "waypoints") if key in data]
        if len(found) != 1:
            self.complain(at, "expected a list of poses, under `poses:` or `waypoints:`")
            return
        items, at = data[found[0]], (*at, found[0])
        if isinstance(items, dict):  # of the panel of Nav2: by their names
            yield from (((*at, key), item) for key, item in items.items())
        elif isinstance(items, list):
            yield from (((*at, index), item) for index, item in enumerate(items))
        else:
            self.complain(at, f"expected a list of poses, found {shown(items)}")

    def _check_keys(self, data: Mapping[str, Data], path: KeyPath, known: tuple[str, ...]) -> None:
        for key in data:
            if key in IGNORED:
                self.ignored.append(key)
            elif key not in known:
                self.complain((*path, key), f"unknown key; known are {', '.join(known)}")

    def _pair(self, item: list[Data], path: KeyPath) -> tuple[float, float]:
        if len(item) != 2:
            self.complain(path, f"{len(item)} numbers; expected x and y, or keys: {{x: 1, y: 2, yaw: 0.5}}")
            return 0.0, 0.0
        x, y = (self._number(dict(zip("xy", item, strict=True)), path, key) for key in "xy")
        return x, y

    def _pose(self, item: dict[str, Data], path: KeyPath) -> tuple[float, float, float | None]:
        while "pose" in item:
            inner = item["pose"]
            if isinstance(inner, list):
                return self._of_panel(item, path, inner)
            self._check_keys(item, path, ("pose",))
            path = (*path, "pose")
            if not self._mapping(inner, path):
                return 0.0, 0.0, None
            item = inner
        if "latitude" in item:
            self._check_keys(item, path, ("latitude", "longitude", "yaw"))
            self.geographic = True
            return self._number(item, path, "longitude"), self._number(item, path, "latitude"), None
        if "position" not in item:
            self._check_keys(item, path, ("x", "y", "z", "yaw", "theta"))
            return self._number(item, path, "x"), self._number(item, path, "y"), self._yaw(item, path)
        self._check_keys(item, path, ("position", "orientation", "yaw"))
        position, at = item["position"], (*path, "position")
        if not self._mapping(position, at):
            return 0.0, 0.0, None
        self._check_keys(position, at, ("x", "y", "z"))
        return self._number(position, at, "x"), self._number(position, at, "y"), self._heading(item, path)

    def _of_panel(
        self, item: dict[str, Data], path: KeyPath, position: list[Data]
    ) -> tuple[float, float, float | None]:
        """A waypoint that Nav2's panel saved: `pose: [x, y, z]`, `orientation: [w, x, y, z]`."""
        self._check_keys(item, path, ("pose", "orientation"))
        rotation = item.get("orientation")
        if len(position) != 3 or not isinstance(rotation, list) or len(rotation) != 4:
            self.complain(path, "expected pose: [x, y, z] and orientation: [w, x, y, z]")
            return 0.0, 0.0, None
        x, y = (self._number(dict(zip("xyz", position, strict=True)), (*path, "pose"), key) for key in "xy")
        return x, y, self._heading({"orientation": dict(zip("wxyz", rotation, strict=True))}, path)

    def _heading(self, item: dict[str, Data], path: KeyPath) -> float | None:
        orientation, at = item.get("orientation"), (*path, "orientation")
        if "orientation" not in item:
            return self._yaw(item, path)
        if "yaw" in item:
            self.complain((*path, "yaw"), "a yaw and an orientation; keep one of them")
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
            self.complain(at, f"expected a quaternion of length 1, found {length:.3g}")
        return float(heading_of(*np.array([[x], [y], [z], [w]]))[0])

    def _yaw(self, item: dict[str, Data], path: KeyPath) -> float | None:
        key = "theta" if "theta" in item else "yaw"
        return self._number(item, path, key) if key in item else None

    def _number(self, item: dict[str, Data], path: KeyPath, key: str, default: float | None = None) -> float:
        value: Any = item.get(key, default)
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12:
            return float(value)
        found = "none" if key not in item else shown(value)
        self.complain((*path, key), f"expected a number, found {found}")
        return 0.0


def read_nav2(raw: bytes, source: str) -> Given:
    """Poses in YAML: a list, also under `poses:` or `waypoints:`, or messages in documents; frame ids are ignored.

    A pose has `position: {x, y}` and `orientation: {x, y, z, w}` (a quaternion) or `yaw` [rad], or x, y and yaw itself,
    or latitude and longitude; it may be under `pose:`, twice in a message with covariance.

    Raises:
        ConfigError: everything wrong, with file:line:column and key.
    """
    document, problems = survey(raw, source, messages=True)
    reader = _Poses(document, problems)
    poses = reader.read()
    if not poses and not reader.problems:
        reader.problems.append(document.problem((), "no poses"))
    without = [path for path, _, _, heading in poses if heading is None]
    if poses and 0 < len(without) < len(poses) and not reader.problems:
        reader.complain(without[0], "no orientation, but other poses have one; all or none")
    raise_first(reader.problems, source)
    places = [f"{source}:{line}:{column}" for line, column in (document.position(path) for path, *_ in poses)]
    ignored = sorted(set(reader.ignored))
    notes = [f"not used: {', '.join(ignored)}"] if ignored else []
    if reader.geographic:
        if wrong := [place for place, (_, x, y, _) in zip(places, poses, strict=True) if abs(y) > 90 or abs(x) > 180]:
            raise ConfigError(f"{wrong[0]}: expected a latitude of -90 to 90 and a longitude of -180 to 180 degrees")
        given = from_places([[(y, x, place) for place, (_, x, y, _) in zip(places, poses, strict=True)]])
        given.notes += notes
        return given
    return Given(
        x=np.array([x for _, x, _, _ in poses]),
        y=np.array([y for _, _, y, _ in poses]),
        heading=None if without else np.array([heading for *_, heading in poses], dtype=float),
        places=places,
        notes=notes,
    )
