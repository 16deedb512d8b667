"""The routes of a run, exactly, for its replay.

They are made of points by numpy, and their corners are rounded by scipy: the last bits depend on the processor and on
the versions of both.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.path import Path
from artemis.motion.route import Part, Route

ROUTES = "routes.msgpack"
"""The name of their attachment."""


class SavedPart(msgspec.Struct, frozen=True, kw_only=True):
    """A `Part`; its columns are packed as 64-bit floats, least significant byte first."""

    x: bytes
    y: bytes
    heading: bytes
    curvature: bytes
    speed: bytes | None
    spacing: float
    closed: bool
    laps: int
    backward: bool


def packed_routes(routes: Mapping[int, Route]) -> bytes:
    """Routes by the number of their step."""
    return msgspec.msgpack.encode({number: [_saved(part) for part in route.parts] for number, route in routes.items()})


def unpacked_routes(data: bytes) -> dict[int, Route]:
    """What was `packed_routes`, bit for bit; but for the points that the routes were made of.

    Raises:
        ValueError: it is something else.
    """
    saved = msgspec.msgpack.decode(data, type=dict[int, list[SavedPart]])
    return {number: Route(tuple([_part(part) for part in parts])) for number, parts in saved.items()}


def _saved(part: Part) -> SavedPart:
    path = part.path
    return SavedPart(
        x=_packed(path.x),
        y=_packed(path.y),
        heading=_packed(path.heading),
        curvature=_packed(path.curvature),
        speed=None if path.speed is None else _packed(path.speed),
        spacing=path.spacing,
        closed=path.closed,
        laps=path.laps,
        backward=part.backward,
    )


def _part(saved: SavedPart) -> Part:
    path = Path(
        _unpacked(saved.x),
        _unpacked(saved.y),
        _unpacked(saved.heading),
        _unpacked(saved.curvature),
        spacing=saved.spacing,
        closed=saved.closed,
        speed=None if saved.speed is None else _unpacked(saved.speed),
    )
    path.laps = saved.laps
    return Part(path=path, backward=saved.backward)


def _packed(column: Array) -> bytes:
    return np.asarray(column, "<f8").tobytes()


def _unpacked(column: bytes) -> Array:
    return np.frombuffer(column, "<f8").astype(float)
