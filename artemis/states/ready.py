"""Mode ready: enabled and standing; where each step of the mission begins and ends."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.states.goto import RoutePlanning
from artemis.states.mode import PATIENCE, at_rest, give_up
from artemis.states.plan import (
    AskStep,
    BehaviourStep,
    CalibrateStep,
    FollowStep,
    GotoStep,
    Shared,
    TeleopStep,
    WaitStep,
)
from artemis.states.priority import heard
from artemis.states.recorded import TrackFitting
from artemis.values import DriveCommand, Event, Snapshot, Wish


class ReadyMode:
    """Starts the next step of the plan, or the ordered end after the last."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self._planning, self._fitting = RoutePlanning(shared), TrackFitting(shared)

    def enter(self, snapshot: Snapshot) -> None:
        """A step has ended, or the bring-up; a wait that was interrupted resumes."""
        self._entry = self.shared.entry
        self._planning.begin()
        self._fitting.begin()
        self._since, self._last = snapshot.time - self.shared.position.done, snapshot.time

    def step(self, snapshot: Snapshot) -> Wish:
        """Stand, and ask for the mode of the plan's current step."""
        shared = self.shared
        if shared.entry != self._entry:  # in the tick before
            self._entry, self._since = shared.entry, self._last - shared.position.done
        self._last = snapshot.time
        stand = replace(at_rest(shared.plan), command=DriveCommand(steering=snapshot.set_points.steering))
        match shared.current:
            case None:
                return replace(stand, event=Event.END, failed=shared.position.ended != "")
            case CalibrateStep():
                return replace(stand, event=Event.CALIBRATE)
            case GotoStep() as step:
                return self._planning.step(step, stand, snapshot)
            case FollowStep(route=str()) as step:
                return self._fitting.step(step, stand, snapshot)
            case FollowStep():
                return replace(stand, event=Event.FOLLOW)
            case BehaviourStep():
                return replace(stand, event=Event.ACT)
            case TeleopStep(inputs=names) as step:
                if held := shared.hands.held(snapshot, names):
                    if snapshot.time - self._since - shared.position.done <= PATIENCE:
                        return replace(stand, phase=held)
                    return give_up(replace(stand, phase=held), late=True)
                shared.hands.released = heard(names, step.stale, snapshot.sensed.inputs)
                return replace(stand, event=Event.TELEOP)
        return self._wait(stand, snapshot)

    def _wait(self, stand: Wish, snapshot: Snapshot) -> Wish:
        """A step that moves nothing: a question ends the run where no operator can answer."""
        step, done = self.shared.current, snapshot.time - self._since
        if isinstance(step, AskStep):
            phase = f"{step.question} ({', '.join(f'{n} {word}' for n, word in enumerate(step.answers, start=1))})"
            stand = replace(stand, done=done, phase=phase)
            if step.at_most is None and (done > PATIENCE or not snapshot.sensed.attended):
                alone = not snapshot.sensed.attended
                return give_up(
                    replace(stand, phase=f"no operator can answer: {phase}") if alone else stand, late=not alone
                )
            return stand
        over = isinstance(step, WaitStep) and step.seconds is not None and done >= step.seconds
        return replace(stand, done=done, over=over, phase="waiting")
