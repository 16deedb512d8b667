"""The pose graph of a map as a file, to correct the map later: key scans, their poses, the links, the trajectory.

One message of MessagePack; arrays are bytes, numbers little-endian.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from artemis.errors import ConfigError
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.map_file import map_files
from artemis.mapping.occupancy import OccupancyMap
from artemis.mapping.pose_graph import Link, PoseGraph
from artemis.mapping.se2 import Array, between, compose
from artemis.yaml_file import read

SUFFIX = ".graph"
VERSION = 1
_MOST_BYTES = 1 << 31


class SavedLink(msgspec.Struct, frozen=True, array_like=True):
    """A `Link` and its number."""

    number: int
    first: int
    second: int
    loop: bool
    motion: bytes
    information: bytes
    untold: bytes = bytes(16)
    """Files of earlier versions have none."""


class SavedGraph(msgspec.Struct, frozen=True, kw_only=True):
    """What the file holds."""

    artemis_map: int
    """Version of this format."""
    poses: bytes
    """Of the key scans: x, y [m], heading [rad], float64."""
    scans: tuple[bytes, ...]
    """Of the key scans: x, y [m] and normal of each point, float32."""
    places: bytes = b""
    """Of the scanner on the robot at each key scan: x, y [m], float64. Files of earlier versions have none."""
    links: tuple[SavedLink, ...]
    trajectory: bytes
    """Time [s], x, y, heading of every reading, float64."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenFrom:
    """Poses, each seen from a key scan: they go with it."""

    keys: NDArray[np.int64]
    """Numbers of the key scans, shape (n,)."""
    motions: Array
    """From there, shape (n, 3)."""

    def poses(self, key_poses: Array) -> Array:
        """Where they are if the key scans are at `key_poses`, shape (m, 3); shape (n, 3)."""
        return compose(key_poses[self.keys], self.motions)


class MapGraph:
    """A pose graph with its scans, out of a file or on the way into one."""

    def __init__(self, keys: KeyScans, graph: PoseGraph, trajectory: Array) -> None:
        """Take what a mapper made; `trajectory` has time, x, y, heading, shape (n, 4)."""
        self.keys, self.graph, self.trajectory = keys, graph, trajectory

    def packed(self) -> bytes:
        """As the file holds it."""
        links = tuple(
            SavedLink(
                n,
                each.first,
                each.second,
                each.loop,
                *(part.astype("<f8").tobytes() for part in (each.motion, each.information, each.untold)),
            )
            for n, each in self.graph.links.items()
        )
        saved = SavedGraph(
            artemis_map=VERSION,
            poses=self.keys.poses.astype("<f8").tobytes(),
            places=self.keys.places.astype("<f8").tobytes(),
            scans=tuple(points.astype("<f4").tobytes() for points in self.keys.points),
            links=links,
            trajectory=self.trajectory.astype("<f8").tobytes(),
        )
        return msgspec.msgpack.encode(saved)

    def nearest_keys(self) -> SeenFrom:
        """The trajectory, each pose seen from the nearest key scan."""
        poses = self.trajectory[:, 1:]
        nearest = np.empty(len(poses), np.int64)
        for number, pose in enumerate(poses):
            off = between(self.keys.poses, pose)
            nearest[number] = (off**2).sum(1).argmin()
        return SeenFrom(nearest, between(self.keys.poses[nearest], poses))

    def turned(self, angle: float) -> None:
        """Turn everything around the origin by `angle` [rad]."""
        self.keys.poses = compose([0.0, 0.0, angle], self.keys.poses)
        self.trajectory[:, 1:] = compose([0.0, 0.0, angle], self.trajectory[:, 1:])


def files_of(path: Path) -> list[Path]:
    """Those of a map: its YAML file `path`, its image, and its graph."""
    return [path, path.with_suffix(".pgm"), path.with_suffix(SUFFIX)]


def saved_files(path: Path, content: OccupancyMap, graph: MapGraph | None) -> dict[Path, bytes]:
    """The graph, the image and the YAML file `path` of a map, to be written."""
    return ({path.with_suffix(SUFFIX): graph.packed()} if graph is not None else {}) | map_files(path, content)


def read_graph(path: Path) -> MapGraph:
    """A graph out of its file.

    Raises:
        ConfigError: it cannot be read.
    """
    try:
        saved = msgspec.msgpack.decode(read(path, _MOST_BYTES), type=SavedGraph)
        if saved.artemis_map != VERSION:
            raise ConfigError(f"{path}: version {saved.artemis_map}; this artemis reads {VERSION}")
        keys, graph = KeyScans(), PoseGraph()
        poses = np.frombuffer(saved.poses, "<f8").reshape(-1, 3)
        places = np.frombuffer(saved.places, "<f8") if saved.places else np.zeros(2 * len(poses))
        for scan, pose, place in zip(saved.scans, poses, places.reshape(-1, 2), strict=True):
            keys.append(np.frombuffer(scan, "<f4").reshape(-1, 4).astype(float), pose, place)
        for link in saved.links:
            if not 0 <= link.first < len(keys) or not 0 <= link.second < len(keys):
                raise ValueError(f"link {link.number} leads to no scan")
            parts = (link.motion, 3), (link.information, (3, 3)), (link.untold, 2)
            motion, information, untold = (np.frombuffer(part, "<f8").reshape(shape) for part, shape in parts)
            graph.restore(link.number, Link(link.first, link.second, motion, information, link.loop, untold))
        return MapGraph(keys, graph, np.frombuffer(saved.trajectory, "<f8").reshape(-1, 4).copy())
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(f"{path}: is no pose graph of artemis: {error}") from None
