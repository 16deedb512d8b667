"""The input `page`: an operator at the page that a run serves (`artemis run MISSION --page`), on any computer or phone.

A stick on the screen, the arrow keys or a gamepad at the browser give two axes; what they mean is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from artemis.bridges.operator.session import Arrived
from artemis.bridges.page.port import PagePort
from artemis.bridges.page.session import FRESH
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.hands import Grip, Hands
from artemis.plugins.inputs.linked import LinkedInput, LinkPort
from artemis.values import OperatorInput
from artemis.vehicle import WishedSpeed


class PageInputConfig(Config):
    """Keys of an input with `plugin: page`."""

    max_speed_m_s: WishedSpeed | None = None
    """Speed of the virtual front wheel at full deflection; None: the robot's limit."""
    expo: Annotated[float, Field(ge=0, le=1)] = 0.3
    """How much finer small deflections are: 0 not at all."""
    required: bool = True
    """The drives are not enabled before somebody took control; False: the mission can do without."""


class PageInput(LinkedInput):
    """One operator at a time, at a page."""

    Config: ClassVar[type[Config]] = PageInputConfig
    live: ClassVar[bool] = True
    stale_s: ClassVar[float] = FRESH
    enabled_by: ClassVar[str] = "the page's stick, or an arrow key there,"

    def __init__(
        self,
        config: PageInputConfig,
        context: PluginContext,
        port: LinkPort | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        """Wait for the page, where the run keeps real time.

        Args:
            config: The mission's keys.
            context: Of the run.
            port: A link that is there already.
            clock: Of the link's times [s]; None: the running loop's.

        Raises:
            ConfigError: more speed than the robot has.
        """
        limits = context.robot.limits
        grip = Grip(
            kind="levers",
            top_speed=context.top_speed("max_speed_m_s", config.max_speed_m_s),
            steering_limit=math.radians(limits.steering_deg),
            acceleration=limits.acceleration_m_s2,
            deceleration=limits.deceleration_m_s2,
            expo=config.expo,
        )
        self._required = config.required
        self._hands = Hands(context.name, grip, speed_range=1.0)
        if port is None and context.real_time:
            port = PagePort(context.name)
        super().__init__(context, port, clock)

    @staticmethod
    def may_share(_one: PageInputConfig, _other: PageInputConfig, _files: Mapping[str, bytes]) -> bool:
        """A run has one page."""
        return True

    def _sample(self, now: float) -> OperatorInput:
        """As of every link; where nobody is required, nobody has a hand on it."""
        if not self._required and self._report.seat == "free":
            self._released = False
            return OperatorInput(source=self._name, age=0.0)
        return super()._sample(now)

    def _wish(self, arrived: Arrived, now: float) -> tuple[float, float]:
        """Steering by the one axis, speed by the other; a hand that let go wishes nothing."""
        self._hands.grasp(arrived.axes if arrived.enabled else (0.0, 0.0), frozenset())
        wish = self._hands.wish(now)
        return wish.speed, wish.steering
