"""A run of hours takes no more memory than one of minutes."""

from __future__ import annotations

import gc
import shutil
import tracemalloc
from pathlib import Path

import pytest

from artemis.app import run_mission
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import load_mission
from artemis.values import Tick

MISSIONS = Path(__file__).parents[2] / "missions"
GROWTH = 24_000
"""Bytes that a run may grow in a minute: the index of the recording's chunks is 150 times 40 bytes, packed. The rest is
by how much the frames that are kept for a fault's entry differ from look to look, 8 kB."""
LOOKS = (20.0, 60.0)
LOOK = 2.0
"""Memory goes up and down with the chunk that is being filled: the least in so long a time [s] counts."""


class _Memory:
    """Sees the ticks; `least` is the least memory [bytes] at each look."""

    def __init__(self) -> None:
        self.least: list[int] = []

    def watch(self, tick: Tick, traffic: Traffic) -> None:
        time = tick.snapshot.time
        if len(self.least) < len(LOOKS) and time >= LOOKS[len(self.least)]:
            gc.collect()
            self.least.append(tracemalloc.get_traced_memory()[0])
        elif self.least and time < LOOKS[len(self.least) - 1] + LOOK:
            self.least[-1] = min(self.least[-1], tracemalloc.get_traced_memory()[0])


@pytest.mark.exhaustive
def test_memory_is_flat_over_a_run(tmp_path: Path) -> None:
    shutil.copytree(MISSIONS, tmp_path, ignore=shutil.ignore_patterns("runs"), dirs_exist_ok=True)
    mission = tmp_path / "long.yaml"
    whole = (MISSIONS / "figure_eight.yaml").read_text()
    mission.write_text(f"{whole}  operator:\n    - {{at_s: {LOOKS[-1] + LOOK}, do: end}}\n")
    memory = _Memory()
    gc.collect()  # also of the interpreter's spare objects: it hands those out again unseen
    tracemalloc.start()  # before the run, or what takes the place of what it held then would count as growth
    try:
        run_mission(load_mission(mission), mission, watch=memory.watch)
    finally:
        tracemalloc.stop()

    first, last = memory.least
    assert (last - first) / (LOOKS[1] - LOOKS[0]) * 60.0 < GROWTH
