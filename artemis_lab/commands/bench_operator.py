"""`artemis bench operator`: the figures of a link to a far operator, against what they have to be."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

import typer

from artemis.errors import ArtemisError
from artemis_lab.bench.operator_link import PERIOD, Ticks, cuts, drive
from artemis_lab.bench.tables import share_of

CUT, REPORT, LATER = 0.3, PERIOD + 0.005, 0.001
"""Link cut to stop at the worst, report to frame at p99, a tick later by a flood [s]."""
MEAN_REPORT = 0.275
"""Between two reports of the hand, in the mean [s]."""
TRIES = 3
"""A run that a busy computer stops is begun again so often."""


def measure(robot: Path, reports: int, seconds: float, runs: int, times: int, seed: int) -> bool:
    """Measure on this computer, and print a table; whether all is as it has to be.

    Args:
        robot: its file.
        reports: of the operator's device, at least.
        seconds: that each run with floods takes, half of them flooded.
        runs: with floods, in a process and in a thread each.
        times: the link is cut.
        seed: of the times of the reports.
    """
    typer.echo(f"load before: {os.getloadavg()[0]:.1f}")
    found = cuts(robot, times)
    held = [
        _row(f"link cut to the tick that stops ({times} cuts)", found, max(found), f"worst at most {CUT * 1e3:g}", CUT)
    ]
    ticks = _driven(lambda: drive(robot, reports * MEAN_REPORT, seed, flood=False))
    latencies = [] if ticks is None else ticks.latencies()
    raw, on_time = [each for each, _ in latencies], [each - late for each, late in latencies]
    budget = f"p99 at most {REPORT * 1e3:g}"
    name = f"report to set-point frame over loopback ({len(raw)} reports)"
    held.append(_row(name, raw, share_of(raw, 0.99), budget, REPORT))
    _row("the same, less what the tick itself was late", on_time, share_of(on_time, 0.99), budget, REPORT)
    for thread in (False, True):
        differences = _flooded(robot, seconds, seed, runs, thread=thread)
        if not thread:
            held.append(bool(differences) and median(differences) <= LATER)
        if not thread and differences:
            spread = f"{min(differences) * 1e3:+.1f} to {max(differences) * 1e3:+.1f}"
            words = f"median {median(differences) * 1e3:+.1f}, {spread} ms in {len(differences)} runs"
            typer.echo(f"a tick begins later by a flood of 10,000 frames/s, p99: {words} (at most +1){_mark(held[-1])}")
    typer.echo(f"load after: {os.getloadavg()[0]:.1f}")
    return all(held)


def _flooded(robot: Path, seconds: float, seed: int, runs: int, *, thread: bool) -> list[float]:
    """Runs with floods: by how much later ticks begin in one, at p99 [s]."""
    where, differences = "thread" if thread else "process", []
    late: tuple[list[float], list[float]] = [], []
    cpu: tuple[list[float], list[float]] = [], []
    for run in range(runs):
        ticks = _driven(lambda: drive(robot, seconds, seed + run, flood=True, thread=thread))  # noqa: B023 (called here)
        if ticks is None:
            continue
        quiet, flooded = ticks.split(ticks.late)
        differences.append(share_of(flooded, 0.99) - share_of(quiet, 0.99))
        for of_all, of_run in ((late, (quiet, flooded)), (cpu, ticks.split(ticks.cpu_per_tick))):
            for place, values in zip(of_all, of_run, strict=True):
                place += values
    for name, found in zip(("quiet", "flooded"), late, strict=True):
        _row(f"tick late, link in a {where}, {name} ({len(found)} ticks)", found, 0.0, "", 0.0)
    if differences:
        told = ", ".join(f"{each * 1e3:+.1f}" for each in differences)
        ratio = share_of(cpu[1], 0.5) / max(share_of(cpu[0], 0.5), 1e-9)
        typer.echo(f"p99 flooded less p99 quiet, link in a {where}, run by run: {told} ms")
        typer.echo(f"processor time of a tick, link in a {where}: flooded / quiet = {ratio:.2f} (medians)")
    return differences


def _driven(run: Callable[[], Ticks]) -> Ticks | None:
    """A run to its end; None: the computer is too busy for real time, again and again."""
    for _ in range(TRIES):
        try:
            return run()
        except ArtemisError as error:
            typer.echo(f"too busy for real time: {error}")
    return None


def _row(name: str, found: Sequence[float], value: float, budget: str, limit: float) -> bool:
    """Print one; whether the `value` is within its `limit` [s]."""
    middle, tail, worst = (share_of(found, share) * 1e3 for share in (0.5, 0.99, 1.0))
    held = value <= limit
    words = f"median {middle:.1f}, p99 {tail:.1f}, worst {worst:.1f} ms"
    typer.echo(f"{name}: {words}" + (f" ({budget}){_mark(held)}" if budget else ""))
    return held


def _mark(held: bool) -> str:
    return "" if held else ": EXCEEDED"
