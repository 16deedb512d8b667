"""Figures of a comparison with the truth: the path coloured by its error, relative errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from artemis.motion.comparison import Comparison
from artemis.report.figures import ESTIMATED, INK, TRUE, WIDTH, legend, style, svg
from artemis.report.truth_charts import after_gap

PIECES = 800
"""Of the coloured line, at most about."""
ERROR_COLORS = LinearSegmentedColormap.from_list("error", ["#3b6fb6", "#8a83a8", "#d9a13a", "#c94f00"])
"""From none to the largest, from blue to orange: readable on light and dark pages, and with any colour vision."""


def error_map(comparison: Comparison) -> Figure:
    """The true path, and what the odometry believed, coloured by its distance from the true place at that moment."""
    figure = Figure(figsize=(WIDTH, 6.2), layout="constrained")
    axes = figure.add_subplot()
    rows = _spaced(comparison)
    joined = ~after_gap(comparison)[rows[1:]]
    true = np.where(np.append(True, joined)[:, np.newaxis], comparison.true[rows, :2], np.nan)
    axes.plot(*true.T, color=INK, linewidth=1.0, alpha=0.55, label="true")
    places, errors = comparison.estimated[rows, :2], 1000 * comparison.error[rows]
    pieces = LineCollection(
        np.stack([places[:-1], places[1:]], axis=1)[joined].tolist(),
        cmap=ERROR_COLORS,
        linewidths=3.0,
        capstyle="round",
    )
    pieces.set_array(np.maximum(errors[:-1], errors[1:])[joined])
    pieces.set_clim(0.0, max(float(np.max(errors)), 1e-3))
    axes.add_collection(pieces)
    axes.autoscale_view()
    x, y, heading = comparison.estimated[0]
    axes.plot(x, y, marker=(3, 0, np.degrees(heading) - 90), color=INK, markersize=9, linestyle="", label="start")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_adjustable("datalim")
    legend(axes)
    bar = figure.colorbar(pieces, ax=axes, label="distance from the true place [mm]", fraction=0.04, pad=0.02)
    bar.outline.set_visible(False)
    return figure


def relative_figure(comparison: Comparison) -> Figure:
    """Mean errors of the motion over stretches of the distance, by their length, and the largest ones."""
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    distances, turns = figure.subplots(1, 2)
    at = np.arange(len(comparison.relative))
    for axes, scale, label, errors in (
        (distances, 100.0, "place [% of the distance]", [each.translation for each in comparison.relative]),
        (turns, np.degrees(1.0), "heading [°/m]", [each.rotation for each in comparison.relative]),
    ):
        axes.bar(at, [scale * float(np.mean(each)) for each in errors], color=ESTIMATED, width=0.6)
        largest = [scale * float(np.max(each)) for each in errors]
        axes.plot(at, largest, color=TRUE, marker="_", markersize=14, linestyle="", label="largest")
        axes.set_xticks(at, [f"{each.length:g}" for each in comparison.relative])
        axes.set(xlabel="stretches of [m]", ylabel=label)
        axes.grid(axis="x", visible=False)
        legend(axes)
    return figure


def truth_drawn(comparison: Comparison) -> Iterator[tuple[str, str, str]]:
    """Title, caption and SVG element of every figure that has something to show."""
    with style():
        caption = "Seen from above, in the frame of the truth: odometry coloured by its distance from the true place."
        yield "Path and its error", caption, svg(error_map(comparison))
        if comparison.relative:
            caption = "Error of the motion over stretches of the distance, beginning anywhere: mean (bars) and largest."
            yield "Relative errors", caption, svg(relative_figure(comparison))


def _spaced(comparison: Comparison) -> NDArray[np.int64]:
    """Rows that are about evenly spread over the distance; the last one and those after gaps are among them."""
    distance = comparison.distance
    step = max(distance[-1], 1e-3) / PIECES
    evenly = np.unique(distance // step, return_index=True)[1]
    return np.unique(np.concatenate([evenly, np.flatnonzero(after_gap(comparison)), [len(distance) - 1]]))
