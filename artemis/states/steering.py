"""Calibrating the potentiometers of the steered wheels: zero and slope against the encoders (thesis 4.3.1)."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from math import copysign, degrees, inf, radians

from msgspec.structs import replace

from artemis.axles import ByHand, Potentiometers
from artemis.drive_states import POWERED
from artemis.motion.ackermann import Ackermann
from artemis.motion.potentiometers import memory_numbers, wheel_angles
from artemis.motion.steering_fit import Line, Pass, SteeringFit, fitted, lines_through, moved, shown_straight
from artemis.motion.totals import mean, total
from artemis.states.alignment import READINGS, do, enable, steer
from artemis.states.keeping import keep
from artemis.states.mode import OFF, PATIENCE, STEERING_ON, Failed, Routine, change_time, feedback
from artemis.states.plan import CalibrateStep, Plan, Shared
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Fault, JobKind, Request, Severity, Snapshot, Wish

TURN, LEAST_TURN = radians(45.0), radians(15.0)
"""A wheel is read straight and turned by so much to both sides [rad]: less where its limits are nearer."""
WINDOW = radians(2.0)
"""It turns by so much to both sides of each angle while it is read [rad]: an analog input steps by 0.35 degrees."""
LEAD = radians(2.0)
"""Before that it turns the same way for so long [rad]: more than any sound play, which is taken up then."""
FLAT = 0.1
"""A voltage that changes less than this [V/rad] does not follow the wheel."""
SLOPE_RANGE = 0.1
"""The slope may differ from the robot file's by this part."""
OFF_LINE, FAR_OFF_LINE = radians(0.2), radians(0.5)
"""A pass whose mean is so far off the line is worth a warning, and a refusal [rad]."""
RELEASE_TIME = 1.0
"""Longest time for the driven wheels' drives to switch off [s]."""
AHEAD = radians(2.0)
"""No keys, however many, send a wheel farther than this from where it is [rad]: it stops when they stop."""
READ_TIME = 0.5
"""Nobody reads a question faster [s]."""
TURN_IT, START, KEEP = "turn it until it stands straight, then accept", "enter: start, q: cancel", "enter: yes, q: no"
"""How the phases end in which a person has to do something."""
INSIDE = 1e-6
"""Targets stay so far inside the gate's limits [rad]: rounding must not put them beyond."""
JOGS = {
    Request.LEFT_DEGREE: radians(1.0),
    Request.RIGHT_DEGREE: -radians(1.0),
    Request.LEFT_TENTH: radians(0.1),
    Request.RIGHT_TENTH: -radians(0.1),
}

Lines = tuple[Line, Line]


class SteeringStep(CalibrateStep, frozen=True, kw_only=True):
    """Measure zero and slope of the potentiometers of steered wheels."""

    sides: tuple[str, ...] = ("left", "right")
    reference: Mapping[str, float] = {}
    """True angle of a wheel that shows 0 [rad], by side; of one with new potentiometers: as it is found."""
    new: bool = False
    """Nothing that the potentiometers say now is believed."""
    save: str = "nothing"
    """`drives`: keep the result in the drives; `ask`: if a person says so."""

    @property
    def replaces(self) -> tuple[str, ...]:
        """Whose drives are to keep another calibration."""
        return self.sides if self.save != "nothing" else ()


