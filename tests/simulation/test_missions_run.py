"""Every mission that comes with artemis is valid and ends as it should, against simulated drives."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from rig import MISSIONS, Run, run

from artemis.mission.loading import load_mission
from artemis.motion.path import path_from_csv
from artemis.values import Mode

NAMES = sorted(path.name for path in MISSIONS.glob("*.yaml"))
Ran = Callable[[str], Run]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """A mission's run, made once."""
    folder = tmp_path_factory.mktemp("shipped") / "missions"
    shutil.copytree(MISSIONS, folder, ignore=shutil.ignore_patterns("runs"))
    return cache(lambda name: run(folder / name, longest=900.0))


def true_cross_track(seen: Run) -> float:
    """The largest distance [m] of the true rear axle from the path, in the frame of the start."""
    path = path_from_csv((MISSIONS / "paths/figure_eight.csv").read_text(), "figure_eight.csv")
    truths = [(s.pose, s.tick.wish.tracking) for s in seen.in_mode(Mode.FOLLOW)]
    origin = seen.in_mode(Mode.READY)[0].pose
    assert math.hypot(origin.x, origin.y) < 0.05  # the wheels were steered straight where the robot stood
    return max(
        abs(path.project(*seen_from_origin((pose.x, pose.y), seen), near=tracking.arc_length).cross_track)
        for pose, tracking in truths
        if tracking is not None
    )


def seen_from_origin(point: tuple[float, float], seen: Run) -> tuple[float, float]:
    origin = seen.first(lambda s: s.tick.wish.reset_pose).pose
    x, y = point[0] - origin.x, point[1] - origin.y
    cos, sin = math.cos(origin.heading), math.sin(origin.heading)
    return x * cos + y * sin, y * cos - x * sin


def end_error(seen: Run) -> float:
    """Distance [m] between the true and the estimated position at the end."""
    estimated = seen.ticks[-1].snapshot.odometry.pose
    true = seen.world.pose
    x, y = seen_from_origin((true.x, true.y), seen)
    return math.hypot(x - estimated.x, y - estimated.y)


@pytest.mark.parametrize("name", NAMES)
def test_a_mission_that_comes_with_artemis_is_valid(name: str) -> None:
    assert load_mission(MISSIONS / name).mission.steps


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_mission_that_comes_with_artemis_runs_in_simulation_to_its_end(ran: Ran, name: str) -> None:
    seen = ran(name)
    assert (seen.status, seen.fault_ids) == (0, [])
    assert seen.plan.current is None
    assert seen.ticks[-1].wish.finished


@pytest.mark.slow
def test_the_figure_eight_is_driven_to_the_centimetre(ran: Ran) -> None:
    seen = ran("figure_eight.yaml")
    assert true_cross_track(seen) < 0.05
    assert end_error(seen) < 0.05
    assert seen.ticks[-1].snapshot.odometry.distance > 10.0


@pytest.mark.slow
def test_hidden_errors_lead_the_robot_away_while_it_believes_to_be_on_the_path(ran: Ran) -> None:
    seen = ran("hidden_errors.yaml")
    assert seen.cross_track() < 0.05
    assert end_error(seen) > 0.1


@pytest.mark.slow
def test_the_scripted_stick_drives_as_its_table_says(ran: Ran) -> None:
    seen = ran("teleop_scripted.yaml")
    teleop = seen.in_mode(Mode.TELEOP)
    begin = seen.seen[0].time  # the table's time starts when the input is first read
    signs = []
    for time in (10.0, 13.5, 19.5, 27.5):  # to the left forward, the same, to the right forward, right backward
        now = next(s for s in teleop if s.time >= begin + time)
        truth = next(t for t in seen.world.history if t.time >= now.now)
        signs.append((math.copysign(1, truth.speed), math.copysign(1, sum(truth.wheel_angles))))
    assert signs == [(1, 1), (1, 1), (1, -1), (-1, -1)]
    assert all(not s.standing for s in teleop if 8.0 < s.time < 22.0)
    assert teleop[-1].standing
    assert seen.seen[-1].time < begin + 32.0
