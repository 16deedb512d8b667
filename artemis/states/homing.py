"""Where the wheels stand on a robot without potentiometers: by a person, a hard stop, a home switch, or encoders.

The motor looks for its stop or its switch by set-points that pass the gate, as they do when the robot drives: no drive
needs another mode of operation for it, and a stop of the robot stops this, too.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from math import copysign, degrees, radians

from msgspec.structs import replace

from artemis.axles import SWITCH_MARGIN_DEG, AbsoluteEncoder, ByHand, HardStop, HomeSwitch
from artemis.families.family import HOME_INPUT
from artemis.motion.ackermann import Ackermann
from artemis.motion.potentiometers import encoder_angle
from artemis.states.alignment import align, do, enable, steer, switch_off
from artemis.states.mode import OFF, ON, PATIENCE, STEERING_ON, Failed, Routine, feedback, give_up, may_answer
from artemis.states.plan import Shared
from artemis.supervision import catalogue
from artemis.values import DriveCommand, DriveFeedback, Fault, JobKind, Request, Snapshot, Wish

STRAIGHT = "set the wheels straight by hand, then accept (enter)"
READ_TIME = 0.5
"""Nobody reads a question faster [s]."""
SLOW = radians(10.0)
"""The motor looks for its stop, or its switch, at this rate [rad/s]: it meets it softly."""
CREEP = radians(0.5)
"""It meets a switch once more at this rate [rad/s]: within a tick of 20 ms it turns by 0.01 degrees."""
BACK = radians(SWITCH_MARGIN_DEG)
"""So far from the switch it begins to creep, and so far it creeps beyond where it saw the switch first [rad]."""
HELD, TURNED, MESSAGES = radians(0.5), 0.25, 3
"""It is held when it is so far behind its set-point [rad] and still turns by less than this part of what is commanded
from one of its messages to the next, so many in a row: one may be older than the set-point, and a late computer makes a
large step."""
ROUNDS = 2
"""The gate lets it turn from lock to lock, and the stops are farther apart: by less than as far again."""
AWAY = radians(5.0)
"""So far the motor turns back from where it was held [rad], before it meets that place once more."""
AGAIN = radians(0.5)
"""A stop holds it twice within this [rad]. What held it for a moment is gone, or elsewhere."""
MEETINGS = 4
"""After being held so often, never twice at one place, it gives up."""
TRAVEL = radians(2.0)
"""Travel between both stops may differ so much from the robot file's [rad]: `scale` may not be calibrated yet."""
BEYOND = radians(20.0)
"""No wheel stands farther beyond the largest angle of the gate [rad]."""
ROUND_TRIP = 0.02
"""What a drive says of its motor is older than the set-points at most by this, in an orderly run [s]."""

Turned = Generator[Wish, Snapshot, tuple[bool, Snapshot]]
"""Of a routine that turns the motor: whether it ended as it was to."""
Stopped = Generator[Wish, Snapshot, tuple[float, Snapshot]]
"""Of a routine that turns the motor until a stop holds it: where [rad]."""
Met = Generator[Wish, Snapshot, tuple[float | None, Snapshot]]
"""Of a routine that turns the motor: where it was held [rad]; None: nowhere."""


def lag_of_search(period: float) -> float:
    """How far behind its set-point [rad] a motor is held until a stop is known, with set-points every `period` [s].

    Its drive must not take so much for a fault. One of the messages in a row may begin late, and the last set-point is
    taken over after them.
    """
    return HELD + SLOW * ((MESSAGES + 2) * period + ROUND_TRIP)


