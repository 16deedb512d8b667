"""Localizers that misbehave: LOC-.."""

from __future__ import annotations

from math import nan, radians
from typing import Annotated

from msgspec.structs import replace
from pydantic import Field

from artemis.motion.angles import wrap
from artemis.values import Pose, PoseFix
from artemis_lab.injections.bad_plugins import LocalizerBehaviour
from artemis_lab.injections.stage import Injection, Lasting, Stage, Undo


class Displaced(Lasting):
    """How far off it says that the robot is, on the map."""

    x_m: float = 0.0
    y_m: float = 1.0
    heading_deg: float = 0.0


class Doubt(Lasting):
    """How sure it is: 0 sure, 1 lost."""

    doubt: Annotated[float, Field(ge=0, le=10)] = 1.0


class WrongTimes(Lasting):
    """What it adds to the times of its fixes."""

    seconds: float = -3.0
    """Negative: they are older than they were."""


def _misbehave(stage: Stage, behaviour: LocalizerBehaviour) -> Undo:
    localizer = stage.localizer
    if localizer is None:
        raise ValueError("needs a localizer: the mission has none")
    localizer.misbehave(behaviour)
    return lambda: localizer.misbehave(None)


def _silence(stage: Stage, node: str | None, given: Lasting) -> Undo:
    return _misbehave(stage, lambda fix: ())


def _jump(stage: Stage, node: str | None, given: Displaced) -> Undo:
    def moved(fix: PoseFix) -> tuple[PoseFix]:
        x, y, heading = fix.pose.x + given.x_m, fix.pose.y + given.y_m, fix.pose.heading + radians(given.heading_deg)
        return (replace(fix, pose=Pose(x=x, y=y, heading=wrap(heading))),)

    return _misbehave(stage, moved)


def _doubt(stage: Stage, node: str | None, given: Doubt) -> Undo:
    return _misbehave(stage, lambda fix: (replace(fix, covariance=(), quality=0.0, doubt=given.doubt),))


def _spoil(stage: Stage, node: str | None, given: Lasting) -> Undo:
    return _misbehave(stage, lambda fix: (replace(fix, pose=Pose(x=nan, y=fix.pose.y, heading=fix.pose.heading)),))


def _shift(stage: Stage, node: str | None, given: WrongTimes) -> Undo:
    return _misbehave(stage, lambda fix: (replace(fix, time=fix.time + given.seconds),))


LOCALIZER_INJECTIONS: dict[str, Injection] = {
    "LOC-01": Injection("localizer reports nothing any more", _silence, parameters=Lasting),
    "LOC-02": Injection("localizer says that the robot is somewhere else", _jump, parameters=Displaced),
    "LOC-03": Injection("localizer is not sure any more", _doubt, parameters=Doubt),
    "LOC-04": Injection("localizer reports poses that are not numbers", _spoil, parameters=Lasting),
    "LOC-05": Injection("localizer reports poses with wrong times", _shift, parameters=WrongTimes),
}
