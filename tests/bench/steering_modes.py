"""How well a steering drive follows set-points of every tick: position mode against profile position mode.

`python -m tests.bench.steering_modes` prints the table of docs/decisions/0003-steering-in-position-mode.md. One
simulated drive gets its frames at 50 Hz and moves in steps of 1 ms, the cycle of its regulators. The set-points are
what the gate makes of the wish, so each wheel turns at no more than the robot's steering rate.

Reference is the straight line from each set-point to the next, reached when the next one is sent: what a drive would do
that follows perfectly without looking ahead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from artemis.devices.can_bus import Frame
from artemis.devices.canopen import SYNC_FRAME, NmtCommand, nmt_frame
from artemis.devices.epos_objects import settings
from artemis.drive_schema import Drive
from artemis.families.epos1 import POSITION_SETTING
from artemis.families.objects import CONTROLWORD, STATUSWORD, TARGET_POSITION, Object
from artemis.mission.loading import load_mission
from artemis.motion.limits import Gate
from artemis.sim.axis import Axis
from artemis.sim.epos import SimEpos
from artemis.values import DriveCommand, SetPoints
from artemis.vehicle import RobotFile

from .composition import FIGURE_EIGHT
from .measure import columns

PERIOD, STEP = 0.02, 0.001
ENABLE = (0x06, 0x0F)
NEW, AT_ONCE = 0x10, 0x20
"""Bits of the controlword in profile position mode (EPOS firmware specification 2010, 14.59)."""
ACKNOWLEDGED = 0x1000
"""Statusword bit 12 there (14.60)."""
RXPDO, RXPDO_AT_ONCE = 0x200, 0x300

Wish = Callable[[float], float]
"""Angle of the virtual wheel [rad] at a time [s]."""


def slalom(time: float) -> float:
    """20 degrees to both sides in 5 s: up to 25 degrees a second of the virtual wheel."""
    return math.radians(20.0) * math.sin(math.tau * 0.2 * time)


def step(time: float) -> float:
    """30 degrees at once; the gate lets each wheel turn at 33 degrees a second."""
    return math.radians(30.0) if time >= 0.2 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A way of giving set-points to the drive."""

    name: str
    mode: int
    frames_per_tick: int = 1
    ramp: int = 10_000
    """Profile acceleration and deceleration [rpm/s] (0x6083, 0x6084); without effect in position mode."""


