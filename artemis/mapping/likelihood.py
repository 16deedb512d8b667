"""A grid of how likely a scan's point is in each cell, made of other scans."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from artemis.mapping import kernels
from artemis.mapping.kernels_numpy import COARSE, FINE, STEPS, Cells
from artemis.mapping.se2 import Array
from artemis.mapping.settings import MapSettings
from artemis.motion.arrays import wrapped

_ROUNDS = 12


class Match(NamedTuple):
    """Where a scan fits."""

    score: float
    """Mean value of the cells in which its points lie, 0 to 1; -1: nowhere."""
    pose: Array
    """Shape (3,)."""
    information: Array
    """What the beams tell of x, y, heading in the frame of the grid, for a standard deviation of 1 m; shape (3, 3)."""


NOWHERE = -1.0
_NOTHING = np.zeros((3, 3))
_LITTLE = 0.5 * np.eye(3)
_NOWHERE_LEFT_OUT = np.zeros(3)


class LikelihoodGrid:
    """Wraps around, so it needs no origin. Made once, and filled again and again.

    The upper levels are filled when they are first needed, by `search` or by `finish`. After `finish`, until something
    is added, neither `search` nor `refine` changes anything: threads may share the grid.
    """

    def __init__(self, settings: MapSettings, cells: int | None = None) -> None:
        """Make an empty one; `cells` per side, if not as the settings say."""
        size = cells or settings.cells
        self._settings, self._per_metre = settings, 1 / settings.cell
        self._field, self._owner = np.zeros((size, size), np.float32), np.zeros((size, size), np.int32)
        self._fine = np.zeros((size // FINE, size // FINE), np.float32)
        self._coarse = np.zeros((size // COARSE, size // COARSE), np.float32)
        self._points = np.zeros((4096, 4))
        self._count, self._raised = 0, 0
        """Points of the map; those of them that the upper levels show."""
        self._blot = _blot(settings)

    @property
    def points(self) -> Array:
        """Of the map: x, y [m] and normal, shape (n, 4)."""
        return self._points[: self._count]

    def build(self, scans: Iterable[Array], poses: Iterable[Array]) -> None:
        """Forget what is there, and add scans."""
        radius = self._blot.shape[2] // 2
        kernels.LOOPS.wipe(self._field, self._points, self._count, radius, self._per_metre)
        kernels.LOOPS.wipe_levels(self._fine, self._coarse, self._points, self._raised, radius, self._per_metre)
        self._count = self._raised = 0
        for scan, pose in zip(scans, poses, strict=True):
            self._place(scan, pose)
        self._stamp(0)

    def add(self, scan: Array, pose: Array) -> None:
        """Add one scan: points and normals seen from `pose`, shape (n, 4)."""
        first = self._count
        self._place(scan, pose)
        self._stamp(first)

    def _place(self, scan: Array, pose: Array) -> None:
        first, last = self._count, self._count + len(scan)
        if last > len(self._points):
            self._points = np.concatenate([self._points, np.zeros((last, 4))])
        kernels.LOOPS.place(self._points, first, scan, pose)
        self._count = last

    def _stamp(self, first: int) -> None:
        kernels.LOOPS.stamp(self._field, self._owner, self._points, first, self._count, self._blot, self._per_metre)

    def finish(self) -> None:
        """Fill the upper levels, if they are not up to date."""
        if self._raised == self._count:
            return
        radius = self._blot.shape[2] // 2
        kernels.LOOPS.raise_levels(
            self._field, self._fine, self._coarse, self._points, self._count, radius, self._per_metre
        )
        self._raised = self._count

    def search(
        self,
        scan: Array,
        middle: Array,
        distance: float,
        turn: float,
        *,
        prior: float = 0.0,
        floor: float = 0.0,
        left_out: Array = _NOWHERE_LEFT_OUT,
    ) -> Match:
        """The best pose within `distance` [m] and `turn` [rad] of `middle`, exact to a cell; information: none.

        Args:
            scan: points and normals, shape (n, 4).
            middle: shape (3,).
            distance: along x and y.
            turn: to both sides.
            prior: what a pose at the edge has to be better by.
            floor: a score that it has to exceed.
            left_out: x, y seen from the middle, and radius [m]: of a circle in which no pose counts, shape (3,).
        """
        self.finish()
        step = turn_step(scan, self._settings.cell)
        turns, half = int(np.ceil(turn / step)), int(np.ceil(distance * self._per_metre))
        score, x, y, heading = kernels.LOOPS.search(
            self._field,
            self._fine,
            self._coarse,
            scan,
            middle,
            half,
            turns,
            step,
            self._per_metre,
            prior,
            floor,
            left_out,
        )
        return Match(float(score), np.array([x, y, wrapped(heading)]), _NOTHING)

    def refine(
        self, scan: Array, pose: Array, *, expected: Array | None = None, trust: Array = _LITTLE, rounds: int = _ROUNDS
    ) -> Match:
        """The pose near `pose` at which the scan's points lie on the lines of the map.

        Args:
            scan: points and normals, shape (n, 4).
            pose: to begin with, shape (3,).
            expected: another opinion on it, shape (3,); if left out, `pose`.
            trust: its information, in units of a beam's, shape (3, 3).
            rounds: at most.
        """
        expected = pose if expected is None else expected
        score, x, y, heading, information = kernels.LOOPS.refine(
            self._field,
            self._owner,
            self._points,
            scan,
            pose,
            self._per_metre,
            rounds,
            self._settings.width,
            expected,
            trust,
        )
        return Match(float(score), np.array([x, y, wrapped(heading)]), information)


def turn_step(scan: Array, cell: float) -> float:
    """A turn [rad] that moves the far points of a scan by about one cell [m]."""
    far = np.sort(np.hypot(scan[:, 0], scan[:, 1]))[int(0.8 * len(scan))] if len(scan) else 1.0
    return float(min(max(cell / far, 0.005), 0.03))


def _blot(settings: MapSettings) -> Cells:
    """Values around a point, by where in its cell it is."""
    reach = np.ceil(2 * settings.width / settings.cell)
    apart = np.arange(-reach, reach + 1)[None, :] - ((np.arange(STEPS) + 0.5) / STEPS - 0.5)[:, None]
    square = (apart * settings.cell / settings.width) ** 2
    return np.exp(-0.5 * (square[:, None, :, None] + square[None, :, None, :])).astype(np.float32)
