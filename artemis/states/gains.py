"""Trying other regulator gains: written while the drives are off, and taken back at the end of every run."""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterator, Mapping
from math import radians

from msgspec.structs import replace

from artemis.drive_states import POWERED
from artemis.motion.ackermann import Ackermann
from artemis.states.alignment import do, enable
from artemis.states.mode import OFF, STEERING_ON, Failed, Routine, change_time, finish_jobs
from artemis.states.plan import BringUp, CalibrateStep, Plan, Shared
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Fault, Job, JobKind, Snapshot, Wish

OFF_TIME = 0.5
"""Longest time for the drives to switch off [s]."""
REST, WATCH = 0.5, 2.0
"""The wheels rest before they turn, and are watched from the beginning of the turn on, for so long [s]."""
TURN, MOST_TURNS, OSCILLATION_S = radians(1.0), 5, 2.0
"""A wheel swings whose error turned back by so much [rad] more often than so within so long [s]: a step that comes to
rest makes one to four."""
TURN_M = 0.002
"""The same of a driven wheel [m], of its distance against that of its set-points: its speed is too coarse."""


class GainsStep(CalibrateStep, frozen=True, kw_only=True):
    """Give drives other gains, until the run ends or a fault has them configured anew."""

    gains: Mapping[str, tuple[int, ...]]
    """Current P, I; velocity P, I; position P, I, D: by drive."""


class TurnStep(CalibrateStep, frozen=True, kw_only=True):
    """Turn the wheels by a step, and back, to see how the steering drives follow."""

    side: str
    angle: float
    """Of the wheel on that side [rad], left positive."""


def try_gains(shared: Shared, step: GainsStep, snapshot: Snapshot) -> Routine:
    """Write the gains into drives that are off, and read them back; then straighten the wheels, traction still off.

    A wheel that turns also rolls about its kingpin: where traction is on, that is for a mode that drives.
    """
    off = replace(OFF, command=DriveCommand(steering=snapshot.set_points.steering))
    snapshot = yield from _switch_off(shared.plan, off, shared.plan.drives(), snapshot)
    for name, numbers in step.gains.items():
        words = words_of(shared.plan.robot.drives[name].tables.told_gains(numbers))
        snapshot = yield replace(off, phase=f"gains of {name}: {words}")
    shared.results.tried.update(step.gains)
    snapshot = yield from do(off, _jobs(shared.bring_up, step.gains), snapshot)
    snapshot = yield from do(off, shared.bring_up.jobs(JobKind.CLEAR_TARGET, shared.plan.drives()), snapshot)
    snapshot = yield from enable(shared, STEERING_ON, snapshot)
    swings, straight = _swings(shared.plan), False
    while not straight:
        snapshot = yield from _hold(shared.plan, 0.0, REST, "straightening", swings, snapshot)
        straight = snapshot.set_points.steering == 0.0
    return snapshot


class OscillationCounter:
    """How often the error of one wheel has turned back. On a ramp it swings about its lag: zero is no matter."""

    def __init__(self, size: float) -> None:
        """`size`: of the smallest turn that counts, in the unit of the errors."""
        self._size, self._farthest, self._sense = size, 0.0, 1
        self._turned: deque[float] = deque()

    def count(self, time: float, error: float) -> int:
        """How often within `OSCILLATION_S` until `time` [s], where the error is that; in the order of time."""
        away = error - self._farthest
        if self._sense * away > 0.0:
            self._farthest = error
        elif abs(away) >= self._size:
            self._farthest, self._sense = error, -self._sense
            self._turned.append(time)
        while self._turned and self._turned[0] <= time - OSCILLATION_S:
            self._turned.popleft()
        return len(self._turned)


def turn(shared: Shared, step: TurnStep, snapshot: Snapshot) -> Routine:
    """Rest, turn, rest, and turn back, traction off; no faster than the gate lets wheels turn."""
    plan = shared.plan
    car = Ackermann(plan.robot.geometry)
    target = car.steering_from_left(step.angle) if step.side == "left" else car.steering_from_right(step.angle)
    held = replace(STEERING_ON, command=DriveCommand(steering=snapshot.set_points.steering))
    snapshot = yield from _switch_off(plan, held, plan.drives("traction"), snapshot)
    snapshot = yield from enable(shared, STEERING_ON, snapshot)
    swings = _swings(plan)
    for wanted, seconds, phase in ((0.0, REST, "at rest"), (target, WATCH, "turning"), (0.0, WATCH, "turning back")):
        snapshot = yield from _hold(plan, wanted, seconds, phase, swings, snapshot)
    return snapshot


