"""What a page is told of a run: numbers, faults in words, the step tree; paths, scans and maps as parts."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from page_rig import MISSIONS, Recorded, recorded

from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_mission
from artemis.motion.ackermann import Ackermann
from artemis.motion.poses import seen_from
from artemis.page.view import MOST_BEAMS, MOST_TRAIL, PageView, mission_in
from artemis.progress import Position
from artemis.values import DriveFeedback, Mode, OperatorInput, Pose, Request
from artemis.vehicle import RobotFile
from artemis.yaml_file import load


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return recorded("fault_recovery_by_hand.yaml", 25.0, tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return recorded("look_around.yaml", 9.0, tmp_path_factory.mktemp("runs"))


def view_of(run: Recorded) -> PageView:
    mission = mission_in(run.loaded.mission.model_dump_json(by_alias=True).encode())
    return PageView(run.loaded.robot, mission, run.loaded.routes)


def seen(run: Recorded, view: PageView) -> Iterator[int]:
    for number, (tick, _) in enumerate(run.ticks):
        view.see(tick)
        yield number


def test_a_fault_comes_in_the_words_of_the_fault_table(faulty: Recorded) -> None:
    view = view_of(faulty)
    at = faulty.at(lambda tick: tick.mode is Mode.FAULT)
    for number in seen(faulty, view):
        if number == at:
            break
    version, faults = view.parts["faults"]
    assert version > 1
    worst = faults[0]
    assert set(worst) == {"id", "device", "text", "severity", "look", "artemis", "next"}
    assert all(worst[name] for name in ("id", "text", "look", "artemis", "next"))
    state = view.state(faulty.ticks[at][0])
    assert (state["mode"], state["severity"]) == ("fault", worst["severity"])
    assert any(line["kind"] == "fault" and worst["id"] in line["text"] for line in view.log)


def test_every_state_is_json_of_finite_numbers(faulty: Recorded) -> None:
    view = view_of(faulty)
    for number in seen(faulty, view):
        if number % 50 == 0:
            text = msgspec.json.encode(view.state(faulty.ticks[number][0]))
            assert b"NaN" not in text
            assert b"Infinity" not in text
            assert len(text) < 2500
    about = view.about()
    assert len(about["series"]) == len(view.history[0])
    assert about["steps"]["numbered"]
    assert len(view.trail) <= MOST_TRAIL


@pytest.mark.parametrize("robot", ["small_car", "tricycle"])
def test_one_motor_turns_both_wheels_that_are_drawn(faulty: Recorded, robot: str) -> None:
    described = RobotFile.model_validate(load(MISSIONS / "robots" / f"{robot}.yaml").data)
    (name,) = [name for name, drive in described.drives.items() if drive.role == "steering"]
    tick = faulty.ticks[0][0]
    steering = DriveFeedback(name=name, position=0.2, age=0.0)
    sensed = replace(tick.snapshot.sensed, drives=(steering,))
    turned = replace(tick, snapshot=replace(tick.snapshot, sensed=sensed))
    view = PageView(described, {}, {})
    assert view.about()["front_wheels"] == described.geometry.front_wheels
    left, right = view.state(turned)["wheels"]
    assert left == right == pytest.approx(Ackermann(described.geometry).steering_from_left(0.2))


def test_the_path_of_a_step_comes_once_and_leaves_with_it(faulty: Recorded) -> None:
    view = view_of(faulty)
    versions = {view.parts["path"][0] for _ in seen(faulty, view)}
    assert len(versions) == len({tick.position.step for tick, _ in faulty.ticks})


@pytest.mark.slow
def test_a_scan_is_where_the_scanner_saw_it(scanned: Recorded) -> None:
    view = view_of(scanned)
    for number in seen(scanned, view):
        scans = scanned.ticks[number][0].snapshot.sensed.scans
        if scans and view.parts["scan"][1] is not None and number > 100:
            break
    scan, located = scans[-1], scanned.ticks[number][0].snapshot.pose
    points = np.frombuffer(base64.b64decode(view.parts["scan"][1]), "<i4").reshape(-1, 2) / 100
    mounting = scanned.loaded.robot.scanners[scan.source]
    x, y = points[0]
    step = -(-len(scan.millimetres) // MOST_BEAMS)
    beam = step * next(index for index, range in enumerate(scan.millimetres[::step]) if range > 0)
    local = seen_from(located.pose, Pose(x=x, y=y))
    away = np.hypot(local.x - mounting.x_m, local.y - mounting.y_m)
    angle = np.arctan2(local.y - mounting.y_m, local.x - mounting.x_m) - mounting.heading
    assert away == pytest.approx(scan.millimetres[beam] / 1000, abs=0.02)
    assert np.cos(angle - (scan.start_angle + beam * scan.increment)) == pytest.approx(1.0, abs=1e-3)


def test_a_map_comes_as_runs_of_equal_cells(scanned: Recorded) -> None:
    cells = np.array([[0, 0, 100], [-1, 100, 100]], np.int8)
    shown = ShownMap(content=OccupancyMap(cells=cells, resolution=0.05, origin=(1.0, 2.0, 0.0)))
    view = PageView(scanned.loaded.robot, {}, {}, lambda: shown)
    tick, _ = scanned.ticks[0]
    view.see(tick)
    part = view.parts["map"][1]
    assert (part["size"], part["origin"]) == ([3, 2], [1.0, 2.0, 0.0])
    assert part["runs"] == [0, 2, 1, 1, 2, 1, 1, 2]
    view.see(tick)
    assert view.parts["map"][0] == 1, "once"


def test_a_mission_that_is_not_known_has_no_steps(scanned: Recorded) -> None:
    assert mission_in(b"") == {}
    assert PageView(scanned.loaded.robot, {}, {}).about()["steps"] == {"tree": None, "numbered": []}


@pytest.mark.parametrize(
    ("mission", "acts"),
    [
        ("page_goto.yaml", {"allow": ["goal_pose", "initialpose"], "goals": [1]}),
        ("ros_goto.yaml", {"goals": []}),  # another input is asked
        ("page_teleop.yaml", {"records": [1], "goals": [], "questions": {}}),
        ("ask_which_way.yaml", {"questions": {1: {"question": "which way?", "answers": ["left", "right", "stop"]}}}),
        ("figure_eight.yaml", {"allow": [], "goals": [], "records": [], "questions": {}}),
    ],
)
def test_a_page_is_told_in_which_steps_an_operator_may_do_what(mission: str, acts: dict[str, object]) -> None:
    loaded = load_mission(MISSIONS / mission)
    view = PageView(loaded.robot, mission_in(loaded.mission.model_dump_json(by_alias=True).encode()), {})
    told = view.about()["acts"]
    assert {name: told[name] for name in acts} == acts


def test_presses_of_the_record_button_are_counted_in_their_step(faulty: Recorded) -> None:
    view, (tick, _) = view_of(faulty), faulty.ticks[-1]
    pressed = OperatorInput(source="page", requests=(Request.RECORD,))

    def seen_at(step: int, *inputs: OperatorInput) -> int:
        sensed = replace(tick.snapshot.sensed, inputs=inputs, requests=())
        snapshot = replace(tick.snapshot, sensed=sensed)
        now = replace(tick, mode=Mode.TELEOP, position=Position(step=step), snapshot=snapshot)
        view.see(now)
        presses = view.state(now)["presses"]
        assert isinstance(presses, int)
        return presses

    assert [seen_at(1), seen_at(1, pressed), seen_at(1), seen_at(1, pressed), seen_at(2)] == [0, 1, 1, 2, 0]


def test_the_voltages_of_the_potentiometers_are_told_of_steered_wheels(faulty: Recorded) -> None:
    drives = view_of(faulty).state(faulty.ticks[-1][0])["drives"]
    assert [len(drive) for drive in drives].count(5) == 2
    assert all(len(drive[4]) == 2 for drive in drives if len(drive) == 5)


def test_the_key_of_a_page_is_not_in_what_is_told(faulty: Recorded, tmp_path: Path) -> None:
    assert "key" not in view_of(faulty).about()
