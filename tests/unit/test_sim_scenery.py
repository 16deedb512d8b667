"""What simulated beams meet: against plain geometry, one beam at a time."""

from __future__ import annotations

from math import cos, hypot, inf, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError

from artemis.mapping.occupancy import FREE, OCCUPIED, OccupancyMap
from artemis.sim.grid import MapGrid
from artemis.sim.scenery import HALL, Crate, Person, Pole, Scenery, Surroundings2D, Wall


def seen(scenery: Scenery, x: float, y: float, *degrees: float, time: float = 0.0) -> NDArray[np.float64]:
    beams = len(degrees)
    heading = np.radians(np.array(degrees))
    return Surroundings2D(scenery).seen(np.full(beams, x), np.full(beams, y), heading, time).distance


def test_the_hall_that_stands_in_for_nothing() -> None:
    assert seen(HALL, 0, 0, 0, 90, 180, 270, 45) == pytest.approx([8, 8, 8, 8, 8 * 2**0.5])
    assert seen(HALL, 3, -2, 0, 90, 180, 270) == pytest.approx([5, 10, 11, 6])


def test_nothing_is_infinitely_far() -> None:
    assert seen(Scenery(), 0, 0, 0, 90).tolist() == [inf, inf]
    wall = Scenery(walls=(Wall(points=((1.0, 1.0), (1.0, 2.0))),))
    assert seen(wall, 0, 0, 0, 180).tolist() == [inf, inf], "beside it, and behind"


def test_a_box_has_four_sides() -> None:
    box = Scenery(boxes=(Crate(x_m=3.0, y_m=0.0, length_m=2.0, width_m=1.0),))
    assert seen(box, 0, 0, 0).tolist() == [2.0]
    assert seen(box, 3, 5, 270).tolist() == [4.5]
    assert seen(box, 9, 0, 180).tolist() == [5.0]
    turned = Scenery(boxes=(Crate(x_m=3.0, y_m=0.0, length_m=2.0, width_m=1.0, heading_deg=90.0),))
    assert seen(turned, 0, 0, 0) == pytest.approx([2.5])


def test_a_pole_is_round_and_the_nearest_is_seen() -> None:
    poles = Scenery(poles=(Pole(x_m=2.0, y_m=0.0, diameter_m=0.2), Pole(x_m=4.0, y_m=0.0, diameter_m=1.0)))
    assert seen(poles, 0, 0, 0, 180) == pytest.approx([1.9, inf])
    assert seen(poles, 3, 0, 0, 180) == pytest.approx([0.5, 0.9])


def test_things_come_and_go() -> None:
    pole = Scenery(poles=(Pole(x_m=2.0, y_m=0.0, diameter_m=0.2, from_s=5.0, until_s=7.0),))
    assert [seen(pole, 0, 0, 0, time=time)[0] for time in (4.9, 5.0, 6.9, 7.0)] == pytest.approx([inf, 1.9, 1.9, inf])


def test_a_person_walks_and_stands() -> None:
    person = Scenery(persons=(Person(path=((1.0, 2.0, 0.0), (3.0, 6.0, 0.0)), diameter_m=0.4),))
    assert [seen(person, 0, 0, 0, time=time)[0] for time in (0.0, 2.0, 9.0)] == pytest.approx([1.8, 3.8, 5.8])
    again = Scenery(persons=(Person(path=((1.0, 2.0, 0.0), (3.0, 6.0, 0.0)), diameter_m=0.4, repeat=True),))
    assert seen(again, 0, 0, 0, time=4.0) == pytest.approx([3.8])
    gone = Scenery(persons=(Person(path=((0.0, 2.0, 0.0),), until_s=1.0),))
    assert [seen(gone, 0, 0, 0, time=time)[0] for time in (0.5, 1.0)] == pytest.approx([1.85, inf])


def test_a_person_does_not_walk_back_in_time() -> None:
    with pytest.raises(ValidationError, match="expected times that grow"):
        Person(path=((1.0, 2.0, 0.0), (1.0, 6.0, 0.0)))


def test_surface_and_angle_are_known() -> None:
    wall = Surroundings2D(Scenery(walls=(Wall(points=((2.0, -5.0), (2.0, 5.0)), surface="shiny"),)))
    sight = wall.seen(np.zeros(2), np.zeros(2), np.radians([0.0, 60.0]), 0.0)
    assert sight.surface.tolist() == [2, 2]
    assert sight.square == pytest.approx([1.0, 0.5])
    pole = Surroundings2D(Scenery(poles=(Pole(x_m=2.0, y_m=0.05, diameter_m=0.2, surface="dark"),)))
    sight = pole.seen(np.zeros(1), np.zeros(1), np.zeros(1), 0.0)
    assert sight.surface.tolist() == [1]
    assert sight.square == pytest.approx([0.75**0.5])


near = st.floats(-5, 5)


@given(near, near, near, near, st.floats(-180, 180))
def test_a_wall_is_met_where_the_lines_cross(ax: float, ay: float, bx: float, by: float, degrees: float) -> None:
    """By the signed area of the triangles, not by the formula of the code."""
    distance = seen(Scenery(walls=(Wall(points=((ax, ay), (bx, by))),)), 0, 0, degrees)[0]
    if not distance < inf:
        return
    x, y = distance * cos(radians(degrees)), distance * sin(radians(degrees))
    length = hypot(bx - ax, by - ay)
    beside = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    assert abs(beside) <= 1e-6 * max(1.0, length) * max(1.0, distance)
    assert hypot(x - ax, y - ay) + hypot(x - bx, y - by) <= length + 1e-3


def grid_of(occupied: NDArray[np.bool_], x: float = 0.0, y: float = 0.0) -> MapGrid:
    cells = np.where(occupied, OCCUPIED, FREE).astype(np.int8)
    return MapGrid(OccupancyMap(cells=cells, resolution=0.05, origin=(x, y, 0.0)))


def test_a_map_is_seen_like_the_walls_that_it_shows() -> None:
    occupied = np.zeros((200, 300), bool)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    grid = grid_of(occupied, -5.0, -4.0)  # 15 x 10 m, its inner side from (-4.95, -3.95) to (9.95, 5.95)
    angles = np.radians(np.arange(0.0, 360.0, 0.5))
    beams = len(angles)
    found = Surroundings2D(Scenery(), grid).seen(np.zeros(beams), np.zeros(beams), angles, 0.0).distance
    walls = Wall(points=((-4.95, -3.95), (9.95, -3.95), (9.95, 5.95), (-4.95, 5.95), (-4.95, -3.95)))
    true = seen(Scenery(walls=(walls,)), 0, 0, *np.degrees(angles))
    assert np.abs(found - true).max() < 0.05


def test_beams_that_leave_the_map_meet_nothing() -> None:
    grid = grid_of(np.zeros((10, 10), bool))
    far = np.full(4, 100.0)
    assert grid.distances(far, far, np.array([1.0, -1, 0, 0]), np.array([0.0, 0, 1, -1])).tolist() == [inf] * 4
    assert np.isinf(grid.distances(np.full(1, 0.2), np.full(1, 0.2), np.ones(1), np.zeros(1))).all()


def test_a_map_is_seen_from_beside_it() -> None:
    grid = grid_of(np.ones((10, 10), bool))
    assert grid.distances(np.array([-2.0]), np.array([0.25]), np.ones(1), np.zeros(1))[0] == pytest.approx(
        2.0, abs=0.05
    )
