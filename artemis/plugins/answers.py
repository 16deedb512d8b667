"""What inputs and followers answer, checked: whole, in range, and as plain values, whatever they compute with."""

from __future__ import annotations

from itertools import repeat
from math import isfinite
from typing import TypeGuard

import numpy as np

from artemis.motion.angles import wrap
from artemis.plugins.contracts import Following
from artemis.plugins.fixes import FARTHEST, is_positive
from artemis.values import Action, DriveCommand, LocatedPose, OperatorInput, Pose, Request, Tracking

_FLOATS = {float}
NUMBER, FLAG = (int, float, np.integer, np.floating), (bool, np.bool_)
MOST = 64
"""Requests, and answers, of one sample."""


def is_whole_input(answer: object) -> TypeGuard[OperatorInput]:
    """Whether an input's answer is a sample, with numbers, buttons and requests in it."""
    if not isinstance(answer, OperatorInput) or not isinstance(answer.source, str):
        return False
    numbers = (answer.speed, answer.steering, 0.0 if answer.age is None else answer.age)
    places: list[object] = [answer.goal]
    if (initial := answer.initial_pose) is not None:
        if not isinstance(initial, LocatedPose) or not _holds(initial.covariance, NUMBER):
            return False
        places.append(initial.pose)
    return (
        all(_is_pose(place) for place in places if place is not None)
        and all(_holds(part, NUMBER) for part in (numbers, answer.raw, answer.axes, answer.centred, answer.shaped))
        and all(_holds(part, FLAG) for part in ((answer.enabled, answer.neutral), answer.buttons))
        and _holds(answer.requests, (Request,))
        and _holds(answer.answers, (str,))
    )


def _is_pose(place: object) -> bool:
    return isinstance(place, Pose) and _holds((place.x, place.y, place.heading), NUMBER)


def _holds(parts: object, kinds: tuple[type, ...]) -> bool:
    """Whether it is a tuple of such parts."""
    return isinstance(parts, tuple) and all(map(isinstance, parts, repeat(kinds)))


def is_in_range(sample: OperatorInput) -> bool:
    """Whether a sample's numbers are finite, its axes between -1 and 1, it is not from the future, its poses can be.

    And whether it asks for no more than anybody can: all of it is written down.
    """
    if len(sample.requests) > MOST or len(sample.answers) > MOST:
        return False
    try:
        age = 0.0 if sample.age is None else sample.age
        numbers = (sample.speed, sample.steering, age, *sample.raw, *sample.centred, *sample.shaped)
        if not all(map(isfinite, numbers)) or age < 0.0 or not all(-1.0 <= axis <= 1.0 for axis in sample.axes):
            return False
        if sample.goal is not None and not _can_be(sample.goal):
            return False
        initial = sample.initial_pose
        if initial is None:
            return True
        covariance = initial.covariance
        return _can_be(initial.pose) and (
            not covariance or (len(covariance) == 6 and is_positive(*map(float, covariance)))
        )
    except OverflowError:  # a whole number too large for a float
        return False


def _can_be(pose: Pose) -> bool:
    return abs(pose.x) <= FARTHEST and abs(pose.y) <= FARTHEST and isfinite(pose.heading)


def plain_input(sample: OperatorInput) -> OperatorInput:
    """The same sample of the types that it is declared to have."""
    return OperatorInput(
        source=str(sample.source),
        speed=float(sample.speed),
        steering=float(sample.steering),
        enabled=bool(sample.enabled),
        neutral=bool(sample.neutral),
        requests=tuple(sample.requests),
        age=None if sample.age is None else float(sample.age),
        raw=tuple(map(float, sample.raw)),
        axes=tuple(map(float, sample.axes)),
        centred=tuple(map(float, sample.centred)),
        shaped=tuple(map(float, sample.shaped)),
        buttons=tuple(map(bool, sample.buttons)),
        goal=None if sample.goal is None else _plain_pose(sample.goal),
        initial_pose=None if (initial := sample.initial_pose) is None else _plain_initial(initial, sample.source),
        answers=tuple(map(str, sample.answers)),
    )


def _plain_pose(pose: Pose) -> Pose:
    return Pose(x=float(pose.x), y=float(pose.y), heading=wrap(float(pose.heading)))


def _plain_initial(initial: LocatedPose, source: str) -> LocatedPose:
    covariance = tuple(map(float, initial.covariance))
    return LocatedPose(pose=_plain_pose(initial.pose), frame="map", source=str(source), covariance=covariance)


def plain_following(answer: object) -> Following | None:
    """A follower's answer of plain values; None: it is no whole one. The gate judges the command's numbers (RUN-11)."""
    if not isinstance(answer, Following) or not isinstance(answer.finished, FLAG):
        return None
    command, tracking = answer.command, answer.tracking
    if not isinstance(command, DriveCommand) or not isinstance(command.action, Action):
        return None
    if not isinstance(tracking, Tracking):
        return None
    place = (tracking.arc_length, tracking.length, tracking.cross_track, tracking.heading_error)
    parts = [part for part in (tracking.planned_speed, tracking.feedforward) if part is not None]
    numbers = (*place, *parts, command.speed, command.steering)
    plain = type(command) is DriveCommand and type(tracking) is Tracking and type(answer.finished) is bool
    if plain and set(map(type, numbers)) == _FLOATS and all(map(isfinite, numbers)):
        return answer
    if not _holds(numbers, NUMBER):
        return None
    try:
        arc_length, length, cross_track, heading_error = map(float, place)
        planned_speed, feedforward = _part(tracking.planned_speed), _part(tracking.feedforward)
        speed, steering = float(command.speed), float(command.steering)
    except OverflowError:  # a whole number too large for a float
        return None
    if not all(map(isfinite, (arc_length, length, cross_track, heading_error, planned_speed or 0, feedforward or 0))):
        return None
    return Following(
        command=DriveCommand(speed=speed, steering=steering, action=command.action),
        tracking=Tracking(
            arc_length=arc_length,
            length=length,
            cross_track=cross_track,
            heading_error=heading_error,
            planned_speed=planned_speed,
            feedforward=feedforward,
        ),
        finished=bool(answer.finished),
    )


def _part(value: float | None) -> float | None:
    return None if value is None else float(value)