def calibrate_steering(shared: Shared, step: SteeringStep, snapshot: Snapshot) -> Routine:
    """Have a person turn the wheels straight where no reference is given, measure each, report, and keep the result.

    Traction is off, and both wheels turn as a pair by set-points that pass the gate.
    """
    snapshot = yield from _release(shared, snapshot)
    straight: dict[str, tuple[float, float]] = {}
    for side in step.sides:
        if side in step.reference:
            straight[side] = (0.0 if shared.plan.blind else -step.reference[side]), 0.0
        else:
            straight[side], snapshot = yield from _ask_straight(shared.plan, side, snapshot)
    if by_hand := [side for side in step.sides if side not in step.reference]:
        if shared.plan.robot.has_potentiometers:
            snapshot = yield from _ask(f"keep clear, the wheels turn to both sides now: {START}", snapshot)
        if shared.plan.blind:
            snapshot = yield from _take_as_straight(shared, {side: straight[side][0] for side in by_hand}, snapshot)
            straight.update({side: (0.0, straight[side][1]) for side in by_hand})
    if not shared.plan.robot.has_potentiometers:
        return (yield from _tell_zeros(shared, step, {side: angle for side, (angle, _) in straight.items()}, snapshot))
    fits: dict[str, SteeringFit] = {}
    for side in step.sides:
        angle, direction = straight[side]
        lines, snapshot = yield from _measure(shared.plan, side, angle, snapshot)
        known = shared.plan.robot.potentiometers(side)
        if side in step.reference and not shared.plan.blind:
            angle = shown_straight(lines, known) - step.reference[side]
        fits[side] = fitted(lines, angle, direction, known)
    snapshot = yield from steer(shared.plan, 0.0, snapshot, {})
    shared.results.steering = fits
    for text in _told(shared.plan, fits):
        snapshot = yield _hold(snapshot, text)
    if step.save == "ask":
        snapshot = yield from _ask(f"keep this in the drives and the robot file? {KEEP}", snapshot)
    if step.save != "nothing":
        robot = shared.plan.robot
        wanted = {robot.drive_at("steering", side)[0]: memory_numbers(fit.calibration) for side, fit in fits.items()}
        snapshot = yield from keep(shared, wanted, snapshot)
        snapshot = yield from enable(shared, STEERING_ON, snapshot)
    return snapshot


def _tell_zeros(shared: Shared, step: SteeringStep, straight: Mapping[str, float], snapshot: Snapshot) -> Routine:
    """Where wheels without potentiometers stand straight [rad, as they count], which nothing more has to be turned for.

    The drives keep nothing of it.
    """
    robot = shared.plan.robot
    snapshot = yield from steer(shared.plan, 0.0, snapshot, {})
    for side, angle in straight.items():
        source = robot.angle_source(side)
        assert not isinstance(source, Potentiometers | ByHand)  # checked when the mission was read
        found = shared.results.zeros[side] = moved(source, angle)
        told = f"{side}: {found.key} {found.before:.4f} -> {found.after:.4f} ({-degrees(angle):+.2f} deg)"
        snapshot = yield _hold(snapshot, told)
    if step.save == "ask":
        snapshot = yield from _ask(f"keep this in the robot file? {KEEP}", snapshot)
    return snapshot


def _release(shared: Shared, snapshot: Snapshot) -> Routine:
    """Have the driven wheels let go: they shall roll as the steering turns them."""
    latest = snapshot.time + change_time(shared.plan, RELEASE_TIME)
    while on := [name for name in shared.plan.drives("traction") if feedback(snapshot, name).state in POWERED]:
        if snapshot.time > latest:
            raise Failed(STEERING_ON, catalogue.fault("COM-03", on[0], "stays on"))
        snapshot = yield _hold(snapshot, "switching traction off")
    return (yield from enable(shared, STEERING_ON, snapshot))


def _hold(snapshot: Snapshot, phase: str) -> Wish:
    """Wheels held, traction off."""
    return replace(STEERING_ON, command=DriveCommand(steering=snapshot.set_points.steering), phase=phase)


# ---------------------------------------------------------------------------------------------- a person


def _ask(question: str, snapshot: Snapshot) -> Routine:
    """Wait until a person accepts; who does not, ends the run."""
    begun = snapshot.time
    while not _accepts(snapshot, begun):
        _check_operator(snapshot, begun, question)
        snapshot = yield _hold(snapshot, question)
    return snapshot


def _accepts(snapshot: Snapshot, begun: float) -> bool:
    """Whether a person accepts what was shown from run time `begun` [s] on: a key that bounces accepts nothing more."""
    return Request.ACCEPT in snapshot.sensed.requests and snapshot.time >= begun + READ_TIME


def _check_operator(snapshot: Snapshot, begun: float, question: str) -> None:
    """See that an operator may answer.

    Raises:
        Failed: there is no operator, or none came.
    """
    if not snapshot.sensed.attended or snapshot.time > begun + PATIENCE:
        raise Failed(STEERING_ON, _refused("", f"no answer from the operator: {question}"))


