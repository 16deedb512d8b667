"""Draw `drive.gif`: the demo mission's robot from above while it drives, from a run. `make picture` does it."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from shutil import copytree

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from artemis.app import run_mission
from artemis.mission import load_mission
from artemis.motion.ackermann import Ackermann
from artemis.recording.mcap_reader import Recording
from artemis.values import Mode

HERE = Path(__file__).parent
MISSIONS = HERE.parents[1] / "missions"
EVERY, FRAMES_PER_S = 25, 20
"""Ticks from picture to picture (0.5 s of the run), and pictures a second: ten times as fast as the robot."""
OVERHANG, LENGTH, WIDTH = 0.12, 0.24, 0.08
"""Of the outline beyond the axles, and of a wheel [m]."""


def wheel(axes: Axes, x: float, y: float, angle: float, pose: Affine2D) -> None:
    """One wheel of the robot's frame: its centre [m], and its angle [rad]."""
    place = Affine2D().rotate(angle).translate(x, y) + pose + axes.transData
    axes.add_patch(Rectangle((-LENGTH / 2, -WIDTH / 2), LENGTH, WIDTH, color="0.15", transform=place))


with tempfile.TemporaryDirectory() as folder:
    missions = copytree(MISSIONS, Path(folder) / "missions", ignore=lambda *_: ["runs"])
    mission = missions / "figure_eight.yaml"
    loaded = load_mission(mission)
    ticks = list(Recording(run_mission(loaded, mission).run.path).ticks())

geometry, car = loaded.robot.geometry, Ackermann(loaded.robot.geometry)
followed = np.array([(t.snapshot.pose.pose.x, t.snapshot.pose.pose.y) for t in ticks if t.mode is Mode.FOLLOW])
shown = ticks[::EVERY]
mpl.rcParams.update({"font.family": "sans-serif", "font.size": 9})
figure, axes = pyplot.subplots(figsize=(6.4, 4.0), layout="constrained")


def draw(number: int) -> None:
    """The robot at a tick, and where it has been."""
    tick = shown[number]
    at, points = tick.snapshot.pose.pose, tick.snapshot.set_points
    axes.clear()
    axes.plot(*followed.T, color="0.85", linewidth=4, solid_capstyle="round")
    driven = np.array([(t.snapshot.pose.pose.x, t.snapshot.pose.pose.y) for t in shown[: number + 1]])
    axes.plot(*driven.T, color="tab:blue", linewidth=1.5)
    pose = Affine2D().rotate(at.heading).translate(at.x, at.y)
    half = geometry.track_m / 2
    outline = (-OVERHANG, -half + 0.05), geometry.wheelbase_m + 2 * OVERHANG, geometry.track_m - 0.1
    axes.add_patch(Rectangle(*outline, facecolor="tab:orange", alpha=0.85, transform=pose + axes.transData))
    left, right = car.wheel_angles(points.steering)
    for side, angle in ((1, left), (-1, right)):
        wheel(axes, 0.0, side * half, 0.0, pose)
        wheel(axes, geometry.wheelbase_m, side * half, angle, pose)
    words = f"{tick.snapshot.sensed.time:5.1f} s   {tick.mode.value:9}   {points.speed:.2f} m/s   "
    axes.set_title(words + f"steering {math.degrees(points.steering):+4.0f}°", family="monospace", fontsize=9)
    axes.set_aspect("equal")
    axes.set(xlim=(followed[:, 0].min() - 0.8, followed[:, 0].max() + 0.8), xlabel="x [m]", ylabel="y [m]")
    axes.set(ylim=(followed[:, 1].min() - 0.6, followed[:, 1].max() + 0.6))


FuncAnimation(figure, draw, frames=len(shown)).save(HERE / "drive.gif", PillowWriter(fps=FRAMES_PER_S), dpi=80)
