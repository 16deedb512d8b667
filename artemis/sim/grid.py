"""A map as an image: read as map_server writes it, and looked at by beams."""

from __future__ import annotations

import re
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from artemis.config import Config, Quantity
from artemis.errors import ConfigError

Floats = NDArray[np.float64]
FARTHEST = 30.0
"""Beams end there [m]."""
MOST_CELLS = 40_000_000
_SHARE = Annotated[float, Field(gt=0, lt=1)]


class MapWords(Config):
    """The YAML file beside the image (ROS, `map_server`: "Map format")."""

    image: Annotated[str, Field(min_length=1)]
    """Its name, beside this file: a PGM."""
    resolution: Annotated[float, Quantity(0.001, 1.0, "m")]
    """Of a cell."""
    origin: Annotated[tuple[float, float, float], Field(strict=False)]
    """x, y [m] and heading [rad] of the lower left corner."""
    negate: Literal[0, 1] = 0
    """1: black is free."""
    occupied_thresh: _SHARE = 0.65
    """Cells darker than this share of black are occupied."""
    free_thresh: _SHARE = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"


class MapGrid:
    """Cells that are occupied or not, with the way to the nearest occupied one."""

    def __init__(self, occupied: NDArray[np.bool_], resolution: float, x: float, y: float) -> None:
        """Row 0 is at the bottom; (x, y) [m] is the lower left corner, `resolution` [m] the size of a cell."""
        from scipy.ndimage import distance_transform_edt

        self._resolution, self._x, self._y = resolution, x, y
        framed = np.pad(occupied, 1)  # beyond the map there is nothing
        free = distance_transform_edt(~framed) if framed.any() else np.full(framed.shape, np.inf)
        self._free: Floats = free * resolution

    def distances(self, x: Floats, y: Floats, dx: Floats, dy: Floats) -> Floats:
        """How far beams from (x, y) in direction (dx, dy) go to the first occupied cell [m]; infinite: none.

        The cell is found to a quarter of its size.
        """
        rows, columns = self._free.shape
        size, along = self._resolution, np.zeros(len(x))
        found, flying = np.full(len(x), np.inf), np.arange(len(x))
        while len(flying):
            column = np.floor((x[flying] + along[flying] * dx[flying] - self._x) / size).astype(np.int64) + 1
            row = np.floor((y[flying] + along[flying] * dy[flying] - self._y) / size).astype(np.int64) + 1
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            free = np.where(inside, self._free[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)], size)
            met = inside & (free == 0.0)
            found[flying[met]] = along[flying[met]]
            along[flying] += np.maximum(free - 1.5 * size, 0.25 * size)
            flying = flying[~met & (along[flying] < FARTHEST)]
        return found


def image_from(data: bytes, name: str) -> NDArray[np.uint8]:
    """The pixels of a PGM image (plain or raw, 8 bits), the first row at the top.

    Raises:
        ConfigError: it is no such image.
    """
    head = re.match(
        rb"(P[25])(?:\s+#[^\n]*)*\s+(\d{1,9})(?:\s+#[^\n]*)*\s+(\d{1,9})(?:\s+#[^\n]*)*\s+(\d{1,9})\s", data
    )
    if head is None:
        raise ConfigError(f"{name}: expected an image in the format PGM (P5 or P2)")
    columns, rows, most = (int(head[number]) for number in (2, 3, 4))
    if not (0 < columns * rows <= MOST_CELLS and 0 < most < 256):
        raise ConfigError(f"{name}: {columns} x {rows} pixels up to {most}: expected at most {MOST_CELLS} of 8 bits")
    body = data[head.end() :]
    if head[1] == b"P5":
        pixels = np.frombuffer(body[: columns * rows], np.uint8)
    else:
        words = body.split()
        if not all(word.isdigit() and len(word) <= 3 for word in words):
            raise ConfigError(f"{name}: expected whole numbers")
        pixels = np.array([min(int(word), 255) for word in words[: columns * rows]], np.uint8)
    if len(pixels) < columns * rows:
        raise ConfigError(f"{name}: ends after {len(pixels)} of {columns * rows} pixels")
    scaled = pixels if most == 255 else np.minimum(pixels.astype(np.uint16) * 255 // most, 255).astype(np.uint8)
    return scaled.reshape(rows, columns)


def grid_from(words: MapWords, image: NDArray[np.uint8]) -> MapGrid:
    """The map that an image is."""
    dark = image if words.negate else 255 - image
    occupied = dark[::-1] > words.occupied_thresh * 255
    return MapGrid(occupied, words.resolution, words.origin[0], words.origin[1])
