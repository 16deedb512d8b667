"""An input and a follower without any fault, to be wrapped, and what a follower is stepped with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import Following
from artemis.values import (
    DriveCommand,
    LocatedPose,
    Odometry,
    OperatorInput,
    Request,
    Sensed,
    SetPoints,
    Snapshot,
    Tracking,
    Verdict,
)


class Stick:
    """Speed is the time in seconds; asks for the same at every read."""

    Config: ClassVar[type[Config]] = Config
    closed = False

    def __init__(self, requests: Sequence[Request] = ()) -> None:
        self._requests = tuple(requests)

    def read(self, now: float) -> OperatorInput:
        return OperatorInput(
            source="stick", speed=now, enabled=True, requests=self._requests, age=0.0, axes=(0.1, 0.2), neutral=False
        )

    def close(self) -> None:
        self.closed = True


class Walker:
    """Commands the time in seconds as speed; is at the end after 10 s."""

    Config: ClassVar[type[Config]] = Config
    started = 0

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self.started += 1

    def step(self, snapshot: Snapshot) -> Following:
        return Following(
            command=DriveCommand(speed=snapshot.time),
            tracking=Tracking(arc_length=snapshot.time, length=10.0, cross_track=0.0),
            finished=snapshot.time >= 10.0,
        )


def at(time: float) -> Snapshot:
    return Snapshot(
        sensed=Sensed(index=0, time=time),
        dt=0.02,
        pose=LocatedPose(),
        odometry=Odometry(),
        standing=False,
        set_points=SetPoints(),
        verdict=Verdict(),
    )
