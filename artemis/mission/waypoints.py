"""Waypoints in a mission."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field

from artemis.config import Config
from artemis.motion.path_points import MIN_STEP

Waypoint = Annotated[list[Annotated[float, Field(ge=-20_000, le=20_000)]], Field(min_length=2, max_length=2)]
"""x, y [m]."""


def _apart(waypoints: list[Waypoint]) -> list[Waypoint]:
    for number, (before, after) in enumerate(pairwise(waypoints), start=2):
        if math.dist(before, after) < MIN_STEP:
            raise ValueError(f"waypoint {number} is at the place of the one before; remove it")
    return waypoints


class Waypoints(Config):
    """A path of straight lines; a corner becomes the nearest curve that the robot can drive."""

    waypoints: Annotated[list[Waypoint], Field(min_length=2, max_length=1000), AfterValidator(_apart)]
    """Each [x, y] in metres, from where the robot stands when the run is armed."""
