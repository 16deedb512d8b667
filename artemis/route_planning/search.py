"""Hybrid A* on a grid: poses of a car, expanded by short arcs, with the path of a point robot as heuristic.

After D. Dolgov, S. Thrun, M. Montemerlo and J. Diebel, Practical search techniques in path planning for autonomous
driving, AAAI workshop 2008. All lengths in metres, in the frame of the grid: cell (row, column) reaches from
(column, row) * resolution to the next.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from artemis.route_planning.curves import TURN, Array, rolled, shortest, wrapped
from artemis.route_planning.floor import Cells, Field
from artemis.route_planning.heuristic import FAR, UNREACHABLE
from artemis.route_planning.kernels import compiled

Nodes = tuple[Array, Array, Array, Array, NDArray[np.int8], NDArray[np.int64], Array, Array]
"""Poses, what was spent to them, the distance driven, the curvature, the direction, the pose before; how far the robot
comes there backwards in one piece, and how much of what it drove forwards is behind it still."""
Table = tuple[NDArray[np.int64], NDArray[np.float32]]
"""Cells that were reached, and at what cost."""

HEADINGS, SQUARE = 72, 0.10
"""Poses whose headings lie in the same of so many sectors, and which lie in the same square of this side [m], count as
the same."""
STEP, PIECES = 0.15, 3
"""Length of an arc [m], and in how many places it is looked whether the outline is free."""
CURVATURES = 5
"""From hard right to hard left."""
BACK, CUSP, TURNING = 2.0, 0.5, 0.05
"""A length driven backwards costs so many times as much, at least; a change of direction so much [m]; steering from
straight to the limit so much [m]."""
GREEDY_BACK = 0.5
"""Backwards a length costs by at least so much more than the heuristic counts: else a greedy search would drive
backwards rather than turn."""
NARROW = 2.5
"""A length with less room around the outline than is wanted costs so many times as much."""
SHORTEST = 0.1
"""Between two changes of direction, and before the goal [m]."""
NEAR = 0.6
"""So near the goal [m] each pose is joined to it by a curve if that is free; farther away only some."""
SPACING = 0.05
"""Of the points of a route [m]."""
AT_GOAL = 0.01
"""A curve that ends farther from the goal [m] is none."""
FINEST = 0.01
"""Pieces of the outline are not divided below this radius [m]."""
FIRST = 1.0
"""So much of the distance counts as its beginning [m], and so near the goal a curve to it as its end."""
BEHIND, MOST_BACK = 2.0, 1.0
"""Of what was driven forwards on the route, so much is known well enough to be driven back over [m], in pieces of so
much [m]: they may bend otherwise."""
FOUND, NO_WAY, TOO_LONG = 0, 1, 2
MOST_POINTS = 20_000


@compiled
def is_free(x: float, y: float, heading: float, clear: Field, resolution: float, box: Array, stack: Array) -> bool:
    """Whether the outline at a pose is free of obstacles, and within the grid.

    The rectangle is divided until each piece lies in a circle that is free by the distance at its middle, or is so
    small that the cell at its middle says it: a corner may reach into an obstacle by `FINEST`.

    Args:
        x: of the centre of the rear axle.
        y: likewise.
        heading: [rad].
        clear: distance from each cell's middle to the nearest obstacle, at most the true one; 0 only within.
        resolution: side of a cell.
        box: front, rear (negative behind the axle) and half width of the outline.
        stack: room for pieces, shape (64, 4).
    """
    rows, columns = clear.shape
    c, s = math.cos(heading), math.sin(heading)
    stack[0, 0], stack[0, 1] = (box[0] + box[1]) / 2.0, 0.0
    stack[0, 2], stack[0, 3] = (box[0] - box[1]) / 2.0, box[2]
    left = 1
    while left:
        left -= 1
        u, v, a, b = stack[left, 0], stack[left, 1], stack[left, 2], stack[left, 3]
        px, py = (x + u * c - v * s) / resolution, (y + u * s + v * c) / resolution
        column, row = math.floor(px), math.floor(py)
        if column < 0 or row < 0 or column >= columns or row >= rows:
            return False
        off = resolution * math.hypot(px - column - 0.5, py - row - 0.5)
        free, radius = clear[row, column] - off, math.hypot(a, b)
        if free >= radius:
            continue
        if clear[row, column] == 0.0:
            return False
        if radius <= FINEST:
            continue
        if a >= b:
            first_u, first_v, a = u - a / 2.0, v, a / 2.0
        else:
            first_u, first_v, b = u, v - b / 2.0, b / 2.0
        stack[left, 0], stack[left, 1], stack[left, 2], stack[left, 3] = first_u, first_v, a, b
        stack[left + 1, 0], stack[left + 1, 1] = 2.0 * u - first_u, 2.0 * v - first_v
        stack[left + 1, 2], stack[left + 1, 3] = a, b
        left += 2
    return True


@compiled
def are_free(poses: Array, clear: Field, resolution: float, box: Array) -> Cells:
    """Whether the outline is free at each pose, shape (n, 3): as of `is_free`."""
    free, stack = np.empty(len(poses), np.bool_), np.empty((64, 4))
    for n in range(len(poses)):
        free[n] = is_free(poses[n, 0], poses[n, 1], poses[n, 2], clear, resolution, box, stack)
    return free


@compiled
def _slot(keys: NDArray[np.int64], key: int) -> int:
    """Where a key is in a table of hashes, or would be; empty places hold -1. Its size is a power of two."""
    mask = len(keys) - 1
    place = ((key * 2654435761) >> 7) & mask
    while keys[place] != -1 and keys[place] != key:
        place = (place + 1) & mask
    return place


@compiled
def _key(x: float, y: float, heading: float, columns: int) -> int:
    """The number of a pose: poses that count as the same have the same.

    Args:
        x: of the pose, 0 or more.
        y: likewise.
        heading: [rad].
        columns: at least as many as there are squares in a row.
    """
    square = int(y / SQUARE) * columns + int(x / SQUARE)
    return square * HEADINGS + int(heading % TURN / TURN * HEADINGS) % HEADINGS


@compiled
def _left(to_go: Field, x: float, y: float, heading: float, ahead: float, resolution: float) -> float:
    """What is left to go from a pose, by the point so far ahead of it."""
    column, row = (x + ahead * math.cos(heading)) / resolution, (y + ahead * math.sin(heading)) / resolution
    return float(to_go[int(row), int(column)])


@compiled
def search(
    clear: Field, begun: Field, cost: Field, to_go: Field, start: Array, goal: Array, box: Array, first_box: Array,
    wide: Array, known: Field, bare: Array, radius: float, resolution: float, most: int, sense: float, greedy: float,
) -> tuple[Array, int, int]:  # fmt: skip
    """A route of a car from pose to pose.

    Args:
        clear: distance from each cell's middle to the nearest obstacle.
        begun: the same in the first metre, where what the outline covers at the start does not count.
        cost: of a metre in each cell.
        to_go: as of `heuristic.cost_to_go` for the goal, of the point on the outline's middle line that is half a width
            ahead of its rear.
        start: x, y, heading of the centre of the rear axle.
        goal: likewise.
        box: front, rear (negative behind the axle) and half width of the outline.
        first_box: in the first metre.
        wide: outline with as much room as is wanted.
        known: distance from each cell's middle to the nearest cell of unknown ground, see `_went`.
        bare: outline that counts there.
        radius: least one of the rear axle's path.
        resolution: side of a cell.
        most: poses that are expanded.
        sense: -1: the route leads from the goal to the start; what costs more is then forwards here.
        greedy: the heuristic counts so many times.

    Returns:
        Points about `SPACING` apart as they are driven (x, y, heading, direction: 1 forwards, -1 backwards), shape
        (n, 4); `FOUND` or why not; how many poses were expanded.
    """
    columns, ahead, stack, word = clear.shape[1], box[1] + box[2], np.empty((64, 4)), np.zeros(6)
    back = BACK if sense > 0.0 else 1.0 / BACK
    prices = np.array([back, CUSP / radius * min(back, 1.0), SHORTEST / radius])
    room, size = 6 * most + 16, 2 ** int(math.log2(12 * most + 32) + 1.0)
    poses, spent, driven = np.empty((room, 3)), np.empty(room), np.empty(room)
    steered, direction, parent = np.empty(room), np.empty(room, np.int8), np.empty(room, np.int64)
    backed, behind = np.zeros(room), np.full(room, bare[1] - bare[0] if sense > 0.0 else BEHIND)
    keys, best, count, expanded = np.full(size, -1, np.int64), np.empty(size, np.float32), 1, 0
    poses[0], spent[0], driven[0], steered[0], direction[0], parent[0] = start, 0.0, 0.0, 0.0, 0, -1
    nodes, heap = (poses, spent, driven, steered, direction, parent, backed, behind), [(0.0, 0)]
    while heap and expanded < most and count + 2 * CURVATURES < room:
        _, number = heappop(heap)
        x, y, heading = poses[number, 0], poses[number, 1], poses[number, 2]
        place = _slot(keys, _key(x, y, heading, columns))
        if keys[place] != -1 and spent[number] > best[place] + 1e-4:
            continue
        expanded, left = expanded + 1, _left(to_go, x, y, heading, ahead, resolution)
        if left < NEAR or expanded % max(1, int(left * left)) == 0:
            c, s, dx, dy = math.cos(heading), math.sin(heading), goal[0] - x, goal[1] - y
            turn = wrapped(goal[2] - heading)
            shortest((c * dx + s * dy) / radius, (c * dy - s * dx) / radius, turn, direction[number], prices, word)
            midway = box if left < NEAR else wide
            if _joins(poses[number], driven[number], backed[number], behind[number], (clear, begun, known), goal, box,
                      first_box, midway, bare, radius, resolution, word, stack, sense):  # fmt: skip
                route = _route(poses, steered, direction, parent, number, word, radius, sense)
                if sense > 0.0 or is_known(route, known, resolution, bare):
                    return route, FOUND, expanded
        count = _expand(number, count, nodes, (keys, best), heap, (clear, begun, cost, to_go, known), box, first_box,
                        wide, bare, radius, resolution, stack, sense, greedy)  # fmt: skip
    return np.empty((0, 4)), (TOO_LONG if heap else NO_WAY), expanded


@compiled
def _went(step: float, backed: float, behind: float) -> tuple[float, float]:
    """Distance reversed without a break, and length of the path behind that was driven forwards, after a step [m].

    Where the latter is negative, or the former above `MOST_BACK`, the robot may reverse over known ground only. At its
    start a robot has not seen what is beside it, so the latter starts at minus its length. A search from the goal
    takes the steps in the opposite order, and counts down from `BEHIND` what has to be driven forwards before them;
    `is_known` judges the route that it finds.
    """
    if step >= 0.0:
        return 0.0, min(behind + step, BEHIND)
    return backed - step, behind + step


@compiled
def is_known(points: Array, known: Field, resolution: float, bare: Array) -> bool:
    """Whether a route (points as `search` gives them) leads backwards over known ground only, as of `search`."""
    backed, behind, stack = 0.0, bare[1] - bare[0], np.empty((64, 4))
    for n in range(1, len(points)):
        step = points[n, 3] * math.hypot(points[n, 0] - points[n - 1, 0], points[n, 1] - points[n - 1, 1])
        backed, behind = _went(step, backed, behind)
        if step < 0.0 and (backed > MOST_BACK + 1e-6 or behind < 0.0):
            if not is_free(points[n, 0], points[n, 1], points[n, 2], known, resolution, bare, stack):
                return False
        behind = max(behind, bare[1] - bare[0])
    return True


@compiled
def _expand(  # a call for each arc would cost a third of its time
    number: int, count: int, nodes: Nodes, table: Table, heap: list[tuple[float, int]],
    fields: tuple[Field, Field, Field, Field, Field], box: Array, first_box: Array, wide: Array, bare: Array,
    radius: float, resolution: float, stack: Array, sense: float, greedy: float,
) -> int:  # fmt: skip
    """Add the ends of all free arcs from a pose that are better than what led there before; how many poses then."""
    poses, spent, driven, steered, direction, parent, backed, behind = nodes
    (keys, best), (clear, begun, cost, to_go, known) = table, fields
    (rows, columns), ahead, arc = clear.shape, box[1] + box[2], np.empty((PIECES, 3))
    x, y, heading = poses[number, 0], poses[number, 1], poses[number, 2]
    for drive in (1, -1):
        back, left_behind = _went(sense * drive * STEP, backed[number], behind[number])
        has_to_be_known = sense * drive < 0 and (back > MOST_BACK + 1e-6 or left_behind < 0.0)
        for choice in range(CURVATURES):
            bend = (2.0 * choice / (CURVATURES - 1) - 1.0) / radius
            nx, ny, nh = x, y, heading
            for piece in range(PIECES):
                nx, ny, nh = rolled(nx, ny, nh, drive * STEP / PIECES, bend)
                arc[piece, 0], arc[piece, 1], arc[piece, 2] = nx, ny, nh
            row, column = math.floor(ny / resolution), math.floor(nx / resolution)
            if row < 0 or column < 0 or row >= rows or column >= columns:
                continue
            key = _key(nx, ny, nh, columns)
            place = _slot(keys, key)
            step = STEP * (max(BACK, greedy + GREEDY_BACK) if sense * drive < 0 else 1.0) * cost[row, column]
            before = spent[number] + TURNING * abs(bend - steered[number]) * radius
            before += CUSP if direction[number] * drive < 0 else 0.0
            if keys[place] == key and before + step >= best[place] - 1e-4:
                continue  # also where there is room
            free, narrow = True, False
            for piece in range(PIECES):
                px, py, ph = arc[piece, 0], arc[piece, 1], arc[piece, 2]
                first = driven[number] + (piece + 1) * STEP / PIECES < FIRST
                field, outline = (begun, first_box) if first else (clear, box)
                narrow = narrow or not is_free(px, py, ph, clear, resolution, wide, stack)
                if narrow and not is_free(px, py, ph, field, resolution, outline, stack):
                    free = False
                    break
                if has_to_be_known and not is_free(px, py, ph, known, resolution, bare, stack):
                    free = False
                    break
            left = _left(to_go, nx, ny, nh, ahead, resolution) if free else FAR
            if left > UNREACHABLE:
                continue
            price = before + step * (NARROW if narrow else 1.0)
            if keys[place] == key and price >= best[place] - 1e-4:
                continue
            keys[place], best[place] = key, price
            poses[count, 0], poses[count, 1], poses[count, 2] = nx, ny, nh
            spent[count], driven[count], steered[count] = price, driven[number] + STEP, bend
            direction[count], parent[count] = drive, number
            backed[count], behind[count] = back, max(left_behind, bare[1] - bare[0])
            heappush(heap, (price + greedy * left, count))
            count += 1
    return count


@compiled
def _joins(
    pose: Array, driven: float, backed: float, behind: float, fields: tuple[Field, Field, Field], goal: Array,
    box: Array, first_box: Array, midway: Array, bare: Array, radius: float, resolution: float, word: Array,
    stack: Array, sense: float,
) -> bool:  # fmt: skip
    """Whether a word leads from a pose to the goal, the outline always free: `midway` but for the first and last metre.

    Where there is less room a length costs more, which a word does not count.
    """
    clear, begun, known = fields
    x, y, heading = pose[0], pose[1], pose[2]
    for piece in range(3):
        length, bend = abs(word[piece]) * radius, word[3 + piece] / radius
        parts = int(length / SPACING) + 1
        step = (1.0 if word[piece] >= 0.0 else -1.0) * length / parts
        for _ in range(parts):
            x, y, heading = rolled(x, y, heading, step, bend)
            driven += abs(step)
            first, last = driven < FIRST, math.hypot(goal[0] - x, goal[1] - y) < FIRST
            field, outline = (begun, first_box) if first else (clear, box if last else midway)
            if not is_free(x, y, heading, field, resolution, outline, stack):
                return False
            backed, behind = _went(sense * step, backed, behind)
            has_to_be_known = sense * step < -1e-9 and (backed > MOST_BACK + 1e-6 or behind < 0.0)
            if has_to_be_known and not is_free(x, y, heading, known, resolution, bare, stack):
                return False
            behind = max(behind, bare[1] - bare[0])
    return math.hypot(x - goal[0], y - goal[1]) < AT_GOAL


@compiled
def _route(
    poses: Array, steered: Array, direction: NDArray[np.int8], parent: NDArray[np.int64], last: int, shot: Array,
    radius: float, sense: float,
) -> Array:  # fmt: skip
    """The points from the first pose to the last one, and of the word from there, in the order they are driven in."""
    order = np.empty(len(parent), np.int64)
    count, number = 0, last
    while number >= 0:
        order[count] = number
        count, number = count + 1, parent[number]
    route = np.empty((MOST_POINTS, 4))
    route[0, :3], route[0, 3] = poses[order[count - 1]], 0.0
    made = 1
    for place in range(count - 2, -1, -1):
        number = order[place]
        made = _add(route, made, direction[number] * STEP, steered[number])
    for piece in range(3):
        made = _add(route, made, shot[piece] * radius, shot[3 + piece] / radius)
    if made > 1:
        route[0, 3] = route[1, 3]
    return route[:made].copy() if sense > 0.0 else _turned_round(route[:made])


@compiled
def _turned_round(points: Array) -> Array:
    """A route driven from its last pose to its first."""
    back = points[::-1].copy()
    if len(back) > 1:
        back[1:, 3] = -points[:0:-1, 3]
        back[0, 3] = back[1, 3]
    return back


@compiled
def _add(route: Array, made: int, length: float, bend: float) -> int:
    """Continue by an arc; how many points there are then."""
    parts = int(abs(length) / SPACING + 0.5)
    if parts == 0 and abs(length) > 1e-6:
        parts = 1
    for _ in range(min(parts, len(route) - made)):
        step = length / parts
        route[made, 0], route[made, 1], route[made, 2] = rolled(
            route[made - 1, 0], route[made - 1, 1], route[made - 1, 2], step, bend
        )
        route[made, 3] = 1.0 if step > 0.0 else -1.0
        made += 1
    return made
