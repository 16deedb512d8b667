"""What follows from feedback without judgement: time steps, odometry, standstill, and where the wheels are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, STEERING, TRACTION, drive, drives, sensed
from msgspec.structs import replace

from artemis.drive_states import DriveState
from artemis.motion.perception import Perception
from artemis.values import JobKind, JobResult, Pose, Sensed, SetPoints, Snapshot, Verdict
from artemis.vehicle import RobotFile


def seen(time: float, left: float = 0.0, right: float | None = None, angle: float = 0.0, age: float = 0.0) -> Sensed:
    """Both driven wheels have rolled so far; both front wheels stand at `angle`."""
    distances = {TRACTION[0]: left, TRACTION[1]: left if right is None else right}
    return sensed(time, drives=tuple(drive(name, position=distances.get(name, angle), age=age) for name in NAMES))


class Eyes:
    def __init__(self, robot: RobotFile = ROBOT) -> None:
        self.perception = Perception(robot, PERIOD)

    def look(self, sensed: Sensed) -> Snapshot:
        return self.perception.perceive(sensed, Verdict(), SetPoints())

    def stands(self, *distances: float) -> bool:
        """After these distances, one a tick."""
        snapshots = [self.look(seen(number * PERIOD, distance)) for number, distance in enumerate(distances)]
        return snapshots[-1].standing


# ---------------------------------------------------------------------------------------------- time


def test_time_step_is_that_since_the_last_scheduled_tick() -> None:
    eyes = Eyes()
    assert [eyes.look(seen(time)).dt for time in (0.0, 0.02, 0.05)] == pytest.approx([0.0, 0.02, 0.03])


def test_time_step_is_clamped_after_a_pause_but_the_way_is_not() -> None:
    eyes = Eyes()
    eyes.look(seen(0.0))
    snapshot = eyes.look(seen(1.0, 0.4))
    assert snapshot.dt == pytest.approx(2 * PERIOD)
    assert snapshot.odometry.pose.x == pytest.approx(0.4)
    assert snapshot.odometry.speed == pytest.approx(0.4), "over the whole second"


def test_extra_tick_takes_no_time_and_moves_nothing() -> None:
    eyes = Eyes()
    eyes.look(seen(0.0))
    before = eyes.look(seen(0.02, 0.008))
    extra = eyes.look(replace(seen(0.031, 0.012), urgent=True))
    assert (extra.dt, extra.odometry) == (0.0, before.odometry)
    after = eyes.look(seen(0.04, 0.016))
    assert after.dt == pytest.approx(0.02)
    assert after.odometry.distance == pytest.approx(0.016)
    assert after.odometry.speed == pytest.approx(0.4)


def test_snapshot_hands_on_what_it_was_given() -> None:
    points, feedback = SetPoints(speed=0.3), seen(1.0)
    snapshot = Perception(ROBOT, PERIOD).perceive(feedback, Verdict(), points)
    assert snapshot.sensed is feedback
    assert snapshot.set_points is points
    assert snapshot.time == 1.0


# ---------------------------------------------------------------------------------------------- odometry


def test_wheels_are_told_apart_by_role_and_side_not_by_their_order() -> None:
    backwards = ROBOT.model_copy(update={"drives": dict(reversed(ROBOT.drives.items()))})
    forth, back = Eyes(), Eyes(backwards)
    for number in range(10):
        feedback = seen(number * PERIOD, number * 0.01, number * 0.012, angle=0.1)
        ahead = forth.look(feedback).odometry
        reverse = back.look(replace(feedback, drives=feedback.drives[::-1])).odometry
    assert reverse == ahead
    assert ahead.pose.heading > 0.0


def test_reset_makes_the_present_place_the_origin() -> None:
    eyes = Eyes()
    for number in range(10):
        eyes.look(seen(number * PERIOD, number * 0.01, angle=0.3))
    eyes.perception.reset()
    pose = eyes.look(seen(0.2, 0.09, angle=0.3)).odometry.pose
    assert pose == Pose()
    assert eyes.look(seen(0.22, 0.1, angle=0.3)).odometry.distance == pytest.approx(0.01, rel=0.1)


def test_angle_that_a_drive_was_told_is_no_steering() -> None:
    turned = 0.5
    told = JobResult(id=1, kind=JobKind.REFERENCE, drive=STEERING[0], ok=True)
    eyes, blind = Eyes(), Eyes()
    for each in (eyes, blind):
        each.look(seen(0.0))
        each.look(seen(0.02))
    assert eyes.look(replace(seen(0.04, angle=turned), results=(told,))).odometry.pose == Pose()
    assert blind.look(seen(0.04, angle=turned)).odometry.slip > 0.0, "else the kingpins' turning rolls the wheels"
    assert eyes.look(seen(0.06, angle=turned)).odometry.pose == Pose()


# ---------------------------------------------------------------------------------------------- speed


def speeds(*ticks: tuple[float, float]) -> list[float]:
    """Speed after each tick: when it is, and when the drives measured; the robot drives 0.5 m/s all the time."""
    eyes = Eyes()
    return [eyes.look(seen(time, 0.5 * measured, age=time - measured)).odometry.speed for time, measured in ticks]


def test_tick_that_comes_late_does_not_change_the_speed() -> None:
    found = speeds((0.02, 0.001), (0.04, 0.021), (0.06, 0.041), (0.0985, 0.061), (0.1, 0.0988), (0.12, 0.101))
    assert found[1:] == pytest.approx([0.5] * 5)


def test_frames_that_miss_a_tick_do_not_change_the_speed() -> None:
    assert speeds((0.02, 0.001), (0.04, 0.021), (0.06, 0.021), (0.08, 0.061))[1:] == pytest.approx([0.5] * 3)


def test_speed_never_rises_while_one_wheel_falls_silent() -> None:
    eyes, speeds = Eyes(), []
    for number in range(30):
        time, silent = number * PERIOD, max(number - 10, 0) * PERIOD
        heard = drive(TRACTION[0], position=0.5 * (time - silent), age=silent)
        feedback = seen(time, 0.5 * time, age=0.0)
        speeds.append(eyes.look(replace(feedback, drives=(heard, *feedback.drives[1:]))).odometry.speed)
    assert max(speeds[2:]) == pytest.approx(0.5)
    assert speeds[-1] == pytest.approx(0.25), "the one that is not heard counts as standing"


def test_frames_of_one_wheel_that_miss_a_tick_do_not_change_the_speed() -> None:
    eyes, found = Eyes(), []
    for number in range(1, 6):
        time = number * PERIOD
        feedback = seen(time, 0.5 * time, age=0.0)
        if number == 3:
            lost = drive(TRACTION[0], position=0.5 * (time - PERIOD), age=PERIOD)
            feedback = replace(feedback, drives=(lost, *feedback.drives[1:]))
        found.append(eyes.look(feedback).odometry.speed)
    assert found[1:] == pytest.approx([0.5] * 4)


def test_computer_that_stalls_does_not_change_the_speed() -> None:
    stalled = speeds((0.02, 0.001), (0.04, 0.021), (0.36, 0.041), (0.38, 0.361), (0.4, 0.381))
    assert stalled[1:] == pytest.approx([0.5] * 4), "the frames that waited are as old as they are"


def test_what_was_rolled_unheard_counts_for_all_of_that_time() -> None:
    silent = [(0.04 + number * PERIOD, 0.021) for number in range(1, 10)]
    assert speeds((0.02, 0.001), (0.04, 0.021), *silent, (0.24, 0.221))[-2:] == pytest.approx([0.0, 0.5])


def test_drives_that_are_no_longer_heard_count_as_standing() -> None:
    found = speeds((0.02, 0.001), (0.04, 0.021), *((0.04 + number * PERIOD, 0.021) for number in range(1, 6)))
    assert found[1] == pytest.approx(0.5)
    assert found[-1] == 0.0


# ---------------------------------------------------------------------------------------------- standstill


def test_robot_stands_when_no_wheel_rolled_a_millimetre_in_100_ms() -> None:
    assert Eyes().stands(*[0.0] * 6)
    assert Eyes().stands(0.0, 0.0002, 0.0004, 0.0006, 0.0008, 0.001)
    assert not Eyes().stands(0.0, 0.0002, 0.0004, 0.0006, 0.0008, 0.0011)


def test_robot_that_was_not_seen_for_100_ms_does_not_stand() -> None:
    assert not Eyes().stands(0.0)
    assert not Eyes().stands(*[0.0] * 5)


def test_robot_that_has_stopped_stands_100_ms_later() -> None:
    moving = [0.008 * number for number in range(10)]
    assert not Eyes().stands(*moving, *[moving[-1]] * 4)
    assert Eyes().stands(*moving, *[moving[-1]] * 5)


@pytest.mark.parametrize("side", [0, 1])
def test_one_rolling_wheel_is_enough_not_to_stand(side: int) -> None:
    eyes = Eyes()
    for number in range(10):
        distances = [0.0, 0.0]
        distances[side] = -0.001 * number
        snapshot = eyes.look(seen(number * PERIOD, *distances))
    assert not snapshot.standing


@pytest.mark.parametrize(("age", "stands"), [(0.08, True), (0.081, False)])
def test_old_feedback_does_not_prove_a_standstill(age: float, stands: bool) -> None:
    eyes = Eyes()
    for number in range(10):
        snapshot = eyes.look(seen(number * PERIOD, age=age))
    assert snapshot.standing is stands


def test_wheel_that_was_never_heard_does_not_stand() -> None:
    eyes = Eyes()
    for number in range(10):
        unheard = drives(drive(TRACTION[1], age=None))
        snapshot = eyes.look(sensed(number * PERIOD, drives=unheard))
    assert not snapshot.standing


def test_steering_at_standstill_is_standing() -> None:
    eyes = Eyes()
    for number in range(10):
        snapshot = eyes.look(seen(number * PERIOD, angle=0.01 * number))
    assert snapshot.standing


# ---------------------------------------------------------------------------------------------- as they stand

POINTS = SetPoints(
    speed=0.4, steering=0.1, speed_left=0.39, speed_right=0.41, steering_left=0.105, steering_right=0.095
)


def as_they_stand(**states: DriveState) -> SetPoints:
    """Set-points after drives, by their names with underscores, are found in these states, wheels at 20 degrees."""
    perception = Perception(ROBOT, PERIOD)
    different = {name.replace("_", "-"): state for name, state in states.items()}
    on = DriveState.OPERATION_ENABLE
    feedback = tuple(drive(name, state=different.get(name, on), position=math.radians(20.0)) for name in NAMES)
    return perception.as_they_stand(sensed(drives=feedback), POINTS)


def test_set_points_of_enabled_drives_are_kept() -> None:
    assert as_they_stand() is POINTS


@pytest.mark.parametrize("state", [state for state in DriveState if state is not DriveState.OPERATION_ENABLE])
def test_speed_is_zero_while_a_traction_drive_is_not_enabled(state: DriveState) -> None:
    for changed in ({"traction_left": state}, {"traction_right": state}):
        points = as_they_stand(**changed)
        assert points == replace(POINTS, speed=0.0, speed_left=0.0, speed_right=0.0)


@pytest.mark.parametrize("state", [state for state in DriveState if state is not DriveState.OPERATION_ENABLE])
def test_angle_of_a_steering_drive_that_is_not_enabled_is_the_measured_one(state: DriveState) -> None:
    measured = math.radians(20.0)
    left, right = as_they_stand(steer_left=state), as_they_stand(steer_right=state)
    assert (left.steering_left, left.steering_right) == (measured, POINTS.steering_right)
    assert (right.steering_left, right.steering_right) == (POINTS.steering_left, measured)
    both = as_they_stand(steer_left=state, steer_right=state)
    assert (both.steering_left, both.steering_right) == (measured, measured)
    assert both.steering == pytest.approx(measured, abs=0.02)
    assert left.speed == right.speed == both.speed == POINTS.speed


# ---------------------------------------------------------------------------------------------- where it is, or not

LEFT = TRACTION[0]
CONFIGURED = JobResult(id=1, kind=JobKind.CONFIGURE, drive=LEFT, ok=True)
"""The drive's counter goes on from wherever it is."""


