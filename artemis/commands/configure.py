"""`artemis configure`: the robot file's whole configuration into the drives, on any line; nothing moves."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from artemis import clock
from artemis.commands.devices import open_bus
from artemis.commands.serial_bus import told_faults
from artemis.devices.memory import configure
from artemis.devices.serial_line import SerialLine
from artemis.errors import DeviceError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import is_simulated


def configure_drives(mission: Path, *, store: bool, simulate: bool) -> int:
    """Configure the drives of a mission, one after the other; each is off then. Returns 1 if one failed.

    Args:
        mission: Names the robot and its bus.
        store: Have them keep it when their power goes.
        simulate: Simulated drives, whatever bus the mission names.

    Raises:
        ConfigError: the mission is refused.
    """
    loaded = load_mission(mission)
    simulated = is_simulated(loaded, simulate)
    _say(f"configures {loaded.robot.robot}{' (simulated)' * simulated}: every drive is stopped, and off")
    done: list[str] = []

    def tell(name: str) -> None:
        done.append(name)
        _say(f"  {name}: configured, each setting read back{', stored' * store}")

    try:
        clock.run(_configure(loaded, simulated, store, tell), simulated=simulated)
    except DeviceError as error:
        _say(f"  {error}")
        if missing := [name for name in loaded.robot.drives if name not in done]:
            _say(f"  not configured: {', '.join(missing)}")
        return 1
    return 0


async def _configure(loaded: LoadedMission, simulated: bool, store: bool, tell: Callable[[str], None]) -> None:
    with closing(open_bus(loaded, simulated)) as bus:
        try:
            await configure(loaded.robot, bus, tell, keep=store)
        finally:
            if isinstance(bus, SerialLine) and (faults := told_faults(bus.faults)):
                _say(f"  {faults}")


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
