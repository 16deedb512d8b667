"""What judges random goals: its maps, its distances, its table."""

from __future__ import annotations

import math

import numpy as np
import pytest

from artemis.values import Pose
from artemis_lab.bench.floor_plans import CELL, CLOSET, LARGE, LARGE_MAPS, MAPS, SIZE, large_plan, small_plan
from artemis_lab.bench.goals import CellEdges, GoalDrive
from artemis_lab.commands.bench_goto import grid, problem, words


@pytest.mark.parametrize("kind", MAPS)
def test_a_map_has_walls_around_and_a_closet_without_a_door(kind: str) -> None:
    occupied = small_plan(kind, 3).occupied
    assert occupied.shape == (round(SIZE / CELL), round((SIZE + CLOSET) / CELL))
    assert occupied[:, round((SIZE - 0.1) / CELL)].all()
    assert occupied[[0, -1]].all()
    assert occupied[:, [0, -1]].all()
    assert np.array_equal(occupied, small_plan(kind, 3).occupied)
    assert small_plan(kind, 3).content.cells.max() == 100


@pytest.mark.parametrize("kind", LARGE_MAPS)
def test_a_large_map_has_walls_around_and_room_to_drive(kind: str) -> None:
    occupied = large_plan(kind, 3).occupied
    assert occupied.shape == (round(LARGE / CELL), round(LARGE / CELL))
    assert occupied[[0, -1]].all()
    assert occupied[:, [0, -1]].all()
    assert occupied.mean() < 0.1


def test_distances_are_those_of_the_rectangle() -> None:
    occupied = np.zeros((60, 60), bool)
    occupied[20, 40] = True  # from 2.00, 1.00 to 2.05, 1.05
    obstacles = CellEdges(occupied)
    assert obstacles.room(Pose(x=1.20, y=1.0)) == pytest.approx(2.00 - 1.20 - 0.68)
    assert obstacles.room(Pose(x=2.0, y=1.05 + 0.27 + 0.1)) == pytest.approx(0.1)
    assert obstacles.room(Pose(x=2.05 + 0.12 + 0.03, y=1.0)) == pytest.approx(0.03)
    assert obstacles.room(Pose(x=2.0, y=1.9, heading=-math.pi / 2)) == pytest.approx(0.17)
    assert obstacles.room(Pose(x=1.5, y=1.0)) < 0.0
    assert obstacles.room(Pose(x=0.5, y=2.5)) == 0.2  # farther does not matter


def leg(**keys: object) -> GoalDrive:
    given = {"map": "rooms", "seed": 1, "number": 1, "closed": False, "ended": "done", "plans": ["5 m"]}
    figures = {"seconds": [0.02], "expanded": [9], "room": 0.06, "nearest": 0.05, "off": 0.01, "turned": 0.01}
    return GoalDrive(**(given | figures | keys))  # type: ignore[arg-type]


def test_a_goal_counts_only_if_all_of_it_was_right() -> None:
    assert problem(leg()) == ""
    assert problem(leg(nearest=0.0)) == "contact"
    assert problem(leg(ended="no route", off=math.nan)) == "no route"
    assert problem(leg(room=0.04)) == "a route leads 4.0 cm from an obstacle"
    assert problem(leg(off=0.04)) == "4.0 cm and 0.6 degrees off"
    assert problem(leg(turned=0.06)) == "1.0 cm and 3.4 degrees off"
    assert problem(leg(closed=True, ended="no way", expanded=[0])) == ""
    assert problem(leg(closed=True, ended="no way", expanded=[7])) == "not reported at once"
    assert words(leg(nearest=0.0)) == "rooms 1, goal 1: contact; plans: 5 m"


def test_the_table_has_a_column_for_each_map_and_bars() -> None:
    legs = [leg(), leg(seconds=[0.3], turned=0.05), leg(map="lanes", ended="no route", off=math.nan)]
    legs.append(leg(closed=True, ended="no way", expanded=[0], seconds=[0.0]))
    rows = {row[0]: row[1:] for row in grid(legs).rows}
    assert rows["goals"] == ["0", "2", "1", "3", ""]
    assert rows["reached"] == ["0", "2", "0", "2", "all"]
    assert rows["plan, the slowest [ms CPU]"] == ["nan", "300", "nan", "300", "<= 200"]
    assert rows["off the goal, most [deg]"][1] == "2.9"
    assert rows["unreachable, reported at once"] == ["0 of 0", "1 of 1", "0 of 0", "1 of 1", "all"]


@pytest.mark.parametrize("kind", MAPS)
def test_scanners_see_the_edges_of_the_cells_that_are_judged(kind: str) -> None:
    plan = small_plan(kind, 3)
    far = 0.0
    for (x0, y0), (x1, y1) in plan.edges:
        assert (x0 == x1) != (y0 == y1)
        far += abs(x1 - x0) + abs(y1 - y0)
        middle = round((x0 + x1) / 2 / CELL - 0.01), round((y0 + y1) / 2 / CELL - 0.01)
        around = np.pad(plan.occupied, 1)[middle[1] : middle[1] + 2, middle[0] : middle[0] + 2]
        assert around.any()
        assert not around.all()
    framed = np.pad(plan.occupied, 1).astype(int)
    assert far == pytest.approx(CELL * sum(np.abs(np.diff(framed, axis=axis)).sum() for axis in (0, 1)))
