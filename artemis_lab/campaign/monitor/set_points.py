"""I9: what the robot is told stays within its limits, and fits together."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import atan2, cos, degrees, hypot, pi, radians, sin
from typing import NamedTuple

from artemis_lab.campaign.monitor.evidence import Evidence, Violation
from artemis_lab.campaign.monitor.frames import DRIVING, QUEUED
from artemis_lab.campaign.monitor.wire import ENABLE, SetPoint, Status
from artemis_lab.campaign.witness import SIDES

TOLERANCE = 1.02
WINDOW = 5
"""Accelerations are looked at over so many set-points: the steering's own share of a wheel's speed evens out."""
STEERED = 0.016
"""What that share may still change of the mean of both wheels [m/s]."""
JITTER = 0.004
"""Between two ticks' frames on the wire [s]."""
TRUE_MARGIN = 0.05
"""The true speed may be so much above the limit: regulators overshoot, wheels differ from their calibration [m/s]."""
PUSHED, ROLLS = ("RUN-01", "RUN-02", "RUN-05", "STE-05", "SYS-10"), 0.02
"""With these the robot is faster than it was told, until it stands [m/s]: without power nothing brakes it."""
ZERO_ERROR = radians(1.5)
"""The wheels' true angle and the believed one may differ by this much [rad]."""
STEADY_TIME, STEADY = 0.3, radians(0.4)
"""A robot whose wheels turned and shall turn no more than this [rad] in this time [s] drives a circle."""
UNEVEN, UNFIT = radians(3.0), 0.015
"""What a sound robot's wheels may be off: in angle [rad] and speed [m/s]."""
UNTRUE = ("STE-01", "STE-02", "STE-03", "STE-04", "STE-05", "STE-06", "STE-07", "CAL-01", "COM-12")
"""With these the wheels do not stand where the host believes, through no fault of its own."""


class _Asked(NamedTuple):
    time: float
    speed: float
    """Mean of both driven wheels [m/s]."""
    wheels: tuple[float, float]


def limits(e: Evidence) -> Iterator[Violation]:
    """I9: speed, acceleration, steering angle and rate stay within the limits of the robot file."""
    yield from _true_speed(e)
    yield from _speed_targets(e)
    yield from _pairs(e)
    for side in SIDES:
        yield from _steering_targets(e, side)


def _true_speed(e: Evidence) -> Iterator[Violation]:
    top = TOLERANCE * e.robot.limits.speed_m_s + TRUE_MARGIN
    pushed = False
    for look in e.looks:
        pushed = e.active(look.time, *PUSHED, after=1.5) or (pushed and abs(look.speed) > ROLLS)
        if abs(look.speed) > top and not pushed:
            yield Violation("I9", look.time, f"the robot drives {look.speed:+.2f} m/s, limit {top:.2f}")
            return


def _speed_targets(e: Evidence) -> Iterator[Violation]:
    bounds, quantum = e.robot.limits, 2 * abs(e.metres_per_unit("left"))
    run: list[_Asked] = []
    left, right = (e.wire.nodes[e.node("traction", side)].all(SetPoint) for side in SIDES)
    scales = [e.metres_per_unit(side) for side in SIDES]
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


