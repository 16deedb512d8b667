"""`artemis bench buildings`: maps of a large building in simulation, each beside the truth."""

from __future__ import annotations

import sys

from artemis.mapping import kernels
from artemis_lab.bench.buildings import OFF, MappedBuilding, mapped
from artemis_lab.bench.tables import Grid

HEAD = ("drive", "mean [m]", "most [m]", "loops", "wrong", "open", "processor [s]")


def measure(number: int, first: int, laps: int) -> int:
    """Make the maps, one line each as soon as it is there; 1: a loop is wrong, or a place was left open.

    Args:
        number: of drives.
        first: seed of the first one.
        laps: of 850 m in each drive.
    """
    if not kernels.COMPILED:
        sys.stderr.write(f"{kernels.notice()}\n")
    rows, good = [], True
    for seed in range(first, first + number):
        made = mapped(seed, laps)
        rows.append(row(seed, made))
        good = good and sound(made)
        sys.stderr.write(f"{'  '.join(rows[-1])}\n")
    title = f"a building of 72 m by 36 m, {850 * laps} m driven; wrong, open: off by more than {OFF:g} m"
    sys.stdout.write(Grid(title=title, head=HEAD, rows=rows).text())
    return 0 if good else 1


def sound(made: MappedBuilding) -> bool:
    """Whether all places that were visited again are one place on the map, and no loop is wrong."""
    return made.wrong == 0 and float(made.revisits.max()) < OFF


def row(seed: int, made: MappedBuilding) -> tuple[str, ...]:
    """Of the table: error of the key scans, loops, those that are wrong, share of the revisits that are left open."""
    left_open = float((made.revisits >= OFF).mean())
    return (
        str(seed),
        f"{made.distances.mean():.3f}",
        f"{made.distances.max():.3f}",
        str(len(made.mapper.graph.loops)),
        str(made.wrong),
        f"{100 * left_open:.1f} %",
        f"{made.seconds:.1f}",
    )
