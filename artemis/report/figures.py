"""Figures by matplotlib: one style, one colour per signal, readable on light and dark pages.

The report of a run needs none of them, unless it is compared with a truth.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from artemis.motion.arrays import Array

INK = "#0a0b0c"
"""Text and axes. The page replaces it by its own text colour, so that figures fit a light and a dark page."""
PATH, ESTIMATED, TRUE = "#9aa0a6", "#2f7ed8", "#e8832a"
LEFT, RIGHT = "#1b9e8a", "#a05cc0"
ALARM = "#d64545"
STYLE: Any = {  # matplotlib types the keys one by one
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": INK,
    "grid.alpha": 0.12,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.title_fontsize": 8.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.hashsalt": "artemis",
    "svg.fonttype": "path",
}
WIDTH = 10.0
"""Of every figure [inch]."""
MARGIN_TOP, MARGIN_BOTTOM = 0.32, 0.48
"""Of some figures [inch]."""
POINTS = 3000
"""A line has at most about this many points; extremes are kept."""


@contextmanager
def style() -> Iterator[None]:
    """Draw and save figures inside, whatever the user's matplotlib settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def svg(figure: Figure) -> str:
    """The figure as an SVG element for a page; its ink is the text colour around it. Call inside `style`."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = buffer.getvalue()
    text = re.sub(r'<g id="[^"]*">', "<g>", text[text.index("<svg") :])  # the same in every figure, and never used
    return text.replace(INK, "currentColor")


def thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """A line with at most about `POINTS` points: of each stretch its lowest and highest."""
    per_bin = -(-2 * len(x) // POINTS)
    if per_bin <= 2:
        return x, y
    count = len(x) // per_bin
    body = y[: count * per_bin].reshape(count, per_bin)
    starts = per_bin * np.arange(count)
    lowest = starts + np.argmin(np.where(np.isnan(body), np.inf, body), axis=1)
    highest = starts + np.argmax(np.where(np.isnan(body), -np.inf, body), axis=1)
    kept = np.unique(np.concatenate([lowest, highest, np.arange(count * per_bin, len(x))]))
    return x[kept], y[kept]


def legend(axes: Axes) -> None:
    """Name the lines, in one row above the axes, or two."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        columns = len(handles) if len(handles) < 8 else (len(handles) + 1) // 2
        axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2)
