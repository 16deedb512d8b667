"""Random goals on three kinds of map, each driven to by simulated drives: is it reached, and is nothing touched?

What judges is no part of the planner: the robot's rectangle against points 1 cm apart on the edges of the map's
occupied cells, at the true pose while it drives and along each planned route.
"""

from __future__ import annotations

import json
import math
import signal
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from artemis import app
from artemis.clock import cpu_time
from artemis.devices.can_bus import Traffic
from artemis.mapping.map_file import map_files
from artemis.mission.goto import BEYOND, NARROW
from artemis.mission.loading import LoadedMission, load_mission
from artemis.motion.planned_route import unpacked_route
from artemis.mounting import Mounting, Outline
from artemis.route_planning import device, zoned
from artemis.route_planning.floor import MARGIN, floor_from, goal_problem
from artemis.route_planning.planner import PlannedRoute, RouteRequest, plan_route
from artemis.sim.world import World
from artemis.testing.contracts import ROBOT
from artemis.values import JobKind, JobResult, Pose, Tick
from artemis.whole_files import write_bytes
from artemis_lab.bench.floor_plans import CELL, CLOSET, MAPS, SIZE, small_plan
from artemis_lab.workers import fresh_workers

OUTLINE = Outline(front_m=0.68, rear_m=0.12, half_width_m=0.27)
"""Of ARTEMIS with its wheels turned out."""
SCANNER = Mounting.model_validate(
    {
        **{"plugin": "lms1xx", "host": "scanner", "least_range_m": 0.5},
        **{"x_m": 0.56, "y_m": 0.0, "heading_deg": 0.0, "height_m": 0.3},
    }
)
"""Above its front axle."""
CHAIN = 5
"""Goals of one run, one after the other; then one to which no path leads."""
SPEED = 0.5
"""[m/s]."""
LOOK = 2
"""The true pose is judged at every so many ticks."""
AHEAD = 0.7
"""Where a robot with a scanner starts, it has so much room ahead of it [m]: it has not seen what is behind it."""
FIRST = 1.0
"""A route may begin nearer to an obstacle than it goes on: so far from its start it is judged by itself [m]."""
_SPACING = 0.02
_FARTHEST, _FAR, _TILE = 0.2, 0.95, 0.25


@dataclass(slots=True, kw_only=True)
class GoalDrive:
    """What came of one goal."""

    map: str
    seed: int
    number: int
    """In its run, from 1."""
    closed: bool
    """No path leads there."""
    ended: str = "not driven to"
    """done, or the outcome with the reason of the planner or of the obstacle stop, or what went wrong."""
    plans: list[str] = field(default_factory=list)
    """What the planner said, in words."""
    seconds: list[float] = field(default_factory=list)
    """Processor time of each plan [s]."""
    expanded: list[int] = field(default_factory=list)
    """Poses that each of these looked at."""
    room: float = math.inf
    """From the outline to the nearest obstacle along the planned routes, but for the first metre [m]."""
    nearest: float = math.inf
    """Likewise from the true outline while it drove [m]; at most 0: contact."""
    off: float = math.nan
    """True distance from the goal at the end [m]."""
    turned: float = math.nan
    """Likewise [rad]."""


