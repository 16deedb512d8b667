"""From ticks to the entries of a journal: what happened, why, and the frames that show it. Pure."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from artemis.devices.canopen import NMT
from artemis.families.family import Errors
from artemis.motion.potentiometers import memory_words
from artemis.progress import MissionEvent
from artemis.recording.asked_poses import AskedPoses
from artemis.recording.emergencies import Emergencies
from artemis.recording.journal import Entry, Level
from artemis.recording.schemas import unpack_frames
from artemis.states.outline import is_beside
from artemis.states.requests import accepted, ignored
from artemis.supervision.catalogue import ROWS, emergency
from artemis.supervision.catalogue.row import SHORT
from artemis.supervision.supervisor import ALL_RECOVERIES
from artemis.values import (
    Cause,
    Event,
    Fault,
    Job,
    JobKind,
    JobResult,
    Mode,
    Request,
    Sensed,
    Severity,
    Tick,
    Verdict,
)

EVIDENCE_TIME = 2.0
"""Frames of so many seconds are kept for a fault's entry."""
_STOPPED = (Mode.FAULT, Mode.QUICKSTOP)
_Key = tuple[str, str]


class EventLog:
    """Sees every tick with its frames and tells what is new."""

    def __init__(self, nodes: Mapping[str, int], errors: Errors) -> None:
        """`nodes`: the drives' node ids by their names; `errors`: what their error codes mean."""
        self._nodes, self._errors = nodes, errors
        self._previous: Tick | None = None
        self._verdict = Verdict()
        self._recent: deque[tuple[float, bytes]] = deque()
        self._origin = 0.0
        self._recovered: Counter[str] = Counter()
        self._recoveries = 0
        self._forgotten_by = "person"
        self._emergencies = Emergencies()
        self._poses = AskedPoses()

    @property
    def time(self) -> float:
        """Run time of the last tick [s]."""
        return self._previous.snapshot.time if self._previous else 0.0

    def observe(self, tick: Tick, frames: bytes = b"", now: float = 0.0) -> list[Entry]:
        """What is new in `tick`. Costs little where nothing is.

        Args:
            tick: its values.
            frames: every frame of the tick, as `schemas.pack_frames` packs them; none where nobody reads of them.
            now: the time of the tick [s] by the clock of the frames.
        """
        previous, self._previous = self._previous, tick
        sensed = tick.snapshot.sensed
        self._origin = self._origin if previous else now - sensed.time
        self._keep(sensed.time, frames)
        entries: list[Entry] = []
        if sensed.answers or sensed.typed or sensed.requests:
            entries += self._asked(tick, previous)
        for sample in sensed.inputs:
            if sample.goal is not None or sample.initial_pose is not None:
                entries += self._poses.entries(tick, sample)
        for drive in sensed.drives:
            if drive.emergencies or drive.boots:
                entries += self._emergencies.entries(sensed.time, drive, tick.wish.phase)
        if self._emergencies.counting:
            entries += self._emergencies.passed(sensed.time)
        if tick.snapshot.verdict is not self._verdict:
            entries += self._judged(previous, tick)
        if previous is None or tick.mode is not previous.mode:
            entries += self._changed(previous, tick)
        for event in tick.events:
            data = {"event": event.kind, "place": event.place}
            entries.append(Entry(time=sensed.time, kind="mission", text=happened(event, tick.mode), data=data))
        if tick.wish.phase and (previous is None or tick.wish.phase != previous.wish.phase):
            entries.append(Entry(time=sensed.time, kind="phase", text=tick.wish.phase))
        if sensed.results or tick.wish.jobs:
            entries += _jobs(tick, self._errors)
        return entries

    def end(self) -> list[Entry]:
        """What was still to be told when the last tick was seen."""
        return self._emergencies.passed()

    # -------------------------------------------------------------------------------------------------- frames

    def _keep(self, time: float, frames: bytes) -> None:
        recent = self._recent
        recent.append((time, frames))
        while recent[0][0] < time - EVIDENCE_TIME:
            recent.popleft()

    def _frames(self, time: float, faults: Sequence[Fault]) -> Entry:
        """The last frames of the nodes that the faults are about; of all, where one is about no node."""
        names = dict.fromkeys(fault.device for fault in faults)
        if not names or not all(name in self._nodes for name in names):
            names = dict.fromkeys(self._nodes)
        ids = {self._nodes[name] for name in names}
        found = [
            [round(frame.time - self._origin, 6), "tx" if sent else "rx", f"{frame.id:03X}", frame.data.hex().upper()]
            for _, frames in self._recent
            for sent, frame in unpack_frames(frames)
            if frame.id & 0x7F in ids or frame.id == NMT
        ]
        text = f"{', '.join(names)}: {len(found)} frames of the last {EVIDENCE_TIME:g} s"
        return Entry(time=time, kind="frames", text=text, data={"drives": list(names), "frames": found})

    # -------------------------------------------------------------------------------------------------- requests

    def _asked(self, tick: Tick, previous: Tick | None) -> Iterator[Entry]:
        """Answers and requests."""
        for answer in (*tick.snapshot.sensed.answers, *(typed.text for typed in tick.snapshot.sensed.typed)):
            yield Entry(time=tick.snapshot.time, kind="answer", text=answer)
        yield from self._requests(tick, previous.mode if previous else tick.mode)

    def _requests(self, tick: Tick, mode: Mode) -> Iterator[Entry]:
        """Who asked for what, in which mode; what it leads to, other entries tell, and if to nothing, why."""
        sensed = tick.snapshot.sensed
        by_input = [(request, sample.source) for sample in sensed.inputs for request in sample.requests]
        by_operator = Counter(sensed.requests) - Counter(request for request, _ in by_input)
        for request, source in [*((request, "") for request in by_operator.elements()), *by_input]:
            data = {"request": request.value, "by": source or "operator", "mode": mode.value}
            text = f"{request.value} (by {source})" if source else request.value
            if reason := ignored(request, tick):
                data["ignored"] = reason
                text += f": ignored, {reason}"
            elif taken := accepted(request, tick, self._verdict):
                text += f": {taken}"
            yield Entry(time=sensed.time, kind="request", text=text, data=data)

    # -------------------------------------------------------------------------------------------------- the verdict

    def _judged(self, previous: Tick | None, tick: Tick) -> Iterator[Entry]:
        """Faults that came, grew worse or went, by whom they were forgotten, and what follows from those left."""
        time, sensed, verdict = tick.snapshot.time, tick.snapshot.sensed, tick.snapshot.verdict
        before, self._verdict = self._verdict, verdict
        old, new = by_key(before), by_key(verdict)
        for key, fault in new.items():
            if key not in old or (fault.severity, fault.final) != (old[key].severity, old[key].final):
                yield _fault(time, fault, sensed, self._errors)
        gone = [fault for key, fault in old.items() if key not in new]
        stopped = [fault for fault in gone if fault.severity >= Severity.CONTROLLED_STOP]
        asked = previous is not None and previous.mode in _STOPPED and Request.ACKNOWLEDGE in sensed.requests
        for fault in gone:
            by = ("person" if asked else "artemis") if fault in stopped else "itself"
            data = {"id": fault.id, "device": fault.device, "by": by}
            yield Entry(time=time, kind="cleared", text=named(fault), data=data)
        if stopped:
            self._forgotten_by = "person" if asked else "artemis"
        if asked:
            yield _acknowledged(time, stopped, verdict)
        elif stopped:
            yield self._recovery(time, stopped)
        if _reaction(before) != _reaction(verdict):
            yield _verdict(time, verdict)

    def _recovery(self, time: float, faults: Sequence[Fault]) -> Entry:
        """Artemis itself forgot what stopped the robot: how often it did so."""
        self._recoveries += 1
        told = []
        for id in dict.fromkeys(fault.id for fault in faults):
            self._recovered[id] += 1
            times = ROWS[id].recovery.times
            told.append(f"{id} {self._recovered[id]} of {times} times" if times else id)
        text = f"automatically: {', '.join(told)}; recovery {self._recoveries} of {ALL_RECOVERIES} in this run"
        data = {"faults": _listed(faults), "recoveries": self._recoveries, "at_most": ALL_RECOVERIES}
        return Entry(time=time, kind="recovered", text=text, level=Level.WARNING, data=data)

    # -------------------------------------------------------------------------------------------------- the mode

    def _changed(self, previous: Tick | None, tick: Tick) -> Iterator[Entry]:
        """The mode, with what changed it; into a stop by a verdict also the frames that led there."""
        time, verdict = tick.snapshot.time, tick.snapshot.verdict
        before = previous.mode.value if previous else None
        cause, words = self._told(tick.cause) if previous and tick.cause else ({"event": "start"}, "")
        level = {Mode.FAULT: Level.ERROR, Mode.QUICKSTOP: Level.WARNING}.get(tick.mode, Level.INFO)
        text = f"{before} -> {tick.mode.value}" if before else tick.mode.value
        text += f": {words}" if words else ""
        data = {"from": before, "to": tick.mode.value, "cause": cause}
        yield Entry(time=time, kind="mode", text=text, level=level, data=data)
        if tick.mode in _STOPPED and "faults" in cause:
            yield self._frames(time, verdict.stopping)

    def _told(self, cause: Cause) -> tuple[dict[str, Any], str]:
        """Why a mode began: data, and words."""
        if cause.request is not None:
            return {"request": cause.request.value}, cause.request.value
        if cause.event is Event.ACKNOWLEDGED:
            words = cause.event.value if self._forgotten_by == "person" else "recovered automatically"
            return {"event": cause.event.value, "by": self._forgotten_by}, words
        faults, words = {"faults": _listed(cause.faults)}, [named(fault) for fault in cause.faults]
        if cause.event in (Event.FAULT, Event.STOP):
            return faults, ", ".join(words)
        data = {"event": cause.event.value, **(faults if cause.faults else {})}
        return data, ", ".join([cause.event.value, *words])


