from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import dist, pi, radians, sin, tan

import numpy as np
import numpy.typing as npt
import pytest

from artemis.axles import Geometry
from artemis.motion.angles import difference
from artemis.motion.odometry import Odometer, move
from artemis.values import Odometry, Pose

Array = npt.NDArray[np.floating]

BASE, TRACK, SCRUB = 0.560, 0.436, 0.0625
FRONT = Geometry(wheelbase_m=BASE, track_m=TRACK, scrub_radius_m=SCRUB, driven_axle="front")
REAR = Geometry(wheelbase_m=BASE, track_m=TRACK, scrub_radius_m=SCRUB, driven_axle="rear")
DT = 1 / 30
FINE = 50
"""Steps of the reference integration in one step of the odometer."""


@dataclass(frozen=True)
class Drive:
    """A motion as functions of time: speed and angle of the virtual front wheel."""

    speed: Callable[[Array], Array]
    steering: Callable[[Array], Array]


def weave(amplitude: float, frequency: float, speed: float = 0.7, offset: float = 0.0) -> Drive:
    return Drive(speed=lambda t: np.full_like(t, speed), steering=lambda t: offset - amplitude * np.cos(frequency * t))


def ramps(amplitude: float, rate: float) -> Drive:
    """To and fro at a constant steering rate, as the gate makes it."""
    frequency = rate / amplitude * pi / 2
    return Drive(
        speed=lambda t: np.full_like(t, 0.7),
        steering=lambda t: -amplitude * 2 / pi * np.arcsin(np.cos(frequency * t)),
    )


def wheel_angles(steering: Array) -> tuple[Array, Array]:
    curvature, half = np.tan(steering) / BASE, TRACK / 2 - SCRUB
    return (
        np.arctan2(curvature * BASE, 1 - curvature * half),
        np.arctan2(curvature * BASE, 1 + curvature * half),
    )


def reference(drive: Drive, geometry: Geometry, steps: int) -> tuple[Array, Array]:
    """The model in curvature, integrated by the midpoint rule on a fine grid.

    Rows at every DT: x, y, heading; distances of the left and right driven wheel, left and right wheel angle.
    """
    edges = np.arange(steps * FINE + 1) * (DT / FINE)
    middles = (edges[1:] + edges[:-1]) / 2
    angles = wheel_angles(drive.steering(edges))
    speed, steering = drive.speed(middles), drive.steering(middles)
    u, curvature = speed * np.cos(steering), np.tan(steering) / BASE
    turn = u * curvature * (DT / FINE)
    heading = np.concatenate(([0.0], np.cumsum(turn)))
    direction = heading[:-1] + turn / 2
    distances = []
    for side, delta in zip((1, -1), angles, strict=True):
        if geometry.driven_axle == "rear":
            distances.append(u * (1 - side * curvature * TRACK / 2) * (DT / FINE))
        else:
            arm = np.hypot(1 - side * curvature * (TRACK / 2 - SCRUB), curvature * BASE)
            distances.append(u * arm * (DT / FINE) - side * SCRUB * (turn + np.diff(delta)))
    rows = [u * np.cos(direction) * (DT / FINE), u * np.sin(direction) * (DT / FINE), turn, *distances]
    sums = np.concatenate((np.zeros((5, 1)), np.cumsum(rows, axis=1)), axis=1)
    return sums[:3, ::FINE].T, np.stack((sums[3], sums[4], *angles))[:, ::FINE].T


def run(drive: Drive, geometry: Geometry, seconds: float) -> tuple[float, float, Odometry]:
    """Largest position and heading error of the odometer over the motion, and its last estimate."""
    poses, wheels = reference(drive, geometry, round(seconds / DT))
    odometer = Odometer(geometry)
    odometer.update(0.0, 0.0, wheels[0, 2].item(), wheels[0, 3].item(), 0.0)
    position_error = heading_error = 0.0
    for (x, y, heading), before, now in zip(poses[1:].tolist(), wheels.tolist(), wheels[1:].tolist(), strict=False):
        pose = odometer.update(now[0] - before[0], now[1] - before[1], now[2], now[3], DT).pose
        position_error = max(position_error, dist((pose.x, pose.y), (x, y)))
        heading_error = max(heading_error, abs(difference(pose.heading, heading)))
    return position_error, heading_error, odometer.odometry


