"""Random floor plans, on which robots are sent from place to place: rooms, lanes, and what lies around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.occupancy import OccupancyMap

CELL = 0.05
"""Side of a cell [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """Occupied cells, row 0 and column 0 at the origin."""

    occupied: NDArray[np.bool_]

    def box(self, x: float, y: float, width: float, height: float, *, filled: bool = True) -> None:
        """Put a box there, or cut one out: its corner with the least x and y, and its size along them [m]."""
        column, row = round(x / CELL), round(y / CELL)
        far = row + max(round(height / CELL), 1), column + max(round(width / CELL), 1)
        self.occupied[row : far[0], column : far[1]] = filled

    @property
    def content(self) -> OccupancyMap:
        """As a map in which the rest is free."""
        cells = np.where(self.occupied, 100, 0).astype(np.int8)
        return OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0))

    @property
    def edges(self) -> list[list[list[float]]]:
        """Where occupied cells end: the ends of straight lines, x and y of each [m]."""
        lines = []
        for across, cells in ((False, self.occupied), (True, self.occupied.T)):
            framed = np.pad(cells, 1)
            change = np.pad(framed[1:] != framed[:-1], ((0, 0), (1, 1)))[:, 1:-1]
            steps = np.diff(np.pad(change, ((0, 0), (1, 1))).astype(np.int8), axis=1)
            for (row, first), (_, last) in zip(np.argwhere(steps == 1), np.argwhere(steps == -1), strict=True):
                ends = [[(first - 1) * CELL, row * CELL], [(last - 1) * CELL, row * CELL]]
                lines.append([[round(float(x), 3) for x in (end[::-1] if across else end)] for end in ends])
        return lines


MAPS = ("clutter", "rooms", "lanes")
SIZE, CLOSET = 9.0, 1.4
"""Of a small plan on a side, and how wide the room without a door beside it is [m]."""


def small_plan(kind: str, seed: int) -> FloorPlan:
    """Of `MAPS`: things that lie around, four rooms with doors, or lanes to and fro; and the closet."""
    count, dice = round(SIZE / CELL), np.random.default_rng(seed)
    plan = FloorPlan(np.zeros((count, count + round(CLOSET / CELL)), bool))
    for far in (0.0, SIZE - 0.1):
        plan.box(0, far, SIZE + CLOSET, 0.1)
        plan.box(far, 0, 0.1, SIZE)
    plan.box(SIZE + CLOSET - 0.1, 0, 0.1, SIZE)
    if kind == "clutter":
        for _ in range(10):
            (x, y), (width, height) = dice.uniform(1, SIZE - 1, 2), dice.uniform(0.1, 0.7, 2)
            plan.box(x, y, min(width, SIZE - x), height)
    elif kind == "rooms":
        across, up = dice.uniform(1.0, 2.2, 2), dice.uniform(1.0, 2.2, 2)
        plan.box(SIZE / 2, 0, 0.1, SIZE)
        plan.box(0, SIZE / 2, SIZE, 0.1)
        for half in (0, 1):
            plan.box(half * SIZE / 2 + across[half], SIZE / 2, 1.2, 0.1, filled=False)
            plan.box(SIZE / 2, half * SIZE / 2 + up[half], 0.1, 1.2, filled=False)
    else:
        plan.box(SIZE / 3, 0, 0.1, SIZE - 2.0)
        plan.box(2 * SIZE / 3, 2.0, 0.1, SIZE - 2.0)
    return plan


LARGE_MAPS = ("open", "boxes", "rooms", "lanes")
LARGE = 20.0
"""Of a large plan on a side [m]."""


def large_plan(kind: str, seed: int) -> FloorPlan:
    """Of `LARGE_MAPS`: nothing but walls around; 40 boxes; rooms along a corridor; lanes to and fro."""
    count, dice = round(LARGE / CELL), np.random.default_rng(seed)
    plan = FloorPlan(np.zeros((count, count), bool))
    plan.occupied[[0, -1]] = plan.occupied[:, [0, -1]] = True
    if kind == "boxes":
        for _ in range(40):
            plan.box(*dice.uniform(1, 19, 2), *dice.uniform(0.1, 0.9, 2))
    elif kind == "rooms":
        for x in (5, 10, 15):
            plan.box(x, 0, 0.1, 8.5)
            plan.box(x, 11, 0.1, 9)
        for y in (8.5, 11):
            plan.box(0, y, LARGE, 0.1)
            for x in (2, 7, 12, 17):
                plan.box(x, y, 1.2, 0.1, filled=False)
        for _ in range(25):
            x, y = dice.uniform(0.5, 19, 2)
            if not 7 < y < 12.5:
                plan.box(x, y, *dice.uniform(0.1, 0.6, 2))
    elif kind == "lanes":
        for number, x in enumerate(range(2, 20, 2)):
            plan.box(x, 0 if number % 2 else 1.7, 0.1, 18.3)
    return plan
