"""How many Python functions are called per tick, and by the words of a mission of 200 nodes; how many values are made.

On virtual time that is the same in each run, on each machine.

`python -m tests.bench.calls` counts and writes the numbers down, in `calls.json`, for the Python that runs it.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import artemis
from artemis import clock
from artemis.devices.drive import Drives
from artemis.mission.loading import load_mission
from artemis.planning import plan_from
from artemis.plugins.guard import PluginGuard
from artemis.robot import Core, Robot
from artemis.sim.bus import SimBus
from artemis.sim.world import World
from artemis.values import Mode, Request, Tick

from .composition import missions, recorder_in
from .trees import ticked, tree

ROOT = Path(__file__).parents[2]
NUMBERS = Path(__file__).with_name("calls.json")
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
BEFORE, TICKS = 100, 200
"""Ticks along the path that are let by, and that are counted."""
OURS = Path(artemis.__file__).parent
ROOMS = {"sim": "simulation", "recording": "recording"}


def room_of(file: Path) -> str:
    """Where a function belongs."""
    return ROOMS.get(file.relative_to(OURS).parts[0], "tick") if file.is_relative_to(OURS) else "libraries"


def along_the_path(machine: str, begin: Callable[[], object], end: Callable[[], object]) -> None:
    """A recorded figure eight at 50 Hz; `begin` and `end` are called with `TICKS` ticks along the path between them."""
    ticks = 0
    with missions() as mission:
        mission.write_text(mission.read_text().replace("robots/artemis.yaml", f"robots/{machine}.yaml"))
        loaded = load_mission(mission)

        async def main() -> None:
            loop = asyncio.get_running_loop()
            bus = SimBus(World(loaded.robot, loaded.true_robot), loaded.robot.bitrate, loop)
            period = 1 / loaded.mission.tick_hz
            drives, recorder = Drives(loaded.robot, bus, period), recorder_in(mission.parent)

            def observe(tick: Tick) -> None:
                nonlocal ticks
                recorder.observe(tick, drives.wire.take_traffic())
                if tick.mode is not Mode.FOLLOW:
                    return
                ticks += 1
                if ticks == BEFORE:
                    begin()
                elif ticks == BEFORE + TICKS:
                    end()
                    robot.request(Request.END)

            robot = Robot(Core(plan_from(loaded), period), drives, PluginGuard({}, loop.time), period, observe)
            await robot.run()
            recorder.close("done")
            bus.close()

        clock.run(main(), simulated=True)


def calls(machine: str = "artemis") -> dict[str, float]:
    """Calls per tick of a recorded figure eight, by where the function that is called belongs."""
    files: Counter[str] = Counter()

    def count(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            files[frame.f_code.co_filename] += 1

    try:
        along_the_path(machine, lambda: sys.setprofile(count), lambda: sys.setprofile(None))
    finally:
        sys.setprofile(None)
    rooms: Counter[str] = Counter()
    for file, number in files.items():
        rooms[room_of(Path(file))] += number
    found = {room: number / TICKS for room, number in sorted(rooms.items())}
    return {**found, "mission tree": float(calls_of(ticked(*tree())))}


def values_made() -> float:
    """Values (`msgspec.Struct`) made per tick of the same run, in a process where artemis is not imported yet."""
    command = [sys.executable, "-m", "tests.bench.made"]
    return float(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)


def calls_of(action: Callable[[], object]) -> int:
    """How many functions one call of an action calls."""
    number = 0

    def count(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal number
        number += event == "call"

    sys.setprofile(count)
    try:
        action()
    finally:
        sys.setprofile(None)
    return number


def kept() -> dict[str, dict[str, float]]:
    """What was written down, by version of Python."""
    numbers: dict[str, dict[str, float]] = json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}
    return numbers


def main() -> None:
    found = {**calls(), "values": values_made()}
    NUMBERS.write_text(json.dumps({**kept(), PYTHON: found}, indent=2, sort_keys=True) + "\n")
    for room, number in found.items():
        print(f"{number:8.1f} {room}")


if __name__ == "__main__":
    main()