# -------------------------------------------------------------------------------------------------- single entries


def named(fault: Fault) -> str:
    """Row and device."""
    return f"{fault.id} {fault.device}".rstrip()


def meaning(code: int, errors: Mapping[int, str]) -> str:
    """An error code of a drive, and what it means: `errors` are its family's rows by code."""
    return f"0x{code:04X} {ROWS[errors[code]].name if code in errors else 'unknown'}"


def happened(event: MissionEvent, mode: Mode) -> str:
    """What happened in a mission, in words; `mode` of that tick."""
    stands = mode is Mode.READY or is_beside(event.place)  # the robot is not stopped for steps beside
    rests = "" if stands else ": coming to rest"
    match event.kind:
        case "ended":
            return f"step ended: {event.text} ({event.place})"
        case "fired":
            return f"condition met: {event.text}{rests}"
        case "expired":
            return f"time limit reached: {event.text}{rests}"
        case "caught":
            return f"outcome {event.text} caught ({event.place})"
        case "end":
            return f"the mission ends: {event.text} ({event.place})"
        case "retry" | "round":
            return f"{event.kind} {event.text}"
    return f"{event.kind}: {event.text}"


def values_of(result: JobResult, errors: Errors) -> str:
    """What a job brought back, in words; `errors`: what the drives' error codes mean."""
    match result.kind:
        case JobKind.READ_HISTORY if result.ok:
            return ", ".join([meaning(code, errors.get(result.drive, {})) for code in result.values]) or "empty"
        case JobKind.CLEAR_TARGET if result.values:
            return f"stale set-point {result.values[0]} cleared"
        case JobKind.READ_CALIBRATION if result.ok:
            return f"keeps {memory_words(result.values)}"
    return ""


