"""Run the thesis' odometry experiments again: draw `thesis_*.png`, and write the tables of `docs/thesis.md`.

`make thesis` does it, in a few minutes. Every run is one of `artemis run` with a mission of `missions/`, or with a copy
of one in which the hidden errors or the robot file are others.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import pi, radians, sin, tan
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from artemis.app import run_mission
from artemis.axles import Geometry
from artemis.calibration.wheel_log import recorded_log
from artemis.commands.calibrate_odometry import calibrate_with_truth
from artemis.mission import load_mission
from artemis.motion.ackermann import Ackermann
from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import as_tum
from artemis.recording.mcap_reader import Recording
from artemis.report.figures import ESTIMATED, INK, TRUE, style
from artemis.values import Mode, Pose
from artemis.vehicle import RobotFile
from artemis.yaml_file import load
from artemis_lab.bench.transport import Parameters, answer_grid, answer_times, compared, comparison_grid, over_serial
from artemis_lab.bench.transport_figure import transport_figure

HERE = Path(__file__).parent
MISSIONS = HERE.parents[1] / "missions"
PAGE = HERE.parent / "thesis.md"
MOVING = (Mode.TELEOP, Mode.FOLLOW)
BLOCK = 0.2
"""The tracker's poses come over WLAN in blocks of about so long [s], and are stamped when they come: an assumption."""
NEAR = 0.02
"""A stamp of the tracker belongs to the pose of odometry if it is nearer than this [s] (thesis, chapter 6)."""
HIGHEST = 1.12
"""End of the colour scale [m]: twice the wheelbase, the most by which two points of the robot seem to part."""
ODOMETRY_HZ, TRACKER_HZ = 30.0, 100.0
"""The thesis' odometry; an assumption for its tracker, which is said to be faster."""
TRACKER = Pose(x=0.565)
"""The thesis' tracker: over the middle of the front axle, where it truly is in the missions of its drives [m]."""

Array = NDArray[np.float64]
Errors = Mapping[str, Any]
"""Keys of a mission's `true_robot`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """What was recorded of one run while it drove: one row a tick."""

    odometry: Trajectory
    """Of the rear axle's centre."""
    true: Trajectory
    """Of the same, or of what a tracker on the robot sees."""
    wheels: Array
    """Ways of the left and right driven wheel [m], angles of the left and right steered wheel [rad]; shape (n, 4)."""
    geometry: Geometry
    """As the robot file has it."""


def main() -> None:
    """Run everything, draw everything, write the tables."""
    with tempfile.TemporaryDirectory() as folder:
        missions = copytree(MISSIONS, Path(folder) / "missions", ignore=lambda *_: ["runs", "campaigns"])
        tables = {"circles": draw_circles(drive(missions, "thesis_circles"))}
        tables["drives"] = draw_drives(missions)
        tables["causes"] = draw_causes(missions)
    tables |= draw_transport()
    text = PAGE.read_text(encoding="utf-8")
    for name, table in tables.items():
        begin = text.index("-->\n", text.index(f"<!-- {name}:")) + 4
        text = text[:begin] + "\n".join(table) + "\n" + text[text.index(f"<!-- end of {name} -->") :]
    PAGE.write_text(text, encoding="utf-8")


# ------------------------------------------------------------------------------------------------------------ runs


def drive(missions: Path, name: str, machine: Errors | None = None, robot: str = "artemis") -> Drive:
    """Run a mission, if asked to with another machine or robot file, and read what was recorded while it drove."""
    recording = run(missions, name, machine, robot)
    ticks = [tick for tick in recording.ticks() if tick.mode in MOVING]
    places = recording.robot.places
    time = [tick.snapshot.time for tick in ticks[:-1]]  # a tick's feedback was sampled at the SYNC of the tick before
    return Drive(
        odometry=_trajectory(time, [tick.snapshot.odometry.pose for tick in ticks[1:]]),
        true=_trajectory(time, [tick.true_pose or Pose() for tick in ticks[:-1]]),
        wheels=np.array([[tick.snapshot.sensed.drives[place].position for place in places] for tick in ticks[1:]]),
        geometry=recording.robot.geometry,
    )


