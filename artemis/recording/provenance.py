"""What a run is made from: its files, and the run that it goes on with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from artemis.values import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumption:
    """Where an earlier run stopped, and this one goes on."""

    run: str
    """Name of the earlier run's folder."""
    step: int
    """The step of the mission that was not finished, counted from 0."""
    done: float
    """How much of it was done: way along its path [m], or time [s]."""
    pose: Pose
    """The last estimate, in the frame `odom`."""
    true_pose: Pose | None = None
    """Where the robot really was, in the frame `odom`, if the recording knows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What a run is made from."""

    start: datetime
    """Date and time on the wall at run time 0, with time zone."""
    mission: bytes
    """The resolved mission, JSON."""
    robot: bytes
    """The resolved robot, JSON."""
    files: Mapping[str, bytes]
    """Contents of every file that the mission names, by the name there."""
    resumption: Resumption | None = None
    """The run that is gone on with."""
