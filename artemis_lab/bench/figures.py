"""One figure for each course: what the followers drove, and their error along it."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib as mpl
from matplotlib.figure import Figure

from artemis.report.figures import INK, PATH, WIDTH, thinned
from artemis_lab.bench.courses import Course
from artemis_lab.bench.judge import RunTrack

LINEAR = 10.0
"""Errors below are drawn to scale, larger ones logarithmically [mm]: followers differ by two orders of magnitude."""


def course_figure(course: Course, tracks: Mapping[str, RunTrack], title: str) -> Figure:
    """The course from above with the followers' tracks; cross-track error over arc length. Call inside `style`."""
    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
    above.plot(*course.points.T, color=PATH, linewidth=5.0, alpha=0.45, label="course")
    colors = mpl.colormaps["tab10"].colors  # type: ignore[attr-defined]  # of a listed colormap
    for number, (name, track) in enumerate(tracks.items()):
        color = colors[number % len(colors)]
        above.plot(track.x, track.y, color=color, linewidth=1.0, label=name)
        below.plot(*thinned(track.arc_length, track.cross_track * 1000), color=color, linewidth=1.0)
    above.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=title)
    above.set_adjustable("datalim")
    above.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    most = max(2000.0 * max(abs(track.cross_track).max() for track in tracks.values()), LINEAR)
    below.axhline(0.0, color=INK, linewidth=0.6)
    below.set(xlabel="arc length [m]", ylabel="cross-track error [mm], left positive")
    below.set_yscale("symlog", linthresh=LINEAR)
    below.set_yticks([-1000, -100, -10, -5, 0, 5, 10, 100, 1000], minor=False)
    below.yaxis.set_major_formatter("{x:g}")
    below.set_ylim(-most, most)
    return figure
