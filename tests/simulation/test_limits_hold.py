"""What leaves for the drives stays within the robot file, and a machine that is not as described is not driven away."""

from __future__ import annotations

import itertools
import math
import random
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rig import CALIBRATE, NODE, SET_POINTS, STEERING, STICK, TELEOP, TRACTION, Run, follow, run, stick, write_mission

from artemis.devices.epos_objects import Units
from artemis.mission.loading import load_mission
from artemis.motion.path import path_from_csv
from artemis.sim.world import PlantParameters
from artemis.values import Mode

MARGIN = 1.02
TICK = 0.02


def random_stick(seed: int) -> str:
    """A hand that does whatever it likes, at once: all the way to one side and back, on and off."""
    dice = random.Random(seed)
    rows = [(0.0, 0.0, 0.0, 0)]
    time = 6.0
    while time < 18.0:
        x, y = (dice.choice((-1.0, 0.0, 1.0, dice.uniform(-1, 1))) for _ in range(2))
        rows.append((round(time, 2), round(x, 2), round(y, 2), int(dice.random() < 0.85)))
        time += dice.uniform(0.1, 1.5)
    return stick(*rows, (round(time, 2), 0.0, 0.0, 0))


def set_points(seen: Run, name: str) -> list[int]:
    """The raw set-points that left for one drive while it was driven by hand."""
    identifier = SET_POINTS + NODE[name]
    frames = [f for now in seen.in_mode(Mode.TELEOP) for f in now.sent if f.id == identifier]
    assert all(frame.data[0] == 0x0F for frame in frames)
    return [int.from_bytes(frame.data[2:6], "little", signed=True) for frame in frames]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(6))
def test_no_set_point_that_leaves_exceeds_the_robot_file_however_wild_the_hand(tmp_path: Path, seed: int) -> None:
    mission = write_mission(tmp_path, [TELEOP], {"stick.csv": random_stick(seed)}, inputs=STICK)
    robot = load_mission(mission).robot
    seen = run(mission)
    assert seen.status == 0
    assert set(seen.fault_ids) <= {"INP-08"}  # a hand that jumps is only told
    speeds, rates = [0.0], [0.0]
    for name in TRACTION:
        units = Units(robot, robot.drives[name])
        wheel = [raw / units.rpm for raw in set_points(seen, name)]
        speeds += [abs(speed) for speed in wheel]
    for name in STEERING:
        units = Units(robot, robot.drives[name])
        angles = [raw / units.counts for raw in set_points(seen, name)]
        rates += [abs(b - a) / TICK for a, b in itertools.pairwise(angles)]
    assert 0.3 < max(speeds) <= robot.limits.wheel_speed_m_s * MARGIN
    allowed = math.radians(robot.limits.steering_rate_wheel_deg_s)
    assert 0.9 * allowed < max(rates) <= allowed * MARGIN
    points = [s.tick.set_points for s in seen.seen]
    assert max(abs(p.steering) for p in points) <= math.radians(robot.limits.steering_deg) + 1e-4
    assert max(abs(p.speed) for p in points) <= robot.limits.speed_m_s * MARGIN
    steps = [abs(b.speed - a.speed) for a, b in itertools.pairwise(points)]
    assert max(steps) <= robot.limits.deceleration_m_s2 * TICK * MARGIN
    true = max(max(abs(v) for v in truth.wheel_speeds) for truth in seen.world.history)
    assert true <= robot.limits.wheel_speed_m_s * 1.05


# ------------------------------------------------------------------------------------------ a machine unlike its file

WAVE = "x,y\n" + "".join(f"{i / 20:.3f},{0.15 * (1 - math.cos(1.5 * i / 20)):.4f}\n" for i in range(51))
degrees = st.floats(-3.0, 3.0)
scales = st.floats(0.95, 1.05)
true_robots = st.builds(
    PlantParameters,
    steering_zero_left_deg=degrees,
    steering_zero_right_deg=degrees,
    wheel_scale_left=scales,
    wheel_scale_right=scales,
    wheelbase_m=st.floats(0.53, 0.59),
    track_m=st.floats(0.41, 0.46),
    scrub_radius_m=st.floats(0.05, 0.075),
    potentiometer_noise_v=st.floats(0.0, 0.01),
    slip=st.floats(0.0, 0.05),
    start_steering_left_deg=st.floats(-30.0, 30.0),
    start_steering_right_deg=st.floats(-30.0, 30.0),
    heading_deg=st.floats(-180.0, 180.0),
)


@pytest.mark.exhaustive
@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@example(PlantParameters(steering_zero_left_deg=3.0, steering_zero_right_deg=3.0, slip=0.05))
@given(true_robots)
def test_no_plausible_machine_leaves_the_path_by_more_than_its_limit_without_a_stop(true: PlantParameters) -> None:
    with tempfile.TemporaryDirectory() as folder:
        seen = run(write_mission(Path(folder), [CALIBRATE, follow(0.3)], {"line.csv": WAVE}), true_robot=true)
        assert seen.status == 0 or seen.faults  # nothing else ends it
        path = path_from_csv(WAVE, "line.csv")
        origin = seen.first(lambda s: s.tick.wish.reset_pose).pose
        cos, sin = math.cos(origin.heading), math.sin(origin.heading)
        for now in seen.in_mode(Mode.FOLLOW):
            if now.tick.wish.tracking is None:
                continue
            x, y = now.pose.x - origin.x, now.pose.y - origin.y
            place = path.project(x * cos + y * sin, y * cos - x * sin, near=now.tick.wish.tracking.arc_length)
            assert abs(place.cross_track) <= 0.6 or Mode.QUICKSTOP in seen.modes
            assert abs(now.tick.wish.tracking.cross_track) <= 0.6
