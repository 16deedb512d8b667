"""Routes with reversals: paths one after the other, each driven forwards or backwards; the robot stands in between."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array
from artemis.motion.columns import DEGREES, is_in_degrees
from artemis.motion.path import Path, check_drivable, path_from_points
from artemis.motion.path_points import MIN_STEP, Points, cusps, read_points
from artemis.motion.totals import total
from artemis.values import Pose
from artemis.vehicle import RobotFile

SHORTEST = 0.05
"""Least distance between two reversals [m]: less is noise, and a follower ends a path some centimetres early."""
ON_THE_SPOT = math.radians(45)
"""A robot that would have to turn by more than this between two parts [rad] cannot: neither a curve nor a reversal."""


class Part(Struct, frozen=True, kw_only=True):
    """A path that is driven in one direction; its tangent is the direction of travel."""

    path: Path
    backward: bool = False
    """With the rear ahead: the robot's heading is against the tangent."""

    def heading_at(self, arc_length: float) -> float:
        """The robot's heading at an arc length [rad]."""
        return wrap(self.path.at(arc_length).heading + (math.pi if self.backward else 0.0))


@dataclass(frozen=True, slots=True)
class Route:
    """The parts between changes of direction. Arc length counts through all of them.

    Only a route of one part may be closed, and have laps.
    """

    parts: tuple[Part, ...]

    @property
    def length(self) -> float:
        """Distance from the start to the end of the last lap [m]."""
        return total(part.path.length for part in self.parts)

    def duration(self, speed: float) -> float:
        """How long it takes [s] at a speed [m/s], or its own where that is lower."""
        return total(part.path.duration(speed) for part in self.parts)

    @property
    def closed(self) -> bool:
        """The end joins the start."""
        return len(self.parts) == 1 and self.parts[0].path.closed

    @property
    def begins(self) -> tuple[float, ...]:
        """Arc length at which each part begins [m]."""
        return tuple(accumulate((part.path.length for part in self.parts[:-1]), initial=0.0))

    def with_laps(self, laps: int) -> Route:
        """The same route, driven `laps` times.

        Raises:
            ConfigError: several laps of a route that is not closed, or none.
        """
        if laps > 1 and len(self.parts) > 1:
            raise ConfigError(f"laps: {laps} is not possible: the path has reversals")
        first = self.parts[0]
        return Route((replace(first, path=first.path.with_laps(laps)), *self.parts[1:]))

    def directed(self, *, from_end: bool, backward: bool | None) -> Route:
        """The route as a mission wants it driven.

        Args:
            from_end: from its last point to its first, with the robot's headings as they are: what was driven forwards
                is driven backwards.
            backward: how it begins then, whatever its headings say; each reversal changes that. None: as it is.
        """
        parts = self.parts
        if from_end:
            parts = tuple(Part(path=_turned(part.path), backward=not part.backward) for part in reversed(parts))
        if backward is not None and parts[0].backward is not backward:
            parts = tuple(replace(part, backward=not part.backward) for part in parts)
        return Route(parts)

    def nearest(self, x: float, y: float) -> float:
        """Arc length [m] of the point, or the first, that is nearest to (x, y); of a closed route in its first lap."""
        places = [min(part.path.nearest(x, y), part.path.length) for part in self.parts]
        points = [part.path.at(place) for part, place in zip(self.parts, places, strict=True)]
        away = [math.hypot(point.x - x, point.y - y) for point in points]
        first = next(number for number, distance in enumerate(away) if distance <= min(away) + MIN_STEP)
        return self.begins[first] + places[first]

    def seen_from(self, pose: Pose) -> tuple[float, float]:
        """How far a robot that is to begin it is to the left of it [m], and turned to the left against it [rad]."""
        first = self.parts[0]
        start = first.path.project(pose.x, pose.y, near=0.0)
        return start.cross_track, wrap(pose.heading - start.heading - (math.pi if first.backward else 0.0))

    def begun_at(self, arc_length: float, done: float) -> Route:
        """What is left when the route is begun at an arc length [m], with `done` [m] of it behind.

        Of a closed route all its laps from there, but for what is done; of an open one the rest.
        """
        if self.closed:
            only = self.parts[0]
            return Route((replace(only, path=only.path.begun_at(arc_length, done)),))
        index = max(bisect(self.begins, arc_length) - 1, 0)
        first = self.parts[index]
        rest = replace(first, path=first.path.rest(arc_length - self.begins[index]))
        return Route((rest, *self.parts[index + 1 :]))

    def rest(self, done: float) -> Route:
        """What is left after so much of it [m], at least the last piece."""
        if self.closed:
            only = self.parts[0]
            return Route((replace(only, path=only.path.rest(done)),))
        return self.begun_at(done, done)

    def poses(self, spacing: float) -> list[Pose]:
        """The robot's poses along it, about every `spacing` [m], at most 2000."""
        poses = []
        for part in self.parts:
            share = 2000 * part.path.length / self.length
            count = max(2, min(int(share), round(part.path.length / spacing)))
            for place in np.linspace(0.0, part.path.length, count).tolist():
                point = part.path.at(place)
                poses.append(Pose(x=point.x, y=point.y, heading=part.heading_at(place)))
        return poses

    def problems(self, robot: RobotFile, speed: float) -> list[str]:
        """Why a robot cannot follow it at a speed of its virtual front wheel [m/s]; empty if it can (PTH-03)."""
        if len(self.parts) == 1:
            return check_drivable(self.parts[0].path, robot, speed)
        numbered = enumerate(self.parts, start=1)
        return [f"part {n}: {problem}" for n, part in numbered for problem in check_drivable(part.path, robot, speed)]