def find_angles(shared: Shared, snapshot: Snapshot) -> Routine:
    """Tell the steering drives where they stand, by what the robot has for it; then enable traction."""
    source = shared.plan.robot.angle_source("left")
    match source:
        case ByHand():
            snapshot = yield from _ask_straight(snapshot)
            snapshot = yield from _take(shared, [0.0] * len(shared.plan.drives("steering")), snapshot)
        case HardStop():
            snapshot = yield from _from_stop(shared, source, snapshot)
        case HomeSwitch():
            snapshot = yield from _from_switch(shared, source, snapshot)
        case AbsoluteEncoder():
            snapshot = yield replace(OFF, phase="reading absolute encoders")
            snapshot = yield from _take(shared, _shown(shared, snapshot), snapshot)
        case _:
            return (yield from align(shared, snapshot))
    snapshot = yield from steer(shared.plan, 0.0, snapshot, {})
    return (yield from enable(shared, ON, snapshot))


def _ask_straight(snapshot: Snapshot) -> Routine:
    """Drives off: wait until a person says that the wheels stand straight."""
    begun = snapshot.time
    while Request.ACCEPT not in snapshot.sensed.requests or snapshot.time < begun + READ_TIME:
        late = snapshot.time > begun + PATIENCE
        if late or not may_answer(snapshot):
            alone = replace(OFF, phase=f"no operator can accept: {STRAIGHT}")
            snapshot = yield give_up(replace(OFF, phase=STRAIGHT) if late else alone, late=late)
        else:
            snapshot = yield replace(OFF, phase=STRAIGHT)
    return snapshot


def _take(shared: Shared, angles: Sequence[float], snapshot: Snapshot) -> Routine:
    """Have the steering drives, which are off, count from these angles [rad] where they stand now, and enable them."""
    names = shared.plan.drives("steering")
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.REFERENCE, names, angles), snapshot)
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.CLEAR_TARGET, shared.plan.drives()), snapshot)
    return (yield from enable(shared, STEERING_ON, snapshot))


def _shown(shared: Shared, snapshot: Snapshot) -> list[float]:
    """Angles of the steering motors [rad] by one reading of their absolute encoders, in the order of the drives.

    Raises:
        Failed: one of them shows what its wheel cannot turn to.
    """
    robot, angles = shared.plan.robot, []
    ends = [Ackermann(robot.geometry).wheel_angles(end * radians(robot.limits.steering_deg)) for end in (-1.0, 1.0)]
    for name in shared.plan.drives("steering"):
        side = robot.drives[name].side
        source = robot.angle_source(side)
        assert isinstance(source, AbsoluteEncoder)  # checked when the file was read: all sides have the same
        angle = encoder_angle(feedback(snapshot, name).angle_sensor, source)
        right, left = (each[side == "right"] for each in ends)
        if not right - BEYOND <= angle <= left + BEYOND:
            seen = f"its absolute encoder shows {degrees(angle):.0f} degrees, farther than the wheel turns"
            raise Failed(OFF, catalogue.fault("CAL-03", name, seen))
        angles.append(angle)
    return angles


def _from_stop(shared: Shared, source: HardStop, snapshot: Snapshot) -> Routine:
    """Turn slowly towards the stop until it holds the motor: that is its angle, if the other side fits to it."""
    (name,) = shared.plan.drives("steering")
    towards, stop = copysign(1.0, source.stop_deg), radians(source.stop_deg)
    _, snapshot = yield from _to_stop(shared, name, towards, "looking for the hard stop", snapshot)
    snapshot = yield from _take_held(shared, name, stop, snapshot)
    phase = "trying the other side"
    near, far = _locks(shared, -towards)
    place, snapshot = yield from _meet(shared, name, near, far, phase, snapshot)
    if place is not None:
        seen = f"held at {degrees(place):.1f} of {degrees(far):.1f} degrees to the other side: what held it is no stop"
        raise Failed(STEERING_ON, catalogue.fault("CAL-03", name, seen))
    snapshot = yield from steer(shared.plan, _virtual(shared, far), snapshot, {}, phase)
    if source.travel_deg is None:
        return snapshot
    place, snapshot = yield from _to_stop(shared, name, -towards, phase, snapshot)
    travel = abs(stop - place)
    if abs(travel - radians(source.travel_deg)) > TRAVEL:
        seen = f"{degrees(travel):.1f} degrees between its hard stops: the robot file says {source.travel_deg:g}"
        raise Failed(STEERING_ON, catalogue.fault("CAL-03", name, seen))
    return (yield from _take_held(shared, name, place, snapshot))