def _ask_straight(
    plan: Plan, side: str, snapshot: Snapshot
) -> Generator[Wish, Snapshot, tuple[tuple[float, float], Snapshot]]:
    """Let a person turn a wheel until it stands straight: its angle by the encoder [rad], and which way it came."""
    name, _ = plan.robot.drive_at("steering", side)
    low, high = _reach(plan, side)
    angle, target = feedback(snapshot, name).position, snapshot.set_points.steering
    direction = 0.0 if plan.blind else 1.0  # as the alignment leaves it
    begun = snapshot.time
    while not _accepts(snapshot, begun):
        question = f"{_wheel(side)} at {degrees(angle):+.1f} deg: {TURN_IT}"
        _check_operator(snapshot, begun, question)
        if jog := total(JOGS.get(request, 0.0) for request in snapshot.sensed.requests):
            here, direction = feedback(snapshot, name).position, copysign(1.0, jog)
            angle = min(max(angle + jog, here - AHEAD, low), here + AHEAD, high)
            target = _virtual(plan, side, angle)
        snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=target), phase=question)
    snapshot = yield from steer(plan, target, snapshot, {})
    return (feedback(snapshot, name).position, direction), snapshot


def _take_as_straight(shared: Shared, straight: Mapping[str, float], snapshot: Snapshot) -> Routine:
    """Have wheels count from where a person found them straight [rad, as they counted before]; all at once.

    Wheels that are no pair by what they count are turned until they are one.
    """
    zeros = {shared.plan.robot.drive_at("steering", side)[0]: angle for side, angle in straight.items()}
    angles = [feedback(snapshot, name).position - zero for name, zero in zeros.items()]
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.REFERENCE, list(zeros), angles), snapshot)
    return (yield from enable(shared, STEERING_ON, snapshot))


# ---------------------------------------------------------------------------------------------- measuring


def _measure(
    plan: Plan, side: str, straight: float, snapshot: Snapshot
) -> Generator[Wish, Snapshot, tuple[Lines, Snapshot]]:
    """Read one wheel straight, turned to both sides, and straight again, each angle from both sides."""
    name, _ = plan.robot.drive_at("steering", side)
    low, high = _reach(plan, side)
    turn = min(TURN, min(high - straight, straight - low) - WINDOW - LEAD)
    if turn < LEAST_TURN:
        seen = f"at its limit: {degrees(turn):.1f} degrees are left to turn it by, {degrees(LEAST_TURN):.0f} are needed"
        raise Failed(STEERING_ON, _refused(name, seen))
    passes: list[Pass] = []
    for offset in (0.0, turn, -turn, 0.0):
        for direction in (1.0, -1.0):
            one, snapshot = yield from _pass(plan, side, straight + offset, direction, snapshot)
            passes.append(one)
    lines = lines_through(passes)
    for fault in _judged(plan, side, lines, passes):
        if fault.severity >= Severity.CONTROLLED_STOP:
            raise Failed(STEERING_ON, fault)
        snapshot = yield replace(_hold(snapshot, fault.text), fault=fault)
    return lines, snapshot


def _pass(
    plan: Plan, side: str, angle: float, direction: float, snapshot: Snapshot
) -> Generator[Wish, Snapshot, tuple[Pass, Snapshot]]:
    """Readings while the wheel turns slowly past `angle` [rad] in one direction."""
    name, _ = plan.robot.drive_at("steering", side)
    begin, phase = angle - direction * WINDOW, f"reading the {_wheel(side)} at {degrees(angle):+.0f} degrees"
    for target in (begin - direction * LEAD, begin):
        snapshot = yield from steer(plan, _virtual(plan, side, target), snapshot, {}, phase)
    number, readings = READINGS // 2, []
    for step in range(1, number + 1):
        target = _virtual(plan, side, begin + direction * 2.0 * WINDOW * step / number)
        snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=target), phase=phase)
        drive = feedback(snapshot, name)
        readings.append((drive.position, *drive.potentiometers))
    return Pass(direction, readings), snapshot


