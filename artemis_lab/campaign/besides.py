"""What some scenarios have besides: a spare input, a run that waits for an arm, acknowledgments nobody asked for.

With dice of its own: the other seeds are what they were.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

SPARE_INPUT = "spare"
"""Its name: nobody drives with it."""
SPARE, WAITS, ANYWHERE = 0.3, 0.06, 0.1
"""Shares: of the missions by hand, of all that are disturbed, and of those."""


def besides(seed: int, mission: dict[str, Any], files: dict[str, str], length: float) -> None:
    """Add to a mission, and to the files that it names, what its seed has; `length` of its run [s]."""
    dice, simulation = random.Random(f"besides {seed}"), mission["simulation"]
    if (teleop := next(_by_hand(mission["steps"]), None)) is not None and dice.random() < SPARE:
        teleop["inputs"] = [teleop.pop("input"), SPARE_INPUT]
        mission["inputs"][SPARE_INPUT] = {"plugin": "scripted", "file": "spare.csv"}
        files["spare.csv"] = f"time_s,x,y,enable\n0,0,0,0\n{length + 60.0:.1f},0,0,0\n"
        for fault in simulation["faults"]:
            if fault["inject"].startswith("INP") and dice.random() < 0.8:
                fault["input"] = dice.choice(("stick", SPARE_INPUT))
    acts = list(simulation["operator"])
    if not (simulation["faults"] or acts):
        return
    if dice.random() < WAITS:
        mission["supervision"] = {"wait_for_arm": True}
        arms = [dice.uniform(0.0, length) for _ in range(dice.randint(0, 2))] + [length]  # early ones count for nothing
        acts += [{"at_s": round(time, 4), "do": "arm"} for time in arms]
    if dice.random() < ANYWHERE:
        times = [dice.uniform(0.0, length) for _ in range(dice.randint(1, 4))]
        acts += [{"at_s": round(time, 4), "do": "acknowledge"} for time in times]
    simulation["operator"] = sorted(acts, key=lambda act: float(act["at_s"]))


def _by_hand(steps: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    return (step["teleop"] for step in steps if "teleop" in step)
