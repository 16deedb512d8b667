"""The inner loops of mapping, compiled. `kernels_numpy` has the same functions, and describes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from artemis.mapping.kernels_numpy import Cells, Numbers
from artemis.mapping.se2 import Array

_Function = TypeVar("_Function", bound=Callable[..., Any])
_compiled = cast(Callable[[_Function], _Function], numba.njit(cache=True, nogil=True))

FINE, COARSE = 4, 16
"""Cells per side of a block of the two upper levels."""
STEPS = 8
"""A point's place within its cell is known to so many steps per side."""


@_compiled
def surface_points(ranges: Array, angles: Array, nearest: float, farthest: float, spacing: float) -> Array:
    """See `kernels_numpy`."""
    n, m, last_x, last_y = len(ranges), 0, 1e9, 1e9
    step = abs(angles[n - 1] - angles[0]) / max(1, n - 1)
    out = np.empty((n, 4))
    xs, ys = ranges * np.cos(angles), ranges * np.sin(angles)
    for k in range(n):
        if not nearest < ranges[k] < farthest:
            continue
        x, y = xs[k], ys[k]
        if (x - last_x) ** 2 + (y - last_y) ** 2 < spacing * spacing:
            continue
        last_x, last_y = x, y
        sx = sy = sxx = sxy = syy = 0.0
        count, apart = 0, max(0.1, 4 * ranges[k] * step)
        for j in range(max(0, k - 3), min(n, k + 4)):
            if abs(ranges[j] - ranges[k]) < apart and nearest < ranges[j] < farthest:
                dx, dy = xs[j] - x, ys[j] - y
                sx, sy, count = sx + dx, sy + dy, count + 1
                sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
        nx = ny = 0.0
        if count >= 3:
            sxx, sxy, syy = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
            big = 0.5 * (sxx + syy + np.sqrt((sxx - syy) ** 2 + 4 * sxy * sxy))
            if sxx + syy - big < 0.1 * big:
                along = 0.5 * np.arctan2(2 * sxy, sxx - syy)
                nx, ny = -np.sin(along), np.cos(along)
        out[m, 0], out[m, 1], out[m, 2], out[m, 3] = x, y, nx, ny
        m += 1
    return out[:m].copy()


