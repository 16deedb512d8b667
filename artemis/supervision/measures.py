"""What the supervisor measures at every tick, and of what: the general mechanisms are age, state, rate and schedule.

A reading is (row, device, value, words). A measure gives one where its value is above zero or suspicious; what value
for how long is a fault stands in the row.
"""

from __future__ import annotations

from collections import deque
from math import inf

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.motion.perception import stale_age
from artemis.motion.totals import total
from artemis.supervision.catalogue import POWER_LOST, ROWS
from artemis.values import DriveFeedback, OperatorInput, Sensed, Wish
from artemis.vehicle import RobotFile

Reading = tuple[str, str, float, str]
"""Row, device, value, what was seen."""

# Found once: before Python 3.12 a member of an Enum is looked up by a function of its class, 20 times as slowly.
_ON, _UNKNOWN, _ENABLED, _OPERATIONAL = (
    DriveState.OPERATION_ENABLE,
    DriveState.UNKNOWN,
    Goal.ENABLED,
    Nmt.OPERATIONAL,
)

FAULT_STATES = (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED)
TOGETHER = 0.04
"""Drives that lose their power within this time [s] lost it for one reason."""
PRODUCER = 0x700
"""Identifier of a heartbeat, less the node's (CiA 301 7.3.3)."""
ROUNDING = 1e-6
"""Ticks are so far from exact in floating point [s]; a hold of so many ticks takes just as many."""
HAND = 1.2
"""No hand moves an axis (-1 to 1) this far between two reports."""


class Rate:
    """How often something happened in the last `window` [s], by name.

    Attributes:
        happened: When, and how many times, by the names of what happened in the window; empty: nothing did.
    """

    def __init__(self, window: float) -> None:
        self._window = window
        self.happened: dict[str, deque[tuple[float, int]]] = {}

    def count(self, name: str, times: int, now: float) -> int:
        """Add `times` at time `now` [s]; the sum over the window."""
        if times:
            self.happened.setdefault(name, deque()).append((now, times))
        elif name not in self.happened:
            return 0
        happened = self.happened[name]
        while happened and happened[0][0] <= now - self._window:
            happened.popleft()
        if not happened:
            del self.happened[name]
        return total(number for _, number in happened)


class DriveMeasures:
    """Each drive against what is expected of it: heard, in the right state, in the right mode."""

    def __init__(self, robot: RobotFile, tick: float) -> None:
        self._stale = stale_age(tick)
        self._slack = self._stale - stale_age(0.0)
        self._traction = {name for name, drive in robot.drives.items() if drive.role == "traction"}
        self._modes = {name: drive.operating_mode for name, drive in robot.drives.items()}
        fixed = ROWS["COM-03"].stages[-1].hold
        self._patience = {name: drive.tables.state_time - fixed for name, drive in robot.drives.items()}
        """How much longer than the row says a drive may take to be enabled [s]."""
        self._enabled: set[str] = set()
        self._asked: dict[str, float] = {}
        """Since when drives are to be enabled [s]."""
        self._late = 0.0

    def forget(self) -> None:
        """Nothing is expected: the drives are being brought up or released."""
        self._enabled.clear()
        self._asked.clear()

    def read(self, sensed: Sensed, last: Wish, explained: set[str]) -> list[Reading]:
        """Readings of all drives; a fault of one that is `explained` is no news."""
        drives = sensed.drives
        late = self._late = self._late if sensed.urgent else sensed.late  # feedback answers our SYNC: it is as late
        newest = min([drive.age for drive in drives if drive.age is not None], default=inf)
        if newest - late > self._stale:
            return [("COM-29", "", 1.0, _old(newest))]
        readings: list[Reading] = []
        for drive in drives:
            name, age = drive.name, inf if drive.age is None else drive.age
            heartbeat = inf if drive.heartbeat_age is None else drive.heartbeat_age
            if drive.boots:
                readings.append(("COM-26", name, 1.0, ""))
            if age - late > self._stale:
                readings.append(("COM-11", name, age - late - self._slack, _old(age)))
            if heartbeat > 0.1:
                readings.append(("COM-28", name, heartbeat, _old(heartbeat)))
            if drive.nmt is not _OPERATIONAL:
                readings.append(("COM-27", name, 1.0, drive.nmt.name if drive.nmt else "never heard"))
            if drive.frames > 2:
                readings.append(("COM-15", name, float(drive.frames), f"{drive.frames} at once"))
            if drive.disordered:
                readings.append(("COM-16", name, 1.0, ""))
            if drive.jumps:
                readings.append(("RUN-10", name, float(drive.jumps), ""))
            if age < inf:
                goal = last.traction if name in self._traction else last.steering
                if goal is not _ENABLED or drive.state is not _ON or drive.mode != self._modes[name]:
                    readings += self._state(drive, goal, explained, sensed.time)
                else:
                    self._enabled.add(name)
        return readings

    def _state(self, drive: DriveFeedback, goal: Goal, explained: set[str], now: float) -> list[Reading]:
        """It is a known one, and without a fault; a drive that is to be enabled gets there in time, and stays."""
        readings: list[Reading] = []
        name, state = drive.name, drive.state
        if state is _UNKNOWN:
            readings.append(("COM-05", name, 1.0, f"0x{drive.statusword:04X}"))
        elif state in FAULT_STATES:
            if not drive.emergencies and name not in explained:
                readings.append(("COM-01", name, 1.0, ""))
        elif drive.mode != self._modes[name]:
            readings.append(("COM-04", name, 1.0, f"mode {drive.mode}, expected {self._modes[name]}"))
        if goal is not _ENABLED:
            self._enabled.discard(name)
            self._asked.pop(name, None)
        elif state is _ON:
            self._enabled.add(name)
        elif name not in self._enabled:
            if now - self._asked.setdefault(name, now) >= self._patience[name] - ROUNDING:
                readings.append(("COM-03", name, 1.0, f"stuck in {state.value}"))
        elif state not in FAULT_STATES:
            readings.append(("COM-02", name, 1.0, f"now {state.value}"))
        return readings


