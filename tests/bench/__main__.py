"""Prints the table of all budgets. Never fails: a number that is over its budget is a fact, not an error."""

from __future__ import annotations

from artemis.clock import stopwatch

from . import latency, starting, ticks, wire
from .measure import table


def main() -> None:
    begun = stopwatch()
    rows = [row for part in (ticks, wire, latency, starting) for row in part.rows()]
    print(table(rows))
    verdicts = [row.held for row in rows if row.held is not None]
    print(f"\n{verdicts.count(False)} of {len(verdicts)} budgets exceeded; measured in {stopwatch() - begun:.0f} s")


if __name__ == "__main__":
    main()
