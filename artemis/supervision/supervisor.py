"""Sensed values in, verdict out: what is wrong now, latched until its clear condition holds. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from math import inf

from msgspec.structs import replace

from artemis.families.objects import LOST_HEARTBEAT
from artemis.motion.totals import total
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind, Row
from artemis.supervision.measures import FAULT_STATES, ROUNDING, DriveMeasures, HostMeasures, Reading
from artemis.supervision.policy import Policies, stricter
from artemis.supervision.poses import PoseMeasures
from artemis.supervision.scanners import ScannerMeasures
from artemis.supervision.supply import SupplyMeasures
from artemis.supervision.wheels import Wheels
from artemis.values import Action, Fault, Mode, Odometry, Request, Sensed, SetPoints, Severity, Verdict, Wish
from artemis.vehicle import RobotFile

STANDING = 0.01
"""Automatic recovery needs a robot that moves no faster than this [m/s]."""
ALL_RECOVERIES = 5
"""Automatic recoveries in a run; then a person is needed."""
ACKNOWLEDGE_AGAIN = 2.0
"""A stuck button acknowledges once in this time [s]."""
STATE_TIME = 0.15
"""A drive that told why it is in fault shows it in its statusword within this time [s]: three ticks of the slowest."""
NO_SLOWER = "RUN-03"
_ADAPTER_LOST = "COM-22"
COVERED = "LAS-06"
"""A person who looks at the scanner may know better."""
_STOPPED = (Mode.FAULT, Mode.QUICKSTOP)
_SILENT = Verdict()
_STOPS_BY = {
    Action.RUN: Severity.CONTROLLED_STOP,
    Action.QUICKSTOP: Severity.QUICK_STOP,
    Action.DISABLE: Severity.OFF,
}
"""How a robot comes to rest that shall, by how it was commanded."""


@dataclass(slots=True)
class _Latched:
    fault: Fault
    seen: float
    """When its cause was there last [s]."""


class Supervisor:
    """Runs the measures at each tick, latches what they find, and gives the worst reaction."""

    def __init__(
        self,
        robot: RobotFile,
        tick: float,
        policies: Policies | None = None,
        blind: bool = False,
        needs_scanners: bool = False,
    ) -> None:
        """Begin.

        Args:
            robot: What is watched.
            tick: The tick's period [s].
            policies: Make rows stricter.
            blind: The potentiometers are new.
            needs_scanners: The run cannot do without them; else what is wrong with one is a warning.
        """
        policies = policies or {}
        self._rows: Mapping[str, Row] = stricter(policies)
        self._resumes = {id for id, policy in policies.items() if policy.resume == "continue"}
        self._drives, self._host, self._wheels = (
            DriveMeasures(robot, tick),
            HostMeasures(robot),
            Wheels(robot, tick, blind),
        )
        self._errors = robot.errors
        self._scanners = ScannerMeasures(robot.scanners) if robot.scanners else None
        self._supply = SupplyMeasures(robot.battery) if robot.battery else None
        self._poses = PoseMeasures(tick)
        self._unneeded = frozenset(() if needs_scanners else robot.scanners)
        self._above: dict[tuple[str, str, int], float] = {}
        self._latched: dict[tuple[str, str], _Latched] = {}
        self._occurred: dict[tuple[str, str], list[float]] = {}
        self._recovered: dict[str, list[float]] = {}
        self._explained: set[str] = set()
        """Drives in fault that said why, also once that was acknowledged."""
        self._told = -inf
        """When one last said why while nobody watched [s]."""
        self._acknowledged = -inf
        self._alarm = False
        self._verdict = _SILENT
        self.odometry = Odometry()
        """Of the tick before: the next one is judged by it."""

    def judge(self, sensed: Sensed, last: Wish, mode: Mode, points: SetPoints, spare: Collection[str] = ()) -> Verdict:
        """The verdict on this tick, knowing the mode, what it wished in the last one, and what then left the gate.

        What is wrong with an input that is `spare` now is a warning.
        """
        faults = [_milder(fault, spare) for fault in sensed.faults] if spare else sensed.faults
        found = [*faults, *self._emergencies(sensed, last), *self._measured(sensed, last, mode, points)]
        if last.fault is not None:
            found.append(last.fault)
        if self._unneeded:
            found = [_milder(fault, self._unneeded, ("LAS", "PLG")) for fault in found]
        if found or self._latched:
            self._latch(found, sensed.time)
            self._forget(sensed, mode)
            self._verdict = self._worst(sensed.time)
        return self._verdict

    # ------------------------------------------------------------------------------------------ finding

    def _emergencies(self, sensed: Sensed, last: Wish) -> list[Fault]:
        """What the drives told; in bring-up and release a lost heartbeat is no news."""
        found = []
        for drive in sensed.drives:
            for code in drive.emergencies:
                if code and (last.supervised or code != LOST_HEARTBEAT):
                    found.append(catalogue.emergency(drive.name, code, self._errors[drive.name]))
        return found

    def _measured(self, sensed: Sensed, last: Wish, mode: Mode, points: SetPoints) -> list[Fault]:
        """The faults among the readings: what is above its limit for long enough."""
        found = []
        above = self._above.copy() if sensed.urgent else {}  # between two ticks not all is measured
        for id, device, value, seen in self._readings(sensed, last, mode, points):
            severity = self._risen((id, device), value, sensed.time, above)
            if severity is not None:
                escalates = id == NO_SLOWER
                found.append(self._escalated(seen, last) if escalates else catalogue.fault(id, device, seen, severity))
        self._above = above
        return found

    def _readings(self, sensed: Sensed, last: Wish, mode: Mode, points: SetPoints) -> list[Reading]:
        readings = self._host.read(sensed, last) + self._poses.read(sensed, mode)
        if self._supply is not None:
            readings += self._supply.read(sensed)
        if self._scanners is not None:
            readings += self._scanners.read(sensed, self.odometry)
        for fault in sensed.faults:
            if fault.id == _ADAPTER_LOST:
                return readings  # of the drives nothing can be known
        if last.supervised:
            readings += self._drives.read(sensed, last, self._explain(sensed))
        else:
            self._drives.forget()
            if reasons := {drive.name for drive in sensed.drives if any(drive.emergencies)}:
                self._explained, self._told = self._explained | reasons, sensed.time
        if not sensed.urgent:
            readings += self._wheels.read(sensed, last, points, self._verdict.stops)
        return readings

    def _explain(self, sensed: Sensed) -> set[str]:
        """Drives whose state of fault is no news: they said why, and are still there or will soon be."""
        if not self._explained and not self._latched:
            return self._explained
        told = self._explained.union([device for id, device in self._latched if id.startswith("DRV")])
        if told:
            soon = sensed.time - self._told <= STATE_TIME
            drives = [drive for drive in sensed.drives if drive.name in told]
            self._explained = {drive.name for drive in drives if soon or drive.state in FAULT_STATES}
        return self._explained

    def _risen(
        self, row: tuple[str, str], value: float, now: float, above: dict[tuple[str, str, int], float]
    ) -> Severity | None:
        """The worst stage of the row that the value has been above for long enough."""
        worst = None
        for number, stage in enumerate(self._rows[row[0]].stages):
            if value > stage.over:
                key = *row, number
                since = above[key] = self._above.get(key, now)
                if now - since >= stage.hold - ROUNDING:
                    worst = stage.severity
        return worst

    def _escalated(self, seen: str, last: Wish) -> Fault:
        """The robot does not slow down as it should: one step further each time, S2 -> S1 -> S0 -> alarm."""
        stops_by = max(self._verdict.severity, _STOPS_BY[last.command.action])
        self._alarm = stops_by is Severity.OFF
        self._wheels.plan_from_here()
        return replace(catalogue.fault(NO_SLOWER, "", seen), severity=Severity(min(stops_by + 1, Severity.OFF)))

    # ------------------------------------------------------------------------------------------ latching

    def _latch(self, found: list[Fault], now: float) -> None:
        for fault in found:
            key, row = (fault.id, fault.device), self._rows[fault.id]
            latched = self._latched.get(key)
            if fault.severity is catalogue.ROWS[fault.id].severity:
                fault = replace(fault, severity=row.severity)
            if latched is None:
                self._latched[key] = _Latched(replace(fault, final=self._is_final(key, row, now)), now)
                continue
            latched.seen = now
            if fault.severity > latched.fault.severity:
                latched.fault = replace(fault, final=latched.fault.final)

    def _is_final(self, key: tuple[str, str], row: Row, now: float) -> bool:
        """Whether this occurrence is one too many for the run."""
        if not row.recovery.final:
            return row.recovery.kind is Kind.NEVER
        occurred = self._occurred.setdefault(key, [])
        occurred.append(now)
        return len([time for time in occurred if time > now - row.recovery.window]) >= row.recovery.final

    def _forget(self, sensed: Sensed, mode: Mode) -> None:
        """Drop what is over: by itself, by an acknowledgment, or automatically."""
        now, latched = sensed.time, self._latched
        asked = Request.ACKNOWLEDGE in sensed.requests and mode in _STOPPED
        asked = asked and now - self._acknowledged >= ACKNOWLEDGE_AGAIN
        if asked:
            self._acknowledged = now
            for key in self._accepted():
                del latched[key]
        for key, entry in list(latched.items()):
            gone = self._is_gone(entry, now)
            mild = entry.fault.severity < Severity.CONTROLLED_STOP
            if gone and (mild or (asked and not entry.fault.final)):
                del latched[key]
        stopping = self._stopping()
        if mode in _STOPPED and self._wheels.speed <= STANDING and self._recover(stopping, now):
            for key in stopping:
                del latched[key]
            for id in {id for id, _ in stopping}:
                self._recovered.setdefault(id, []).append(now)

    def _accepted(self) -> list[tuple[str, str]]:
        """The scanners that an acknowledgment is about, whose view is taken as it is: nothing else stops the robot.

        Nobody looks at a window that moves.
        """
        stopping = self._stopping()
        if self._scanners is None or self._wheels.speed > STANDING or any(id != COVERED for id, _ in stopping):
            return []
        return [key for key, entry in stopping.items() if not entry.fault.final and self._scanners.accept(key[1])]

    def _is_gone(self, entry: _Latched, now: float) -> bool:
        """The cause is not there in this tick, and has not been for the row's settling time."""
        return now > entry.seen and now - entry.seen >= self._rows[entry.fault.id].recovery.settle

    def _recover(self, stopping: Mapping[tuple[str, str], _Latched], now: float) -> bool:
        return self._recoverable(stopping, now) and all(self._is_gone(entry, now) for entry in stopping.values())

    def _stopping(self) -> dict[tuple[str, str], _Latched]:
        """What stops the robot."""
        return {key: entry for key, entry in self._latched.items() if entry.fault.severity >= Severity.CONTROLLED_STOP}

    def _recoverable(self, stopping: Iterable[tuple[str, str]], now: float) -> bool:
        """Whether all that stops the robot may be forgotten without a person, within the budgets."""
        if total(map(len, self._recovered.values())) >= ALL_RECOVERIES:
            return False
        return all(self._has_budget(id, device, now) for id, device in stopping)

    def _has_budget(self, id: str, device: str, now: float) -> bool:
        recovery = self._rows[id].recovery
        if recovery.kind is Kind.ITSELF:
            return True
        spent = len([time for time in self._recovered.get(id, ()) if time > now - recovery.window])
        others = any((other, device) in self._latched for other in recovery.unless)
        return spent < recovery.times and not others

    def _worst(self, now: float) -> Verdict:
        faults = tuple(sorted((entry.fault for entry in self._latched.values()), key=lambda fault: -fault.severity))
        if not faults:
            return _SILENT
        stopping = self._stopping()
        recovers = bool(stopping) and self._recoverable(stopping, now)
        return Verdict(
            severity=faults[0].severity,
            faults=faults,
            to_fault=any(fault.to_fault for fault in faults),
            final=any(entry.fault.final for entry in stopping.values()),
            recovers=recovers,
            resumes=recovers and all(id in self._resumes for id, _ in stopping),
            alarm=self._alarm,
        )


def _milder(fault: Fault, spare: Collection[str], rows: tuple[str, ...] = ("INP", "NET")) -> Fault:
    """The fault, a warning where it is of such an input, or another device and one of these rows."""
    return replace(fault, severity=Severity.WARN) if fault.device in spare and fault.id.startswith(rows) else fault
