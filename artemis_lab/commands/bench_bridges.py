"""`artemis bench bridges`: how soon bridges to other programs are back whose processes are killed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import typer

from artemis_lab.bench.killed_bridges import kill_bridges

BACK = 2.0
"""A bridge is back after so long at the worst [s]."""
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
    typer.echo(f"load after: {os.getloadavg()[0]:.1f}")
    return all(held) and not figures.stops


def _tell(what: str, late: Sequence[float]) -> None:
    ordered = sorted(late) or [float("nan")]
    middle, tail, worst = (
        ordered[min(int(share * len(ordered)), len(ordered) - 1)] * 1e3 for share in (0.5, 0.99, 1.0)
    )
    typer.echo(f"{what} ({len(late)}): median {middle:.1f}, p99 {tail:.1f}, worst {worst:.1f} ms")