def rolling(time: float, distance: float, **left: Any) -> Sensed:  # noqa: ANN401 (of `DriveFeedback`)
    """Both driven wheels rolled so far and were heard, but for what is different of the left one."""
    wheels = (drive(name, position=distance, frames=1, age=0.0) for name in TRACTION)
    return sensed(time, drives=drives(*(replace(wheel, **left) if wheel.name == LEFT else wheel for wheel in wheels)))


def place_is_lost(speed: float, *then: Sensed) -> bool:
    """After the robot was heard to drive for 0.4 s, and then this was sensed."""
    eyes = Eyes()
    for number in range(20):
        eyes.look(rolling(number * PERIOD, speed * number * PERIOD))
    for sample in then:
        snapshot = eyes.look(sample)
    return snapshot.odometry.lost


@pytest.mark.parametrize(("speed", "lost"), [(0.4, True), (0.06, True), (0.0, False)])
@pytest.mark.parametrize(
    "anew",
    [
        lambda sample: replace(sample, drives=drives(drive(LEFT, boots=1, position=0.0, age=0.1))),
        lambda sample: replace(sample, results=(CONFIGURED,)),
        lambda sample: replace(sample, results=(CONFIGURED,), urgent=True),
    ],
    ids=["restarted", "configured", "in an extra tick"],
)
def test_place_is_lost_when_a_counter_begins_anew_unless_the_robot_stood(
    speed: float, lost: bool, anew: Callable[[Sensed], Sensed]
) -> None:
    distance = speed * 19 * PERIOD
    assert place_is_lost(speed, anew(rolling(0.4, distance)), rolling(0.42, distance)) is lost


