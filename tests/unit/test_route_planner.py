"""The planner as a part of the robot: the zones that count, what goes to its process, and the scans that it keeps."""

from __future__ import annotations

import asyncio
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from core_builders import snapshot
from msgspec.structs import replace

from artemis.clock import SimulatedLoop
from artemis.errors import ConfigError
from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.loading import load_model
from artemis.mission.zones import HEAD, zones_in
from artemis.motion.planned_route import PLANNER
from artemis.route_planning.device import AGAIN, RoutePlanner
from artemis.route_planning.floor import CELL, Destination, ZonedMap, packed_map
from artemis.route_planning.zones import MapZones
from artemis.scan import Scan
from artemis.values import Job, JobKind, JobResult, Mode, Pose, SetPoints, Tick, Wish
from artemis.vehicle import RobotFile

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml", RobotFile)
ZONES = b"""# Zones of the hall.
zones:
  - {name: pit, kind: keep-out, corners: [[1, 2], [2, 2], [2, 2.5], [1, 2.5]]}
places:
  gate: {x_m: 4.1, y_m: 1.0, heading_deg: 0}
"""
STAIRS = b"  - {name: stairs, kind: keep-out, corners: [[2.5, 0], [2.7, 0], [2.7, 3], [2.5, 3]]}\n"


def planner(beside: Path, raw: bytes, read: Callable[[bytes, str], MapZones] = zones_in) -> RoutePlanner:
    """On a floor of 5 x 3 m with walls around, from x 0.8 m to 4.1 m; the file of its zones was `raw` at the start."""
    cells = np.zeros((60, 100), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    content = packed_map(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))
    destination = Destination(
        made_of=ZonedMap(content, beside, raw), goal=Pose(x=4.1, y=1.0), speed=0.5, margin=0.05, known_behind=None
    )
    made = RoutePlanner(ROBOT, {0: destination}, read, virtual=True)
    made._pose = Pose(x=0.8, y=1.0)
    return made


