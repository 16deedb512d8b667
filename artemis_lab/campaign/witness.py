"""What an outsider sees of a run: every frame on the wire, and the true vehicle. It stands by and changes nothing."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from artemis.devices.can_bus import Frame
from artemis.sim.axis import Regulation
from artemis.sim.bus import Node
from artemis.sim.world import World
from artemis.vehicle import RobotFile

SIDES = ("left", "right")


class Heard(NamedTuple):
    """A frame when it ended on the wire."""

    time: float
    """[s]."""
    id: int
    data: bytes


class Look(NamedTuple):
    """The true machine at one instant. Pairs are left and right; a motor in the middle is both."""

    time: float
    """[s]."""
    x: float
    """Of the rear axle's centre [m]."""
    y: float
    heading: float
    """[rad]."""
    speed: float
    """Of the virtual front wheel [m/s], forward positive."""
    rolling: tuple[float, float]
    """Speed of the driven wheels [m/s], forward positive."""
    angles: tuple[float, float]
    """Of what the steering motors turn [rad], left positive; of a single one its own, twice."""
    enabled: tuple[bool, ...]
    """Which drives obey set-points: traction left, right, steering left, right."""
    pushed: tuple[bool, bool]
    """Which driven wheels are regulated to a speed other than zero."""


class Witness:
    """Stands around the world where the bus expects it: one more station that only listens, and eyes on the machine."""

    def __init__(self, world: World, robot: RobotFile) -> None:
        self.heard: list[Heard] = []
        self.looks: list[Look] = []
        self.nodes: Sequence[Node] = [*world.nodes, _Ear(self.heard)]
        """Every station, ours last."""
        self._world = world
        self._drives = [
            world.drive(robot.drive_at(role, side)[0]) for role in ("traction", "steering") for side in SIDES
        ]
        self._wheels = []
        for side, drive in zip(SIDES, self._drives, strict=False):
            distance = robot.metres_per_count(side) * drive.axis.counts_per_rpm_s
            self._wheels.append((drive.axis, -distance if robot.drives[drive.name].mirrored else distance))

    @property
    def time(self) -> float:
        """How far the world has come [s]."""
        return self._world.time

    def advance(self, now: float) -> None:
        """Let the world go on, and look."""
        self._world.advance(now)
        world = self._world
        if self.looks and self.looks[-1].time == world.time:
            return
        pose = world.pose
        (left, left_scale), (right, right_scale) = self._wheels
        enabled = tuple([drive.state.value == "operation enable" for drive in self._drives])
        pushed = [
            on and axis.regulation is Regulation.VELOCITY and axis.target != 0.0
            for on, axis in zip(enabled, (left, right), strict=False)
        ]
        self.looks.append(
            Look(
                time=world.time,
                x=pose.x,
                y=pose.y,
                heading=pose.heading,
                speed=world.speed,
                rolling=(left.velocity * left_scale, right.velocity * right_scale),
                angles=world.motor_angles,
                enabled=enabled,
                pushed=(pushed[0], pushed[1]),
            )
        )

    def run_alone(self, seconds: float) -> None:
        """The host is gone: let the machine go on by itself for so long [s]."""
        start, step = self.time, 0.002
        for number in range(1, round(seconds / step) + 1):
            now = start + number * step
            self.advance(now)
            for drive in self._world.nodes:
                drive.advance(now)


class _Ear:
    """A station without a voice."""

    def __init__(self, heard: list[Heard]) -> None:
        self.outbox: list[tuple[float, Frame]] = []
        self.next_due = inf
        self.hears = range(0x800)
        self._heard = heard

    def receive(self, frame: Frame, now: float) -> None:
        """Write the frame down."""
        self._heard.append(Heard(now, frame.id, frame.data))

    def advance(self, now: float) -> None:
        """Nothing ever is due."""
