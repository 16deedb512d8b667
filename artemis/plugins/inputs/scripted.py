"""An operator from a file: a table of stick positions and buttons over time stands in for a joystick."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.table import Table
from artemis.plugins.contracts import Setup
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Grip, Hands, Kind, top_speed
from artemis.plugins.inputs.joystick import Gate
from artemis.values import OperatorInput, Request


class ScriptedConfig(Config):
    """Keys of an input with `plugin: scripted`."""

    file: str
    """A table with header: time_s, x (right positive), y (forward positive), and any of the buttons (0 or 1) enable,
    faster, slower, quickstop, acknowledge, arm, end, done. A row holds until the time of the next one. For a wheel:
    steering (right positive), gas and brake (0 to 1) instead of x and y, and the button reverse."""
    max_speed_m_s: Annotated[float, Field(gt=0)] | None = None
    """Speed at full deflection; None: the robot's limit."""
    speed_range: Annotated[float, Field(ge=0.2, le=1)] = 1.0
    """Share of it to begin with; the buttons faster and slower change it by 0.1."""
    gate: Gate = "square"
    deadzone: Annotated[float, Field(ge=0, lt=1)] = 0.05
    hysteresis_deg: Annotated[float, Field(ge=0, le=20)] = 1.0
    """The angle trails the stick's by at most this much; 5 in the thesis."""
    done_at_end: bool = True
    """At the time of the last row ask for `done`, once, and go on with that row. False: fall silent instead, as a
    device does that froze."""


class ScriptedInput:
    """Plays a table from the first `read` on."""

    Config: ClassVar[type[Config]] = ScriptedConfig
    contract: ClassVar[int] = 1

    def __init__(self, config: ScriptedConfig, setup: Setup) -> None:
        """Take the table from the mission's files.

        Raises:
            ConfigError: the file is not among them, everything that is wrong in it, or too high a speed.
        """
        limits = setup.robot.limits
        speed = top_speed(config.max_speed_m_s, setup)
        kind, table = _table(config.file, setup)
        self._config, self._lists = config, table.columns
        self._times = self._lists["time_s"]
        self._axes = AXES[kind]
        self._buttons = [name for name in self._lists if name in BUTTONS[kind]]
        grip = Grip(
            kind=kind,
            top_speed=speed,
            steering_limit=math.radians(limits.steering_deg),
            acceleration=limits.acceleration_m_s2,
            deceleration=limits.deceleration_m_s2,
            gate=config.gate,
            deadzone=config.deadzone,
            band=math.radians(config.hysteresis_deg),
        )
        self._name, self._hands = setup.name, Hands(setup.name, grip, config.speed_range)
        self._start: float | None = None
        self._row = -1
        self._done = False

    def read(self, now: float) -> OperatorInput:
        """The row in force at run time `now` [s]; time 0 of the table is the first read."""
        if self._start is None:
            self._start = now
        time = now - self._start
        requests = self._advance(time)
        if self._row < 0:
            return OperatorInput(source=self._name)
        ended = time >= self._times[-1]
        if ended and self._config.done_at_end and not self._done:
            self._done = True
            requests += [] if Request.DONE in requests else [Request.DONE]
        wish, down = self._hands.wish(now), self._down()
        return replace(
            wish,
            enabled="enable" in down,
            neutral=wish.neutral and "enable" not in down,
            requests=tuple(requests),
            age=time - self._times[-1] if ended and not self._config.done_at_end else 0.0,
            buttons=tuple(name in down for name in self._buttons),
        )

    def close(self) -> None:
        """Nothing to give back."""

    def _advance(self, time: float) -> list[Request]:
        """Go to the row in force; every button pressed on the way counts, once."""
        requests = []
        while self._row + 1 < len(self._times) and self._times[self._row + 1] <= time:
            self._row += 1
            axes = tuple(self._lists[name][self._row] for name in self._axes)
            requests += self._hands.grasp(axes, self._down())
        return requests

    def _down(self) -> frozenset[str]:
        """The buttons that the row in force holds down."""
        return frozenset(name for name in self._buttons if self._lists[name][self._row] != 0)


def _table(file: str, setup: Setup) -> tuple[Kind, Table]:
    """Read and check the table; what it stands in for shows in its header.

    Raises:
        ConfigError: with every problem.
    """
    if file not in setup.files:
        raise ConfigError(f"{setup.name}: file: no '{file}' among the mission's files")
    try:
        text = setup.files[file].decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}:1:1: byte {error.start} is not text in UTF-8") from error
    header = next((line for line in text.splitlines() if line.partition("#")[0].strip()), "").lower()
    kind: Kind = "wheel" if any(name in header for name in AXES["wheel"]) else "stick"
    columns = ("time_s", *AXES[kind])
    table = Table(text, file, {name: name for name in (*columns, *BUTTONS[kind])}, required=columns)
    if table.complete:
        _check(table)
    table.raise_problems()
    return kind, table


def _check(table: Table) -> None:
    """Report times that do not rise, and levels that no stick or button has."""
    if not table.lines:
        table.report_file("no rows; expected at least one")
    times = table.columns["time_s"]
    for row, time in enumerate(times):
        if time < 0 or (row > 0 and time <= times[row - 1]):
            table.report(row, f"time_s: expected at least 0 and more than in the row before, found {time:g}", "time_s")
    for name, levels in table.columns.items():
        for row, level in enumerate(levels):
            lowest = 0 if name in PEDALS else -1
            if name in (*AXES["stick"], *AXES["wheel"]) and not lowest <= level <= 1:
                table.report(row, f"{name}: expected {lowest} to 1, found {level:g}", name)
            if name in BUTTONS["wheel"] and level not in (0, 1):
                table.report(row, f"{name}: expected 0 or 1, found {level:g}", name)
