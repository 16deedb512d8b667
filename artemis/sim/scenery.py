"""What a simulated laser scanner sees: walls, poles, boxes, people, and a map."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import cos, pi, radians, sin
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, field_validator, model_validator

from artemis.config import Config, Inconsistent, Quantity
from artemis.sim.grid import MapGrid


def _numbers(*names: str) -> BeforeValidator:
    """Refuses a list of more or less than these numbers by their names."""

    def check(value: object) -> object:
        if isinstance(value, list | tuple) and len(value) != len(names):
            raise ValueError(f"expected [{', '.join(names)}], found a list of {len(value)}")
        return value

    return BeforeValidator(check)


Floats = NDArray[np.float64]
Place = Annotated[float, Quantity(0.0, 10_000.0, "m", signed=True)]
Size = Annotated[float, Quantity(0.001, 100.0, "m")]
Point = Annotated[tuple[Place, Place], Field(strict=False), _numbers("x", "y")]
Moment = Annotated[float, Field(ge=0)]
Waypoint = Annotated[tuple[Moment, Place, Place], Field(strict=False), _numbers("run time", "x", "y")]
Surface = Literal["plain", "dark", "shiny"]
SURFACES: tuple[Surface, ...] = ("plain", "dark", "shiny")


class Obstacle(Config):
    """Something that stands in the world."""

    surface: Surface = "plain"
    """Dark ones are seen less far; shiny ones only where the beam meets them squarely."""
    from_s: Moment = 0.0
    """It is there from this run time on."""
    until_s: Moment | None = None
    """It is gone from then on."""

    @model_validator(mode="after")
    def _there(self) -> Self:
        if self.until_s is not None and self.until_s <= self.from_s:
            text = f"expected more than from_s ({self.from_s:g} s), found {self.until_s:g} s: it would never be there"
            raise Inconsistent([(("until_s",), text)])
        return self


class Wall(Obstacle):
    """Straight pieces from point to point."""

    points: Annotated[tuple[Point, ...], Field(strict=False, min_length=2)]
    """[x, y] of each corner [m]."""


class Pole(Obstacle):
    """Something round."""

    x_m: Place
    y_m: Place
    diameter_m: Size


class Crate(Obstacle):
    """Something with four sides."""

    x_m: Place
    """Of its middle."""
    y_m: Place
    length_m: Size
    width_m: Size
    heading_deg: Annotated[float, Quantity(0.0, 360.0, "degrees", signed=True)] = 0.0
    """Of its length."""


class Person(Obstacle):
    """Somebody who walks from place to place, stands at the end, and is as round as a pole."""

    path: Annotated[tuple[Waypoint, ...], Field(strict=False, min_length=1)]
    """[t, x, y]: where somebody is at that run time [s, m, m]."""
    diameter_m: Size = 0.3
    repeat: bool = False
    """After the last place begin again at the first."""

    @field_validator("path")
    @classmethod
    def _forward(cls, path: tuple[tuple[float, float, float], ...]) -> tuple[tuple[float, float, float], ...]:
        times = [time for time, _, _ in path]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("expected times that grow from place to place")
        return path


class Scenery(Config):
    """The surroundings of a simulated robot, in the frame of its true pose (`true_robot`)."""

    walls: Annotated[tuple[Wall, ...], Field(strict=False)] = ()
    poles: Annotated[tuple[Pole, ...], Field(strict=False)] = ()
    boxes: Annotated[tuple[Crate, ...], Field(strict=False)] = ()
    persons: Annotated[tuple[Person, ...], Field(strict=False)] = ()
    map_file: str | None = None
    """A map (YAML beside an image, as of map_server): what is occupied there is a plain wall."""


HALL = Scenery(walls=(Wall(points=((-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0), (-8.0, -8.0))),))
"""Where a mission says nothing: a hall of 16 x 16 m around the origin."""


class Sight:
    """What beams meet."""

    __slots__ = ("distance", "square", "surface")

    def __init__(self, beams: int) -> None:
        self.distance: Floats = np.full(beams, np.inf)
        """[m]; infinite: nothing."""
        self.surface: NDArray[np.int8] = np.zeros(beams, np.int8)
        """Index in `SURFACES`."""
        self.square: Floats = np.ones(beams)
        """Cosine of the angle between the beam and what stands upright on the surface."""

    def nearer(self, distance: Floats, surface: NDArray[np.int8], square: Floats) -> None:
        """Take what is nearer."""
        closer = distance < self.distance
        self.distance = np.where(closer, distance, self.distance)
        self.surface = np.where(closer, surface, self.surface)
        self.square = np.where(closer, square, self.square)


class Surroundings2D:
    """Scenery ready to be looked at."""

    def __init__(self, scenery: Scenery, grid: MapGrid | None = None) -> None:
        """`grid` is what the scenery's map file holds."""
        self._grid, self._persons = grid, scenery.persons
        lines, rounds = list(_lines(scenery)), list(_rounds(scenery))
        self._lines, self._rounds = _table(lines, 7), _table(rounds, 6)
        self._changes = any(row[-2] > 0.0 or row[-1] < np.inf for row in (*lines, *rounds))

    def seen(self, x: Floats, y: Floats, heading: Floats, time: float) -> Sight:
        """What beams from (x, y) [m] into `heading` [rad] meet, at run time `time` [s] for what moves by itself."""
        sight, dx, dy = Sight(len(x)), np.cos(heading), np.sin(heading)
        if len(lines := self._present(self._lines, time)):
            _meet_lines(sight, lines, x, y, dx, dy)
        rounds = self._present(self._rounds, time)
        if self._persons:
            rounds = np.vstack([rounds, *(_person(person, time) for person in self._persons)])
            rounds = self._present(rounds, time, changes=True)
        if len(rounds):
            _meet_rounds(sight, rounds, x, y, dx, dy)
        if self._grid is not None:
            distance = self._grid.distances(x, y, dx, dy)
            sight.nearer(distance, np.zeros(len(x), np.int8), np.ones(len(x)))
        return sight

    def _present(self, rows: Floats, time: float, *, changes: bool = False) -> Floats:
        if not (changes or self._changes):
            return rows
        return rows[(rows[:, -2] <= time) & (time < rows[:, -1])]


