"""Mode ready: enabled and standing; where each step of the mission begins and ends."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.states.mode import PATIENCE, at_rest, give_up, hands_on
from artemis.states.plan import CalibrateStep, FollowStep, Shared, TeleopStep
from artemis.values import DriveCommand, Event, Snapshot, Wish


class ReadyMode:
    """Starts the next step of the plan, or the ordered end after the last."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared

    def enter(self, snapshot: Snapshot) -> None:
        """A step has ended, or the bring-up; a wait that was interrupted goes on."""
        self._since = snapshot.time - self.shared.position.done

    def step(self, snapshot: Snapshot) -> Wish:
        """Stand, and ask for the mode of the plan's current step."""
        stand = replace(at_rest(self.shared.plan), command=DriveCommand(steering=snapshot.set_points.steering))
        match self.shared.current:
            case None:
                return replace(stand, event=Event.END)
            case CalibrateStep():
                return replace(stand, event=Event.CALIBRATE)
            case FollowStep():
                return replace(stand, event=Event.FOLLOW)
            case TeleopStep(input=name):
                if held := hands_on(sample for sample in snapshot.sensed.inputs if sample.source == name):
                    if snapshot.time - self._since - self.shared.position.done <= PATIENCE:
                        return replace(stand, phase=held)
                    return give_up(replace(stand, phase=held), late=True)
                return replace(stand, event=Event.TELEOP)
            case wait:
                done = snapshot.time - self._since
                if over := done >= wait.seconds:
                    self._since = snapshot.time
                return replace(stand, done=done, over=over, phase="waiting")
