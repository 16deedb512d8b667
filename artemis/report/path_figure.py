"""The figure of path files: from above, and their curvature with what a robot can do."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from artemis.motion.path import Path
from artemis.report.figures import ALARM, ESTIMATED, INK, LEFT, PATH, RIGHT, TRUE, WIDTH, thinned
from artemis.vehicle import RobotFile

COLORS = (ESTIMATED, TRUE, LEFT, RIGHT, PATH)
ARROWS = 8
"""On each path."""


def path_figure(paths: Mapping[str, Path], robot: RobotFile | None) -> Figure:
    """Paths by their names, with arrows in the direction of travel and a mark at the start; curvature over arc length.

    Call inside `figures.style`.
    """
    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(2.6, 1.0))
    for number, (name, path) in enumerate(paths.items()):
        color = COLORS[number % len(COLORS)]
        step = max(len(path.x) // 5000, 1)
        kept = np.append(np.arange(0, len(path.x) - 1, step), len(path.x) - 1)
        above.plot(path.x[kept], path.y[kept], color=color, label=name)
        for share in (np.arange(ARROWS) + 0.5) / ARROWS:
            point = path.at(float(share) * path.length)
            marker = (3, 0, math.degrees(point.heading) - 90)
            above.plot(point.x, point.y, marker=marker, color=color, markersize=8, linestyle="")
        above.plot(path.x[0], path.y[0], marker="o", color=INK, markersize=7, linestyle="")
        below.plot(*thinned(path.arc_length, path.curvature), color=color)
    above.plot([], [], marker="o", color=INK, markersize=7, linestyle="", label="start")
    above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    above.set_adjustable("datalim")
    if robot is not None:
        bound = math.tan(math.radians(robot.limits.steering_deg)) / robot.geometry.wheelbase_m
        for sign in (1, -1):
            label = f"limit of {robot.robot}" if sign > 0 else None
            below.axhline(sign * bound, color=ALARM, linewidth=1.0, label=label)
        below.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    below.axhline(0.0, color=INK, linewidth=0.6)
    below.set(xlabel="arc length [m]", ylabel="curvature [1/m]")
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)
    return figure
