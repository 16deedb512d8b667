"""An operator from a file: a table of stick positions and buttons over time stands in for a joystick."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.table import Table
from artemis.plugins.contracts import Setup
from artemis.plugins.inputs.joystick import (
    Gate,
    deflection_from_stick,
    reverse_at_standstill,
    speed_from_stick,
    steering_from_stick,
    step_range,
    trail,
)
from artemis.values import OperatorInput, Request

AXES = ("x", "y")
REQUESTS = {
    "quickstop": Request.QUICKSTOP,
    "acknowledge": Request.ACKNOWLEDGE,
    "arm": Request.ARM,
    "end": Request.END,
    "done": Request.DONE,
}
BUTTONS = ("enable", "faster", "slower", *REQUESTS)


class ScriptedConfig(Config):
    """Keys of an input with `plugin: scripted`."""

    file: str
    """A table with header: time_s, x (right positive), y (forward positive), and any of the buttons (0 or 1) enable,
    faster, slower, quickstop, acknowledge, arm, end, done. A row holds until the time of the next one."""
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
        if (config.max_speed_m_s or 0.0) > limits.speed_m_s:
            problem = f"max_speed_m_s: {config.max_speed_m_s:g}; the robot's limit is {limits.speed_m_s:g}"
            raise ConfigError(f"{setup.name}: {problem}")
        self._config, self._name = config, setup.name
        self._lists = _table(config.file, setup).columns
        self._times = self._lists["time_s"]
        self._buttons = [name for name in self._lists if name in BUTTONS]
        self._top_speed = config.max_speed_m_s or limits.speed_m_s
        self._steering_limit = math.radians(limits.steering_deg)
        self._deceleration = limits.deceleration_m_s2
        self._start: float | None = None
        self._last_read = 0.0
        self._row = -1
        self._range = config.speed_range
        self._moving = self._steering = 0.0
        self._done = False

    def read(self, now: float) -> OperatorInput:
        """The row in force at run time `now` [s]; time 0 of the table is the first read."""
        if self._start is None:
            self._start = self._last_read = now
        time = now - self._start
        requests = self._advance(time)
        if self._row < 0:
            return OperatorInput(source=self._name)
        ended = time >= self._times[-1]
        if ended and self._config.done_at_end and not self._done:
            self._done = True
            requests += [] if Request.DONE in requests else [Request.DONE]
        speed, deflection = self._map(now)
        buttons = tuple(self._lists[name][self._row] != 0 for name in self._buttons)
        enabled = "enable" in self._buttons and buttons[self._buttons.index("enable")]
        return OperatorInput(
            source=self._name,
            speed=speed,
            steering=self._steering,
            enabled=enabled,
            neutral=deflection == 0 and not enabled,
            requests=tuple(requests),
            age=time - self._times[-1] if ended and not self._config.done_at_end else 0.0,
            axes=tuple(self._lists[name][self._row] for name in AXES),
            buttons=buttons,
        )

    def close(self) -> None:
        """Nothing to give back."""

    def _advance(self, time: float) -> list[Request]:
        """Go to the row in force; every button pressed on the way counts, once."""
        requests = []
        while self._row + 1 < len(self._times) and self._times[self._row + 1] <= time:
            self._row += 1
            requests += [request for name, request in REQUESTS.items() if self._pressed(name)]
            self._range = step_range(self._range, self._pressed("faster"), self._pressed("slower"))
        return requests

    def _pressed(self, name: str) -> bool:
        """The button goes down in the row in force."""
        if name not in self._lists:
            return False
        levels = self._lists[name]
        return levels[self._row] != 0 and (self._row == 0 or levels[self._row - 1] == 0)

    def _map(self, now: float) -> tuple[float, float]:
        """Speed [m/s] and deflection of the row in force; the steering angle trails."""
        x, y = self._lists["x"][self._row], self._lists["y"][self._row]
        deflection = deflection_from_stick(x, y, self._config.gate, self._config.deadzone)
        angle = steering_from_stick(x, y, self._steering_limit) if deflection > 0 else 0.0
        band = math.radians(self._config.hysteresis_deg)
        self._steering = trail(angle, self._steering, band, self._steering_limit)
        # A device does not hear how fast the robot is; it knows how fast it can be, braking from what was wished.
        slowed = max(abs(self._moving) - self._deceleration * (now - self._last_read), 0.0)
        slowed = math.copysign(slowed, self._moving)
        self._last_read = now
        wished = speed_from_stick(y, deflection, self._range * self._top_speed)
        speed = reverse_at_standstill(wished, slowed)
        self._moving = max(speed, slowed, key=abs)
        return speed, deflection


def _table(file: str, setup: Setup) -> Table:
    """Read and check the table.

    Raises:
        ConfigError: with every problem.
    """
    if file not in setup.files:
        raise ConfigError(f"{setup.name}: file: no '{file}' among the mission's files")
    columns = ("time_s", *AXES)
    try:
        text = setup.files[file].decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}:1:1: byte {error.start} is not text in UTF-8") from error
    table = Table(text, file, {name: name for name in (*columns, *BUTTONS)}, required=columns)
    if table.complete:
        _check(table)
    table.raise_problems()
    return table


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
            if name in AXES and abs(level) > 1:
                table.report(row, f"{name}: expected -1 to 1, found {level:g}", name)
            if name in BUTTONS and level not in (0, 1):
                table.report(row, f"{name}: expected 0 or 1, found {level:g}", name)
