"""How far the motions between poses of a map are from verified ones.

The error of R. Kuemmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27(4), 2009: for each
verified motion between two instants the difference to the estimated one, its size in metres and in degrees. It needs no
common frame, and no alignment.
"""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.mapping.se2 import Array, between
from artemis.motion.arrays import wrapped

FIELDS = 8
"""Of a line: both times [s], x, y, z [m], roll, pitch, yaw [rad]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Relations:
    """Verified motions."""

    first: Array
    """Times [s], shape (n,)."""
    second: Array
    motion: Array
    """From the pose at the first to that at the second time, shape (n, 3)."""

    def until(self, end: float) -> Relations:
        """Those that end at a time [s], at the latest: behind it a robot that turns is soon far from its last pose."""
        used = (self.first <= end) & (self.second <= end)
        return Relations(first=self.first[used], second=self.second[used], motion=self.motion[used])


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSize:
    """Sizes of errors in a few numbers."""

    mean: float
    std: float
    square_mean: float
    square_std: float
    median: float
    max: float

    @classmethod
    def of(cls, sizes: Array) -> ErrorSize:
        """Of sizes, shape (n,), n > 0."""
        squares = sizes**2
        return cls(
            mean=float(sizes.mean()),
            std=float(sizes.std()),
            square_mean=float(squares.mean()),
            square_std=float(squares.std()),
            median=float(np.median(sizes)),
            max=float(sizes.max()),
        )


def read_relations(path: Path) -> Relations:
    """Verified motions out of a file with one a line; `#` begins a comment.

    Raises:
        ConfigError: it cannot be read, or a line is not as it should be.
    """
    rows = []
    try:
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as lines:
            for number, line in enumerate(lines, start=1):
                fields = line.split()
                if not fields or fields[0].startswith("#"):
                    continue
                if len(fields) != FIELDS:
                    raise ConfigError(f"{path}:{number}: {len(fields)} fields; a relation has {FIELDS}")
                try:
                    rows.append([float(each) for each in fields])
                except ValueError as error:
                    raise ConfigError(f"{path}:{number}: {error}") from None
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    if not rows:
        raise ConfigError(f"{path}: no relations")
    table = np.array(rows)
    return Relations(first=table[:, 0], second=table[:, 1], motion=table[:, [2, 3, 7]])


def errors(relations: Relations, times: Array, poses: Array, longest_gap: float = 5.0) -> tuple[Array, Array]:
    """Sizes of the errors of all relations with an estimate near both ends: [m], [deg], shape (k,) each.

    Args:
        relations: the verified motions.
        times: of the estimate [s], in any order, shape (n,).
        poses: of the estimate, shape (n, 3); between two of them the pose is interpolated linearly.
        longest_gap: from a wanted time to the nearest estimate, at most [s].
    """
    order = np.argsort(times, kind="stable")
    times, poses = times[order], poses[order]
    last = np.append(np.diff(times) > 0, True)  # of equal times the last counts
    times, poses = times[last], poses[last]
    near = [_distance(times, each) <= longest_gap for each in (relations.first, relations.second)]
    used = near[0] & near[1]
    ends = [_at(times, poses, each[used]) for each in (relations.first, relations.second)]
    off = between(relations.motion[used], between(ends[0], ends[1]))
    return np.asarray(np.hypot(off[:, 0], off[:, 1])), np.degrees(np.abs(off[:, 2]))


def _distance(times: Array, wanted: Array) -> Array:
    after = np.searchsorted(times, wanted)
    before, after = (after - 1).clip(0, len(times) - 1), after.clip(0, len(times) - 1)
    return np.asarray(np.minimum(np.abs(times[before] - wanted), np.abs(times[after] - wanted)))


def _at(times: Array, poses: Array, wanted: Array) -> Array:
    if len(times) == 1:
        return np.repeat(poses, len(wanted), axis=0)
    first = (np.searchsorted(times, wanted, "right") - 1).clip(0, len(times) - 2)
    share = ((wanted - times[first]) / (times[first + 1] - times[first])).clip(0, 1)[:, None]
    way = poses[first + 1] - poses[first]
    way[:, 2] = wrapped(way[:, 2])
    found = poses[first] + share * way
    found[:, 2] = wrapped(found[:, 2])
    return np.asarray(found)