WAYS = (
    Way(name="position (-1)", mode=-1),
    Way(name="profile position (1), handshake", mode=1),
    Way(name="profile position (1), handshake, ramp x 10", mode=1, ramp=100_000),
    Way(name="profile position (1), two frames a tick", mode=1, frames_per_tick=2),
    Way(name="profile position (1), two frames a tick, ramp x 10", mode=1, frames_per_tick=2, ramp=100_000),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracking:
    """How a drive followed."""

    rms: float
    """Of reference minus wheel [deg]."""
    worst: float
    ripple: float
    """Peak to peak of wheel rate minus the reference's, while that is steady [deg/s]."""
    set_points: float
    """That took effect, a second, while the reference moved."""
    frames: float
    """To this drive, a second."""
    following_error: float
    """Largest demand minus actual position inside the drive [counts]: what 0x6065 limits."""
    faulted: bool


class Rig:
    """The left steering drive, enabled in one mode, with the frames it gets counted."""

    def __init__(self, robot: RobotFile, drive: Drive, way: Way) -> None:
        self.way, self.drive = way, drive
        self.axis = Axis(drive)
        self.node = SimEpos(drive, self.axis, name="steer-left")
        self.now, self.frames, self.changes = 0.0, 0, 0
        self.counts_per_degree = drive.sensor.counts_per_turn * drive.gear_ratio / 360
        self._target = self.axis.target
        self.node.power_on(0.0)
        self.pass_time(0.1)
        self._configure(robot)
        for word in ENABLE:
            self._send(word, 0)
            self.pass_time(PERIOD)
        self._raised = False
        self.frames = 0

    def _configure(self, robot: RobotFile) -> None:
        set_point = POSITION_SETTING if self.way.mode < 0 else TARGET_POSITION
        places = [
            *((setting.object, setting.value) for setting in settings(robot, self.drive, PERIOD)),
            (Object(0x1016, 1, STATUSWORD.type), 0),
            (Object(0x6060, 0, STATUSWORD.type), self.way.mode),
            (Object(0x6081, 0, STATUSWORD.type), self.drive.motor.max_speed_rpm),
            (Object(0x6083, 0, STATUSWORD.type), self.way.ramp),
            (Object(0x6084, 0, STATUSWORD.type), self.way.ramp),
            (Object(0x1400, 2, STATUSWORD.type), 1),
            (Object(0x1600, 1, STATUSWORD.type), CONTROLWORD.mapping),
            (Object(0x1600, 2, STATUSWORD.type), set_point.mapping),
            (Object(0x1600, 0, STATUSWORD.type), 2),
            (Object(0x1601, 0, STATUSWORD.type), 1),
        ]
        for entry, value in places:
            self.node.poke(entry.index, entry.subindex, value)
        self._hear(nmt_frame(NmtCommand.START, self.drive.node_id))

    def command(self, counts: int) -> None:
        """One tick's set-point, as far as the way of giving it lets it through."""
        if self.way.mode < 0:
            self._send(ENABLE[1], counts)
        elif self.way.frames_per_tick == 2:
            self._send_controlword(ENABLE[1] | AT_ONCE)
            self._send(ENABLE[1] | AT_ONCE | NEW, counts)
        else:
            acknowledged = int(self.node.read(0x6041)) & ACKNOWLEDGED
            self._raised = not self._raised and not acknowledged
            self._send(ENABLE[1] | AT_ONCE | (NEW if self._raised else 0), counts)
        if self.axis.target != self._target:
            self._target = self.axis.target
            self.changes += 1

    def pass_time(self, seconds: float) -> list[tuple[float, float]]:
        """Angle [deg] and rate [deg/s] of the wheel after each step."""
        found = []
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.axis.step(STEP)
            self.node.advance(self.now)
            rate = self.axis.velocity * self.axis.counts_per_rpm_s / self.counts_per_degree
            found.append((self.axis.position / self.counts_per_degree, rate))
        self.node.outbox.clear()
        return found

    def _send(self, controlword: int, counts: int) -> None:
        data = controlword.to_bytes(2, "little") + counts.to_bytes(4, "little", signed=True)
        self._hear(Frame(RXPDO + self.drive.node_id, data))
        self._hear(SYNC_FRAME)
        self.frames += 1

    def _send_controlword(self, controlword: int) -> None:
        self._hear(Frame(RXPDO_AT_ONCE + self.drive.node_id, controlword.to_bytes(2, "little")))
        self.frames += 1

    def _hear(self, frame: Frame) -> None:
        self.node.receive(frame, self.now)


def gated(robot: RobotFile, wish: Wish, seconds: float) -> Iterator[float]:
    """The left wheel's set-point [deg] of each tick."""
    gate, points = Gate(robot, PERIOD), SetPoints()
    for number in range(round(seconds / PERIOD)):
        points = gate.limit(DriveCommand(steering=wish(number * PERIOD)), points, PERIOD)
        yield math.degrees(points.steering_left)


def track(robot: RobotFile, way: Way, wish: Wish, seconds: float, steady: tuple[float, float]) -> Tracking:
    """Let the drive follow a wish; `steady`: the time [s] in which the reference's rate may be compared."""
    _, drive = robot.drive_at("steering", "left")
    rig = Rig(robot, drive, way)
    errors: list[float] = []
    ripples: list[float] = []
    last, moving, lag = 0.0, 0.0, 0.0
    for number, target in enumerate(gated(robot, wish, seconds)):
        rig.command(round(target * rig.counts_per_degree))
        rate = (target - last) / PERIOD
        moving += PERIOD if rate else 0.0
        for part, (angle, wheel_rate) in enumerate(rig.pass_time(PERIOD), 1):
            time = number * PERIOD + part * STEP
            errors.append(last + rate * part * STEP - angle)
            if steady[0] <= time < steady[1]:
                ripples.append(wheel_rate - rate)
            lag = max(lag, abs(rig.axis.lag))
        last = target
    return Tracking(
        rms=math.sqrt(sum(error * error for error in errors) / len(errors)),
        worst=max(map(abs, errors)),
        ripple=max(ripples) - min(ripples),
        set_points=rig.changes / moving,
        frames=rig.frames / seconds,
        following_error=lag,
        faulted=bool(int(rig.node.read(0x6041)) & 0x08),
    )


def lines(robot: RobotFile) -> list[tuple[str, ...]]:
    """The table's cells."""
    cells: list[tuple[str, ...]] = [
        ("wish", "mode", "error RMS", "max", "rate ripple", "set-points", "frames", "in the drive")
    ]
    for name, wish, seconds, steady in (("slalom", slalom, 11.0, (1.0, 11.0)), ("step", step, 2.0, (0.6, 1.0))):
        for way in WAYS:
            found = track(robot, way, wish, seconds, steady)
            cells.append(
                (
                    name,
                    way.name,
                    f"{found.rms:.2f} deg",
                    f"{found.worst:.2f} deg",
                    f"{found.ripple:.1f} deg/s",
                    f"{found.set_points:.0f} Hz",
                    f"{found.frames:.0f} /s",
                    f"{found.following_error:.0f} counts" + (", FAULT" if found.faulted else ""),
                )
            )
    return cells


if __name__ == "__main__":
    print(columns(lines(load_mission(FIGURE_EIGHT).robot)))
