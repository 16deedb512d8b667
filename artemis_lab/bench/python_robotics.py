"""Outside reference: the path trackers of PythonRobotics, unmodified, from a checkout that the user names.

Their constants are set to this robot and this bench: wheelbase, greatest angle, time step, speed; all else is as they
come, but for the tuned ones, which say what differs. They get the path as points at constant distance, as their own
examples do, continued a little beyond its end, which they need to reach it.

    A. Sakai et al.: PythonRobotics: a Python code collection of robotics algorithms. arXiv 1808.10703, 2018.
"""

from __future__ import annotations

import importlib.util
import io
import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, ClassVar, TypeAlias

import numpy as np

from artemis.config import Config
from artemis.motion.angles import difference
from artemis.motion.path import Path
from artemis.plugins.contracts import Follower, Following
from artemis.plugins.followers.progress import BRAKING, Progress
from artemis.values import DriveCommand, Snapshot
from artemis.vehicle import RobotFile
from artemis_lab.bench.driving import FollowerRefused

Theirs: TypeAlias = Any
"""A module of the checkout, or a value of one."""
SPACING = 0.02
"""Between the points that they get [m]. Some take the nearest point for the foot of the perpendicular."""


@dataclass(frozen=True, slots=True)
class PeerTracker:
    """One of their trackers: file in the checkout, class of the adapter, constants that differ from theirs."""

    file: str
    adapter: Callable[[Theirs, RobotFile, float, float], Follower]
    constants: dict[str, Any] = field(default_factory=dict)


