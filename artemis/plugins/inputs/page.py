"""The input `page`: an operator at the page that a run serves (`artemis run MISSION --page`), on any computer or phone.

A stick on the screen, the arrow keys or a gamepad at the browser give two axes; what they mean is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, Literal

from msgspec.structs import replace
from pydantic import Field

from artemis.bridges.operator.session import Arrived, Given, GivenAnswer
from artemis.bridges.page.port import PagePort
from artemis.bridges.page.session import FRESH
from artemis.bridges.poses import FRAME, GOAL_POSE
from artemis.config import Config
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.hands import Grip, Hands
from artemis.plugins.inputs.linked import LinkedInput, LinkPort
from artemis.values import LocatedPose, Mode, OperatorInput, Pose, Request, Tick
from artemis.vehicle import WishedSpeed

JOG_EVERY = 0.1
"""A wheel that is jogged is sent on so often [s]: by a tenth of a degree, or by half a degree where that is wanted."""
TENTHS = 5
REFUSED, OUTDATED = "NET-14", "NET-04"
_LEFT, _RIGHT = Request.LEFT_TENTH, Request.RIGHT_TENTH


class PageInputConfig(Config):
    """Keys of an input with `plugin: page`."""

    max_speed_m_s: WishedSpeed | None = None
    """Speed of the virtual front wheel at full deflection; None: the robot's limit."""
    expo: Annotated[float, Field(ge=0, le=1)] = 0.3
    """How much finer small deflections are: 0 not at all."""
    required: bool = True
    """The drives are not enabled before somebody took control; False: the mission can do without."""
    allow: Annotated[tuple[Literal["goal_pose", "initialpose"], ...], Field(strict=False)] = ()
    """What may be set on the map. goal_pose: where a step `goto: {to: {from_input: NAME}}` drives; initialpose: about
    where the robot is, for the localizer."""


class PageInput(LinkedInput):
    """One operator at a time, at a page."""

    Config: ClassVar[type[Config]] = PageInputConfig
    live: ClassVar[bool] = True
    stale_s: ClassVar[float] = FRESH
    enable: ClassVar[str] = "the page's stick, or an arrow key there,"

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
        self._required, self._allow = config.required, config.allow
        self._mode, self._step = Mode.INIT, 0
        self._jogged = -math.inf
        self._hands = Hands(context.name, grip, speed_range=1.0)
        if port is None and context.real_time:
            port = PagePort(context.name)
        super().__init__(context, port, clock)

    @staticmethod
    def may_share(_one: PageInputConfig, _other: PageInputConfig, _files: Mapping[str, bytes]) -> bool:
        """A run has one page."""
        return True

    def read(self, now: float) -> OperatorInput:
        """As of every link; a wheel that is calibrated is turned as long as somebody holds its button."""
        sample = super().read(now)
        jog = sample.axes[2] if sample.enabled and len(sample.axes) > 2 else 0.0
        if not jog or self._mode is not Mode.CALIBRATE or now - self._jogged < JOG_EVERY:
            return sample
        self._jogged = now
        tenths = (_LEFT if jog > 0.0 else _RIGHT,) * (TENTHS if abs(jog) > 0.5 else 1)
        return replace(sample, requests=sample.requests + tenths)

    def show(self, tick: Tick) -> str:
        """Know what the robot does: what is given has to fit."""
        self._mode, self._step = tick.mode, tick.position.step
        return ""

    def _sample(self, now: float) -> OperatorInput:
        """As of every link; where nobody is required, nobody has a hand on it."""
        if not self._required and self._report.seat == "free":
            self._released = False
            return OperatorInput(source=self._name, age=0.0)
        return super()._sample(now)

    def _wish(self, arrived: Arrived, now: float) -> tuple[float, float]:
        """Steering by the one axis, speed by the other; a hand that let go wishes nothing."""
        self._hands.grasp(arrived.axes[:2] if arrived.enabled else (0.0, 0.0), frozenset())
        wish = self._hands.wish(now)
        return wish.speed, wish.steering

    def _with(self, sample: OperatorInput, given: Given) -> OperatorInput:
        """A goal, an initial pose, or an answer to the present question."""
        who = self._report.who
        if isinstance(given, GivenAnswer):
            if given.step == self._step:
                return replace(sample, answers=(*sample.answers, given.text))
            self._problems.append((OUTDATED, f"{who}: '{given.text}' answers a question that is over"))
            return sample
        if given.kind not in self._allow:
            words = f"{given.kind}: the mission does not allow it: inputs: {self._name}: {{allow: [{given.kind}]}}"
            self._problems.append((REFUSED, words))
            return sample
        pose = Pose(x=given.x, y=given.y, heading=given.heading)
        if given.kind == GOAL_POSE:
            return replace(sample, goal=pose)
        return replace(sample, initial_pose=LocatedPose(pose=pose, frame=FRAME, source=self._name))
