"""Align the wheels: where they stand comes from the potentiometers, never from the encoders' zero."""

from __future__ import annotations

import math
from collections.abc import Generator
from math import inf

from msgspec.structs import replace

from artemis.drive_states import POWERED, DriveState, Goal
from artemis.motion.potentiometers import StepEdges, is_at_a_rail, wheel_angles
from artemis.motion.totals import mean
from artemis.states.mode import (
    HEARD,
    OFF,
    ON,
    STEERING_ON,
    Failed,
    Routine,
    change_time,
    finish_jobs,
    is_second,
)
from artemis.states.plan import Plan, Shared
from artemis.supervision import catalogue
from artemis.values import DriveCommand, DriveFeedback, Fault, Job, JobKind, Snapshot, Wish

READINGS = 100
"""Readings of each potentiometer that are averaged (thesis 4.3.1)."""
STRAIGHT = math.radians(0.5)
"""A wheel this close to its angle has reached it [rad]."""
REST = math.radians(0.2)
"""A wheel that turns no faster than this [rad/s] rests."""
SWEEP = math.radians(5.0)
"""The wheels turn this far to both sides [rad]: an analog input steps by 0.35 degrees, and only in motion does the mean
of many readings is more exact than one."""
LARGEST_CORRECTION = math.radians(1.0)
"""The sweep may correct the first reading by this much [rad]; more means that encoder and potentiometers disagree."""
STEP_TICKS, STEPS = 16.618, 2
"""For edges between the steps of an analog input the wheels pass a step in so many ticks, and so many to both sides.

With the fraction of the golden ratio each edge lies elsewhere between two ticks: where in between averages out."""
SETTLE_TICKS = 10
"""Then the wheels rest for so many ticks: what they still turned before their angle is set would be an error."""
STEER_TIME = 12.0
"""Longest time for one of the turns [s]: from lock to straight takes 2.3 s at 33 degrees a second."""
LOOK_TIME = 0.1
"""Between two looks at drives that exchange no process data [s]."""
LATE = 0.5
"""A drive that is still off after so long [s] is asked for the reason, before it is late (COM-03)."""
OFF_TIME, OFF_LIMIT = 0.2, 1.0
"""Drives that stand are off within the first [s]; after the second [s] everything has been tried, unless one that is
heard is allowed more."""

Readings = dict[str, tuple[float, float]]
"""Mean voltages of both potentiometers [V], by steering drive."""


def align(shared: Shared, snapshot: Snapshot) -> Routine:
    """At rest: read the potentiometers, set the drives' angle, sweep for the fine angle; then enable traction.

    Traction stays off while the wheels turn: before they are aligned, nothing can drive the robot. Wheels with new
    potentiometers are taken as they are found, and stay there; traction stays off.
    """
    volts, snapshot = yield from _read_potentiometers(shared.plan, snapshot)
    names = shared.plan.drives("steering")
    if shared.plan.found and shared.bring_up.taken:
        seen = "the wheels may have been turned since their angles were measured from outside: start again"
        raise Failed(OFF, catalogue.fault("CAL-01", "", seen))
    fault = next((f for name in names for f in _implausible(shared.plan, name, volts[name])), None)
    if fault is not None:
        raise Failed(OFF, fault)
    angles = [_angle_at_rest(shared.plan, name, volts[name]) for name in names]
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.REFERENCE, names, angles), snapshot)
    snapshot = yield from do(OFF, shared.bring_up.jobs(JobKind.CLEAR_TARGET, shared.plan.drives()), snapshot)
    shared.bring_up.taken = shared.plan.blind
    snapshot = yield from enable(shared, STEERING_ON, snapshot)
    if shared.plan.blind:
        return snapshot
    errors: dict[str, list[float]] = {name: [] for name in names}
    for target in (SWEEP, -SWEEP, 0.0):
        snapshot = yield from steer(shared.plan, target, snapshot, errors)
    exact, snapshot = yield from _seek_edges(shared.plan, snapshot)
    corrections = {name: exact.get(name, mean(found)) for name, found in errors.items()}
    for name, correction in corrections.items():
        if abs(correction) > LARGEST_CORRECTION:
            seen = f"by {math.degrees(correction):.1f} degrees"
            raise Failed(STEERING_ON, catalogue.fault("STE-05", name, seen))
    positions = {drive.name: drive.position for drive in snapshot.sensed.drives}
    angles = [positions[name] + correction for name, correction in corrections.items()]
    snapshot = yield from do(STEERING_ON, shared.bring_up.jobs(JobKind.REFERENCE, names, angles), snapshot)
    snapshot = yield from steer(shared.plan, 0.0, snapshot, {})
    return (yield from enable(shared, ON, snapshot))