@pytest.mark.parametrize("geometry", [FRONT, REAR], ids=["front-driven", "rear-driven"])
@pytest.mark.parametrize("alpha", [-60.0, 20.0, 40.0, 60.0])
@pytest.mark.parametrize("speed", [0.7, -0.4])
def test_circle_closes(geometry: Geometry, alpha: float, speed: float) -> None:
    steering, steps = radians(alpha), 100
    duration = 2 * pi * BASE / abs(sin(steering) * speed)  # the virtual wheel's lap
    drive = Drive(speed=lambda t: np.full_like(t, speed), steering=lambda t: np.full_like(t, steering))
    left, right, *angles = reference(drive, geometry, 1)[1][1].tolist()
    dt = duration / steps
    odometer = Odometer(geometry)
    for _ in range(steps // 4):
        odometer.update(left * dt / DT, right * dt / DT, angles[0], angles[1], dt)
    radius = BASE / tan(steering)
    quarter = odometer.odometry.pose
    forward = 1 if speed > 0 else -1
    assert (quarter.x, quarter.y) == pytest.approx((forward * abs(radius), radius), abs=1e-6)
    for _ in range(steps - steps // 4):
        odometer.update(left * dt / DT, right * dt / DT, angles[0], angles[1], dt)
    end = odometer.odometry
    assert (end.pose.x, end.pose.y, end.pose.heading) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert end.distance == pytest.approx(forward * 2 * pi * abs(radius), abs=1e-6)
    assert end.speed == pytest.approx(speed, abs=1e-6)
    assert end.steering == pytest.approx(steering, abs=1e-12)
    assert end.slip == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("geometry", [FRONT, REAR], ids=["front-driven", "rear-driven"])
@pytest.mark.parametrize(
    "drive",
    [
        weave(radians(20), 1.0),
        weave(radians(35), 0.8),
        weave(radians(55), 0.45),
        weave(radians(15), 1.2, offset=radians(30)),
        weave(radians(30), 0.8, speed=-0.7),
        ramps(radians(20), radians(25)),
        ramps(radians(55), radians(25)),
    ],
    ids=["weave 20", "weave 35", "weave 55", "curve and weave", "reverse weave", "ramps 20", "ramps 55"],
)
def test_hundred_metres_of_weaving_err_by_less_than_five_millimetres(drive: Drive, geometry: Geometry) -> None:
    position_error, heading_error, _ = run(drive, geometry, 100 / 0.7)
    assert position_error < 0.005
    assert heading_error < 0.0005


def test_changing_speed_while_steering_is_followed() -> None:
    drive = Drive(speed=lambda t: 0.5 * np.sin(0.6 * t), steering=lambda t: radians(40) * np.sin(0.5 * t + 1.0))
    position_error, _, _ = run(drive, FRONT, 100.0)
    assert position_error < 0.005


def test_steering_at_standstill_leaves_the_pose() -> None:
    drive = weave(radians(60), 0.5, speed=0.0)
    position_error, heading_error, end = run(drive, FRONT, 20.0)
    assert position_error < 1e-6
    assert heading_error < 1e-6
    assert end.speed == pytest.approx(0.0, abs=1e-6)


def test_locked_wheels_that_scrub_are_reported_as_slip() -> None:
    odometer = Odometer(FRONT)
    odometer.update(0.0, 0.0, 0.0, 0.0, DT)
    odometry = odometer.update(0.0, 0.0, 0.02, 0.02, DT)
    assert odometry.slip == pytest.approx(SCRUB * 0.02 / DT, rel=0.02)


def test_straight_ahead_is_the_mean_of_both_wheels() -> None:
    odometer = Odometer(FRONT)
    odometry = odometer.update(0.011, 0.009, 0.0, 0.0, 0.02)
    assert (odometry.pose.y, odometry.pose.heading) == (0.0, 0.0)
    assert odometry.pose.x == pytest.approx(0.010, abs=1e-15)
    assert odometry.speed == pytest.approx(0.5)
    assert odometry.slip == pytest.approx(0.05)
    assert odometry.distance == pytest.approx(0.010)


@pytest.mark.parametrize("steering", [1e-12, 1e-7, 1e-5])
def test_almost_straight_is_continuous(steering: float) -> None:
    odometer = Odometer(FRONT)
    left, right = wheel_angles(np.array([steering]))
    pose = odometer.update(1.0, 1.0, left.item(), right.item(), 1.0).pose
    assert pose.x == pytest.approx(1.0, abs=1e-9)
    assert pose.y == pytest.approx(steering / BASE / 2, rel=1e-6)
    assert pose.heading == pytest.approx(steering / BASE, rel=1e-6)


def test_without_time_speed_and_slip_keep_their_values() -> None:
    odometer = Odometer(FRONT)
    before = odometer.update(0.011, 0.009, 0.0, 0.0, 0.02)
    after = odometer.update(0.001, 0.001, 0.0, 0.0, 0.0)
    assert (after.speed, after.slip) == (before.speed, before.slip)
    assert after.pose.x == pytest.approx(0.011)


def test_what_rolled_without_time_counts_when_there_is_time_again() -> None:
    odometer = Odometer(FRONT)
    odometer.update(0.011, 0.009, 0.0, 0.0, 0.0)
    after = odometer.update(0.011, 0.009, 0.0, 0.0, 0.04)
    assert after.speed == pytest.approx(0.5)
    assert after.slip == pytest.approx(0.05)
    assert odometer.update(0.011, 0.009, 0.0, 0.0, 0.02).speed == pytest.approx(0.5)


def test_reset_begins_anew() -> None:
    odometer = Odometer(FRONT)
    odometer.update(0.5, 0.5, 0.1, 0.1, 0.02)
    odometer.reset(Pose(x=1.0, y=2.0, heading=pi / 2))
    assert odometer.odometry == Odometry(pose=Pose(x=1.0, y=2.0, heading=pi / 2))
    pose = odometer.update(0.5, 0.5, 0.0, 0.0, 0.02).pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((1.0, 2.5, pi / 2))
    odometer.reset()
    assert odometer.odometry == Odometry()


def test_angles_told_to_a_drive_after_reset_are_no_steering() -> None:
    odometer = Odometer(FRONT)
    odometer.update(0.0, 0.0, 0.0, 0.0, 0.02)
    odometer.reset()
    assert odometer.update(0.0, 0.0, 0.7, 0.6, 0.02).pose == Pose()


def test_heading_stays_wrapped() -> None:
    pose = move(Pose(heading=3.0), 0.0, 1.0)
    assert pose.heading == pytest.approx(4.0 - 2 * pi)


def test_arc_moves_to_the_end_of_its_chord() -> None:
    pose = move(Pose(x=1.0, y=1.0, heading=pi / 2), pi, pi / 2)  # a quarter of a circle of radius 2, from heading north
    assert (pose.x, pose.y, pose.heading) == pytest.approx((-1.0, 3.0, pi))
