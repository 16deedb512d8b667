"""Invariants of what is on the wire: I1, I2, I5, I9."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, cos, degrees, inf, pi, radians, sin
from typing import NamedTuple

from artemis.campaign.monitor.evidence import Evidence, Violation
from artemis.campaign.monitor.wire import (
    ENABLE,
    HISTORY,
    LOST_HEARTBEAT,
    MODE_SHOWN,
    VENDOR,
    VERSION,
    WATCHED_HOST,
    Boot,
    Emergency,
    Event,
    ModeShown,
    SetPoint,
    Status,
    Transfer,
)
from artemis.campaign.witness import SIDES

DRIVING, RESTING = {"teleop", "follow"}, {"init", "fault", "end"}
QUEUED = 0.006
"""A frame may wait so long for the wire [s]: it can belong to the mode before."""
SCRUB = 0.05
"""A wheel's target may rise by this much while the robot slows down: it no longer rolls about its kingpin [m/s]."""
TOLERANCE = 1.02
WINDOW = 5
"""Accelerations are looked at over so many set-points: the steering's own share of a wheel's speed evens out."""
STEERED = 0.016
"""What that share may still change of the mean of both wheels [m/s]."""
JITTER = 0.004
"""Between two ticks' frames on the wire [s]."""
TRUE_MARGIN = 0.05
"""The true speed may be so much above the limit: regulators overshoot, wheels differ from their calibration [m/s]."""
ZERO_ERROR = radians(1.5)
"""The wheels' true angle and the believed one may differ by this much [rad]."""
WATCH_MS = 200
"""A drive watches the host's heartbeat with this time-out."""
MODES = {"traction": 3, "steering": -1}
"""Modes of operation: profile velocity, position."""
SILENCE = 0.15
"""A pause of the host's heartbeat this long [s] is no jitter."""


# ---------------------------------------------------------------------------------------------- I1, I2


def targets_at_rest(e: Evidence) -> Iterator[Violation]:
    """I1: no target but zero in `init`, `fault`, `end`; elsewhere outside driving it only falls, to zero."""
    for side in SIDES:
        last = 0.0
        for time, target in e.targets[side]:
            before, last = abs(last), target
            if target == 0.0:
                continue
            modes = e.journal.modes_between(time - QUEUED, time)
            if modes & DRIVING:
                continue
            where = ", ".join(sorted(modes))
            if modes <= RESTING:
                yield Violation("I1", time, f"target {target:+.2f} m/s to the {side} wheel in {where}")
            elif abs(target) > before + (SCRUB if before else 0.0):
                yield Violation("I1", time, f"target of the {side} wheel rises to {target:+.2f} m/s in {where}")


_INPUT_LOST = {"INP-01": 0.06, "INP-03": 0.17, "INP-04": 0.17, "INP-05": 0.17, "INP-06": 1.02}
"""Worst case until the loss of the input is noticed [s]."""


def loss_of_input(e: Evidence) -> Iterator[Violation]:
    """I2: once the input is lost, or its enable button released, targets fall, and are zero after the ramp."""
    losses = [
        (i.time + _INPUT_LOST[i.id] + 1.5 * e.tick, f"{i.id} at {i.time:.3f} s")
        for i in e.injected
        if i.id in _INPUT_LOST and i.until > i.time + _INPUT_LOST[i.id] + 0.2 and e.journal.mode_at(i.time) == "teleop"
    ]
    for row, after in zip(e.stick, [*e.stick[1:], None], strict=False):
        again = after.time if after is not None and after.held else inf
        if not row.held and again - row.time > 1.5:
            losses.append((row.time + 2.5 * e.tick, f"release of the enable button at {row.time:.3f} s"))
    if any(i.id in ("INP-07", "INP-08", "INP-12") for i in e.injected):
        losses = []  # then the stick is not what moves the robot
    stall = [i for i in e.injected if "seconds" in i.options]
    for since, why in losses:
        until = min([*(row.time for row in e.stick if row.held and row.time > since), inf])
        if e.journal.mode_at(since) not in {"teleop", "quickstop"} or any(abs(i.time - since) < 1.5 for i in stall):
            continue
        for side in SIDES:
            targets = [(time, abs(v)) for time, v in e.targets[side] if since <= time < until]
            if not targets:
                continue
            zero_by = since + targets[0][1] / e.robot.limits.deceleration_m_s2 + 0.1 + e.tick
            last = inf
            for time, speed in targets:
                if speed > last + SCRUB or (speed > 0.0 and time > zero_by):
                    yield Violation("I2", time, f"{side} wheel is still sent {speed:.2f} m/s after {why}")
                    break
                last = speed


