"""`python -m tests.host_death --cases 200 --seed 1`: plays the cases, and says what they have shown."""

from __future__ import annotations

import argparse
import sys

from artemis import clock

from .cases import WAYS, Outcome, draw, play


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=4, help="so many at a time")
    words = parser.parse_args()
    begun = clock.stopwatch()
    outcomes = []
    for outcome in play(draw(words.cases, words.seed), words.jobs):
        show(outcome)
        outcomes.append(outcome)
    for way in WAYS:
        summarise(way, [outcome for outcome in outcomes if outcome.case.way == way and outcome.trips])
    failed = sum(bool(outcome.problems) for outcome in outcomes)
    undecided = sum(outcome.undecided for outcome in outcomes)
    replaced = sum(len(outcome.replaced) for outcome in outcomes)
    print(
        f"{len(outcomes)} cases in {clock.stopwatch() - begun:.0f} s: {failed} failed, {undecided} undecided; "
        f"{replaced} hosts stopped by themselves before and were replaced"
    )
    return 1 if failed or undecided else 0


def summarise(way: str, outcomes: list[Outcome]) -> None:
    silences = [trip.latency * 1000 for outcome in outcomes for trip in outcome.trips]
    if silences:
        print(
            f"{way:11} {len(outcomes):3} hosts: quick stops {min(silences):.3f} to {max(silences):.3f} ms after the "
            f"last heartbeat, on the bus after {max(o.reported for o in outcomes) * 1000:.0f} ms at most; "
            f"motors at rest {max(o.behind for o in outcomes) * 1000:.0f} ms behind their ramp at most"
        )


def show(outcome: Outcome) -> None:
    print(f"{outcome.case}: {'FAILED' if outcome.problems else 'undecided' if outcome.undecided else 'ok'}", flush=True)
    for line in (*outcome.problems, *(f"replaced: {reason}" for reason in outcome.replaced)):
        print(f"    {line}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
