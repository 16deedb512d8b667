"""How long a plan takes: `.venv/bin/python -m tests.bench.routes [PLANS]`, CPU time of whole plans on 20 x 20 m.

Everything from the request to the checked route counts: fields, heuristic, search, fit. Compiling does not.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np

from artemis.mission.loading import load_model
from artemis.route_planning import kernels
from artemis.route_planning.device import warm_up
from artemis.route_planning.floor import MARGIN, floor_from, goal_problem
from artemis.route_planning.planner import RouteRequest, plan_route
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis_lab.bench.floor_plans import LARGE_MAPS, large_plan

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml"
LEAST = 5.0
"""From start to goal [m]."""


def main(plans: int) -> None:
    """Print a line for each kind of floor."""
    robot = load_model(ROBOT, RobotFile)
    if not kernels.COMPILED:
        print(kernels.NOTICE)
    begun = time.process_time()
    warm_up(robot)
    print(f"first plan, with loading or compiling: {time.process_time() - begun:.1f} s")
    for kind in LARGE_MAPS:
        times, failed, dice = [], list[str](), np.random.default_rng(5)
        for seed in range(plans):
            on = floor_from(large_plan(kind, seed).content)
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