def run(missions: Path, name: str, machine: Errors | None, robot: str) -> Recording:
    """The recording of one `artemis run`."""
    path = missions / f"{name}.yaml"
    if machine is not None:
        text = path.read_text(encoding="utf-8").replace("robots/artemis.yaml", f"robots/{robot}.yaml")
        text = text[: text.index("  true_robot:")] + f"  true_robot: {json.dumps(dict(machine))}\n"
        path = path.with_stem(f"{name}_of_another_machine")
        path.write_text(text, encoding="utf-8")
    return Recording(run_mission(load_mission(path), path).run.path)


def calibrated(missions: Path, machine: Errors) -> Errors:
    """Drive the calibration pattern and write `robots/calibrated.yaml` by `artemis calibrate odometry`.

    The truth is what a tracker over the rear axle measures, with noise of 2 mm and 0.2 degrees, its clock 0.1 s ahead.

    Returns:
        The hidden errors of the same machine, told from the new file.
    """
    recording = run(missions, "calibration_pattern", machine, "artemis")
    _, true = recorded_log(recording, "calibration_pattern")
    assert true is not None  # of a simulated run
    noise = np.random.default_rng(1).normal(0.0, (0.002, 0.002, radians(0.2)), true.poses.shape)
    tracked = recording.path.with_name("tracker.tum")
    tracked.write_text(as_tum(Trajectory(time=true.time + 0.1, poses=true.poses + noise)), encoding="utf-8")
    file = missions / "robots" / "calibrated.yaml"
    file.write_bytes((missions / "robots" / "artemis.yaml").read_bytes())
    calibrate_with_truth([recording.path.parent], [str(tracked)], None, [], None, file)
    before, after = recording.robot, RobotFile.model_validate(load(file).data)
    told = {"scrub_radius_m": before.geometry.scrub_radius_m, **machine}
    for side in ("left", "right"):
        old, new = before.potentiometers(side), after.potentiometers(side)
        told[f"steering_zero_{side}_deg"] += old.slope_deg_per_v[0] * (new.zero_v[0] - old.zero_v[0])
        told[f"steering_scale_{side}"] = old.scale / new.scale
        told[f"wheel_scale_{side}"] *= before.metres_per_count(side) / after.metres_per_count(side)
    return told


def _trajectory(time: list[float], poses: list[Pose]) -> Trajectory:
    return Trajectory(time=np.array(time), poses=np.array([(pose.x, pose.y, pose.heading) for pose in poses]))


# --------------------------------------------------------------------------------------------------------- circles


def draw_circles(run: Drive) -> list[str]:
    """Odometry and the model of a differential drive beside the circles of section 5.1; their table."""
    car = Ackermann(run.geometry)
    steering = np.array([car.steering_from_wheel_angles(left, right) for left, right in run.wheels[:, 2:]])
    rows = ["| steering | model | its circle | by the run | off |", "|---|---|---|---|---|"]
    with style():
        figure = Figure(figsize=(10.0, 5.4), layout="constrained")
        axes: list[Axes] = list(figure.subplots(1, 2))
        for degrees, color in ((40.0, ESTIMATED), (60.0, TRUE)):
            part = np.abs(np.degrees(steering) - degrees) < 0.5
            rows += _circle(axes, run, part, radians(degrees), color)
        for ax, title in zip(axes, ("Ackermann: rear axle", "differential drive: front axle"), strict=True):
            ax.set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
        lines = [
            Line2D([], [], linestyle="--", linewidth=1.0, color=INK, label="circle of the steering angle"),
            Line2D([], [], linewidth=3.0, alpha=0.6, color=ESTIMATED, label="40°"),
            Line2D([], [], linewidth=3.0, alpha=0.6, color=TRUE, label="60°"),
            Line2D(
                [],
                [],
                linewidth=1.0,
                color=INK,
                alpha=0.5,
                label=f"thin: with the machine's track, {run.geometry.track_m} m",
            ),
        ]
        figure.legend(handles=lines, loc="outside lower center", ncols=4)
        figure.savefig(HERE / "thesis_circles.png", dpi=100, facecolor="white")
    return rows


