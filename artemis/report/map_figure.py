"""A map, seen from above, with the trajectory of the robot and the loops of its graph."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from artemis.mapping.graph_file import MapGraph
from artemis.mapping.occupancy import OccupancyMap
from artemis.motion.route import Route
from artemis.report.figures import ALARM, ESTIMATED, INK, LEFT, RIGHT, TRUE, WIDTH, legend
from artemis.report.known_map import corners, draw_cells
from artemis.route_planning.zones import MapZones

_BINS = 40


_ZONES = {"keep-out": ALARM, "slow": TRUE, "prefer": LEFT}
"""Colours."""
_ARROW = 0.4
"""Of a place, to where the robot looks there [m]."""


def map_figure(
    content: OccupancyMap, graph: MapGraph | None, zones: MapZones | None = None, route: Route | None = None
) -> Figure:
    """The map, zones, places and a route; with a graph also its trajectory, its loops, and how far each loop is off."""
    figure = Figure(figsize=(WIDTH, 8.0 if graph is None else 10.0), layout="constrained")
    if graph is None:
        above = figure.add_subplot()
    else:
        above, below = figure.subplots(2, 1, height_ratios=(5, 1))
    draw_cells(above, content)
    x_limits, y_limits = corners(content)
    above.set(xlim=x_limits, ylim=y_limits)
    above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    _draw_zones(above, zones or MapZones())
    labels = {False: "route", True: "backwards"}
    for part in route.parts if route is not None else ():
        style = "--" if part.backward else "-"
        label = labels.pop(part.backward, None)
        above.plot(part.path.x, part.path.y, color=RIGHT, linewidth=1.6, linestyle=style, label=label)
    if graph is None:
        legend(above)
        return figure
    poses, loops = graph.keys.poses, graph.graph.loops
    above.plot(graph.trajectory[:, 1], graph.trajectory[:, 2], color=ESTIMATED, linewidth=0.8, label="trajectory")
    lines = [poses[[link.first, link.second], :2] for link in loops.values()]
    above.add_collection(LineCollection(lines, colors=LEFT, linewidths=0.4, alpha=0.5))
    above.plot([], [], color=LEFT, label="loops")
    above.plot(*poses[0, :2], marker="o", color=INK, markersize=5, linestyle="", label="start")
    deviations = graph.graph.deviations(poses)
    off = np.array([deviations[number] for number in loops])
    doubted = [poses[loops[number].second, :2] for number in loops if deviations[number] > 5]
    if doubted:
        above.plot(*np.array(doubted).T, marker="x", color=ALARM, markersize=5, linestyle="", label="off by 5 std")
    legend(above)
    below.hist(off, bins=_BINS, color=ESTIMATED)
    below.set(xlabel="loops: off by [standard deviations]", ylabel="number")
    return figure


def _draw_zones(axes: Axes, known: MapZones) -> None:
    """Polygons, and an arrow for each place."""
    for zone in known.zones:
        colour = _ZONES[zone.kind]
        axes.fill(*np.array(zone.corners).T, facecolor=colour, alpha=0.2, edgecolor=colour, linewidth=1.0)
        x, y = np.mean(zone.corners, axis=0)
        speed = f"\n{zone.speed_m_s:g} m/s" if zone.speed_m_s is not None else ""
        axes.annotate(f"{zone.name or zone.kind}{speed}", (x, y), ha="center", va="center", fontsize=7, color=colour)
    for name, place in known.places.items():
        heading = np.radians(place.heading_deg)
        ahead = place.x_m + _ARROW * np.cos(heading), place.y_m + _ARROW * np.sin(heading)
        axes.annotate("", ahead, (place.x_m, place.y_m), arrowprops={"arrowstyle": "->", "color": INK})
        axes.plot(place.x_m, place.y_m, marker="o", color=INK, markersize=4, linestyle="")
        axes.annotate(name, (place.x_m, place.y_m), (0, -10), textcoords="offset points", ha="center", fontsize=8)