def _table(rows: list[tuple[float, ...]], columns: int) -> Floats:
    return np.array(rows, np.float64).reshape(len(rows), columns)


def _span(thing: Obstacle) -> tuple[float, float, float]:
    return float(SURFACES.index(thing.surface)), thing.from_s, np.inf if thing.until_s is None else thing.until_s


def _lines(scenery: Scenery) -> Iterator[tuple[float, ...]]:
    """Rows x, y, dx, dy, surface, from, until."""
    for wall in scenery.walls:
        for (ax, ay), (bx, by) in pairwise(wall.points):
            yield ax, ay, bx - ax, by - ay, *_span(wall)
    for box in scenery.boxes:
        along, across = radians(box.heading_deg), radians(box.heading_deg) + pi / 2
        ux, uy = cos(along) * box.length_m, sin(along) * box.length_m
        vx, vy = cos(across) * box.width_m, sin(across) * box.width_m
        x, y = box.x_m - (ux + vx) / 2, box.y_m - (uy + vy) / 2
        yield x, y, ux, uy, *_span(box)
        yield x, y, vx, vy, *_span(box)
        yield x + vx, y + vy, ux, uy, *_span(box)
        yield x + ux, y + uy, vx, vy, *_span(box)


def _rounds(scenery: Scenery) -> Iterator[tuple[float, ...]]:
    """Rows x, y, radius, surface, from, until."""
    for pole in scenery.poles:
        yield pole.x_m, pole.y_m, pole.diameter_m / 2, *_span(pole)


def _person(person: Person, time: float) -> Floats:
    """A row as of `_rounds`."""
    times, xs, ys = (np.array(part) for part in zip(*person.path, strict=True))
    if person.repeat and time > times[-1] > times[0]:
        time_there = times[0] + (time - times[0]) % (times[-1] - times[0])
    else:
        time_there = time
    x, y = np.interp(time_there, times, xs), np.interp(time_there, times, ys)
    return np.array([[x, y, person.diameter_m / 2, *_span(person)]])


def _meet_lines(sight: Sight, lines: Floats, x: Floats, y: Floats, dx: Floats, dy: Floats) -> None:
    px, py, ex, ey = (lines[:, column, None] for column in range(4))
    with np.errstate(divide="ignore", invalid="ignore"):
        across = dx * ey - dy * ex
        wx, wy = px - x, py - y
        along = (wx * ey - wy * ex) / across
        share = (wx * dy - wy * dx) / across
        along[~((along >= 0.0) & (share >= 0.0) & (share <= 1.0))] = np.inf
    first = np.argmin(along, axis=0)
    beams = np.arange(len(x))
    length = np.hypot(ex[:, 0], ey[:, 0])[first]
    with np.errstate(divide="ignore", invalid="ignore"):
        square = np.abs(across[first, beams]) / length
    sight.nearer(along[first, beams], lines[first, 4].astype(np.int8), square)


def _meet_rounds(sight: Sight, rounds: Floats, x: Floats, y: Floats, dx: Floats, dy: Floats) -> None:
    wx, wy = rounds[:, 0, None] - x, rounds[:, 1, None] - y
    radius = rounds[:, 2, None]
    along, beside = wx * dx + wy * dy, wx * dy - wy * dx
    half = radius * radius - beside * beside
    with np.errstate(invalid="ignore"):
        distance = along - np.sqrt(half)
        distance[~((half >= 0.0) & (distance >= 0.0))] = np.inf
    first = np.argmin(distance, axis=0)
    beams = np.arange(len(x))
    with np.errstate(invalid="ignore"):
        square = np.sqrt(np.maximum(half[first, beams], 0.0)) / rounds[first, 2]
    sight.nearer(distance[first, beams], rounds[first, 3].astype(np.int8), square)
