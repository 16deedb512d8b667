"""The observer `csv`: chosen signals of each tick as a table in the run's folder, for a spreadsheet or a script."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from math import degrees
from typing import Annotated, ClassVar, Literal, TextIO

from pydantic import Field

from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.values import Tick

Signal = Literal["mode", "phase", "x_m", "y_m", "heading_deg", "speed_m_s", "steering_deg", "cross_track_m"]
_SIGNALS: dict[Signal, Callable[[Tick], object]] = {
    "mode": lambda tick: tick.mode.value,
    "phase": lambda tick: tick.wish.phase,
    "x_m": lambda tick: f"{tick.snapshot.pose.pose.x:.4f}",
    "y_m": lambda tick: f"{tick.snapshot.pose.pose.y:.4f}",
    "heading_deg": lambda tick: f"{degrees(tick.snapshot.pose.pose.heading):.2f}",
    "speed_m_s": lambda tick: f"{tick.snapshot.odometry.speed:.4f}",
    "steering_deg": lambda tick: f"{degrees(tick.snapshot.odometry.steering):.2f}",
    "cross_track_m": lambda tick: "" if tick.wish.tracking is None else f"{tick.wish.tracking.cross_track:.4f}",
}


class CsvConfig(Config):
    """Keys that a mission may write beside `plugin: csv`."""

    signals: Annotated[tuple[Signal, ...], Field(strict=False)] = tuple(_SIGNALS)
    """Columns after the run time `time_s`."""
    every_s: Annotated[float, Field(ge=0)] = 0.0
    """Run time between two rows; 0: each tick."""


class CsvObserver:
    """Writes `NAME.csv`; speed and steering are those of the odometry."""

    Config: ClassVar[type[Config]] = CsvConfig
    pure: ClassVar[bool] = True

    def __init__(self, config: CsvConfig, context: PluginContext) -> None:
        """Take the name; the file is made with the first tick."""
        if not re.fullmatch(r"[\w-]+", context.name):
            raise ConfigError(f"{context.name}: plugin: the name becomes that of a file: letters, digits, - and _ only")
        self._config, self._folder, self._name = config, context.run or context.folder, f"{context.name}.csv"
        self._file: TextIO | None = None
        self._next = 0.0

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Write a row, if it is time for one."""
        time = tick.snapshot.time
        if self._file is None:
            self._file = (self._folder / self._name).open("x", newline="", encoding="utf-8")
            self._rows = csv.writer(self._file)
            self._rows.writerow(["time_s", *self._config.signals])
        if time >= self._next:
            self._next = time + self._config.every_s - 1e-6
            self._rows.writerow([f"{time:.3f}", *(_SIGNALS[signal](tick) for signal in self._config.signals)])

    def take_problems(self) -> list[tuple[str, str, str]]:
        """None: a file that cannot be written ends it."""
        return []

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
