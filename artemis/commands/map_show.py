"""`artemis map show`: facts about a map and its loops, and a figure."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from artemis.commands.map_files import numbers
from artemis.commands.map_zones import say_zones, zones_of
from artemis.errors import ConfigError, similar
from artemis.mapping.graph_file import SUFFIX, MapGraph, read_graph
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import FREE, OCCUPIED, OccupancyMap
from artemis.mapping.se2 import between
from artemis.mission.goto import Goto, goto_rules, known_behind, route_margin
from artemis.mission.loading import load_model
from artemis.motion.arrays import wrapped
from artemis.motion.planned_route import unpacked_route
from artemis.motion.route import Route
from artemis.report.drawing import check_figures
from artemis.route_planning.floor import MARGIN, floor_from, goal_problem
from artemis.route_planning.zones import MapZones
from artemis.values import Pose
from artemis.vehicle import RobotFile

_DEFAULTS = Goto(map="map.yaml", to="place")
"""A step in which nothing else is said."""
_SHOWN = 10
"""Loops that fit worst."""


def show_map(file: Path, figure: Path | None, wanted: tuple[str, str, Path] | None = None) -> None:
    """Print facts of a map, of its graph, zones and places, and draw them.

    Args:
        file: the map.
        figure: the drawing; None: none.
        wanted: of a route its begin and end, places or poses, and the file of the robot; None: none is planned.

    Raises:
        ConfigError: a file cannot be read, the figure cannot be written, or there is no route.
    """
    if figure is not None and figure.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"{figure}: no figure can be drawn as that: name it .png, .svg or .pdf")
    if figure is not None:
        check_figures("--output")
    content = read_map(file)
    rows, columns = content.cells.shape
    size = f"{columns * content.resolution:.1f} x {rows * content.resolution:.1f} m"
    free, occupied = (float((content.cells == value).mean()) for value in (FREE, OCCUPIED))
    _row("map", f"{file}: {size}, cells of {content.resolution:g} m")
    _row("cells", f"{free:.1%} free, {occupied:.1%} occupied")
    beside = file.with_suffix(SUFFIX)
    graph = read_graph(beside) if beside.exists() else None
    if graph is None:
        _row("graph", f"none: there is no {beside.name}")
    else:
        _say(graph)
    zones = zones_of(file)
    if zones.zones or zones.places:
        say_zones(file, zones, content)
    route = planned(content, zones, *wanted) if wanted is not None else None
    if route is not None:
        length, reversals = route.path.length, len(route.path.parts) - 1
        _row("route", f"{length:.1f} m, {reversals} reversals, {100 * route.margin:.0f} cm around the outline")
    if figure is not None:
        _draw(content, graph, zones, None if route is None else route.path, figure)


def _say(graph: MapGraph) -> None:
    keys, loops = graph.keys, graph.graph.loops
    moved = between(graph.trajectory[:-1, 1:], graph.trajectory[1:, 1:])
    _row("driven", f"{float(np.hypot(moved[:, 0], moved[:, 1]).sum()):.1f} m, {len(graph.trajectory)} poses")
    _row("graph", f"{len(keys)} key scans, {len(loops)} loops")
    deviations = graph.graph.deviations(keys.poses)
    worst = sorted(loops, key=lambda number: -deviations[number])[:_SHOWN]
    for number in worst:
        link = loops[number]
        off = between(between(keys.poses[link.first], keys.poses[link.second]), link.motion)
        place = keys.poses[link.second]
        distance, turn = math.hypot(off[0], off[1]), math.degrees(abs(float(wrapped(off[2]))))
        at = f"x {place[0]:.1f} m, y {place[1]:.1f} m"
        _row("loop", f"{number}: off {1000 * distance:.0f} mm, {turn:.2f} deg, {deviations[number]:.1f} std, at {at}")


def _row(name: str, words: str) -> None:
    sys.stdout.write(f"{name:<12}{words}\n")


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownRoute:
    """A route for people."""

    path: Route
    margin: float
    """Around the outline [m]."""


def planned(content: OccupancyMap, zones: MapZones, begin: str, end: str, robot_file: Path) -> ShownRoute:
    """A route as a step `goto` plans it in which nothing is said but the map and the place.

    Raises:
        ConfigError: there is none, or no such place; the robot cannot stand there, or has no outline.
    """
    from artemis.route_planning.planner import RouteRequest, plan_route

    robot = load_model(robot_file, RobotFile)
    if robot.outline is None:
        raise ConfigError(f"{robot_file}: routes are planned for the robot's outline: it has none")
    rules = goto_rules(_DEFAULTS, None, robot)
    margin = route_margin(rules)
    floor, poses = floor_from(content, zones.zones), list[Pose]()
    for option, words, room in (("--from", begin, MARGIN), ("--to", end, margin)):
        pose = _pose(option, words, zones)
        if problem := goal_problem(floor, robot, pose, room):
            raise ConfigError(f"{option} {words}: {problem}")
        poses.append(pose)
    request = RouteRequest(
        floor=floor,
        robot=robot,
        start=poses[0],
        goal=poses[1],
        speed=_DEFAULTS.speed_m_s,
        margin=margin,
        known_behind=known_behind(rules),
    )
    found = plan_route(request)
    if not found.values:
        raise ConfigError(f"from {begin} to {end}: {found.detail}")
    return ShownRoute(path=unpacked_route(found.values), margin=margin)


def _pose(option: str, words: str, zones: MapZones) -> Pose:
    if (place := zones.places.get(words)) is not None:
        return Pose(x=place.x_m, y=place.y_m, heading=math.radians(place.heading_deg))
    if "," not in words:
        raise ConfigError(
            f"{option} {words or repr(words)}: no such place; {similar(words, zones.places) or 'expected X,Y,DEG'}"
        )
    x, y, heading = numbers(words, option, 3)
    return Pose(x=x, y=y, heading=math.radians(heading))


def _draw(content: OccupancyMap, graph: MapGraph | None, zones: MapZones, route: Route | None, figure: Path) -> None:
    from artemis.report.figures import style
    from artemis.report.map_figure import map_figure

    try:
        with style():
            map_figure(content, graph, zones, route).savefig(figure, facecolor="white", dpi=150)
    except OSError as error:
        raise ConfigError(f"{figure}: cannot be written: {error.strerror}") from error
    _row("figure", str(figure))