def _switch_off(plan: Plan, wish: Wish, names: Container[str], snapshot: Snapshot) -> Routine:
    """Yield `wish` until these drives are off."""
    latest = snapshot.time + change_time(plan, OFF_TIME)
    while on := [drive.name for drive in snapshot.sensed.drives if drive.name in names and drive.state in POWERED]:
        if snapshot.time > latest:
            raise Failed(OFF, catalogue.fault("COM-03", on[0], "stays on"))
        snapshot = yield replace(wish, phase="switching off")
    return snapshot


def _swings(plan: Plan) -> dict[str, OscillationCounter]:
    return {name: OscillationCounter(TURN) for name in plan.drives("steering")}


def _hold(
    plan: Plan, wanted: float, seconds: float, phase: str, swings: Mapping[str, OscillationCounter], snapshot: Snapshot
) -> Routine:
    """Have the wheels at the virtual angle `wanted` [rad] for so long; one that swings is a fault.

    Other rows wait for an error that lasts: one that changes its sign does not.
    """
    until = snapshot.time + seconds
    while snapshot.time < until:
        snapshot = yield replace(STEERING_ON, command=DriveCommand(steering=wanted), phase=phase)
        for name, error in _errors(plan, snapshot):
            if (often := swings[name].count(snapshot.time, error)) > MOST_TURNS:
                seen = f"oscillates: {often} turns by a degree or more in {OSCILLATION_S:g} s; less P or I, or more D"
                raise Failed(STEERING_ON, catalogue.fault("CAL-01", name, seen))
    return snapshot


def _errors(plan: Plan, snapshot: Snapshot) -> Iterator[tuple[str, float]]:
    """Set-point less angle of each steered wheel [rad]."""
    for drive in snapshot.sensed.drives:
        described = plan.robot.drives[drive.name]
        if described.role == "steering":
            yield drive.name, getattr(snapshot.set_points, described.set_point) - drive.position


class OscillationDetector:
    """Watches the driven wheels with gains on trial, at each tick in which the robot drives."""

    def __init__(self, plan: Plan, tried: Container[str], snapshot: Snapshot) -> None:
        """`tried`: names of the drives that have them."""
        self._robot, self._time = plan.robot, snapshot.time
        self._distances = {d.name: d.position for d in snapshot.sensed.drives if d.name in tried}
        self._swings = {name: OscillationCounter(TURN_M) for name in plan.drives("traction") if name in self._distances}

    def look(self, snapshot: Snapshot) -> Fault | None:
        """A wheel that swings, to and fro by `TURN_M` or more."""
        points, dt = snapshot.set_points, snapshot.time - self._time
        self._time = snapshot.time
        for drive in snapshot.sensed.drives:
            if drive.name in self._swings:
                self._distances[drive.name] += getattr(points, self._robot.drives[drive.name].set_point) * dt
                often = self._swings[drive.name].count(snapshot.time, self._distances[drive.name] - drive.position)
                if often > MOST_TURNS:
                    seen = (
                        f"oscillates: {often} turns by {1000 * TURN_M:g} mm or more in {OSCILLATION_S:g} s; less P or I"
                    )
                    return catalogue.fault("CAL-01", drive.name, seen)
        return None


def restore_gains(shared: Shared, wish: Wish, snapshot: Snapshot) -> Routine:
    """Give drives that are off the robot file's gains again; one that does not take them is reported."""
    tried, drives = shared.results.tried, shared.plan.robot.drives
    known = {name: numbers for name in tried if (numbers := drives[name].gain_numbers)}
    if not known:
        return snapshot
    results, snapshot = yield from finish_jobs(replace(wish, phase="restoring gains"), _jobs(shared.bring_up, known))
    for result in results:
        if not result.ok:
            words = words_of(drives[result.drive].tables.told_gains(tried[result.drive]))
            kept = f"it may keep the gains on trial, {words}, while it has power"
            seen = f"{result.detail}; {kept}; the next start writes those of the robot file"
            snapshot = yield replace(wish, fault=catalogue.fault(result.fault, result.drive, seen), failed=True)
    return snapshot


def words_of(gains: tuple[float, ...]) -> str:
    """Gains as the robot file has them, for people."""
    current_p, current_i, velocity_p, velocity_i, *position = gains
    return f"current {current_p},{current_i} velocity {velocity_p},{velocity_i} position {','.join(map(str, position))}"


def _jobs(bring_up: BringUp, gains: Mapping[str, tuple[int, ...]]) -> tuple[Job, ...]:
    return tuple(job for name, numbers in gains.items() for job in bring_up.job(JobKind.WRITE_GAINS, name, *numbers))
