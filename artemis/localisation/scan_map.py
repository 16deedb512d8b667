"""What a scanner can see of a map: points on its surfaces, and how the surfaces lie there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.occupancy import OccupancyMap
from artemis.mapping.se2 import Array, placed_surface
from artemis.mapping.settings import MapSettings

_ROUGH = 2
"""Cells of the rough grid are so many times as wide."""
_AROUND, _LEAST, _RADIUS = 21, 4, 4.2
"""Occupied cells that a line is laid through, at most and at least, and how far away they are [cells]."""
_THIN = 0.45
"""Of a line: its width is at most so much of its length."""
_DIRECTIONS = 4
"""Points of one cell are one surface if their normals lie in one of so many sectors."""

_LEVER = 5.0
"""Distance between the walls that constrain a heading: half a room [m]."""


def common_covariance(resolution: float) -> tuple[float, float]:
    """What all matches of one place on a map have in common, as the map does not change: variances [m²], [rad²].

    A wall that is drawn in cells of side r [m] lies anywhere in them: r² / 12, the variance of a uniform distribution.
    Two walls or more constrain each direction: r² / 24. Walls some metres apart constrain the heading. This part of the
    error is the same in two matches within a metre or so; that of the beams is not.
    """
    of_wall = resolution**2 / 12
    return of_wall / 2, of_wall / _LEVER**2


class ScanMap:
    """A likelihood grid of a whole map, finished: one thread may follow a robot on it while another one searches.

    Attributes:
        grid: to match scans on.
        rough: with larger cells, to look for a robot on all of it.
        middle: of the map, x, y [m], heading 0.
        reach: from the middle to the farthest point along x or y [m].
    """

    def __init__(self, points: Array, settings: MapSettings) -> None:
        """Take surface points: x, y [m] and normal (0, 0: unknown), shape (n, 4).

        Raises:
            ValueError: there are none.
        """
        if not len(points):
            raise ValueError("nothing is occupied in the map")
        low, high = points[:, :2].min(0), points[:, :2].max(0)
        self.middle = np.append((low + high) / 2, 0.0)
        self.reach = float((high - low).max() / 2)
        wanted = 2 * (self.reach + settings.farthest) / settings.cell  # points of a scan may lie outside of the map
        self.grid = LikelihoodGrid(settings, 1 << int(np.ceil(np.log2(wanted))))
        self.grid.add(points, np.zeros(3))
        wide = replace(settings, cell=_ROUGH * settings.cell, width=_ROUGH * settings.width)
        self.rough = LikelihoodGrid(wide, 1 << int(np.ceil(np.log2(wanted / _ROUGH))))
        self.rough.add(points, np.zeros(3))
        for grid in (self.grid, self.rough):
            grid.finish()

    @classmethod
    def of_scans(cls, scans: Sequence[Array], poses: Array, settings: MapSettings) -> ScanMap:
        """Of key scans with their poses: finer than the cells of an image."""
        return cls(surface_of_scans(scans, poses, settings.cell), settings)

    @classmethod
    def of_cells(cls, content: OccupancyMap, settings: MapSettings) -> ScanMap:
        """Of the occupied cells of a map."""
        return cls(surface_of_cells(content), settings)


def surface_of_scans(scans: Sequence[Array], poses: Array, cell: float) -> Array:
    """Points of scans, those of one surface in one cell [m] made one: x, y and normal, shape (n, 4)."""
    every = np.concatenate([placed_surface(pose, scan) for scan, pose in zip(scans, poses, strict=True)])
    known = (every[:, 2:] != 0).any(1)
    direction = np.arctan2(every[:, 3], every[:, 2]) % np.pi  # a wall that is seen from both sides is one
    sector = np.where(known, np.floor(direction / np.pi * _DIRECTIONS), -1)
    key = np.c_[np.floor(every[:, :2] / cell), sector].astype(np.int64)
    _, of, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    of = of.reshape(-1)
    sums = np.zeros((len(count), 4))
    doubled = np.where(known[:, None], np.stack([np.cos(2 * direction), np.sin(2 * direction)], 1), 0.0)
    np.add.at(sums, of, np.c_[every[:, :2], doubled])
    mean = sums[:, :2] / count[:, None]
    normal = 0.5 * np.arctan2(sums[:, 3], sums[:, 2])
    has = ((sums[:, 2:] != 0).any(1))[:, None]
    return np.asarray(np.c_[mean, np.where(has, np.stack([np.cos(normal), np.sin(normal)], 1), 0.0)])


def surface_of_cells(content: OccupancyMap) -> Array:
    """Occupied cells, each moved onto the line through those around it: x, y and normal, shape (n, 4)."""
    points = content.points()
    if len(points) < _LEAST:
        return np.asarray(np.c_[points, np.zeros((len(points), 2))])
    tree = cKDTree(points)
    _, around = tree.query(points, k=_AROUND, distance_upper_bound=_RADIUS * content.resolution)
    there = around < len(points)
    beside = np.where(there[:, :, None], points[np.minimum(around, len(points) - 1)], 0.0)
    count = there.sum(1)
    centre = beside.sum(1) / count[:, None]
    off = np.where(there[:, :, None], beside - centre[:, None], 0.0)
    eigenvalues, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
    line = (count >= _LEAST) & (eigenvalues[:, 0] < _THIN**2 * eigenvalues[:, 1])
    normal = np.where(line[:, None], axes[:, :, 0], 0.0)
    return np.asarray(np.c_[points - normal * ((points - centre) * normal).sum(1, keepdims=True), normal])
