"""Noise in the points of a path: how far they jitter, and how much smoothing takes that away."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from artemis.motion.arrays import Array

FEWEST = 20
"""Of fewer points nobody can say whether they jitter."""
LONGEST_STRIDE = 0.3
"""Noise is looked for among points up to so far apart [m]; what is longer is the shape of the path."""
ALTERNATING = 0.6
"""Share of the deviations that change sign from one point to the next: 0.8 for white noise, 0 for a smooth curve."""
LEAST = 8e-5
"""Less [m] is rounding to a tenth of a millimetre, which the usual smoothing removes."""
WHOLE = 0.8
"""Neighbours that show less of the largest deviation than this deviate alike."""
LEFT = 0.2
"""Root mean square of the change of curvature [1/m^2] that noise may leave: the steering follows that at any speed."""
CLEAR = 8.0
"""Points of noise apart, in standard deviations: nearer ones would seem to reverse."""
LONGEST = 2.0
"""Of a wavelength to smooth with [m]."""
_LEFT_FACTOR = 3 * math.pi / (4 * math.sqrt(2))
"""Twice the integral of u^6 / (1 + u^4)^2 over u from 0."""


class Noise(Struct, frozen=True, kw_only=True):
    """How far points deviate at random from a smooth curve, across it."""

    deviation: float = 0.0
    """Standard deviation [m]; 0: they do not."""
    apart: float = 0.0
    """Distance between points whose deviations have nothing to do with each other [m]."""

    def wavelength(self, least: float) -> float:
        """Of which smoothing has to halve the amplitude [m]: `least`, or more where noise would steer the robot.

        Of white noise with the density deviation^2 apart, the low pass of `artemis.motion.spline.smoothed` leaves in
        the third derivative the variance deviation^2 apart (2 pi)^6 / wavelength^7 times the integral above.
        """
        amount = self.deviation * math.sqrt(_LEFT_FACTOR * self.apart) * math.tau**3 / LEFT
        return min(max(least, math.pow(amount, 2 / 7)), LONGEST)


class Drawn(Struct, frozen=True, kw_only=True, eq=False):
    """The points through which a path was laid."""

    points: Array
    """As given [m], shape (n, 2); a closed path repeats its first point at its end."""
    moved: Array
    """How far smoothing moved each of them [m], shape (n,)."""
    smoothing: float
    """Wavelength [m] of which the amplitude was halved."""
    noise: Noise

    def words(self) -> str:
        """What was done about the noise; nothing if there is none."""
        if not self.noise.deviation:
            return ""
        worst = int(np.argmax(self.moved))
        x, y = self.points[worst]
        rms = math.sqrt(float(np.mean(self.moved**2)))
        return (
            f"the points jitter by {1e3 * self.noise.deviation:.1f} mm: smoothed over {self.smoothing:.2f} m, which "
            f"moves them by {1e3 * rms:.1f} mm RMS, at most {1e3 * self.moved[worst]:.1f} mm (x {x:.2f} m, y {y:.2f} m)"
        )


def noise_of(x: Array, y: Array) -> Noise:
    """The noise in points along a path [m], each of shape (n,), n >= 1.

    A point deviates from the cubic through two points on both sides of it: hardly on a smooth curve, with signs that
    alternate on a noisy one. The median deviation ignores corners and single outliers. Points farther apart are
    looked at, too, for deviations of neighbours may be alike.
    """
    points = np.column_stack([x, y])
    found, stride = [Noise()], 1
    while len(points) >= max(FEWEST, 6 * stride):
        between = float(np.median(np.hypot(*(points[stride:] - points[:-stride]).T)))
        if not between <= LONGEST_STRIDE:
            break
        off = _deviations(points, stride)
        changes = float(np.mean(off[stride:] * off[:-stride] < 0))
        deviation = float(np.median(np.abs(off))) / 0.6745  # of a normal distribution
        if changes < ALTERNATING or deviation < LEAST:
            break
        found.append(Noise(deviation=deviation, apart=between))
        stride *= 2
    most = max(noise.deviation for noise in found)
    return next(noise for noise in found if noise.deviation >= WHOLE * most)


def averaged(x: Array, y: Array) -> tuple[Array, Array, NDArray[np.intp]] | None:
    """Points along a path that are nearer to each other than their noise allows, averaged group by group.

    Returns:
        Coordinates [m], and of each group the point in its middle; None: nothing is wrong with the points.
    """
    points, noise = np.column_stack([x, y]), noise_of(x, y)
    size = 1
    while (
        FEWEST * size < len(points)
        and _stride(points, size) < CLEAR * noise.deviation
        and _stride(points, 2 * size) < LONGEST_STRIDE  # or nobody would find what noise is left
    ):
        size *= 2
    if size == 1:
        return None
    begins = np.arange(0, len(points) - size // 2, size)
    counts = np.diff(np.append(begins, len(points)))
    means = np.add.reduceat(points, begins) / counts[:, None]
    least = min(CLEAR * noise.deviation / math.sqrt(size), _stride(points, size) / 2)
    kept = apart(means[:, 0], means[:, 1], least)  # of a robot that stood only the noise moved
    return means[kept, 0], means[kept, 1], (begins + counts // 2)[kept]


def apart(x: Array, y: Array, step: float) -> list[int]:
    """Indices of the points that are at least `step` [m] from the last one kept."""
    kept: list[int] = []
    last = (math.inf, math.inf)
    for index, point in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        if not math.dist(point, last) < step:
            kept.append(index)
            last = point
    return kept


def _stride(points: Array, stride: int) -> float:
    """Distance of points that are a stride apart [m], while the robot moves: of three quarters less."""
    return float(np.quantile(np.hypot(*(points[stride:] - points[:-stride]).T), 0.75))


def _deviations(points: Array, stride: int) -> Array:
    """Of the points from the cubic through their neighbours, across the path, in units of one point's noise [m]."""
    count = len(points) - 4 * stride
    around = [points[k * stride : k * stride + count] for k in range(5)]
    steps = [np.maximum(np.hypot(*(b - a).T), 1e-9) for a, b in pairwise(around)]
    at = [-steps[0] - steps[1], -steps[1], steps[2], steps[2] + steps[3]]  # chord length, from the point in the middle
    weights = [
        np.prod([at[j] / (at[j] - at[i]) for j in range(4) if j != i], axis=0) for i in range(4)
    ]  # of Lagrange's cubic
    middle = np.zeros_like(around[0])
    for weight, k in zip(weights, (0, 1, 3, 4), strict=True):
        middle += weight[:, None] * around[k]
    along = around[4] - around[0]
    along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    off = around[2] - middle
    across = off[:, 1] * along[:, 0] - off[:, 0] * along[:, 1]
    return np.asarray(across / np.sqrt(1 + np.sum(np.square(weights), axis=0)))
