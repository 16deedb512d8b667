"""A map as an image, looked at by beams."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.map_file import OCCUPIED_FROM
from artemis.mapping.occupancy import OccupancyMap

Floats = NDArray[np.float64]
FARTHEST = 30.0
"""Beams end there [m]."""


class MapGrid:
    """Cells that are occupied or not, with the way to the nearest occupied one."""

    def __init__(self, content: OccupancyMap) -> None:
        """Take the map: cells that are probably occupied are a wall."""
        from scipy.ndimage import distance_transform_edt

        self._resolution, (self._x, self._y, heading) = content.resolution, content.origin
        self._cos, self._sin = cos(heading), sin(heading)
        occupied = content.cells >= OCCUPIED_FROM
        framed = np.pad(occupied, 1)  # beyond the map there is nothing
        free = distance_transform_edt(~framed) if framed.any() else np.full(framed.shape, np.inf)
        self._free: Floats = free * content.resolution

    def distances(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> Floats:
        """How far beams from (x, y) in direction (dx, dy) go to the first occupied cell [m]; infinite: none.

        The cell is found to a quarter of its size.
        """
        x, y = self._turned(x - self._x, y - self._y)
        dx, dy = self._turned(dx, dy)
        rows, columns = self._free.shape
        size, along = self._resolution, np.zeros(len(x))
        found, flying = np.full(len(x), np.inf), np.arange(len(x))
        while len(flying):
            column = np.floor((x[flying] + along[flying] * dx[flying]) / size).astype(np.int64) + 1
            row = np.floor((y[flying] + along[flying] * dy[flying]) / size).astype(np.int64) + 1
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            row, column = np.minimum(np.maximum(row, 0), rows - 1), np.minimum(np.maximum(column, 0), columns - 1)
            free = np.where(inside, self._free[row, column], size)
            met = inside & (free == 0.0)
            found[flying[met]] = along[flying[met]]
            along[flying] += np.maximum(free - 1.5 * size, 0.25 * size)
            flying = flying[~met & (along[flying] < FARTHEST)]
        return found

    def _turned(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Along columns and rows."""
        return self._cos * x + self._sin * y, self._cos * y - self._sin * x
