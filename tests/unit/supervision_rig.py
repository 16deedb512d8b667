"""A supervisor with a robot in front of it that rolls and steers as a test says: a rig for tests of the supervision."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from math import inf
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, STEERING, drive, volts
from msgspec.structs import replace

from artemis.drive_states import Goal
from artemis.motion.ackermann import Ackermann
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind
from artemis.supervision.policy import WATCHED, Policies
from artemis.supervision.supervisor import Supervisor
from artemis.supervision.wheels import Wheels
from artemis.values import (
    Action,
    BusHealth,
    DriveCommand,
    JobKind,
    JobResult,
    Mode,
    Request,
    Sensed,
    SetPoints,
    Severity,
    Verdict,
    Wish,
)
from artemis.vehicle import RobotFile

CAR = Ackermann(ROBOT.geometry)
DRIVING = Wish(traction=Goal.ENABLED, steering=Goal.ENABLED)
OFF = Wish()
UNWATCHED = replace(OFF, supervised=False)
STOPPING = Wish(command=DriveCommand(action=Action.QUICKSTOP), traction=Goal.QUICK_STOPPED, steering=Goal.HOLD)
COASTING = Wish(command=DriveCommand(action=Action.DISABLE))
STEER_LEFT, STEER_RIGHT = STEERING
WELL = {name: drive(name) for name in NAMES}
REFERENCED = tuple(JobResult(id=0, kind=JobKind.REFERENCE, drive=name, ok=True) for name in STEERING)


def points(speed: float = 0.0, steering: float = 0.0) -> SetPoints:
    """What the gate makes of a command that it need not limit."""
    left, right = CAR.wheel_speeds(speed, steering)
    steer_left, steer_right = CAR.wheel_angles(steering)
    return SetPoints(
        speed=speed,
        steering=steering,
        speed_left=left,
        speed_right=right,
        steering_left=steer_left,
        steering_right=steer_right,
    )


class Watch:
    """Ticks of a robot under supervision. What a test does not say is well, and as it was."""

    def __init__(self, policies: Policies | None = None, *, tick: float = PERIOD, robot: RobotFile = ROBOT) -> None:
        self.supervisor = Supervisor(robot, tick, policies)
        self.period = tick
        self.time = 0.0
        self.mode = Mode.FOLLOW
        self.wish, self.points = DRIVING, points()
        self.distances, self.angles = [0.0, 0.0], [0.0, 0.0]
        self.speeds: tuple[float, float] = (0.0, 0.0)
        """Of the driven wheels [m/s]."""
        self.rates: tuple[float, float] = (0.0, 0.0)
        """Of the steered wheels [rad/s]."""
        self.changes: dict[str, dict[str, Any]] = {name: {} for name in NAMES}
        """What a drive says instead of the truth."""
        self.verdict = Verdict()

    def sense(self, **changes: Any) -> Sensed:
        """What the edge hands in now."""
        places = [*self.distances, *self.angles]
        velocities = [*self.speeds, *self.rates]
        told = tuple(
            replace(WELL[name], **{**self._truth(name, place, velocity), **self.changes[name]})
            for name, place, velocity in zip(NAMES, places, velocities, strict=True)
        )
        index = round(self.time / PERIOD)
        return Sensed(**{"index": index, "time": self.time, "attended": True, "drives": told, **changes})

    def tick(self, *, after: float | None = None, **changes: Any) -> Verdict:
        """The next tick, `after` so many seconds; `changes` of what is sensed."""
        dt = self.period if after is None else after
        self.time += dt
        self.distances = [distance + speed * dt for distance, speed in zip(self.distances, self.speeds, strict=True)]
        self.angles = [angle + rate * dt for angle, rate in zip(self.angles, self.rates, strict=True)]
        self.verdict = self.supervisor.judge(self.sense(**changes), self.wish, self.mode, self.points)
        return self.verdict

    def ticks(self, seconds: float, **changes: Any) -> Verdict:
        """Ticks for so long, all alike."""
        for _ in range(round(seconds / self.period)):
            self.tick(**changes)
        return self.verdict

    def until(self, id: str, *, longest: float = 5.0, severity: Severity | None = None, **changes: Any) -> float:
        """Ticks until a fault is found (as severe as that); how long it took from the first of them [s]."""
        begun = self.time + self.period
        while self.time < begun + longest:
            self.tick(**changes)
            if self.severity(id) >= (severity or Severity.WARN):
                return self.time - begun
        raise AssertionError(f"{id} is not found within {longest} s; found: {self.found()}")

    def found(self) -> list[tuple[str, str]]:
        """Id and device of every fault that is there."""
        return sorted((fault.id, fault.device) for fault in self.verdict.faults)

    def ids(self) -> list[str]:
        return sorted(fault.id for fault in self.verdict.faults)

    def severity(self, id: str) -> Severity:
        return max((fault.severity for fault in self.verdict.faults if fault.id == id), default=Severity.NONE)

    def text(self, id: str) -> str:
        return next(fault.text for fault in self.verdict.faults if fault.id == id)

    def ill(self, name: str, **changes: Any) -> None:
        """From now on a drive says this."""
        self.changes[name] = changes

    def well(self) -> None:
        self.changes = {name: {} for name in NAMES}

    def drive(self, speed: float, steering: float = 0.0, *, actual: float | None = None) -> None:
        """Command this, and have the wheels do it (at another speed than commanded, if `actual`)."""
        self.wish = replace(DRIVING, command=DriveCommand(speed=speed, steering=steering))
        self.points = points(speed, steering)
        self.roll(speed if actual is None else actual, steering)

    def roll(self, speed: float, steering: float = 0.0) -> None:
        """The wheels roll and stand as a robot's do."""
        self.speeds = CAR.wheel_speeds(speed, steering)
        self.angles, self.rates = list(CAR.wheel_angles(steering)), (0.0, 0.0)

    def reference(self) -> None:
        """The steered wheels are aligned."""
        self.tick(results=REFERENCED)

    def acknowledge(self, mode: Mode = Mode.FAULT, **changes: Any) -> Verdict:
        """A tick with an acknowledgment."""
        self.mode = mode
        return self.tick(requests=(Request.ACKNOWLEDGE,), **changes)

    def _truth(self, name: str, place: float, velocity: float) -> dict[str, Any]:
        potentiometers = volts(ROBOT.drives[name].side, place) if name in STEERING else (0.0, 0.0)
        return {"position": place, "velocity": velocity, "potentiometers": potentiometers}