def _circle(axes: list[Axes], run: Drive, part: NDArray[np.bool_], steering: float, color: str) -> list[str]:
    """Draw one circle in the frame of its start, in both models; its rows of the table."""
    wheelbase, track = run.geometry.wheelbase_m, run.geometry.track_m
    rear, front = wheelbase / tan(steering), wheelbase / sin(steering)
    left, right = (front * ratio for ratio in Ackermann(run.geometry).speed_ratios(steering))
    odometry = run.odometry.poses[part]
    x, y, heading = odometry[0]
    c, s = np.cos(heading), np.sin(heading)
    place = (odometry[:, :2] - (x, y)) @ np.array([[c, -s], [s, c]])
    rolled = run.wheels[part, :2] - run.wheels[part][0, :2]
    name = f"{np.degrees(steering):.0f}°"
    found = [("Ackermann, rear axle", rear, place)]
    for words, base in (("its track", track), ("difference of the radii as track", right - left)):
        found.append((f"differential drive, {words}", front, _differential(rolled, base, wheelbase, steering)))
    circle = np.linspace(0.0, 2.0 * pi, 400)
    for ax, radius in zip(axes, (rear, front), strict=True):
        ax.plot(radius * np.cos(circle), rear + radius * np.sin(circle), "--", color=INK, linewidth=1.0, zorder=5)
    axes[0].plot(*found[0][2].T, color=color, linewidth=3.0, alpha=0.6)
    axes[1].plot(*found[1][2].T, color=color, linewidth=1.0)
    axes[1].plot(*found[2][2].T, color=color, linewidth=3.0, alpha=0.6)
    return [
        f"| {name} | {words} | {radius:.4f} m | {_radius(points):.4f} m | {_radius(points) / radius - 1:+.2%} |"
        for words, radius, points in found
    ]


def _differential(rolled: Array, track: float, ahead: float, steering: float) -> Array:
    """Places (n, 2) of a differential drive `ahead` [m] of the origin that begins in the direction `steering` [rad]."""
    steps = np.diff(rolled, axis=0)
    turn = (steps[:, 1] - steps[:, 0]) / track
    middle = steering + np.cumsum(turn) - turn / 2.0
    moved = steps.mean(axis=1)[:, np.newaxis] * np.column_stack([np.cos(middle), np.sin(middle)])
    places: Array = np.array([ahead, 0.0]) + np.vstack([np.zeros(2), np.cumsum(moved, axis=0)])
    return places


def _radius(points: Array) -> float:
    """Of the circle through points [m], by least squares (Kåsa)."""
    (a, b, c), *_ = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), np.sum(points**2, axis=1))
    return float(np.sqrt(c + a * a + b * b))


# ---------------------------------------------------------------------------------------------------------- drives


DRIVES = (
    ("thesis_stop_and_steer", "5.5 drive and steer separately", "1.8 m at the end"),
    ("thesis_slow", "5.6 slow, 0.2 m/s", "58 cm"),
    ("thesis_fast", "5.6 fast, 0.6 m/s", "53 cm"),
    ("thesis_every_angle", "5.7 follower takes every angle", "53 cm"),
    ("thesis_hysteresis", "5.7 hysteresis of 0.2 rad", "62 cm"),
)
"""Mission, its title, and the mean deviation that the thesis reports."""


def draw_drives(missions: Path) -> list[str]:
    """The drives of section 5.3 as the thesis compares them, before and after a calibration; their table."""
    rows = [
        "| drive | thesis | mean | highest | at the end | in x, mean | rear axle, mean | calibrated, mean |",
        "|---|---|---|---|---|---|---|---|",
    ]
    machine: Errors = load_mission(missions / "thesis_fast.yaml").mission.simulation.true_robot
    same = calibrated(missions, machine)
    with style():
        figure, axes, colors = _panels(2, 3, 5.8)
        for ax, (mission, title, reported) in zip(axes, DRIVES, strict=False):
            before, after = drive(missions, mission), drive(missions, mission, same, "calibrated")
            _draw(ax, before.odometry.poses, _from_start(before.true.of_point(TRACKER).poses), title, colors)
            left = _distance(after.odometry.poses, after.true.poses).mean()
            rows.append(f"| {title} | {reported} | {_as_compared(before)} | {_cm(left)} |")
        turned = {**machine, "steering_zero_left_deg": 0.8, "steering_zero_right_deg": 0.3}
        worse = _as_compared(drive(missions, "thesis_stop_and_steer", turned))
        rows.append(f"| the first, steering zeros 0.5° farther off | {DRIVES[0][2]} | {worse} | |")
        _explain(figure, axes[-1], "what the tracker over the front axle saw", colors)
        figure.savefig(HERE / "thesis_drives.png", dpi=100, facecolor="white")
    return rows


