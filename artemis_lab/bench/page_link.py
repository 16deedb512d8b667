"""How soon Stop on the page is on the robot's wire, how large the page is, and what a flood of it costs a tick."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from bisect import bisect_left
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from artemis.app import run_mission
from artemis.clock import stopwatch
from artemis.devices.can_bus import Traffic
from artemis.drive_states import Goal
from artemis.errors import ArtemisError
from artemis.mission.loading import load_mission
from artemis.page.access import key_place, new_code, read_key
from artemis.values import Tick
from artemis_lab.bench.ports import free_port

DRIVEN = {"mission": "driven", "bus": "simulation", "steps": [{"wait": {"seconds": 60}}]}
"""The run whose report is made meanwhile."""


@dataclass(slots=True)
class PageFigures:
    """What was measured, in seconds and bytes."""

    size: int
    paint: float | None
    quiet: list[float]
    """From Stop to the quick stop's frames."""
    reporting: list[float]
    """Likewise, while a report is made."""
    late: tuple[list[float], list[float]]
    """How late ticks began without and with a flood."""


@dataclass(slots=True)
class _Stops:
    """Ticks of a run, as far as they matter here."""

    stops: list[float] = field(default_factory=list)
    """When the frames had been written with which the drives were first told to stop quickly."""
    ticks: list[tuple[float, float]] = field(default_factory=list)
    faults: dict[str, float] = field(default_factory=dict)
    _stopping: bool = False

    def see(self, tick: Tick, traffic: Traffic) -> None:
        """Write a tick down."""
        now, stopping = stopwatch(), tick.wish.traction is Goal.QUICK_STOPPED
        if stopping and not self._stopping:
            self.stops.append(now)
        self._stopping = stopping
        if not tick.snapshot.sensed.urgent:
            self.ticks.append((now, tick.snapshot.sensed.late))
        for fault in tick.snapshot.verdict.faults:
            self.faults.setdefault(f"{fault.id} {fault.text}", tick.snapshot.time)

    def after(self, presses: list[float]) -> list[float]:
        """From each press to the frames [s]."""
        places = [(bisect_left(self.stops, pressed), pressed) for pressed in presses]
        return [self.stops[place] - pressed for place, pressed in places if place < len(self.stops)]


def measure_page(robot: Path, presses: int, seconds: float) -> PageFigures:
    """A run in real time on simulated drives with its page, stopped from there so often, twice; and flooded.

    Raises:
        ArtemisError: the run, or whoever presses, failed.
    """
    seen = _Stops()
    with TemporaryDirectory() as made, patch.dict(os.environ, XDG_CONFIG_HOME=made):
        folder, port = Path(made), free_port()
        (folder / "robot.yaml").write_bytes(robot.read_bytes())
        (folder / "driven.yaml").write_text(json.dumps({**DRIVEN, "robot": "robot.yaml"}))
        finished = run_mission(load_mission(folder / "driven.yaml"), folder / "driven.yaml").run.path
        mission, out = folder / "mission.yaml", folder / "hand.json"
        teleop = [{"teleop": {"input": "page", "until": {"button": "done"}}}]
        page = {"page": {"plugin": "page"}}
        words = {"mission": "bench", "robot": "robot.yaml", "bus": "simulation", "inputs": page, "steps": teleop}
        mission.write_text(json.dumps({**words, "observers": {"page": {"plugin": "page", "port": port}}}))
        key = read_key(key_place())
        given = [new_code(key), new_code(key), str(out), str(presses), str(finished), str(seconds)]
        errors = (folder / "errors").open("w+b")
        command = [sys.executable, "-m", "artemis_lab.bench.page_hand", f"http://127.0.0.1:{port}", *given]
        hand = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
        try:
            run_mission(load_mission(mission), mission, watch=seen.see)
            hand.wait(30)
        finally:
            hand.kill()
            hand.wait()
        if not out.exists():
            errors.seek(0)
            raise ArtemisError(f"nobody pressed to the end: {seen.faults}\n{errors.read().decode()}")
        return _figures(json.loads(out.read_text()), seen)


def _figures(told: dict[str, Any], seen: _Stops) -> PageFigures:
    begun, ended = told["flood"]
    length = ended - begun
    late: tuple[list[float], list[float]] = [], []
    for time, behind in seen.ticks:
        if begun - length <= time <= ended:
            late[time >= begun].append(behind)
    return PageFigures(told["size"], told["paint"], seen.after(told["quiet"]), seen.after(told["report"]), late)
