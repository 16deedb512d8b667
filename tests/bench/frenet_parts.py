"""What each part of the Frenet follower is good for: it drives the courses with one part left out at a time.

    python -m tests.bench.frenet_parts

Prints a table: root mean square of the true cross-track error [mm] on the kinematic plant of `artemis bench followers`
(ARTEMIS, 33 deg/s each wheel), clean, and with 5 mm / 0.25 deg of noise and 1 deg of steering zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from unittest.mock import patch

import numpy as np

from artemis.motion.arrays import Array
from artemis.motion.path import Path
from artemis.motion.pose_filter import PoseFilter
from artemis.plugins.contracts import PluginContext
from artemis.plugins.followers import frenet
from artemis.testing.contracts import ROBOT
from artemis.values import Odometry, Pose
from artemis.vehicle import RobotFile
from artemis_lab.bench.courses import Course, five_courses
from artemis_lab.bench.driving import drive
from artemis_lab.bench.plant import Conditions

PLANT = ROBOT
CONDITIONS = (
    Conditions(),
    Conditions(position_noise=0.005, heading_noise=math.radians(0.25), steering_zero=math.radians(1.0)),
)


class Unfiltered(PoseFilter):
    """Believes every pose, and the steering as it is measured."""

    def update(self, pose: Pose, odometry: Odometry) -> None:
        self.pose = pose


def unplanned(path: Path, robot: RobotFile, speed: float) -> Array:
    return np.full(len(path.x), speed)


@contextmanager
def as_it_is() -> Iterator[None]:
    yield


PARTS: dict[str, Callable[[], object]] = {
    "nothing": as_it_is,
    "no look ahead (`delay_s: 0`)": as_it_is,
    "no speed plan": lambda: patch.object(frenet, "speed_profile", unplanned),
    "no waiting for the wheels": lambda: patch.object(frenet, "LAG", math.inf),
    "no pose filter, no steering zero": lambda: patch.object(frenet, "PoseFilter", Unfiltered),
    "no rounding of corners": lambda: patch.object(frenet, "rounded", lambda path, _robot: (path, [])),
}


def figure(course: Course, conditions: Conditions, delay: float) -> str:
    """Error on a course, as words."""
    context = PluginContext(name="frenet", robot=PLANT, folder=FilePath())
    follower = frenet.FrenetFollower(frenet.FrenetConfig(speed_m_s=0.7, delay_s=delay), context)
    driven = drive(follower, course, PLANT, conditions)
    if driven.problem:
        return driven.problem.partition(":")[0]
    return f"{1e3 * driven.figures.rms:.1f}"


def main() -> None:
    """Print the table."""
    courses = five_courses()
    print("| left out | " + " | ".join(course.name for course in courses) + " |")
    print("|---" * (len(courses) + 1) + "|")
    for name, without in PARTS.items():
        delay = 0.0 if "delay_s" in name else 0.033
        with without():  # type: ignore[attr-defined]
            cells = [" / ".join(figure(course, each, delay) for each in CONDITIONS) for course in courses]
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
