"""Drives made by hand for the tests of comparisons: smooth speeds and curvatures, odometry with errors, trackers."""

from __future__ import annotations

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory
from artemis.values import Pose

DURATION = 60.0


def integrated(time: Array, speed: Array, turn_rate: Array) -> Trajectory:
    """From the origin on, with a step's mean speed [m/s] and turn rate [rad/s]."""
    dt = np.diff(time)
    heading = np.append(0.0, np.cumsum(dt * (turn_rate[1:] + turn_rate[:-1]) / 2))
    distance = dt * (speed[1:] + speed[:-1]) / 2
    middle = (heading[1:] + heading[:-1]) / 2
    x, y = (np.append(0.0, np.cumsum(distance * part)) for part in (np.cos(middle), np.sin(middle)))
    return Trajectory(time=time, poses=np.column_stack([x, y, heading]))


def driven(seed: int, *, scale: float = 1.0, bend: float = 0.0) -> Trajectory:
    """A drive of a minute, 50 poses a second; distance scaled and turns off by `bend` [rad/m]: its odometry."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, DURATION, 0.02)
    moving = np.clip(np.minimum(time - 3.0, DURATION - 4.0 - time) / 1.5, 0.0, 1.0)
    waves = 2 * np.pi * random.uniform(0.03, 0.2, (4, 1)) * time + random.uniform(0, 6, (4, 1))
    speed = moving * (0.3 + 0.05 * np.sin(waves[0]) + 0.05 * np.sin(waves[1]))
    turn_rate = speed * (0.6 * np.sin(waves[2]) + 0.4 * np.sin(waves[3]))
    return integrated(time, scale * speed, turn_rate + bend * speed)


def tracked(
    true: Trajectory,
    seed: int,
    *,
    rate: float = 30.0,
    offset: float = 0.0,
    drift: float = 0.0,
    noise: float = 0.002,
    headings: bool = True,
    frame: Pose | None = None,
) -> Trajectory:
    """What a tracker says of it, at uneven times by its own clock; noise [m] of places, and [rad] of headings."""
    random = np.random.default_rng(seed)
    count = int((true.time[-1] - true.time[0]) * rate) - 1
    time = true.time[0] + (np.arange(count) + random.uniform(0.0, 0.6, count)) / rate
    poses = true.at(time) + random.normal(size=(count, 3)) * noise
    if not headings:
        poses[:, 2] = np.nan
    shown = time + offset + drift * (time - DURATION / 2)
    return Trajectory(time=shown, poses=poses).placed(frame or Pose(x=5.0, y=-7.0, heading=2.0))


def cut(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """What lies between two times [s]."""
    kept = (begin <= trajectory.time) & (trajectory.time <= end)
    return Trajectory(time=trajectory.time[kept], poses=trajectory.poses[kept])