def do(wish: Wish, jobs: tuple[Job, ...], snapshot: Snapshot) -> Routine:
    """Have jobs of one kind done; one that fails is a fault."""
    first, *_ = jobs
    results, snapshot = yield from finish_jobs(replace(wish, phase=first.kind.value), jobs)
    for result in results:
        if not result.ok:
            raise Failed(wish, catalogue.fault(result.fault, result.drive, result.detail))
        if result.kind is JobKind.CLEAR_TARGET and result.values:
            snapshot = yield replace(wish, fault=catalogue.fault("COM-06", result.drive, f"{result.values[0]} units"))
    return snapshot


def enable(shared: Shared, wish: Wish, snapshot: Snapshot) -> Routine:
    """Enable the drives that `wish` wants enabled, wheels held; the supervisor judges one that takes too long.

    One that stays off, without a fault, is asked for the reason before.
    """
    steering, asked = frozenset(shared.plan.drives("steering")), snapshot.time + LATE
    goals = {drive.name: wish.steering if drive.name in steering else wish.traction for drive in snapshot.sensed.drives}
    while waiting := [d for d in snapshot.sensed.drives if goals[d.name] is Goal.ENABLED and not _is_on(d)]:
        command = DriveCommand(steering=snapshot.set_points.steering)
        wanted = replace(wish, command=command, phase="enabling")
        if snapshot.time >= asked and any(drive.state is DriveState.SWITCH_ON_DISABLED for drive in waiting):
            asked = inf
            snapshot = yield from _ask_why(shared, wanted, snapshot)
        else:
            snapshot = yield wanted
    return snapshot


def _ask_why(shared: Shared, wish: Wish, snapshot: Snapshot) -> Routine:
    """Read the state of the inputs that keep a drive off, of all drives that show it.

    Raises:
        Failed: STO inputs are open: of all drives (EST-01), or of one (DRV-29).
    """
    drives = shared.plan.robot.drives
    names = [name for name, drive in drives.items() if drive.tables.sto is not None]
    if not names:
        return (yield wish)
    results, snapshot = yield from finish_jobs(wish, shared.bring_up.jobs(JobKind.READ_STO, names))
    found = [result for result in results if result.values]
    if len(found) == len(drives) > 1:
        raise Failed(OFF, catalogue.fault("EST-01", "", "the STO inputs of all drives are open"))
    if found:
        others = f"; open at {', '.join(result.drive for result in found[1:])}, too" if found[1:] else ""
        seen = f"its STO inputs are open: they read 0x{found[0].values[0]:02X}{others}"
        raise Failed(OFF, catalogue.fault("DRV-29", found[0].drive, seen))
    return snapshot


def switch_off(shared: Shared, wish: Wish, snapshot: Snapshot) -> Routine:
    """Yield `wish`, which switches off, until no drive is on. An unresponsive one: by SDO, or by our silence."""
    begun, heartbeat = snapshot.time, wish.heartbeat
    limit = change_time(shared.plan, OFF_LIMIT)
    halted: set[str] = set()
    snapshot = yield replace(wish, phase="switching off")
    while (passed := snapshot.time - begun) < limit:
        powered = [drive for drive in snapshot.sensed.drives if drive.state in POWERED]
        on = [drive.name for drive in powered if passed < OFF_LIMIT or (drive.age is not None and drive.age < HEARD)]
        if not on:
            break
        heartbeat = heartbeat and all(r.ok for r in snapshot.sensed.results if r.kind is JobKind.HALT)
        jobs = shared.bring_up.jobs(JobKind.HALT, [name for name in on if passed >= OFF_TIME and name not in halted])
        halted.update(job.drive for job in jobs)
        snapshot = yield replace(wish, jobs=jobs, heartbeat=heartbeat, phase="switching off")
    return snapshot


class Lookout:
    """Keeps drives off that are not ours yet: they report nothing without our configuration; each is asked by SDO."""

    def __init__(self) -> None:
        self._under_way: set[int] = set()
        self._next = 0.0

    def watch(self, shared: Shared, wish: Wish, snapshot: Snapshot) -> Wish:
        """`wish`, with what keeps them off; its phase names one that a stranger had switched on."""
        if shared.bring_up.connected or is_second(shared, snapshot):
            return wish
        found = [result for result in snapshot.sensed.results if result.id in self._under_way]
        self._under_way.difference_update(result.id for result in found)
        if strangers := [result.drive for result in found if result.values]:
            wish = replace(wish, phase=f"stopped what another master switched on: {', '.join(strangers)}")
        if self._under_way or snapshot.time < self._next:
            return wish
        jobs = shared.bring_up.jobs(JobKind.KEEP_OFF, shared.plan.drives())
        self._under_way, self._next = {job.id for job in jobs}, snapshot.time + LOOK_TIME
        return replace(wish, jobs=(*wish.jobs, *jobs))


def _is_on(drive: DriveFeedback) -> bool:
    return drive.state is DriveState.OPERATION_ENABLE


