"""Align the wheels: where they stand comes from the potentiometers, never from the encoders' zero."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace

from artemis.states.mode import OFF, ON, Plan, Routine, fail, finish_jobs
from artemis.supervision import catalogue
from artemis.values import DriveState, Fault, JobKind, Snapshot, Wish
from artemis.vehicle import Potentiometers

READINGS = 100
"""Readings of each potentiometer that are averaged (thesis 4.3.1)."""
RAIL = 0.02
"""Within this part of the 0..5 V range from a rail a potentiometer counts as open or shorted."""
SUPPLY_V = 5.0
STRAIGHT = math.radians(0.5)
"""A wheel this close to straight ahead is aligned [rad]."""
STEER_TIME = 12.0
"""Longest time for steering straight [s]: from lock to straight takes 2.3 s at 33 degrees a second."""


def wheel_angles(volts: tuple[float, float], calibration: Potentiometers) -> tuple[float, float]:
    """The wheel's angle [rad] by each of its two potentiometers (two-point calibration, thesis 4.3.1)."""
    first, second = (
        math.radians(slope * (volt - zero))
        for volt, zero, slope in zip(volts, calibration.zero_v, calibration.slope_deg_per_v, strict=True)
    )
    return first, second


Readings = dict[str, tuple[float, float]]
"""Mean voltages of both potentiometers [V], by steering drive."""


def align(plan: Plan, snapshot: Snapshot) -> Routine:
    """At rest: read the potentiometers, tell the drives their angle, enable all drives, steer straight ahead."""
    volts, snapshot = yield from _read_potentiometers(plan, snapshot)
    names = plan.drives("steering")
    fault = next((f for name in names for f in _implausible(plan, name, volts[name])), None)
    if fault is not None:
        return (yield from fail(OFF, fault))
    angles = [sum(_angles(plan, name, volts[name])) / 2 for name in names]
    for kind, drives, values in ((JobKind.REFERENCE, names, angles), (JobKind.CLEAR_TARGET, plan.drives(), None)):
        results, snapshot = yield from finish_jobs(replace(OFF, phase=kind.value), plan.jobs(kind, drives, values))
        for result in results:
            if not result.ok:
                return (yield from fail(OFF, catalogue.fault("COM-08", result.drive, result.detail)))
    return (yield from _steer_straight(snapshot))


def enable(snapshot: Snapshot) -> Routine:
    """Enable all drives; the supervisor judges one that takes too long."""
    wish = replace(ON, phase="enabling")
    while any(drive.state is not DriveState.OPERATION_ENABLE for drive in snapshot.sensed.drives):
        snapshot = yield replace(wish, command=replace(ON.command, steering=snapshot.set_points.steering))
    return snapshot


def _steer_straight(snapshot: Snapshot) -> Routine:
    snapshot = yield from enable(snapshot)
    latest = snapshot.time + STEER_TIME
    wish = replace(ON, phase="steering straight")
    while True:
        crooked = [d for d in snapshot.sensed.drives if d.mode < 0 and abs(d.position) > STRAIGHT]
        if not crooked and snapshot.standing:
            return snapshot
        if snapshot.time > latest:
            seen = f"{math.degrees(crooked[0].position):.1f} degrees" if crooked else "the robot does not stand"
            name = crooked[0].name if crooked else ""
            return (yield from fail(ON, catalogue.fault("STE-01", name, seen)))
        snapshot = yield wish


def _read_potentiometers(plan: Plan, snapshot: Snapshot) -> Generator[Wish, Snapshot, tuple[Readings, Snapshot]]:
    readings: dict[str, list[tuple[float, float]]] = {name: [] for name in plan.drives("steering")}
    wish = replace(OFF, phase="reading potentiometers")
    for _ in range(READINGS):
        snapshot = yield wish
        for drive in snapshot.sensed.drives:
            if drive.name in readings:
                readings[drive.name].append(drive.potentiometers)
    means = {
        name: (sum(a for a, _ in pairs) / len(pairs), sum(b for _, b in pairs) / len(pairs))
        for name, pairs in readings.items()
    }
    return means, snapshot


def _angles(plan: Plan, name: str, volts: tuple[float, float]) -> tuple[float, float]:
    return wheel_angles(volts, plan.robot.potentiometers(plan.robot.drives[name].side))


def _implausible(plan: Plan, name: str, volts: tuple[float, float]) -> list[Fault]:
    margin = RAIL * SUPPLY_V
    if any(not margin <= volt <= SUPPLY_V - margin for volt in volts):
        return [catalogue.fault("STE-04", name, f"{volts[0]:.2f} V and {volts[1]:.2f} V")]
    first, second = (math.degrees(angle) for angle in _angles(plan, name, volts))
    if abs(first - second) > plan.robot.calibration.steering.disagreement_deg:
        return [catalogue.fault("STE-03", name, f"{first:.1f} and {second:.1f} degrees")]
    return []