@_compiled
def place(points: Array, first: int, scan: Array, pose: Array) -> None:
    """See `kernels_numpy`."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(scan)):
        x, y, nx, ny = scan[i, 0], scan[i, 1], scan[i, 2], scan[i, 3]
        points[first + i, 0], points[first + i, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        points[first + i, 2], points[first + i, 3] = c * nx - s * ny, s * nx + c * ny


@_compiled
def stamp(field: Cells, owner: Numbers, points: Array, first: int, last: int, blot: Cells, per_metre: float) -> None:
    """See `kernels_numpy`. Most cells stay: a branch costs less here than writing each of them."""
    mask, side = field.shape[0] - 1, blot.shape[2]
    for i in range(first, last):
        gx, gy = points[i, 0] * per_metre + 0.5, points[i, 1] * per_metre + 0.5
        u, v = int(np.floor(gx)), int(np.floor(gy))
        kernel = blot[min(STEPS - 1, int((gy - v) * STEPS)), min(STEPS - 1, int((gx - u) * STEPS))]
        left, top = u - side // 2, v - side // 2
        for b in range(side):
            row = (top + b) & mask
            for a in range(side):
                column = (left + a) & mask
                if kernel[b, a] > field[row, column]:
                    field[row, column], owner[row, column] = kernel[b, a], i


@_compiled
def wipe(field: Cells, points: Array, count: int, radius: int, per_metre: float) -> None:
    """See `kernels_numpy`."""
    mask = field.shape[0] - 1
    for i in range(count):
        u, v = int(np.floor(points[i, 0] * per_metre + 0.5)), int(np.floor(points[i, 1] * per_metre + 0.5))
        left = (u - radius) & mask
        right = left + 2 * radius + 1
        for b in range(v - radius, v + radius + 1):
            field[b & mask, left:right] = 0
            if right > mask + 1:  # the rest is at the other edge
                field[b & mask, : right - mask - 1] = 0


@_compiled
def wipe_levels(fine: Cells, coarse: Cells, points: Array, count: int, radius: int, per_metre: float) -> None:
    """See `kernels_numpy`."""
    fine_mask, coarse_mask = fine.shape[0] - 1, coarse.shape[0] - 1
    for i in range(count):
        u, v = int(np.floor(points[i, 0] * per_metre + 0.5)), int(np.floor(points[i, 1] * per_metre + 0.5))
        for b in range((v - radius) // FINE - 1, (v + radius) // FINE + 1):
            for a in range((u - radius) // FINE - 1, (u + radius) // FINE + 1):
                fine[b & fine_mask, a & fine_mask] = 0
        for b in range((v - radius) // COARSE - 2, (v + radius) // COARSE + 1):
            for a in range((u - radius) // COARSE - 2, (u + radius) // COARSE + 1):
                coarse[b & coarse_mask, a & coarse_mask] = 0


@_compiled
def raise_levels(
    field: Cells, fine: Cells, coarse: Cells, points: Array, count: int, radius: int, per_metre: float
) -> None:
    """See `kernels_numpy`."""
    mask, fine_mask, coarse_mask = field.shape[0] - 1, fine.shape[0] - 1, coarse.shape[0] - 1
    ratio = COARSE // FINE
    for i in range(count):
        u, v = int(np.floor(points[i, 0] * per_metre + 0.5)), int(np.floor(points[i, 1] * per_metre + 0.5))
        for b in range((v - radius) // FINE - 1, (v + radius) // FINE + 1):
            for a in range((u - radius) // FINE - 1, (u + radius) // FINE + 1):
                if fine[b & fine_mask, a & fine_mask] > 0:
                    continue
                most = np.float32(0)
                for y in range(b * FINE, b * FINE + 2 * FINE):
                    for x in range(a * FINE, a * FINE + 2 * FINE):
                        most = max(most, field[y & mask, x & mask])
                fine[b & fine_mask, a & fine_mask] = most
                for cy in range(b // ratio - 1, b // ratio + 1):
                    for cx in range(a // ratio - 1, a // ratio + 1):
                        if most > coarse[cy & coarse_mask, cx & coarse_mask]:
                            coarse[cy & coarse_mask, cx & coarse_mask] = most


@_compiled
def _window(
    coarse: Cells, scan: Array, pose: Array, half: int, turns: int, turn: float, per_metre: float
) -> tuple[Numbers, Numbers, Cells]:
    """Column and row of each point in the first corner of the window, for each turn; and bounds of all blocks there."""
    n, mask, top = len(scan), coarse.shape[0] - 1, 2 * half // COARSE + 1
    across, along = np.empty((2 * turns + 1, n), np.int32), np.empty((2 * turns + 1, n), np.int32)
    bound = np.zeros((2 * turns + 1) * top * top, np.float32)
    for t in range(2 * turns + 1):
        heading = pose[2] + (t - turns) * turn
        c, s = np.cos(heading), np.sin(heading)
        for i in range(n):
            u = int(np.floor((pose[0] + c * scan[i, 0] - s * scan[i, 1]) * per_metre + 0.5)) - half
            v = int(np.floor((pose[1] + s * scan[i, 0] + c * scan[i, 1]) * per_metre + 0.5)) - half
            across[t, i], along[t, i] = u, v
            u, v = u // COARSE, v // COARSE
            for by in range(top):
                for bx in range(top):
                    bound[(t * top + by) * top + bx] += coarse[(v + by) & mask, (u + bx) & mask]
    return across, along, bound


@_compiled
def _total(level: Cells, block: int, along: Numbers, across: Numbers, up: int, right: int) -> np.float32:
    """Sum of a level's values for all points, shifted by so many blocks."""
    mask, total = level.shape[0] - 1, np.float32(0)
    for i in range(len(along)):
        total += level[(along[i] // block + up) & mask, (across[i] // block + right) & mask]
    return total


@_compiled
def _free(dx: int, dy: int, per_metre: float, left_out: Array) -> bool:
    x, y = dx / per_metre - left_out[0], dy / per_metre - left_out[1]
    return bool(x * x + y * y >= left_out[2] * left_out[2])


@_compiled
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
    """See `kernels_numpy`."""
    n, top, ratio = len(scan), 2 * half // COARSE + 1, COARSE // FINE
    across, along, bound = _window(coarse, scan, pose, half, turns, turn, per_metre)
    best, found, found_x, found_y = np.float32(floor * n), -1, 0, 0
    under = np.empty(ratio * ratio, np.float32)
    for k in np.argsort(-bound, kind="mergesort"):
        if bound[k] <= best:
            break
        t, by, bx = k // (top * top), ratio * ((k // top) % top), ratio * (k % top)
        turned = ((t - turns) / max(1, turns)) ** 2
        for q in range(ratio * ratio):
            up, right = by + q // ratio, bx + q % ratio
            inside = max(up, right) * FINE <= 2 * half
            under[q] = _total(fine, FINE, along[t], across[t], up, right) if inside else 0
        for q in np.argsort(-under, kind="mergesort"):
            if under[q] <= best:
                break
            up, right = FINE * (by + q // ratio), FINE * (bx + q % ratio)
            for leaf in range(FINE * FINE):
                dy, dx = up + leaf // FINE - half, right + leaf % FINE - half
                if max(dx, dy) > half or not _free(dx, dy, per_metre, left_out):
                    continue
                away = (dx**2 + dy**2) / max(1, half) ** 2
                total = _total(field, 1, along[t], across[t], dy + half, dx + half)
                total = np.float32(total - np.float32(prior * n * (turned + away)))
                if total > best:
                    best, found, found_x, found_y = total, t, dx, dy
    if found < 0:
        return -1.0, pose[0], pose[1], pose[2]
    score = float(best / n)
    return score, pose[0] + found_x / per_metre, pose[1] + found_y / per_metre, pose[2] + (found - turns) * turn


@_compiled
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
    """See `kernels_numpy`."""
    x, y, t = pose[0], pose[1], pose[2]
    mask, score = field.shape[0] - 1, 0.0
    told, pull, residual = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for _ in range(rounds):
        told[:], pull[:], score = 0, 0, 0.0
        c, s = np.cos(t), np.sin(t)
        for i in range(len(scan)):
            rx, ry = c * scan[i, 0] - s * scan[i, 1], s * scan[i, 0] + c * scan[i, 1]
            u, v = int(np.floor((x + rx) * per_metre + 0.5)) & mask, int(np.floor((y + ry) * per_metre + 0.5)) & mask
            value = field[v, u]
            if value <= 0:
                continue
            score += value
            q = owner[v, u]
            nx, ny = points[q, 2], points[q, 3]
            if nx == 0 and ny == 0:
                continue
            px, py = c * scan[i, 2] - s * scan[i, 3], s * scan[i, 2] + c * scan[i, 3]
            if (px != 0 or py != 0) and abs(nx * px + ny * py) < 0.8:
                continue
            d = nx * (x + rx - points[q, 0]) + ny * (y + ry - points[q, 1])
            w, lever = np.exp(-0.5 * (d / width) ** 2), ny * rx - nx * ry
            told[0, 0] += w * nx * nx
            told[0, 1] += w * nx * ny
            told[0, 2] += w * nx * lever
            told[1, 1] += w * ny * ny
            told[1, 2] += w * ny * lever
            told[2, 2] += w * lever * lever
            pull[0] -= w * nx * d
            pull[1] -= w * ny * d
            pull[2] -= w * lever * d
        told[1, 0], told[2, 0], told[2, 1] = told[0, 1], told[0, 2], told[1, 2]
        residual[0], residual[1] = expected[0] - x, expected[1] - y
        residual[2] = (expected[2] - t + np.pi) % (2 * np.pi) - np.pi
        change = np.linalg.solve(told + trust, pull + trust @ residual)
        x, y, t = x + change[0], y + change[1], t + change[2]
        if abs(change[0]) + abs(change[1]) < 2e-4 and abs(change[2]) < 1e-4:
            break
    return score / max(1, len(scan)), x, y, t, told


@_compiled
def count_rays(
    ends: Numbers, passes: Numbers, points: Array, begin: Array, per_metre: float, origin_x: float, origin_y: float
) -> None:
    """See `kernels_numpy`."""
    bx, by = (begin[0] - origin_x) * per_metre, (begin[1] - origin_y) * per_metre
    for i in range(len(points)):
        ex, ey = (points[i, 0] - origin_x) * per_metre, (points[i, 1] - origin_y) * per_metre
        n = max(1, int(np.ceil(max(abs(ex - bx), abs(ey - by)) - 1e-6)))
        for k in range(n):
            passes[int(by + (ey - by) * k / n), int(bx + (ex - bx) * k / n)] += 1
        ends[int(ey), int(ex)] += 1
