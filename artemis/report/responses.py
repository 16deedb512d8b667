"""How drives followed a step in a run: read from its recording, as numbers and as a figure."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.step_response import StepResponse, slope, step_response
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.values import Mode
from artemis.vehicle import RobotFile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEED_DISTANCE = 0.012
"""A wheel's speed is the slope of its position over the time in which it rolls so far [m]: halls are too coarse for
less."""
BEFORE = 0.05
"""So much of the rest before the step is shown [s]."""
SLOWEST = 0.1
"""[m/s]."""
REST = 20
"""Ticks of standing before a path that belong to its trace; a turn of the wheels has a rest of its own."""
HEIGHT = 1.7
"""Of each row of the figure [inch]."""
PANELS = ("set-point and value", "error", "current")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """One drive during one step of a mission; angles in degrees, speeds in m/s. Arrays of shape (n,)."""

    drive: str
    unit: str
    time: Array
    """[s]."""
    set_point: Array
    value: Array
    current: Array
    """[A]."""
    position: Array
    """[m] or [rad] of the wheel."""
    width: float = 0.0
    """Each value belongs to so long a time [s]."""

    def response(self) -> StepResponse:
        """In numbers.

        Raises:
            CalibrationError: the run was over before the step.
        """
        return step_response(self.time, self.set_point, self.value, self.current, 0.5 * self.width)


_TRIED = (Mode.CALIBRATE, Mode.FOLLOW)
_Row = tuple[float, float, float, float]
"""Time, set-point, position and current."""


def read_traces(recording: Recording, drives: Sequence[str], steps: Sequence[int]) -> dict[tuple[str, int], Trace]:
    """What some drives did in some steps of the mission, counted from 0; steps that were not reached are left out.

    What a drive said in one tick it measured when it got the set-point of the tick before (at its SYNC).

    Raises:
        RecordingError: a tick holds other values than this version of artemis knows.
    """
    rows: dict[tuple[str, int], list[_Row]] = {}
    recent: dict[str, deque[_Row]] = {name: deque(maxlen=REST) for name in drives}
    before: TickRecord | None = None
    for tick in recording.ticks():
        if tick.snapshot.sensed.urgent:
            continue
        for drive in tick.snapshot.sensed.drives:
            if before is not None and drive.name in recent and drive.age is not None:
                told, step = _set_point(before, recording.robot, drive.name), before.position.step
                row = before.snapshot.time, told, drive.position, drive.current
                if step in steps and before.mode in _TRIED:
                    rest = recent[drive.name] if recording.robot.drives[drive.name].role == "traction" else ()
                    rows.setdefault((drive.name, step), list(rest)).append(row)
                recent[drive.name].append(row)
        before = tick
    return {key: _trace(key[0], recording.robot, np.array(found)) for key, found in rows.items()}


def _set_point(tick: TickRecord, robot: RobotFile, name: str) -> float:
    told: float = getattr(tick.set_points, robot.drives[name].set_point)
    return told


def _trace(name: str, robot: RobotFile, table: Array) -> Trace:
    time, told, position, current = table.T
    return replace(trace_of(name, robot, time, told, position), current=current)


def trace_of(name: str, robot: RobotFile, time: Array, told: Array, position: Array) -> Trace:
    """What a drive was told, and where its wheel was [m or m/s, or rad]; without its current."""
    current = np.zeros(len(time))
    if robot.drives[name].role == "traction":
        width = SPEED_DISTANCE / max(float(np.max(np.abs(told))), SLOWEST)
        value = slope(time, position, width)
        return Trace(
            drive=name,
            unit="m/s",
            time=time,
            set_point=told,
            value=value,
            current=current,
            position=position,
            width=width,
        )
    scale = degrees(1.0)
    return Trace(
        drive=name,
        unit="deg",
        time=time,
        set_point=scale * told,
        value=scale * position,
        current=current,
        position=position,
    )


def response_figure(traces: Mapping[str, Sequence[Trace]]) -> Figure:
    """One column a drive, by what was tried (now, predicted, new): set-point and value, error, current over time.

    Call inside `figures.style`. All traces of a drive were asked for the same step.
    """
    from matplotlib.figure import Figure

    from artemis.report.figures import ESTIMATED, LEFT, MARGIN_BOTTOM, MARGIN_TOP, TRUE, WIDTH

    colors = {"now": ESTIMATED, "predicted": LEFT, "new": TRUE}
    labels, columns = list(traces), list(zip(*traces.values(), strict=True))
    height = MARGIN_TOP + len(PANELS) * (HEIGHT + 0.2) + MARGIN_BOTTOM
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    grid = figure.subplots(len(PANELS), len(columns), sharex="col", sharey="row", squeeze=False)
    for column, shown in enumerate(columns):
        panels: list[Axes] = list(grid[:, column])
        responses = [trace.response() for trace in shown]
        for label, trace, response in zip(labels, shown, responses, strict=True):
            _draw(panels, label, colors[label], trace, response)
        _finish(panels, shown[0], responses)
    return figure


def _draw(panels: Sequence[Axes], label: str, color: str, trace: Trace, response: StepResponse) -> None:
    from artemis.report.figures import PATH

    since = trace.time - response.begin
    shown = (since >= -BEFORE) & (since <= response.watched)
    since, told, value = since[shown], trace.set_point[shown], trace.value[shown]
    if not panels[0].lines:
        panels[0].plot(since, told, color=PATH, linewidth=4.0, alpha=0.45, label="set-point")
    panels[0].plot(since, value, color=color, label=label)
    panels[1].plot(since, told - value, color=color)
    panels[2].plot(since, trace.current[shown], color=color, linewidth=0.9)


def _finish(panels: Sequence[Axes], trace: Trace, responses: Sequence[StepResponse]) -> None:
    """Axes from shortly before the step until all is at rest."""
    from artemis.report.figures import INK

    watched, step = min(r.watched for r in responses), responses[0].step
    settled = [watched if r.settled_2 is None else r.settled_2 for r in responses]
    end = min(watched, max(1.6 * max(settled), 4.0 * responses[0].ramp))
    final = trace.set_point[int(np.argmax(np.abs(trace.set_point - trace.set_point[0])))]
    panels[0].axhspan(final - 0.05 * step, final + 0.05 * step, color=INK, alpha=0.06, linewidth=0)
    names = ("angle [°]", "error [°]") if trace.unit == "deg" else ("speed [m/s]", "error [m/s]")
    for axes, name in zip(panels, (*names, "current [A]"), strict=True):
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_xlim(-BEFORE, end)
        if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]  # all are in a grid
            axes.set_ylabel(name)
    panels[0].set_title(trace.drive)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)
    panels[-1].set_xlabel("since the set-point began to change [s]")
