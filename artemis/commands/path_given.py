"""Points of a path as a file of others gives them."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.geodesy import local_metres
from artemis.motion.table import MAX_CHARACTERS
from artemis.yaml_file import read


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


def text_in(file: Path) -> str:
    """The text of a table's file, which may be packed by gzip.

    Raises:
        ConfigError: it cannot be read or unpacked, is too large, or is not UTF-8.
    """
    raw = read(file, MAX_CHARACTERS)
    if raw.startswith(b"\x1f\x8b"):
        try:
            raw = gzip.GzipFile(fileobj=io.BytesIO(raw)).read(MAX_CHARACTERS + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise ConfigError(f"{file}: cannot be unpacked: {error}") from None
    return text_of(raw, str(file))


def heading_of(qx: Array, qy: Array, qz: Array, qw: Array) -> Array:
    """Rotation about z [rad] of quaternions of any length."""
    return np.asarray(np.arctan2(2 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz))


Place = tuple[float, float, str]
"""Latitude, longitude [deg], and file:line:column."""


def from_places(segments: Sequence[Sequence[Place]]) -> Given:
    """Points on Earth, segment after segment: metres to the east (x) and north (y) of the first one."""
    points = [point for segment in segments for point in segment]
    x, y = local_metres(np.radians([point[0] for point in points]), np.radians([point[1] for point in points]))
    notes = [f"x is east and y north of {points[0][0]:.7f}, {points[0][1]:.7f} (WGS 84)"]
    lengths = [len(segment) for segment in segments if segment]
    places = [point[2] for point in points]
    return Given(x=x, y=y, places=places, notes=notes + joined(lengths, x, y, places))


def joined(lengths: Sequence[int], x: Array, y: Array, places: Sequence[str]) -> list[str]:
    """Words for segments of so many points that were joined, and how wide the widest gap between them is."""
    if len(lengths) < 2:
        return []
    ends = np.cumsum(lengths)[:-1]
    gaps = np.hypot(x[ends] - x[ends - 1], y[ends] - y[ends - 1])
    widest = int(np.argmax(gaps))
    return [f"{len(lengths)} segments were joined; the widest gap is {gaps[widest]:.2f} m ({places[ends[widest]]})"]
