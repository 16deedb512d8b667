"""What the supervisor measures at every tick, and of what: the general mechanisms are age, state, rate and schedule.

A reading is (row, device, value, words). A measure gives one where its value is above zero or suspicious; what value
for how long is a fault stands in the row.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterator

from artemis.motion.perception import stale_age
from artemis.values import DriveFeedback, DriveState, Goal, Nmt, OperatorInput, Sensed, Wish
from artemis.vehicle import OPERATING_MODES, Robot

Reading = tuple[str, str, float, str]
"""Row, device, value, what was seen."""

FAULT_STATES = (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED)
UNDER_VOLTAGE = 0x3220
TOGETHER = 0.04
"""Drives that lose their supply within this time [s] lost it for one reason."""
PRODUCER = 0x700
"""Identifier of a heartbeat, less the node's (CiA 301 7.3.3)."""
HAND = 1.2
"""No hand moves an axis (-1 to 1) this far between two reports."""


class Rate:
    """How often something happened in the last `window` [s], by name."""

    def __init__(self, window: float) -> None:
        self._window = window
        self._happened: defaultdict[str, deque[tuple[float, int]]] = defaultdict(deque)

    def count(self, name: str, times: int, now: float) -> int:
        """Add `times` at time `now` [s]; the sum over the window."""
        happened = self._happened[name]
        if times:
            happened.append((now, times))
        while happened and happened[0][0] <= now - self._window:
            happened.popleft()
        return sum(number for _, number in happened)


class DriveMeasures:
    """Each drive against what is expected of it: heard, in the right state, in the right mode."""

    def __init__(self, robot: Robot, tick: float) -> None:
        self._stale = stale_age(tick)
        self._slack = self._stale - stale_age(0.0)
        self._traction = {name for name, drive in robot.drives.items() if drive.role == "traction"}
        self._modes = {name: OPERATING_MODES[drive.role] for name, drive in robot.drives.items()}
        self._enabled: set[str] = set()

    def forget(self) -> None:
        """Nothing is expected: the drives are being brought up or released."""
        self._enabled.clear()

    def read(self, sensed: Sensed, last: Wish, explained: set[str]) -> Iterator[Reading]:
        """Readings of all drives; a fault of one that is `explained` is no news."""
        drives, late = sensed.drives, sensed.late  # feedback answers our SYNC: where we are late, so is all of it
        ages = [drive.age for drive in drives]
        if all(age is None or age - late > self._stale for age in ages):
            yield "COM-29", "", 1.0, _old(min((age for age in ages if age is not None), default=None))
            return
        for drive in drives:
            if drive.boots:
                yield "COM-26", drive.name, 1.0, ""
            if drive.age is None or drive.age - late > self._stale:
                own = 9e9 if drive.age is None else drive.age - late - self._slack
                yield "COM-11", drive.name, own, _old(drive.age)
            if drive.heartbeat_age is None or drive.heartbeat_age > 0.1:
                heard = 9e9 if drive.heartbeat_age is None else drive.heartbeat_age
                yield "COM-28", drive.name, heard, _old(drive.heartbeat_age)
            if drive.nmt is not Nmt.OPERATIONAL:
                yield "COM-27", drive.name, 1.0, drive.nmt.name if drive.nmt else "never heard"
            if drive.frames > 2:
                yield "COM-15", drive.name, float(drive.frames), f"{drive.frames} at once"
            if drive.disordered:
                yield "COM-16", drive.name, 1.0, ""
            if drive.jumps:
                yield "RUN-10", drive.name, float(drive.jumps), ""
            if drive.age is not None:
                yield from self._state(drive, explained)
                yield from self._enabling(drive, last.traction if drive.name in self._traction else last.steering)

    def _state(self, drive: DriveFeedback, explained: set[str]) -> Iterator[Reading]:
        if drive.state is DriveState.UNKNOWN:
            yield "COM-05", drive.name, 1.0, f"0x{drive.statusword:04X}"
        elif drive.state in FAULT_STATES:
            if not drive.emergencies and drive.name not in explained:
                yield "COM-01", drive.name, 1.0, ""
        elif drive.mode != self._modes[drive.name]:
            yield "COM-04", drive.name, 1.0, f"mode {drive.mode}, expected {self._modes[drive.name]}"

    def _enabling(self, drive: DriveFeedback, goal: Goal) -> Iterator[Reading]:
        """A drive that is to be enabled gets there in time, and stays."""
        if goal is not Goal.ENABLED:
            self._enabled.discard(drive.name)
        elif drive.state is DriveState.OPERATION_ENABLE:
            self._enabled.add(drive.name)
        elif drive.name not in self._enabled:
            yield "COM-03", drive.name, 1.0, f"stuck in {drive.state.value}"
        elif drive.state not in FAULT_STATES:
            yield "COM-02", drive.name, 1.0, f"now {drive.state.value}"


