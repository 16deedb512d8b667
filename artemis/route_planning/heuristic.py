"""What the path from each cell of a floor to one of them costs: the heuristic of the search."""

from __future__ import annotations

import math

import numpy as np

from artemis.route_planning import kernels
from artemis.route_planning.floor import Field
from artemis.route_planning.kernels import compiled

FAR = 1e9


@compiled
def _cost_to_go(clear: Field, cost: Field, row: int, column: int, resolution: float, least: float) -> Field:
    """See `cost_to_go`. Dijkstra's algorithm with buckets (Dial 1969, doi 10.1145/363269.363610).

    A bucket is no wider than the shortest step: what is in the lowest one cannot become nearer any more.
    """
    rows, columns = clear.shape
    across = columns + 2  # with a border that cannot be passed
    price = np.full((rows + 2) * across, np.float32(np.inf), np.float32)
    for j in range(rows):
        for i in range(columns):
            if clear[j, i] >= least:
                price[(j + 1) * across + i + 1] = resolution * cost[j, i] / 2.0
    goal = (row + 1) * across + column + 1
    price[goal] = resolution * cost[row, column] / 2.0
    buckets, each = 1, 1.0 / (resolution * float(cost.min()))
    while buckets < 1.4142136 * resolution * float(cost.max()) * each + 3.0:
        buckets *= 2
    steps = np.array([1, -1, across, -across, across + 1, across - 1, 1 - across, -across - 1])
    found = np.full(len(price), np.float32(FAR), np.float32)
    newest, mask = np.full(buckets, -1, np.int64), buckets - 1
    cells, before = np.empty(2 * len(price), np.int32), np.empty(2 * len(price), np.int32)
    found[goal], cells[0], before[0], newest[0] = 0.0, goal, -1, 0
    made, waiting, number = 1, 1, 0
    while waiting:
        entry = newest[number & mask]
        if entry < 0:
            number += 1
            continue
        newest[number & mask] = before[entry]
        waiting -= 1
        cell = cells[entry]
        here, out = float(found[cell]), float(price[cell])
        if int(here * each) < number:
            continue  # it was nearer, and has been looked at
        for k in range(8):
            there = cell + steps[k]
            far = here + (out + price[there]) * (1.0 if k < 4 else 1.4142135)
            if far < found[there] - 1e-4:
                found[there] = far
                if made == len(cells):
                    cells, before = np.concatenate((cells, cells)), np.concatenate((before, before))
                place = int(float(found[there]) * each) & mask
                cells[made], before[made], newest[place] = there, newest[place], made
                made, waiting = made + 1, waiting + 1
    return found.reshape(rows + 2, across)[1:-1, 1:-1].copy()


def _cost_to_go_plain(clear: Field, cost: Field, row: int, column: int, resolution: float, least: float) -> Field:
    """See `cost_to_go`."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    passable, (rows, columns) = clear >= least, clear.shape
    passable[row, column] = True
    number, begins, ends, lengths = np.arange(rows * columns).reshape(rows, columns), [], [], []
    for dj, di in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = slice(0, rows - dj), slice(max(-di, 0), columns - max(di, 0))
        two = slice(dj, rows), slice(max(di, 0), columns + min(di, 0))
        both = passable[one] & passable[two]
        begins.append(number[one][both])
        ends.append(number[two][both])
        lengths.append(resolution * math.hypot(dj, di) * (cost[one] + cost[two])[both] / 2.0)
    places = np.concatenate(begins), np.concatenate(ends)
    graph = coo_array((np.concatenate(lengths), places), shape=(rows * columns, rows * columns)).tocsr()
    found = dijkstra(graph, directed=False, indices=row * columns + column)
    return np.asarray(np.minimum(found, FAR), np.float32).reshape(rows, columns)


def cost_to_go(clear: Field, cost: Field, row: int, column: int, resolution: float, least: float) -> Field:
    """What the path of a round robot from each cell to one of them costs [m]; `UNREACHABLE` or more: there is none.

    Args:
        clear: distance from each cell's middle to the nearest obstacle [m].
        cost: of a metre in each cell.
        row: of the goal.
        column: likewise.
        resolution: side of a cell [m].
        least: radius of the robot [m].
    """
    return (_cost_to_go if kernels.COMPILED else _cost_to_go_plain)(clear, cost, row, column, resolution, least)


UNREACHABLE = 0.9 * FAR
