"""`artemis bench obstacles`: what the obstacle stop has to reach, and what it does."""

from __future__ import annotations

import sys

from rich.progress import Progress

from artemis_lab.bench.obstacle_bars import PIECE, cost, legs, persons, slow_downs, standing, who_stays, workers
from artemis_lab.bench.tables import Grid

LOOKS = 2000


def measure(scenes: int, around: int, few: int, first: int, metres: float, number: int) -> int:
    """Print the table. Returns 0 when all bars are met, else 1.

    Args:
        scenes: random ones of what stands.
        around: likewise, with something behind the robot, too.
        few: scenes of persons who cross, of those who step in, of those who step aside, and of thin legs.
        first: seed of the first.
        metres: that are driven in the corridor, and in dust.
        number: of processes.
    """
    total = scenes + around + 4 * few + 2 * max(1, round(metres / PIECE))
    found = [cost(LOOKS)]  # before others need the processor
    with Progress(disable=not sys.stdout.isatty()) as progress, workers(number) as pool:
        bar = progress.add_task("drives", total=total)

        def done() -> None:
            progress.advance(bar)

        found.append(standing(pool, scenes, first, done))
        found.append(standing(pool, around, first, done, around=True))
        found.append(persons(pool, few, first, done))
        found.append(who_stays(pool, few, first, done))
        found.append(legs(pool, few, first, done))
        found += slow_downs(pool, metres, first, done)
    rows = [(it.name, it.bar, it.measured, "yes" if it.met else "NO") for it in found]
    sys.stdout.write(Grid(title="obstacle stop", head=("what", "bar", "measured", "met"), rows=rows).text())
    return 0 if all([it.met for it in found]) else 1
