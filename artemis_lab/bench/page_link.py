"""How soon Stop at the page, and its loss, stop the robot; what the page costs, and what its troubles cost a tick."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from bisect import bisect_left
from collections.abc import Sequence
from contextlib import suppress
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
from artemis_lab.bench.page_losses import LASTS, OF_PAGE
from artemis_lab.bench.ports import free_port

DRIVEN = {"mission": "driven", "bus": "simulation", "steps": [{"wait": {"seconds": 60}}]}
"""The run whose report is made meanwhile."""

ATTENDED = {"operator": [{"at_s": 3600, "do": "end"}]}
"""A run that is stopped before the hand is there waits for it."""

Late = tuple[list[float], list[float]]
"""How late ticks began without and with something [s]."""


@dataclass(slots=True)
class PageFigures:
    """What was measured, in seconds and bytes."""

    size: int
    paint: float | None
    quiet: list[float]
    """From Stop to the quick stop's frames."""
    reporting: list[float]
    """Likewise, while a report is made."""
    late: Late
    """By a flood."""
    shares: tuple[float, float]
    """Of one processor, by the page's process itself and for each browser that watches."""


@dataclass(slots=True)
class LossFigures:
    """What was measured, in seconds."""

    after: dict[str, list[float]]
    """By the loss: from it to the first set-point that is lower."""
    late: Late
    """By a page that is frozen or killed."""


@dataclass(slots=True)
class _Seen:
    """Ticks of a run, as far as they matter here."""

    stops: list[float] = field(default_factory=list)
    """When the frames had been written with which the drives were first told to stop quickly."""
    ticks: list[tuple[float, float, float]] = field(default_factory=list)
    """When its frames had been written, how late it began, and the set-point of the speed [m/s]."""
    faults: dict[str, float] = field(default_factory=dict)
    _stopping: bool = False

    def see(self, tick: Tick, traffic: Traffic) -> None:
        """Write a tick down."""
        now, stopping = stopwatch(), tick.wish.traction is Goal.QUICK_STOPPED
        if stopping and not self._stopping:
            self.stops.append(now)
        self._stopping = stopping
        if not tick.snapshot.sensed.urgent:
            self.ticks.append((now, tick.snapshot.sensed.late, tick.set_points.speed))
        for fault in tick.snapshot.verdict.faults:
            self.faults.setdefault(f"{fault.id} {fault.text}", tick.snapshot.time)

    def after(self, presses: list[float]) -> list[float]:
        """From each press to the frames [s]."""
        places = [(bisect_left(self.stops, pressed), pressed) for pressed in presses]
        return [self.stops[place] - pressed for place, pressed in places if place < len(self.stops)]

    def slower_after(self, event: float) -> float | None:
        """From an event to the frames of the first lower set-point [s]; None: there was none, or nothing drove."""
        place = bisect_left(self.ticks, (event,))
        before = self.ticks[place - 1][2] if place else 0.0
        slower = (time for time, _, speed in self.ticks[place:] if speed < before - 1e-6)
        return None if before <= 0.0 or (time := next(slower, None)) is None else time - event

    def late(self, begun: float, ended: float) -> Late:
        """How late ticks began in a stretch of time, and in as long a one before."""
        found: Late = [], []
        for time, behind, _ in self.ticks:
            if 2 * begun - ended <= time <= ended:
                found[time >= begun].append(behind)
        return found


def measure_page(robot: Path, presses: int, seconds: float) -> PageFigures:
    """A run in real time on simulated drives with its page, stopped from there so often, twice; and flooded.

    Raises:
        ArtemisError: the run, or whoever presses, failed.
    """
    with TemporaryDirectory() as made, patch.dict(os.environ, XDG_CONFIG_HOME=made):
        folder = Path(made)
        (folder / "robot.yaml").write_bytes(robot.read_bytes())
        (folder / "driven.yaml").write_text(json.dumps({**DRIVEN, "robot": "robot.yaml"}))
        finished = run_mission(load_mission(folder / "driven.yaml"), folder / "driven.yaml").run.path
        told, seen = _run_with(folder, "page_hand", 2, [str(presses), str(finished), str(seconds)])
    return _figures(told, seen)


def measure_losses(robot: Path, times: int) -> LossFigures:
    """A run in which a hand drives at the page, and is lost in each way so often.

    Raises:
        ArtemisError: the run, or who has the hand lost, failed.
    """
    with TemporaryDirectory() as made, patch.dict(os.environ, XDG_CONFIG_HOME=made):
        folder = Path(made)
        (folder / "robot.yaml").write_bytes(robot.read_bytes())
        events, seen = _run_with(folder, "page_losses", 1, [str(times)])
    return _losses(events, seen)


def _run_with(folder: Path, program: str, codes: int, words: Sequence[str]) -> tuple[Any, _Seen]:
    """Drive by hand at the page, beside a program that is told its address, codes to pair with, and a file to write."""
    seen, port, out = _Seen(), free_port(), folder / "told.json"
    mission = folder / "mission.yaml"
    teleop = [{"teleop": {"input": "page", "until": {"button": "done"}}}]
    page = {"page": {"plugin": "page"}}
    keys = {"mission": "bench", "robot": "robot.yaml", "bus": "simulation", "inputs": page, "steps": teleop}
    keys |= {"observers": {"page": {"plugin": "page", "port": port}}, "simulation": ATTENDED}
    mission.write_text(json.dumps(keys))
    given = [f"http://127.0.0.1:{port}", *(new_code(read_key(key_place())) for _ in range(codes)), str(out), *words]
    with (folder / "errors").open("w+b") as errors:
        command = [sys.executable, "-m", f"artemis_lab.bench.{program}", *given]
        hand = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
        try:
            run_mission(load_mission(mission), mission, watch=seen.see)
            with suppress(subprocess.TimeoutExpired):
                hand.wait(30)
        finally:
            hand.kill()
            hand.wait()
        if not out.exists():
            errors.seek(0)
            raise ArtemisError(f"it did not come to its end: {seen.faults}\n{errors.read().decode()}")
    return json.loads(out.read_text()), seen


def _figures(told: dict[str, Any], seen: _Seen) -> PageFigures:
    return PageFigures(
        size=told["size"],
        paint=told["paint"],
        quiet=seen.after(told["quiet"]),
        reporting=seen.after(told["report"]),
        late=seen.late(*told["flood"]),
        shares=tuple(told["shares"]),
    )


def _losses(events: Sequence[tuple[str, float]], seen: _Seen) -> LossFigures:
    """An event after which nothing became slower counts as one of infinite length."""
    found = LossFigures({}, ([], []))
    for loss, at in events:
        after = seen.slower_after(at)
        found.after.setdefault(loss, []).append(float("inf") if after is None else after)
        if loss in OF_PAGE:
            for all, new in zip(found.late, seen.late(at, at + LASTS), strict=True):
                all += new
    return found
