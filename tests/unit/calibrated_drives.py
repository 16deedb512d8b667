"""Seeded drives of machines that are not as described, with counting wheels and a noisy tracker: what a fit is given.

The machine is the vehicle of the simulation, in steps of 5 ms; its drives set the wheels as a pair by the description.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter  # scipy has no types

from artemis.axles import Geometry
from artemis.calibration.kinematics import TWO_WHEELS, Kinematics, altered
from artemis.calibration.wheel_log import WheelLog
from artemis.motion.ackermann import Ackermann
from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory
from artemis.sim.vehicle import Chassis, Vehicle
from artemis.values import Pose

DESCRIBED = Geometry(wheelbase_m=0.56, track_m=0.436, scrub_radius_m=0.0625, driven_axle="front")
STEP = 0.005
MEMORY = 3.0
"""Over which slip is correlated [s]."""
COUNT, STEERING_COUNT = 2.1276596e-4, math.radians(1 / 5255.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """One drive of one machine."""

    log: WheelLog
    truth: Trajectory
    poses: Array
    """Of the rear axle's centre at the times of the log, without noise, from the origin."""


def hidden(seed: int) -> dict[str, float]:
    """What is not as described, by the names of the parameters."""
    dice = random.Random(seed)
    return {each.name: dice.gauss(0.0, each.band) for each in TWO_WHEELS}


def drive(
    values: dict[str, float],
    seed: int,
    *,
    duration: float = 120.0,
    largest: float = 45.0,
    slip: float = 0.002,
    noise: tuple[float, float] = (0.002, math.radians(0.2)),
    hertz: float = 50.0,
    on_axle: bool = False,
    wander: float = 0.0,
    filtered: float = 0.0,
) -> Drive:
    """Weave, forwards and backwards, with halts at which the wheels turn.

    Args:
        values: what the machine hides.
        seed: of the distance, the slip, the tracker.
        duration: of the drive [s].
        largest: angle of the virtual front wheel [deg].
        slip: share of its distance that a driven wheel loses on average.
        noise: standard deviations of the tracker [m, rad].
        hertz: ticks a second.
        on_axle: the tracker is at the rear axle's centre, not anywhere.
        wander: standard deviation of a slip of each wheel that is correlated over `MEMORY`.
        filtered: time constant of a low pass in the tracker [s].
    """
    dice = random.Random(seed)
    machine = altered(Kinematics.of(DESCRIBED), values)
    time, speed, steering = _commanded(dice, duration, math.radians(largest))
    counted = counted_by_drives(speed, steering)
    poses = moved(machine, _slipped(counted, wander, seed), slip, dice)
    ticks = np.arange(0, len(time), round(1 / hertz / STEP))
    distances = np.round(counted[ticks, :2] / COUNT) * COUNT
    angles = np.round(counted[ticks, 2:] / STEERING_COUNT) * STEERING_COUNT
    log = WheelLog(
        name=f"drive {seed}",
        time=time[ticks],
        distance_left=distances[:, 0],
        distance_right=distances[:, 1],
        steering_left=angles[:, 0],
        steering_right=angles[:, 1],
    )
    truth = _tracked(time, _low_pass(poses, filtered), dice, noise, on_axle)
    return Drive(log=log, truth=truth, poses=poses[ticks])


def _slipped(counted: Array, wander: float, seed: int) -> Array:
    """What the wheels truly roll while the drives count `counted`."""
    if not wander:
        return counted
    keep = math.exp(-STEP / MEMORY)
    drawn = np.random.default_rng(seed).normal(0.0, wander, (len(counted) - 1, 2)) * math.sqrt(1.0 - keep**2)
    slip: Array = np.asarray(lfilter([1.0], [1.0, -keep], drawn, axis=0), dtype=np.float64)
    rolled = counted.copy()
    rolled[1:, :2] = np.cumsum(np.diff(counted[:, :2], axis=0) * (1.0 - slip), axis=0)
    return rolled


def _low_pass(poses: Array, period: float) -> Array:
    keep = math.exp(-STEP / period) if period else 0.0
    return np.asarray(poses[0] + lfilter([1.0 - keep], [1.0, -keep], poses - poses[0], axis=0), dtype=np.float64)