class CellEdges:
    """Points on the edges of occupied cells, 1 cm apart."""

    def __init__(self, occupied: NDArray[np.bool_]) -> None:
        rows, columns = np.nonzero(occupied)
        side = np.linspace(0.0, CELL, 6)
        frame = [(a, b) for a in side for b in side if a in (side[0], side[-1]) or b in (side[0], side[-1])]
        points = np.concatenate([np.column_stack([columns * CELL + a, rows * CELL + b]) for a, b in frame])
        self._points = np.unique(points.round(4), axis=0)
        self._near: dict[tuple[int, int], NDArray[np.float64]] = {}

    def room(self, pose: Pose) -> float:
        """From the outline at a pose to the nearest point, at most 0.2 [m]; not above 0: it is touched."""
        tile = math.floor(pose.x / _TILE), math.floor(pose.y / _TILE)
        if tile not in self._near:
            middle = (np.array(tile) + 0.5) * _TILE
            self._near[tile] = self._points[np.abs(self._points - middle).max(axis=1) < _FAR + _TILE / 2].T
        near = self._near[tile]
        x, y = near - np.array([[pose.x], [pose.y]])
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        u, v = c * x + s * y, np.abs(c * y - s * x) - OUTLINE.half_width_m
        ahead = np.maximum(-OUTLINE.rear_m - u, u - OUTLINE.front_m)
        outside = np.hypot(np.maximum(ahead, 0.0), np.maximum(v, 0.0))
        return float(np.where((ahead > 0) | (v > 0), outside, np.maximum(ahead, v)).min(initial=_FARTHEST))


def drive(folder: Path, kind: str, seed: int, goals: int = CHAIN, *, blind: bool = False) -> list[GoalDrive]:
    """Drive to random goals, one after the other, from a random place; the last one is in the closet.

    Args:
        folder: for the mission's files and its run; empty.
        kind: of the map.
        seed: of map, goals and noise.
        goals: that can be reached, as far as the walls go.
        blind: the robot has no scanner, and does not stop for obstacles.
    """
    dice, plan = np.random.default_rng([seed, MAPS.index(kind)]), small_plan(kind, seed)
    write_bytes(map_files(folder / "map.yaml", plan.content))
    body = {"outline": OUTLINE} if blind else {"outline": OUTLINE, "scanners": {"front": SCANNER}}
    robot, floor = ROBOT.model_copy(update=body), floor_from(plan.content)
    (folder / "robot.yaml").write_text(robot.model_dump_json(exclude_none=True))

    margin = MARGIN if blind else NARROW + BEYOND

    def place(left: float, right: float, *, begins: bool = False) -> Pose:
        while True:
            heading = math.radians(round(math.degrees(dice.uniform(-3.1, 3.1)), 3))
            pose = Pose(x=dice.uniform(left, right), y=dice.uniform(0.5, SIZE - 0.5), heading=heading)
            ahead = [Pose(x=pose.x + far * math.cos(heading), y=pose.y + far * math.sin(heading), heading=heading)
                     for far in (AHEAD, 0.0)]  # fmt: skip
            if all(goal_problem(floor, robot, each, margin) is None for each in ahead[0 if begins else 1 :]):
                return pose

    poses = [place(0.5, SIZE - 0.5, begins=not blind), *[place(0.5, SIZE - 0.5) for _ in range(goals)]]
    poses.append(place(SIZE + 0.2, SIZE + CLOSET - 0.2))
    places = [{"x_m": each.x, "y_m": each.y, "heading_deg": math.degrees(each.heading)} for each in poses]
    outcomes = ["no-path", *(["blocked"] if robot.scanners else [])]
    steps = [
        {"try": {"steps": [{"goto": {"map": "map.yaml", "to": each, "speed_m_s": SPEED}}],
                 "catch": {name: [{"say": name}] for name in outcomes}}}
        for each in places[1:]
    ]  # fmt: skip
    mission = {
        "mission": "goals",
        "robot": "robot.yaml",
        "bus": "simulation",
        "steps": [{"calibrate": {"steering": "from_potentiometers"}}, *steps],
        "simulation": {
            "seed": seed,
            "world": {"walls": [{"points": line} for line in plan.edges]},
            "true_robot": places[0],
            "localizer": {"plugin": "simulated_tracker", "noise_m": 0.005, "noise_deg": 0.3, "seed": seed},
        },
    }
    source = folder / "mission.json"
    source.write_text(json.dumps(mission))
    legs = [GoalDrive(map=kind, seed=seed, number=number + 1, closed=number == goals) for number in range(goals + 1)]
    _GoalWitness(load_mission(source), CellEdges(plan.occupied), poses[1:], legs).run(source)
    return legs


