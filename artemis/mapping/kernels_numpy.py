"""The inner loops of mapping, for where numba is not installed: the same functions, the same results, slower.

Grids wrap around: a world cell (column, row) is kept at its remainder by the number of cells per side, a power of two.
So a grid needs no origin, and what is in it may be as wide as the grid. Two upper levels hold for every block of `FINE`
and of `COARSE` cells the highest value of the 2 x 2 blocks from there: bounds for every shift that begins in the block.

Correlative matching with bounds: E. Olson, Real-time correlative scan matching, ICRA 2009; W. Hess et al., Real-time
loop closure in 2D LIDAR SLAM, ICRA 2016. Points to lines: A. Censi, An ICP variant using a point-to-line metric, 2008.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.se2 import Array

Cells: TypeAlias = NDArray[np.float32]
Numbers: TypeAlias = NDArray[np.int32]
Indices: TypeAlias = NDArray[np.int64]

FINE, COARSE = 4, 16
"""Cells per side of a block of the two upper levels."""
STEPS = 8
"""A point's place within its cell is known to so many steps per side."""
SAME_WALL = 0.8
"""Cosine of the angle between two normals from which on they may be of one surface."""
_AT_ONCE = 24
"""Blocks that are opened together: more waste work, fewer cost calls."""


def surface_points(ranges: Array, angles: Array, nearest: float, farthest: float, spacing: float) -> Array:
    """Where the beams of one scan end, and how the surface lies there.

    Args:
        ranges: [m], shape (n,); outside of `nearest` to `farthest`: no return.
        angles: of the beams [rad], evenly spaced, shape (n,).
        nearest: see `ranges`.
        farthest: see `ranges`.
        spacing: a point closer to the last one that was kept is left out [m].

    Returns:
        x, y [m] and the unit normal of the line through up to 7 neighbouring points, seen from the scanner, shape
        (m, 4). The normal is 0, 0 where they form no line.
    """
    n = len(ranges)
    step = abs(angles[-1] - angles[0]) / max(1, n - 1)
    x, y, good = ranges * np.cos(angles), ranges * np.sin(angles), (ranges > nearest) & (ranges < farthest)
    kept, last_x, last_y = [], 1e9, 1e9
    for k, px, py in zip(np.flatnonzero(good).tolist(), x[good].tolist(), y[good].tolist(), strict=True):
        if (px - last_x) ** 2 + (py - last_y) ** 2 >= spacing * spacing:
            kept.append(k)
            last_x, last_y = px, py
    if not kept:
        return np.empty((0, 4))
    centre = np.array(kept)
    beside = centre[:, None] + np.arange(-3, 4)
    there = (beside >= 0) & (beside < n)
    beside = beside.clip(0, n - 1)
    apart = np.maximum(0.1, 4 * ranges[centre] * step)[:, None]
    with np.errstate(invalid="ignore"):
        there &= good[beside] & (np.abs(ranges[beside] - ranges[centre][:, None]) < apart)
    dx, dy = (np.where(there, each[beside] - each[centre][:, None], 0.0) for each in (x, y))
    count, sx, sy = there.sum(1), dx.sum(1), dy.sum(1)
    sxx, sxy, syy = (
        (dx * dx).sum(1) - sx * sx / count,
        (dx * dy).sum(1) - sx * sy / count,
        (dy * dy).sum(1) - sy * sy / count,
    )
    big = 0.5 * (sxx + syy + np.sqrt((sxx - syy) ** 2 + 4 * sxy * sxy))
    line = (count >= 3) & (sxx + syy - big < 0.1 * big)
    along = 0.5 * np.arctan2(2 * sxy, sxx - syy)
    return np.stack([x[centre], y[centre], np.where(line, -np.sin(along), 0), np.where(line, np.cos(along), 0)], 1)


