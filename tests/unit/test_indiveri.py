"""The follower of Indiveri and Corradini on a kinematic bicycle with a steering rate and one cycle of delay."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.motion.path import Path, path_from_csv, path_from_points
from artemis.plugins.contracts import Follower, Following, PluginContext
from artemis.plugins.followers.indiveri import IndiveriConfig, IndiveriFollower, curvature, gain
from artemis.values import LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

MISSIONS = FilePath(__file__).parents[2] / "missions"
DT = 0.02
WHEELBASE = 0.56
STEERING_RATE = math.radians(33)
ACCELERATION, DECELERATION = 0.5, 1.0
CURVATURE_LIMIT = math.tan(math.radians(60)) / WHEELBASE


def shipped(name: str) -> Path:
    return path_from_csv((MISSIONS / "paths" / name).read_text(encoding="utf-8"), name)


@pytest.fixture(scope="module")
def context() -> PluginContext:
    robot = RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)
    return PluginContext(name="indiveri", robot=robot, folder=MISSIONS)


@dataclass
class Bicycle:
    """Kinematic bicycle (pose of the rear axle) behind drives that act one cycle late."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    steering: float = 0.0
    pending: tuple[float, float] = (0.0, 0.0)

    def snapshot(self) -> Snapshot:
        pose = Pose(x=self.x, y=self.y, heading=self.heading)
        return Snapshot(
            sensed=Sensed(index=0, time=0.0),
            dt=DT,
            pose=LocatedPose(pose=pose),
            odometry=Odometry(speed=self.speed, steering=self.steering),
            standing=self.speed == 0,
            set_points=SetPoints(),
            verdict=Verdict(),
        )

    def move(self, following: Following) -> None:
        speed, steering = self.pending
        self.pending = (following.command.speed, following.command.steering)
        self.speed += min(max(speed - self.speed, -DECELERATION * DT), ACCELERATION * DT)
        turn = min(max(steering - self.steering, -STEERING_RATE * DT), STEERING_RATE * DT)
        for _ in range(10):
            self.steering += turn / 10
            step = self.speed * DT / 10
            self.heading += step * math.sin(self.steering) / WHEELBASE
            self.x += step * math.cos(self.steering) * math.cos(self.heading)
            self.y += step * math.cos(self.steering) * math.sin(self.heading)


@dataclass(frozen=True)
class Run:
    answers: list[Following]
    robot: Bicycle

    @property
    def cross_track(self) -> list[float]:
        return [answer.tracking.cross_track for answer in self.answers]


def drive(context: PluginContext, path: Path, config: IndiveriConfig, robot: Bicycle, limit_s: float = 200.0) -> Run:
    follower = IndiveriFollower(config, context)
    follower.start(path, robot.snapshot())
    answers: list[Following] = []
    while not (answers and answers[-1].finished and robot.speed == 0):
        assert len(answers) < limit_s / DT, "the follower does not come to the end of the path"
        answers.append(follower.step(robot.snapshot()))
        robot.move(answers[-1])
    return Run(answers, robot)


# ---------------------------------------------------------------------------------------------- on the plant


@pytest.mark.parametrize(
    ("name", "speed", "bound"),
    [
        ("figure_eight.csv", 0.2, 0.02),
        ("figure_eight.csv", 0.7, 0.02),
        ("slalom.csv", 0.4, 0.02),
        ("circle.csv", 0.4, 0.02),
    ],
)
def test_smooth_paths_are_followed_within_two_centimetres(
    context: PluginContext, name: str, speed: float, bound: float
) -> None:
    run = drive(context, shipped(name), IndiveriConfig(speed_m_s=speed), Bicycle())
    assert max(map(abs, run.cross_track)) < bound


