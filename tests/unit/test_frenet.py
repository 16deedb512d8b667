"""The Frenet follower: its law on ideal wheels, its look ahead, its speed, and the figures it has to reach."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.path import Path, path_from_points
from artemis.plugins.contracts import PluginContext
from artemis.plugins.followers.frenet import APPROACH, FrenetConfig, FrenetFollower, law
from artemis.testing.contracts import ROBOT, FollowerContract
from artemis.values import LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis.vehicle import RobotFile
from artemis_lab.bench.cases import random_case
from artemis_lab.bench.courses import five_courses, random_course
from artemis_lab.bench.driving import RunOutcome, drive
from artemis_lab.bench.plant import Conditions, bicycle

COURSES = {course.name: course for course in five_courses()}
RADIUS = ROBOT.geometry.wheelbase_m / math.tan(math.radians(ROBOT.limits.steering_deg))
CLEAN = Conditions()
DISTURBED = Conditions(position_noise=0.005, heading_noise=math.radians(0.25), steering_zero=math.radians(1.0))


class TestFrenet(FollowerContract):
    plugin = FrenetFollower
    options: Mapping[str, object] = {"speed_m_s": 0.4}


def follower(robot: RobotFile = ROBOT, speed: float = 0.7, **options: float) -> FrenetFollower:
    context = PluginContext(name="frenet", robot=robot, folder=TestFrenet().given().folder)
    return FrenetFollower(FrenetConfig(speed_m_s=speed, **options), context)


def at(pose: Pose, *, speed: float = 0.0, steering: float = 0.0, told: float | None = None) -> Snapshot:
    return Snapshot(
        sensed=Sensed(index=0, time=0.0),
        dt=1 / 30,
        pose=LocatedPose(pose=pose),
        odometry=Odometry(speed=speed, steering=steering),
        standing=speed == 0.0,
        set_points=SetPoints(speed=speed, steering=steering if told is None else told),
        verdict=Verdict(),
    )


STRAIGHT = path_from_points(np.array([0.0, 4.0, 8.0]), np.zeros(3))


# ---------------------------------------------------------------------------------------------- the law


def test_on_the_path_it_asks_for_the_paths_curvature() -> None:
    assert law(0.0, 0.0, 1.3, 0.5, 4.0) == pytest.approx(1.3)


def test_beside_a_curve_it_asks_for_the_parallel_curve() -> None:
    radius, left = 2.0, 0.1
    heading = -math.atan(left / 0.5)
    turning_out_of_the_field = law(left, heading, 1 / radius, 0.5, 4.0)
    slope = -1 / (0.5 * (1 + (left / 0.5) ** 2))
    parallel = math.cos(heading) / (radius - left)
    assert turning_out_of_the_field == pytest.approx(parallel + slope * math.sin(heading))


@pytest.mark.parametrize("offset", [0.02, -0.3, 1.0, -3.0])
@pytest.mark.parametrize("askew_deg", [0.0, 60.0, -90.0, 179.0])
def test_wheels_without_inertia_come_onto_the_path_without_overshoot(offset: float, askew_deg: float) -> None:
    e, psi, step = offset, math.radians(askew_deg), 0.002
    distance, settled_at, other_side = 0.0, 0.0, 0.0
    aligned = False
    while distance < 12.0:
        psi += law(e, psi, 0.0, 0.5, 4.0) * step
        e += math.sin(psi) * step
        distance += step
        aligned = aligned or abs(psi + math.atan(e / 0.5)) < 0.01
        if aligned:
            other_side = max(other_side, -e * math.copysign(1.0, offset))
        if abs(e) > 0.02:
            settled_at = distance
    assert abs(e) < 1e-4
    assert settled_at < 9.0
    assert other_side < 0.002 or abs(askew_deg) > 0.0


def test_nothing_in_it_has_no_bound() -> None:
    for e in (0.0, 0.5, 2.0, 100.0):
        for psi in np.linspace(-math.pi, math.pi, 25).tolist():
            assert abs(law(e, psi, 3.0, 0.5, 4.0)) < 35.0


# ---------------------------------------------------------------------------------------------- around the law


def test_it_acts_on_the_pose_at_which_the_command_takes_effect() -> None:
    waiting, delayed = follower(delay_s=0.0), follower(delay_s=0.1)
    pose = Pose(x=1.0, y=0.0, heading=0.2)
    answers = []
    for each in (waiting, delayed):
        each.start(STRAIGHT, at(pose, speed=0.5))
        answers.append(each.step(at(pose, speed=0.5)).command.steering)
    ahead = Pose(x=1.0 + 0.05 * math.cos(0.2), y=0.05 * math.sin(0.2), heading=0.2)
    there = follower(delay_s=0.0)
    there.start(STRAIGHT, at(ahead, speed=0.5))
    assert answers[1] == pytest.approx(there.step(at(ahead, speed=0.5)).command.steering, abs=1e-4)
    assert answers[0] != pytest.approx(answers[1], abs=1e-2)


def test_it_waits_for_its_wheels_before_it_drives_on() -> None:
    robot = follower()
    robot.start(STRAIGHT, at(Pose(y=0.5)))
    askew = robot.step(at(Pose(y=0.5))).command
    assert askew.steering < math.radians(-50)
    assert 0.0 < askew.speed < 0.05
    ready = robot.step(at(Pose(y=0.5), steering=askew.steering)).command
    assert ready.speed > 0.3


def test_it_halts_at_the_end_and_says_so() -> None:
    robot = follower()
    rest = STRAIGHT.rest(7.8)
    robot.start(rest, at(Pose(x=7.9)))
    near = robot.step(at(Pose(x=7.9), speed=0.3))
    assert 0.0 < near.command.speed < math.sqrt(2 * ROBOT.limits.deceleration_m_s2 * 0.1)
    robot.start(rest, at(Pose(x=7.985)))
    over = robot.step(at(Pose(x=7.985)))
    assert over.finished
    assert over.command.speed == 0.0
    assert over.tracking.length == pytest.approx(0.2)


def test_more_speed_than_the_robot_has_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"frenet: speed_m_s: 0\.8; the robot's limit is 0\.7"):
        follower(speed=0.8)


def test_the_approach_fits_the_robot() -> None:
    wider = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"steering_deg": 30.0})})
    steering = []
    for robot in (ROBOT, wider):
        each = follower(robot)
        each.start(STRAIGHT, at(Pose(y=0.05)))
        steering.append(each.step(at(Pose(y=0.05))).command.steering)
    assert APPROACH * RADIUS == pytest.approx(0.485, abs=0.001)
    assert steering[0] < 2 * steering[1] < 0.0


# ---------------------------------------------------------------------------------------------- the figures


def driven(name: str, rate: float, conditions: Conditions, seed: int = 1) -> RunOutcome:
    robot = bicycle(ROBOT, rate)
    result = drive(follower(robot), COURSES[name], robot, conditions, seed)
    assert result.problem == ""
    return result


@pytest.mark.parametrize("rate", [38.0, 33.0, 29.0])
def test_clean(rate: float) -> None:
    for name in ("figure-eight", "slalom"):
        figures = driven(name, rate, CLEAN).figures
        assert figures.rms <= 0.001
        assert figures.max <= 0.003
    circle = driven("circle", rate, CLEAN).figures
    assert circle.rms <= 0.008
    assert circle.steady_rms <= 0.001
    corner = driven("corner", rate, CLEAN).figures
    assert corner.rms <= 0.025
    assert corner.max <= 0.115
    assert corner.settling_distance <= 1.5
    straight = driven("straight", rate, CLEAN).figures
    assert straight.settling_distance <= 2.5
    assert straight.overshoot <= 0.005


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_with_noise_and_a_wrong_steering_zero(seed: int) -> None:
    for name in ("figure-eight", "slalom", "circle"):
        assert driven(name, 38.0, DISTURBED, seed).figures.steady_rms <= 0.006
    assert driven("corner", 38.0, DISTURBED, seed).figures.rms <= 0.025
    assert driven("straight", 38.0, DISTURBED, seed).figures.residual <= 0.003


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(10))
def test_never_lost_on_random_courses(seed: int) -> None:
    """A slice of `artemis bench followers --random 2000 --follower frenet`."""
    case = random_case(seed)
    robot = case.robot(ROBOT)
    result = drive(follower(robot), random_course(seed, ROBOT), robot, case.conditions, seed)
    assert result.problem == ""
    assert result.figures.steady_rms <= 0.025


def robot_with(geometry: dict[str, object], limits: dict[str, object]) -> RobotFile:
    changed = {"geometry": ROBOT.geometry.model_copy(update=geometry), "limits": ROBOT.limits.model_copy(update=limits)}
    return ROBOT.model_copy(update=changed)


OTHERS = {
    "long and slow to steer": robot_with(
        {"wheelbase_m": 1.2, "track_m": 0.6, "scrub_radius_m": 0.05},
        {"steering_deg": 35.0, "steering_rate_wheel_deg_s": 15.0},
    ),
    "a small car": robot_with(
        {"wheelbase_m": 2.7, "track_m": 1.5, "scrub_radius_m": 0.0},
        {"steering_deg": 33.0, "steering_rate_wheel_deg_s": 25.0, "speed_m_s": 2.0, "wheel_speed_m_s": 3.0},
    ),
    "driven behind": robot_with({"driven_axle": "rear"}, {}),
}


@pytest.mark.exhaustive
@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", OTHERS)
def test_other_robots_by_their_files_alone(name: str, seed: int) -> None:
    """Each wheel within its own rate; a course of each random kind, every other one with the rear ahead."""
    robot = OTHERS[name]
    conditions = Conditions(start_speed=0.0, backward=seed % 2 == 1)
    result = drive(follower(robot, robot.limits.speed_m_s), random_course(seed, robot), robot, conditions, seed)
    radius = robot.geometry.wheelbase_m / math.tan(math.radians(robot.limits.steering_deg))
    assert result.problem == ""
    assert result.figures.steady_rms <= 0.06 * radius


def test_the_steps_cost_does_not_depend_on_the_paths_length() -> None:
    """Counted, not timed: of a path of 1e5 samples a step reads as many as of one of 1e3."""
    counts = []
    for samples in (1_000, 100_000):
        reads = 0

        class Counting(list[float]):
            def __getitem__(self, index: Any) -> Any:  # noqa: ANN401 (as of a list)
                nonlocal reads
                reads += 1
                return super().__getitem__(index)

        zeros = np.zeros(samples)
        path = Path(0.02 * np.arange(float(samples)), zeros, zeros, zeros, spacing=0.02)
        path._samples.x = Counting(path._samples.x)
        robot = follower()
        robot.start(path, at(Pose(x=5.0)))
        robot.step(at(Pose(x=5.0)))
        robot.step(at(Pose(x=5.01), speed=0.3))
        counts.append(reads)
    assert counts[0] == counts[1] > 0
