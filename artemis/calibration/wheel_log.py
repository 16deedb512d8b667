"""What the wheels of one run counted, and where it truly was, from a recording of artemis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from artemis.errors import RecordingError
from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.values import JobKind, Pose

LEAST_TICKS = 10


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WheelLog:
    """Driven distances and steering angles over time, all shape (n,), counted as the machine is described."""

    name: str
    time: Array
    """[s], rising."""
    distance_left: Array
    """What the left driven wheel rolled until then [m], forward positive."""
    distance_right: Array
    steering_left: Array
    """Angle of the left front wheel [rad], left positive."""
    steering_right: Array

    @property
    def rolled(self) -> float:
        """Distance of the driven wheels, forward and back, mean of both [m]."""
        return float(np.abs(np.diff(self.distance_left)).sum() + np.abs(np.diff(self.distance_right)).sum()) / 2.0


def recorded_log(recording: Recording, name: str) -> tuple[WheelLog, Trajectory | None]:
    """The longest stretch of a run in which the wheels were counted without a break, and its true poses if recorded.

    A stretch ends where the pose or the angle of a wheel is set anew, and where wheels may have rolled uncounted.

    Raises:
        RecordingError: damaged, or nothing was driven.
    """
    stretches: list[list[TickRecord]] = [[]]
    for tick in recording.ticks():
        sensed, lost = tick.snapshot.sensed, tick.snapshot.odometry.lost
        referenced = any(result.kind is JobKind.REFERENCE for result in sensed.results)
        if lost or tick.wish.reset_pose or referenced:
            stretches.append([])
        heard = all(drive.age is not None for drive in sensed.drives)
        if heard and not sensed.urgent and not lost:
            stretches[-1].append(tick)
    logs = [(_log(each, recording, name), each) for each in stretches if len(each) >= LEAST_TICKS]
    if not logs:
        raise RecordingError(f"{recording.path}: nothing was driven in this run")
    log, ticks = max(logs, key=lambda each: each[0].rolled)
    known = [(tick.snapshot.time, tick.true_pose) for tick in ticks if tick.true_pose is not None]
    return log, _trajectory(known) if known else None


def _log(ticks: list[TickRecord], recording: Recording, name: str) -> WheelLog:
    places = recording.robot.places
    rows = np.array([[tick.snapshot.sensed.drives[place].position for place in places] for tick in ticks])
    return WheelLog(
        name=name,
        time=np.array([tick.snapshot.sensed.time for tick in ticks]),
        distance_left=rows[:, 0],
        distance_right=rows[:, 1],
        steering_left=rows[:, 2],
        steering_right=rows[:, 3],
    )


def _trajectory(known: list[tuple[float, Pose]]) -> Trajectory:
    poses = np.array([[pose.x, pose.y, pose.heading] for _, pose in known])
    return Trajectory(time=np.array([time for time, _ in known]), poses=poses)
