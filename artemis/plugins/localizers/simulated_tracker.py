"""A tracker in a simulation: it sees where the robot truly is, with noise, late, and now and then wrong or not at all.

Its map is the floor of the simulated world: `true_robot: {x_m, y_m, heading_deg}` is where the robot stands on it.
"""

from __future__ import annotations

import random
from collections import deque
from math import radians
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.plugins.contracts import PluginContext
from artemis.plugins.localizers.covariance import SUREST_DEG, SUREST_M, covariance
from artemis.values import Pose, PoseFix

Span = Annotated[tuple[float, float], Field(strict=False)]


class Jump(Config):
    """For a while the tracker sees something else."""

    at_s: Annotated[float, Field(ge=0)]
    """Run time."""
    for_s: Annotated[float, Field(gt=0)] = 0.3
    by_m: Span = (0.0, 0.0)
    """Along x and y of the map."""
    turn_deg: float = 0.0


class SimulatedTrackerConfig(Config):
    """Keys of `localizer: {plugin: simulated_tracker, ...}`."""

    rate_hz: Annotated[float, Field(gt=0, le=200)] = 10.0
    noise_m: Annotated[float, Field(ge=SUREST_M, le=1)] = 0.005
    """Standard deviation of x and y; the fixes say so."""
    noise_deg: Annotated[float, Field(ge=SUREST_DEG, le=90)] = 0.5
    delay_s: Annotated[float, Field(ge=0, le=2)] = 0.1
    """So long after its time a fix arrives."""
    drop_out: Annotated[tuple[Span, ...], Field(strict=False)] = ()
    """From when to when it sees nothing, in run time."""
    jumps: Annotated[tuple[Jump, ...], Field(strict=False)] = ()
    seed: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = 0
    """Of the noise."""

    @model_validator(mode="after")
    def _spans(self) -> Self:
        for begin, end in self.drop_out:
            if not 0 <= begin < end:
                raise ValueError(f"drop_out: from {begin:g} to {end:g} s is not a time span")
        return self


class SimulatedTracker:
    """Looks at the simulated robot."""

    Config: ClassVar[type[Config]] = SimulatedTrackerConfig
    contract: ClassVar[int] = 1

    def __init__(self, config: SimulatedTrackerConfig, context: PluginContext) -> None:
        """Look at `context.true_pose`.

        Raises:
            ConfigError: the run is not simulated.
        """
        if context.true_pose is None:
            raise ConfigError(f"{context.name}: plugin: simulated_tracker sees simulated robots only")
        self._config, self._name, self._true_pose = config, context.name, context.true_pose
        self._covariance = covariance(config.noise_m, config.noise_deg)
        self._dice = random.Random(config.seed)
        self._next = 0.0
        self._on_the_way: deque[PoseFix] = deque()

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """Those that have arrived at run time `now` [s] since the last call."""
        time, true = self._true_pose()
        if time >= self._next:
            self._next += (1 + (time - self._next) * self._config.rate_hz // 1) / self._config.rate_hz
            if not any(begin <= time < end for begin, end in self._config.drop_out):
                self._on_the_way.append(self._seen(time, true))
        arrived = []
        while self._on_the_way and self._on_the_way[0].time + self._config.delay_s <= now:
            arrived.append(self._on_the_way.popleft())
        return tuple(arrived)

    def _seen(self, time: float, true: Pose) -> PoseFix:
        config, dice = self._config, self._dice
        x = true.x + dice.gauss(0.0, config.noise_m)
        y = true.y + dice.gauss(0.0, config.noise_m)
        heading = true.heading + radians(dice.gauss(0.0, config.noise_deg))
        for jump in config.jumps:
            if jump.at_s <= time < jump.at_s + jump.for_s:
                x, y, heading = x + jump.by_m[0], y + jump.by_m[1], heading + radians(jump.turn_deg)
        pose = Pose(x=x, y=y, heading=wrap(heading))
        return PoseFix(time=time, pose=pose, covariance=self._covariance, source=self._name)

    def close(self) -> None:
        """Nothing is open."""
