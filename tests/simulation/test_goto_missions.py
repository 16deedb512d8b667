"""Missions that drive to places on a map: checked, driven, replayed, resumed."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import resuming
from mcap.reader import make_reader
from rig import CALIBRATE, MISSIONS, Rig, Seen, run, write_mission

from artemis.app import resume_point_of
from artemis.errors import ConfigError
from artemis.mapping.map_file import map_files
from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.goto import Goto, goto_rules
from artemis.mission.loading import load_mission
from artemis.mission.obstacles import Obstacles
from artemis.mission.walking import walk
from artemis.motion.planned_route import route_poses
from artemis.planning import plan_for
from artemis.recording.mcap_reader import Recording
from artemis.report.series import read_series
from artemis.values import JobKind, Mode, Request
from artemis.whole_files import write_bytes
from artemis_lab.bench.goals import drive
from artemis_lab.bench.obstacle_scenes import robot_with_scanner
from artemis_lab.commands.bench_goto import problem

pytestmark = pytest.mark.short_alignment

OUTLINE = "\noutline: {front_m: 0.68, rear_m: 0.12, half_width_m: 0.27}\n"

ZONES = """
zones: [{kind: keep-out, corners: [[2.8, 1.4], [4.0, 1.4], [4.0, 2.4], [2.8, 2.4]]}]
places:
  gate: {x_m: 2.5, y_m: 0.8, heading_deg: 0}
  crane: {x_m: 3.2, y_m: 1.9, heading_deg: 0}