class HostMeasures:
    """The bus, the schedule, the drives' messages and the inputs: watched at all times."""

    def __init__(self, host_node_id: int) -> None:
        self._heartbeat = PRODUCER + host_node_id
        self._malformed, self._stray, self._emergencies = Rate(1.0), Rate(1.0), Rate(1.0)
        self._errors, self._jumps = Rate(0.1), Rate(0.5)
        self._supply_lost: dict[str, float] = {}
        self._last_beat: float | None = None
        self._axes: dict[str, tuple[float, ...]] = {}

    def read(self, sensed: Sensed, last: Wish) -> Iterator[Reading]:
        """Readings of everything that is not one drive's state."""
        now, bus = sensed.time, sensed.bus
        if not sensed.urgent:
            yield from self._schedule(sensed, last)
        if bus.foreign:
            id = "COM-18" if self._heartbeat in bus.foreign else "COM-17"
            yield id, "", 1.0, ", ".join(f"0x{identifier:03X}" for identifier in bus.foreign[:4])
        malformed = self._malformed.count("", sum(drive.malformed for drive in sensed.drives), now)
        if malformed:
            yield "COM-14", "", float(malformed), f"{malformed} in a second"
        if bus.refused:
            yield "COM-25", "", float(bus.refused), ""
        for reason in bus.blocked:
            yield "PLG-07", "", 1.0, reason
        if errors := self._errors.count("", bus.error_frames, now):
            yield "COM-20", "", float(errors), f"{errors} error frames"
        for drive in sensed.drives:
            yield from self._messages(drive, now)
        if lost := sum(time > now - TOGETHER for time in self._supply_lost.values()):
            yield "EST-01", "", float(lost), f"{lost} drives"
        for sample in sensed.inputs:
            yield from self._input(sample, now)

    def _schedule(self, sensed: Sensed, last: Wish) -> Iterator[Reading]:
        if sensed.late > 0.0:
            yield "SYS-01", "", sensed.late, f"{sensed.late * 1000:.0f} ms"
            yield "SYS-03", "", sensed.late, f"for {sensed.late * 1000:.0f} ms"
        if self._last_beat is not None and (gap := sensed.time - self._last_beat) > 0.1:
            yield "COM-31", "", gap, f"{gap * 1000:.0f} ms after the one before"
        self._last_beat = sensed.time if last.heartbeat else None

    def _messages(self, drive: DriveFeedback, now: float) -> Iterator[Reading]:
        name = drive.name
        if stray := self._stray.count(name, drive.stray, now):
            yield "COM-19", name, float(stray), f"{stray} answers too many in a second"
            if drive.stray:
                yield "COM-09", name, 1.0, ""
        if number := self._emergencies.count(name, len(drive.emergencies), now):
            yield "DRV-33", name, float(number), f"{number} in a second"
        if UNDER_VOLTAGE in drive.emergencies:
            self._supply_lost[name] = now

    def _input(self, sample: OperatorInput, now: float) -> Iterator[Reading]:
        before = self._axes.get(sample.source, sample.axes)
        self._axes[sample.source] = sample.axes
        jumped = any(abs(axis - last) > HAND for axis, last in zip(sample.axes, before, strict=False))
        if jumps := self._jumps.count(sample.source, jumped, now):
            yield "INP-08", sample.source, float(jumps), ""


def _old(age: float | None) -> str:
    return "never heard" if age is None else f"{age * 1000:.0f} ms old"