def _pairs(e: Evidence) -> Iterator[Violation]:
    """Both wheels are sent about one turning point, and each driven wheel with the speed that belongs to its place."""
    if any(i.id in (*UNTRUE, "RUN-09", "RUN-10") for i in e.injected):
        return
    asked: dict[tuple[str, str], SetPoint] = {}
    angles: list[tuple[float, ...]] = []
    talks = {(role, side): e.wire.nodes[e.node(role, side)] for role in ("traction", "steering") for side in SIDES}
    points = sorted(
        ((point.time, place, point) for place, talk in talks.items() for point in talk.all(SetPoint)),
        key=lambda entry: entry[0],
    )
    scales = {side: e.metres_per_unit(side) for side in SIDES}
    for time, place, point in points:
        asked[place] = point
        if len(asked) < 4 or time - min(one.time for one in asked.values()) > QUEUED:
            continue  # the others of this tick follow
        look, calm = e.look_at(time), all(one.controlword == ENABLE for one in asked.values())
        driving = e.journal.modes_between(time - QUEUED, time) <= DRIVING
        if look is None or not calm or not driving or not all(look.enabled):
            angles.clear()
            continue
        wanted = [asked["steering", side].target * _radians_per_count(e, side) for side in SIDES]
        angles.append((time, *look.angles, *wanted))
        while angles[0][0] < time - STEADY_TIME:
            angles.pop(0)
        turned = max(abs(now - then) for now, then in zip(angles[-1][1:], angles[0][1:], strict=True))
        if time - angles[0][0] < 0.5 * STEADY_TIME or turned > STEADY:
            continue
        left, right = (asked["traction", side].target * scales[side] for side in SIDES)
        steps = (abs(b - a) for one, two in pairwise(angles) for a, b in zip(one[3:], two[3:], strict=True))
        roll = max(steps, default=0.0) / e.tick * e.robot.geometry.scrub_radius_m
        kept = _belongs(e, look.angles, (left, right), roll)
        if kept is not None:
            yield Violation("I9", time, kept)
            return


def _belongs(e: Evidence, angles: tuple[float, float], speeds: tuple[float, float], roll: float) -> str | None:
    """What is wrong with wheel angles [rad] and speeds [m/s] of a robot that turns about one point.

    A wheel that is steered, be it there and back, rolls about its kingpin meanwhile: `roll` [m/s] at most.
    """
    half = _half(e)
    virtual = [
        atan2(sin(angle), cos(angle) + side * half * sin(angle)) for angle, side in zip(angles, (1, -1), strict=True)
    ]
    if abs(virtual[0] - virtual[1]) > UNEVEN:
        return f"wheels at {degrees(angles[0]):+.1f} and {degrees(angles[1]):+.1f} degrees turn about two points"
    if e.robot.geometry.driven_axle != "front" or abs(sum(speeds)) < 0.2:
        return None
    middle, out = sum(virtual) / 2, e.robot.geometry.scrub_radius_m / e.robot.geometry.wheelbase_m
    s, c = sin(middle), cos(middle)
    left, right = hypot(s, c - half * s) - out * s, hypot(s, c + half * s) + out * s
    fits = sum(speeds) / (left + right)
    if max(abs(speeds[0] - fits * left), abs(speeds[1] - fits * right)) > UNFIT + roll:
        return f"wheel targets {speeds[0]:+.3f}, {speeds[1]:+.3f} m/s do not belong to {degrees(middle):+.1f} degrees"
    return None


def _steering_targets(e: Evidence, side: str) -> Iterator[Violation]:
    _, drive = e.robot.drive_at("steering", side)
    scale = _radians_per_count(e, side)
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
        calm = e.journal.modes_between(event.time - QUEUED, event.time) <= DRIVING
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


def _radians_per_count(e: Evidence, side: str) -> float:
    _, drive = e.robot.drive_at("steering", side)
    scale = e.robot.angle_source(side).scale * 2 * pi / (drive.sensor.counts_per_turn * drive.gear_ratio)
    return -scale if drive.mirrored else scale


def _reach(e: Evidence, side: str) -> tuple[float, float]:
    """Angles [rad] of one wheel at which the virtual front wheel stands at its limits."""
    most, half = TOLERANCE * radians(e.robot.limits.steering_deg), _half(e)
    table = e.robot.geometry.linkage
    if isinstance(table, tuple):
        turned = [row.motor_deg for row in table]  # the file has to say all that the limit allows
        return radians(turned[0]), radians(turned[-1])
    inward = -half if side == "left" else half
    ends = [atan2(sin(angle), cos(angle) + inward * sin(angle)) for angle in (-most, most)]
    return ends[0], ends[1]


def _half(e: Evidence) -> float:
    """Half of the kingpins' distance as the steering motors see it, in wheelbases: none for a single one."""
    return e.robot.geometry.steered_kingpin_distance_m / 2 / e.robot.geometry.wheelbase_m
