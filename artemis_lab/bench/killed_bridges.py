"""How soon the process of a bridge is back that was killed while the robot drives, and what that costs a tick."""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar
from unittest.mock import patch

from artemis import run_record
from artemis.app import run_mission
from artemis.clock import stopwatch
from artemis.devices.can_bus import Traffic
from artemis.errors import ArtemisError
from artemis.mission.loading import load_mission
from artemis.plugins.own_process import ObserverProcess
from artemis.values import Mode, Request, Severity, Tick
from artemis_lab.bench.ports import free_port

SPEED, LENGTH = 0.2, 1000.0
"""Of the robot [m/s], and of its straight path [m]."""
APART, AGAIN = (2.0, 4.0), (0.0, 1.0)
"""Between two kills, and from the return of a process to the next kill of it [s]."""
LONGEST, LOOK = 20.0, 0.002
"""Nothing takes longer; between two looks [s]."""
DOMAIN = 230
"""Of ROS 2: nobody is heard."""


@dataclass(slots=True)
class KillFigures:
    """What was measured."""

    back: dict[str, list[float]] = field(default_factory=dict)
    """By bridge: from each kill until it works again [s]; every second kill is soon after the return."""
    quiet: list[float] = field(default_factory=list)
    restarting: list[float] = field(default_factory=list)
    """How late ticks began while all bridges worked, and while one did not [s]."""
    stops: dict[str, float] = field(default_factory=dict)
    """Faults that stopped the robot, and when [s]."""


class _Noted(ObserverProcess):
    """One that is found again."""

    made: ClassVar[list[_Noted]] = []

    def __init__(self, *given: Any) -> None:  # noqa: ANN401 (as `ObserverProcess` takes)
        super().__init__(*given)
        self.made.append(self)

    @property
    def name(self) -> str:
        """In the mission: that of the plugin."""
        return self._name


def kill_bridges(robot: Path, bridges: Sequence[str], kills: int, seed: int) -> KillFigures:
    """A run in real time on simulated drives, in which each bridge is killed so often.

    Raises:
        ArtemisError: the run failed.
    """
    figures, lock = KillFigures({name: [] for name in bridges}), threading.Event()
    drives = threading.Event()

    def see(tick: Tick, traffic: Traffic) -> None:
        if tick.mode is Mode.FOLLOW and tick.set_points.speed > SPEED / 2:
            drives.set()
        if drives.is_set() and not lock.is_set():
            whole = all(process.works for process in _Noted.made)
            (figures.quiet if whole else figures.restarting).append(tick.snapshot.sensed.late)
        for fault in tick.snapshot.verdict.faults:
            if drives.is_set() and fault.severity > Severity.WARN:
                figures.stops.setdefault(f"{fault.id} {fault.text}", tick.snapshot.time)

    def operate(request: Callable[[Request | str], None], typed: object) -> Callable[[], None]:
        loop = asyncio.get_running_loop()

        def work() -> None:
            try:
                if drives.wait(LONGEST):
                    _kill(random.Random(seed), kills, figures)
            finally:
                lock.set()
                loop.call_soon_threadsafe(request, Request.END)

        killing = threading.Thread(target=work)
        killing.start()
        return lambda: None

    with TemporaryDirectory() as made, patch.object(run_record, "ObserverProcess", _Noted):
        _Noted.made.clear()
        mission = _mission(Path(made), robot, bridges)
        run_mission(load_mission(mission), mission, watch=see, operator=operate)
    if not drives.is_set():
        raise ArtemisError(f"the robot did not drive: {figures.stops}")
    return figures


def _kill(drawn: random.Random, kills: int, figures: KillFigures) -> None:
    never = threading.Event()
    for number in range(kills):
        for process in _Noted.made:
            never.wait(drawn.uniform(*(AGAIN if number % 2 else APART)))
            killed = process.pid
            if killed is None:
                continue
            os.kill(killed, signal.SIGKILL)
            begun = stopwatch()
            while (process.pid in (killed, None) or not process.works) and stopwatch() - begun < LONGEST:
                never.wait(LOOK)
            figures.back[process.name].append(stopwatch() - begun)


def _mission(folder: Path, robot: Path, bridges: Sequence[str]) -> Path:
    keys: dict[str, dict[str, object]] = {
        "ros1": {"master": f"http://127.0.0.1:{free_port()}"},
        "ros2": {"domain": DOMAIN},
        "rosbridge": {"port": free_port()},
        "foxglove": {"port": free_port()},
    }
    (folder / "robot.yaml").write_bytes(robot.read_bytes())
    words = {
        "mission": "bridges",
        "robot": "robot.yaml",
        "bus": "simulation",
        "observers": {name: {"plugin": name, **keys[name]} for name in bridges},
        "steps": [
            {"calibrate": {"steering": "from_potentiometers"}},
            {"follow": {"path": {"waypoints": [[0, 0], [LENGTH, 0]]}, "follower": {"speed_m_s": SPEED}}},
        ],
        "simulation": {"pace": "real_time"},
    }
    mission = folder / "mission.yaml"
    mission.write_text(json.dumps(words))
    return mission