def planned(by: RoutePlanner, values: tuple[int, ...] = ()) -> tuple[JobResult, float]:
    """The result of a job, and how long it took in virtual time [s]."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        begun = runner.get_loop().time()
        result = runner.run(by.perform(Job(id=1, kind=JobKind.PLAN, drive=PLANNER, values=values)))
        return result, runner.get_loop().time() - begun


@pytest.mark.parametrize(
    "left", [None, b"", HEAD, ZONES[ZONES.index(b"places") :]], ids=["gone", "empty", "head", "cut"]
)
def test_zones_that_are_gone_are_an_error_and_no_route_is_planned(tmp_path: Path, left: bytes | None) -> None:
    beside = tmp_path / "hall.zones.yaml"
    if left is not None:
        beside.write_bytes(left)
    result, took = planned(planner(beside, ZONES))
    assert (result.ok, result.values, result.fault) == (False, (), "PTH-11")
    assert "hall.zones.yaml: " in result.detail
    assert "and had 1 when it was read last" in result.detail
    assert took >= AGAIN, "it was read twice"


def test_a_file_that_is_being_replaced_is_read_again(tmp_path: Path) -> None:
    beside = tmp_path / "hall.zones.yaml"
    beside.write_bytes(b"")

    def read(raw: bytes, source: str) -> MapZones:
        if not raw:
            beside.write_bytes(ZONES)
        return zones_in(raw, source)

    result, _ = planned(planner(beside, ZONES, read))
    assert (result.ok, result.fault) == (True, "")


@pytest.mark.parametrize("left", [b"zones: []\n", HEAD + b"zones: []\nplaces: {}\n"])
def test_that_there_are_no_zones_any_more_is_said_by_the_file_and_told(tmp_path: Path, left: bytes) -> None:
    beside = tmp_path / "hall.zones.yaml"
    beside.write_bytes(left)
    by = planner(beside, ZONES)
    result, _ = planned(by)
    assert result.ok
    assert result.detail.endswith(
        'zones changed: no more {name: "pit", kind: keep-out, corners: [[1, 2], [2, 2], [2, 2.5], [1, 2.5]]}'
    )
    beside.unlink()
    assert planned(by)[0].ok, "now it had none"


def test_a_map_without_zones_needs_no_file(tmp_path: Path) -> None:
    result, took = planned(planner(tmp_path / "hall.zones.yaml", b""))
    assert result.ok
    assert took < AGAIN


def test_a_file_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    beside = tmp_path / "hall.zones.yaml"
    beside.mkdir()
    result, _ = planned(planner(beside, b""))
    assert (result.ok, result.fault) == (False, "PTH-11")
    assert "cannot be read" in result.detail


def test_the_present_route_is_given_back_unless_a_zone_is_new_on_it(tmp_path: Path) -> None:
    beside = tmp_path / "hall.zones.yaml"
    beside.write_bytes(ZONES)
    by = planner(beside, ZONES)
    present = planned(by)[0].values
    assert planned(by, present)[0].values == present
    beside.write_bytes(ZONES.replace(b"places:", STAIRS + b"places:"))
    for values in (present, (0, *present), present):
        shut, _ = planned(by, values)
        assert (shut.ok, shut.values, shut.fault) == (False, (), "")
        assert "a zone that is new is in the way of the present one" in shut.detail
    shut, _ = planned(by, (-1, *present))
    assert (shut.ok, shut.values) == (False, ())
    assert shut.detail.startswith("no other route is sought, and a zone that is new is in the way")
    beside.write_bytes(ZONES)
    for values in (present, (-1, *present)):
        assert planned(by, values)[0].values == present


def test_no_floor_goes_to_the_process(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    cells = np.zeros((2000, 2000), np.int8)
    cells[rng.integers(0, 2000, 20_000), rng.integers(0, 2000, 20_000)] = 100
    content = packed_map(OccupancyMap(cells=cells, resolution=CELL, origin=(1.0, 2.0, 0.5)))
    unpacked = content.content
    assert np.array_equal(unpacked.cells, cells)
    assert (unpacked.resolution, unpacked.origin) == (CELL, (1.0, 2.0, 0.5))
    by = planner(tmp_path / "hall.zones.yaml", b"")
    by._destinations = {0: replace(by._destinations[0], made_of=ZonedMap(content, tmp_path / "hall.zones.yaml", b""))}
    order = by._order(Job(id=1, kind=JobKind.PLAN, drive=PLANNER))
    assert len(pickle.dumps(order)) < 200_000


def test_a_wrong_file_is_told_with_all_that_is_wrong(tmp_path: Path) -> None:
    beside = tmp_path / "hall.zones.yaml"
    beside.write_bytes(b"zones: 3\n")
    with pytest.raises(ConfigError) as raised:
        zones_in(b"zones: 3\n", str(beside))
    assert planned(planner(beside, ZONES))[0].detail == "; ".join(raised.value.problems)


@pytest.mark.parametrize("late", [0, 1, 2])
def test_of_each_scanner_a_scan_is_kept_twice_a_second(tmp_path: Path, late: int) -> None:
    by = planner(tmp_path / "hall.zones.yaml", b"")
    for number in range(50 * 3):
        names = [name for name, first in (("front", 0), ("rear", late)) if number % 5 == first]
        scans = tuple(
            Scan(source=name, time=0.02 * number, start_angle=0.0, increment=0.1, ranges=bytes(20)) for name in names
        )
        seen = snapshot(0.02 * number, scans=scans)
        by.write(Tick(snapshot=seen, mode=Mode.READY, wish=Wish(), set_points=SetPoints()))
    kept = [each.scan.source for each in by._placed_scans]
    assert (kept.count("front"), kept.count("rear")) == (6, 6)
    times = [each.time for each in by._placed_scans]
    assert times == sorted(times)
