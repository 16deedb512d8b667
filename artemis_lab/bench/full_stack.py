"""One run of one follower on one course through everything: a mission on simulated drives, frame by frame.

The robot is as its file says, and knows where it is by odometry only; time is simulated.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from artemis.app import run_mission
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.sim.truth import Truth
from artemis.sim.world import World
from artemis.values import Fault, Mode, Pose, Tick
from artemis.vehicle import RobotFile
from artemis_lab.bench.courses import Course
from artemis_lab.bench.driving import FollowerRefused, RunLog, RunOutcome

ROUNDED = 0.2
"""So far from a corner [m] the path may go where the robot cannot do it; where it cannot steer fast enough, it slows
down."""


class _TooLong(Exception):
    """The run leads nowhere."""


def drive(follower: str, options: Mapping[str, float], course: Course, robot: RobotFile, seed: int) -> RunOutcome:
    """Run a mission that follows the course; the true pose is judged, from where the path begins.

    Raises:
        Refused: `artemis check` would refuse the mission, with its words.
    """
    course = _from_start(course)
    log, truths, faults = RunLog(course), list[Truth](), dict[Fault, None]()

    def witness(world: World) -> World:
        truths.append(Truth(world, Pose()))
        return world

    def watch(tick: Tick, _traffic: Traffic) -> None:
        pose = truths[0].pose(tick)
        faults.update(dict.fromkeys(tick.snapshot.verdict.faults))
        if tick.mode is Mode.FOLLOW and tick.wish.tracking is not None:
            odometry, points = tick.snapshot.odometry, tick.set_points
            log.add(tick.snapshot.time, pose, odometry.distance, odometry.speed, points.steering)
            if log.problem:
                raise _TooLong

    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as folder:
        source = _write(FilePath(folder), follower, options, course, robot, seed)
        try:
            loaded = load_mission(source)
        except ConfigError as error:
            raise FollowerRefused("; ".join(problem.replace(folder, "") for problem in error.problems)) from error
        try:
            failed = run_mission(loaded, source, watch=watch, witness=witness).failed
        except* _TooLong:
            failed = False
        if failed and not log.begun:
            raise FollowerRefused(_words(faults))
        driven = log.driven(1 / loaded.mission.tick_hz)
    return replace(driven, problem=f"stopped: {_words(faults)}") if failed else driven


def _from_start(course: Course) -> Course:
    """The course as seen from where the robot starts on it."""
    start = course.start()
    cosine, sine = math.cos(start.heading), math.sin(start.heading)
    turned = (course.points - [start.x, start.y]) @ np.array([[cosine, -sine], [sine, cosine]])
    return replace(course, points=turned)


def _write(
    folder: FilePath, follower: str, options: Mapping[str, float], course: Course, robot: RobotFile, seed: int
) -> FilePath:
    """Lay the files of the mission."""
    rows = [f"{x:.5f},{y:.5f}" for x, y in course.points]
    (folder / "path.csv").write_text("\n".join(["x_m,y_m", *rows, ""]))
    (folder / "robot.yaml").write_text(robot.model_dump_json(exclude_none=True))
    follow = {
        "path": "path.csv",
        "follower": {"plugin": follower, **options},
        "round_corners_m": ROUNDED,
        "allow_slowdown": True,
    }
    mission = {
        "mission": "bench",
        "robot": "robot.yaml",
        "bus": "simulation",
        "steps": [{"calibrate": {"steering": "from_potentiometers"}}, {"follow": follow}],
        "simulation": {"seed": seed, "pace": "fast"},
    }
    source = folder / "mission.yaml"
    source.write_text(json.dumps(mission))
    return source


def _words(faults: Mapping[Fault, None]) -> str:
    return "; ".join(f"{fault.id} {fault.text}" for fault in faults) or "no fault was reported"