# ---------------------------------------------------------------------------------------------- I5


@dataclass(slots=True)
class _Known:
    """What the host has made sure of, of one drive."""

    vendor: bool = False
    version: bool = False
    watch: int = -1
    mode: int | None = None
    target: int | None = None
    proof: bool = False


def enabling(e: Evidence) -> Iterator[Violation]:
    """I5: a drive is enabled only after all that has to be known of it, since it booted or was in fault."""
    for name, drive in e.robot.drives.items():
        known, last = _Known(), Status(0.0, 0, 0)
        watch = e.robot.host_node_id << 16 | WATCH_MS
        for event in e.wire.nodes[drive.node_id].events:
            if isinstance(event, Status):
                if event.enabled and not last.enabled and not _forced(e, name, event.time):
                    off = abs(known.target - event.position) if known.target is not None else -1
                    wrong = _unknown(known, drive.role, watch, off, drive.sensor.counts_per_turn * drive.gear_ratio)
                    if wrong:
                        yield Violation("I5", event.time, f"{name} was enabled without {', '.join(wrong)}")
                if event.faulty and not last.faulty and not _proving(e, event.time):
                    known = _Known()
                last = event
            else:
                known = _learned(e, known, event)


def _learned(e: Evidence, known: _Known, event: Event) -> _Known:
    match event:
        case Boot():
            return _Known()
        case Emergency(code=code) if code == LOST_HEARTBEAT and _proving(e, event.time):
            known.proof = True
        case Emergency(code=code) if code:
            return _Known()
        case ModeShown(mode=mode):
            known.mode = mode
        case SetPoint(target=target):
            known.target = target
        case Transfer(object=index, sub=sub, value=value):
            known.vendor = known.vendor or (index, sub) == (VENDOR, 1)
            known.version = known.version or (index, sub) == (VERSION, 1)
            known.proof = known.proof or (index == HISTORY and sub > 0 and value & 0xFFFF == LOST_HEARTBEAT)
            if (index, sub) == (WATCHED_HOST, 1):
                known.watch = value
            if index == MODE_SHOWN:
                known.mode = value - (value >> 7 << 8)
    return known


def _unknown(known: _Known, role: str, watch: int, off: int, counts_per_turn: float) -> list[str]:
    """What had to be made sure of and was not; `off`: target less position [counts], negative if none was sent."""
    near = off == 0 if role == "traction" else 0 <= off <= counts_per_turn * 3 / 360
    zero = known.target == 0 if role == "traction" else near
    checks = {
        "its identity read": known.vendor and known.version,
        "watching our heartbeat": known.watch == watch,
        "its mode of operation seen": known.mode == MODES[role],
        "a harmless target": zero,
        "the proof that it watches": known.proof,
    }
    return [what for what, done in checks.items() if not done]


def _proving(e: Evidence, time: float) -> bool:
    """The host's heartbeat pauses on purpose: in `init`, with no drive enabled."""
    look = e.look_at(time)
    return (
        "init" in e.journal.modes_between(time - 0.5, time)
        and time - e.beat_before(time) > SILENCE
        and (look is None or not any(look.enabled))
    )


def _forced(e: Evidence, name: str, time: float) -> bool:
    """The drive was put into operation by an injection, not by the host."""
    return any(i.id == "SYS-10" and i.node == name and 0.0 <= time - i.time < 2.0 for i in e.injected)


def controls_released(e: Evidence) -> Iterator[Violation]:
    """I5: driving by hand begins with the controls released."""
    odd = any(i.id.startswith(("INP", "SYS")) for i in e.injected)
    for time, mode in e.journal.modes:
        if mode != "teleop" or odd or not e.stick:
            continue
        rows = [row for row in e.stick if row.time <= time + e.tick]
        recent = [row for row in rows if row.time >= time - 2 * e.tick] or rows[-1:]
        if not any(row.neutral for row in (*recent, *rows[-1:])):
            yield Violation("I5", time, "driving by hand began with the controls held")


# ---------------------------------------------------------------------------------------------- I9


class _Asked(NamedTuple):
    time: float
    speed: float
    """Mean of both driven wheels [m/s]."""
    wheels: tuple[float, float]


def limits(e: Evidence) -> Iterator[Violation]:
    """I9: speed, acceleration, steering angle and rate stay within the limits of the robot file."""
    yield from _true_speed(e)
    yield from _speed_targets(e)
    for side in SIDES:
        yield from _steering_targets(e, side)


