"""A simulated world and bus that write down what truly happens, and when."""

from __future__ import annotations

import asyncio
from typing import NamedTuple

from artemis.devices.can_bus import Frame
from artemis.devices.epos_objects import Units
from artemis.drive_states import DriveState
from artemis.sim.bus import Disturb, SimBus
from artemis.sim.epos import SimEpos
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters, World
from artemis.values import Pose
from artemis.vehicle import RobotFile

TRACTION, STEERING = ("traction-left", "traction-right"), ("steer-left", "steer-right")
DRIVES = TRACTION + STEERING
NODE = {name: number for number, name in enumerate(DRIVES, 1)}
SYNC, EMERGENCY, SDO_ANSWER, SDO_REQUEST, HEARTBEAT = 0x080, 0x080, 0x580, 0x600, 0x700
SET_POINTS, STOP_FRAMES = 0x200, 0x300
"""Identifiers of RxPDO 1 and 2, less the node."""


class Truth(NamedTuple):
    """The machine at one instant."""

    time: float
    pose: Pose
    speed: float
    """True speed of the virtual front wheel [m/s]."""
    wheel_speeds: tuple[float, float]
    """Rolling speed of the driven wheels [m/s], forward positive."""
    wheel_angles: tuple[float, float]
    """Of the steered wheels [rad]."""
    states: tuple[DriveState, ...]
    """In the order of `DRIVES`; a drive in the middle is both sides."""


class WatchedWorld(World):
    """Writes down its truth at every step."""

    def __init__(
        self,
        robot: RobotFile,
        true: PlantParameters | None = None,
        *,
        seed: int = 1,
        start: float = 0.0,
        settings: SimSettings | None = None,
    ) -> None:
        self.history: list[Truth] = []
        super().__init__(robot, true, seed=seed, start=start, settings=settings)
        axes = {node.name: node.axis for node in self.nodes}
        names = [robot.drive_at(role, side)[0] for role in ("traction", "steering") for side in ("left", "right")]
        self._wheels = [(axes[name], 1 / Units(robot, robot.drives[name]).rpm) for name in names[:2]]
        self._place_in_order = [self.drive(name) for name in names]

    def drive(self, name: str) -> SimEpos:
        """A simulated drive by its name in the robot file."""
        return next(node for node in self.nodes if node.name == name)

    @property
    def truth(self) -> Truth:
        """Now."""
        (left, left_scale), (right, right_scale) = self._wheels
        one, two, three, four = self._place_in_order
        return Truth(
            self.time,
            self.pose,
            self.speed,
            (left.velocity * left_scale, right.velocity * right_scale),
            self.wheel_angles,
            (one.state, two.state, three.state, four.state),
        )

    def advance(self, now: float) -> None:
        """Let time pass, and look."""
        super().advance(now)
        self.history.append(self.truth)


class WatchedBus(SimBus):
    """Writes down when the host sends and what it receives; may go unresponsive and dumb as after the host's death."""

    dead = False

    def __init__(
        self, world: World, bitrate: int, loop: asyncio.AbstractEventLoop, disturb: Disturb | None = None
    ) -> None:
        self.loop = loop
        self.sent: list[tuple[float, Frame]] = []
        self.heard: list[Frame] = []
        super().__init__(world, bitrate, loop, disturb=disturb)

    def send(self, frame: Frame) -> None:
        """Unless the host is dead."""
        if not self.dead:
            self.sent.append((self.loop.time(), frame))
            super().send(frame)

    def receive(self) -> list[Frame]:
        """Nothing if the host is dead."""
        frames = super().receive()
        if self.dead:
            return []
        self.heard += frames
        return frames


def standing(truth: Truth) -> bool:
    """No driven wheel turns (less than 0.2 mm/s)."""
    return max(abs(speed) for speed in truth.wheel_speeds) < 2e-4


def target_velocity(frame: Frame) -> int | None:
    """Target velocity [rpm] that a frame carries to a traction drive; None if it carries none."""
    if frame.id in (SET_POINTS + NODE[name] for name in TRACTION):
        return int.from_bytes(frame.data[2:6], "little", signed=True)
    if frame.id in (SDO_REQUEST + NODE[name] for name in TRACTION) and frame.data[1:4] == b"\xff\x60\x00":
        return int.from_bytes(frame.data[4:8], "little", signed=True) if frame.data[0] >> 5 == 1 else None
    return None


def controlword(frame: Frame) -> int | None:
    """The controlword that a frame carries, by PDO or SDO."""
    if frame.id - SET_POINTS in NODE.values() or frame.id - STOP_FRAMES in NODE.values():
        return int.from_bytes(frame.data[:2], "little")
    if frame.id - SDO_REQUEST in NODE.values() and frame.data[0] >> 5 == 1 and frame.data[1:4] == b"\x40\x60\x00":
        return int.from_bytes(frame.data[4:6], "little")
    return None
