"""A map, seen from above, with the way of the robot and the loops of its graph."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from artemis.mapping.graph_file import MapGraph
from artemis.mapping.occupancy import OccupancyMap
from artemis.report.figures import ALARM, ESTIMATED, INK, LEFT, WIDTH, legend

_UNKNOWN_GREY = 0.87
_BINS = 40


def map_figure(content: OccupancyMap, graph: MapGraph | None) -> Figure:
    """The map; with a graph also its trajectory, its loops, and how far each loop is off."""
    figure = Figure(figsize=(WIDTH, 8.0 if graph is None else 10.0), layout="constrained")
    if graph is None:
        above = figure.add_subplot()
    else:
        above, below = figure.subplots(2, 1, height_ratios=(5, 1))
    cells = content.cells
    grey = np.where(cells < 0, _UNKNOWN_GREY, 1 - cells / 100)
    rows, columns = cells.shape
    x, y, heading = content.origin
    image = above.imshow(
        grey,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        interpolation="nearest",
        extent=(0, columns * content.resolution, 0, rows * content.resolution),
    )
    image.set_transform(Affine2D().rotate(heading).translate(x, y) + above.transData)
    corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) * content.resolution
    turned = corners @ np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]) + (x, y)
    above.set(xlim=(turned[:, 0].min(), turned[:, 0].max()), ylim=(turned[:, 1].min(), turned[:, 1].max()))
    above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    if graph is None:
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