def test_lateral_offset_is_driven_off_without_oscillation(context: PluginContext) -> None:
    run = drive(context, shipped("straight.csv"), IndiveriConfig(speed_m_s=0.4), Bicycle(y=0.5))
    offsets = np.array(run.cross_track)
    assert offsets[0] == pytest.approx(0.5)
    assert offsets.min() > -0.005
    assert np.diff(offsets).max() < 0.0005
    settled = next(answer for answer in run.answers if abs(answer.tracking.cross_track) < 0.02)
    assert settled.tracking.arc_length < 4.0


def test_heading_error_is_driven_off(context: PluginContext) -> None:
    run = drive(context, shipped("straight.csv"), IndiveriConfig(speed_m_s=0.3), Bicycle(heading=-0.9))
    assert run.answers[0].tracking.heading_error == pytest.approx(-0.9)
    assert abs(run.answers[-1].tracking.heading_error) < 0.01
    assert abs(run.cross_track[-1]) < 0.005


@pytest.mark.parametrize("speed", [0.1, 0.4, 0.7])
def test_robot_stops_within_two_centimetres_of_the_end(context: PluginContext, speed: float) -> None:
    run = drive(context, shipped("straight.csv"), IndiveriConfig(speed_m_s=speed), Bicycle())
    end = run.answers[-1]
    assert end.finished
    assert end.command.speed == 0
    assert abs(run.robot.x - 8.0) < 0.02
    assert not any(answer.finished for answer in run.answers if answer.tracking.arc_length < 7.98)


def test_finished_stays_finished_when_the_robot_is_pushed_back(context: PluginContext) -> None:
    path = shipped("straight.csv")
    follower = IndiveriFollower(IndiveriConfig(speed_m_s=0.3), context)
    follower.start(path, Bicycle().snapshot())
    for x in np.linspace(0.0, 7.99, 60):
        answer = follower.step(Bicycle(x=float(x)).snapshot())
    assert answer.finished
    answer = follower.step(Bicycle(x=7.9).snapshot())
    assert answer.finished
    assert answer.command.speed == 0


def test_approach_to_the_end_respects_the_deceleration(context: PluginContext) -> None:
    run = drive(context, shipped("straight.csv"), IndiveriConfig(speed_m_s=0.7), Bicycle())
    speeds = np.array([answer.command.speed for answer in run.answers if not answer.finished])
    assert np.diff(speeds).min() > -DECELERATION * DT


def test_two_laps_pass_the_crossing_four_times(context: PluginContext) -> None:
    path = shipped("figure_eight.csv")
    run = drive(context, path.with_laps(2), IndiveriConfig(speed_m_s=0.6), Bicycle())
    distances = np.array([answer.tracking.arc_length for answer in run.answers])
    assert run.answers[0].tracking.length == pytest.approx(2 * path.length)
    assert distances[-1] == pytest.approx(2 * path.length, abs=0.02)
    assert -0.001 < np.diff(distances).min() < np.diff(distances).max() < 0.02


def test_recorded_speed_slows_the_robot(context: PluginContext) -> None:
    x = np.linspace(0.0, 4.0, 9)
    path = path_from_points(x, 0 * x, speed=np.where(x < 2, 0.5, 0.1))
    run = drive(context, path, IndiveriConfig(speed_m_s=0.4), Bicycle())
    assert max(answer.command.speed for answer in run.answers) == 0.4
    late = [a.command.speed for a in run.answers if 2.5 < a.tracking.arc_length < 3.5]
    assert late == pytest.approx([0.1] * len(late))
    assert len(late) > 100


def test_commanded_curvature_stays_within_the_robots(context: PluginContext) -> None:
    run = drive(context, shipped("straight.csv"), IndiveriConfig(speed_m_s=0.3), Bicycle(y=-0.6, heading=-1.0))
    angles = [abs(answer.command.steering) for answer in run.answers]
    assert max(angles) <= math.radians(60)
    assert max(angles) > math.radians(20)


