"""Mode teleop: an operator's input becomes the vehicle's command; of several inputs the first that is active."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.motion.track import Track
from artemis.states.mode import ON
from artemis.states.plan import Shared, TeleopStep
from artemis.states.priority import Priority, asked
from artemis.values import DriveCommand, Event, OperatorInput, Request, Severity, Snapshot, Wish


class TeleopMode:
    """Drives as the inputs of the present step say, while an enable button is held."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared

    def enter(self, snapshot: Snapshot) -> None:
        """The step begins, or resumes after it was interrupted; `hands` knows which controls were at rest."""
        self._anew = not self.shared.position.done
        self._since, self._ending = snapshot.time - self.shared.position.done, False
        if isinstance(step := self.shared.current, TeleopStep):
            self._priority = Priority([name in self.shared.hands.released for name in step.inputs], step.stale)

    def step(self, snapshot: Snapshot) -> Wish:
        """The operator's wish; standing still when the enable button is up; done when asked and at rest."""
        step = self.shared.current
        if not isinstance(step, TeleopStep):
            return replace(ON, event=Event.DONE)
        done = snapshot.time - self._since
        return replace(self._drive(step, done, snapshot), done=done)

    def _drive(self, step: TeleopStep, done: float, snapshot: Snapshot) -> Wish:
        """As the operator says, `done` [s] after the step began."""
        given = {sample.source: sample for sample in snapshot.sensed.inputs}
        samples = [given.get(name) or OperatorInput(source=name) for name in step.inputs]
        stand = DriveCommand(steering=snapshot.set_points.steering)
        if self._anew:  # what an earlier step recorded under this name is forgotten
            self.shared.results.tracks.pop(step.record, None)
            self._anew = False
        if step.record and not snapshot.pose.lost:
            track = self.shared.results.tracks.setdefault(step.record, Track())
            track.see(snapshot.pose.pose, pressed=asked(Request.RECORD, samples))
        over = step.seconds is not None and done >= step.seconds
        self._ending = self._ending or over or asked(Request.DONE, samples)
        if self._ending and snapshot.standing:
            return replace(ON, command=stand, event=Event.DONE, over=True)
        if self.shared.rests and snapshot.standing:
            return replace(ON, command=stand, event=Event.DONE)
        if self._ending or self.shared.rests:
            return replace(ON, command=stand, phase="stopping")
        turn = self._priority.decide(samples, standing=snapshot.standing)
        self.shared.needed = step.inputs[: turn.needed]
        unheard = self._priority.unheard(samples)
        fatal = [fault for fault in unheard if fault.device in self.shared.needed]
        if fatal:
            return replace(ON, command=stand, fault=fatal[0])
        wish = replace(ON, fault=replace(unheard[0], severity=Severity.WARN)) if unheard else ON
        if turn.active is None:
            return replace(wish, command=stand, phase=f"hold {step.enabled_by} to drive")
        if not turn.drives:
            which = f" of {samples[turn.active].source}" if step.lower else ""
            again = f"release {step.enabled_by}{which}, and press it again at standstill"
            return replace(wish, command=stand, phase=again if turn.rested else f"release all controls{which}")
        sample = samples[turn.active]
        phase = f"driving: {sample.source}" if step.lower else "driving"
        return replace(wish, command=DriveCommand(speed=sample.speed, steering=sample.steering), phase=phase)