def _fault(time: float, fault: Fault, sensed: Sensed, errors: Errors) -> Entry:
    row = ROWS[fault.id]
    level = Level.ERROR if fault.severity >= Severity.CONTROLLED_STOP else Level.WARNING
    data: dict[str, Any] = {
        "id": fault.id,
        "device": fault.device,
        "severity": fault.severity.name,
        "recovery": "not in this run" if fault.final else row.recovery.kind.value,
    }
    codes = [code for drive in sensed.drives if drive.name == fault.device for code in drive.emergencies]
    for code in codes:
        if code and emergency(fault.device, code, errors[fault.device]).id == fault.id:
            data["code"] = code
    return Entry(time=time, kind="fault", text=f"{fault.id} {fault.text}", level=level, data=data)


def _acknowledged(time: float, forgotten: Sequence[Fault], verdict: Verdict) -> Entry:
    """A person acknowledged: what was forgotten, and what is still there."""
    left = verdict.stopping
    kind = "acknowledged" if forgotten else "refused"
    text = ", ".join(map(named, forgotten)) if forgotten else "acknowledge"
    text += f"; still there: {', '.join(map(named, left))}" if left else ""
    level = Level.WARNING if left else Level.INFO
    return Entry(
        time=time, kind=kind, text=text, level=level, data={"faults": _listed(forgotten), "left": _listed(left)}
    )


