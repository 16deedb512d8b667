"""All robot modes by name, and how the robot goes from one to the next. The place to add a mode, with `machine.py`."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from artemis.drive_states import Goal
from artemis.motion.limits import is_sane
from artemis.progress import MissionEvent
from artemis.states.act import ActMode, Observing
from artemis.states.answers import answers_without_mission
from artemis.states.blocked import heeded
from artemis.states.calibrate import CalibrateMode
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.follow import FollowMode
from artemis.states.goto import take_goal
from artemis.states.init import InitMode
from artemis.states.machine import STEP_MODES, ModeMachine
from artemis.states.mode import ModeLogic
from artemis.states.plan import Shared
from artemis.states.quickstop import QuickstopMode
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.supervision import catalogue
from artemis.values import Action, Cause, Event, Mode, Request, Severity, Snapshot, Verdict, Wish

_END, _END_REQUEST, _QUICKSTOP_REQUEST, _QUICKSTOP = Event.END, Request.END, Request.QUICKSTOP, Mode.QUICKSTOP
RUNNING = (Mode.READY, *STEP_MODES)
"""Modes in which the mission runs; in all others it is as it was."""
_STOPPED = (Mode.QUICKSTOP, Mode.FAULT)
_UNDER_WAY = (Mode.READY, Mode.FOLLOW)
"""Modes of a step `goto`."""
_CONTROLLED_STOP, _QUICK_STOP, _OFF = Severity.CONTROLLED_STOP, Severity.QUICK_STOP, Severity.OFF


class Modes:
    """The present mode and the logic of each; what they share: `Shared`.

    Attributes:
        mode: The present mode.
        failed: A fault or a stop ended the run before its last step, or a drive did not end normally.
        events: What happened in the mission in this tick.
    """

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._machine = ModeMachine()
        self.mode = self._machine.mode
        self._end_requested = self._end_wished = False
        self.failed = False
        self.events: tuple[MissionEvent, ...] = ()
        self._stopped_for = Severity.NONE
        self._step_stopped = False  # the robot is stopped in a step, not in its bring-up
        self._beside = Observing(shared)
        self._logic: dict[Mode, ModeLogic] = {
            Mode.INIT: InitMode(shared),
            Mode.READY: ReadyMode(shared),
            Mode.CALIBRATE: CalibrateMode(shared),
            Mode.TELEOP: TeleopMode(shared),
            Mode.FOLLOW: FollowMode(shared),
            Mode.ACT: ActMode(shared),
            Mode.QUICKSTOP: QuickstopMode(shared),
            Mode.FAULT: FaultMode(shared),
            Mode.END: EndMode(shared),
        }

    def advance(self, snapshot: Snapshot, wished: Event | None) -> Cause | None:
        """Change the mode by the most urgent event that the present one expects; `wished`: what the mode asked for.

        Returns why a mode begins, also where the present one begins anew; None: it lasts.
        """
        verdict, requests = snapshot.verdict, snapshot.sensed.requests
        self._end_requested = self._end_requested or _END_REQUEST in requests
        self._end_wished = self._end_wished or wished is _END
        if _QUICKSTOP_REQUEST in requests or (verdict.stops and not self._may_continue(verdict)):
            self._shared.bring_up.held = True
        for cause in self._causes(verdict, requests, wished):
            if self._machine.fire(cause.event):
                before, self.mode = self.mode, self._machine.mode
                if self.mode not in _STOPPED or before in RUNNING:
                    self._step_stopped = self.mode in _STOPPED
                if cause.event is Event.END and (self._shared.current is not None or verdict.stops):
                    self.failed = True
                self._stopped_for = verdict.severity if self.mode is Mode.QUICKSTOP else Severity.NONE
                self._logic[self.mode].enter(snapshot)
                return cause
        return None

    @property
    def spare(self) -> frozenset[str]:
        """Inputs without which the robot may do what it does now."""
        shared = self._shared
        return shared.spare.difference(shared.needed) if self.mode is Mode.TELEOP else shared.spare

    def _causes(self, verdict: Verdict, requests: tuple[Request, ...], wished: Event | None) -> Iterator[Cause]:
        """What may change the mode, the most urgent first."""
        stop_at = _QUICK_STOP if self.mode is _QUICKSTOP else _CONTROLLED_STOP
        if verdict.to_fault:
            yield Cause(event=Event.FAULT, faults=tuple(fault for fault in verdict.stopping if fault.to_fault))
        if _QUICKSTOP_REQUEST in requests:
            yield Cause(event=Event.STOP, request=Request.QUICKSTOP)
        if verdict.severity >= stop_at and verdict.severity > self._stopped_for:
            yield Cause(event=Event.STOP, faults=verdict.stopping)
        if self._end_requested:
            yield Cause(event=Event.END, request=Request.END)
        if self._end_wished:
            yield Cause(event=Event.END, faults=verdict.stopping)
        if wished is not None:
            yield Cause(event=wished)

    def _may_continue(self, verdict: Verdict) -> bool:
        """Whether the robot may continue by itself after a stop: as the mission says, or with an arm not yet used."""
        return verdict.resumes or (verdict.recovers and self._shared.bring_up.armed)

    def step(self, snapshot: Snapshot) -> Wish:
        """What the present mode wants of this tick, unless nothing but power off is left."""
        shared, verdict, self.events = self._shared, snapshot.verdict, ()
        shared.hands.see(snapshot)
        if verdict.stops and self._step_stopped:
            shared.note_faults(verdict.stopping)
        told = take_goal(shared, snapshot) if self.mode in _UNDER_WAY else ()
        wish = self._logic[self.mode].step(snapshot)
        self.failed = self.failed or wish.failed
        if not is_sane(wish.command):
            wish = replace(wish, fault=catalogue.fault("RUN-11", self.mode.value, repr(wish.command)))
        if self.mode in STEP_MODES:
            wish = heeded(shared, self.mode, wish, snapshot)
        if self.mode in RUNNING:
            wish = self._beside.ask(snapshot, wish)
            entry, ready = shared.entry, self.mode is Mode.READY
            self.events = (*told, *shared.advance(wish, snapshot, standing=ready))
            if ready and wish.event is not _END and (shared.entry != entry or shared.rests or shared.current is None):
                wish = replace(wish, event=None)  # what was to begin is no longer next
        elif snapshot.sensed.answers or snapshot.sensed.typed:
            self.events = answers_without_mission(snapshot.sensed)
        if verdict.severity is _OFF:
            off = replace(wish.command, action=Action.DISABLE)
            wish = replace(wish, command=off, traction=Goal.DISABLED, heartbeat=wish.heartbeat and not verdict.alarm)
        return wish
