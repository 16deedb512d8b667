"""A mission that localises on a map by a laser scanner: followed for long, and begun at places that it is not given."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from artemis import app
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.mapping.map_file import read_map
from artemis.mission.loading import load_mission
from artemis.motion.poses import placed
from artemis.recording.mcap_reader import Recording
from artemis.report.summary import Summary, summary
from artemis.route_planning.floor import CELL, floor_from, goal_problem
from artemis.sim.world import World
from artemis.values import Pose, Tick
from artemis.yaml_file import load

LAPS = 10_000
"""More than any drive has: it ends by its time."""
STANDS = 20.0
"""A robot that is switched on somewhere stands for so long [s]."""
ROOM = 0.1
"""There is so much room around its outline [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GlobalStart:
    """A robot that was switched on at a place that it was not given."""

    place: Pose
    """The true one, on the map."""
    after: float = math.inf
    """Run time of the first pose that was not lost [s]; infinite: there was none."""
    off: float = 0.0
    """Greatest distance of the poses from then on from the true one [m]."""


def copied(mission: Path, folder: Path) -> Path:
    """A mission in a copy of its folder; its file.

    Raises:
        ConfigError: it has errors, or is no simulated mission that follows a path by the localizer `scan_map`.
    """
    loaded = load_mission(mission)
    localizer, steps = loaded.mission.localizer, _content(mission)["steps"]
    if localizer is None or localizer.plugin != "scan_map" or not any("follow" in step for step in steps):
        raise ConfigError(f"{mission}: expected a mission with the localizer scan_map and a step follow")
    shutil.copytree(mission.parent, folder, ignore=shutil.ignore_patterns("runs"))
    return folder / mission.name


def followed(mission: Path, minutes: float) -> Summary:
    """Follow the path of a copied mission, lap after lap, for so much run time."""
    content = _content(mission)
    for step in content["steps"]:
        if "follow" in step:
            step["follow"]["laps"] = LAPS
    content["simulation"]["operator"] = [{"at_s": 60.0 * minutes, "do": "end"}]
    outcome = _run(mission, content)
    return summary(Recording(outcome.run.recording))


def places(mission: Path, count: int, seed: int) -> list[Pose]:
    """Random places on the map of a copied mission where its robot can stand."""
    content, robot = _content(mission), load_mission(mission).robot
    floor = floor_from(read_map(mission.parent / content["localizer"]["map"]))
    dice, found = np.random.default_rng(seed), list[Pose]()
    rows, columns = floor.occupied.shape
    while len(found) < count:
        x, y, heading = dice.uniform((0.0, 0.0, -math.pi), (columns * CELL, rows * CELL, math.pi)).tolist()
        pose = placed(floor.origin, Pose(x=x, y=y, heading=heading))
        if goal_problem(floor, robot, pose, ROOM) is None:
            found.append(pose)
    return found


def begun(mission: Path, place: Pose) -> GlobalStart:
    """Switch the robot of a copied mission on somewhere; it stands."""
    content = _content(mission)
    content["steps"] = [{"wait": {"seconds": STANDS}}]
    content["localizer"]["start"] = "global"
    content["simulation"]["true_robot"] = {"x_m": place.x, "y_m": place.y, "heading_deg": math.degrees(place.heading)}
    worlds: list[World] = []
    poses: list[tuple[float, float]] = []

    def meet(world: World) -> World:
        worlds.append(world)
        return world

    def watch(tick: Tick, _traffic: Traffic) -> None:
        located, true = tick.snapshot.pose, worlds[0].pose
        if located.frame != "odom" and not located.lost:
            poses.append((tick.snapshot.time, math.hypot(located.pose.x - true.x, located.pose.y - true.y)))

    _run(mission, content, watch=watch, witness=meet)
    if not poses:
        return GlobalStart(place=place)
    return GlobalStart(place=place, after=poses[0][0], off=max(off for _, off in poses))


def _content(mission: Path) -> dict[str, Any]:
    return dict(load(mission).data)  # type: ignore[arg-type]  # it is a mission


def _run(mission: Path, content: dict[str, Any], **seen: Any) -> app.Outcome:  # noqa: ANN401 (of run_mission)
    """Run a copied mission with another content."""
    changed = mission.with_name("changed.json")
    changed.write_text(json.dumps(content))
    return app.run_mission(load_mission(changed), changed, **seen)