def _as_compared(run: Drive) -> str:
    """Deviations from the tracker over the front axle, in cells of the table, and of the rear axle itself."""
    seen, odometry = _from_start(run.true.of_point(TRACKER).poses), run.odometry.poses
    off, shift = _distance(odometry, seen), np.mean(seen[:, 0] - odometry[:, 0])
    rear = _distance(odometry, run.true.poses)
    return " | ".join(map(_cm, (off.mean(), off.max(), off[-1], shift, rear.mean())))


def _from_start(poses: Array) -> Array:
    """As if the tracker's first place were the origin."""
    moved: Array = poses - np.array([*poses[0, :2], 0.0])
    return moved


def _distance(one: Array, other: Array) -> Array:
    distance: Array = np.hypot(*(one[:, :2] - other[:, :2]).T)
    return distance


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm"


def _panels(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes], ScalarMappable]:
    """A grid of maps, and the colours of deviations."""
    figure = Figure(figsize=(10.0, height), layout="constrained")
    axes = list(np.ravel(figure.subplots(rows, columns)))
    return figure, axes, ScalarMappable(Normalize(0.0, HIGHEST), "turbo")


def _draw(ax: Axes, odometry: Array, seen: Array, title: str, colors: ScalarMappable) -> Array:
    """A map: what was seen in black, odometry coloured by its deviation [m], which is returned."""
    off = _distance(odometry, seen)
    points = odometry[:, np.newaxis, :2]
    lines = LineCollection(list(np.concatenate([points[:-1], points[1:]], axis=1)), cmap=colors.cmap, norm=colors.norm)
    lines.set(array=off, linewidth=2.2)
    ax.plot(*seen[:, :2].T, color=INK, linewidth=1.0)
    ax.add_collection(lines)
    ax.set_title(f"{title}\nmean {_cm(off.mean())}, highest {_cm(off.max())}", fontsize=8.5)
    ax.set(aspect="equal")
    ax.set_adjustable("datalim")
    ax.tick_params(labelsize=7.5)
    return off


def _explain(figure: Figure, ax: Axes, words: str, colors: ScalarMappable) -> None:
    """What the lines and colours are, in a panel of its own."""
    ax.axis("off")
    ax.plot([], [], color=INK, linewidth=1.0, label=words)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 0.5))
    bar = figure.colorbar(colors, cax=ax.inset_axes((0.05, 0.38, 0.9, 0.06)), orientation="horizontal", extend="max")
    bar.set_label("odometry, and how far off it is [m]", fontsize=8.5)


# ---------------------------------------------------------------------------------------------------------- causes


CAUSES: tuple[tuple[str, dict[str, float]], ...] = (
    ("the machine as described", {}),
    ("both steering zeros off by 0.5°", {"steering_zero_left_deg": 0.5, "steering_zero_right_deg": 0.5}),
    ("steering gears 1 % off", {"steering_scale_left": 1.01, "steering_scale_right": 1.01}),
    ("wheel circumference 1 % off", {"wheel_scale_left": 1.01, "wheel_scale_right": 1.01}),
    ("wheels unequal by 1 %", {"wheel_scale_left": 1.005, "wheel_scale_right": 0.995}),
    ("track 10 mm off", {"track_m": 0.446}),
    ("wheelbase 5 mm off", {"wheelbase_m": 0.565}),
    ("slip of 0.5 %", {"slip": 0.005}),
)
"""What is wrong, each alone, in the drive of `thesis_fast`."""