def bus(**changes: Any) -> dict[str, Any]:
    """What the bus went through, for `tick`."""
    return {"bus": BusHealth(**changes)}


class Road(Watch):
    """As a watch, but with the measures of the motion alone."""

    def __init__(self) -> None:
        super().__init__()
        self.wheels = Wheels(ROBOT, PERIOD)
        self.stops = False
        self.seen: dict[tuple[str, str], float] = {}
        """Row and device -> value, in the last tick."""
        self.words: dict[str, str] = {}

    def tick(self, *, after: float | None = None, **changes: Any) -> Verdict:
        dt = PERIOD if after is None else after
        self.time += dt
        self.distances = [distance + speed * dt for distance, speed in zip(self.distances, self.speeds, strict=True)]
        self.angles = [angle + rate * dt for angle, rate in zip(self.angles, self.rates, strict=True)]
        read = list(self.wheels.read(self.sense(**changes), self.wish, self.points, self.stops))
        self.seen = {(id, device): value for id, device, value, _ in read}
        self.words = {id: words for id, _, _, words in read}
        return self.verdict

    def rows(self) -> set[str]:
        return {id for id, _ in self.seen}

    def value(self, id: str, device: str = "") -> float | None:
        return self.seen.get((id, device))

    def history(self, id: str, seconds: float, device: str = "") -> list[float | None]:
        """Values of a reading, tick by tick."""
        told = []
        for _ in range(round(seconds / PERIOD)):
            self.tick()
            told.append(self.value(id, device))
        return told


def road(speed: float = 0.0, steering: float = 0.0) -> Road:
    """A robot that has driven like this for a while."""
    made = Road()
    made.drive(speed, steering)
    made.ticks(0.5)
    assert made.seen == {}
    return made


WATCHED_ROWS = {id: row for id, row in catalogue.ROWS.items() if row.found in WATCHED}
STOPPED = (Mode.FAULT, Mode.QUICKSTOP)


def of_kind(*kinds: Kind, stops: bool = True) -> pytest.MarkDecorator:
    """Rows that are forgotten so, and do or do not stop the robot."""
    chosen = {
        id: row
        for id, row in WATCHED_ROWS.items()
        if row.recovery.kind in kinds and (row.severity >= Severity.CONTROLLED_STOP) is stops
    }
    assert chosen
    return pytest.mark.parametrize(("id", "row"), chosen.items(), ids=list(chosen))


def at_rest(policies: Policies | None = None, mode: Mode = Mode.FAULT) -> Watch:
    """A robot whose drives are off, in a mode where faults are forgotten; it sends no heartbeat to be late."""
    watch = Watch(policies)
    watch.wish, watch.mode = replace(OFF, heartbeat=False), mode
    return watch


def standing(policies: Policies | None = None, mode: Mode = Mode.FAULT) -> Watch:
    """The same, and that it stands is known."""
    watch = at_rest(policies, mode)
    watch.ticks(0.1)
    return watch


def happen(watch: Watch, *ids: str, device: str = "") -> Verdict:
    """Faults, once."""
    return watch.tick(faults=tuple(catalogue.fault(id, device) for id in ids))


def lasts(watch: Watch, longest: float = 60.0) -> float:
    """How long the robot has to stop for, though nothing is wrong any more [s]; without end: inf."""
    begun = watch.time
    while watch.verdict.stops:
        watch.tick()
        if watch.time - begun > longest:
            return inf
    return watch.time - begun
