"""Mode teleop: an operator's input becomes the vehicle's command."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.motion.track import Track
from artemis.states.mode import ON
from artemis.states.plan import Shared, TeleopStep
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Event, OperatorInput, Request, Snapshot, Wish

STALE = 0.15
"""A sample older than this [s] stops the robot: the device is frozen or gone (INP-03)."""


class TeleopMode:
    """Drives as the input of the present step says, while its enable button is held."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared

    def enter(self, snapshot: Snapshot) -> None:
        """The controls were neutral when the step began, or went on after it was interrupted."""
        self._since, self._ending, self._released = snapshot.time - self.shared.position.done, False, True

    def step(self, snapshot: Snapshot) -> Wish:
        """The operator's wish; standing still when the enable button is up; done when asked and at rest."""
        step = self.shared.current
        if not isinstance(step, TeleopStep):
            return replace(ON, event=Event.DONE)
        done = snapshot.time - self._since
        return replace(self._drive(step, done, snapshot), done=done)

    def _drive(self, step: TeleopStep, done: float, snapshot: Snapshot) -> Wish:
        """As the operator says, `done` [s] after the step began."""
        sample = next((i for i in snapshot.sensed.inputs if i.source == step.input), OperatorInput(source=step.input))
        stand = DriveCommand(steering=snapshot.set_points.steering)
        if step.record and not snapshot.pose.lost:
            track = self.shared.results.tracks.setdefault(step.record, Track())
            track.see(snapshot.pose.pose, pressed=Request.RECORD in sample.requests)
        over = step.seconds is not None and done >= step.seconds
        self._ending = self._ending or over or Request.DONE in sample.requests
        if self._ending and snapshot.standing:
            return replace(ON, command=stand, event=Event.DONE, over=True)
        if self._ending:
            return replace(ON, command=stand, phase="stopping")
        if sample.age is None or sample.age > STALE:
            unheard = catalogue.fault("INP-01" if sample.age is None else "INP-03", step.input)
            return replace(ON, command=stand, fault=unheard)
        if not sample.enabled:
            self._released = snapshot.standing  # a press that comes sooner does not count (INP-09)
            return replace(ON, command=stand, phase=f"hold {step.enabled_by} to drive")
        if not self._released:
            return replace(ON, command=stand, phase=f"release {step.enabled_by}, and press it again at standstill")
        return replace(ON, command=DriveCommand(speed=sample.speed, steering=sample.steering), phase="driving")
