"""A tracker's fixes from a file: what a camera or a laser beside the floor saw of the robot."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.table import Table
from artemis.plugins.contracts import PluginContext
from artemis.plugins.localizers.covariance import SUREST_DEG, SUREST_M, covariance
from artemis.values import Pose, PoseFix

NAMES = {
    "t": "t",
    "time_s": "t",
    "x": "x",
    "x_m": "x",
    "y": "y",
    "y_m": "y",
    "heading": "heading",
    "heading_rad": "heading",
    "std_m": "std_m",
    "std_deg": "std_deg",
}


class TrackerConfig(Config):
    """Keys of `localizer: {plugin: tracker, ...}`."""

    file: str
    """A table with header: t (run time [s]), x, y [m] and heading [rad] of the centre of the rear axle in the frame of
    the map; std_m and std_deg, their standard deviations, if they change."""
    std_m: Annotated[float, Field(ge=SUREST_M, le=10)] = 0.01
    std_deg: Annotated[float, Field(ge=SUREST_DEG, le=90)] = 1.0
    delay_s: Annotated[float, Field(ge=0, le=2)] = 0.0
    """So long after its time a fix arrives."""


class TrackerLocalizer:
    """Plays a file on run time."""

    Config: ClassVar[type[Config]] = TrackerConfig
    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True

    def __init__(self, config: TrackerConfig, context: PluginContext) -> None:
        """Take the file from the mission's.

        Raises:
            ConfigError: it is not among them, or everything that is wrong in it.
        """
        if config.file not in context.files:
            raise ConfigError(f"{context.name}: file: no '{config.file}' among the mission's files")
        source = str(context.folder / config.file)
        try:
            text = context.files[config.file].decode()
        except UnicodeDecodeError as error:
            raise ConfigError(f"{source}: byte {error.start + 1} is not UTF-8") from None
        table = Table(text, source, NAMES, required=("t", "x", "y", "heading"))
        self._delay, self._next = config.delay_s, 0
        columns = table.columns if table.complete else {}
        count = len(table.lines) if columns else 0
        times = columns.get("t", [])
        stds_m = columns.get("std_m") or [config.std_m] * count
        stds_deg = columns.get("std_deg") or [config.std_deg] * count
        for row in range(count):
            if row and times[row] < times[row - 1]:
                table.report(row, f"times run backwards, from {times[row - 1]:g} to {times[row]:g} s", "t")
            for name, stds, least in (("std_m", stds_m, SUREST_M), ("std_deg", stds_deg, SUREST_DEG)):
                if not least <= stds[row] <= 100:
                    table.report(row, f"expected {least:g} to 100, not {stds[row]:g}", name)
        table.raise_problems()
        poses = zip(columns["x"], columns["y"], columns["heading"], strict=True)
        self._fixes = [
            PoseFix(
                time=time,
                pose=Pose(x=x, y=y, heading=wrap(heading)),
                covariance=covariance(std_m, std_deg),
                source=context.name,
            )
            for time, (x, y, heading), std_m, std_deg in zip(times, poses, stds_m, stds_deg, strict=True)
        ]

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """Those that have arrived at run time `now` [s] since the last call."""
        first = self._next
        while self._next < len(self._fixes) and self._fixes[self._next].time + self._delay <= now:
            self._next += 1
        return tuple(self._fixes[first : self._next])

    def close(self) -> None:
        """Nothing is open."""
