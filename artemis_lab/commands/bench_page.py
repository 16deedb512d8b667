"""`artemis bench page`: the figures of the page for operators, against what they have to be."""

from __future__ import annotations

from pathlib import Path

import typer

from artemis_lab.bench.page_link import Late, measure_losses, measure_page
from artemis_lab.bench.tables import share_of

STOP, LOSS, PAINT, SIZE, LATER, SHARE = 25.0, 350.0, 1.0, 300, 1.0, 3.0
"""Stop to frame at p95 [ms], a loss to the first lower set-point [ms], first paint [s], all files [kB], a tick later by
a flood or a page that is lost [ms], and the share of a processor for each browser [%]."""


def measure(robot: Path, presses: int, seconds: float, losses: int) -> bool:
    """Measure on this computer, and print a table; whether all is as it has to be."""
    found = measure_page(robot, presses, seconds)
    alone, client = (100 * share for share in found.shares)
    typer.echo("| | measured | at most |\n|---|---|---|")
    held = [
        _row(
            f"Stop to the quick stop's frames, p95 of {len(found.quiet)}", share_of(found.quiet, 0.95) * 1e3, STOP, "ms"
        ),
        _row(
            f"the same while a report is made, p95 of {len(found.reporting)}",
            share_of(found.reporting, 0.95) * 1e3,
            STOP,
            "ms",
        ),
        _row("the page with all that it loads", found.size / 1e3, SIZE, "kB"),
        *([] if found.paint is None else [_row("first paint, nothing of it known before", found.paint, PAINT, "s")]),
        *_later("a flood of 10,000 messages/s", found.late),
        _row("processor for each browser that watches", client, SHARE, "%"),
    ]
    if losses:
        lost = measure_losses(robot, losses)
        for loss, after in lost.after.items():
            held.append(_row(f"{loss}: the first lower set-point, worst of {len(after)}", max(after) * 1e3, LOSS, "ms"))
        held += _later("a page that is frozen or killed", lost.late)
    typer.echo(f"\nThe page's process by itself takes {alone:.1f} % of a processor.")
    if found.paint is None:
        typer.echo("First paint was not measured, there is no browser: scripts/browser installs it.")
    return all(held)


def _later(by: str, late: Late) -> list[bool]:
    quiet, troubled = late
    return [
        _row(
            f"a tick begins later by {by}, {name} of {len(troubled)}",
            (share_of(troubled, share) - share_of(quiet, share)) * 1e3,
            LATER,
            "ms",
        )
        for name, share in (("p50", 0.5), ("p99", 0.99))
    ]


def _row(name: str, value: float, most: float, unit: str) -> bool:
    held = value <= most
    typer.echo(f"| {name} | {value:.1f} {unit}{'' if held else ' EXCEEDED'} | {most:g} {unit} |")
    return held
