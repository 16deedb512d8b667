"""What pages of runs are made of: tables, folded parts, the charts, and the frame around all of it."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from itertools import groupby

from artemis.report.chart_data import ChartData, PlacedChart
from artemis.report.path_map import PLACE, PathMap

_MARKS = {"start": PLACE, "end": "M-6-6H6V6H-6z", "fault": "M-6-6L6 6M-6 6L6-6"}
_DOTS = {"seen", "slowed"}
_UNSCRIPTED = (
    "The charts below are drawn by JavaScript, which this browser does not run here. Numbers, faults, map and "
    "tables are all there without it."
)


def table(
    head: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]], *, numbers: int, stacking: bool = False
) -> str:
    """A table; each row comes with its class. The last `numbers` columns are numbers.

    `stacking`: on a narrow screen the cells of a row stand below each other.
    """
    kinds = [""] * (len(head) - numbers) + [' class="number"'] * numbers
    names = [f' data-name="{escape(name)}"' if stacking else "" for name in head]
    lines = ['<table class="stacking">' if stacking else "<table>"]
    if any(head):
        cells = "".join(f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, head, strict=True))
        lines.append(f"<tr>{cells}</tr>")
    for row_class, values in rows:
        cells = "".join(
            f"<td{kind}{name}>{escape(value)}</td>" for kind, name, value in zip(kinds, names, values, strict=True)
        )
        lines.append(f'<tr class="{row_class}">{cells}</tr>' if row_class else f"<tr>{cells}</tr>")
    return "\n".join([*lines, "</table>"])


def folded(title: str, what: str, content: str, *, printed: bool = False) -> str:
    """A part that a click shows; `printed`: paper shows it too."""
    told = f" <span>{escape(what)}</span>" if what else ""
    words = ' class="printed"' if printed else ""
    return f'<details{words}><summary>{escape(title)}{told}</summary>\n<div class="wide">{content}</div></details>'


def map_section(picture: PathMap) -> str:
    """The map with the names of what is on it."""
    names = "".join(
        f'<li><svg class="{which}" viewBox="-13 -7 26 14" aria-hidden="true">{_sample(kind)}</svg>{escape(name)}</li>'
        for name, (kind, which) in picture.names.items()
    )
    caption = "Centre of the rear axle, seen from above, in the frame of its pose."
    return f'<h2>Path and trajectory</h2>\n<p>{caption}</p>\n<ul class="names">{names}</ul>\n{picture.svg}'


def _sample(kind: str) -> str:
    if kind in _DOTS:
        return f'<path class="{kind}" stroke-linecap="round" stroke-width="6" d="M0 0h0"/>'
    return f'<path class="{kind}" d="{_MARKS.get(kind, "M-13 0H13")}"/>'


def chart_sections(data: ChartData, begins: Sequence[str] = (), chosen: int = 0) -> list[str]:
    """All charts, below the tools that work on them; `begins`: names of what the runs may be aligned at."""
    options = "".join(
        f'<option value="{number}"{" selected" * (number == chosen)}>{escape(name)}</option>'
        for number, name in enumerate(begins)
    )
    choice = f'<label>aligned at <select id="align">{options}</select></label>' if options else ""
    tools = (
        f'<p class="warning" id="unscripted">{_UNSCRIPTED}</p>\n<div class="tools" id="tools" hidden>'
        '<output id="readout"></output><span class="hint">Drag to zoom; double click shows all</span>'
        f'{choice}<button type="button" id="reset">Show all</button></div>'
    )
    caption = "What the robot and its drives were doing over the run time, and what happened."
    parts = [tools, "<h2>Modes, drives and events</h2>", f"<p>{caption}</p>"]
    label = "Modes of the robot, states of its drives, faults, requests and jobs"
    shown = f'<div class="plot" id="timeline" role="group" tabindex="0" aria-label="{label}"></div>'
    parts.append(f'<div class="panel">{shown}</div>')
    for (title, text), charts in groupby(data.placed, lambda chart: (chart.title, chart.caption)):
        parts += [f"<h2>{title}</h2>", f"<p>{text}</p>", *map(_panel, charts)]
    return parts


def _panel(chart: PlacedChart) -> str:
    return (
        f'<div class="panel"><div class="head"><b>{escape(chart.name)}</b></div><div class="plot" role="group" '
        f'tabindex="0" data-chart="{chart.number}" aria-label="{escape(chart.label)}"></div></div>'
    )


def framed(title: str, parts: Iterable[str], data: ChartData) -> str:
    """The whole page: everything inside, and nothing else may be loaded or run."""
    script = _script()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>\n{_static('uplot/uPlot.min.css')}\n{_static('report/report.css')}</style>\n</head>\n<body>\n"
        + "\n".join(filter(None, parts))
        + f'\n<script type="application/json" id="data">{data.text()}</script>\n<script>{script}</script>\n'
        + "</body>\n</html>\n"
    )


@cache
def _static(name: str) -> str:
    return (files("artemis") / "static" / name).read_text(encoding="utf-8").strip()


@cache
def _script() -> str:
    licence = _static("uplot/LICENSE")
    return f"/* uPlot:\n{licence}\n*/\n{_static('uplot/uPlot.iife.min.js')}\n{_static('report/report.js')}\n"