def place(points: Array, first: int, scan: Array, pose: Array) -> None:
    """Write a scan, seen from `pose`, to map points `first` and on: both are x, y [m] and normal, shape (n, 4)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    part = points[first : first + len(scan)]
    x, y, nx, ny = scan.T
    part[:, 0], part[:, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
    part[:, 2], part[:, 3] = c * nx - s * ny, s * nx + c * ny


def stamp(field: Cells, owner: Numbers, points: Array, first: int, last: int, blot: Cells, per_metre: float) -> None:
    """Add map points `first` to `last` (excluded): each cell keeps the highest value, and the point that gave it.

    Args:
        field: values, shape (cells, cells), changed.
        owner: numbers of points, likewise, changed.
        points: of the map: x, y [m] and normal, shape (>= last, 4).
        first: see above.
        last: see above.
        blot: values around a point, by its place in its cell (y, x), shape (STEPS, STEPS, size, size).
        per_metre: cells per metre.
    """
    part = points[first:last]
    gx, gy = part[:, 0] * per_metre + 0.5, part[:, 1] * per_metre + 0.5
    u, v = np.floor(gx).astype(np.int64), np.floor(gy).astype(np.int64)
    inside_y = np.minimum(STEPS - 1, ((gy - v) * STEPS).astype(np.int64))
    inside_x = np.minimum(STEPS - 1, ((gx - u) * STEPS).astype(np.int64))
    weight = blot[inside_y, inside_x].reshape(-1)
    cell = _footprints(u, v, blot.shape[2] // 2, field.shape[0]).reshape(-1)
    flat, flat_owner = field.reshape(-1), owner.reshape(-1)
    rising = weight > flat[cell]
    cell, weight = cell[rising], weight[rising]
    number = np.repeat(np.arange(first, last), blot.shape[2] ** 2)[rising]
    np.maximum.at(flat, cell, weight)
    won = weight == flat[cell]
    flat_owner[cell[won][::-1]] = number[won][::-1]  # of equal ones the first: a repeated index keeps what comes last


def wipe(field: Cells, points: Array, count: int, radius: int, per_metre: float) -> None:
    """Take the first `count` map points out of the field again; `radius` of their blots [cells]."""
    if count == 0:
        return
    u, v = (np.floor(points[:count, k] * per_metre + 0.5).astype(np.int64) for k in (0, 1))
    field.reshape(-1)[_footprints(u, v, radius, field.shape[0])] = 0


def wipe_levels(fine: Cells, coarse: Cells, points: Array, count: int, radius: int, per_metre: float) -> None:
    """Take them out of the two upper levels."""
    if count == 0:
        return
    u, v = (np.floor(points[:count, k] * per_metre + 0.5).astype(np.int64) for k in (0, 1))
    fine.reshape(-1)[_blocks(u, v, radius, FINE, fine.shape[0])] = 0
    coarse.reshape(-1)[_blocks(u, v, radius + FINE, COARSE, coarse.shape[0])] = 0  # a block of `fine` begins before it


def raise_levels(
    field: Cells, fine: Cells, coarse: Cells, points: Array, count: int, radius: int, per_metre: float
) -> None:
    """Fill the two upper levels from the field around the first `count` map points."""
    if count == 0:
        return
    size = fine.shape[0]
    u, v = (np.floor(points[:count, k] * per_metre + 0.5).astype(np.int64) for k in (0, 1))
    block = _blocks(u, v, radius, FINE, size)
    row, column = block // size, block % size
    reach = np.arange(2 * FINE)
    rows = (row[:, None] * FINE + reach) % field.shape[0]
    columns = (column[:, None] * FINE + reach) % field.shape[0]
    most = field[rows[:, :, None], columns[:, None, :]].max((1, 2))
    fine.reshape(-1)[block] = most
    ratio, mask = COARSE // FINE, coarse.shape[0] - 1
    for dy in (0, 1):
        for dx in (0, 1):
            np.maximum.at(coarse, ((row // ratio - dy) & mask, (column // ratio - dx) & mask), most)


def search(
    field: Cells,
    fine: Cells,
    coarse: Cells,
    scan: Array,
    pose: Array,
    half: int,
    turns: int,
    turn: float,
    per_metre: float,
    prior: float,
    floor: float,
    left_out: Array,
) -> tuple[float, float, float, float]:
    """The best pose of a scan in a window of shifts by whole cells and turns by whole steps. Exact: nothing is missed.

    Args:
        field: values of the cells.
        fine: its upper level.
        coarse: the next one.
        scan: points, seen from the robot: x, y [m], ..., shape (n, >= 2).
        pose: middle of the window, shape (3,).
        half: of the window, to each side [cells].
        turns: likewise [steps].
        turn: one step [rad].
        per_metre: cells per metre.
        prior: what a pose at the edge of the window has to be better by, in mean value.
        floor: only poses with a mean value above.
        left_out: a circle around x, y with a radius [m], seen from the middle of the window, in which no pose counts.

    Returns:
        Mean value of the cells in which the points lie, less the prior; and the pose. -1 and the middle: none is above.
    """
    n, span, ratio = len(scan), 2 * half, COARSE // FINE
    window = _Window(scan, pose, half, turns, turn, per_metre)
    bound, top = window.bounds(coarse), span // COARSE + 1
    best, found, inner = float(np.float32(floor * n)), (-1, 0, 0), np.arange(ratio * ratio)
    for block in _chunks(bound):
        block = block[bound[block] > best]
        if len(block) == 0:
            break
        t = np.repeat(block // (top * top), ratio * ratio)
        up = (ratio * ((block // top) % top)[:, None] + inner // ratio).reshape(-1)
        right = (ratio * (block % top)[:, None] + inner % ratio).reshape(-1)
        inside = np.maximum(up, right) * FINE <= span
        t, up, right = t[inside], up[inside], right[inside]
        under = window.totals(fine, FINE, t, up, right)
        for chosen in _chunks(under):
            chosen = chosen[under[chosen] > best]
            if len(chosen) == 0:
                break
            total, *place = window.leaves(field, t[chosen], up[chosen], right[chosen], prior, left_out)
            k = int(total.argmax())
            if total[k] > best:
                best, found = float(total[k]), (int(place[0][k]), int(place[1][k]), int(place[2][k]))
    if found[0] < 0:
        return -1.0, pose[0], pose[1], pose[2]
    turned, x, y = found
    return best / n, pose[0] + x / per_metre, pose[1] + y / per_metre, pose[2] + (turned - turns) * turn


class _Window:
    """Column and row of each point of a scan in the first corner of a search window, for each turn."""

    def __init__(self, scan: Array, pose: Array, half: int, turns: int, turn: float, per_metre: float) -> None:
        self._n, self._half, self._turns, self._per_metre = len(scan), half, turns, per_metre
        heading = pose[2] + (np.arange(2 * turns + 1) - turns) * turn
        c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
        x, y = pose[0] + c * scan[:, 0] - s * scan[:, 1], pose[1] + s * scan[:, 0] + c * scan[:, 1]
        self._across, self._along = (np.floor(each * per_metre + 0.5).astype(np.int64) - half for each in (x, y))

    def totals(self, level: Cells, block: int, t: Indices, up: Indices, right: Indices) -> Cells:
        """Sums of a level's values for turns `t` and shifts by so many blocks, shape (k,)."""
        mask = level.shape[0] - 1
        rows = (self._along[t] // block + up[:, None]) & mask
        columns = (self._across[t] // block + right[:, None]) & mask
        return np.asarray(level[rows, columns].sum(1, dtype=np.float32))

    def bounds(self, coarse: Cells) -> Cells:
        """Of all blocks for all turns."""
        top = 2 * self._half // COARSE + 1
        block = np.arange(top * top)
        every = [
            self.totals(coarse, COARSE, np.full(top * top, t), block // top, block % top)
            for t in range(2 * self._turns + 1)
        ]
        return np.concatenate(every)

    def leaves(
        self, field: Cells, t: Indices, up: Indices, right: Indices, prior: float, left_out: Array
    ) -> tuple[Cells, Indices, Indices, Indices]:
        """Values of all cells in blocks of the level `fine`, less the prior: and their turns, dx, dy."""
        half, inner = self._half, np.arange(FINE * FINE)
        t = np.repeat(t, FINE * FINE)
        dy = (FINE * up[:, None] + inner // FINE).reshape(-1) - half
        dx = (FINE * right[:, None] + inner % FINE).reshape(-1) - half
        cost = ((t - self._turns) / max(1, self._turns)) ** 2 + (dx**2 + dy**2) / max(1, half) ** 2
        total = self.totals(field, 1, t, dy + half, dx + half) - (prior * self._n * cost).astype(np.float32)
        x, y = dx / self._per_metre - left_out[0], dy / self._per_metre - left_out[1]
        total[(np.maximum(dx, dy) > half) | (x * x + y * y < left_out[2] ** 2)] = -np.inf
        return total, t, dx, dy


def _chunks(bound: Cells) -> Iterator[Indices]:
    """Numbers of the blocks, the best first, some at a time."""
    order = np.argsort(-bound, kind="stable")
    return (order[start : start + _AT_ONCE] for start in range(0, len(order), _AT_ONCE))


def refine(
    field: Cells,
    owner: Numbers,
    points: Array,
    scan: Array,
    pose: Array,
    per_metre: float,
    rounds: int,
    width: float,
    expected: Array,
    trust: Array,
) -> tuple[float, float, float, float, Array]:
    """Gauss-Newton on the distances of a scan's points from the lines through the nearest map points.

    Args:
        field: values of the cells.
        owner: the map point that is nearest to each cell.
        points: of the map, shape (m, 4).
        scan: points and normals, seen from the robot, shape (n, 4).
        pose: to begin with, shape (3,).
        per_metre: cells per metre.
        rounds: at most.
        width: a distance d weighs exp(-d²/2 width²) [m].
        expected: another opinion on the pose, shape (3,).
        trust: its information, in units of a beam's, shape (3, 3).

    Returns:
        Mean value of the cells in which the points lie, x, y, heading, and the information that the beams gave, for
        beams with a standard deviation of 1 m, in the frame of the map: shape (3, 3).
    """
    x, y, t = float(pose[0]), float(pose[1]), float(pose[2])
    mask, score, told = field.shape[0] - 1, 0.0, np.zeros((3, 3))
    px, py, qx, qy = scan.T
    has_normal = (qx != 0) | (qy != 0)
    for _ in range(rounds):
        c, s = np.cos(t), np.sin(t)
        rx, ry = c * px - s * py, s * px + c * py
        u = np.floor((x + rx) * per_metre + 0.5).astype(np.int64) & mask
        v = np.floor((y + ry) * per_metre + 0.5).astype(np.int64) & mask
        value = field[v, u]
        score = float(value.sum(dtype=float))
        near = points[owner[v, u]]
        nx, ny = near[:, 2], near[:, 3]
        alike = np.abs(nx * (c * qx - s * qy) + ny * (s * qx + c * qy)) >= SAME_WALL
        used = (value > 0) & ((nx != 0) | (ny != 0)) & (alike | ~has_normal)
        d = nx * (x + rx - near[:, 0]) + ny * (y + ry - near[:, 1])
        w = np.where(used, np.exp(-0.5 * (d / width) ** 2), 0.0)
        rows = np.stack([nx, ny, ny * rx - nx * ry])
        told = (rows * w) @ rows.T
        residual = np.array([expected[0] - x, expected[1] - y, (expected[2] - t + np.pi) % (2 * np.pi) - np.pi])
        change = np.linalg.solve(told + trust, -(rows @ (w * d)) + trust @ residual)
        x, y, t = x + change[0], y + change[1], t + change[2]
        if abs(change[0]) + abs(change[1]) < 2e-4 and abs(change[2]) < 1e-4:
            break
    return score / max(1, len(scan)), x, y, t, told


def count_rays(
    ends: Numbers, passes: Numbers, points: Array, begin: Array, per_metre: float, origin_x: float, origin_y: float
) -> None:
    """Count for every cell the beams that end in it, and those that pass through it. Both are changed.

    Args:
        ends: shape (rows, columns).
        passes: likewise.
        points: where the beams end, in the frame of the map [m], shape (n, 2).
        begin: where they begin: the scanner's place, likewise, shape (>= 2,).
        per_metre: cells per metre.
        origin_x: of the corner of cell 0, 0 [m].
        origin_y: likewise.
    """
    ex, ey = (points[:, 0] - origin_x) * per_metre, (points[:, 1] - origin_y) * per_metre
    bx, by = (begin[0] - origin_x) * per_metre, (begin[1] - origin_y) * per_metre
    n = np.maximum(1, np.ceil(np.maximum(np.abs(ex - bx), np.abs(ey - by)) - 1e-6)).astype(np.int64)
    ray = np.repeat(np.arange(len(points)), n)
    k = np.arange(len(ray)) - np.repeat(np.cumsum(n) - n, n)
    row = (by + (ey - by)[ray] * k / n[ray]).astype(np.int64)
    column = (bx + (ex - bx)[ray] * k / n[ray]).astype(np.int64)
    np.add.at(passes, (row, column), 1)
    np.add.at(ends, (ey.astype(np.int64), ex.astype(np.int64)), 1)


def _footprints(u: Indices, v: Indices, radius: int, size: int) -> Indices:
    """Flat numbers of the cells around each cell, shape (n, (2 radius + 1)²)."""
    reach = np.arange(-radius, radius + 1)
    rows, columns = (v[:, None] + reach) & (size - 1), (u[:, None] + reach) & (size - 1)
    return (rows[:, :, None] * size + columns[:, None, :]).reshape(len(u), len(reach) ** 2)


def _blocks(u: Indices, v: Indices, radius: int, block: int, size: int) -> Indices:
    """Flat numbers of the blocks whose bounds the cells around (u, v) may raise, each once."""
    low_x, low_y = (u - radius) // block - 1, (v - radius) // block - 1
    high_x, high_y = (u + radius) // block, (v + radius) // block
    raised = np.zeros(size * size, bool)
    for dy in range(int((high_y - low_y).max()) + 1):
        for dx in range(int((high_x - low_x).max()) + 1):
            row, column = np.minimum(low_y + dy, high_y), np.minimum(low_x + dx, high_x)
            raised[(row & (size - 1)) * size + (column & (size - 1))] = True
    return np.flatnonzero(raised)
