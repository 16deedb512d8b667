"""`artemis bench page`: the figures of the page for operators, against what they have to be."""

from __future__ import annotations

from pathlib import Path

import typer

from artemis_lab.bench.page_link import measure_page

STOP, PAINT, SIZE, LATER = 25.0, 1.0, 300, 1.0
"""Stop to frame at p95 [ms], first paint [s], all files [kB], a tick later by a flood [ms]."""


def measure(robot: Path, presses: int, seconds: float) -> bool:
    """Measure on this computer, and print a table; whether all is as it has to be."""
    found = measure_page(robot, presses, seconds)
    quiet, flooded = found.late
    held = [
        _row("Stop to the quick stop's frames, p95", _share(found.quiet, 0.95) * 1e3, STOP, "ms"),
        _row("the same while a report is made, p95", _share(found.reporting, 0.95) * 1e3, STOP, "ms"),
        _row("the page with all that it loads", found.size / 1e3, SIZE, "kB"),
    ]
    for name, share in (("p50", 0.5), ("p99", 0.99)):
        more = (_share(flooded, share) - _share(quiet, share)) * 1e3
        held.append(_row(f"a tick begins later by a flood of 10,000 messages/s, {name}", more, LATER, "ms"))
    if found.paint is None:
        typer.echo("first paint: not measured, there is no browser: scripts/browser installs it")
    else:
        held.append(_row("first paint", found.paint, PAINT, "s"))
    typer.echo(f"{len(found.quiet)} and {len(found.reporting)} presses, {len(flooded)} ticks in the flood")
    return all(held)


def _row(name: str, value: float, most: float, unit: str) -> bool:
    held = value <= most
    typer.echo(f"{name}: {value:.1f} {unit} (at most {most:g}){'' if held else ': EXCEEDED'}")
    return held


def _share(found: list[float], share: float) -> float:
    """NaN, and so not held, where nothing was found."""
    return sorted(found)[min(int(share * len(found)), len(found) - 1)] if found else float("nan")
