"""The page of a fit: one HTML file with tables and figures inside."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure

from artemis.calibration.knowledge import QUANTILE, Estimates
from artemis.calibration.score import ScoredRun
from artemis.report.figures import ESTIMATED, INK, PATH, TRUE, WIDTH, legend, style, svg, thinned

MAX_MAPS = 12
"""Runs that are drawn in top view; the others are in the tables."""
DRAWN = 0.1
"""Means of truth and odometry over so long are drawn [s]."""
_STYLE = """
:root { color-scheme: light dark; --ink: #1d2125; --paper: #ffffff; --line: #dde1e6; }
@media (prefers-color-scheme: dark) { :root { --ink: #d9dde2; --paper: #16191d; --line: #343b43; } }
body { margin: 0 auto; padding: 32px 20px 64px; max-width: 1000px; color: var(--ink); background: var(--paper);
       font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 26px; font-weight: 600; margin: 0; }
h2 { font-size: 17px; font-weight: 600; margin: 40px 0 2px; }
svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: 4px 10px 4px 0; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; }
""".strip()

Tables = Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]]


def page(title: str, tables: Tables, figures: Sequence[tuple[str, Figure]]) -> str:
    """HTML of tables (title, head, rows) and figures (title, figure), these drawn inside `style`."""
    parts = [f"<h1>{escape(title)}</h1>"]
    parts += [f"<h2>{escape(name)}</h2>\n{_table(head, rows)}" for name, head, rows in tables if rows]
    parts += [f"<h2>{escape(name)}</h2>\n{svg(figure)}" for name, figure in figures]
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f"<style>\n{_STYLE}\n</style>\n</head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return "<table>" + line("th", head) + "".join(line("td", row) for row in rows) + "</table>"


def drawn(before: Sequence[ScoredRun], after: Sequence[ScoredRun], found: Estimates) -> list[tuple[str, Figure]]:
    """Figures of a fit with a truth; call inside `style`."""
    return [
        ("Truth and odometry, before and after, top view", map_figure(before, after)),
        ("Distance from the truth over the distance driven", error_figure(before, after)),
        ("Parameters as shares of their plausible bands, with 95 % intervals", parameter_figure(found)),
    ]


def map_figure(before: Sequence[ScoredRun], after: Sequence[ScoredRun]) -> Figure:
    """Each run from above."""
    pairs = list(zip(before, after, strict=True))[:MAX_MAPS]
    columns = min(3, len(pairs))
    rows = -(-len(pairs) // columns)
    figure = Figure(figsize=(WIDTH, 3.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel in panels[len(pairs) :]:
        panel.set_axis_off()
    for panel, (old, new) in zip(panels, pairs, strict=False):
        panel.plot(*old.reckoned[:, :2].T, color=PATH, label="before")
        panel.plot(*new.true[:, :2].T, color=TRUE, label="truth")
        panel.plot(*new.reckoned[:, :2].T, color=ESTIMATED, linestyle="--", label="after")
        panel.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        panel.set_adjustable("datalim")
        panel.set_title(fill(Path(old.name).name, 34))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def error_figure(before: Sequence[ScoredRun], after: Sequence[ScoredRun]) -> Figure:
    """Position error of every run over its distance."""
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for tracks, color, label in ((before, PATH, "before"), (after, ESTIMATED, "after")):
        for number, track in enumerate(tracks):
            line = thinned(track.distance, 1000.0 * track.error)
            axes.plot(*line, color=color, linewidth=1.0, label=label if number == 0 else None)
    axes.set(xlabel="distance [m]", ylabel="error [mm]", yscale="log")
    axes.set_ylim(bottom=200.0 * min(float(np.median(each.error)) for each in (*before, *after)) or None)
    legend(axes)
    return figure


def parameter_figure(found: Estimates) -> Figure:
    """Each parameter of the machine, held ones grey."""
    shown = [each for each in found.estimates if not each.parameter.name.startswith("sensor")]
    figure = Figure(figsize=(WIDTH, 0.6 + 0.34 * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    for row, each in enumerate(shown):
        band, color = each.parameter.band, ESTIMATED if each.seen else PATH
        width = min(each.half_width / band, 2.0 * QUANTILE)
        axes.errorbar(each.value / band, row, xerr=width, color=color, marker="o", markersize=4, capsize=3)
    axes.axvline(0.0, color=INK, linewidth=0.6)
    axes.set_yticks(range(len(shown)), [each.parameter.name for each in shown])
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xlabel("deviation from the nominal value, in standard deviations of the plausible band")
    return figure


def residual_figure(before: Sequence[Sequence[float]], after: Sequence[Sequence[float]]) -> Figure:
    """Where runs end that should end where they began: x, y [m] of each, before and after."""
    figure = Figure(figsize=(WIDTH, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for ends, color, label in ((before, PATH, "before"), (after, ESTIMATED, "after")):
        axes.plot(*(1000.0 * np.array(ends)[:, :2].T), color=color, marker="o", linestyle="", label=label)
    axes.plot(0.0, 0.0, marker="+", color=INK, markersize=12, linestyle="", label="measured")
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes.set_adjustable("datalim")
    legend(axes)
    return figure


def styled_page(tables: Tables, before: Sequence[ScoredRun], after: Sequence[ScoredRun], found: Estimates) -> str:
    """The whole page of a fit with a truth."""
    with style():
        return page("Calibration of the odometry", tables, drawn(before, after, found))


def closing_page(tables: Tables, before: np.ndarray, after: np.ndarray, found: Estimates) -> str:
    """The whole page of a fit of closing errors."""
    with style():
        figures = [
            (
                "Ends of the runs relative to the measured ones",
                residual_figure(before.tolist(), after.tolist()),
            ),
            ("Parameters as shares of their plausible bands, with 95 % intervals", parameter_figure(found)),
        ]
        return page("Calibration of the odometry by closing errors", tables, figures)
