"""`artemis bench transport`: the thesis' comparison of RS232 and CAN, and a tick over RS232, in simulation."""

from __future__ import annotations

import sys
from pathlib import Path

from artemis.errors import ConfigError
from artemis.report.drawing import check_figures
from artemis_lab.bench.serial_tick import serial_tick_grid, serial_ticks
from artemis_lab.bench.transport import (
    Parameters,
    answer_grid,
    answer_times,
    compared,
    comparison_grid,
    over_serial,
)


def measure(baud: int, latency: float, answer: float, output: Path | None) -> None:
    """Print the tables, and draw the figure into `output`; times in seconds.

    Raises:
        ConfigError: the figure cannot be written.
    """
    if output is not None:
        check_figures("--output")
    parameters = Parameters(baud=baud, latency_s=latency, answer_s=answer)
    rows = compared(parameters)
    sys.stdout.write(comparison_grid(rows).text() + "\n")
    sys.stdout.write(answer_grid(answer_times(parameters)).text() + "\n")
    sys.stdout.write(serial_tick_grid(serial_ticks()).text())
    if output is not None:
        from artemis.report.figures import style
        from artemis_lab.bench.transport_figure import transport_figure

        with style():
            try:
                transport_figure(over_serial(parameters), rows, parameters).savefig(output, facecolor="white", dpi=120)
            except (OSError, ValueError) as error:  # no such folder; no such format
                raise ConfigError(f"{output}: cannot be written: {error}") from None
