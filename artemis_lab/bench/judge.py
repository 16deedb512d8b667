"""What a run was like: the true rear axle's error against the course itself, whatever the follower believed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from artemis.motion.arrays import Array
from artemis_lab.bench.courses import SPACING, Course

WINDOW = 0.5
"""The robot is looked for so far [m] along the course from where it was: other branches of a crossing are not seen."""
SETTLED = 0.02
"""Cross-track error of a settled robot [m]."""
RUN_IN, RUN_OUT = 3.0, 3.0
"""Distance after which the steady figures begin, and distance at the end of which the residual is taken [m]."""


class ReferenceLine:
    """A course to measure distances from; goes on straight before its beginning and after its end."""

    def __init__(self, course: Course) -> None:
        x, y = self._x, self._y = course.points.T.copy()
        arc = np.append(0.0, np.hypot(np.diff(x), np.diff(y)).cumsum())
        self._arc: list[float] = arc.tolist()
        self._index, self._reach = 0, round(WINDOW / SPACING)
        self.length = self._arc[-1]

    def locate(self, x: float, y: float) -> tuple[float, float]:
        """Arc length [m] and distance to the left [m] of a point, near where the last one was."""
        first, final = max(self._index - self._reach, 0), self._index + self._reach + 1
        square = (self._x[first:final] - x) ** 2 + (self._y[first:final] - y) ** 2
        index = self._index = first + int(np.argmin(square))
        last = len(self._arc) - 1
        pieces = [self._on_piece(piece, x, y) for piece in (index - 1, index) if 0 <= piece < last]
        return min(pieces, key=lambda found: abs(found[1]))

    def _on_piece(self, piece: int, x: float, y: float) -> tuple[float, float]:
        """The same for the straight piece after a point; signed distance from its end if it lies beyond."""
        begin_x, begin_y = float(self._x[piece]), float(self._y[piece])
        dx, dy = float(self._x[piece + 1]) - begin_x, float(self._y[piece + 1]) - begin_y
        length = math.hypot(dx, dy)
        along = ((x - begin_x) * dx + (y - begin_y) * dy) / length
        left = ((y - begin_y) * dx - (x - begin_x) * dy) / length
        low = -math.inf if piece == 0 else 0.0
        high = math.inf if piece == len(self._arc) - 2 else length
        beyond = along - min(max(along, low), high)
        return self._arc[piece] + along - beyond, math.copysign(math.hypot(left, beyond), left)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTrack:
    """A run, tick by tick: arrays of shape (n,), true values.

    `arc_length` and `cross_track` [m] are against the course, `distance` [m] is that of the rear axle's centre,
    `steering` [rad] what the follower commanded, `speed` [m/s] that of the virtual front wheel.
    """

    time: Array
    x: Array
    y: Array
    distance: Array
    arc_length: Array
    cross_track: Array
    speed: Array
    steering: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Of one run. Errors in m. Means are over the distance: standing still counts for nothing."""

    rms: float
    max: float
    steady_rms: float
    """After the first `RUN_IN` metres."""
    steady_max: float
    residual: float
    """RMS over the last `RUN_OUT` metres."""
    settling_distance: float
    """Arc length from the start (or the kink) until it stays within `SETTLED`; infinite: never."""
    overshoot: float
    """Largest error on the other side than the start's offset; 0 for a course without."""
    time: float
    """Of the run [s]."""
    steering_rate: float
    """Greatest change of the commanded angle [rad/s]."""


def judge(track: RunTrack, course: Course, period: float) -> Figures:
    """The figures of a run; what lies beyond the end of the course does not count."""
    error, arc = np.abs(track.cross_track), track.arc_length
    on_course = arc <= course.length
    error = np.where(on_course, error, 0.0)
    weight = np.where(on_course, np.append(np.diff(track.distance), 0.0), 0.0)
    steady, late = track.distance >= RUN_IN, arc >= course.length - RUN_OUT
    outside = np.flatnonzero(error > SETTLED)
    settled = 0.0
    if len(outside):
        last = int(outside[-1])
        settled = float(arc[last + 1]) - course.settled_from if last + 1 < len(arc) else math.inf
    first = float(track.cross_track[0])
    overshoot = max(float(np.max(-math.copysign(1.0, first) * track.cross_track)), 0.0) if abs(first) > SETTLED else 0.0
    return Figures(
        rms=_rms(error, weight),
        max=float(error.max()),
        steady_rms=_rms(error[steady], weight[steady]),
        steady_max=float(error[steady].max(initial=0.0)),
        residual=_rms(error[late], weight[late]),
        settling_distance=max(settled, 0.0),
        overshoot=overshoot,
        time=float(track.time[-1]),
        steering_rate=float(np.max(np.abs(np.diff(track.steering)), initial=0.0)) / period,
    )


def _rms(error: Array, weight: Array) -> float:
    total = float(weight.sum())
    return math.sqrt(float((error**2 * weight).sum()) / total) if total > 0 else math.nan
