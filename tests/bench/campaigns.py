"""How many runs of a campaign a minute are done, on all processors."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from artemis.build import kind_of_build
from artemis.clock import stopwatch
from artemis_lab.campaign.runs import ResultFile, load_campaign, run_campaign

from .composition import MISSIONS
from .measure import Row

RUNS, ENOUGH = 60, 250


def rows() -> list[Row]:
    """The rows of the table."""
    with tempfile.TemporaryDirectory(prefix="artemis-bench-") as folder:
        copy = Path(folder) / "missions"
        shutil.copytree(MISSIONS, copy, ignore=shutil.ignore_patterns("runs"))
        words = copy / "campaigns" / "bench.yaml"
        words.write_text(f"campaign: bench\nrobot: ../robots/artemis.yaml\nruns: {RUNS}\n")
        campaign = load_campaign(words)
        worked, begun = _worked(), stopwatch()
        run_campaign(campaign, ResultFile(campaign.folder), lambda result: None, lambda: False)
        took = stopwatch() - begun
        busy = (_worked() - worked) / took / (os.cpu_count() or 1)
    speed = 60.0 * RUNS / took
    compiled = kind_of_build() == "compiled"
    return [
        Row(
            name=f"campaign of {RUNS} runs on {os.cpu_count()} processors",
            measured=f"{speed:.0f} runs a minute, workers computing {100.0 * busy:.0f} % of the time",
            budget=f">= {ENOUGH} a minute, >= 90 %" if compiled else "",
            held=speed >= ENOUGH and busy >= 0.9 if compiled else None,
        )
    ]


def _worked() -> float:
    """Processor time of all that has been done by processes that have ended, and by this one [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
