"""The border to foreign code: whether what a plugin returned is what its contract says."""

from __future__ import annotations

from math import isfinite

from artemis.plugins.contracts import Following
from artemis.values import OperatorInput, Request


def is_whole_input(answer: object) -> bool:
    """Whether an input's answer is a sample with finite numbers and requests in it."""
    if not isinstance(answer, OperatorInput):
        return False
    try:
        numbers = (answer.speed, answer.steering, *answer.axes, *(() if answer.age is None else (answer.age,)))
        return all(isfinite(number) for number in numbers) and all(isinstance(r, Request) for r in answer.requests)
    except (TypeError, OverflowError):
        return False


def is_whole_following(answer: object) -> bool:
    """Whether a follower's answer is one, with numbers in it. The gate judges those of the command (RUN-11)."""
    if not isinstance(answer, Following):
        return False
    command, tracking = answer.command, answer.tracking
    try:
        told = (tracking.arc_length, tracking.length, tracking.cross_track, tracking.heading_error)
        finite = [isfinite(number) for number in (*told, command.speed, command.steering)]
    except (AttributeError, TypeError, OverflowError):
        return False
    return all(finite[: len(told)])
