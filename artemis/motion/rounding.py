"""Corners that are too sharp for a robot, made into the nearest curve that it can drive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.cubic import Cubic
from artemis.motion.path import Path, place_on
from artemis.vehicle import RobotFile

CURVATURE_SHARE = 0.95
"""Of what the steering allows a plan uses this much; the rest is the controller's, to correct with."""
SLACK = 1e-6
"""So much more curvature is none [1/m]: a rounded path that was packed and unpacked is not rounded again."""
REACH = 2.5
"""A corner is made anew from so many smallest radii before it to as many after it."""
KNOT = 0.24
"""Distance between the points whose curvature is sought, in smallest radii."""
FINE = 4
"""Steps between two knots in which the curve is integrated."""
MEET = 10.0
"""Weight of meeting the path again."""
MEETS = 0.005
"""The new piece meets the path again within this [smallest radii, rad]."""
EASE = 0.15
"""What a change of curvature costs against the distance from the path, in cubes of the smallest radius: keeps the
steering slow where that is cheap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """A corner that was rounded."""

    arc_length: float
    """Of the corner on the path as given [m]."""
    distance: float
    """Farthest that the new path is from the given one [m]."""
    x: float
    y: float
    """The corner [m]."""


def rounded(path: Path, robot: RobotFile) -> tuple[Path, list[Cut]]:
    """The path with every corner that the robot's steering cannot do replaced, and what was cut.

    Where the curvature is beyond what the steering allows, a piece around it becomes that curve of bounded curvature
    that is nearest to it: the sum of its squared distances from the path, and a little of its squared change of
    curvature, is the least (nonlinear least squares in the curvature at knots; both ends meet the path with its
    heading and curvature).

    Raises:
        ConfigError: no such curve was found: the place, and what to change.
    """
    bound = CURVATURE_SHARE * math.tan(math.radians(robot.limits.steering_deg)) / robot.geometry.wheelbase_m
    sharp = np.flatnonzero(np.abs(path.curvature) > bound + SLACK)
    if not len(sharp):
        return path, []
    reach = math.ceil(REACH / bound / path.spacing)
    last = len(path.x) - 1
    begin, start, done = 0, (path.x[0], path.y[0]), float(path.arc_length[-1]) * path.laps - path.length
    if path.closed:  # cut open where it is farthest from a corner
        gaps = np.diff(np.append(sharp, sharp[0] + last))
        begin = int(sharp[np.argmax(gaps)] + gaps.max() // 2) % last
        path = path.begun_at((begin + 0.5) * path.spacing, 0.0)
        sharp = np.sort((sharp - begin) % last)
    groups = np.split(sharp, np.flatnonzero(np.diff(sharp) > 2 * reach) + 1)
    pieces: list[Array] = []
    cuts, kept = [], 0
    for group in groups:
        first, final = max(int(group[0]) - reach, 0), min(int(group[-1]) + reach, last)
        worst = int(group[np.argmax(np.abs(path.curvature[group]))])
        piece, distance = _Piece(path, first, final, bound).drivable(worst)
        pieces += [_samples(path, kept, first), piece]
        cuts.append(
            Cut(
                arc_length=(worst + begin) % last * path.spacing,
                distance=distance,
                x=float(path.x[worst]),
                y=float(path.y[worst]),
            )
        )
        kept = final
    pieces.append(_samples(path, kept, last + 1))
    made = _joined(path, pieces)
    if path.closed:
        nearest = int(np.argmin(np.hypot(made.x[:-1] - start[0], made.y[:-1] - start[1])))
        made = made.begun_at((nearest + 0.5) * made.spacing, done)
    return made, cuts


def _joined(path: Path, pieces: list[Array]) -> Path:
    """One path of pieces end to end, sampled at constant arc length again."""
    x, y, heading, curvature, source = np.concatenate(pieces, axis=1)
    chord = np.hypot(np.diff(x), np.diff(y))
    arc = np.append(0.0, np.cumsum(chord * (1 + np.diff(heading) ** 2 / 24)))
    count = math.ceil(arc[-1] / path.spacing)
    at = np.linspace(0.0, arc[-1], count + 1)
    made = Path(
        Cubic(arc, x, np.cos(heading))(at),
        Cubic(arc, y, np.sin(heading))(at),
        np.interp(at, arc, heading),
        np.interp(at, arc, curvature),
        spacing=float(at[1]),
        closed=path.closed,
        speed=None if path.speed is None else np.interp(np.interp(at, arc, source), np.arange(len(path.x)), path.speed),
        drawn=path.drawn,
    )
    made.laps = path.laps
    return made


def _samples(path: Path, first: int, end: int) -> Array:
    """x, y, heading, curvature and index in the path of samples, shape (5, n)."""
    index = np.arange(first, end)
    return np.array([path.x[index], path.y[index], path.heading[index], path.curvature[index], index])


class _Piece:
    """A piece of a path and the curve that takes its place. The unit of length in here is the smallest radius.

    The curve is told by its curvature at knots, linear in between (clothoids), and its length: the unknowns. The first
    and the last knot have the path's own curvature.
    """

    def __init__(self, path: Path, first: int, final: int, bound: float) -> None:
        """The piece from sample `first` to `final`; `bound`: largest curvature [1/m]."""
        piece = slice(first, final + 1)
        self._path, self._source, self._bound = path, (first, final), bound
        self._x, self._y, self._heading = path.x[piece] * bound, path.y[piece] * bound, path.heading[piece]
        self._curvature = path.curvature[piece] / bound
        self._normal = -np.sin(self._heading), np.cos(self._heading)
        self._length = path.spacing * (final - first) * bound
        self._ends = np.clip(self._curvature[[0, -1]], -1.0, 1.0)
        self._knots = np.linspace(0.0, 1.0, max(math.ceil(self._length / KNOT), 8) + 2)
        inner = len(self._knots) - 2
        shares = np.linspace(0.0, 1.0, FINE * (inner + 1) + 1)
        self._step = float(shares[1])
        self._hats = np.array([np.interp(shares, self._knots, row) for row in np.eye(inner + 2)]).T
        mean = (self._hats[:-1] + self._hats[1:]) / 2
        self._turning = np.vstack([np.zeros(inner + 2), np.cumsum(mean, axis=0)]) * self._step
        self._halfway = (self._turning[:-1] + self._turning[1:]) / 2
        self._weight, self._stiffness = math.sqrt(self._length * self._step), math.sqrt((inner + 1) / self._length)
        changes = np.diff(np.eye(inner + 2), axis=0)[:, 1:-1]
        self._changes = np.column_stack([changes, np.zeros(inner + 1)])

    def drivable(self, worst: int) -> tuple[Array, float]:
        """The new piece, rows as `_samples` without its last one, and its largest distance from the path [m].

        Raises:
            ConfigError: none was found; `worst`: the sharpest sample, to be named.
        """
        from scipy.optimize import least_squares

        unknown, inner = self._guess(), len(self._knots) - 2
        low = np.append(np.full(inner, -1.0), 0.3 * self._length)
        high = np.append(np.full(inner, 1.0), 1.5 * self._length)
        for ease in (5 * EASE, EASE):  # a stiffer curve first: from there no corner is in the way
            unknown = np.clip(unknown, low + 1e-3, high - 1e-3)
            unknown = least_squares(
                self._cost, unknown, jac=self._slope, args=(ease,), bounds=(low, high), ftol=1e-4, max_nfev=60
            ).x
        x, y, heading = self._curve(unknown)
        miss = np.array([x[-1] - self._x[-1], y[-1] - self._y[-1], heading[-1] - self._heading[-1]])
        if np.abs(miss).max() > MEETS:
            raise ConfigError(
                f"too sharp at {place_on(self._path, worst)}, and no curve of radius {1 / self._bound:.2f} m leads "
                "around it; move the corners apart or widen them"
            )
        x, y, heading = np.array([x, y, heading]) - miss[:, None] * np.linspace(0.0, 1.0, len(x))
        foot = self._foot(x, y)
        distance = float(np.hypot(x - self._x[foot], y - self._y[foot]).max()) / self._bound
        curvature = self._hats @ self._at_knots(unknown) * self._bound
        rows = np.array([x / self._bound, y / self._bound, heading, curvature, np.linspace(*self._source, len(x))])
        return rows[:, :-1], distance

    def _guess(self) -> Array:
        """The path's curvature, averaged over two radii."""
        width = round(1.0 / self._bound / self._path.spacing)
        window = np.hanning(2 * width + 3)[1:-1]
        smooth = np.convolve(np.pad(self._curvature, width, mode="edge"), window / window.sum(), "valid")
        curvature = np.interp(self._knots[1:-1], np.linspace(0.0, 1.0, len(smooth)), smooth)
        return np.append(curvature, 0.95 * self._length)

    def _at_knots(self, unknown: Array) -> Array:
        return np.concatenate([self._ends[:1], unknown[:-1], self._ends[1:]])

    def _curve(self, unknown: Array) -> tuple[Array, Array, Array]:
        """x, y and heading."""
        curvature, length = self._at_knots(unknown), unknown[-1]
        middle = self._heading[0] + length * self._halfway @ curvature
        x = self._x[0] + np.append(0.0, np.cumsum(length * self._step * np.cos(middle)))
        y = self._y[0] + np.append(0.0, np.cumsum(length * self._step * np.sin(middle)))
        return x, y, self._heading[0] + length * self._turning @ curvature

    def _foot(self, x: Array, y: Array) -> npt.NDArray[np.intp]:
        """The nearest sample of the path, for each point."""
        return np.asarray(np.argmin((x[:, None] - self._x) ** 2 + (y[:, None] - self._y) ** 2, axis=1))

    def _off(self, x: Array, y: Array) -> Array:
        """Distances to the left of the path."""
        foot = self._foot(x, y)
        return np.asarray((x - self._x[foot]) * self._normal[0][foot] + (y - self._y[foot]) * self._normal[1][foot])

    def _cost(self, unknown: Array, ease: float) -> Array:
        """What is to become small."""
        x, y, heading = self._curve(unknown)
        meet = np.array([x[-1] - self._x[-1], y[-1] - self._y[-1], heading[-1] - self._heading[-1]])
        change = np.diff(self._at_knots(unknown))
        return np.concatenate([self._weight * self._off(x, y), ease * self._stiffness * change, MEET * meet])

    def _slope(self, unknown: Array, ease: float) -> Array:
        """Derivative of `_cost`, shape (residuals, unknowns)."""
        x, y, _ = self._curve(unknown)
        curvature, length = self._at_knots(unknown), unknown[-1]
        middle = self._heading[0] + length * self._halfway @ curvature
        turn = np.column_stack([length * self._halfway[:, 1:-1], self._halfway @ curvature])
        dx = np.vstack(
            [np.zeros(len(unknown)), np.cumsum(-length * self._step * np.sin(middle)[:, None] * turn, axis=0)]
        )
        dy = np.vstack(
            [np.zeros(len(unknown)), np.cumsum(length * self._step * np.cos(middle)[:, None] * turn, axis=0)]
        )
        dx[:, -1] += (x - self._x[0]) / length
        dy[:, -1] += (y - self._y[0]) / length
        end = np.append(length * self._turning[-1, 1:-1], self._turning[-1] @ curvature)
        foot = self._foot(x, y)
        across = self._normal[0][foot, None] * dx + self._normal[1][foot, None] * dy
        meet = np.vstack([dx[-1], dy[-1], end])
        return np.vstack([self._weight * across, ease * self._stiffness * self._changes, MEET * meet])