"""
TRACKER = {"plugin": "simulated_tracker", "noise_m": 0.003}


def mission(folder: Path, to: object = "gate", *, localizer: object = TRACKER, **keys: Any) -> Path:  # noqa: ANN401
    steps = [CALIBRATE, {"goto": {"map": "floor.yaml", "to": to, "speed_m_s": 0.5, **keys}}]
    simulation = {"seed": 3, "true_robot": {"x_m": 0.8, "y_m": 0.8}, "localizer": localizer}
    path = write_mission(folder, steps, {"floor.zones.yaml": ZONES}, simulation=simulation)
    with (folder / "artemis.yaml").open("a") as robot:
        robot.write(OUTLINE)
    cells = np.zeros((52, 88), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    content = OccupancyMap(cells=cells, resolution=0.05, origin=(0.0, 0.0, 0.0))
    write_bytes(map_files(folder / "floor.yaml", content))
    return path


@pytest.mark.parametrize(
    ("to", "keys", "refused"),
    [
        ("gat", {}, "no such place on floor.yaml: gat; did you mean gate?"),
        ("crane", {}, "crane: the robot cannot stand there"),
        ({"x_m": 9.0, "y_m": 1.0, "heading_deg": 0.0}, {}, "lies outside of the map"),
        ("gate", {"localizer": None}, "has to come from a localizer"),
        ("gate", {"map": "flor.yaml"}, "did you mean floor.yaml?"),
        ("gate", {"follower": {"plugin": "frenet", "speed_m_s": 0.3}}, "is a key of the step itself"),
        ("gate", {"follower": {"plugin": "frenett"}}, "frenett"),
        ("gate", {"speed_m_s": 3.0}, "is above the robot's limits"),
        (
            "gate",
            {"blocked_after_s": 10, "obstacles": {"blocked_after_s": 90}},
            "blocked_after_s stands here and in `obstacles`",
        ),
    ],
)
def test_what_cannot_be_driven_to_is_refused(tmp_path: Path, to: object, keys: dict[str, Any], refused: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load_mission(mission(tmp_path, to, **keys))
    assert refused in str(raised.value)


def test_a_map_that_is_not_the_localizers_is_refused(tmp_path: Path) -> None:
    path = mission(tmp_path, localizer={"plugin": "scan_map", "map": "./other.yaml"})
    for suffix in (".yaml", ".zones.yaml", ".pgm"):
        (tmp_path / f"other{suffix}").write_bytes((tmp_path / f"floor{suffix}").read_bytes())
    with pytest.raises(ConfigError, match=r"map: the localizer finds the robot on ./other.yaml"):
        load_mission(path)
    path.write_text(path.read_text().replace("other", "floor"))
    with pytest.raises(ConfigError) as raised:
        load_mission(path)
    assert "the localizer finds" not in str(raised.value)  # it has no scanner


@pytest.mark.parametrize(("number", "words"), [("50", "88 x 52 cells of 50 m are 4400 x 2600 m"), ("1", "")])
def test_a_map_that_is_too_large_for_routes_is_refused(tmp_path: Path, number: str, words: str) -> None:
    path = mission(tmp_path, {"x_m": 30, "y_m": 30, "heading_deg": 0})
    map_file = tmp_path / "floor.yaml"
    map_file.write_text(map_file.read_text().replace("resolution: 0.05", f"resolution: {number}"))
    if not words:
        load_mission(path)
        return
    with pytest.raises(ConfigError, match="is the `resolution` in metres") as raised:
        load_mission(path)
    assert words in str(raised.value)


def test_zones_and_places_outside_of_the_map_are_told(tmp_path: Path) -> None:
    path = mission(tmp_path)
    zones = tmp_path / "floor.zones.yaml"
    far = "{name: far, kind: keep-out, corners: [[50, 1], [51, 1], [51, 2]]}"
    zones.write_text(ZONES.replace("zones: [", f"zones: [{far}, ") + "  away: {x_m: 70, y_m: 0, heading_deg: 0}\n")
    assert load_mission(path).remarks[:2] == (
        "floor.zones.yaml: zone far lies outside of the map: it has no effect",
        "floor.zones.yaml: place away lies outside of the map",
    )


@pytest.mark.parametrize(
    ("said", "own", "kept"),
    [
        (None, None, (0.03, 0.03, 30.0)),
        ({"blocked_after_s": 60}, None, (0.03, 0.03, 60.0)),
        ({"margin_m": 0.2}, None, (0.2, 0.03, 30.0)),
        ({"margin_m": 0.2}, {"clear_m": 0.1}, (0.03, 0.1, 30.0)),
    ],
)
def test_a_goto_keeps_3_cm_where_its_mission_states_nothing_else(
    said: dict[str, float] | None, own: dict[str, float] | None, kept: tuple[float, ...]
) -> None:
    given = Goto.model_validate({"map": "m.yaml", "to": "a", **({"obstacles": own} if own else {})})
    rules = goto_rules(given, Obstacles.model_validate(said) if said else None, robot_with_scanner())
    assert rules is not None
    assert (rules.margin, rules.clear, rules.blocked_after) == kept


def test_the_localizer_of_a_simulation_counts_where_the_run_is_simulated(tmp_path: Path) -> None:
    path = mission(tmp_path)
    words = json.loads(path.read_text()) | {"bus": {"interface": "virtual", "channel": "goto"}}
    path.write_text(json.dumps(words))
    with pytest.raises(ConfigError, match="has to come from a localizer"):
        load_mission(path)
    loaded = load_mission(path, simulate=True)
    assert [plan_for(loaded, simulated, None).localized for simulated in (True, False)] == [True, False]


def test_a_robot_without_outline_is_refused(tmp_path: Path) -> None:
    path = mission(tmp_path)
    robot = tmp_path / "artemis.yaml"
    robot.write_text(robot.read_text().replace(OUTLINE, ""))
    with pytest.raises(ConfigError, match="routes are planned for the robot's outline"):
        load_mission(path)


def test_a_walk_knows_how_it_may_end(tmp_path: Path) -> None:
    path = mission(tmp_path)
    assert walk(path, "done", "no-path").ended == "no-path"
    with pytest.raises(ConfigError, match="'goto gate' does not end so; there are done, lost, no-path, fault:ID"):
        walk(path, "done", "blocked")
    assert walk(MISSIONS / "goto_blocked.yaml", "done", "blocked").ended == "failed"
    assert walk(path, "done").at == "goto gate"


def test_zones_that_are_gone_stop_the_robot_until_they_are_back(tmp_path: Path) -> None:
    path, beside = mission(tmp_path), tmp_path / "floor.zones.yaml"
    words = json.loads(path.read_text())
    words["simulation"]["operator"] = [{"at_s": 60.0, "do": "acknowledge"}]
    path.write_text(json.dumps(words))
    rig = Rig(path, longest=90.0)
    beside.unlink()

    def stopped(seen: Seen) -> bool:
        return seen.mode is Mode.QUICKSTOP

    def bring_back() -> None:
        beside.write_text(ZONES)

    rig.when(stopped, bring_back, after=1.0, name="bring back")
    rig.when(stopped, rig.request(Request.ACKNOWLEDGE), after=2.0, name="acknowledge")
    rig.when(stopped, rig.request(Request.ARM), after=3.0, name="arm")
    seen = rig.run()
    assert seen.status == 0
    assert set(seen.fault_ids) == {"PTH-11"}
    (told,) = {fault.text for tick in seen.ticks for fault in tick.snapshot.verdict.faults}
    assert "floor.zones.yaml: is not there any more, and had 1 when it was read last" in told
    assert seen.recompute().difference is None


def test_a_zone_that_is_drawn_where_the_robot_is_to_go_ends_the_step_with_the_reason(tmp_path: Path) -> None:
    path, beside = mission(tmp_path), tmp_path / "floor.zones.yaml"
    rig = Rig(path)
    zone = "{kind: keep-out, corners: [[2, 0], [2.2, 0], [2.2, 3], [2, 3]]}"
    beside.write_text(ZONES.replace("zones: [", f"zones: [{zone}, "))
    seen = rig.run()
    assert seen.status == 1
    assert seen.ticks[-1].position.ended == "no-path"
    assert any(tick.wish.phase.startswith("no route to gate: ") for tick in seen.ticks)
    assert seen.outcome is not None
    found = read_series(Recording(seen.outcome.run.path)).mission.failure
    assert (
        "ended with no-path (no route to gate: no path leads there, however the robot turns; zones changed: new {"
        in found
    )


def test_drives_to_a_place_and_replays_bit_for_bit(tmp_path: Path) -> None:
    seen = run(mission(tmp_path))

    assert seen.status == 0
    pose = seen.seen[-1].pose
    assert math.hypot(pose.x - 2.5, pose.y - 0.8) < 0.03
    assert abs(pose.heading) < math.radians(3)
    (result,) = [each for tick in seen.ticks for each in tick.snapshot.sensed.results if each.kind is JobKind.PLAN]
    assert result.detail == "1.7 m, 0 reversals, radius 0.50 m"
    assert seen.recompute().difference is None
    assert seen.outcome is not None
    with seen.outcome.run.recording.open("rb") as file:
        (message,) = [json.loads(each.data) for _, _, each in make_reader(file).iter_messages(["/path"])]
    assert message["frame_id"] == "map"
    assert message["poses"][0]["position"]["x"] == pytest.approx(0.8, abs=0.05)
    assert message["poses"][-1]["position"]["x"] == pytest.approx(2.5, abs=0.03)


@pytest.mark.exhaustive
def test_a_goto_that_was_interrupted_is_planned_anew_from_where_it_stands(tmp_path: Path) -> None:
    path = mission(tmp_path)
    first = resuming.run(path, until=lambda tick: bool(tick.wish.tracking and tick.wish.tracking.arc_length > 0.8))
    second = resuming.run(path, first.folder)

    assert (first.outcome.exit_status, second.outcome.exit_status) == (1, 0)
    results = [each for tick in second.ticks for each in tick.snapshot.sensed.results if each.kind is JobKind.PLAN]
    assert len(results) == 1
    start = route_poses(results[0].values)[0]
    assert 0.7 < start.x - 0.8 < 1.3
    assert abs(start.y - 0.8) < 0.05


def test_a_run_is_resumed_with_the_zones_of_now_unless_its_goal_has_moved(tmp_path: Path) -> None:
    path, beside = mission(tmp_path), tmp_path / "floor.zones.yaml"
    run = resuming.run(path, until=lambda tick: tick.mode is Mode.FOLLOW).folder

    def notes() -> list[str]:
        return resume_point_of(load_mission(path), path, run)[1]

    assert notes() == []
    wet = '{name: "wet", kind: keep-out, corners: [[1, 2], [2, 2], [2, 2.2]]}'
    beside.write_text(ZONES.replace("zones: [", f"zones: [{wet}, "))
    assert notes() == [f"floor.zones.yaml: zones changed: new {wet}"]
    for changed, why in (
        (ZONES.replace("x_m: 2.5", "x_m: 2.4"), "the place gate is not where it was"),
        (ZONES[ZONES.index("places:") :], "has no zones any more, and had 1"),
    ):
        beside.write_text(changed)
        with pytest.raises(ConfigError, match=why):
            notes()
    beside.write_text(ZONES.replace("x_m: 3.2", "x_m: 3.3"))
    assert notes() == [], "no step leads to the crane"


@pytest.mark.exhaustive
def test_a_crate_behind_the_door_is_driven_around() -> None:
    seen = run(MISSIONS / "goto_blocked.yaml", longest=200.0)
    assert seen.status == 0
    assert "LAS-08" in seen.fault_ids
    plans = [each for tick in seen.ticks for each in tick.snapshot.sensed.results if each.kind is JobKind.PLAN]
    assert len(plans) >= 2
    assert seen.recompute().difference is None


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["clutter", "rooms", "lanes"])
def test_random_goals_are_reached_without_contact(tmp_path: Path, kind: str) -> None:
    legs = drive(tmp_path, kind, 7, 4)
    assert [problem(leg) for leg in legs] == [""] * 5
    assert [leg.closed for leg in legs] == [False] * 4 + [True]
