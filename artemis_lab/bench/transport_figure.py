"""Figure of the comparison of RS232 and CAN: where the time of one command goes, and what that makes of the whole."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from artemis.report.figures import ESTIMATED, INK, PATH, TRUE, WIDTH
from artemis.sim.serial_wire import BITS
from artemis_lab.bench.transport import Measured, Parameters, TransportTimes

COMMAND = 5
"""Shown is the fifth command: the first to another drive than the one on the line, through its gateway."""


def transport_figure(run: Measured, rows: Sequence[TransportTimes], parameters: Parameters) -> Figure:
    """One command over RS232 as it happens; the durations of all rows. Call inside `style`."""
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_command(left, run, parameters)
    places = range(len(rows))
    right.barh([place - 0.2 for place in places], [1e3 * row.serial for row in rows], 0.36, color=TRUE, label="RS232")
    right.barh([place + 0.2 for place in places], [1e3 * row.can for row in rows], 0.36, color=ESTIMATED, label="CAN")
    for place, row in enumerate(rows):
        thesis = f" (thesis 1:{row.thesis:g})" if row.thesis is not None else ""
        right.text(1e3 * row.serial, place - 0.2, f" 1:{row.ratio:.3g}{thesis}", va="center", fontsize=8)
    right.set_yticks(list(places), [row.short for row in rows])
    right.invert_yaxis()
    right.set(xscale="log", xlim=(1.0, 3e4), xlabel="time for all 32 messages [ms]", title="every cause in its turn")
    right.legend(loc="upper right", fontsize=8)
    return figure


def _draw_command(axes: Axes, run: Measured, parameters: Parameters) -> None:
    """Bytes of one command on the wire, and when the computer was handed the drive's."""
    byte = BITS / parameters.baud
    given = [index for index, it in enumerate(run.passages) if it.to_drive and it.count == 1 and _begins(run, index)]
    begin, end = given[COMMAND - 1], given[COMMAND]
    start = run.passages[begin].time - byte
    for passage in run.passages[begin:end]:
        at = 1e3 * (passage.time - start)
        if passage.to_drive:
            duration = 1e3 * passage.count * byte
            axes.barh(1.0, duration, 0.3, left=at - duration, color=TRUE, edgecolor=TRUE)
            axes.annotate(f"{passage.count} B", (at, 1.2), ha="center", fontsize=8)
        else:
            axes.plot([at, at], [-0.25, 0.25], color=ESTIMATED, linewidth=2.0)
            axes.annotate(f"{passage.count} B", (at, 0.3), ha="center", fontsize=8)
    handed = [1e3 * (it.time - start) for it in run.passages[begin:end] if not it.to_drive]
    for previous, now in zip([0.0, *handed], handed, strict=False):
        axes.annotate("", (now, -0.45), (previous, -0.45), arrowprops={"arrowstyle": "<->", "color": PATH})
        axes.text((previous + now) / 2, -0.62, f"{now - previous:.0f} ms", ha="center", va="top", fontsize=8, color=INK)
    axes.set_yticks([1.0, 0.0], ["computer to drive", "handed to the\ncomputer"])
    axes.set(xlabel="time [ms]", ylim=(-1.0, 1.6), title="one command over RS232: the adapter's timer")


def _begins(run: Measured, index: int) -> bool:
    """Whether this byte is an operation code: the frame follows once it is confirmed."""
    after = [it for it in run.passages[index + 1 : index + 3] if it.to_drive]
    return bool(after) and after[0].count > 1
