"""Whole missions of a robot with a scanner, among things and people: judged by the true pose."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig import CALIBRATE, MISSIONS, Run, run, stick, write_mission

from artemis.commands.run import run_and_report
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.report.page import _rows
from artemis.report.series import read_series
from artemis.report.summary import summary
from artemis.values import Mode, Pose

pytestmark = pytest.mark.short_alignment

LONG = {"follow": {"path": {"waypoints": [[0, 0], [4, 0]]}, "follower": {"speed_m_s": 0.5}}}
WALLS = [{"points": [[-2, -2.5], [8, -2.5], [8, 2.5], [-2, 2.5], [-2, -2.5]]}]
POST = {"x_m": 2.6, "y_m": 0.05, "diameter_m": 0.1}
FRONT, HALF_WIDTH = 0.68, 0.27


def mission(folder: Path, steps: list[Any], *, bus: object = "simulation", **keys: Any) -> Path:  # noqa: ANN401 (of a file)
    simulation = {"seed": 3, "world": keys.pop("world", {"walls": WALLS}), **keys.pop("simulation", {})}
    path = write_mission(folder, steps, bus=bus, simulation=simulation, **keys)
    shutil.copy(MISSIONS / "robots" / "artemis_lms100.yaml", folder / "artemis.yaml")
    return path


def post_to_robot(pose: Pose, post: dict[str, float] = POST) -> float:
    """From the front edge of the true robot to the post [m]; infinite where the post is not ahead."""
    dx, dy = post["x_m"] - pose.x, post["y_m"] - pose.y
    ahead = math.cos(pose.heading) * dx + math.sin(pose.heading) * dy
    left = math.cos(pose.heading) * dy - math.sin(pose.heading) * dx
    radius = post["diameter_m"] / 2
    return ahead - radius - FRONT if abs(left) < HALF_WIDTH + radius else math.inf


def faults(seen: Run) -> set[str]:
    return {fault.id for tick in seen.ticks for fault in tick.snapshot.verdict.faults}


@pytest.mark.slow
def test_waits_for_what_stands_in_its_way_and_drives_on_once_it_is_gone(tmp_path: Path) -> None:
    path = mission(tmp_path, [CALIBRATE, LONG], world={"walls": WALLS, "poles": [{**POST, "until_s": 25}]})

    seen = run(path)

    assert seen.status == 0
    assert faults(seen) == {"LAS-08"}
    nearest = min(post_to_robot(each.pose) for each in seen.seen if each.now < 25)
    assert 0.03 < nearest < 0.3
    waited = [tick for tick in seen.ticks if tick.set_points.clearance and tick.set_points.clearance.blocked]
    assert waited[-1].snapshot.time == pytest.approx(26.0, abs=0.3)
    assert seen.recompute().difference is None


@pytest.mark.slow
def test_a_step_that_stays_blocked_ends_so(tmp_path: Path) -> None:
    keys: dict[str, Any] = {"world": {"walls": WALLS, "poles": [POST]}, "obstacles": {"blocked_after_s": 3}}
    caught = {"try": {"steps": [LONG], "catch": {"blocked": [{"say": "blocked"}]}}}

    without, with_try = (
        run(mission(tmp_path / name, [CALIBRATE, step], **keys)) for name, step in (("a", LONG), ("b", caught))
    )

    assert (without.status, with_try.status) == (1, 0)
    assert "blocked" in [event.text for tick in with_try.ticks for event in tick.events]
    assert all(post_to_robot(each.pose) > 0.03 for each in [*without.seen, *with_try.seen])


@pytest.mark.exhaustive
def test_each_step_may_have_its_own_rules(tmp_path: Path) -> None:
    away = {"follow": {**LONG["follow"], "obstacles": {"mode": "off", "reason": "the post is of foam"}}}

    seen = run(mission(tmp_path, [CALIBRATE, away], world={"walls": WALLS, "poles": [POST]}))

    assert seen.status == 0
    assert min(post_to_robot(each.pose) for each in seen.seen) < 0.0
    assert max(abs(tick.set_points.speed) for tick in seen.ticks) == pytest.approx(0.3)
    assert seen.recompute().difference is None


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("off", "the robot may drive into what it could see, at up to 0.3 m/s (the post is of foam)"),
        ("slow", "the robot may creep into what it sees, at up to 0.1 m/s (the post is of foam)"),
    ],
)
def test_that_obstacles_may_be_touched_is_said_before_in_and_after_the_run(
    tmp_path: Path, mode: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    short = {"path": {"waypoints": [[0, 0], [0.6, 0]]}, "follower": {"speed_m_s": 0.5}}
    step = {"follow": {**short, "obstacles": {"mode": mode, "reason": "the post is of foam"}}}
    told = f"steps[1].follow.obstacles: {mode}: {words}"
    path = mission(tmp_path, [CALIBRATE, step])
    assert load_mission(path).remarks == (told,)

    assert run_and_report(path, simulate=True) == 0

    assert told in " ".join(capsys.readouterr().out.split())
    (folder,) = (tmp_path / "runs").iterdir()
    recording = Recording(folder)
    assert recording.journal is not None
    assert [entry.text for entry in recording.journal.entries if entry.kind == "obstacles"] == [told]
    series = read_series(recording)
    assert dict(_rows(summary(recording, series)))["may have touched obstacles"] == told
    if mode == "off":
        assert not np.isfinite(series.slowed).any(), "it is no obstacle that slows it down"


@pytest.mark.exhaustive
def test_backwards_over_unknown_ground_is_blocked_unless_the_mission_allows_it(tmp_path: Path) -> None:
    back = {
        "follow": {"path": {"waypoints": [[0, 0], [-1, 0]]}, "follower": {"speed_m_s": 0.3}, "direction": "backward"}
    }
    careful = {"follow": {**back["follow"], "obstacles": {"unseen_reverse": "allowed"}}}

    blocked, allowed = (
        run(mission(tmp_path / name, [CALIBRATE, step], obstacles={"blocked_after_s": 2}))
        for name, step in (("a", back), ("b", careful))
    )

    assert (blocked.status, allowed.status) == (1, 0)
    assert min(tick.set_points.speed for tick in blocked.ticks) == 0.0
    assert min(tick.set_points.speed for tick in allowed.ticks) == pytest.approx(-0.2)


@pytest.mark.slow
def test_modes_that_drive_by_hand_stop_too_and_may_back_off(tmp_path: Path) -> None:
    rows = ["time_s,speed,steering,enable", "0,0,0,0", "9,1,0,1", "15,0,0,1", "16,-1,0,1", "19,0,0,0"]
    (tmp_path / "drive.csv").parent.mkdir(parents=True, exist_ok=True)
    path = mission(
        tmp_path,
        [CALIBRATE, {"teleop": {"input": "stick", "until": {"seconds": 18}}}],
        inputs={"stick": {"plugin": "scripted", "file": "drive.csv", "max_speed_m_s": 0.5}},
        world={"walls": WALLS, "poles": [POST]},
    )
    (tmp_path / "drive.csv").write_text("\n".join(rows) + "\n")

    seen = run(path)

    assert seen.status == 0
    places = [each.pose.x for each in seen.seen if each.mode is Mode.TELEOP]
    assert min(post_to_robot(each.pose) for each in seen.seen) > 0.03
    assert max(places) > 1.5
    assert places[-1] < max(places) - 0.2


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"obstacles": "halt"}, "stop"),
        ({"obstacles": {"margin_m": 0.01}}, "0.03"),
        ({"obstacles": "off", "bus": {"interface": "virtual"}}, "write why"),
        ({"obstacles": "slow", "bus": {"interface": "virtual"}}, "creep into what it sees; write why"),
        ({"obstacles": {"modus": "stop"}}, "mode"),
    ],
)
def test_wrong_rules_are_refused_with_their_place(tmp_path: Path, keys: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        load_mission(mission(tmp_path, [CALIBRATE, LONG], **keys))
    assert "obstacles" in str(caught.value)


@pytest.mark.parametrize(
    ("mounted", "where"),
    [
        (("heading_deg: 0", "heading_deg: 180"), "from -24 to +24 cm"),
        (("least_range_m: 0.5", "least_range_m: 0.5\n    mask: [[-27, 27]]"), "from -23 to +23 cm"),
        (("least_range_m: 0.5", "least_range_m: 0.5\n    mask: [[3, 9]]"), "from +4 to +7 cm"),
    ],
)
def test_a_robot_whose_scanner_does_not_see_ahead_is_refused(
    tmp_path: Path, mounted: tuple[str, str], where: str
) -> None:
    off = {"follow": {**LONG["follow"], "obstacles": {"mode": "off", "reason": "somebody walks ahead"}}}
    path = mission(tmp_path, [CALIBRATE, off, LONG])
    robot = tmp_path / "artemis.yaml"
    robot.write_text(robot.read_text().replace(*mounted))
    with pytest.raises(ConfigError, match="no scanner sees all of the ground ahead") as caught:
        load_mission(path)
    assert where in str(caught.value)
    assert "artemis.yaml:" in str(caught.value)
    load_mission(mission(tmp_path / "off", [CALIBRATE, off]))
    load_mission(mission(tmp_path / "standing", [CALIBRATE, {"wait": {"seconds": 1}}]))


def test_a_least_range_below_that_of_the_device_is_refused(tmp_path: Path) -> None:
    path = mission(tmp_path, [CALIBRATE, LONG])
    robot = tmp_path / "artemis.yaml"
    robot.write_text(robot.read_text().replace("least_range_m: 0.5", "least_range_m: 0.05"))
    with pytest.raises(ConfigError, match=r"least_range_m: lms1xx measures nothing nearer than 0.5 m"):
        load_mission(path)


def test_a_robot_without_a_scanner_cannot_stop_for_obstacles(tmp_path: Path) -> None:
    path = write_mission(tmp_path, [CALIBRATE, LONG], obstacles="stop")

    with pytest.raises(ConfigError, match="has no scanner"):
        load_mission(path)


@pytest.mark.slow
def test_what_comes_too_near_to_be_seen_does_not_cover_the_scanner(tmp_path: Path) -> None:
    box = {"x_m": 2.6, "y_m": 0, "length_m": 0.6, "width_m": 0.4}
    keys: dict[str, Any] = {"world": {"walls": WALLS, "boxes": [box]}, "obstacles": {"blocked_after_s": 3}}

    seen = run(mission(tmp_path, [CALIBRATE, LONG], **keys))

    assert faults(seen) == {"LAS-08"}
    assert max(each.pose.x for each in seen.seen) + FRONT < 2.3


BOX = {"x_m": 5.0, "y_m": 0.0, "length_m": 0.4, "width_m": 0.5}
HALL = [{"points": [[-2, -2.5], [10, -2.5], [10, 2.5], [-2, 2.5], [-2, -2.5]]}]
RESTART = {"at_s": 8, "inject": "COM-26", "node": "traction-left"}
BY_A_PERSON = [{"at_s": 14, "do": "acknowledge"}, {"at_s": 20, "do": "arm"}]


@pytest.mark.parametrize("tick_hz", [50, pytest.param(100, marks=pytest.mark.exhaustive)])
def test_stops_for_what_stands_there_though_the_wheels_once_rolled_uncounted(tmp_path: Path, tick_hz: int) -> None:
    """Then the place is lost for the rest of the run; what the scanner sees is not."""
    forwards = stick((0, 0, 0, 0), (4.2, 0, 0.6, 1), (8.5, 0, 0, 0), (28, 0, 0.6, 1), (90, 0, 0.6, 1))
    hand = {"stick": {"plugin": "scripted", "file": "stick.csv", "max_speed_m_s": 0.5, "done_at_end": False}}
    step = {"teleop": {"input": "stick", "until": {"seconds": 40}}}
    simulation = {"faults": [RESTART], "operator": BY_A_PERSON}
    world = {"walls": HALL, "boxes": [BOX]}

    seen = run(
        mission(
            tmp_path,
            [step],
            files={"stick.csv": forwards},
            inputs=hand,
            tick_hz=tick_hz,
            world=world,
            simulation=simulation,
        )
    )

    assert any(tick.snapshot.odometry.lost for tick in seen.ticks)
    ahead = [BOX["x_m"] - BOX["length_m"] / 2 - FRONT - each.pose.x for each in seen.seen]
    assert 0.03 < min(ahead) < 0.3