def _to_stop(shared: Shared, name: str, towards: float, phase: str, snapshot: Snapshot) -> Stopped:
    """Turn slowly `towards` a side (1: left) until a stop holds the motor: where, as it counted before.

    The gate lets it turn from lock to lock: for each such turn it counts anew, from as near to the far lock as leaves
    room to turn back.
    """
    near, far = _locks(shared, towards)
    begin, before = near + towards * min(AWAY, abs(far - near) / 4.0), 0.0
    for _ in range(ROUNDS):
        snapshot = yield from _release(shared, snapshot)
        before += feedback(snapshot, name).position - begin
        snapshot = yield from _take(shared, [begin], snapshot)
        place, snapshot = yield from _meet(shared, name, begin, far, phase, snapshot)
        if place is not None:
            return before + place, snapshot
    raise Failed(STEERING_ON, _not_found(name, "no hard stop", far - begin))


def _meet(shared: Shared, name: str, begin: float, end: float, phase: str, snapshot: Snapshot) -> Met:
    """Turn the motor slowly from `begin` to `end` [rad]. Where it is held it turns back, and meets that place again.

    Only what holds it twice at one place counts. What lets it go in the meantime, as a lost set-point or a wheel that
    is blocked both ways, does not: it turns back before.
    """
    towards, last = copysign(1.0, end - begin), None
    near, _ = _locks(shared, towards)
    for _ in range(MEETINGS):
        is_held, snapshot = yield from _turn(shared, begin, end, SLOW, _Held(name, towards), phase, snapshot)
        if not is_held:
            return None, snapshot
        place = feedback(snapshot, name).position
        if last is not None and abs(place - last) <= AGAIN:
            return place, snapshot
        last, begin = place, towards * max(towards * place - AWAY, towards * near)
        snapshot = yield from steer(shared.plan, _virtual(shared, begin), snapshot, {}, phase)
    raise Failed(STEERING_ON, catalogue.fault("CAL-03", name, f"held {MEETINGS} times, never twice at one place"))


def _take_held(shared: Shared, name: str, angle: float, snapshot: Snapshot) -> Routine:
    """Have the motor count from `angle` [rad] where it is held: switched off, it may spring back."""
    held = feedback(snapshot, name).position
    snapshot = yield from _release(shared, snapshot)
    return (yield from _take(shared, [angle + feedback(snapshot, name).position - held], snapshot))


def _release(shared: Shared, snapshot: Snapshot) -> Routine:
    """Switch off; the set-point stays where it is."""
    wish = replace(OFF, command=DriveCommand(steering=snapshot.set_points.steering))
    return (yield from switch_off(shared, wish, snapshot))


def _from_switch(shared: Shared, source: HomeSwitch, snapshot: Snapshot) -> Routine:
    """Look for where the switch changes; then meet it once more, slower and always from the side where it is off."""
    (name,) = shared.plan.drives("steering")
    phase, place = "looking for the home switch", radians(source.switch_deg)
    on_side = 1.0 if source.on_side == "left" else -1.0
    was_on = _is_on(feedback(snapshot, name))
    towards = -on_side if was_on else on_side
    is_held = _Held(name, towards)

    def is_over(now: Snapshot) -> bool:
        return is_held(now) or _is_on(feedback(now, name)) is not was_on

    found = False
    for _ in range(ROUNDS):
        if not found:
            found, snapshot = yield from _search(shared, towards, is_over, phase, snapshot)
    if not found:
        right, left = _locks(shared, 1.0)
        raise Failed(STEERING_ON, _not_found(name, "no change of the home switch", left - right))
    if _is_on(feedback(snapshot, name)) is was_on:
        raise Failed(STEERING_ON, catalogue.fault("CAL-03", name, "held before its home switch changes"))
    snapshot = yield from _release(shared, snapshot)
    snapshot = yield from _take(shared, [place], snapshot)
    begin, end = place - on_side * BACK, place + on_side * BACK
    snapshot = yield from steer(shared.plan, _virtual(shared, begin), snapshot, {}, phase)
    before = feedback(snapshot, name)
    if _is_on(before):
        raise Failed(STEERING_ON, catalogue.fault("CAL-03", name, "its home switch is on to both sides of its place"))
    positions = [before.position]

    def is_on(now: Snapshot) -> bool:
        positions.append(feedback(now, name).position)
        return _is_on(feedback(now, name))

    found, snapshot = yield from _turn(shared, begin, end, CREEP, is_on, phase, snapshot)
    if not found:
        raise Failed(
            STEERING_ON, catalogue.fault("CAL-03", name, "its home switch closes at another place than before")
        )
    edge = (positions[-2] + positions[-1]) / 2.0
    snapshot = yield from _release(shared, snapshot)
    return (yield from _take(shared, [place + feedback(snapshot, name).position - edge], snapshot))


