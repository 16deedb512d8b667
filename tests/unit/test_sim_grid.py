"""Maps as images: where beams meet what is occupied."""

from __future__ import annotations

import numpy as np
import pytest

from artemis.mapping.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from artemis.sim.grid import MapGrid

CELLS = np.array([[FREE, FREE, FREE], [OCCUPIED, UNKNOWN, FREE]], np.int8)


def test_occupied_cells_end_a_beam_and_unknown_ones_do_not() -> None:
    grid = MapGrid(OccupancyMap(cells=CELLS, resolution=0.5, origin=(0.0, 0.0, 0.0)))
    met = set()
    for x in (0.0, 0.5, 1.0):
        for y in (0.0, 0.5):
            if grid.distances(np.array([x + 0.25]), np.array([y + 0.25]), np.ones(1), np.zeros(1))[0] == 0.0:
                met.add((x, y))
    assert met == {(0.0, 0.5)}


def test_a_map_may_be_turned() -> None:
    """Its occupied cell lies at x -1 to -0.5, y 0 to 0.5 if it is turned by 90 degrees around its corner."""
    grid = MapGrid(OccupancyMap(cells=CELLS, resolution=0.5, origin=(0.0, 0.0, np.pi / 2)))
    distance = grid.distances(np.full(2, -3.0), np.array([0.25, 0.75]), np.ones(2), np.zeros(2))
    assert distance[0] == pytest.approx(2.0, abs=0.13)
    assert np.isinf(distance[1])