def _commanded(dice: random.Random, duration: float, largest: float) -> tuple[Array, Array, Array]:
    count = round(duration / STEP) + 1
    speeds, angles = np.zeros(count), np.zeros(count)
    wanted_speed, wanted_angle = 0.0, 0.0
    for step in range(1, count):
        time = step * STEP
        if time % 2.0 < STEP:
            wanted_angle = dice.uniform(-largest, largest)
        if time % 12.0 < STEP:
            wanted_speed = dice.choice([0.3, 0.4, 0.5, -0.4])
        wanted = 0.0 if time < 1.5 or time % 24.0 < 2.0 else wanted_speed
        speeds[step] = speeds[step - 1] + min(max(wanted - speeds[step - 1], -0.5 * STEP), 0.5 * STEP)
        change = wanted_angle - angles[step - 1] if time > 1.5 else 0.0
        angles[step] = angles[step - 1] + min(max(change, -0.4 * STEP), 0.4 * STEP)
    return np.arange(count, dtype=np.float64) * STEP, speeds, angles


def counted_by_drives(speed: Array, steering: Array) -> Array:
    """Distances [m] and angles [rad] of both sides, as drives count them that keep the wheels a pair; shape (n, 4)."""
    car = Ackermann(DESCRIBED)
    angles = np.array([car.wheel_angles(each) for each in steering])
    counted, distances = np.zeros((len(speed), 4)), np.zeros(2)
    counted[0, 2:] = angles[0]
    for step in range(1, len(speed)):
        turned = angles[step] - angles[step - 1]
        middle, rolled = (steering[step] + steering[step - 1]) / 2, speed[step] * STEP
        distances = distances + car.wheel_speeds(rolled, middle, *turned)
        counted[step] = *distances, *angles[step]
    return counted


def moved(machine: Kinematics, counted: Array, slip: float, dice: random.Random) -> Array:
    """Poses of the rear axle's centre of a machine whose drives counted so; shape (n, 3)."""
    left, right = machine.zero_left, machine.zero_right
    angles = (counted[:, 2:] - (left, right)) * (machine.scale_left, machine.scale_right)
    distances = np.diff(counted[:, :2], axis=0) * (machine.distance_left, machine.distance_right) / (1.0 - slip)
    chassis = Chassis(
        wheelbase=machine.wheelbase,
        track=machine.track,
        scrub_radius=machine.scrub_radius,
        front_driven=machine.front_driven,
    )
    vehicle = Vehicle(chassis, steering=(angles[0, 0], angles[0, 1]), slip=slip, dice=dice)
    poses = np.zeros((len(counted), 3))
    for step, (angle, distance) in enumerate(zip(angles[1:].tolist(), distances.tolist(), strict=True), 1):
        vehicle.move(*angle, *distance)
        poses[step] = vehicle.x, vehicle.y, vehicle.heading
    return poses


def _tracked(time: Array, poses: Array, dice: random.Random, noise: tuple[float, float], on_axle: bool) -> Trajectory:
    """By a tracker in its own frame and time."""
    period, offset = 1.0 / dice.choice([20.0, 40.0, 100.0]), dice.uniform(-0.2, 0.2)
    seen = np.arange(0.0, time[-1], period)
    trajectory = Trajectory(time=time, poses=poses)
    arm = Pose(x=dice.uniform(-0.3, 0.6), y=dice.uniform(-0.2, 0.2), heading=dice.uniform(-0.05, 0.05))
    arm = Pose() if on_axle else arm
    frame = Pose(x=dice.uniform(-3, 3), y=dice.uniform(-3, 3), heading=dice.uniform(-3, 3))
    tracked = Trajectory(time=seen, poses=trajectory.at(seen)).of_point(arm).placed(frame)
    errors = [[dice.gauss(0, noise[0]), dice.gauss(0, noise[0]), dice.gauss(0, noise[1])] for _ in seen]
    return Trajectory(time=seen + offset, poses=tracked.poses + np.array(errors))
