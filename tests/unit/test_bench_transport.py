"""The comparison of RS232 and CAN, beside the thesis' numbers and a calculation by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from artemis.report.figures import style
from artemis_lab.bench.serial_tick import SLOWEST, serial_tick_grid, serial_ticks
from artemis_lab.bench.transport import (
    MESSAGES,
    THESIS_RATIO,
    THESIS_WIRE,
    Parameters,
    compared,
    comparison_grid,
    over_can,
    over_serial,
)
from artemis_lab.bench.transport_figure import transport_figure

USUAL = Parameters()


def test_wire_is_as_calculated() -> None:
    """16 commands of 24 bytes of 10 bits; 32 frames of 121 to 123 bits, and their pauses."""
    assert MESSAGES == 32
    assert over_serial(USUAL).wire == pytest.approx(16 * 24 * 10 / 115200)
    assert over_can(USUAL).wire == pytest.approx(0.00393, abs=1e-6)


def test_ratios_are_those_of_the_thesis() -> None:
    wire, *_, whole = compared(USUAL)
    assert wire.ratio == pytest.approx(THESIS_WIRE, rel=0.01)
    assert whole.ratio == pytest.approx(THESIS_RATIO, rel=0.15)


def test_adapter_alone_makes_the_time() -> None:
    """Three times its timer for each of 16 commands, less what the first saves; the drives' time hides behind it."""
    total = over_serial(USUAL).total
    assert 47 * 0.016 < total <= 48 * 0.016
    assert over_serial(replace(USUAL, answer_s=0.001)).total == pytest.approx(total)
    assert over_serial(replace(USUAL, latency_s=0.001)).total < 0.1 * total


def test_every_cause_adds_time() -> None:
    times = [row.serial for row in compared(USUAL)]
    assert times == sorted(times)
    assert "1:138" in comparison_grid(compared(USUAL)).text()


def test_table_of_ticks_over_a_line_is_the_one_of_the_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "serial.md").read_text()
    table = page.partition("checked by a test -->\n")[2].partition("<!-- end of ticks -->")[0]
    assert table == "\n".join(serial_tick_grid(serial_ticks()).markdown().splitlines()[2:]) + "\n"


def test_ticks_of_two_drives_fit_the_slowest_tick_only_without_adapter_and_hand_shake() -> None:
    """24 bytes a command of 10 bits; 7 of a driven wheel, 8 of a steered one with its two potentiometers."""
    ticks = {(tick.family, tick.drives, tick.baud): tick for tick in serial_ticks()}
    first = ticks["EPOS", 2, 115200]
    assert first.commands == 7 + 8
    assert first.wire == pytest.approx(15 * 240 / 115200)
    assert ticks["EPOS", 4, 115200].wire == pytest.approx(30 * 240 / 115200)
    assert SLOWEST < min(first.totals)
    assert ticks["EPOS4", 2, 115200].totals[0] < SLOWEST < ticks["EPOS4", 2, 115200].totals[1]
    assert ticks["EPOS4", 4, 1_000_000].totals[1] < SLOWEST


def test_figure_is_drawn(tmp_path: Path) -> None:
    for parameters in (USUAL, replace(USUAL, latency_s=0.0, baud=38400)):
        with style():
            transport_figure(over_serial(parameters), compared(parameters), parameters).savefig(tmp_path / "figure.png")
