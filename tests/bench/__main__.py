"""Prints the table of all budgets, or of some, and writes it into the documentation: one for each build.

Never fails: a number that is over its budget is a fact, not an error.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from artemis.build import described, kind_of_build
from artemis.clock import stopwatch

from . import campaigns, latency, observing, starting, ticks, trees, wire
from .measure import table, written

MODULES = (ticks, trees, observing, wire, latency, starting, campaigns)
PARTS = {module.__name__.rpartition(".")[2]: module for module in MODULES}
PAGE = Path(__file__).parents[2] / "docs" / "benchmarks.md"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"measure these only: {', '.join(PARTS)}")
    parser.add_argument("--write", action="store_true", help=f"write the table into {PAGE.name}, too")
    words = parser.parse_args()
    if unknown := [name for name in words.parts if name not in PARTS]:
        parser.error(f"{unknown[0]}: expected one of {', '.join(PARTS)}")
    if words.write and words.parts:
        parser.error("--write: the table in the documentation has all parts")
    begun = stopwatch()
    rows = [row for name in words.parts or PARTS for row in PARTS[name].rows()]
    verdicts = [row.held for row in rows if row.held is not None]
    told = f"{described()}, {os.cpu_count()} processors\n\n{table(rows)}\n\n"
    told += f"{verdicts.count(False)} of {len(verdicts)} budgets exceeded"
    print(f"{told}; measured in {stopwatch() - begun:.0f} s")
    if words.write:
        PAGE.write_text(written(PAGE.read_text(), kind_of_build(), told))


if __name__ == "__main__":
    main()
