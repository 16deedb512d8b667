"""One run of one follower on one course on the kinematic plant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from artemis.errors import ConfigError
from artemis.plugins.contracts import Follower
from artemis.states.parts import flipped, flipped_command
from artemis.values import Pose, Snapshot
from artemis.vehicle import RobotFile
from artemis_lab.bench.courses import Course
from artemis_lab.bench.judge import Figures, ReferenceLine, RunTrack, judge
from artemis_lab.bench.plant import Conditions, Plant

LOST = 2.0
"""So far from its course [m] a robot is lost."""
AT_END = 0.1
"""A run ends so near to the end of its course [m]."""
SLOWEST, SLACK = 0.2, 20.0
"""A run may take the time of its course at this mean speed [m/s], and this [s]."""


class FollowerRefused(Exception):
    """The follower does not begin, and says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """What came of a run."""

    track: RunTrack
    figures: Figures
    problem: str = ""
    """Why it did not finish (`lost: ...`, `late: ...`, `elsewhere: ...`); empty if it did."""


def drive(follower: Follower, course: Course, robot: RobotFile, conditions: Conditions, seed: int = 1) -> RunOutcome:
    """Drive a course from its start to where the follower has finished and the robot stands.

    `robot` moves as its file says, but for `conditions`. Whatever the follower raises is passed on.

    Raises:
        Refused: the follower does not begin on this path.
    """
    turned = math.pi if conditions.backward else 0.0
    start = course.start(conditions.start_offset, conditions.start_heading + turned)
    plant, log = Plant(robot, conditions, start, seed), RunLog(course)
    snapshot = _seen(plant, conditions)
    try:
        follower.start(course.path(), snapshot)
    except ConfigError as error:
        raise FollowerRefused(error) from error
    while True:
        following = follower.step(snapshot)
        log.add(plant.time, plant.pose, plant.distance, plant.speed, following.command.steering)
        if log.problem or (following.finished and snapshot.standing):
            return log.driven(conditions.period)
        command = following.command
        plant.step(flipped_command(command) if conditions.backward else command)
        snapshot = _seen(plant, conditions)


def _seen(plant: Plant, conditions: Conditions) -> Snapshot:
    return flipped(plant.snapshot()) if conditions.backward else plant.snapshot()


class RunLog:
    """Writes a run down, tick by tick.

    Attributes:
        problem: Why it has to end: lost, or too long under way.
    """

    def __init__(self, course: Course) -> None:
        self._course, self._reference = course, ReferenceLine(course)
        self._longest = self._reference.length / SLOWEST + SLACK
        self._rows: list[tuple[float, ...]] = []
        self.problem = ""

    def add(self, time: float, pose: Pose, distance: float, speed: float, steering: float) -> None:
        """A tick: time [s], true pose, distance of the rear axle [m], speed [m/s], commanded angle [rad]."""
        arc, error = self._reference.locate(pose.x, pose.y)
        self._rows.append((time, pose.x, pose.y, distance, arc, error, speed, steering))
        if abs(error) > LOST:
            self.problem = f"lost: {abs(error):.1f} m from the course after {distance:.1f} m"
        elif time - self._rows[0][0] > self._longest:
            self.problem = f"late: at {arc:.1f} of {self._reference.length:.1f} m after {self._longest:.0f} s"

    @property
    def begun(self) -> bool:
        """Something is written down."""
        return bool(self._rows)

    def driven(self, period: float) -> RunOutcome:
        """The whole run; `period` of the ticks [s]."""
        time, x, y, distance, arcs, errors, speed, angles = np.array(self._rows).T
        time, distance = time - time[0], distance - distance[0]
        track = RunTrack(
            time=time, x=x, y=y, distance=distance, arc_length=arcs, cross_track=errors, speed=speed, steering=angles
        )
        problem = self.problem
        if not problem and abs(self._reference.length - arcs[-1]) > AT_END:
            problem = f"elsewhere: finished at {arcs[-1]:.2f} of {self._reference.length:.2f} m"
        return RunOutcome(track=track, figures=judge(track, self._course, period), problem=problem)
