"""`artemis bench operator`: the figures of a link to a far operator, against themselves."""

from __future__ import annotations

from pathlib import Path

import typer

from artemis.errors import ArtemisError
from artemis_lab.bench.operator_link import PERIOD, Ticks, cuts, drive

TRIES = 3
"""A run that a busy computer stops is begun again so often."""


def measure(robot: Path, seconds: float, seed: int, times: int) -> None:
    """Measure on this computer, and print a table."""
    found = sorted(cuts(robot, times))
    typer.echo(_row(f"link cut to the tick that stops ({times} cuts)", found, 1e3, "ms", "at most 300"))
    for thread in (False, True):
        where = "thread" if thread else "process"
        if (ticks := _driven(robot, seconds, seed, thread=thread)) is None:
            continue
        if not thread:
            _tell_latencies(ticks)
        quiet, flooded = map(sorted, ticks.split(ticks.late))
        typer.echo(_row(f"tick late, link in a {where}, quiet", quiet, 1e3, "ms", ""))
        typer.echo(_row(f"tick late, link in a {where}, flood of 10,000 frames/s", flooded, 1e3, "ms", "+1 at most"))
        idle, busy = map(sorted, ticks.split(ticks.cpu_per_tick))
        ratio = _share(busy, 0.5) / max(_share(idle, 0.5), 1e-9)
        typer.echo(f"processor time of a tick, link in a {where}: flood / quiet = {ratio:.2f} (medians)")


def _driven(robot: Path, seconds: float, seed: int, *, thread: bool) -> Ticks | None:
    """A run to its end; None: the computer is too busy for real time, again and again."""
    for _ in range(TRIES):
        try:
            return drive(robot, seconds, seed, flood=True, thread=thread)
        except ArtemisError as error:
            typer.echo(f"too busy for real time: {error}")
    return None


def _tell_latencies(ticks: Ticks) -> None:
    found = sorted(ticks.latencies())
    budget = f"p99 at most {PERIOD * 1e3 + 5:.0f}"
    typer.echo(
        _row(f"report to set-point frame over loopback, ticks on time ({len(found)} reports)", found, 1e3, "ms", budget)
    )


def _row(name: str, found: list[float], scale: float, unit: str, budget: str) -> str:
    middle, tail, worst = (_share(found, share) * scale for share in (0.5, 0.99, 1.0))
    numbers = f"median {middle:.1f}, p99 {tail:.1f}, worst {worst:.1f} {unit}"
    return f"{name}: {numbers}" + (f" ({budget})" if budget else "")


def _share(found: list[float], share: float) -> float:
    return found[min(int(share * len(found)), len(found) - 1)] if found else float("nan")
