"""`artemis bench goto`: random goals on three kinds of map, driven to the end in simulation; one table with bars."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence

import numpy as np
from rich.progress import Progress

from artemis.route_planning import kernels
from artemis.route_planning.floor import MARGIN
from artemis.route_planning.planner import END_ANGLE, END_DISTANCE
from artemis_lab.bench.floor_plans import MAPS
from artemis_lab.bench.goals import GoalDrive, run_all
from artemis_lab.bench.tables import Grid

MEDIAN_MS, MOST_MS = 50, 200
"""What a plan may take, half of them and the slowest: processor time."""


def measure(goals: int, seed: int, workers: int, *, blind: bool) -> bool:
    """Drive to the goals, print the table and what went wrong; returns whether all bars hold."""
    if not kernels.COMPILED:
        sys.stderr.write(f"{kernels.notice()}\n")
    legs: list[GoalDrive] = []
    with Progress(disable=not sys.stdout.isatty()) as progress:
        bar = progress.add_task("goals", total=goals)

        def finished(chain: Sequence[GoalDrive]) -> None:
            legs.extend(chain)
            progress.advance(bar, len(_open(chain)))

        run_all(goals, seed, workers, finished, blind=blind)
    legs.sort(key=lambda leg: (leg.map, leg.seed, leg.number))
    table, wrong = grid(legs), [words(leg) for leg in legs if problem(leg)]
    sys.stdout.write("\n".join([table.text(), *wrong, ""]))
    slow = _milliseconds([leg for leg in legs if not leg.closed])
    return not wrong and float(np.median(slow)) <= MEDIAN_MS and max(slow) <= MOST_MS


def problem(leg: GoalDrive) -> str:
    """Why a goal does not count as reached, or an unreachable one not as reported at once; empty: it does."""
    if min(leg.nearest, leg.room) <= 0.0:
        return "contact"
    if leg.closed:
        return "" if leg.ended != "done" and not any(leg.expanded) else "not reported at once"
    if leg.ended != "done":
        return leg.ended
    if leg.room < MARGIN:
        return f"a route leads {100 * leg.room:.1f} cm from an obstacle"
    far = leg.off > END_DISTANCE or leg.turned > END_ANGLE
    return f"{100 * leg.off:.1f} cm and {math.degrees(leg.turned):.1f} degrees off" if far else ""


def words(leg: GoalDrive) -> str:
    """What went wrong with a goal, and which one it was."""
    return f"{leg.map} {leg.seed}, goal {leg.number}: {problem(leg)}; plans: {'; '.join(leg.plans)}"


def grid(legs: Sequence[GoalDrive]) -> Grid:
    """All figures, by map."""
    columns = [[leg for leg in legs if leg.map == name] for name in MAPS] + [list(legs)]
    rows = [[name, *map(figure, columns), bar] for name, bar, figure in _FIGURES]
    return Grid(title="Random goals, driven in simulation", head=["", *MAPS, "all", "bar"], rows=rows)


def _open(legs: Sequence[GoalDrive]) -> list[GoalDrive]:
    return [leg for leg in legs if not leg.closed]


def _reached(legs: Sequence[GoalDrive]) -> list[GoalDrive]:
    return [leg for leg in _open(legs) if leg.ended == "done"]


def _milliseconds(legs: Sequence[GoalDrive]) -> list[float]:
    """Of plans that found a route; not of looks whether the present one is free."""
    plans = [plan for leg in legs if leg.ended == "done" for plan in zip(leg.seconds, leg.expanded, strict=True)]
    return [1e3 * seconds for seconds, expanded in plans if expanded] or [math.nan]


def _at_once(legs: Sequence[GoalDrive]) -> str:
    closed = [leg for leg in legs if leg.closed]
    return f"{sum(not problem(leg) for leg in closed)} of {len(closed)}"


def _most(legs: Sequence[GoalDrive], of: Callable[[GoalDrive], float]) -> str:
    return f"{max(map(of, _reached(legs)), default=math.nan):.1f}"


def _least(legs: Sequence[GoalDrive], of: Callable[[GoalDrive], float]) -> str:
    return f"{min(map(of, legs), default=math.nan):.1f}"


_FIGURES: list[tuple[str, str, Callable[[Sequence[GoalDrive]], str]]] = [
    ("goals", "", lambda legs: str(len(_open(legs)))),
    ("reached", "all", lambda legs: str(len(_reached(legs)))),
    ("contacts", "0", lambda legs: str(sum(leg.nearest <= 0.0 for leg in legs))),
    ("nearest to an obstacle, driven [cm]", "> 0", lambda legs: _least(legs, lambda leg: 100 * leg.nearest)),
    ("nearest, planned [cm]", f">= {100 * MARGIN:.0f}", lambda legs: _least(legs, lambda leg: 100 * leg.room)),
    ("off the goal, most [cm]", f"<= {100 * END_DISTANCE:.0f}", lambda legs: _most(legs, lambda leg: 100 * leg.off)),
    ("off the goal, most [deg]", f"<= {math.degrees(END_ANGLE):.0f}",
     lambda legs: _most(legs, lambda leg: math.degrees(leg.turned))),
    ("plan, half of them [ms CPU]", f"<= {MEDIAN_MS}", lambda legs: f"{np.median(_milliseconds(_open(legs))):.0f}"),
    ("plan, the slowest [ms CPU]", f"<= {MOST_MS}", lambda legs: f"{max(_milliseconds(_open(legs))):.0f}"),
    ("unreachable, reported at once", "all", _at_once),
]  # fmt: skip
"""Name, bar, and what it is of some legs."""