def test_with_the_laboratory_floors_curves_become_wide(context: PluginContext) -> None:
    laboratory = IndiveriConfig(speed_m_s=0.7, heading_floor_rad=0.34, switch_m=0.1, distance_floor_m=0.001)
    run = drive(context, shipped("circle.csv"), laboratory, Bicycle())
    late = np.array(run.cross_track[len(run.answers) // 2 :])
    assert -0.05 < np.mean(late) < -0.02  # only an offset makes the law steer: there is no feed-forward


# ---------------------------------------------------------------------------------------------- hysteresis


def angles_taken(run: Run) -> list[float]:
    angles = [answer.command.steering for answer in run.answers]
    return [here - before for before, here in itertools.pairwise(angles) if here != before]


@pytest.mark.parametrize("degrees", [5.0, math.degrees(0.2)])
def test_hysteresis_takes_only_larger_changes(context: PluginContext, degrees: float) -> None:
    config = IndiveriConfig(speed_m_s=0.4, hysteresis_deg=degrees)
    run = drive(context, shipped("figure_eight.csv"), config, Bicycle())
    steps = angles_taken(run)
    assert steps
    assert min(map(abs, steps)) > math.radians(degrees)
    assert max(map(abs, run.cross_track)) < 0.06


def test_without_hysteresis_every_change_is_taken(context: PluginContext) -> None:
    run = drive(context, shipped("figure_eight.csv"), IndiveriConfig(speed_m_s=0.4), Bicycle())
    assert len(angles_taken(run)) > 0.9 * len(run.answers)


# ---------------------------------------------------------------------------------------------- the law


@pytest.mark.parametrize(("y", "theta"), [(0.5, 0.0), (0.01, 0.3), (2.0, -1.0), (1e-6, 0.2)])
def test_gain_uses_the_whole_curvature(y: float, theta: float) -> None:
    h = gain(y, theta, CURVATURE_LIMIT, 1.2)
    assert (1 + 2.4) * math.sqrt(h) * math.sqrt(h * y**2 + theta**2) == pytest.approx(CURVATURE_LIMIT)


def test_gain_on_the_line_is_the_papers_special_case() -> None:
    assert gain(1e-12, 0.3, CURVATURE_LIMIT, 1.2) == pytest.approx((CURVATURE_LIMIT / (0.3 * 3.4)) ** 2)


def test_law_steers_back_to_the_line() -> None:
    assert curvature(0.3, 0.0, 2.0, 1.2) == pytest.approx(-0.6)
    assert curvature(0.0, 0.1, 4.0, 1.2) == pytest.approx(-0.48)
    assert curvature(-0.3, 0.0, 2.0, 1.2) > 0


def test_law_works_at_standstill(context: PluginContext) -> None:
    follower = IndiveriFollower(IndiveriConfig(speed_m_s=0.3), context)
    robot = Bicycle(y=0.3)
    follower.start(shipped("straight.csv"), robot.snapshot())
    answer = follower.step(robot.snapshot())
    assert answer.command.steering < 0
    assert answer.command.speed == 0.3


def test_a_speed_beyond_the_robots_is_refused(context: PluginContext) -> None:
    with pytest.raises(ConfigError, match=r"speed_m_s: 0.9; the robot's limit is 0.7"):
        IndiveriFollower(IndiveriConfig(speed_m_s=0.9), context)


def test_it_fulfils_the_contract(context: PluginContext) -> None:
    follower: Follower = IndiveriFollower(IndiveriConfig(speed_m_s=0.3), context)
    assert follower.Config is IndiveriConfig


@given(
    y=st.floats(-5, 5),
    theta=st.floats(-math.pi, math.pi),
    y_floor=st.floats(1e-4, 0.1),
    theta_floor=st.floats(1e-3, 0.4),
    damping=st.floats(1.01, 3),
)
def test_curvature_bound_holds_everywhere(
    y: float, theta: float, y_floor: float, theta_floor: float, damping: float
) -> None:
    h = gain(max(abs(y), y_floor), max(abs(theta), theta_floor), CURVATURE_LIMIT, damping)
    assert abs(curvature(y, theta, h, damping)) <= CURVATURE_LIMIT * (1 + 1e-9)