def _true_speed(e: Evidence) -> Iterator[Violation]:
    top = TOLERANCE * e.robot.limits.speed_m_s + TRUE_MARGIN
    for look in e.looks:
        if abs(look.speed) > top and not e.active(look.time, "RUN-01", "RUN-02", "RUN-05", "SYS-10", after=1.5):
            yield Violation("I9", look.time, f"the robot drives {look.speed:+.2f} m/s, limit {top:.2f}")
            return


def _speed_targets(e: Evidence) -> Iterator[Violation]:
    bounds, quantum = e.robot.limits, 2 * abs(e.metres_per_rpm("left"))
    run: list[_Asked] = []
    left, right = (e.wire.nodes[e.node("traction", side)].all(SetPoint) for side in SIDES)
    scales = [e.metres_per_rpm(side) for side in SIDES]
    others = {round(point.time / QUEUED): point for point in right}
    for point in left:
        slot = round(point.time / QUEUED)
        other = next((others[near] for near in (slot, slot + 1, slot - 1) if near in others), None)
        driving = e.journal.modes_between(point.time - QUEUED, point.time) <= DRIVING
        if other is None or not driving or {point.controlword, other.controlword} != {ENABLE}:
            run.clear()
            continue
        wheels = point.target * scales[0], other.target * scales[1]
        run.append(_Asked(point.time, sum(wheels) / 2, wheels))
        if max(map(abs, wheels)) > TOLERANCE * bounds.wheel_speed_m_s + quantum:
            yield Violation("I9", point.time, f"wheel targets {wheels[0]:+.2f}, {wheels[1]:+.2f} m/s")
            return
        if abs(run[-1].speed) > TOLERANCE**2 * bounds.speed_m_s + STEERED:
            yield Violation("I9", point.time, f"target speed {run[-1].speed:+.2f} m/s")
            return
        if len(run) > WINDOW:
            first, last = run[-1 - WINDOW], run[-1]
            passed, gain = last.time - first.time + JITTER, abs(last.speed) - abs(first.speed)
            most = bounds.acceleration_m_s2 if gain > 0 else bounds.deceleration_m_s2
            if first.speed * last.speed >= 0 and abs(gain) > TOLERANCE * most * passed + STEERED + quantum:
                yield Violation("I9", last.time, f"target changes by {gain:+.3f} m/s in {passed:.3f} s")
                return


def _steering_targets(e: Evidence, side: str) -> Iterator[Violation]:
    _, drive = e.robot.drive_at("steering", side)
    scale = (-1 if drive.mirrored else 1) * 2 * pi / (drive.sensor.counts_per_turn * drive.gear_ratio)
    rate = TOLERANCE * radians(e.robot.limits.steering_rate_wheel_deg_s)
    low, high = _reach(e, side)
    looks = iter(e.looks)
    look, index = next(looks, None), SIDES.index(side)
    position, last = 0, None
    odd = any(i.id in ("STE-05", "STE-06", "RUN-09", "RUN-10", "STE-03") for i in e.injected)
    for event in e.wire.nodes[drive.node_id].events:
        if isinstance(event, Status):
            position = event.position
            while look is not None and look.time < event.time - 0.002:
                look = next(looks, None)
        if not isinstance(event, SetPoint):
            continue
        calm = e.journal.modes_between(event.time - QUEUED, event.time) <= {"teleop", "follow"}
        if not calm or event.controlword != ENABLE or look is None or not look.enabled[2 + index]:
            last = None
            continue
        angle = look.angles[index] + (event.target - position) * scale
        if not odd and not low - ZERO_ERROR <= angle <= high + ZERO_ERROR:
            yield Violation("I9", event.time, f"{side} wheel is sent to {degrees(angle):+.1f} degrees")
            return
        if last is not None:
            turned, passed = abs(event.target - last.target) * abs(scale), event.time - last.time + JITTER
            if turned > rate * passed:
                speed = degrees(turned / passed)
                yield Violation("I9", event.time, f"{side} wheel is steered with {speed:.0f} degrees a second")
                return
        last = event


def _reach(e: Evidence, side: str) -> tuple[float, float]:
    """Angles [rad] of one wheel at which the virtual front wheel stands at its limits."""
    geometry, most = e.robot.geometry, TOLERANCE * radians(e.robot.limits.steering_deg)
    half = geometry.kingpin_distance_m / 2 / geometry.wheelbase_m
    inward = -half if side == "left" else half
    ends = [atan2(sin(angle), cos(angle) + inward * sin(angle)) for angle in (-most, most)]
    return ends[0], ends[1]
