"""`artemis bench slam --bars`: what is promised of mapping and localisation on a public log, in one table."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from artemis.mapping import kernels
from artemis_lab.commands.bench_localisation import RIGHT, localised
from artemis_lab.commands.bench_slam import LogDrive, mapped

_SPLIT = 1085.0
"""[s]; the map is made of what was seen after it."""
_DRIVES = (
    ("backwards", LogDrive(backwards=True), 0.0165),
    ("odometry x 0.8, turning 10 deg/m", LogDrive(scale=0.8, turn_deg_m=10), 0.018),
    ("without odometry", LogDrive(odometry=False), 0.017),
    *(
        (f"the same, 1 cm noise, seed {seed}", LogDrive(odometry=False, noise=0.01, seed=seed), 0.017)
        for seed in (1, 2)
    ),
)
_WITHIN = 20.0
"""A robot that knows nothing is found within so many seconds, its searches included."""


def measure(log: Path, relations: Path) -> int:
    """Measure all of it, and print each figure beside its bar as soon as it is known; 1: a bar was missed.

    Raises:
        ConfigError: a file cannot be read.
    """
    missed = 0
    sys.stdout.write(f"{'':<52} {'measured':>9} {'bar':>14}\n")
    rows = chain(_of_mapping(log, relations), _of_localisation(log, relations), _without_numba(log, relations))
    for name, value, least, most in rows:
        good = least <= value <= most
        missed += not good
        bar = f"<= {most:g}" if least == -np.inf else f">= {least:g}" if most == np.inf else f"{least:g} to {most:g}"
        sys.stdout.write(f"{name:<52} {value:>9.4g} {bar:>14} {'' if good else ' MISSED'}\n")
        sys.stdout.flush()
    return 1 if missed else 0


_Row = tuple[str, float, float, float]


def _of_mapping(log: Path, relations: Path) -> Iterator[_Row]:
    plain = mapped(log, relations, LogDrive())
    yield "mapping: relations [m]", float(plain.metres.mean()), -np.inf, 0.0157
    yield "mapping: relations [deg]", float(plain.degrees.mean()), -np.inf, 0.425
    yield "mapping: processor time [s]", plain.seconds, -np.inf, 8.0
    for name, drive, bar in _DRIVES:
        yield f"mapping, {name} [m]", float(mapped(log, relations, drive).metres.mean()), -np.inf, bar


def _of_localisation(log: Path, relations: Path) -> Iterator[_Row]:
    for cells in (False, True):
        found, on = localised(log, relations, _SPLIT, cells=cells), "cells" if cells else "scans"
        right = [each for each in found.found if each.after is not None and each.after <= _WITHIN and each.off < RIGHT]
        yield f"on a map of {on}: lost scans", found.lost, -np.inf, 0
        yield f"on a map of {on}: relations [m]", float(found.metres.mean()), -np.inf, 0.0224
        yield f"on a map of {on}: relations [deg]", float(found.degrees.mean()), -np.inf, 0.32
        yield f"on a map of {on}: distance, mean [m]", float(found.away.mean()), -np.inf, 0.035
        yield f"on a map of {on}: distance, 95 % [m]", float(np.quantile(found.away, 0.95)), -np.inf, 0.08
        yield f"on a map of {on}: distance, largest [m]", float(found.away.max()), -np.inf, 0.25
        yield f"on a map of {on}: within the ellipse for 95 % [%]", 100 * found.inside, 90, 99
        yield f"on a map of {on}: one scan, 99 % [ms]", float(np.quantile(found.milliseconds, 0.99)), -np.inf, 10
        yield f"on a map of {on}: starts found within {_WITHIN:g} s", len(right), len(found.found), np.inf


def _without_numba(log: Path, relations: Path) -> Iterator[_Row]:
    kernels.use_numpy()
    plain = mapped(log, relations, LogDrive())
    yield "mapping without numba: relations [m]", float(plain.metres.mean()), -np.inf, 0.0157
    yield "mapping without numba: processor time [s]", plain.seconds, -np.inf, 60
