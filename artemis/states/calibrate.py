"""Mode calibrate: align the wheels again from the potentiometers, or measure what the robot has to know of itself."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.states.alignment import align, enable
from artemis.states.gains import GainsStep, TurnStep, try_gains, turn
from artemis.states.mode import OFF, ON, Routine, RoutineMode
from artemis.states.plan import CalibrateStep
from artemis.states.steering import SteeringStep, calibrate_steering
from artemis.values import DriveCommand, Event, Snapshot


class CalibrateMode(RoutineMode):
    """The step `calibrate`, of any kind."""

    def routine(self, snapshot: Snapshot) -> Routine:
        """As the step says, then done; the run is over where the wheels could not be aligned, or nothing is to come."""
        shared, plan = self.shared, self.plan
        match shared.current:
            case SteeringStep() as step:
                snapshot = yield from calibrate_steering(shared, step, snapshot)
            case GainsStep() as step:
                snapshot = yield from try_gains(shared, step, snapshot)
            case TurnStep() as step:
                snapshot = yield from turn(shared, step, snapshot)
            case _ if plan.robot.has_potentiometers:
                snapshot = yield from align(shared, snapshot)
        is_last = shared.tree.is_list and shared.current is plan.steps[-1]
        if plan.blind or (type(shared.current) is not CalibrateStep and is_last):
            yield replace(OFF, event=Event.END, over=True, phase="calibrated")
        snapshot = yield from enable(shared, ON, snapshot)
        stand = replace(ON, command=DriveCommand(steering=snapshot.set_points.steering))
        yield replace(stand, event=Event.DONE, over=True, phase="aligned")
        while True:
            yield stand
