"""A grid of what is free and what is occupied, made of scans and their poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.key_scans import KeyScans
from artemis.mapping.se2 import Array, compose
from artemis.values import Pose

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
FREE_BELOW, OCCUPIED_FROM = 0.2, 0.3
"""Share of the beams that met a cell and ended there: what is thin, or seen at a flat angle, lets most by."""
MARGIN = 1.0
"""Around the farthest points [m]."""
MOST_CELLS = 100_000_000
LARGEST_CELL = 1.0
"""[m]"""
_AT_ONCE = 1 << 17
"""Cells that are computed together: each takes some 200 bytes meanwhile."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OccupancyMap:
    """Cells, and where they are."""

    cells: NDArray[np.int8]
    """Probability of being occupied [%], -1: unknown; row 0 has the lowest y, column 0 the lowest x."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """x, y [m], heading [rad] of the outer corner of cell 0, 0 in the frame of the map."""

    def points(self, least: int = 65) -> Array:
        """Centres of the cells that are occupied with at least `least` percent, shape (n, 2)."""
        return self._centres(*np.nonzero(self.cells >= least))

    def _centres(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
        """Of cells, shape (n, 2)."""
        local = np.stack([columns + 0.5, rows + 0.5, np.zeros(len(rows))], 1) * self.resolution
        return compose(np.array(self.origin), local)[:, :2]

    def cell_of(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of points, shape (n, 2), which may lie outside."""
        columns, rows = np.floor(self._in_cells(points)).astype(np.int64)
        return rows, columns

    def contains(self, x: float, y: float) -> bool:
        """Whether a place lies on one of the cells."""
        return bool(self._has(*self.cell_of(np.array([[x, y]]))).all())

    def _has(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of these cells there are."""
        height, width = self.cells.shape
        return np.asarray((rows >= 0) & (rows < height) & (columns >= 0) & (columns < width))

    def _in_cells(self, points: Array) -> Array:
        """Columns and rows with their fractions, shape (2, n)."""
        x, y, heading = self.origin
        c, s = np.cos(heading), np.sin(heading)
        dx, dy = points[:, 0] - x, points[:, 1] - y
        return np.stack([c * dx + s * dy, c * dy - s * dx]) / self.resolution

    def rotated(self, angle: float) -> OccupancyMap:
        """Turned around the frame's origin by `angle` [rad], on cells along x and y again.

        Raises:
            ValueError: these would be more than `MOST_CELLS`.
        """
        x, y, heading = self.origin
        height, width = self.cells.shape
        corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) * self.resolution
        turned = compose(compose([0.0, 0.0, angle], [x, y, heading]), np.c_[corners, np.zeros(4)])[:, :2]
        low, high = turned.min(0), turned.max(0)
        columns, rows = np.ceil((high - low) / self.resolution - 1e-9).astype(int)
        if rows * columns > MOST_CELLS:
            raise ValueError(f"{rows} x {columns} cells; a map has {MOST_CELLS} at most")
        cells = np.full(rows * columns, UNKNOWN, np.int8)
        for start in range(0, len(cells), _AT_ONCE):
            part = cells[start : start + _AT_ONCE]
            row, column = np.divmod(np.arange(start, start + len(part)), columns)
            centres = np.stack([low[0] + (column + 0.5) * self.resolution, low[1] + (row + 0.5) * self.resolution], 1)
            back = compose([0.0, 0.0, -angle], np.c_[centres, np.zeros(len(centres))])[:, :2]
            old_row, old_column = self.cell_of(back)
            inside = self._has(old_row, old_column)
            part[inside] = self.cells[old_row[inside], old_column[inside]]
        return replace(self, cells=cells.reshape(rows, columns), origin=(float(low[0]), float(low[1]), 0.0))

    def cropped(self, low: tuple[float, float], high: tuple[float, float]) -> OccupancyMap:
        """The part between two corners [m].

        Raises:
            ValueError: nothing is left.
        """
        rows, columns = self.cell_of(np.array([low, high]))
        first_row, last_row = max(0, int(rows.min())), min(self.cells.shape[0], int(rows.max()) + 1)
        first_column, last_column = max(0, int(columns.min())), min(self.cells.shape[1], int(columns.max()) + 1)
        if first_row >= last_row or first_column >= last_column:
            raise ValueError("nothing of the map lies there")
        x, y, _ = compose(np.array(self.origin), [first_column * self.resolution, first_row * self.resolution, 0.0])
        cells = self.cells[first_row:last_row, first_column:last_column].copy()
        return replace(self, cells=cells, origin=(float(x), float(y), self.origin[2]))

    def inside(self, corners: Sequence[tuple[float, float]], *, touched: bool = False) -> NDArray[np.bool_]:
        """Of each cell, whether its middle lies inside of a polygon [m, in the frame of the map].

        `touched`: or an edge passes through it, sampled four times in each cell.
        """
        rows, columns = (
            slice(max(int(each.min()) - 1, 0), max(int(each.max()) + 2, 0)) for each in self.cell_of(np.array(corners))
        )
        found = np.zeros(self.cells.shape, bool)
        around = found[rows, columns]
        row, column = np.indices(around.shape).reshape(2, -1)
        x, y = self._centres(row + rows.start, column + columns.start).T.reshape(2, *around.shape)
        edges = list(zip(corners, [*corners[1:], corners[0]], strict=True))
        for (ax, ay), (bx, by) in edges:
            if ay != by:
                around ^= ((ay > y) != (by > y)) & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
        for start, end in edges if touched else ():
            found[self._along(start, end)] = True
        return found

    def _along(self, start: tuple[float, float], end: tuple[float, float]) -> tuple[NDArray[np.int64], ...]:
        """Rows and columns of the cells through which a straight line passes, not only between them."""
        places = self._in_cells(np.linspace(start, end, int(4.0 * math.dist(start, end) / self.resolution) + 2))
        columns, rows = np.floor(places[:, (np.abs(places - np.rint(places)) > 1e-6).all(0)]).astype(np.int64)
        within = self._has(rows, columns)
        return rows[within], columns[within]

    def closed(self, corners: Sequence[tuple[float, float]]) -> OccupancyMap:
        """With the inside of a polygon [m] occupied: a zone in which no robot may be.

        Raises:
            ValueError: it reaches no cell.
        """
        reached = self.inside(corners, touched=True)
        if not reached.any():
            raise ValueError("nothing of the map lies there")
        cells = self.cells.copy()
        cells[reached] = OCCUPIED
        return replace(self, cells=cells)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShownMap:
    """The map of a run as viewers show it."""

    content: OccupancyMap
    odometry: Pose | None = None
    """Where the odometry's frame lies on it; None: a localizer gives the robot's pose on it."""


def coarser(content: OccupancyMap, wanted: float) -> str:
    """That a map has larger cells than those that were wanted [m], for people; empty: it has not."""
    if content.resolution == wanted:
        return ""
    return f"cells of {content.resolution:g} m: with {wanted:g} m there would be more than {MOST_CELLS}"


def occupancy(keys: KeyScans, resolution: float = 0.05) -> OccupancyMap:
    """The map that scans make: what lies between the scanner and the points is free.

    Args:
        keys: the scans, their poses, and where the scanner was on the robot.
        resolution: side of a cell [m]; doubled until there are no more than `MOST_CELLS`.

    Raises:
        ValueError: there is no point, or they are so far apart that cells of a metre are too many.
    """
    from artemis.mapping import kernels  # loads numba: who only reads maps does without

    scanners = compose(keys.poses, np.c_[keys.places, np.zeros(len(keys))])
    ends = [
        np.ascontiguousarray(compose(pose, np.c_[scan[:, :2], np.zeros(len(scan))])[:, :2])
        for scan, pose in zip(keys.points, keys.poses, strict=True)
    ]
    if not any(len(each) for each in ends):
        raise ValueError("no scan has a point")
    every = np.concatenate([*ends, keys.poses[:, :2], scanners[:, :2]])
    low, high = np.floor(every.min(0) - MARGIN), np.ceil(every.max(0) + MARGIN)
    while np.prod(shape := ((high - low)[::-1] / resolution).astype(int) + 1) > MOST_CELLS:
        resolution *= 2.0
        if resolution > LARGEST_CELL:
            across = " x ".join(f"{side:.0f}" for side in high - low)
            raise ValueError(f"the scans reach over {across} m; a map has {MOST_CELLS} cells at most")
    hits, passes = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    for seen, scanner in zip(ends, scanners, strict=True):
        kernels.LOOPS.count_rays(hits, passes, seen, scanner, 1 / resolution, low[0], low[1])
    cells = np.full(shape, UNKNOWN, np.int8)
    for row in range(0, len(cells), some := 1 + _AT_ONCE // shape[1]):
        part, ended = cells[row : row + some], hits[row : row + some]
        met = ended + passes[row : row + some]
        share = ended / np.maximum(1, met)
        part[(met > 0) & (share < FREE_BELOW)] = FREE
        part[share >= OCCUPIED_FROM] = OCCUPIED
    return OccupancyMap(cells=cells, resolution=resolution, origin=(float(low[0]), float(low[1]), 0.0))