def _verdict(time: float, verdict: Verdict) -> Entry:
    words = [SHORT.get(verdict.severity, "nothing is wrong")]
    words += ["leads to fault"] * verdict.to_fault
    words += ["recovers automatically"] * verdict.recovers + ["and continues"] * verdict.resumes
    words += ["not in this run"] * verdict.final
    words += ["PRESS THE EMERGENCY STOP: the robot does not stop"] * verdict.alarm
    data = {
        "severity": verdict.severity.name,
        "faults": _listed(verdict.faults),
        "to_fault": verdict.to_fault,
        "final": verdict.final,
        "recovers": verdict.recovers,
        "resumes": verdict.resumes,
        "alarm": verdict.alarm,
    }
    level = Level.ERROR if verdict.alarm else Level.WARNING if verdict.stops else Level.INFO
    return Entry(time=time, kind="verdict", text=", ".join(words), level=level, data=data)


def _jobs(tick: Tick, errors: Errors) -> Iterator[Entry]:
    """Orders and what became of them, but for looks at drives that are off as they should be."""
    time = tick.snapshot.time
    for result in tick.snapshot.sensed.results:
        if result.kind is JobKind.KEEP_OFF and not result.values:
            continue
        outcome = "done" if result.ok else "failed"
        text = f"{result.kind.value} {result.drive}: {outcome}" + (f", {result.detail}" if result.detail else "")
        if told := values_of(result, errors):
            text += f": {told}"
        level = Level.INFO if result.ok else Level.WARNING
        data = {**_order(result), "ok": result.ok, "values": list(result.values)}
        if result.kind in (JobKind.PLAN, JobKind.FIT):
            data["values"] = []  # a route: the recording has it
        if result.fault:
            data["fault"] = result.fault
        yield Entry(time=time, kind="result", text=text, level=level, data=data)
    for job in tick.wish.jobs:
        if job.kind is JobKind.KEEP_OFF:
            continue
        data = {**_order(job), "value": job.value}
        yield Entry(time=time, kind="job", text=f"{job.kind.value} {job.drive}", data=data)


def _order(job: Job | JobResult) -> dict[str, Any]:
    return {"id": job.id, "job": job.kind.value, "drive": job.drive}


def by_key(verdict: Verdict) -> dict[_Key, Fault]:
    """The faults of a verdict by row and device."""
    return {(fault.id, fault.device): fault for fault in verdict.faults}


def _reaction(verdict: Verdict) -> tuple[object, ...]:
    return verdict.severity, verdict.to_fault, verdict.final, verdict.recovers, verdict.resumes, verdict.alarm


def _listed(faults: Sequence[Fault]) -> list[dict[str, str]]:
    return [{"id": fault.id, "device": fault.device} for fault in faults]
