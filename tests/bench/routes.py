"""How long a plan takes: `.venv/bin/python -m tests.bench.routes [PLANS]`, so many on each kind of floor of 20 x 20 m.

By a robot that has just been switched on, without a scanner and with one. Everything from the request to the checked
route counts: fields, heuristic, search, fit. Compiling does not.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from artemis.clock import cpu_time
from artemis.mission.goto import BEYOND, NARROW, TO_STOP
from artemis.mission.loading import load_model
from artemis.motion.planned_route import unpacked_route
from artemis.motion.poses import placed
from artemis.mounting import Mounting
from artemis.route_planning import kernels
from artemis.route_planning.device import warm_up
from artemis.route_planning.floor import MARGIN, floor_from, goal_problem
from artemis.route_planning.obstacle_layer import PlacedScan
from artemis.route_planning.planner import RouteRequest, plan_route
from artemis.scan import Scan
from artemis.sim.grid import MapGrid
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis_lab.bench.floor_plans import LARGE, LARGE_MAPS, FloorPlan, large_plan
from artemis_lab.bench.goals import AHEAD, FIRST, CellEdges

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml"
LEAST = 5.0
"""From start to goal [m]."""
BEAMS = np.radians(np.arange(-135.0, 135.5, 0.5))
FARTHEST = 20.0
"""Of the simulated scanner [m]."""
SPACING = 0.04
"""Places along a route that are judged [m]."""


def main(plans: int) -> None:
    """Print a line for each kind of floor."""
    robot = load_model(ROBOT, RobotFile)
    if not kernels.COMPILED:
        print(kernels.notice())
    begun = cpu_time()
    warm_up(robot)
    print(f"first plan, with loading or compiling: {cpu_time() - begun:.1f} s")
    everything: list[tuple[float, int]] = []
    for sees in (False, True):
        for kind in LARGE_MAPS:
            figures, rooms, failed = list[tuple[float, int]](), list[float](), list[str]()
            for seed in range(plans):
                plan = large_plan(kind, seed)
                request = asked(plan, robot, seed, sees=sees)
                begun = cpu_time()
                found = plan_route(request)
                figures.append((1e3 * (cpu_time() - begun), found.expanded))
                if found.values:
                    rooms.append(room(plan, found.values))
                else:
                    failed.append(f"  {seed}: {found.detail}")
            name = f"{kind}, {'with' if sees else 'without'} scanner: {plans} plans"
            free = f"at least {100 * min(rooms, default=math.nan):.1f} cm free"
            print(f"{name}, {words(figures)}; {free}; {len(failed)} without route")
            for line in failed:
                print(line)
            everything += figures
    print(f"all {len(everything)}: {words(everything)}")


def words(figures: list[tuple[float, int]]) -> str:
    """The median and the largest of times [ms] and of numbers of poses."""
    milliseconds, poses = np.array(figures).T
    return (
        f"median {np.median(milliseconds):.0f} ms and {np.median(poses):.0f} poses searched, "
        f"at most {milliseconds.max():.0f} ms and {poses.max():.0f}"
    )


def asked(plan: FloorPlan, robot: RobotFile, seed: int, *, sees: bool) -> RouteRequest:
    """A route from one random place to another."""
    on, dice = floor_from(plan.content), np.random.default_rng([seed, sees])
    margin = NARROW + BEYOND if sees else MARGIN

    def places() -> Iterator[tuple[Pose, Pose, Pose]]:
        while True:
            x, y = dice.uniform(1.0, LARGE - 1.0, (2, 2)).tolist()
            headings = dice.uniform(-math.pi, math.pi, 2).tolist()
            start, goal = (Pose(x=a, y=b, heading=c) for a, b, c in zip(x, y, headings, strict=True))
            yield start, goal, placed(start, Pose(x=AHEAD)) if sees else start

    start, goal = next(
        (start, goal)
        for start, goal, ahead in places()
        if math.dist((start.x, start.y), (goal.x, goal.y)) > LEAST
        and all(goal_problem(on, robot, pose, margin) is None for pose in (start, goal, ahead))
    )
    request = RouteRequest(floor=on, robot=robot, start=start, goal=goal, speed=0.5, margin=margin)
    if not sees:
        return request
    scans = tuple(seen(plan, name, mounting, start) for name, mounting in robot.scanners.items())
    return replace(request, placed_scans=scans, known_behind=NARROW + TO_STOP)


def seen(plan: FloorPlan, name: str, mounting: Mounting, pose: Pose) -> PlacedScan:
    """What a scanner sees of a plan, without errors."""
    eye = placed(pose, Pose(x=mounting.x_m, y=mounting.y_m, heading=mounting.heading))
    x, y, heading = np.full_like(BEAMS, eye.x), np.full_like(BEAMS, eye.y), BEAMS + eye.heading
    distances = np.minimum(MapGrid(plan.content).distances(x, y, np.cos(heading), np.sin(heading)), FARTHEST)
    ranges = np.rint(1000.0 * distances).astype("<u2").tobytes()
    first, second = BEAMS[:2].tolist()
    return PlacedScan(
        0.0, pose, Scan(source=name, time=0.0, start_angle=first, increment=second - first, ranges=ranges)
    )


def room(plan: FloorPlan, values: tuple[int, ...]) -> float:
    """From the outline to the nearest obstacle along a route but for its first metre, at most 0.2 [m]."""
    edges, poses = CellEdges(plan.occupied), unpacked_route(values).poses(SPACING)
    return min(map(edges.room, poses[round(FIRST / SPACING) :]))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
