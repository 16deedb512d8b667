"""All robot modes by name, and how the robot goes from one to the next. The place to add a mode, with `machine.py`."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.states.calibrate import CalibrateMode
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.follow import FollowMode
from artemis.states.init import InitMode
from artemis.states.machine import ModeMachine
from artemis.states.mode import ModeLogic
from artemis.states.plan import Shared, advance
from artemis.states.quickstop import QuickstopMode
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.values import Action, Event, Goal, Mode, Request, Severity, Snapshot, Verdict, Wish


class Modes:
    """The present mode and the logic of each; what they share: `Shared`.

    Attributes:
        failed: A fault or a stop ended the run before its last step, or a drive did not end in order.
    """

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._machine = ModeMachine()
        self._ending = False
        self.failed = False
        self._stopped_for = Severity.NONE
        self._logic: dict[Mode, ModeLogic] = {
            Mode.INIT: InitMode(shared),
            Mode.READY: ReadyMode(shared),
            Mode.CALIBRATE: CalibrateMode(shared),
            Mode.TELEOP: TeleopMode(shared),
            Mode.FOLLOW: FollowMode(shared),
            Mode.QUICKSTOP: QuickstopMode(shared),
            Mode.FAULT: FaultMode(shared),
            Mode.END: EndMode(shared),
        }

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._machine.mode

    def advance(self, snapshot: Snapshot, wished: Event | None) -> Mode:
        """Change the mode by the most urgent event that the present one expects; `wished`: what the mode asked for."""
        verdict, requests = snapshot.verdict, snapshot.sensed.requests
        stop_at = Severity.QUICK_STOP if self.mode is Mode.QUICKSTOP else Severity.CONTROLLED_STOP
        self._ending = self._ending or Request.END in requests or wished is Event.END
        if Request.QUICKSTOP in requests or (verdict.stops and not self._may_go_on(verdict)):
            self._shared.bring_up.held = True
        for event in (
            Event.FAULT if verdict.to_fault else None,
            Event.STOP if Request.QUICKSTOP in requests else None,
            Event.STOP if verdict.severity >= stop_at and verdict.severity > self._stopped_for else None,
            Event.END if self._ending else None,
            wished,
        ):
            if event is not None and self._machine.fire(event):
                if event is Event.END and (self._shared.current is not None or verdict.stops):
                    self.failed = True
                self._stopped_for = verdict.severity if self.mode is Mode.QUICKSTOP else Severity.NONE
                self._logic[self.mode].enter(snapshot)
                break
        return self.mode

    def _may_go_on(self, verdict: Verdict) -> bool:
        """Whether what stops the robot may let it go on by itself: as the mission says, or with an arm not yet used."""
        return verdict.resumes or (verdict.recovers and self._shared.bring_up.armed)

    def step(self, snapshot: Snapshot) -> Wish:
        """What the present mode wants of this tick, unless nothing but power off is left."""
        wish, verdict = self._logic[self.mode].step(snapshot), snapshot.verdict
        self.failed = self.failed or wish.failed
        self._shared.position = advance(self._shared.position, wish)
        if verdict.severity is Severity.OFF:
            off = replace(wish.command, action=Action.DISABLE)
            wish = replace(wish, command=off, traction=Goal.DISABLED, heartbeat=wish.heartbeat and not verdict.alarm)
        return wish
