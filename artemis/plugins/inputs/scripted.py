"""An operator from a file: what was once done by hand, or written down, stands in for a device."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from msgspec.structs import replace
from pydantic import Field

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.hands import AXES, BUTTONS, Grip, Hands
from artemis.plugins.inputs.joystick import Gate
from artemis.plugins.inputs.recorded import RecordedHand, is_recorded
from artemis.plugins.inputs.script_rows import rows_from
from artemis.values import OperatorInput, Request
from artemis.vehicle import WishedSpeed

KEPT_UP = {"enable", "quickstop"}
"""Buttons that are released where everything rests."""
OF_ROWS = ("speed_range", "gate", "deadzone", "hysteresis_deg")
"""Keys that say how levels become a wish: a recorded run holds the wishes themselves."""


class ScriptedConfig(Config):
    """Keys of an input with `plugin: scripted`."""

    file: str
    """A table with header: time_s, x (right positive), y (forward positive), and any of the buttons (0 or 1) enable,
    faster, slower, quickstop, acknowledge, arm, end, done, record. A row holds until the time of the next one. For a
    wheel: steering (right positive), gas and brake (0 to 1) instead of x and y, and the button reverse. Or the same as
    YAML (.yaml), a list of mappings. Or an earlier run: its folder or its recording.mcap."""
    input: str | None = None
    """Of an earlier run: the name of the input there; None: as here."""
    max_speed_m_s: WishedSpeed | None = None
    """Speed at full deflection, or the highest that an earlier run may have wished; None: the robot's limit."""
    speed_range: Annotated[float, Field(ge=0.2, le=1)] = 1.0
    """Share of it to begin with; the buttons faster and slower change it by 0.1."""
    gate: Gate = "square"
    deadzone: Annotated[float, Field(ge=0, lt=1)] = 0.05
    hysteresis_deg: Annotated[float, Field(ge=0, le=20)] = 1.0
    """The angle trails the stick's by at most this much; 5 in the thesis."""
    done_at_end: bool = True
    """At the time of the last row ask for `done`, once, and stay at that row. False: fall silent instead, as a
    device does that froze."""


class ScriptedInput:
    """Plays a file from the first `read` on."""

    Config: ClassVar[type[Config]] = ScriptedConfig
    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True

    def __init__(self, config: ScriptedConfig, context: PluginContext) -> None:
        """Take the file from the mission's.

        Raises:
            ConfigError: it is not among them, everything that is wrong in it, or too high a speed.
        """
        if config.file not in context.files:
            raise ConfigError(f"{context.name}: file: no '{config.file}' among the mission's files")
        content = context.files[config.file]
        self._name, self._done_at_end = context.name, config.done_at_end
        self._script = (
            _recorded(config, context, content) if is_recorded(content) else _ScriptRows(config, context, content)
        )
        self._start: float | None = None
        self._row = -1
        self._requests: list[Request] = []
        self._done = False

    def read(self, now: float) -> OperatorInput:
        """The row in force at run time `now` [s]; time 0 of the file is the first read.

        Raises:
            DeviceLost: a recorded input was lost at that time.
        """
        self._start = now if self._start is None else self._start
        time, times = now - self._start, self._script.times
        while self._row + 1 < len(times) and times[self._row + 1] <= time:
            self._row += 1
            self._requests += self._script.go_to(self._row)  # every press on the way counts, once
        if self._row < 0:
            return OperatorInput(source=self._name)
        ended = time >= times[-1]
        if ended and self._done_at_end and not self._done:
            self._done = True
            self._requests += [] if Request.DONE in self._requests else [Request.DONE]
        sample = self._script.sample(now)
        silence = time - times[-1] if ended and not self._done_at_end else 0.0
        requests, self._requests = tuple(self._requests), []
        return replace(sample, requests=requests, age=None if sample.age is None else sample.age + silence)

    def close(self) -> None:
        """Nothing to give back."""


class _ScriptRows:
    """Levels of axes and buttons, as hands would hold them."""

    def __init__(self, config: ScriptedConfig, context: PluginContext, content: bytes) -> None:
        limits = context.robot.limits
        speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        if config.input is not None:
            raise ConfigError(f"{context.name}: input: names one of an earlier run, and {config.file} is none")
        kind, self._levels = rows_from(content, config.file)
        self.times = self._levels["time_s"]
        self._axes = AXES[kind]
        self._buttons = [name for name in BUTTONS[kind] if name in self._levels]
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
        self._hands = Hands(context.name, grip, config.speed_range)
        self._down: frozenset[str] = frozenset()

    def go_to(self, row: int) -> list[Request]:
        """What is asked for in the next row."""
        axes = tuple(self._levels[name][row] for name in self._axes)
        self._down = frozenset(name for name in self._buttons if self._levels[name][row] != 0)
        return self._hands.grasp(axes, self._down)

    def sample(self, now: float) -> OperatorInput:
        """What the row in force wishes at run time `now` [s]."""
        wish, enabled = self._hands.wish(now), "enable" in self._down
        buttons = tuple(name in self._down for name in self._buttons)
        return replace(wish, enabled=enabled, neutral=wish.neutral and not self._down & KEPT_UP, buttons=buttons)


def _recorded(config: ScriptedConfig, context: PluginContext, content: bytes) -> RecordedHand:
    """An input of an earlier run.

    Raises:
        ConfigError: the run had no such input, or drove faster, or there are keys that mean nothing to it.
    """
    meaningless = [key for key in OF_ROWS if key in config.model_fields_set]
    if meaningless:
        name = context.name
        raise ConfigError([f"{name}: {key}: not used with an earlier run; leave it out" for key in meaningless])
    hand = RecordedHand(content, config.file, config.input or context.name, context.name)
    limit = context.top_speed("max_speed_m_s", config.max_speed_m_s)
    if hand.top_speed > limit:
        raise ConfigError(f"{context.name}: file: it drove up to {hand.top_speed:g} m/s; {limit:g} are allowed")
    return hand
