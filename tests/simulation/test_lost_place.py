"""Drives that lost their power did not count how the robot rolled: it must not go on along its path from a guess."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from every_row import short_alignment
from rig import CALIBRATE, STICK, TELEOP, Run, follow, run, stick, straight, write_mission

from artemis import app
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.values import Mode

FOLLOWING, ACKNOWLEDGED, ARMED = 6.0, 12.0, 15.0
"""When it happens, and when somebody acts [s]."""
RESTART = {"inject": "COM-26", "node": "traction-left"}
NO_POWER = {"inject": "SYS-09", "duration_s": 3.0}
FILES = {
    "line.csv": straight(2.0),
    "stick.csv": stick((0, 0, 0, 0), (3.0, 0, 1, 1), (8.0, 0, 0, 0), (18.0, 0, 1, 1), (25.0, 0, 0, 0)),
}


def broken(folder: Path, fault: Mapping[str, Any], steps: Sequence[Mapping[str, Any]], end: float = 60.0) -> Run:
    """The run in which it happens; somebody acknowledges, arms, and at last ends it."""
    acts = (ACKNOWLEDGED, "acknowledge"), (ARMED, "arm"), (end, "end")
    simulation = {
        "faults": [{"at_s": FOLLOWING, **fault}],
        "operator": [{"at_s": time, "do": what} for time, what in acts],
    }
    with short_alignment():
        seen = run(write_mission(folder, steps, FILES, inputs=STICK, simulation=simulation), longest=70.0)
        assert seen.recompute().difference is None
    return seen


def following(seen: Run, since: float = 0.0) -> bool:
    return any(s.phase == "following" for s in seen.in_mode(Mode.FOLLOW) if s.time >= since)


@pytest.mark.parametrize("fault", [RESTART, NO_POWER], ids=["one restarts", "none has power"])
def test_a_path_is_not_gone_on_with_from_an_unknown_place(tmp_path: Path, fault: Mapping[str, Any]) -> None:
    seen = broken(tmp_path, fault, [CALIBRATE, follow(0.4)], end=24.0)

    assert following(seen)
    assert not following(seen, since=ARMED)
    found = next(fault for fault in seen.faults if fault.id == "RUN-08")
    assert (seen.status, found.final) == (1, True)
    assert "the position of the robot is lost" in found.text
    assert seen.modes[-3:] == [Mode.FOLLOW, Mode.QUICKSTOP, Mode.END]
    stood = [s.pose for s in seen.seen if s.time >= ARMED]
    assert max(abs(a.x - b.x) for a, b in itertools.pairwise(stood)) < 1e-4
    believed, true = seen.ticks[-1].snapshot.odometry.pose, seen.seen[-1].pose
    assert true.x - believed.x > 0.1, "else this test shows nothing"
    assert_not_resumed(seen)


def assert_not_resumed(seen: Run) -> None:
    assert seen.outcome is not None
    with pytest.raises(ConfigError, match="the position of the robot is unknown"):
        app.resume_point_of(load_mission(seen.mission), seen.mission, seen.outcome.run.path)


@pytest.mark.parametrize("fault", [RESTART, {"inject": "SYS-09"}], ids=["one restarts", "none has power"])
def test_a_run_that_ended_in_an_unknown_place_is_not_resumed(tmp_path: Path, fault: Mapping[str, Any]) -> None:
    simulation = {"faults": [{"at_s": FOLLOWING, **fault}]}
    with short_alignment():
        seen = run(write_mission(tmp_path, [CALIBRATE, follow(0.4)], FILES, inputs=STICK, simulation=simulation))

    assert (seen.status, following(seen)) == (1, True)
    assert_not_resumed(seen)


@pytest.mark.parametrize("fault", [RESTART, NO_POWER], ids=["one restarts", "none has power"])
def test_a_robot_that_stood_goes_on_along_its_path(tmp_path: Path, fault: Mapping[str, Any]) -> None:
    seen = broken(tmp_path, fault, [CALIBRATE, {"wait": {"seconds": 3.0}}, follow(0.4)])

    assert Mode.FAULT in seen.modes
    assert (seen.status, "RUN-08" in seen.fault_ids) == (0, False)
    assert seen.seen[-1].pose.x == pytest.approx(2.0, abs=0.03)


def test_driving_by_hand_goes_on_without_a_place_but_is_not_recorded(tmp_path: Path) -> None:
    seen = broken(tmp_path, RESTART, [{"teleop": {**TELEOP["teleop"], "record": "shown"}}], end=22.0)

    assert Mode.FAULT in seen.modes
    assert "RUN-08" not in seen.fault_ids
    assert seen.ticks[-1].snapshot.odometry.lost
    driving = [s for s in seen.in_mode(Mode.TELEOP) if s.time > ARMED and s.tick.set_points.speed > 0.1]
    assert len(driving) > 50
    lost = next(s.tick.snapshot.odometry.pose.x for s in seen.seen if s.tick.snapshot.odometry.lost)
    assert 0.5 < max(pose.x for pose in seen.results.tracks["shown"].poses) <= lost
