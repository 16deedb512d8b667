"""Where the wheels stand on a robot whose steering angle nothing measures: straight by hand, or from a hard stop.

The motor looks for its stop by set-points that pass the gate, as they do when the robot drives: no drive needs another
mode of operation for it, and a stop of the robot stops this, too.
"""

from __future__ import annotations

from math import copysign, degrees, radians

from msgspec.structs import replace

from artemis.axles import ByHand, HardStop
from artemis.motion.ackermann import Ackermann
from artemis.states.alignment import align, do, enable, steer, switch_off
from artemis.states.mode import OFF, ON, PATIENCE, STEERING_ON, Failed, Routine
from artemis.states.plan import Shared
from artemis.supervision import catalogue
from artemis.values import DriveCommand, DriveFeedback, JobKind, Request, Snapshot

STRAIGHT = "set the wheels straight by hand, then accept (enter)"
READ_TIME = 0.5
"""Nobody reads a question faster [s]."""
SLOW = radians(10.0)
"""The motor looks for its stop at this rate [rad/s]: it meets it softly."""
HELD = radians(0.5)
"""It is held when it stays so far behind its set-point [rad]; at that rate a free one is 0.2 degrees behind."""
ROUNDS = 2
"""The gate lets it turn from lock to lock, and the stops are farther apart: by less than as far again."""


def find_angles(shared: Shared, snapshot: Snapshot) -> Routine:
    """Tell the steering drives where they stand, by what the robot has for it; then enable traction."""
    source = shared.plan.robot.angle_source("left")
    if isinstance(source, ByHand):
        snapshot = yield from _ask_straight(snapshot)
        snapshot = yield from _take(shared, 0.0, snapshot)
    elif isinstance(source, HardStop):
        snapshot = yield from _from_stop(shared, source, snapshot)
    else:
        return (yield from align(shared, snapshot))
    snapshot = yield from steer(shared.plan, 0.0, snapshot, {})
    return (yield from enable(shared.plan, ON, snapshot))


def _ask_straight(snapshot: Snapshot) -> Routine:
    """Drives off: wait until a person says that the wheels stand straight."""
    begun = snapshot.time
    while Request.ACCEPT not in snapshot.sensed.requests or snapshot.time < begun + READ_TIME:
        if not snapshot.sensed.attended or snapshot.time > begun + PATIENCE:
            raise Failed(OFF, catalogue.fault("CAL-01", "", f"no answer from the operator: {STRAIGHT}"))
        snapshot = yield replace(OFF, phase=STRAIGHT)
    return snapshot


def _take(shared: Shared, angle: float, snapshot: Snapshot) -> Routine:
    """Have all steering drives, which are off, count from `angle` [rad] where they stand now, and enable them."""
    names = shared.plan.drives("steering")
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.REFERENCE, names, [angle] * len(names)), snapshot)
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.CLEAR_TARGET, shared.plan.drives()), snapshot)
    return (yield from enable(shared.plan, STEERING_ON, snapshot))


def _from_stop(shared: Shared, source: HardStop, snapshot: Snapshot) -> Routine:
    """Turn slowly towards the stop until the motor is held there: that is its angle.

    What it counts before is not where it stands, so it begins at the far lock, and once more if that is not enough.
    """
    (name,) = shared.plan.drives("steering")
    car, limit = Ackermann(shared.plan.robot.geometry), radians(shared.plan.robot.limits.steering_deg)
    towards = copysign(1.0, source.stop_deg)
    (begin, _), (end, _) = car.wheel_angles(-towards * limit), car.wheel_angles(towards * limit)
    for _ in range(ROUNDS):
        snapshot = yield from switch_off(shared, OFF, snapshot)
        snapshot = yield from _take(shared, begin, snapshot)
        told = begin
        while towards * (end - told) > 0.0:
            told += towards * SLOW * snapshot.dt
            command = DriveCommand(steering=car.steering_from_left(told))
            snapshot = yield replace(STEERING_ON, command=command, phase="looking for the hard stop")
            drive = _drive(snapshot, name)
            if towards * (snapshot.set_points.steering_left - drive.position) > HELD:
                held = drive.position
                wish = replace(OFF, command=DriveCommand(steering=snapshot.set_points.steering))
                snapshot = yield from switch_off(shared, wish, snapshot)
                sprung = _drive(snapshot, name).position - held
                return (yield from _take(shared, radians(source.stop_deg) + sprung, snapshot))
    seen = f"no hard stop within {ROUNDS * degrees(abs(end - begin)):.0f} degrees"
    raise Failed(STEERING_ON, catalogue.fault("CAL-01", name, seen))


def _drive(snapshot: Snapshot, name: str) -> DriveFeedback:
    return next(drive for drive in snapshot.sensed.drives if drive.name == name)
