"""Tests the tests: `python -m tests.mutation [--module motion/limits.py]...` for some modules, without: for all.

Fails if a mutant survives that is not in `survivors.toml`, if a survivor there is none any more, or if there are more
than 2 % of them.
"""

from __future__ import annotations

import argparse
import os
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from artemis.clock import stopwatch

from .core import CORE
from .mutants import Mutant
from .running import ROOT, Outcome, Subject, examine

MOST_SURVIVORS = 0.02
"""Of all mutants."""
SURVIVORS = Path(__file__).parent / "survivors.toml"
_PROGRESS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Survivor:
    """A mutant that no test can or need kill."""

    module: str
    where: str
    change: str
    reason: str


def main() -> int:
    """Print a table; 1 if anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description="Tests the tests of the safety core.")
    parser.add_argument("--module", action="append", choices=CORE, help="only this module of artemis (repeatable)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    chosen = {module: subject for module, subject in subjects().items() if module in (options.module or CORE)}
    return judge(chosen, listed(SURVIVORS), options.workers)


def subjects() -> dict[str, Subject]:
    """The modules of the safety core with their tests."""
    return {
        module: Subject(
            name="artemis." + module.removesuffix(".py").removesuffix("/__init__").replace("/", "."),
            path=ROOT / "artemis" / module,
            tests=[ROOT / "tests" / test for test in tests],
        )
        for module, tests in CORE.items()
    }


def listed(path: Path) -> list[Survivor]:
    """The survivors that have a reason."""
    return [Survivor(**entry) for entry in tomllib.loads(path.read_text(encoding="utf-8")).get("survivor", [])]


def judge(examined: Mapping[str, Subject], known: Sequence[Survivor], workers: int) -> int:
    """Examine modules and print what was found; 1 if a survivor is new or gone, or if there are too many."""
    reasons = {(each.module, each.where, each.change): each.reason for each in known if each.module in examined}
    gone = set(reasons)
    new = 0
    rows: list[tuple[str, Counter[Outcome], float]] = []
    for module, subject in examined.items():
        begun = stopwatch()
        counts: Counter[Outcome] = Counter()
        for mutant, outcome in examine(subject, workers):
            counts[outcome] += 1
            key = (module, mutant.where, mutant.change)
            if outcome is Outcome.SURVIVED:
                gone.discard(key)
                new += key not in reasons
                print(_told(module, mutant, reasons.get(key)), flush=True)
            elif counts.total() % _PROGRESS == 0:
                print(f"{module}: {counts.total()} mutants so far", flush=True)
        rows.append((module, counts, stopwatch() - begun))
    print("\n" + _table(rows))
    survived, count = (sum(number(counts) for _, counts, _ in rows) for number in (_survived, _count))
    problems = [f"gone, take it out of the list: {module}, {where}: {change}" for module, where, change in sorted(gone)]
    problems += [f"{new} survivors are not in the list"] if new else []
    problems += [f"{survived} of {count} survived"] if survived > MOST_SURVIVORS * count else []
    print("\n".join(["", *problems] if problems else ["", "every survivor is known"]))
    return 1 if problems else 0


def _told(module: str, mutant: Mutant, reason: str | None) -> str:
    place = f"{module}:{mutant.line}: {mutant.where}: {mutant.change}"
    return f"survived: {place}" if reason is None else f"known:    {place}: {reason}"


def _survived(counts: Counter[Outcome]) -> int:
    return counts[Outcome.SURVIVED]


def _count(counts: Counter[Outcome]) -> int:
    return counts.total() - counts[Outcome.STILLBORN]


def _table(rows: Sequence[tuple[str, Counter[Outcome], float]]) -> str:
    """One line a module. Stillborn mutants are not counted."""
    lines = [f"{'module':<30} {'mutants':>8} {'killed':>8} {'timed out':>10} {'survived':>9} {'s':>6}"]
    for module, counts, seconds in rows:
        killed, late = counts[Outcome.KILLED], counts[Outcome.TIMED_OUT]
        lines.append(f"{module:<30} {_count(counts):>8} {killed:>8} {late:>10} {_survived(counts):>9} {seconds:>6.0f}")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