def steer(
    plan: Plan, target: float, snapshot: Snapshot, errors: dict[str, list[float]], phase: str = "aligning"
) -> Routine:
    """Turn the wheels to the virtual angle `target`; add each tick's potentiometers minus encoder to `errors`."""
    latest, steering = snapshot.time + STEER_TIME, frozenset(plan.drives("steering"))
    wish = replace(STEERING_ON, command=DriveCommand(steering=target), phase=phase)
    while True:
        snapshot = yield wish
        for drive in snapshot.sensed.drives:
            if drive.name in errors:
                errors[drive.name].append(_angle(plan, drive.name, drive.potentiometers) - drive.position)
        away = [d for d in snapshot.sensed.drives if abs(_way_to_go(plan, d, snapshot)) > STRAIGHT]
        turning = any(drive.name in steering and abs(drive.velocity) > REST for drive in snapshot.sensed.drives)
        if snapshot.set_points.steering == target and not away and not turning:
            return snapshot
        if snapshot.time > latest:
            name = away[0].name if away else ""
            seen = f"{math.degrees(_way_to_go(plan, away[0], snapshot)):.1f} degrees away" if away else "keeps turning"
            raise Failed(STEERING_ON, catalogue.fault("STE-01", name, seen))


def _seek_edges(plan: Plan, snapshot: Snapshot) -> Generator[Wish, Snapshot, tuple[dict[str, float], Snapshot]]:
    """Turn the wheels slowly to and fro about straight ahead: what their encoders lack [rad], by steering drive.

    Those whose family states no step of its analog inputs are not among them, nor those of which no edge is seen.
    """
    edges: dict[str, StepEdges] = {}
    steps: list[float] = []
    for name in plan.drives("steering"):
        drive = plan.robot.drives[name]
        if drive.tables.analog_step is not None:
            calibration = plan.robot.potentiometers(drive.side)
            edges[name] = StepEdges(calibration, drive.tables.analog_step)
            steps += [math.radians(abs(slope)) * drive.tables.analog_step for slope in calibration.slope_deg_per_v]
    if not edges:
        return {}, snapshot
    step = max(steps)
    for tick in range(round(6 * STEPS * STEP_TICKS)):  # ahead, to the left end, the right, the left, and back
        place = step * (abs((tick / STEP_TICKS - STEPS) % (4 * STEPS) - 2 * STEPS) - STEPS)
        snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=place), phase="aligning")
        for told in snapshot.sensed.drives:
            if told.name in edges:
                edges[told.name].take(told.position, told.potentiometers)
    snapshot = yield from steer(plan, 0.0, snapshot, {})
    for _ in range(SETTLE_TICKS):
        snapshot = yield replace(STEERING_ON, phase="aligning")
    return {name: error for name, found in edges.items() if (error := found.error) is not None}, snapshot


def _way_to_go(plan: Plan, drive: DriveFeedback, snapshot: Snapshot) -> float:
    """Set-point minus measured angle of a steered wheel [rad]; 0 for a traction drive."""
    described = plan.robot.drives[drive.name]
    if described.role != "steering":
        return 0.0
    told: float = getattr(snapshot.set_points, described.set_point)
    return told - drive.position


def _read_potentiometers(plan: Plan, snapshot: Snapshot) -> Generator[Wish, Snapshot, tuple[Readings, Snapshot]]:
    readings: dict[str, list[tuple[float, float]]] = {name: [] for name in plan.drives("steering")}
    for _ in range(READINGS):  # the drives may still be on: a wheel that turned would roll
        command = DriveCommand(steering=snapshot.set_points.steering)
        snapshot = yield replace(OFF, command=command, phase="reading potentiometers")
        for drive in snapshot.sensed.drives:
            if drive.name in readings:
                readings[drive.name].append(drive.potentiometers)
    return {name: (mean([a for a, _ in read]), mean([b for _, b in read])) for name, read in readings.items()}, snapshot


def _angle_at_rest(plan: Plan, name: str, volts: tuple[float, float]) -> float:
    if plan.found is not None:
        return plan.found.get(plan.robot.drives[name].side, 0.0)
    return _angle(plan, name, volts)


def _angle(plan: Plan, name: str, volts: tuple[float, float]) -> float:
    return mean(_angles(plan, name, volts))


def _angles(plan: Plan, name: str, volts: tuple[float, float]) -> tuple[float, float]:
    return wheel_angles(volts, plan.robot.potentiometers(plan.robot.drives[name].side))


def _implausible(plan: Plan, name: str, volts: tuple[float, float]) -> list[Fault]:
    if is_at_a_rail(volts, plan.robot.potentiometers(plan.robot.drives[name].side).supply_v):
        return [catalogue.fault("STE-04", name, f"{volts[0]:.2f} V and {volts[1]:.2f} V")]
    if plan.blind:
        return []
    first, second = (math.degrees(angle) for angle in _angles(plan, name, volts))
    if abs(first - second) > plan.robot.calibration.steering.disagreement_deg:
        return [catalogue.fault("STE-03", name, f"{first:.1f} and {second:.1f} degrees")]
    return []