def draw_causes(missions: Path) -> list[str]:
    """The same drive with one cause of deviations at a time; their table."""
    rows = ["| cause | mean | highest | at the end | in x, mean |", "|---|---|---|---|---|"]
    runs = [(words, drive(missions, "thesis_fast", errors)) for words, errors in CAUSES]
    exact = runs[0][1]
    shown = [(words, run.odometry.poses, run.true.poses) for words, run in runs]
    shown.append(("odometry by the thesis' formulas", by_the_thesis(exact), exact.true.poses))
    shown.append(("stamps of the tracker, matched within 20 ms", *matched_by_stamps(exact)))
    over_front = exact.true.of_point(Pose(x=exact.geometry.wheelbase_m))
    shown.append(("tracker over the front axle", exact.odometry.poses, _from_start(over_front.poses)))
    with style():
        figure, axes, colors = _panels(4, 3, 8.6)
        for ax, (words, odometry, seen) in zip(axes, shown, strict=False):
            off = _draw(ax, odometry, seen, words, colors)
            shift = np.mean(seen[:, 0] - odometry[:, 0])
            rows.append(f"| {words} | {' | '.join(map(_cm, (off.mean(), off.max(), off[-1], shift)))} |")
        _explain(figure, axes[-1], "true, or what the tracker saw", colors)
        figure.savefig(HERE / "thesis_causes.png", dpi=100, facecolor="white")
    return rows


def by_the_thesis(run: Drive) -> Array:
    """Poses (n, 3) by equations 3.18 to 3.21, with the distance that 3.20 lacks, at 30 Hz, held in between."""
    times = np.arange(run.odometry.time[0], run.odometry.time[-1], 1.0 / ODOMETRY_HZ)
    wheels = np.column_stack([np.interp(times, run.odometry.time, column) for column in run.wheels.T])
    car = Ackermann(run.geometry)
    x, y, heading = run.odometry.poses[0]
    poses = [(x, y, heading)]
    for before, after in pairwise(wheels):
        distance = float(after[0] - before[0] + after[1] - before[1]) / 2.0
        steering = car.steering_from_wheel_angles(after[2], after[3])
        x += distance * np.cos(heading) * np.cos(steering)
        y += distance * np.sin(heading) * np.cos(steering)
        heading += distance * np.sin(steering) / car.wheelbase
        poses.append((x, y, heading))
    return np.array(poses)[np.searchsorted(times, run.odometry.time, side="right") - 1]


def matched_by_stamps(run: Drive) -> tuple[Array, Array]:
    """Odometry and truth, paired as the thesis does: the nearest stamp within 20 ms, of poses that come in blocks."""
    taken = np.arange(run.true.time[0], run.true.time[-1], 1.0 / TRACKER_HZ)
    lengths = np.random.default_rng(1).uniform(0.5, 1.5, len(taken)) * BLOCK
    arrivals = taken[0] + np.cumsum(lengths)
    block = np.searchsorted(arrivals, taken)
    stamps = arrivals[block] + 1e-3 * (np.arange(len(taken)) - np.searchsorted(block, block))  # one a millisecond
    times = np.arange(run.odometry.time[0], run.odometry.time[-1], 1.0 / ODOMETRY_HZ)
    nearest = np.argmin(np.abs(times[:, np.newaxis] - stamps), axis=1)
    near = np.abs(times - stamps[nearest]) < NEAR
    return run.odometry.at(times[near]), run.true.at(taken[nearest[near]])


# ------------------------------------------------------------------------------------------------------- transport


def draw_transport() -> dict[str, list[str]]:
    """RS232 and CAN compared as in section 4.1; both tables."""
    rows, parameters = compared(Parameters()), Parameters()
    with style():
        figure = transport_figure(over_serial(parameters), rows, parameters)
        figure.savefig(HERE / "thesis_transport.png", dpi=100, facecolor="white")
    grids = {"transport": comparison_grid(rows), "answers": answer_grid(answer_times(parameters))}
    return {name: grid.markdown().splitlines()[2:] for name, grid in grids.items()}


if __name__ == "__main__":
    main()