def test_place_is_kept_by_a_robot_that_came_to_rest_before_its_drives_were_configured() -> None:
    resting = [rolling(0.4 + number * PERIOD, 0.16) for number in range(10)]
    assert not place_is_lost(0.4, *resting, replace(rolling(0.6, 0.16), results=(CONFIGURED,)), rolling(0.62, 0.16))


def test_place_is_lost_by_a_robot_of_which_one_wheel_was_heard_no_more() -> None:
    """The other one came to rest in sight."""
    resting = [rolling(0.4 + number * PERIOD, 0.16, frames=0, age=0.3) for number in range(10)]
    assert place_is_lost(0.4, *resting, replace(rolling(0.6, 0.16), results=(CONFIGURED,)))


@pytest.mark.parametrize(("distance", "lost"), [(0.009, False), (0.011, True), (-0.011, True)])
def test_place_is_lost_by_a_robot_that_rolled_while_nobody_listened(distance: float, lost: bool) -> None:
    unresponsive = replace(rolling(0.4, 0.0, frames=0, age=None), results=(CONFIGURED,))
    assert place_is_lost(0.0, unresponsive, rolling(1.0, distance)) is lost
    assert not place_is_lost(0.0, rolling(0.4, 0.0), rolling(1.0, distance)), "counted all the time"


