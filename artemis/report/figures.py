"""Figures of a run: one function each, one style, one colour per signal, readable on light and dark pages."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from artemis.drive_states import DriveState
from artemis.motion.spline import Array
from artemis.recording.journal import Entry
from artemis.report.known_map import draw_under
from artemis.report.series import Interval, Series
from artemis.values import Mode

INK = "#0a0b0c"
"""Text and axes. The page replaces it by its own text colour, so that figures fit a light and a dark page."""
PATH, ESTIMATED, TRUE = "#9aa0a6", "#2f7ed8", "#e8832a"
LEFT, RIGHT = "#1b9e8a", "#a05cc0"
ALARM = "#d64545"
MODE_COLORS = {
    Mode.INIT.value: "#b8c4d0",
    Mode.READY.value: "#8fbfa0",
    Mode.CALIBRATE.value: "#d9b44a",
    Mode.TELEOP.value: "#a58bd0",
    Mode.FOLLOW.value: "#6fa8dc",
    Mode.ACT.value: "#d58fb4",
    Mode.QUICKSTOP.value: "#ee9a4d",
    Mode.FAULT.value: ALARM,
    Mode.END.value: "#9aa0a6",
}
STATE_GROUPS = {
    DriveState.UNKNOWN.value: "unknown",
    DriveState.START.value: "off",
    DriveState.NOT_READY.value: "off",
    DriveState.SWITCH_ON_DISABLED.value: "off",
    DriveState.READY.value: "rising",
    DriveState.SWITCHED_ON.value: "rising",
    DriveState.REFRESH.value: "rising",
    DriveState.MEASURE_INIT.value: "rising",
    DriveState.OPERATION_ENABLE.value: "enabled",
    DriveState.QUICK_STOP_ACTIVE.value: "stopping",
    DriveState.FAULT_REACTION_DISABLED.value: "stopping",
    DriveState.FAULT_REACTION_ENABLED.value: "stopping",
    DriveState.FAULT.value: "fault",
}
GROUP_COLORS = {
    "unknown": "#dfe3e8",
    "off": "#b8c4d0",
    "rising": "#d9b44a",
    "enabled": "#8fbfa0",
    "stopping": "#ee9a4d",
    "fault": ALARM,
}
STATE_COLORS = {state: GROUP_COLORS[group] for state, group in STATE_GROUPS.items()}
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
MARGIN_LEFT, MARGIN_TOP, MARGIN_BOTTOM = 1.05, 0.32, 0.48
"""Of figures over time [inch]."""
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


# --------------------------------------------------------------------------------------------------------- figures


def path_figure(run: Series) -> Figure:
    """The path, and what the robot drove, seen from above."""
    figure = Figure(figsize=(WIDTH, 6.2), layout="constrained")
    axes = figure.add_subplot()
    for number, path in enumerate(run.paths):
        axes.plot(path.x, path.y, color=PATH, linewidth=5.0, alpha=0.45, label="path" if number == 0 else None)
    _trajectory(axes, run.true, TRUE, "driven (true)")
    if run.source != "odometry":
        _trajectory(axes, run.odometry, LEFT, "by odometry alone")
    _trajectory(axes, run.estimated, ESTIMATED, f"driven ({run.source})")
    known = run.estimated[np.isfinite(run.estimated[:, 0])]
    if len(known):
        x, y, heading = known[0]
        axes.plot(x, y, marker=(3, 0, np.degrees(heading) - 90), color=INK, markersize=9, linestyle="", label="start")
        axes.plot(*known[-1, :2], marker="o", color=INK, markersize=6, linestyle="", label="end")
    slowed = np.isfinite(run.slowed)
    if slowed.any():
        x, y, _ = run.estimated[slowed].T
        axes.plot(x, y, marker=".", color=RIGHT, markersize=5, linestyle="", label="slowed for an obstacle", zorder=4)
    run.around.draw(axes, PATH, ALARM)
    faults = [entry.time for entry in _faults(run)]
    if faults and len(known):
        x, y, _ = run.estimated[np.searchsorted(run.time, faults).clip(0, len(run.time) - 1)].T
        axes.plot(x, y, marker="X", color=ALARM, markersize=9, linestyle="", label="fault", zorder=5)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_adjustable("datalim")
    if run.map is not None:
        draw_under(axes, run.map)
    legend(axes)
    return figure


def cross_track_figure(run: Series) -> Figure:
    """Distance from the path over time and over the distance along it."""
    figure, (over_time, over_arc) = stacked(run, 2, 2.1, sharex=False)
    for error, arc_length, color, label in (
        (run.true_cross_track, run.true_arc_length, TRUE, "true"),
        (run.cross_track, run.arc_length, ESTIMATED, f"by {run.source}"),
    ):
        if np.isfinite(error).any():
            over_time.plot(*thinned(run.time, 1000 * error), color=color, label=label)
            over_arc.plot(*thinned(arc_length, 1000 * error), color=color)
    legend(over_time)
    for axes in (over_time, over_arc):
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_ylabel("error [mm]")
    over_arc.set_xlabel("arc length along the path [m]")
    return figure


def uncertainty_figure(run: Series) -> Figure:
    """Standard deviations of the estimated pose, with its true error, and how well the scans fit the map."""
    figure, (place, heading, fits) = stacked(run, 3, 1.4, sharey=False)
    off = np.hypot(*(run.estimated - run.true)[:, :2].T)
    turned = np.degrees(((run.estimated - run.true)[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    localised = np.isfinite(run.std)
    for axes, error, std, unit in (
        (place, 1000 * off, 1000 * run.std, "position [mm]"),
        (heading, np.abs(turned), np.degrees(run.std_heading), "heading [°]"),
    ):
        error = np.where(localised, error, np.nan)
        if np.isfinite(error).any():
            axes.plot(*thinned(run.time, error), color=TRUE, label="true error")
        axes.plot(*thinned(run.time, std), color=ESTIMATED, label="standard deviation")
        axes.set_ylabel(unit)
        axes.set_ylim(bottom=0.0)
    fits.plot(*thinned(run.time, run.quality), color=LEFT)
    fits.set(ylabel="quality of fixes", ylim=(0.0, 1.05))
    legend(place)
    return figure


def plan_figure(run: Series) -> Figure:
    """Speed as planned and as driven; steering for the path itself, and what feedback adds to it."""
    figure, (speeds, angles) = stacked(run, 2, 1.7, sharey=False)
    driven = np.where(np.isfinite(run.planned_speed), np.abs(run.speed), np.nan)
    speeds.plot(*thinned(run.time, run.planned_speed), color=PATH, linewidth=4.0, alpha=0.45, label="planned")
    speeds.plot(*thinned(run.time, driven), color=ESTIMATED, label="driven")
    speeds.set_ylabel("speed [m/s]")
    angles.plot(*thinned(run.time, np.degrees(run.feedforward)), color=PATH, label="feed-forward")
    angles.plot(*thinned(run.time, np.degrees(run.feedback)), color=ESTIMATED, label="feedback")
    angles.set_ylabel("steering [°]")
    for axes in (speeds, angles):
        _mark_faults(axes, run)
        legend(axes)
    return figure


def speed_figure(run: Series) -> Figure:
    """Rolling speed of each driven wheel: set-point and measured."""
    return _wheel_figure(run, "traction", 1.0, "speed [m/s]")


def steering_figure(run: Series) -> Figure:
    """Angle of each steered wheel: set-point and measured."""
    return _wheel_figure(run, "steering", np.degrees(1.0), "angle [°]")


def timeline_figure(run: Series) -> Figure:
    """Mode of the robot, state of each drive, and what happened, over time."""
    lanes = {"robot": (run.modes, MODE_COLORS)}
    lanes |= {name: (states, STATE_COLORS) for name, states in run.drive_states.items()}
    happenings = {"faults": ("fault", ALARM, "X"), "requests": ("request", ESTIMATED, "v"), "jobs": ("job", PATH, "d")}
    figure, (axes,) = stacked(run, 1, 0.34 * (len(lanes) + len(happenings)), below=0.75)
    for row, (intervals, colors) in enumerate(lanes.values()):
        _band(axes, run, row, intervals, colors)
    for row, (kind, color, marker) in enumerate(happenings.values(), start=len(lanes)):
        times = [entry.time for entry in run.entries if entry.kind == kind]
        axes.plot(times, [row] * len(times), marker=marker, color=color, markersize=6, linestyle="", clip_on=False)
    _mark_faults(axes, run)
    axes.set_yticks(range(len(lanes) + len(happenings)), [*lanes, *happenings])
    axes.set_ylim(len(lanes) + len(happenings) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    modes = {interval.value: MODE_COLORS[interval.value] for interval in run.modes}
    states = {STATE_GROUPS[each.value] for intervals in run.drive_states.values() for each in intervals}
    _patches(figure, "robot", modes, MARGIN_LEFT / WIDTH, "lower left")
    _patches(figure, "drives", {k: v for k, v in GROUP_COLORS.items() if k in states}, 0.99, "lower right")
    return figure


def bus_figure(run: Series) -> Figure:
    """Load of the CAN bus over time."""
    figure, (axes,) = stacked(run, 1, 1.7)
    if len(run.bus_load):
        axes.fill_between(run.bus_time, 100 * run.bus_load, step="mid", color=ESTIMATED, alpha=0.2, linewidth=0)
        axes.step(run.bus_time, 100 * run.bus_load, where="mid", color=ESTIMATED, linewidth=1.0)
        axes.set_ylim(0.0, 1.15 * max(1.0, 100 * float(np.max(run.bus_load))))
    axes.set_ylabel("bus load [%]")
    return figure


FIGURES: tuple[tuple[str, str, Callable[[Series], Figure]], ...] = (
    ("Path and trajectory", "Centre of the rear axle, seen from above, in the frame of its pose.", path_figure),
    ("Cross-track error", "Distance of the rear axle from the path, left positive.", cross_track_figure),
    (
        "Pose uncertainty",
        "What the pose on the map may be off, and how well each fix says it fits.",
        uncertainty_figure,
    ),
    ("Plan and feedback", "Speed and angle of the virtual front wheel, as the follower plans them.", plan_figure),
    ("Wheel speeds", "Rolling speed of the driven wheels: set-point and measured.", speed_figure),
    ("Steering angles", "Angles of the steered wheels, left positive: set-point and measured.", steering_figure),
    ("Modes, drives and events", "What the robot and its drives were doing, and what happened.", timeline_figure),
    ("Bus load", "Share of the time that the CAN bus is busy, each frame with its most stuff bits.", bus_figure),
)
"""Title, caption and function of each figure, in the order of the page."""


def drawn(run: Series) -> Iterator[tuple[str, str, str]]:
    """Title, caption and SVG element of every figure that has something to show."""
    shown: dict[Callable[[Series], Figure], bool] = {
        cross_track_figure: bool(np.isfinite(run.cross_track).any()),
        plan_figure: bool(np.isfinite(run.planned_speed).any()),
        uncertainty_figure: bool(np.isfinite(run.std).any()),
    }
    with style():
        for title, caption, draw in FIGURES:
            if shown.get(draw, True):
                yield title, caption, svg(draw(run))


# ----------------------------------------------------------------------------------------------------------- parts


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


def _trajectory(axes: Axes, poses: Array, color: str, label: str) -> None:
    """Draw where the robot was, without the many points of standstill."""
    x, y = poses[np.isfinite(poses[:, 0]), :2].T
    if len(x) == 0:
        return
    distance = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    step = max(float(np.ptp(x)), float(np.ptp(y)), distance[-1] / 50) / 1000
    kept = np.unique(np.append(np.unique(distance // step if step > 0 else distance, return_index=True)[1], len(x) - 1))
    axes.plot(x[kept], y[kept], color=color, label=label)


def stacked(
    run: Series, count: int, height: float, *, sharex: bool = True, sharey: bool = True, below: float = 0.0
) -> tuple[Figure, list[Axes]]:
    """Axes below each other [`height` inch each], run time on the lowest (or the first, unless they share it).

    All such figures have the same margins, so that one moment is at the same place in all of them.
    """
    gap = 0.38 if sharex else 0.6
    total = MARGIN_TOP + count * height + (count - 1) * gap + MARGIN_BOTTOM + below
    figure = Figure(figsize=(WIDTH, total))
    rows = list(figure.subplots(count, 1, sharex=sharex, sharey=sharey, squeeze=False)[:, 0])
    figure.subplots_adjust(
        left=MARGIN_LEFT / WIDTH,
        right=0.99,
        top=1 - MARGIN_TOP / total,
        bottom=(MARGIN_BOTTOM + below) / total,
        hspace=gap / height,
    )
    timed = rows[-1] if sharex else rows[0]
    timed.set_xlabel("run time [s]")
    if len(run.time):
        timed.set_xlim(run.time[0], max(run.time[-1], run.time[0] + 0.1))
    return figure, rows


def _wheel_figure(run: Series, role: str, scale: float, label: str) -> Figure:
    wheels = [(name, wheel) for name, wheel in run.wheels.items() if wheel.role == role]
    figure, rows = stacked(run, len(wheels), 1.5)
    for axes, (name, wheel) in zip(rows, wheels, strict=True):
        color = LEFT if wheel.side == "left" else RIGHT
        set_point, measured = scale * wheel.set_point, scale * wheel.measured
        axes.plot(*thinned(run.time, set_point), color=PATH, linewidth=4.0, alpha=0.45, label="set-point")
        axes.plot(*thinned(run.time, measured), color=color, label="measured")
        axes.set_title(name)
        axes.set_ylabel(label)
        _mark_faults(axes, run)
        legend(axes)
    return figure


def _mark_faults(axes: Axes, run: Series) -> None:
    for entry in _faults(run):
        axes.axvline(entry.time, color=ALARM, linewidth=0.8, alpha=0.6, zorder=0)


def _patches(
    figure: Figure, title: str, colors: dict[str, str], x: float, place: Literal["lower left", "lower right"]
) -> None:
    """What the colours of bands mean."""
    handles = [Patch(color=color, label=label) for label, color in colors.items()]
    if handles:
        figure.legend(
            handles=handles,
            title=title,
            loc=place,
            bbox_to_anchor=(x, 0.0),
            ncols=6,
            handlelength=1.0,
            columnspacing=1.2,
            borderaxespad=0.0,
            alignment="left",
        )


def _band(axes: Axes, run: Series, row: int, intervals: Sequence[Interval], colors: dict[str, str]) -> None:
    """One lane of coloured stretches, named where there is room."""
    spans = [(interval.begin, interval.end - interval.begin) for interval in intervals]
    axes.broken_barh(spans, (row - 0.34, 0.68), facecolors=[colors[interval.value] for interval in intervals])
    room = (run.time[-1] - run.time[0]) / 110 if len(run.time) else 0.0  # of one letter
    for interval in intervals:
        if interval.end - interval.begin > room * (len(interval.value) + 2):
            middle = (interval.begin + interval.end) / 2
            axes.text(middle, row, interval.value, color="#1d2125", fontsize=8, ha="center", va="center")


def legend(axes: Axes) -> None:
    """Name the lines, in one row above the axes, or two."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        columns = len(handles) if len(handles) < 8 else (len(handles) + 1) // 2
        axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2)


def _faults(run: Series) -> list[Entry]:
    return [entry for entry in run.entries if entry.kind == "fault"]
