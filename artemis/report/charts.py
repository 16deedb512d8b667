"""What the charts of a report show: of one run, or of several in the same charts. Drawn in the browser, by uPlot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from artemis.motion.arrays import Array, wrapped
from artemis.report.series import Series

MILLI, DEGREES, PERCENT = 1000.0, 180.0 / np.pi, 100.0
TIME, PATH = "run time [s]", "distance along the path [m]"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartLine:
    """One signal of a chart."""

    name: str
    ink: str
    """`reference` (set-point or plan), `estimated` (or measured), `true`, or `second`, of two measured ones. The style
    sheet knows its colour."""
    values: Array
    """In the chart's unit, nan: unknown; shape (n,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Lines over one axis."""

    name: str
    """Beside the axis, with the unit."""
    digits: int
    """Decimals that matter; what is drawn is rounded to them."""
    x: Array
    """Increasing, shape (n,)."""
    lines: tuple[ChartLine, ...]
    title: str = ""
    """If it has one of its own."""
    over: str = TIME
    """What `x` is: `TIME` or `PATH`."""
    from_zero: bool = False
    """The axis begins at zero; else zero is marked."""


def _cross_track(run: Series) -> Iterator[Chart]:
    lines = (
        ChartLine(name="true", ink="true", values=MILLI * run.true_cross_track),
        ChartLine(name=f"by {run.source}", ink="estimated", values=MILLI * run.cross_track),
    )
    if not np.isfinite(run.cross_track).any():
        return
    yield Chart(name="error [mm]", digits=2, x=run.time, lines=lines)
    along = np.isfinite(run.arc_length)
    # A path that begins anew is drawn behind the one before.
    x = np.cumsum(np.maximum(np.diff(run.arc_length[along], prepend=run.arc_length[along][:1]), 0.0))
    there = tuple(ChartLine(name=line.name, ink=line.ink, values=line.values[along]) for line in lines)
    yield Chart(name="error [mm]", digits=2, x=x, lines=there, over=PATH)


def _uncertainty(run: Series) -> Iterator[Chart]:
    if not np.isfinite(run.std).any():
        return
    off = run.estimated - run.true
    turned = np.abs(wrapped(off[:, 2]))
    localised = np.where(np.isfinite(run.std), 1.0, np.nan)
    for name, digits, scale, error, std in (
        ("position [mm]", 2, MILLI, np.hypot(off[:, 0], off[:, 1]), run.std),
        ("heading [°]", 2, DEGREES, turned, run.std_heading),
    ):
        lines = (
            ChartLine(name="true error", ink="true", values=scale * localised * error),
            ChartLine(name="standard deviation", ink="estimated", values=scale * std),
        )
        yield Chart(name=name, digits=digits, x=run.time, lines=lines, from_zero=True)
    quality = ChartLine(name="quality", ink="estimated", values=run.quality)
    yield Chart(name="quality of fixes", digits=2, x=run.time, lines=(quality,), from_zero=True)


def _plan(run: Series) -> Iterator[Chart]:
    if not np.isfinite(run.planned_speed).any():
        return
    driven = np.where(np.isfinite(run.planned_speed), np.abs(run.speed), np.nan)
    speeds = (
        ChartLine(name="planned", ink="reference", values=run.planned_speed),
        ChartLine(name="driven", ink="estimated", values=driven),
    )
    yield Chart(name="speed [m/s]", digits=3, x=run.time, lines=speeds)
    angles = (
        ChartLine(name="feed-forward", ink="reference", values=DEGREES * run.feedforward),
        ChartLine(name="feedback", ink="estimated", values=DEGREES * run.feedback),
    )
    yield Chart(name="steering [°]", digits=2, x=run.time, lines=angles)


def _wheels(run: Series, role: str, name: str, scale: float, digits: int) -> Iterator[Chart]:
    for drive, wheel in run.wheels.items():
        if wheel.role == role:
            lines = (
                ChartLine(name="set-point", ink="reference", values=scale * wheel.set_point),
                ChartLine(name="measured", ink="estimated", values=scale * wheel.measured),
            )
            yield Chart(name=name, digits=digits, x=run.time, lines=lines, title=drive)


def _speeds(run: Series) -> Iterator[Chart]:
    return _wheels(run, "traction", "speed [m/s]", 1.0, 3)


def _angles(run: Series) -> Iterator[Chart]:
    return _wheels(run, "steering", "angle [°]", DEGREES, 2)


def _temperatures(run: Series) -> Iterator[Chart]:
    for role in ("traction", "steering"):
        drives = {drive: wheel for drive, wheel in run.wheels.items() if wheel.role == role}
        lines = tuple(
            ChartLine(name=drive, ink=ink, values=wheel.temperature)
            for ink, (drive, wheel) in zip(("estimated", "second"), drives.items(), strict=False)
        )
        yield Chart(name="temperature [°C]", digits=1, x=run.time, lines=lines, title=f"{role} drives")


def _battery(run: Series) -> Iterator[Chart]:
    std = (PERCENT * (run.charge + sign * run.charge_std) for sign in (1.0, -1.0))
    charges = (
        ChartLine(name="charge", ink="estimated", values=PERCENT * run.charge),
        *(ChartLine(name="one standard deviation off", ink="reference", values=values) for values in std),
    )
    yield Chart(name="charge [%]", digits=2, x=run.time, lines=charges)
    yield Chart(
        name="voltage [V]",
        digits=3,
        x=run.time,
        lines=(ChartLine(name="under load", ink="estimated", values=run.volts),),
    )
    watts = ChartLine(name="power", ink="estimated", values=run.watts)
    yield Chart(name="power [W]", digits=1, x=run.time, lines=(watts,), from_zero=True)


def _bus(run: Series) -> Iterator[Chart]:
    load = ChartLine(name="bus load", ink="estimated", values=PERCENT * run.bus_load)
    yield Chart(name="bus load [%]", digits=2, x=run.bus_time, lines=(load,), from_zero=True)


SECTIONS: tuple[tuple[str, str, Callable[[Series], Iterator[Chart]]], ...] = (
    ("Cross-track error", "Distance of the rear axle from the path, left positive.", _cross_track),
    ("Pose uncertainty", "What the pose on the map may be off, and how well each fix says it fits.", _uncertainty),
    ("Plan and feedback", "Speed and angle of the virtual front wheel, as the follower plans them.", _plan),
    ("Wheel speeds", "Rolling speed of the driven wheels: set-point and measured.", _speeds),
    ("Steering angles", "Angles of the steered wheels, left positive: set-point and measured.", _angles),
    ("Temperatures", "Of the power stages of the drives, where they measure it.", _temperatures),
    ("Battery", "What is left of it, by its voltage and by what was taken; its voltage, and the power.", _battery),
    ("Bus load", "Share of the time that the CAN bus is busy, each frame with its most stuff bits.", _bus),
)
"""Title, caption and charts, in the order of the page."""


def charts_of(run: Series) -> dict[str, list[Chart]]:
    """Those that have something to show, by the title of their section."""
    return {title: drawn(charts(run)) for title, _, charts in SECTIONS}


def drawn(charts: Iterable[Chart]) -> list[Chart]:
    """Those that have something to show, with the lines of which something is known."""
    known = [replace(chart, lines=tuple(filter(_is_known, chart.lines))) for chart in charts]
    return [chart for chart in known if chart.lines]


def _is_known(line: ChartLine) -> bool:
    return bool(np.isfinite(line.values).any())