class _GoalWitness:
    """Sees a run from outside."""

    def __init__(
        self, loaded: LoadedMission, obstacles: CellEdges, goals: Sequence[Pose], legs: Sequence[GoalDrive]
    ) -> None:
        self._loaded, self._obstacles, self._goals, self._legs = loaded, obstacles, goals, legs
        self._world: World | None = None
        self._destinations = sorted(loaded.destinations)
        self._at = 0
        self._plans: list[tuple[float, int]] = []
        self._stood_for = ""

    def run(self, source: Path) -> None:
        with patch.object(zoned, "plan_route", self._plan):
            outcome = app.run_mission(self._loaded, source, watch=self._watch, witness=self._meet)
        if outcome.failed and self._at < len(self._legs):
            self._legs[self._at].ended = "failed"

    def _meet(self, world: World) -> World:
        self._world = world
        return world

    def _plan(self, request: RouteRequest) -> PlannedRoute:
        """Plan with a watch in hand."""
        begun = cpu_time()
        found = plan_route(request)
        self._plans.append((cpu_time() - begun, found.expanded))
        return found

    def _watch(self, tick: Tick, _traffic: Traffic) -> None:
        assert self._world is not None
        if self._at == len(self._legs):
            return
        leg, pose = self._legs[self._at], self._world.pose
        if tick.snapshot.sensed.index % LOOK == 0:
            leg.nearest = min(leg.nearest, self._obstacles.room(pose))
        for result in tick.snapshot.sensed.results:
            if result.kind is JobKind.PLAN:
                self._planned(leg, result)
        if (fault := tick.wish.fault) is not None and fault.id == "LAS-08":
            self._stood_for = fault.text
        if tick.position.step <= self._at + 1:
            return
        said = [event.text for event in tick.events if event.kind == "said"]
        goal = self._goals[self._at]
        self._at += 1
        if said:
            leg.ended = f"{said[0]}: {self._stood_for if said[0] == 'blocked' else leg.plans[-1]}"
            return
        leg.ended = "done"
        leg.off = math.hypot(pose.x - goal.x, pose.y - goal.y)
        leg.turned = abs(math.remainder(pose.heading - goal.heading, math.tau))

    def _planned(self, leg: GoalDrive, result: JobResult) -> None:
        """Judge a route."""
        leg.plans.append(result.detail)
        seconds, expanded = self._plans.pop()
        leg.seconds.append(seconds)
        leg.expanded.append(expanded)
        if not result.values:
            return
        driven = 0.0
        for part in unpacked_route(result.values).parts:
            count = max(2, math.ceil(part.path.length / _SPACING))
            for place in np.linspace(0.0, part.path.length, count).tolist():
                point = part.path.at(place)
                if driven + place > FIRST:
                    pose = Pose(x=point.x, y=point.y, heading=part.heading_at(place))
                    leg.room = min(leg.room, self._obstacles.room(pose))
            driven += part.path.length


def run_chain(kind: str, seed: int, blind: bool) -> list[GoalDrive]:
    """One run in a folder of its own."""
    device.warm_up(ROBOT.model_copy(update={"outline": OUTLINE}))
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as folder:
        return drive(Path(folder), kind, seed, blind=blind)


def run_all(
    goals: int, seed: int, workers: int, finished: Callable[[Sequence[GoalDrive]], None], *, blind: bool
) -> None:
    """At least so many goals, spread over the maps; what came of those of a run is passed to `finished`.

    An interruption ends it after the runs under way, also in the background.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    chains = [
        (MAPS[number % len(MAPS)], seed + number // len(MAPS), blind) for number in range(math.ceil(goals / CHAIN))
    ]
    device.warm_up(ROBOT.model_copy(update={"outline": OUTLINE}))  # compiles, for all
    with fresh_workers(min(workers, len(chains))) as pool:
        futures = [pool.submit(run_chain, *chain) for chain in chains]
        try:
            for future in as_completed(futures):
                finished(future.result())
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
