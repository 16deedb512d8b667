"""Observers for a process of their own; nothing of the tests is imported there."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import ClassVar

from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick


class KeeperConfig(Config):
    refuse: bool = False
    breaks: bool = False
    stops_at: int | None = None
    """Ends the process with a word."""
    raises_at: int | None = None


class Keeper:
    """Keeps what it is shown in a file, one for each process."""

    Config: ClassVar[type[Config]] = KeeperConfig
    own_process: ClassVar[bool] = True

    def __init__(self, config: KeeperConfig, context: PluginContext) -> None:
        if config.refuse:
            raise ConfigError(f"{context.name}: refuse: it was asked to")
        if config.breaks:
            raise RuntimeError("broken")
        assert context.run is not None
        self._config, self._name, self._map = config, context.name, context.map
        number = len(list(context.run.glob("kept*")))
        self._file = (context.run / f"kept{number}").open("xb")
        self._new: list[tuple[str, str, str]] = []

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        index = tick.snapshot.sensed.index
        if index == self._config.stops_at:
            sys.stderr.write("out of luck\n")
            sys.stderr.flush()
            import os

            os._exit(3)
        if index == self._config.raises_at:
            raise ValueError("no more")
        pickle.dump((tick, list(traffic), now), self._file)
        self._file.flush()
        self._new = [("NET-12", self._name, f"tick {index}")] if index == 2 else []
        if (shown := self._map()) is not None:
            assert shown.odometry is not None
            self._new.append(("NET-12", self._name, f"map {shown.odometry.x:g}"))

    def take_problems(self) -> list[tuple[str, str, str]]:
        problems, self._new = self._new, []
        return problems

    def close(self) -> None:
        self._file.close()


def kept(folder: Path, number: int) -> list[tuple[Tick, Traffic, float]]:
    """What the process `number` was shown, as far as it is written."""
    found = []
    path = folder / f"kept{number}"
    if not path.exists():
        return []
    with path.open("rb") as file:
        while True:
            try:
                found.append(pickle.load(file))
            except (EOFError, pickle.UnpicklingError):
                return found