def _wheel(side: str) -> str:
    """What a steering motor turns, for people."""
    return "steering" if side == "middle" else f"{side} wheel"


def _virtual(plan: Plan, side: str, angle: float) -> float:
    """Angle of the virtual wheel at which the wheel of one side stands at `angle` [rad]."""
    car = Ackermann(plan.robot.geometry)
    return car.steering_from_left(angle) if side == "left" else car.steering_from_right(angle)


def _reach(plan: Plan, side: str) -> tuple[float, float]:
    """How far the gate lets a wheel turn to the right and to the left [rad], by its encoder."""
    car, limit = Ackermann(plan.robot.geometry), radians(plan.robot.limits.steering_deg)
    place = 0 if side == "left" else 1
    return car.wheel_angles(-limit)[place] + INSIDE, car.wheel_angles(limit)[place] - INSIDE


# ---------------------------------------------------------------------------------------------- judging


def _judged(plan: Plan, side: str, lines: Lines, passes: list[Pass]) -> Iterator[Fault]:
    """What is wrong with what was read, or worth a warning."""
    name, _ = plan.robot.drive_at("steering", side)
    known = plan.robot.potentiometers(side)
    for number, (line, slope) in enumerate(zip(lines, known.slope_deg_per_v, strict=True), 1):
        who = f"potentiometer {number}"
        found = degrees(1.0) / line.per_radian if line.per_radian else inf
        ratio = found / slope
        if abs(line.per_radian) < FLAT:
            yield _refused(name, f"{who} does not follow the wheel: {abs(line.per_radian):.3f} V per radian")
        elif not plan.blind and abs(ratio - 1.0) > SLOPE_RANGE:
            swapped = "; are two plugs swapped?" if ratio < 0.0 else ""
            yield _refused(
                name, f"{who}: {found:.1f} degrees per volt, the robot file says {slope:.1f}; at most 10 % off{swapped}"
            )
        elif line.misfit > FAR_OFF_LINE:
            seen = f"{who} is {degrees(line.misfit):.2f} degrees off its line: it drifts, or a coupling slips"
            yield _refused(name, seen)
        elif line.misfit > OFF_LINE:
            yield _warning(name, f"{who} is {degrees(line.misfit):.2f} degrees off its line")
    if not plan.blind and (apart := _apart(known, passes[0])) > plan.robot.calibration.steering.disagreement_deg / 2.0:
        yield _warning(name, f"by the robot file its potentiometers are {apart:.1f} degrees apart")


def _apart(known: Potentiometers, one: Pass) -> float:
    """Difference of both potentiometers in the mean of a pass, by a calibration [degrees]."""
    volts = mean([first for _, first, _ in one.readings]), mean([second for _, _, second in one.readings])
    first, second = wheel_angles(volts, known)
    return degrees(abs(first - second))


def _refused(name: str, seen: str) -> Fault:
    return catalogue.fault("CAL-01", name, seen)


def _warning(name: str, seen: str) -> Fault:
    return catalogue.fault("CAL-01", name, seen, Severity.WARN)


def _told(plan: Plan, fits: Mapping[str, SteeringFit]) -> Iterator[str]:
    """What was found, beside what was known, line by line."""
    for side, fit in fits.items():
        old, new = plan.robot.potentiometers(side), fit.calibration
        for number in (0, 1):
            zero, slope = new.zero_v[number], new.slope_deg_per_v[number]
            shift = (zero - old.zero_v[number]) * slope
            yield (
                f"{side} {number + 1}: zero {old.zero_v[number]:.4f} -> {zero:.4f} V ({shift:+.2f} deg, "
                f"+- {abs(fit.zero_std_v[number] * slope):.3f}), slope {old.slope_deg_per_v[number]:.3f} -> "
                f"{slope:.3f} deg/V (+- {fit.slope_std_deg_per_v[number]:.3f})"
            )
        yield f"{side}: backlash {fit.backlash_deg:.2f} deg, off the line by {fit.misfit_deg:.3f} deg at most"
