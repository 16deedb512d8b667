"""How a simulated laser scanner measures: each beam at its own time along the motion, with the errors of an LMS100."""

from __future__ import annotations

from math import radians

import numpy as np
from numpy.typing import NDArray

from artemis.mounting import Mounting
from artemis.sim.scenery import SURFACES, Floats, Surroundings2D
from artemis.sim.world import World

NEAREST, FARTHEST = 0.5, 20.0
"""Range of an LMS100 [m] (SICK, operating instructions LMS1xx, 8012471)."""
NOISE = 0.012
"""Standard deviation [m] (the same; "statistical error")."""
SYSTEMATIC = 0.030
"""The systematic error is no larger [m] (the same)."""
FARTHEST_DARK = 8.0
"""As far as it sees something with 2 % remission [m]: the square root of a fifth of 18 m, which are for 10 %."""
SQUARE_ENOUGH = np.cos(radians(8.0))
"""Shiny things send the light back only into about the direction from which it came; an assumption."""
SPOT, SPREAD = 0.008, 0.015
"""Diameter of the beam at the window [m], and how it grows [rad] (the same operating instructions)."""
EDGE, APART = 0.1, 3.0
"""Neighbours whose distances differ by more than the first [m] have an edge between them; beyond the second the echoes
are told apart. An assumption."""


class Laser:
    """The optics of one scanner on a robot in its world."""

    def __init__(self, world: World, mounting: Mounting, around: Surroundings2D, *, seed: int, start: float) -> None:
        """`start`: the world's time at which run time is 0 [s]; `seed` of everything random."""
        self._world, self._around, self._start = world, around, start
        self._x, self._y, self._heading = mounting.x_m, mounting.y_m, mounting.heading
        self._turn = -1.0 if mounting.upside_down else 1.0
        self._dice = np.random.default_rng(seed)
        self._waves = self._dice.uniform([2.0, 0.0], [9.0, 2 * np.pi], (3, 2))
        self.noise, self.systematic = NOISE, SYSTEMATIC
        """Errors: standard deviation, and the largest that stays the same for a distance [m]."""
        self.dirt = 0.0
        """Share of the beams that the window swallows."""
        self.covered: tuple[float, float] | None = None
        """A sector that something on the window hides [rad], in the scanner's own angles."""
        world.keep_trail()

    def look(self, times: Floats, angles: Floats) -> NDArray[np.uint16]:
        """Distances [mm], 0: no return, of beams at loop times [s] into angles [rad] from the scanner's x axis."""
        x, y, heading = self._world.poses_at(times)
        cos, sin = np.cos(heading), np.sin(heading)
        x += cos * self._x - sin * self._y
        y += sin * self._x + cos * self._y
        sight = self._around.seen(x, y, heading + self._heading + self._turn * angles, times[0] - self._start)
        true = sight.distance
        reach = np.where(sight.surface == SURFACES.index("dark"), FARTHEST_DARK, FARTHEST)
        mirrors = (sight.surface == SURFACES.index("shiny")) & (sight.square < SQUARE_ENOUGH)
        distance = self._mixed(np.minimum(true, 2 * FARTHEST))
        dice = self._dice
        measured = distance + self._systematic(distance) + dice.normal(0.0, self.noise, len(true))
        lost = (distance < NEAREST) | (distance > reach) | mirrors
        if self.dirt:
            lost |= dice.random(len(true)) < self.dirt
        if self.covered is not None:
            lost |= (angles >= self.covered[0]) & (angles <= self.covered[1])
        measured[lost] = 0.0
        return np.rint(measured * 1000.0).astype(np.uint16)

    def _mixed(self, distance: Floats) -> Floats:
        """At an edge a beam, which is not thin, may hit both what is near and what is far: it measures in between."""
        gap = np.diff(distance)
        edges = np.flatnonzero((np.abs(gap) > EDGE) & (np.abs(gap) < APART))
        if not len(edges):
            return distance
        near = np.minimum(distance[edges], distance[edges + 1])
        width = near * np.radians(0.5) + 1e-9
        hit = self._dice.random(len(edges)) < np.minimum((SPOT + SPREAD * near) / width, 1.0) / 2
        share = self._dice.random(len(edges))
        mixed = distance.copy()
        mixed[edges[hit]] += (share * gap[edges])[hit]
        return mixed

    def _systematic(self, distance: Floats) -> Floats:
        """An error that stays the same for a distance: three waves along it [m]."""
        error = np.zeros(len(distance))
        for length, phase in self._waves:
            error += np.sin(distance * (2 * np.pi / length) + phase)
        return error * (self.systematic / 3)
