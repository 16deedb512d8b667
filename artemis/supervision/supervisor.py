"""Sensed values in, verdict out: what is wrong now, latched until it is acknowledged. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from artemis.motion.perception import stale_age
from artemis.supervision import catalogue
from artemis.values import DriveFeedback, DriveState, Fault, Goal, Mode, Nmt, Request, Sensed, Severity, Verdict, Wish
from artemis.vehicle import OPERATING_MODES, Robot

LATE, TOO_LATE = 0.02, 0.06
"""Three ticks in a row that began this late [s], or one TOO_LATE, are a fault (SYS-01)."""
HEARTBEAT_LOST = 0.25
"""A node's heartbeat, produced every 100 ms, is lost after this age [s]."""
ENABLE_TIME = 1.0
"""A drive that is to be enabled and is not after this time [s] does not enable (COM-03)."""

_FAULT_STATES = (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED)


class Supervisor:
    """Runs the checks at each tick, latches what they find, and gives the worst reaction."""

    def __init__(self, robot: Robot, tick: float) -> None:
        """`tick` is the tick's period [s]: feedback is stale after max(80 ms, 2.5 ticks)."""
        self._stale = stale_age(tick)
        self._traction = {name for name, drive in robot.drives.items() if drive.role == "traction"}
        self._modes = {name: OPERATING_MODES[drive.role] for name, drive in robot.drives.items()}
        self._latched: dict[tuple[str, str], Fault] = {}
        self._active: set[tuple[str, str]] = set()
        self._enabled: set[str] = set()
        self._enabling_since: dict[str, float] = {}
        self._verdict = Verdict()
        self._late = 0

    def judge(self, sensed: Sensed, last: Wish, mode: Mode) -> Verdict:
        """The verdict on this tick, knowing the mode and what it wanted in the last one."""
        found = [*sensed.faults, *self._check_schedule(sensed)]
        if last.fault is not None:
            found.append(last.fault)
        for drive in sensed.drives:
            if last.supervised:
                found += self._check_drive(drive, sensed.time, last)
            else:
                self._forget(drive.name)
        acknowledged = Request.ACKNOWLEDGE in sensed.requests and mode in (Mode.FAULT, Mode.QUICKSTOP)
        if found or self._active or acknowledged:
            self._latch(found, acknowledged)
        return self._verdict

    def _check_schedule(self, sensed: Sensed) -> Iterator[Fault]:
        if not sensed.urgent:
            self._late = self._late + 1 if sensed.late > LATE else 0
            if sensed.late > TOO_LATE or self._late >= 3:
                yield catalogue.fault("SYS-01", detail=f"{sensed.late * 1000:.0f} ms")

    def _latch(self, found: list[Fault], acknowledged: bool) -> None:
        """Keep what was found; an acknowledgment forgets each fault whose cause is gone."""
        self._active = {(fault.id, fault.device) for fault in found}
        for fault in found:
            self._latched.setdefault((fault.id, fault.device), fault)
        if acknowledged:
            self._latched = {key: fault for key, fault in self._latched.items() if key in self._active}
        faults = tuple(sorted(self._latched.values(), key=lambda fault: -fault.severity))
        self._verdict = Verdict(
            severity=faults[0].severity if faults else Severity.NONE,
            faults=faults,
            to_fault=any(fault.to_fault for fault in faults),
        )

    def _forget(self, name: str) -> None:
        self._enabled.discard(name)
        self._enabling_since.pop(name, None)

    def _check_drive(self, drive: DriveFeedback, now: float, last: Wish) -> Iterator[Fault]:
        name = drive.name
        for code in drive.emergencies:
            if code:  # code 0: all errors cleared
                yield catalogue.emergency(name, code)
        if drive.boots:
            yield catalogue.fault("COM-26", name)
        if drive.age is None or drive.age > self._stale:
            seen = "never heard" if drive.age is None else f"{drive.age * 1000:.0f} ms old"
            yield catalogue.fault("COM-11", name, seen)
        if drive.heartbeat_age is None or drive.heartbeat_age > HEARTBEAT_LOST:
            yield catalogue.fault("COM-28", name)
        if drive.nmt is not Nmt.OPERATIONAL:
            yield catalogue.fault("COM-27", name, drive.nmt.name if drive.nmt else "never heard")
        if drive.state is DriveState.UNKNOWN and drive.age is not None:
            yield catalogue.fault("COM-05", name, f"0x{drive.statusword:04X}")
        elif drive.state in _FAULT_STATES and not drive.emergencies and not self._has_reason(name):
            yield catalogue.fault("COM-01", name)
        elif drive.age is not None and drive.mode != self._modes[name]:
            yield catalogue.fault("COM-04", name, f"mode {drive.mode}, expected {self._modes[name]}")
        yield from self._check_enabling(drive, now, last.traction if name in self._traction else last.steering)

    def _has_reason(self, name: str) -> bool:
        return any(device == name and id.startswith("DRV") for id, device in self._latched)

    def _check_enabling(self, drive: DriveFeedback, now: float, goal: Goal) -> Iterator[Fault]:
        """A drive that is to be enabled gets there in time, and stays."""
        if goal is not Goal.ENABLED:
            self._forget(drive.name)
        elif drive.state is DriveState.OPERATION_ENABLE:
            self._enabled.add(drive.name)
            self._enabling_since.pop(drive.name, None)
        elif drive.name in self._enabled:
            if drive.state not in _FAULT_STATES:
                yield catalogue.fault("COM-02", drive.name, f"now {drive.state.value}")
        elif now - self._enabling_since.setdefault(drive.name, now) > ENABLE_TIME:
            yield catalogue.fault("COM-03", drive.name, f"stuck in {drive.state.value}")