def reference(name: str, checkout: FilePath, robot: RobotFile, period: float, speed: float) -> Follower:
    """One of `REFERENCES` for a robot, ticks of `period` [s] and a speed of the virtual front wheel [m/s].

    Raises:
        Refused: its file is not there, or what it imports.
    """
    entry = REFERENCES[name]
    file = checkout / entry.file
    spec = importlib.util.spec_from_file_location(f"python_robotics_{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise FollowerRefused(f"{file} is not there; expected a checkout of PythonRobotics")
    module = importlib.util.module_from_spec(spec)
    if str(checkout) not in sys.path:
        sys.path.append(str(checkout))
    try:
        spec.loader.exec_module(module)
    except ImportError as error:
        raise FollowerRefused(f"{file.name}: {error}") from error
    for constant, value in entry.constants.items():
        setattr(module, constant, value)
    return entry.adapter(module, robot, period, speed)


class _Tracker(ABC):
    """What all adapters share: the points, and the halt at the end, which none of the trackers makes by itself."""

    Config: ClassVar[type[Config]] = Config
    beyond: ClassVar[float] = 0.6
    """Distance by which the path is continued [m]: for a front axle, which is there first."""

    def __init__(self, module: Theirs, robot: RobotFile, period: float, speed: float) -> None:
        self._module, self._speed, self._period = module, min(speed, robot.limits.speed_m_s), period
        self._deceleration = BRAKING * robot.limits.deceleration_m_s2
        self._wheelbase, self._limit = robot.geometry.wheelbase_m, math.radians(robot.limits.steering_deg)

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self._progress = Progress(path)
        points = [path.at(place) for place in np.arange(0.0, path.length, SPACING)]
        count = round(self.beyond / SPACING)
        # around a closed path the very same points: of equally near ones they take the first
        points += points[:count] if path.closed else [path.at(path.length + SPACING * n) for n in range(count)]
        self._x, self._y = [point.x for point in points], [point.y for point in points]
        self._heading = np.unwrap([point.heading for point in points]).tolist()
        self._curvature = [point.curvature for point in points]
        self._begin()

    def step(self, snapshot: Snapshot) -> Following:
        progress = self._progress
        tracking = progress.update(snapshot.pose.pose)
        with redirect_stdout(io.StringIO()):  # one of them talks
            speed, steering = self._control(snapshot)
        speed = min(speed, progress.halting_speed(self._deceleration))
        return Following(
            command=DriveCommand(speed=speed, steering=self._within(steering)),
            tracking=tracking,
            finished=progress.finished,
        )

    def _within(self, steering: float) -> float:
        return min(max(float(steering), -self._limit), self._limit)

    def _begin(self) -> None:  # noqa: B027 (only some have more to do)
        """The points are there."""

    @abstractmethod
    def _control(self, snapshot: Snapshot) -> tuple[float, float]:
        """Speed [m/s] and angle [rad] of the virtual front wheel."""

    def _state(self, snapshot: Snapshot, ahead: float = 0.0) -> Theirs:
        """Their state of the robot, at a point `ahead` of its rear axle [m]; v is the rear axle's."""
        pose, odometry = snapshot.pose.pose, snapshot.odometry
        return self._module.State(
            x=pose.x + ahead * math.cos(pose.heading),
            y=pose.y + ahead * math.sin(pose.heading),
            yaw=pose.heading,
            v=odometry.speed * math.cos(odometry.steering),
        )


class _PurePursuit(_Tracker):
    """Their state is the middle of the wheelbase."""

    beyond = 2.5  # more than it looks ahead

    def _begin(self) -> None:
        module = self._module
        module.WB, module.MAX_STEER = self._wheelbase, self._limit
        self._course, self._target = module.TargetCourse(self._x, self._y), 0

    def _control(self, snapshot: Snapshot) -> tuple[float, float]:
        state = self._state(snapshot, ahead=self._wheelbase / 2)
        steering, self._target = self._module.pure_pursuit_steer_control(state, self._course, self._target)
        return self._speed, steering


class _Stanley(_Tracker):
    def _begin(self) -> None:
        module = self._module
        module.L, module.max_steer = self._wheelbase, self._limit
        self._target = 0

    def _control(self, snapshot: Snapshot) -> tuple[float, float]:
        steering, self._target = self._module.stanley_control(
            self._state(snapshot), self._x, self._y, self._heading, self._target
        )
        return self._speed, steering


class _Lqr(_Tracker):
    def _begin(self) -> None:
        module = self._module
        module.L, module.max_steer, module.dt = self._wheelbase, self._limit, self._period
        self._errors = 0.0, 0.0

    def _control(self, snapshot: Snapshot) -> tuple[float, float]:
        steering, _, *self._errors = self._module.lqr_steering_control(
            self._state(snapshot), self._x, self._y, self._heading, self._curvature, *self._errors
        )
        return self._speed, steering


class _Mpc(_Tracker):
    """Keeps its own time step of 0.2 s for the horizon; asked at every tick."""

    def _begin(self) -> None:
        module = self._module
        module.WB, module.MAX_STEER = self._wheelbase, self._limit
        self._target, self._plan = 0, (None, None)
        self._speeds = [self._speed] * len(self._x)

    def _control(self, snapshot: Snapshot) -> tuple[float, float]:
        module, state = self._module, self._state(snapshot)
        tangent = self._heading[min(round(max(self._progress.arc_length, 0.0) / SPACING), len(self._heading) - 1)]
        state.yaw = tangent + difference(state.yaw, tangent)  # continuous, as their reference
        points, self._target, angles = module.calc_ref_trajectory(
            state, self._x, self._y, self._heading, self._curvature, self._speeds, SPACING, self._target
        )
        now = [state.x, state.y, state.v, state.yaw]
        accelerations, steering, *_ = module.iterative_linear_mpc_control(points, now, angles, *self._plan)
        self._plan = accelerations, steering
        if steering is None:
            return snapshot.set_points.speed, snapshot.set_points.steering
        speed = (state.v + accelerations[0] * module.DT) / math.cos(self._within(steering[0]))
        return min(max(speed, 0.0), self._speed), steering[0]


_PATH_TRACKING = "PathTracking/"
_PURE_PURSUIT = _PATH_TRACKING + "pure_pursuit/pure_pursuit.py"
_STANLEY = _PATH_TRACKING + "stanley_control/stanley_control.py"
_LQR = _PATH_TRACKING + "lqr_steer_control/lqr_steer_control.py"
_MPC = _PATH_TRACKING + "model_predictive_speed_and_steer_control/model_predictive_speed_and_steer_control.py"
REFERENCES = {
    "[PR] pure pursuit": PeerTracker(_PURE_PURSUIT, _PurePursuit),
    "[PR] pure pursuit, 0.7 m": PeerTracker(_PURE_PURSUIT, _PurePursuit, {"Lfc": 0.7, "k": 0.0}),
    "[PR] Stanley": PeerTracker(_STANLEY, _Stanley),
    "[PR] LQR steer": PeerTracker(_LQR, _Lqr),
    "[PR] LQR steer, Q 3 0 0.3 0": PeerTracker(_LQR, _Lqr, {"Q": np.diag([3.0, 0.0, 0.3, 0.0])}),
    "[PR] MPC": PeerTracker(_MPC, _Mpc),
    "[PR] MPC, Q 10 10 0.5 1, Rd 0.1": PeerTracker(
        _MPC,
        _Mpc,
        {"Q": np.diag([10, 10, 0.5, 1.0]), "Qf": np.diag([10, 10, 0.5, 1.0]), "Rd": np.diag([0.1, 0.1])},
    ),
}
"""By their names in the table."""