class HostMeasures:
    """The bus, the schedule, the drives' messages and the inputs: watched at all times."""

    def __init__(self, robot: RobotFile) -> None:
        self._heartbeat = PRODUCER + robot.host_node_id
        self._power_lost = {
            name: frozenset(code for code, row in errors.items() if row in POWER_LOST)
            for name, errors in robot.errors.items()
        }
        """By drive: its EMCY codes that say so."""
        self._malformed, self._stray, self._emergencies = Rate(1.0), Rate(1.0), Rate(1.0)
        self._errors, self._jumps = Rate(0.1), Rate(0.5)
        self._supply_lost: dict[str, float] = {}
        self._last_beat: float | None = None
        self._axes: dict[str, tuple[float, ...]] = {}

    def read(self, sensed: Sensed, last: Wish) -> list[Reading]:
        """Readings of everything that is not one drive's state."""
        now, bus = sensed.time, sensed.bus
        readings = [] if sensed.urgent else self._schedule(sensed, last)
        if bus.foreign:
            id = "COM-18" if self._heartbeat in bus.foreign else "COM-17"
            readings.append((id, "", 1.0, ", ".join(f"0x{identifier:03X}" for identifier in bus.foreign[:4])))
        damaged = told = 0
        for drive in sensed.drives:
            damaged += drive.malformed
            told += drive.stray + len(drive.emergencies)
        if malformed := self._malformed.count("", damaged, now):
            readings.append(("COM-14", "", float(malformed), f"{malformed} in a second"))
        if bus.refused:
            readings.append(("COM-25", "", float(bus.refused), ""))
        for reason in bus.blocked:
            readings.append(("PLG-07", "", 1.0, reason))
        if errors := self._errors.count("", bus.error_frames, now):
            readings.append(("COM-20", "", float(errors), f"{errors} error frames"))
        if told or self._stray.happened or self._emergencies.happened:
            for drive in sensed.drives:
                readings += self._messages(drive, now)
        lost = 0
        for time in self._supply_lost.values():
            lost += time > now - TOGETHER
        if lost:
            readings.append(("EST-01", "", float(lost), f"{lost} drives"))
        for sample in sensed.inputs:
            readings += self._input(sample, now)
        return readings

    def _schedule(self, sensed: Sensed, last: Wish) -> list[Reading]:
        readings: list[Reading] = []
        if sensed.late > 0.0:
            readings.append(("SYS-01", "", sensed.late, f"{sensed.late * 1000:.0f} ms"))
            readings.append(("SYS-03", "", sensed.late, f"for {sensed.late * 1000:.0f} ms"))
        if self._last_beat is not None and (gap := sensed.time - self._last_beat) > 0.1:
            readings.append(("COM-31", "", gap, f"{gap * 1000:.0f} ms after the one before"))
        self._last_beat = sensed.time if last.heartbeat else None
        return readings

    def _messages(self, drive: DriveFeedback, now: float) -> list[Reading]:
        readings: list[Reading] = []
        name = drive.name
        if stray := self._stray.count(name, drive.stray, now):
            readings.append(("COM-19", name, float(stray), f"{stray} answers too many in a second"))
            if drive.stray:
                readings.append(("COM-09", name, 1.0, ""))
        if number := self._emergencies.count(name, len(drive.emergencies), now):
            readings.append(("DRV-33", name, float(number), f"{number} in a second"))
        if drive.emergencies and not self._power_lost[name].isdisjoint(drive.emergencies):
            self._supply_lost[name] = now
        return readings

    def _input(self, sample: OperatorInput, now: float) -> list[Reading]:
        before = self._axes.get(sample.source, sample.axes)
        self._axes[sample.source] = sample.axes
        jumped = any([abs(axis - last) > HAND for axis, last in zip(sample.axes, before, strict=False)])
        jumps = self._jumps.count(sample.source, jumped, now)
        return [("INP-08", sample.source, float(jumps), "")] if jumps else []


def _old(age: float) -> str:
    return "never heard" if age == inf else f"{age * 1000:.0f} ms old"
