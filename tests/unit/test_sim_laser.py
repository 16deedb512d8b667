"""How a simulated scanner measures: its mounting, the motion within a scan, and the errors of its data sheet."""

from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from artemis.mission.loading import load_model
from artemis.mounting import Mounting
from artemis.sim.laser import Laser
from artemis.sim.scenery import HALL, Crate, Pole, Scenery, Surroundings2D, Wall
from artemis.sim.world import PlantParameters, World
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml", RobotFile)
ANGLES = np.radians(np.arange(541) * 0.5 - 135)
AT_ONCE = np.zeros(541)
PLACE = {"plugin": "lms1xx", "x_m": 0.0, "y_m": 0.0, "heading_deg": 0.0, "height_m": 0.3, "least_range_m": 0.5}


def laser(
    scenery: Scenery = HALL,
    *,
    seed: int = 1,
    true: PlantParameters | None = None,
    exact: bool = True,
    **mounted: object,
) -> Laser:
    world = World(ROBOT, true)
    made = Laser(world, Mounting.model_validate({**PLACE, **mounted}), Surroundings2D(scenery), seed=seed, start=0.0)
    if exact:
        made.noise = made.systematic = 0.0
    return made


def metres(ranges: NDArray[np.uint16]) -> NDArray[np.float64]:
    return np.asarray(ranges / 1000.0)


def beam(degrees: float) -> int:
    return round((degrees + 135) * 2)


def test_walls_are_where_they_are_seen_from_the_mounting() -> None:
    found = metres(laser(x_m=1.0, y_m=0.5).look(AT_ONCE, ANGLES))
    assert found[[beam(0), beam(90), beam(-90)]] == pytest.approx([7.0, 7.5, 8.5], abs=1e-3)
    turned = metres(laser(x_m=1.0, y_m=0.5, heading_deg=90.0).look(AT_ONCE, ANGLES))
    assert turned[[beam(0), beam(90), beam(-90)]] == pytest.approx([7.5, 9.0, 7.0], abs=1e-3)


def test_upside_down_it_sees_the_left_on_its_right() -> None:
    scenery = Scenery(poles=(Pole(x_m=0.0, y_m=2.0, diameter_m=0.2),))
    assert metres(laser(scenery).look(AT_ONCE, ANGLES))[beam(90)] == pytest.approx(1.9, abs=1e-3)
    hanging = metres(laser(scenery, upside_down=True).look(AT_ONCE, ANGLES))
    assert hanging[beam(-90)] == pytest.approx(1.9, abs=1e-3)
    assert hanging[beam(90)] == 0.0


def test_each_beam_is_measured_at_its_own_time_along_the_motion() -> None:
    """The robot turns by 1 rad/s: the last beam looks 15 ms later, by 0.86 degrees further round."""
    made = laser(Scenery(walls=(Wall(points=((-9.0, 3.0), (9.0, 3.0))),)))
    world = made._world
    for step in range(1, 30):
        world._trail.append((step * 1e-3, 0.0, 0.0, step * 1e-3))  # type: ignore[union-attr]
    world.time = 0.029
    times = 0.005 + np.arange(541) * 0.015 / 540
    found = metres(made.look(times, ANGLES))
    true = 3.0 / np.sin(ANGLES + times)
    ahead = (ANGLES + times > radians(30)) & (ANGLES + times < radians(134))
    assert np.abs(found - true)[ahead].max() < 1e-3
    assert np.abs(found[ahead] - 3.0 / np.sin(ANGLES[ahead])).max() > 0.04, "not all at once"


def test_a_world_that_lags_behind_is_carried_on() -> None:
    made = laser()
    world = made._world
    for step in range(1, 30):
        world._trail.append((step * 1e-3, step * 0.5e-3, 0.0, 0.0))  # type: ignore[union-attr]
    x, _, _ = world.poses_at(np.array([0.0285, 0.029, 0.039, 0.049]))
    assert x == pytest.approx([0.01425, 0.0145, 0.0195, 0.0245])
    world.carry(1.0, 0.0, 0.0)
    x, _, _ = world.poses_at(np.array([0.05]))
    assert x == pytest.approx([1.0])


def test_noise_and_systematic_error_are_those_of_the_data_sheet() -> None:
    made = laser(exact=False)
    scans = np.array([metres(made.look(AT_ONCE, ANGLES)) for _ in range(400)])
    spread, error = scans.std(axis=0), scans.mean(axis=0) - metres(laser().look(AT_ONCE, ANGLES))
    assert np.median(spread) == pytest.approx(0.012, abs=0.0006)
    assert 0.005 < np.abs(error).max() < 0.032
    other = laser(seed=2, exact=False)
    mean = np.mean([metres(other.look(AT_ONCE, ANGLES)) for _ in range(400)], axis=0)
    assert np.abs(mean - scans.mean(axis=0)).max() > 0.005, "every device has its own"


def test_the_same_seed_measures_the_same() -> None:
    one, same, other = (laser(seed=seed, exact=False).look(AT_ONCE, ANGLES).tolist() for seed in (3, 3, 4))
    assert one == same
    assert one != other


def test_nearer_and_farther_than_its_range_nothing_returns() -> None:
    wall = Scenery(walls=(Wall(points=((0.45, -1.0), (0.45, 1.0))), Wall(points=((-2.0, 21.0), (2.0, 21.0)))))
    found = laser(wall).look(AT_ONCE, ANGLES)
    assert found[[beam(0), beam(90)]].tolist() == [0, 0]
    assert metres(found)[beam(45)] == pytest.approx(0.45 * 2**0.5, abs=1e-3)


def test_dark_things_are_seen_less_far_and_mirrors_only_squarely() -> None:
    walls = (
        Wall(points=((7.0, -20.0), (7.0, 20.0)), surface="dark"),
        Wall(points=((-20.0, 9.0), (20.0, 9.0)), surface="dark"),
        Wall(points=((-20.0, -5.0), (20.0, -5.0)), surface="shiny"),
    )
    found = metres(laser(Scenery(walls=walls)).look(AT_ONCE, ANGLES))
    assert found[[beam(0), beam(40), beam(90), beam(-90)]] == pytest.approx([7.0, 0.0, 0.0, 5.0], abs=1e-3)
    assert found[beam(-90) - 20 : beam(-90) - 17].tolist() == [0.0] * 3


def test_at_an_edge_it_measures_in_between_now_and_then() -> None:
    scenery = Scenery(
        boxes=(Crate(x_m=2.0, y_m=0.0, length_m=0.1, width_m=1.0),), walls=(Wall(points=((3.0, -9.0), (3.0, 9.0))),)
    )
    made = laser(scenery)
    between = 0
    for _ in range(200):
        found = metres(made.look(AT_ONCE, ANGLES))[beam(-20) : beam(20)]
        between += int(np.count_nonzero((found > 2.15) & (found < 2.9)))
    assert 50 < between < 400, "two edges in each scan, about half of them hit"


def test_dirt_and_covers_take_beams() -> None:
    made = laser()
    made.dirt = 0.4
    assert 0.3 < np.mean(made.look(AT_ONCE, ANGLES) == 0) < 0.5
    made.dirt, made.covered = 0.0, (radians(10), radians(30))
    assert np.flatnonzero(made.look(AT_ONCE, ANGLES) == 0).tolist() == list(range(beam(10), beam(30) + 1))
