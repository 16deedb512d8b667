"""A path's samples as plain numbers, which are read several times faster than arrays. This module can be compiled."""

from __future__ import annotations

from math import cos, hypot, inf, sin, sqrt

from artemis.motion.angles import wrap

LONGEST_CHORD = 1.01
"""From one sample to the next, in spacings: a chord is no longer than its arc, which is found with an error."""


class Samples:
    """Points at constant arc length, with heading and curvature; of a closed path the last one is the first again."""

    def __init__(
        self,
        x: list[float],
        y: list[float],
        heading: list[float],
        curvature: list[float],
        *,
        spacing: float,
        closed: bool,
    ) -> None:
        """Of arrays of one length [m, m, rad, 1/m], `spacing` [m] apart."""
        self.x, self.y, self.heading, self.curvature = x, y, heading, curvature
        self._spacing, self._closed = spacing, closed
        self._last = len(x) - 1

    def nearest(self, x: float, y: float, near: float, window: float) -> tuple[int, float]:
        """The sample that is nearest to (x, y), and how far behind it the foot of the perpendicular is [m].

        Only samples within `window` [m] of the arc length `near` [m] count.
        """
        spacing, last = self._spacing, self._last
        if self._closed:
            window, count = min(window, last * spacing / 2), last
            first, final = round((near - window) / spacing), round((near + window) / spacing)
        else:
            near, count = min(max(near, 0.0), last * spacing), last + 1
            first, final = max(round((near - window) / spacing), 0), min(round((near + window) / spacing), last)
        xs, ys = self.x, self.y
        middle = min(max(round(near / spacing), first), final) % count
        bound = hypot(x - xs[middle], y - ys[middle])
        nearest, index, candidate = inf, first, first
        while candidate <= final:
            dx, dy = x - xs[candidate % count], y - ys[candidate % count]
            square = dx * dx + dy * dy
            distance = sqrt(square)
            if square < nearest:
                nearest, index, bound = square, candidate, min(bound, distance)
            nearer = (distance - bound) / (LONGEST_CHORD * spacing)  # so many samples on, one may be as near as `bound`
            candidate += 1 + int(nearer) if nearer < count else 1
        return index, self._foot(x, y, index)

    def at(self, index: int, rest: float) -> tuple[float, float, float, float]:
        """x, y, heading and curvature `rest` metres after a sample; curvature is linear between samples."""
        if self._closed:
            index %= self._last
        heading, curvature = self.heading[index], self.curvature[index]
        following = index + 1 if rest > 0 else index - 1
        if self._closed:
            following %= self._last
        if 0 <= following <= self._last:
            end_curvature = curvature + (self.curvature[following] - curvature) * abs(rest) / self._spacing
        elif rest == 0:
            end_curvature = curvature
        else:
            curvature = end_curvature = 0.0
        chord = heading + curvature * rest / 2
        end_heading = wrap(heading + (curvature + end_curvature) * rest / 2)
        return self.x[index] + rest * cos(chord), self.y[index] + rest * sin(chord), end_heading, end_curvature

    def _foot(self, x: float, y: float, index: int) -> float:
        """Arc length from a sample to the perpendicular through (x, y), which is close to that sample."""
        sample = index % self._last if self._closed else index
        dx, dy, heading = x - self.x[sample], y - self.y[sample], self.heading[sample]
        cosine, sine = cos(heading), sin(heading)
        along = dx * cosine + dy * sine
        if not self._closed and (along < 0 if index == 0 else index == self._last and along > 0):
            return along
        # One Newton step; the distance from the centre of curvature scales the distance along the curve.
        scale = 1.0 - self.curvature[sample] * (dy * cosine - dx * sine)
        return max(-self._spacing, min(self._spacing, along / max(scale, 0.1)))
