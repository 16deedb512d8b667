"""`artemis path show`: what is true of path files, and whether a robot can follow them."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from artemis.commands.path_files import keeps_up, say
from artemis.commands.path_formats import text_of
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.motion.path import Path as Curve
from artemis.motion.path import place_on
from artemis.motion.path_facts import PartFacts, demand_of, facts_of
from artemis.motion.path_points import MAX_SPEED
from artemis.motion.route import route_from_csv
from artemis.motion.table import MAX_CHARACTERS
from artemis.report.drawing import check_figures
from artemis.vehicle import RobotFile
from artemis.yaml_file import read


def show_paths(files: Sequence[Path], robot_file: Path | None, speed: float | None, figure: Path | None) -> int:
    """Print facts of path files, and draw them; 1 if mode follow refuses one, or the robot cannot follow it.

    Args:
        files: Path files.
        robot_file: Robot file: also what the paths ask of it.
        speed: Of its virtual front wheel [m/s]; None: the highest that is possible on each path.
        figure: PNG, SVG or PDF to draw; overwritten.

    Raises:
        ConfigError: a file cannot be read, the figure cannot be written.
    """
    if speed is not None and (robot_file is None or not 0 < speed <= MAX_SPEED):
        raise ConfigError(f"--speed {speed:g}: expected up to {MAX_SPEED:g} m/s, and a robot with --robot")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"{figure}: no figure can be drawn as that: name it .png, .svg or .pdf")
    if figure is not None:
        check_figures("--output")
    robot = None
    if robot_file is not None:
        robot = load_model(robot_file, RobotFile)
    texts = {file: text_of(read(file, MAX_CHARACTERS), str(file)) for file in files}
    facts = {file: facts_of(text, str(file)) for file, text in texts.items()}
    failed = False
    curves: dict[str, Curve] = {}
    for file, found in facts.items():
        for number, part in enumerate(found.parts, start=1):
            name = f"{file}, part {number}" if len(found.parts) > 1 else str(file)
            curves[name] = part.path
            sys.stdout.write(f"{name}\n")
            failed = _show(part, robot, speed) or failed
        if found.reversals:
            _row("reversals", "; ".join(f"line {line} (x {x:.2f} m, y {y:.2f} m)" for line, x, y in found.reversals))
        try:
            route_from_csv(texts[file], str(file))
        except ConfigError as error:
            say(file, ["mode follow refuses it:"])
            sys.stdout.writelines(f"  {problem}\n" for problem in error.problems)
            failed = True
    if figure is not None:
        _draw(curves, robot, figure)
    return int(failed)


def _show(part: PartFacts, robot: RobotFile | None, speed: float | None) -> bool:
    """Print what is true of a part; whether the robot cannot follow it."""
    path = part.path
    worst = int(np.argmax(np.abs(path.curvature)))
    sharpest = abs(float(path.curvature[worst]))
    place = f"at {place_on(path, worst)}"
    _row("length", f"{path.length:.3f} m, {'closed' if path.closed else 'open'}, driven {_direction(part.backward)}")
    _row("points", f"{part.points}, at most {part.gap:.3f} m apart, at most {1000 * part.off:.1f} mm off the curve")
    if path.drawn is not None and (words := path.drawn.words()):
        _row("noise", words)
    _row("extent", f"x {_range(path.x)}, y {_range(path.y)}")
    _row("tightest", f"radius {1 / sharpest:.2f} m {place}" if sharpest > 1e-3 else "straight")
    if path.speed is not None:
        _row("speed", f"{path.speed.min():.2f} to {path.speed.max():.2f} m/s")
    if robot is None:
        return False
    demand = demand_of(path, robot, speed)
    _row("steering", f"{math.degrees(demand.steering):.1f} deg, {robot.robot} can {robot.limits.steering_deg:g} deg")
    rate = robot.limits.steering_rate_wheel_deg_s
    _row("rate", f"{math.degrees(demand.rate):.1f} deg/s at {demand.speed:.2f} m/s, {robot.robot} can {rate:g} deg/s")
    _row("drivable", keeps_up(path, demand.highest, demand.bounded_at))
    for problem in demand.problems:
        _row("problem", problem)
    return bool(demand.problems)


def _row(name: str, words: str) -> None:
    sys.stdout.write(f"  {name:<10}{words}\n")


def _direction(backward: bool) -> str:
    return "backwards" if backward else "forwards"


def _range(values: np.ndarray) -> str:
    return f"{values.min():.2f} to {values.max():.2f} m"


def _draw(curves: Mapping[str, Curve], robot: RobotFile | None, figure: Path) -> None:
    from artemis.report.figures import style
    from artemis.report.path_figure import path_figure

    try:
        with style():
            path_figure(curves, robot).savefig(figure, facecolor="white", dpi=120)
    except OSError as error:
        raise ConfigError(f"{figure}: cannot be written: {error.strerror}") from error
    sys.stdout.write(f"figure      {figure}\n")
