"""Localisation on the map of a small world: followed, found anywhere, found again, and doubted where nothing fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from office import OFFICE
from twin_rooms import APART, TWINS, twin_map

from artemis.localisation.scan_localizer import LocalizerSettings, PlaceSearch, ScanLocalizer, ScanPose
from artemis.localisation.scan_map import ScanMap, surface_of_cells
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.occupancy import OCCUPIED, OccupancyMap, occupancy
from artemis.mapping.se2 import Array, between, compose
from artemis_lab.bench.laser_worlds import SETTINGS, box, driven, odometry, scan

TUNED = LocalizerSettings(matching=replace(SETTINGS, cells=1024, farthest=20.0))
STANDS = driven([(-2, -3), (1, -3), (1, 1), (3.5, 1), (3.5, 0), (6, 0), (6, 1.2), (1, 1), (-5, 1), (-5, -3)], 0.5)
DRIVE = driven([(-2.2, -3.1), (0.9, -3.0), (0.8, 1.2), (3.4, 0.9), (0.9, 1.1), (-5.1, 1.1), (-5.2, -2.9)], 0.2)
SOLD = np.concatenate([OFFICE, box(0.0, 3.0, 0.8, 0.8), box(4.0, -3.0, 0.5, 0.5)])
"""The office with two things more than on the map."""


@pytest.fixture(scope="module")
def known() -> ScanMap:
    return ScanMap.of_scans([scan(OFFICE, pose) for pose in STANDS], STANDS, TUNED.matching)


def followed(localizer: ScanLocalizer, world: Array, poses: Array, counted: Array | None) -> list[ScanPose]:
    dice = np.random.default_rng(1)
    found = []
    for number, pose in enumerate(poses):
        found.append(localizer.update(scan(world, pose, 0.01, dice), None if counted is None else counted[number]))
        if (wanted := localizer.wanted()) is not None:
            localizer.take(wanted, localizer.look(wanted))
    return found


def errors(found: list[ScanPose], true: Array) -> Array:
    off = between(true, np.array([each.pose for each in found]))
    return np.asarray(np.hypot(off[:, 0], off[:, 1]))


@pytest.mark.exhaustive
def test_a_robot_is_followed_past_things_that_are_not_on_the_map(known: ScanMap) -> None:
    counted = odometry(DRIVE, [0.9] * (len(DRIVE) - 1), np.radians(5))
    found = followed(ScanLocalizer(known, TUNED, DRIVE[0]), SOLD, DRIVE, counted)
    off = errors(found, DRIVE)
    assert off.mean() < 0.02
    assert off.max() < 0.08
    assert not any(each.lost for each in found)
    measured = [each.measured for each in found[5:] if each.measured is not None]
    assert all(0 < np.linalg.eigvalsh(each)[0] for each in measured)
    assert max(np.sqrt(each[0, 0]) for each in measured) < 0.05


@pytest.mark.exhaustive
def test_a_robot_is_followed_without_odometry(known: ScanMap) -> None:
    assert errors(followed(ScanLocalizer(known, TUNED, DRIVE[0]), OFFICE, DRIVE, None), DRIVE).max() < 0.08


@pytest.mark.parametrize("begin", [0, 30, 60])
def test_a_robot_is_found_anywhere(known: ScanMap, begin: int) -> None:
    way = DRIVE[begin:]
    found = followed(ScanLocalizer(known, TUNED), OFFICE, way, odometry(way, [1.0] * (len(way) - 1)))
    first = next(number for number, each in enumerate(found) if not each.lost)
    assert first < 25
    assert found[0].lost
    assert errors(found, way)[first:].max() < 0.08


def compared(on: ScanMap, world: Array, true: Array, *, by_operator: bool) -> tuple[list[int], Array | None]:
    """At which scans a robot that stands was looked for, its place being given; and where else it may be."""
    near, std, looked = true + np.array([-0.1, -0.1, 0.1]), (0.3, 0.17), list[int]()
    localizer = ScanLocalizer(on, TUNED, None if by_operator else near, std)
    if by_operator:
        localizer.begin_at(near, std)
    for number in range(30):
        found = localizer.update(scan(world, true), np.zeros(3))
        assert not found.lost
        assert np.hypot(*(found.pose - true)[:2]) < 0.02
        if (wanted := localizer.wanted()) is not None:
            looked.append(number)
            localizer.take(wanted, localizer.look(wanted))
    return looked, localizer.rival


@pytest.mark.parametrize("by_operator", [False, True])
def test_a_given_place_is_compared_once_with_all_others(known: ScanMap, by_operator: bool) -> None:
    after = [TUNED.gather_scans - 1]
    assert compared(known, OFFICE, DRIVE[3], by_operator=by_operator) == (after, None)
    looked, rival = compared(twin_map(TUNED.matching), TWINS, np.array([2.6, 2.1, 0.0]), by_operator=by_operator)
    assert looked == after
    assert rival == pytest.approx([9.6, 2.1, 0.0], abs=0.02)


def test_a_place_is_not_compared_any_more_once_another_one_was_given() -> None:
    """The wrong room of two is given, and the right one while the wrong one is compared with the others."""
    true, std = np.array([9.6, 2.1, 0.0]), (0.3, 0.17)
    localizer = ScanLocalizer(twin_map(TUNED.matching), TUNED, true - APART, std)
    followed(localizer, TWINS, np.tile(true, (TUNED.gather_scans - 1, 1)), None)
    localizer.update(scan(TWINS, true), None)
    wanted = localizer.wanted()
    assert wanted is not None
    localizer.begin_at(true, std)
    localizer.update(scan(TWINS, true), None)
    found = localizer.look(wanted)
    localizer.take(wanted, found)
    assert found is not None
    assert found.pose == pytest.approx(true, abs=0.02)
    assert localizer.rival is None, "the robot stands there"
    followed(localizer, TWINS, np.tile(true, (TUNED.gather_scans, 1)), None)
    assert localizer.rival == pytest.approx(true - APART, abs=0.03)


def test_a_kidnapped_robot_says_so_and_is_found_again(known: ScanMap) -> None:
    way = np.concatenate([DRIVE[:15], DRIVE[55:90]])
    counted = odometry(DRIVE, [1.0] * (len(DRIVE) - 1))
    wheels = np.concatenate([counted[:15], compose(counted[14], between(counted[55], counted[55:90]))])
    found = followed(ScanLocalizer(known, TUNED, way[0]), OFFICE, way, wheels)
    assert not any(each.lost for each in found[:15])
    lost = [number for number, each in enumerate(found) if each.lost]
    assert lost
    assert 15 <= lost[0] < 25
    assert not found[-1].lost
    assert errors(found, way)[-1] < 0.08


@pytest.mark.exhaustive
def test_another_building_is_not_taken_for_the_map(known: ScanMap) -> None:
    hall = np.concatenate([box(-9, -7, 17, 13), box(-6, -4, 3, 1), box(1, 2, 2, 2)])
    way = driven([(-7, -6), (6, -6), (6, 4)], 0.4)
    found = followed(ScanLocalizer(known, TUNED), hall, way, odometry(way, [1.0] * (len(way) - 1)))
    assert all(each.lost for each in found)
    assert {each.doubt for each in found} == {1.0}


def test_a_robot_that_sees_nothing_grows_doubtful(known: ScanMap) -> None:
    localizer = ScanLocalizer(known, TUNED, DRIVE[0])
    followed(localizer, OFFICE, DRIVE[:5], None)
    nothing = np.empty((0, 4))
    doubts = [localizer.update(nothing, None).doubt for _ in range(6)]
    assert doubts == sorted(doubts)
    assert doubts[0] < 1 <= doubts[-1]


def test_cells_of_an_image_are_lines_again() -> None:
    keys = KeyScans()
    for pose in STANDS:
        keys.append(scan(OFFICE, pose), pose, np.zeros(2))
    grid = occupancy(keys, 0.05)
    surface = surface_of_cells(grid)
    normals = surface[(surface[:, 2:] != 0).any(1)]
    assert len(normals) > 0.6 * len(surface)
    assert (np.abs(normals[:, 2:]).max(1) > 0.98).mean() > 0.8, "all walls are along x or y"
    localizer = ScanLocalizer(ScanMap.of_cells(grid, TUNED.matching), TUNED, DRIVE[0])
    assert errors(followed(localizer, OFFICE, DRIVE[:40], odometry(DRIVE[:40], [1.0] * 39)), DRIVE[:40]).max() < 0.1


def test_a_map_that_two_threads_share_is_changed_by_neither() -> None:
    """One thread follows a robot whose pose was given while another one searches all of the map."""
    fresh = ScanMap.of_scans([scan(OFFICE, pose) for pose in STANDS], STANDS, TUNED.matching)
    arrays = [
        value for grid in (fresh.grid, fresh.rough) for value in vars(grid).values() if isinstance(value, np.ndarray)
    ]
    before = [array.copy() for array in arrays]
    points = scan(OFFICE, DRIVE[3])
    localizer = ScanLocalizer(fresh, replace(TUNED, gather_scans=1))
    localizer.begin_at(DRIVE[3], (0.3, 0.1))
    assert localizer.update(points, None).doubt == 0.0
    assert localizer.look(PlaceSearch(points=points, at=np.zeros(3), since=0)) is not None
    for array, old in zip(arrays, before, strict=True):
        assert np.array_equal(array, old)


def test_an_empty_map_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing is occupied"):
        ScanMap(np.empty((0, 4)), TUNED.matching)
    cells = np.full((5, 5), -1, np.int8)
    cells[2, 2] = OCCUPIED
    lonely = OccupancyMap(cells=cells, resolution=0.05, origin=(0.0, 0.0, 0.0))
    assert surface_of_cells(lonely)[0] == pytest.approx([0.125, 0.125, 0, 0])