def _search(shared: Shared, towards: float, ends: Callable[[Snapshot], bool], phase: str, snapshot: Snapshot) -> Turned:
    """Turn slowly `towards` a side (1: left) until `ends`; whether that was on the way from lock to lock.

    What the motor counts is not where it stands, so it begins at the far lock.
    """
    begin, end = _locks(shared, towards)
    snapshot = yield from switch_off(shared, OFF, snapshot)
    snapshot = yield from _take(shared, [begin], snapshot)
    return (yield from _turn(shared, begin, end, SLOW, ends, phase, snapshot))


def _turn(
    shared: Shared,
    begin: float,
    end: float,
    rate: float,
    ends: Callable[[Snapshot], bool],
    phase: str,
    snapshot: Snapshot,
) -> Turned:
    """Turn the motor at `rate` [rad/s] from `begin` to `end` [rad], or until `ends`; whether it did."""
    car, told, towards = Ackermann(shared.plan.robot.geometry), begin, copysign(1.0, end - begin)
    while towards * (end - told) > 0.0:
        told += towards * rate * snapshot.dt
        snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=car.steering_from_left(told)), phase=phase)
        if ends(snapshot):
            return True, snapshot
    return False, snapshot


def _locks(shared: Shared, towards: float) -> tuple[float, float]:
    """Between which angles [rad] the gate lets the motor turn: the far one, and that `towards` a side (1: left)."""
    car, limit = Ackermann(shared.plan.robot.geometry), radians(shared.plan.robot.limits.steering_deg)
    return car.wheel_angles(-towards * limit)[0], car.wheel_angles(towards * limit)[0]


def _virtual(shared: Shared, angle: float) -> float:
    """Angle of the virtual wheel for that of the motor [rad], as far as the gate lets it turn."""
    limit = radians(shared.plan.robot.limits.steering_deg)
    return min(max(Ackermann(shared.plan.robot.geometry).steering_from_left(angle), -limit), limit)


def _not_found(name: str, what: str, travel: float) -> Fault:
    """Of a motor that turned `ROUNDS` times by `travel` [rad]."""
    return catalogue.fault("CAL-03", name, f"{what} within {ROUNDS * degrees(abs(travel)):.0f} degrees")


class _Held:
    """Whether a motor that is commanded to turn `towards` a side (1: left) does not."""

    def __init__(self, name: str, towards: float) -> None:
        self._name, self._towards = name, towards
        self._position, self._messages = 0.0, 0

    def __call__(self, snapshot: Snapshot) -> bool:
        """By the next snapshot."""
        drive = feedback(snapshot, self._name)
        if drive.frames:
            turned = self._towards * (drive.position - self._position)
            behind = self._towards * (snapshot.set_points.steering_left - drive.position)
            self._messages = self._messages + 1 if behind > HELD and abs(turned) < TURNED * SLOW * snapshot.dt else 0
            self._position = drive.position
        return self._messages >= MESSAGES


def _is_on(drive: DriveFeedback) -> bool:
    return bool(drive.angle_sensor & HOME_INPUT)
