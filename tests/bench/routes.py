"""How long a plan takes: `.venv/bin/python -m tests.bench.routes [PLANS]`, CPU time of whole plans on 20 x 20 m.

Everything from the request to the checked route counts: fields, heuristic, search, fit. Compiling does not.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.loading import load_model
from artemis.route_planning import kernels
from artemis.route_planning.floor import CELL, MARGIN, Floor, floor_from, goal_problem
from artemis.route_planning.planner import RouteRequest, plan_route
from artemis.values import Pose
from artemis.vehicle import RobotFile

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml"
SIZE = 20.0
LEAST = 5.0
"""From start to goal [m]."""


def floor(kind: str, seed: int) -> Floor:
    """Nothing but walls around; 40 boxes; rooms along a corridor; lanes to and fro."""
    count, dice = round(SIZE / CELL), np.random.default_rng(seed)
    occupied: NDArray[np.bool_] = np.zeros((count, count), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True

    def box(x: float, y: float, width: float, height: float, *, filled: bool = True) -> None:
        column, row = round(x / CELL), round(y / CELL)
        occupied[row : row + max(round(height / CELL), 1), column : column + max(round(width / CELL), 1)] = filled

    if kind == "boxes":
        for _ in range(40):
            box(*dice.uniform(1, 19, 2), *dice.uniform(0.1, 0.9, 2))
    elif kind == "rooms":
        for x in (5, 10, 15):
            box(x, 0, 0.1, 8.5)
            box(x, 11, 0.1, 9)
        for y in (8.5, 11):
            box(0, y, SIZE, 0.1)
            for x in (2, 7, 12, 17):
                box(x, y, 1.2, 0.1, filled=False)
        for _ in range(25):
            x, y = dice.uniform(0.5, 19, 2)
            if not 7 < y < 12.5:
                box(x, y, *dice.uniform(0.1, 0.6, 2))
    elif kind == "lanes":
        for number, x in enumerate(range(2, 20, 2)):
            box(x, 0 if number % 2 else 1.7, 0.1, 18.3)
    cells = np.where(occupied, 100, 0).astype(np.int8)
    return floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))


def main(plans: int) -> None:
    """Print a line for each kind of floor."""
    robot = load_model(ROBOT, RobotFile)
    if not kernels.COMPILED:
        print(kernels.NOTICE)
    begun = time.process_time()
    there, here = Pose(x=3.0, y=3.0), Pose(x=9.0, y=9.0)
    plan_route(RouteRequest(floor=floor("open", 0), robot=robot, start=there, goal=here, speed=0.5))
    print(f"first plan, with loading or compiling: {time.process_time() - begun:.1f} s")
    for kind in ("open", "boxes", "rooms", "lanes"):
        times, failed, dice = [], list[str](), np.random.default_rng(5)
        for seed in range(plans):
            on = floor(kind, seed)
            while True:
                x, y = dice.uniform(1, 19, (2, 2))
                turns = dice.uniform(-math.pi, math.pi, 2)
                ends = [Pose(x=a, y=b, heading=c) for a, b, c in zip(x, y, turns, strict=True)]
                free = all(goal_problem(on, robot, pose, MARGIN) is None for pose in ends)
                if free and math.dist((x[0], y[0]), (x[1], y[1])) > LEAST:
                    break
            request = RouteRequest(floor=on, robot=robot, start=ends[0], goal=ends[1], speed=0.5)
            begun = time.process_time()
            found = plan_route(request)
            times.append(1e3 * (time.process_time() - begun))
            failed += [] if found.values else [found.detail]
        median, most = np.median(times), max(times)
        print(
            f"{kind}: {plans} plans, median {median:.0f} ms, at most {most:.0f} ms; {len(failed)} without route",
            *failed,
            sep="\n  ",
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
