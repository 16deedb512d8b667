"""What an operator gets of the robot, as JSON: its description, once, and its state, repeatedly."""

from __future__ import annotations

from math import degrees

from msgspec import Raw, Struct

from artemis.values import Mode, Severity, Tick

SHOWN_EVERY = 0.1
"""Interval at which an unchanged state is sent [s]."""
MOST_FAULTS, LONGEST_TEXT = 6, 160


class Welcome(Struct, frozen=True):
    """What a robot is, for the operator's devices."""

    robot: Raw
    """The robot file, its top speed as the mission has it."""
    allow: tuple[str, ...] = ()
    """What an operator may ask for besides the quick stop."""


class ToldFault(Struct, frozen=True, array_like=True):
    """A fault, for the operator."""

    id: str
    text: str
    stops: bool


class RobotStatus(Struct, frozen=True):
    """What a robot does."""

    time: float
    """Run time [s]."""
    mode: str
    phase: str
    speed: float
    """Of the virtual front wheel [m/s]."""
    steering: float
    """Its angle [degrees], left positive."""
    counts: bool
    """The operator's commands drive the robot."""
    faults: tuple[ToldFault, ...] = ()

    def differs(self, other: RobotStatus) -> bool:
        """Whether there is news in it, beside the numbers."""
        mine, its = (self.mode, self.phase, self.counts), (other.mode, other.phase, other.counts)
        return mine != its or [fault.id for fault in self.faults] != [fault.id for fault in other.faults]


def status_of(tick: Tick, source: str) -> RobotStatus:
    """What a tick did, for the operator of the input `source`."""
    phase, odometry = tick.wish.phase, tick.snapshot.odometry
    return RobotStatus(
        time=round(tick.snapshot.time, 2),
        mode=tick.mode.value,
        phase=phase[:LONGEST_TEXT],
        speed=round(odometry.speed, 3),
        steering=round(degrees(odometry.steering), 1),
        counts=tick.mode is Mode.TELEOP and phase in ("driving", f"driving: {source}"),
        faults=tuple(
            ToldFault(fault.id, fault.text[:LONGEST_TEXT], fault.severity >= Severity.CONTROLLED_STOP)
            for fault in tick.snapshot.verdict.faults[:MOST_FAULTS]
        ),
    )
