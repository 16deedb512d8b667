"""Ground that the robot drove over or saw to be free a short time ago: where it may drive backwards without looking."""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, inf, sin

import numpy as np
from numpy.typing import NDArray

from artemis.motion.poses import placed
from artemis.motion.spline import Array
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View, placed_points
from artemis.values import Pose

Indices = NDArray[np.int64]

CELL = 0.05
"""Width of a cell [m]."""
CELLS = 256
"""In each direction; the grid goes round: what is 12.8 m away takes the place of what was here."""
MEMORY = 60.0
"""Of what was seen or driven [s]."""
STEP, TURN = 0.04, 0.05
"""The ground is marked again after so much distance [m] or rotation [rad]."""
AROUND = 0.7
"""Ground is looked at this far around the outline [m]."""
SHRUNK = 0.03
"""The outline is looked for this much smaller than it is [m]: cells at its edge are there to half."""
AHEAD = 0.3
"""Known ground is looked for this far back [m]: a robot that drives slowly stops within less."""


class Ground:
    """A grid in the frame of the odometry, with the time at which each of its cells was known to be free."""

    def __init__(self, box: Rectangle) -> None:
        """`box`: the outline."""
        self._box = box
        wide = box.grown(AROUND)
        self._beside = _cells(wide, CELL)
        self._under = _cells(box, CELL / 2)
        self._edge = _border(box.grown(-SHRUNK))
        self._seen: dict[View, tuple[Indices, Array]] = {}
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self._when = np.full((CELLS, CELLS), -inf)
        self._who = np.zeros((CELLS, CELLS), dtype=np.int64)
        self._pose: Pose | None = None

    def mark(self, pose: Pose, time: float, views: Iterable[View]) -> None:
        """What the robot stands on at a run time [s], and what its scanners see to be free."""
        last, self._at = self._pose, pose
        if last is not None:
            turned = abs(pose.heading - last.heading) > TURN
            if not turned and abs(pose.x - last.x) + abs(pose.y - last.y) < STEP:
                return
        self._pose = pose
        self._set(self._under, pose, time)
        for view in views:
            if view.millimetres.size:
                self._set(self._free(view), pose, time)

    def _free(self, view: View) -> Array:
        """Centres of the cells around the robot that a scanner sees to be free, shape (2, n)."""
        if view not in self._seen:
            beams = [view.beam_past(x, y) for x, y in self._beside.T.tolist()]
            looked = [place for place, beam in enumerate(beams) if beam is not None]
            distances = [view.distance_to(*self._beside[:, place].tolist()) for place in looked]
            self._seen[view] = (
                np.array([looked, [beams[place] for place in looked]], dtype=np.int64),
                1000.0 * np.array(distances),
            )
        (places, beams_past), far = self._seen[view]
        free = (view.millimetres[beams_past] > far + 1000.0 * CELL) & (far > view.least)
        return self._beside[:, places[free]]

    def _set(self, cells: Array, pose: Pose, time: float) -> None:
        column, row = _indices(cells, pose)
        at = column % CELLS, row % CELLS
        self._when[at], self._who[at] = time, column * 1_000_003 + row

    def known(self, curvature: float, now: float) -> float:
        """How far back the robot may roll on an arc over ground that was known in the last `MEMORY` [m]."""
        assert self._pose is not None
        steps = [CELL * number for number in range(1, round(AHEAD / CELL) + 1)]
        for distance in steps:
            turn = -curvature * distance
            x = sin(turn) / curvature if abs(curvature) > 1e-9 else -distance
            y = (1.0 - cos(turn)) / curvature if abs(curvature) > 1e-9 else 0.0
            there = placed(self._at, Pose(x=x, y=y, heading=turn))
            column, row = _indices(self._edge, there)
            at = column % CELLS, row % CELLS
            fresh = (self._when[at] >= now - MEMORY) & (self._who[at] == column * 1_000_003 + row)
            if not fresh.all():
                return distance - CELL
        return inf


def _cells(box: Rectangle, apart: float) -> Array:
    """Places in a rectangle in the robot's frame, so far apart [m]; shape (2, n)."""
    x = np.arange(box.rear, box.front + apart, apart)
    y = np.arange(-box.half_width, box.half_width + apart, apart)
    return np.array(np.meshgrid(x, y)).reshape(2, -1)


def _border(box: Rectangle) -> Array:
    """Points on the border of a rectangle, half a cell apart, shape (2, n)."""
    x = np.append(np.arange(box.rear, box.front, CELL / 2), box.front)
    y = np.append(np.arange(-box.half_width, box.half_width, CELL / 2), box.half_width)
    sides = [np.array([x, np.full_like(x, side)]) for side in (-box.half_width, box.half_width)]
    ends = [np.array([np.full_like(y, end), y]) for end in (box.rear, box.front)]
    return np.concatenate([*sides, *ends], axis=1)


def _indices(places: Array, pose: Pose) -> tuple[Indices, Indices]:
    column, row = np.floor(placed_points(pose, places) / CELL).astype(np.int64)
    return column, row