@pytest.mark.parametrize(("jumps", "lost"), [(1, False), (2, True)])
def test_place_is_lost_by_a_wheel_whose_position_jumps(jumps: int, lost: bool) -> None:
    assert place_is_lost(0.0, rolling(0.4, 0.0, jumps=jumps)) is lost


def test_place_stays_lost_until_it_is_the_origin() -> None:
    eyes = Eyes()
    eyes.look(rolling(0.0, 0.0))
    eyes.look(rolling(0.02, 0.01))
    eyes.look(replace(rolling(0.04, 0.02), results=(CONFIGURED,)))
    assert all(eyes.look(rolling(number * PERIOD, 0.02)).odometry.lost for number in range(3, 20))
    eyes.perception.reset()
    assert not eyes.look(rolling(0.4, 0.02)).odometry.lost


@pytest.mark.parametrize(
    ("speed", "age", "lost"), [(0.4, 0.5, False), (0.4, 0.51, True), (0.4, None, True), (0.0, 9.0, False)]
)
def test_place_is_lost_while_a_wheel_is_not_heard_that_was_rolling(speed: float, age: float | None, lost: bool) -> None:
    silent = rolling(1.0, speed * 19 * PERIOD, frames=0, age=age)
    assert place_is_lost(speed, silent) is lost
    assert not place_is_lost(speed, silent, rolling(2.0, 0.5)), "it counted on"


def test_a_steering_drive_that_begins_anew_loses_no_way() -> None:
    told = replace(CONFIGURED, drive=STEERING[0])
    restarted = replace(rolling(0.4, 0.16), results=(told,))
    other = tuple(replace(each, boots=each.name == STEERING[0]) for each in restarted.drives)
    assert not place_is_lost(0.4, replace(restarted, drives=other), rolling(0.42, 0.16))


def test_only_the_ticks_in_which_wheels_roll_uncounted_say_so() -> None:
    """The place stays lost; what is near is known again by what is seen from then on."""
    eyes = Eyes()
    for number in range(20):
        eyes.look(rolling(number * PERIOD, 0.4 * number * PERIOD))
    restart = replace(rolling(0.4, 0.16), drives=drives(drive(LEFT, boots=1, position=0.0, age=0.1)))
    seen = [eyes.look(sample).odometry for sample in (restart, *(rolling(0.42 + 0.02 * k, 0.16) for k in range(5)))]
    assert all(odometry.lost for odometry in seen)
    assert seen[0].uncounted
    assert not any(odometry.uncounted for odometry in seen[2:])