def route_from_csv(text: str, source: str) -> Route:
    """Read a path file: as `path_from_csv`, but it may reverse, and be driven backwards.

    A part is driven backwards where the column heading points against it. Without headings the path begins forwards.

    Raises:
        ConfigError: every problem found, with file:line:column (faults PTH-01, PTH-02, PTH-04).
    """
    points = read_points(text, source)
    points.table.raise_problems()
    found = stretches(points.x, points.y, points.heading)
    _check_headings(points, found)
    points.table.raise_problems()
    parts = [part_of(points, stretch, whole=len(found) == 1) for stretch in found]
    for number, problem in turns_on_the_spot(parts):
        points.report(found[number][0], problem)
    points.table.raise_problems()
    return Route(tuple(parts))


def noise_words(route: Route) -> list[str]:
    """What smoothing did about noise, part by part."""
    return [words for part in route.parts if part.path.drawn is not None and (words := part.path.drawn.words())]


def turns_on_the_spot(parts: Sequence[Part]) -> Iterator[tuple[int, str]]:
    """Parts that do not begin with the heading with which the one before ends: which, and words for it."""
    for number, (before, after) in enumerate(pairwise(parts), start=1):
        turn = abs(wrap(after.heading_at(0.0) - before.heading_at(before.path.length)))
        if turn > ON_THE_SPOT:
            degrees = math.degrees(turn)
            yield number, f"the robot would turn by {degrees:.0f} deg on the spot here; expected a curve, or a reversal"


Stretch = tuple[int, int, bool]
"""Its first and its last point, and whether it is driven backwards."""


def stretches(x: Array, y: Array, heading: Array | None) -> list[Stretch]:
    """Distinct points, split where the direction changes; neighbours share a point.

    Without headings [rad] the route begins forwards, and each cusp changes the direction.
    """
    turned = np.zeros(len(x) - 1, dtype=int)
    turned[[index for index, _ in cusps(x, y)]] = 1
    if heading is None:
        backward = np.cumsum(turned) % 2 == 1
    else:
        tangent = np.arctan2(np.diff(y), np.diff(x))
        backward = np.cos(heading[:-1] - tangent) + np.cos(heading[1:] - tangent) < 0
    changes = np.flatnonzero((backward[1:] != backward[:-1]) | (turned[1:] != 0)) + 1
    ends = [0, *changes.tolist(), len(x) - 1]
    return [(first, last, bool(backward[first])) for first, last in pairwise(ends)]


def part_of(points: Points, stretch: Stretch, *, whole: bool) -> Part:
    """The part of a stretch; one that is not the `whole` path is open."""
    first, last, backward = stretch
    piece = slice(first, last + 1)
    speed = None if points.speed is None else points.speed[piece]
    path = path_from_points(points.x[piece], points.y[piece], speed=speed, between_halts=not whole)
    return Part(path=path, backward=backward)


def _check_headings(points: Points, found: list[Stretch]) -> None:
    """Report headings across the path, and reversals too near to each other."""
    if points.heading is not None and is_in_degrees(points.x, points.y, points.heading):
        index = int(np.abs(points.heading).argmax())
        problem = f"heading {points.heading[index]:g}: {DEGREES}"
        points.report(index, f"{problem}, and read the file by `artemis path import`", "heading")
    elif points.heading is not None:
        for index in across(points.x, points.y, points.heading, found):
            problem = f"heading {points.heading[index]:.2f} rad points across the path; expected along or against it"
            points.report(index, problem, "heading")
    for number, (first, last, _) in enumerate(found):
        x, y = points.x[first : last + 1], points.y[first : last + 1]
        length = float(np.hypot(np.diff(x), np.diff(y)).sum())
        if 0 < number < len(found) - 1 and length < SHORTEST:
            problem = f"reverses twice within {length:.3f} m; expected at least {SHORTEST:g} m in one direction"
            points.report(last, problem)


def across(x: Array, y: Array, heading: Array, found: Sequence[Stretch]) -> list[int]:
    """Points at which the heading [rad] is not along the path, or where it is driven backwards not against it.

    The direction of the path at a point is the mean of both sides.
    """
    wrong = []
    for first, last, backward in found:
        dx, dy = np.diff(x[first : last + 1]), np.diff(y[first : last + 1])
        length = np.hypot(dx, dy) * (-1.0 if backward else 1.0)
        ux, uy = dx / length, dy / length
        along_x = np.concatenate([ux[:1], ux[:-1] + ux[1:], ux[-1:]])
        along_y = np.concatenate([uy[:1], uy[:-1] + uy[1:], uy[-1:]])
        own = heading[first : last + 1]
        wrong += [first + int(i) for i in np.flatnonzero(along_x * np.cos(own) + along_y * np.sin(own) < 0)]
    return list(dict.fromkeys(wrong))


def _turned(path: Path) -> Path:
    """The same curve from its end to its start."""
    turned = Path(
        path.x[::-1],
        path.y[::-1],
        path.heading[::-1] + math.pi,
        -path.curvature[::-1],
        spacing=path.spacing,
        closed=path.closed,
        speed=None if path.speed is None else path.speed[::-1],
        drawn=path.drawn,
    )
    return turned.with_laps(path.laps)
