"""Trying other regulator gains: written while the drives are off, and taken back at the end of every run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from artemis.motion.ackermann import Ackermann
from artemis.states.alignment import do, enable
from artemis.states.mode import OFF, STEERING_ON, CalibrateStep, Plan, Routine, fail, finish_jobs
from artemis.supervision import catalogue
from artemis.values import POWERED, DriveCommand, Job, JobKind, Snapshot, Wish

OFF_TIME = 0.5
"""Longest time for the drives to switch off [s]."""
REST, WATCH = 0.5, 2.0
"""The wheels rest before they turn, and are watched from the beginning of the turn on, for so long [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GainsStep(CalibrateStep):
    """Give drives other gains, until the run ends or a fault has them configured anew."""

    gains: Mapping[str, tuple[int, ...]]
    """Current P, I; velocity P, I; position P, I, D: by drive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnStep(CalibrateStep):
    """Turn the wheels by a step, and back, to see how the steering drives follow."""

    side: str
    angle: float
    """Of the wheel on that side [rad], left positive."""


def try_gains(plan: Plan, step: GainsStep, snapshot: Snapshot) -> Routine:
    """Write the gains into drives that are off, and read them back."""
    off = replace(OFF, command=DriveCommand(steering=snapshot.set_points.steering), phase="switching off")
    latest = snapshot.time + OFF_TIME
    while on := [drive.name for drive in snapshot.sensed.drives if drive.state in POWERED]:
        if snapshot.time > latest:
            return (yield from fail(OFF, catalogue.fault("COM-03", on[0], "stays on")))
        snapshot = yield off
    for name, numbers in step.gains.items():
        snapshot = yield replace(off, phase=f"gains of {name}: {words_of(numbers)}")
    plan.tried.update(step.gains)
    snapshot = yield from do(off, _jobs(plan, step.gains), snapshot)
    return (yield from do(off, plan.jobs(JobKind.CLEAR_TARGET, plan.drives()), snapshot))


def turn(plan: Plan, step: TurnStep, snapshot: Snapshot) -> Routine:
    """Rest, turn, rest, and turn back, traction off; no faster than the gate lets wheels turn."""
    car = Ackermann(plan.robot.geometry)
    target = car.steering_from_left(step.angle) if step.side == "left" else car.steering_from_right(step.angle)
    snapshot = yield from enable(STEERING_ON, snapshot)
    for wanted, seconds, phase in ((0.0, REST, "at rest"), (target, WATCH, "turning"), (0.0, WATCH, "turning back")):
        until = snapshot.time + seconds
        while snapshot.time < until:
            snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=wanted), phase=phase)
    return snapshot


def restore_gains(plan: Plan, wish: Wish, snapshot: Snapshot) -> Routine:
    """Give drives that are off the robot file's gains again; one that does not take them is told."""
    known = {name: gains.numbers for name in plan.tried if (gains := plan.robot.drives[name].gains) is not None}
    if not known:
        return snapshot
    results, snapshot = yield from finish_jobs(replace(wish, phase="restoring gains"), _jobs(plan, known))
    for result in results:
        if not result.ok:
            plan.failed = True
            kept = f"it may keep the gains on trial, {words_of(plan.tried[result.drive])}, while it has power"
            seen = f"{result.detail}; {kept}; the next start writes those of the robot file"
            snapshot = yield replace(wish, fault=catalogue.fault(result.fault, result.drive, seen))
    return snapshot


def words_of(gains: tuple[int, ...]) -> str:
    """Gains for people."""
    current_p, current_i, velocity_p, velocity_i, *position = gains
    return f"current {current_p},{current_i} velocity {velocity_p},{velocity_i} position {','.join(map(str, position))}"


def _jobs(plan: Plan, gains: Mapping[str, tuple[int, ...]]) -> tuple[Job, ...]:
    return tuple(job for name, numbers in gains.items() for job in plan.job(JobKind.WRITE_GAINS, name, *numbers))
