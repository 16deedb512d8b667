"""The localizer on a map of a room: its keys, its contract, and its threads."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
import pytest
from core_builders import ROBOT as PLAIN
from msgspec.structs import replace as changed
from pydantic import ValidationError

from artemis.errors import ConfigError
from artemis.mapping.map_file import map_files
from artemis.mapping.occupancy import FREE, OCCUPIED, OccupancyMap
from artemis.mapping.recent_odometry import RecentOdometry
from artemis.mapping.settings import MapSettings
from artemis.mapping.sighting import points_of
from artemis.mounting import Mounting
from artemis.plugins.contracts import PluginContext
from artemis.plugins.guard import PluginGuard
from artemis.plugins.localizers.scan_map import WAITING, ScanMapConfig, ScanMapLocalizer
from artemis.testing.localizers import ROOM, SPEED, LocalizerContract
from artemis.values import LocatedPose, Pose, PoseFix, Tick

CELL = 0.05
PLACE = Mounting(plugin="lms1xx", x_m=0.5, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=0.1)
ROBOT = LocalizerContract.robot.model_copy(update={"scanners": {"front": PLACE}})
START = {"x_m": 0.0, "y_m": 0.0, "heading_deg": 0.0}


def room_map() -> dict[str, bytes]:
    """The room of the contract, as a mission names its files."""
    left, right, low, high = ROOM
    cells = np.full((round((high - low) / CELL) + 2, round((right - left) / CELL) + 2), FREE, np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    from pathlib import Path

    content = OccupancyMap(cells=cells, resolution=CELL, origin=(left - CELL, low - CELL, 0.0))
    return {path.as_posix(): data for path, data in map_files(Path("maps/room.yaml"), content).items()}


FILES = room_map()


class TestContract(LocalizerContract):
    plugin = ScanMapLocalizer
    options: Mapping[str, object] = {"map": "maps/room.yaml", "start": START}
    files = FILES
    robot = ROBOT
    duration = 3.0

    def test_it_finds_the_robot(self) -> None:
        found = self.found()
        assert len(found) == pytest.approx(30, abs=2)
        for now, fix in found:
            assert fix.pose.x == pytest.approx(SPEED * fix.time, abs=0.03)
            assert abs(fix.pose.y) < 0.03
            assert abs(fix.pose.heading) < 0.01
            assert (len(fix.covariance), fix.doubt) == (6, 0.0)
            assert 0.0 < now - fix.time < 0.1


def context(**options: Any) -> PluginContext:  # noqa: ANN401
    return replace(TestContract().given(), **options)


def made(given: PluginContext | None = None, **options: Any) -> ScanMapLocalizer:  # noqa: ANN401
    config = ScanMapConfig.model_validate({"map": "maps/room.yaml", **options})
    return ScanMapLocalizer(config, given or context())


def shown(localizer: ScanMapLocalizer, ticks: range) -> list[PoseFix]:
    found: list[PoseFix] = []
    for number in ticks:
        found += localizer.fixes(0.02 * number)
        localizer.see(TestContract().tick(0.02 * number))
    return found


@pytest.mark.parametrize(
    ("given", "options", "problem"),
    [
        ({"robot": PLAIN}, {}, "scanner: the robot has none"),
        ({}, {"scanner": "frnt"}, "no such scanner: frnt; nearest is 'front'"),
        (
            {"robot": ROBOT.model_copy(update={"scanners": {"front": PLACE, "rear": PLACE}})},
            {},
            "scanner: choose one of front, rear",
        ),
        ({}, {"start": {**START, "x_m": 1000.0}}, r"start: \(1000, 0\) lies outside of maps/room.yaml"),
        ({"files": {}}, {}, "map: no 'maps/room.yaml' among the mission's files"),
        ({"files": {"maps/room.yaml": FILES["maps/room.yaml"]}}, {}, "map: no 'maps/room.pgm'"),
        ({"files": {**FILES, "maps/room.yaml": b"image: room.pgm\nresolution: 0\n"}}, {}, r"room.yaml:2:1: resolution"),
        ({"files": {**FILES, "maps/room.pgm": b"P5 2 1 255\n\xfe\xfe"}}, {}, "nothing is occupied"),
    ],
)
def test_what_cannot_be_is_refused_before_the_run(given: dict[str, Any], options: dict[str, Any], problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        made(context(**given), **options)


@pytest.mark.parametrize(
    ("start", "problems"),
    [
        ("here", [("<word>", "literal_error")]),
        (7, [("<word>", "literal_error")]),
        ({"x_m": 1.0}, [("y_m", "missing"), ("heading_deg", "missing")]),
        ({**START, "z_m": 0.0}, [("z_m", "extra_forbidden")]),
    ],
)
def test_a_wrong_start_is_refused_as_what_it_was_meant_to_be(start: object, problems: list[tuple[str, str]]) -> None:
    with pytest.raises(ValidationError) as refused:
        ScanMapConfig.model_validate({"map": "m.yaml", "start": start})
    assert [(each["loc"][-1], each["type"]) for each in refused.value.errors()] == problems


def test_the_last_pose_is_a_hint_where_the_mission_wants_it_and_where_it_resumes() -> None:
    there = Pose(x=0.1, y=0.1, heading=0.05)
    for options, given in (
        ({"start": "last"}, {"last_pose": lambda: there}),
        ({"start": {"x_m": 5, "y_m": 1, "heading_deg": 90}}, {"last_pose": lambda: there, "resumed": True}),
    ):
        found = shown(made(context(**given), **options), range(30))
        assert found[0].doubt == 0.0
        assert found[0].pose.x == pytest.approx(0.0, abs=0.03)
    assert shown(made(start="last"), range(30))[0].doubt >= 1.0


def initial(x: float, y: float, heading: float, covariance: tuple[float, ...] = ()) -> LocatedPose:
    return LocatedPose(pose=Pose(x=x, y=y, heading=heading), frame="map", source="rviz", covariance=covariance)


@pytest.mark.parametrize("covariance", [(), (0.25, 0.0, 0.0, 0.25, 0.0, 0.068)])
def test_a_lost_robot_is_found_where_somebody_says_that_it_is(covariance: tuple[float, ...]) -> None:
    localizer = made(start={"x_m": 6.0, "y_m": 2.0, "heading_deg": 90.0})
    assert {fix.doubt for fix in shown(localizer, range(25))} == {1.0}
    localizer.begin_at(initial(0.3, -0.2, 0.1, covariance))
    found = shown(localizer, range(25, 75))[1:]  # the first was matched before
    assert {fix.doubt for fix in found} == {0.0}
    assert max(abs(fix.pose.x - SPEED * fix.time) + abs(fix.pose.y) for fix in found) < 0.04
    assert localizer.take_problems() == []


def test_a_pose_that_does_not_fit_is_refused_and_the_robot_is_followed_as_before() -> None:
    localizer = made(start=START)
    shown(localizer, range(25))
    localizer.begin_at(initial(6.0, 2.0, 1.0))
    found = shown(localizer, range(25, 75))
    assert {fix.doubt for fix in found} == {0.0}
    assert max(abs(fix.pose.x - SPEED * fix.time) + abs(fix.pose.y) for fix in found) < 0.04
    ((row, words),) = localizer.take_problems()
    assert row == "LOC-07"
    assert re.fullmatch(r"a scan fits \d+% at best there", words)
    assert localizer.take_problems() == []


def test_a_start_that_fits_another_place_as_well_is_doubted() -> None:
    localizer = made(start=START)
    shown(localizer, range(230))
    ((row, words),) = localizer.take_problems()
    assert row == "LOC-07"
    x, y, heading = (float(each) for each in re.findall(r"-?[\d.]+", words))
    assert words == f"x {x:.2f} m, y {y:.2f} m, heading {heading:.0f} deg fits as well"
    assert abs(heading) == pytest.approx(180.0, abs=1.0), "the empty room looks the same after half a turn"
    left, right, low, high = ROOM
    assert [x, y] == pytest.approx([left + right - SPEED * 1.2, low + high], abs=0.1)
    shown(localizer, range(230, 400))
    assert localizer.take_problems() == []


def test_in_real_time_scans_wait_for_the_thread_and_the_oldest_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    gate = Event()
    build = ScanMapLocalizer._begun

    def held(self: ScanMapLocalizer) -> Any:  # noqa: ANN401
        assert gate.wait(60.0)
        return build(self)

    monkeypatch.setattr(ScanMapLocalizer, "_begun", held)
    localizer = made(context(real_time=True), start=START)
    problems = [localizer.see(TestContract().tick(0.02 * number)) for number in range(101)]
    told = [problem for problem in problems if problem]
    assert told[0] == "matching is too slow: 1 scans were dropped"
    assert told[-1].endswith(f"{len(told)} scans were dropped")
    assert localizer.fixes(2.0) == ()
    gate.set()
    localizer.close()
    found = localizer.fixes(2.0)
    assert len(found) == WAITING
    assert found[-1].time == pytest.approx(2.0, abs=0.15)
    assert found[-1].pose.x == pytest.approx(SPEED * found[-1].time, abs=0.03)


def test_what_fails_in_the_thread_is_a_fault_of_the_plugin(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: ScanMapLocalizer) -> None:
        raise MemoryError("map")

    monkeypatch.setattr(ScanMapLocalizer, "_begun", fails)
    monkeypatch.setattr("threading.excepthook", lambda arguments: None)
    localizer = made(context(real_time=True))
    localizer._matching._thread.join()  # type: ignore[union-attr]  # it is threaded
    guard = PluginGuard({}, lambda: 0.0, localizer)
    guard.show(TestContract().tick(0.0))
    ((id, name, seen),) = guard.take_problems()
    assert (id, name) == ("PLG-02", "localizer")
    assert seen.startswith("MemoryError('map') at ")


def way_of(*poses: tuple[float, Pose], reset: float | None = None) -> RecentOdometry:
    way = RecentOdometry(ROBOT)
    for time, pose in poses:
        tick = TestContract().tick(time)
        snapshot = changed(tick.snapshot, odometry=changed(tick.snapshot.odometry, pose=pose))
        way.see(changed(tick, snapshot=snapshot, wish=changed(tick.wish, reset_pose=time == reset)))
    return way


def scan_at(time: float, beam_time: float = 0.0) -> Any:  # noqa: ANN401
    (scan,) = TestContract().tick(time).snapshot.sensed.scans
    return changed(scan, time=time, beam_time=beam_time)


def test_the_way_of_a_scan_is_interpolated_and_waited_for() -> None:
    way = way_of((0.0, Pose()), (0.1, Pose(x=0.1, heading=0.2)))
    assert way.sighting(scan_at(0.11)) is None
    seen = way.sighting(scan_at(0.05, 0.02 / 540))
    assert seen is not None
    assert (seen.time, seen.begin.heading, seen.end.heading) == pytest.approx((0.06, 0.1, 0.14))
    assert seen.middle.x == pytest.approx(0.06, abs=1e-3)


def test_where_the_odometry_begins_anew_the_way_goes_on() -> None:
    way = way_of((0.0, Pose()), (0.1, Pose(x=1.0)), (0.2, Pose()), (0.3, Pose(x=0.5)), reset=0.1)
    seen = way.sighting(scan_at(0.3))
    assert seen is not None
    assert seen.middle.x == pytest.approx(1.5)


def test_a_turning_and_driving_robot_sees_straight_walls_where_they_are() -> None:
    """Each beam from where the scanner was then, at 0.7 m/s and 1 rad/s."""
    way = way_of(*((0.001 * number, Pose(x=0.0007 * number, heading=0.001 * number)) for number in range(40)))
    scan = scan_at(0.01, 0.02 / 540)
    seen = way.sighting(scan)
    assert seen is not None
    angles = scan.start_angle + scan.increment * np.arange(541)
    times = 10 + 20 * np.arange(541) / 540
    heading = 0.001 * times
    place_y = 0.5 * np.sin(heading)  # of the scanner; its x tells nothing of walls along x
    bearing = angles + heading
    with np.errstate(divide="ignore"):
        reach = np.where(np.sin(bearing) > 0, 2.0 - place_y, -2.0 - place_y) / np.sin(bearing)
    ranges = np.where((reach > 0) & (reach < 15), np.rint(1000 * reach), 0).astype("<u2")
    moved = changed(scan, ranges=ranges.tobytes())
    points = points_of(changed_sighting(seen, moved), PLACE, MapSettings())
    c, s = math.cos(seen.middle.heading), math.sin(seen.middle.heading)
    y = seen.middle.y + s * points[:, 0] + c * points[:, 1]
    assert len(points) > 200
    assert np.abs(np.abs(y) - 2.0).max() < 0.002
    masked = PLACE.model_copy(update={"mask": ((0.0, 54.0),), "least_range_m": 2.5})
    left = points_of(changed_sighting(seen, moved), masked, MapSettings())
    off_x, off_y = left[:, 0] - 0.5, left[:, 1]
    assert np.hypot(off_x, off_y).min() > 2.45
    bearings = np.degrees(np.arctan2(off_y, off_x))
    assert not ((bearings > 1.0) & (bearings < 53.0)).any()


def changed_sighting(seen: Any, scan: Any) -> Any:  # noqa: ANN401
    return replace(seen, scan=scan)


def test_a_robot_that_lost_count_is_followed_by_its_scans_alone() -> None:
    localizer = made(start=START)
    found: list[PoseFix] = []
    for number in range(60):
        found += localizer.fixes(0.02 * number)
        tick: Tick = TestContract().tick(0.02 * number)
        gap = number > 20
        odometry = changed(tick.snapshot.odometry, lost=gap, uncounted=gap, pose=Pose(x=9.0 if number > 20 else 0.0))
        localizer.see(changed(tick, snapshot=changed(tick.snapshot, odometry=odometry)))
    assert found[-1].doubt == 0.0
    assert found[-1].pose.x == pytest.approx(SPEED * found[-1].time, abs=0.04)
