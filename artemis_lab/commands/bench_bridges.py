"""`artemis bench bridges`: how soon bridges to other programs are back whose processes are killed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import typer

from artemis_lab.bench.killed_bridges import kill_bridges
from artemis_lab.bench.rosbridge_flood import flooded
from artemis_lab.bench.tables import share_of

BACK = 2.0
"""A bridge is back after so long at the worst [s]."""
LATER, CLIENTS, FLOODS = 0.001, 8, 15
"""A tick begins later by a flood at p99 [s]; clients, and floods of 2 s."""
NEEDS = {"ros1": "rosbags", "ros2": "cyclonedds", "rosbridge": "websockets", "foxglove": "foxglove"}
"""Packages of the bridges."""


def measure(robot: Path, kills: int, seed: int) -> bool:
    """Measure on this computer, and print a table; whether all is as it has to be."""
    bridges = [name for name, package in NEEDS.items() if find_spec(package) is not None]
    for name in NEEDS.keys() - bridges:
        typer.echo(f"{name}: not measured, the package {NEEDS[name]} is not installed")
    typer.echo(f"load before: {os.getloadavg()[0]:.1f}")
    figures = kill_bridges(robot, bridges, kills, seed)
    held = [len(found) >= kills and max(found) <= BACK for found in figures.back.values()]
    for (name, found), ok in zip(figures.back.items(), held, strict=True):
        words = f"back after {median(found):.2f} s in the median, {max(found):.2f} s at the worst" if found else "never"
        typer.echo(f"{name}, killed {len(found)} times: {words} (at most {BACK:g}){'' if ok else ': EXCEEDED'}")
    _tell("ticks begin late while all bridges work", figures.quiet)
    _tell("ticks begin late while one is started again", figures.restarting)
    for fault, time in figures.stops.items():
        typer.echo(f"the robot was stopped after {time:.1f} s: {fault}: EXCEEDED")
    if "rosbridge" in bridges:
        held.append(_tell_flood(robot))
    typer.echo(f"load after: {os.getloadavg()[0]:.1f}")
    return all(held) and not figures.stops


def _tell_flood(robot: Path) -> bool:
    """What a flood of rosbridge's clients costs the ticks; whether it is as it has to be."""
    ticks = flooded(robot, CLIENTS, FLOODS)
    quiet, poured = ticks.split(ticks.late)
    _tell("ticks begin late with the input rosbridge, quiet", quiet)
    later = _tell(f"the same, flooded by {CLIENTS} clients", poured) - share_of(quiet, 0.99)
    held = later <= LATER
    typer.echo(f"a tick begins later by that, p99: {later * 1e3:+.1f} ms (at most +1){'' if held else ': EXCEEDED'}")
    return held


def _tell(what: str, late: Sequence[float]) -> float:
    """Print how late; returns the 99th percentile [s]."""
    ordered = sorted(late) or [float("nan")]
    middle, tail, worst = ordered[len(ordered) // 2] * 1e3, share_of(late, 0.99) * 1e3, ordered[-1] * 1e3
    typer.echo(f"{what} ({len(late)}): median {middle:.1f}, p99 {tail:.1f}, worst {worst:.1f} ms")
    return share_of(late, 0.99)
