"""A follower goes along a whole route, part by part, and never knows which end of the robot is ahead."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from core_builders import PERIOD, ROBOT, Player, StubFollower, fault_of, following, shared
from msgspec.structs import replace
from reversing_car import Car, drive, follower, straight, three_point_turn

from artemis.motion.path import Path
from artemis.plugins.contracts import Following
from artemis.states.follow import FollowMode
from artemis.states.parts import STEERED, PartByPart, flipped, flipped_command
from artemis.states.plan import FollowStep
from artemis.values import Action, DriveCommand, Event, Fault, LocatedPose, Odometry, Pose, SetPoints, Snapshot

FOLLOWERS = ("frenet", "indiveri", "pure_pursuit", "stanley")


class Taker(StubFollower):
    """Keeps what it is given; drives on until it is told to finish."""

    def __init__(self) -> None:
        super().__init__()
        self.paths: list[Path] = []
        self.seen: list[Snapshot] = []
        self.arc_length, self.command, self.finished = 0.0, DriveCommand(speed=0.2, steering=0.05), False

    def start(self, path: Path, snapshot: Snapshot) -> None:
        super().start(path, snapshot)
        self.paths.append(path)
        self.arc_length, self.finished = 0.0, False

    def step(self, snapshot: Snapshot) -> Following:
        self.seen.append(snapshot)
        tracking = replace(following().tracking, arc_length=self.arc_length, length=self.paths[-1].length)
        return Following(command=self.command, tracking=tracking, finished=self.finished)


def answered(driver: PartByPart, snapshot: Snapshot) -> Following:
    answer = driver.step(snapshot)
    assert isinstance(answer, Following)
    return answer


def standing(steering: float = 0.0, pose: Pose | None = None) -> Snapshot:
    car = Car(pose=pose or Pose())
    points = SetPoints(steering=steering)
    return replace(car.snapshot(), set_points=points, odometry=Odometry(steering=steering), standing=True)


# ---------------------------------------------------------------------------------------------- the flip


def test_flipped_is_the_same_car_seen_from_behind() -> None:
    odometry = Odometry(pose=Pose(x=1.0, y=2.0, heading=0.5), speed=0.3, steering=0.2, distance=4.0, slip=0.01)
    points = SetPoints(
        speed=0.3, steering=0.2, speed_left=0.27, speed_right=0.33, steering_left=0.22, steering_right=0.18
    )
    located = LocatedPose(pose=Pose(x=3.0, y=4.0, heading=0.6), frame="map", age=0.1)
    seen = flipped(replace(Car().snapshot(), pose=located, odometry=odometry, set_points=points))
    pose = seen.odometry.pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((1.0, 2.0, 0.5 - math.pi))
    assert seen.pose == replace(located, pose=Pose(x=3.0, y=4.0, heading=seen.pose.pose.heading))
    assert seen.pose.pose.heading == pytest.approx(0.6 - math.pi)
    assert (seen.odometry.speed, seen.odometry.steering, seen.odometry.distance) == (-0.3, -0.2, -4.0)
    assert seen.odometry.slip == 0.01
    assert (seen.set_points.speed, seen.set_points.steering) == (-0.3, -0.2)
    assert (seen.set_points.speed_left, seen.set_points.speed_right) == (-0.33, -0.27)
    assert (seen.set_points.steering_left, seen.set_points.steering_right) == (-0.18, -0.22)


def test_a_flipped_command_keeps_its_action() -> None:
    command = DriveCommand(speed=0.3, steering=-0.1, action=Action.QUICKSTOP)
    assert flipped_command(command) == DriveCommand(speed=-0.3, steering=0.1, action=Action.QUICKSTOP)


# ---------------------------------------------------------------------------------------------- part by part


@pytest.mark.parametrize("name", FOLLOWERS)
def test_every_follower_drives_a_three_point_turn(name: str) -> None:
    route, car = three_point_turn(), Car()
    steps = drive(PartByPart(follower(name), route, 0.0, ROBOT), car)
    assert math.hypot(car.pose.x, car.pose.y) < 0.08
    assert abs(math.remainder(car.pose.heading - math.pi, math.tau)) < 0.25
    assert max(abs(step.tracking.cross_track) for _, step in steps) < 0.09
    speeds = [round(math.copysign(1, seen.odometry.speed)) for seen, _ in steps if abs(seen.odometry.speed) > 0.01]
    assert [sign for index, sign in enumerate(speeds) if index == 0 or sign != speeds[index - 1]] == [1, -1, 1]


@pytest.mark.parametrize("name", FOLLOWERS)
def test_every_follower_drives_backwards_as_it_drives_forwards(name: str) -> None:
    begin = Pose(x=0.1, y=0.3, heading=0.2)
    behind = Pose(x=-0.1, y=-0.3, heading=0.2)
    there = drive(PartByPart(follower(name), straight(4.0), 0.0, ROBOT), Car(pose=begin))
    back = drive(PartByPart(follower(name), straight(4.0, backward=True), 0.0, ROBOT), Car(pose=behind))
    assert len(there) == len(back)
    for (seen, forward), (seen_too, backward) in zip(there, back, strict=True):
        assert backward.command.speed == pytest.approx(-forward.command.speed, abs=1e-6)
        assert backward.command.steering == pytest.approx(-forward.command.steering, abs=1e-6)
        assert backward.tracking.cross_track == pytest.approx(forward.tracking.cross_track, abs=1e-6)
        assert seen_too.odometry.pose.x == pytest.approx(-seen.odometry.pose.x, abs=1e-6)


def test_arc_length_counts_through_all_parts_and_the_length_is_that_of_the_route() -> None:
    route = three_point_turn()
    steps = drive(PartByPart(follower(), route, 5.0, ROBOT), Car())
    distances = [step.tracking.arc_length for _, step in steps]
    assert distances[0] == pytest.approx(5.0, abs=0.01)
    assert distances[-1] == pytest.approx(5.0 + route.length, abs=0.03)
    assert all(later > sooner - 0.005 for sooner, later in pairwise(distances))
    assert {round(step.tracking.length, 6) for _, step in steps} == {round(5.0 + route.length, 6)}


def test_the_next_part_begins_when_the_robot_stands_and_is_seen_from_its_own_end() -> None:
    taker, route = Taker(), three_point_turn()
    driver = PartByPart(taker, route, 0.0, ROBOT)
    answered(driver, standing())
    taker.finished = True
    moving = replace(standing(steering=0.3), standing=False)
    between = answered(driver, moving)
    assert between.command == DriveCommand(speed=0.0, steering=0.3)
    assert not between.finished
    answered(driver, moving)
    assert taker.starts == 1
    answered(driver, standing(steering=0.3))
    assert taker.starts == 2
    assert taker.paths[1] is route.parts[1].path
    assert taker.seen[-1].odometry.steering == -0.3
    assert abs(taker.seen[-1].pose.pose.heading) == pytest.approx(math.pi)
    taker.finished = True
    answered(driver, standing())
    answered(driver, standing())
    taker.finished = True
    assert answered(driver, standing()).finished, "after the last part"


def test_the_wheels_are_turned_before_the_robot_drives_off() -> None:
    taker = Taker()
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    taker.command = DriveCommand(speed=0.2, steering=0.6)
    held = answered(driver, standing(steering=0.0)).command
    assert held == DriveCommand(speed=0.0, steering=0.6)
    assert answered(driver, standing(steering=0.6 - 1.1 * STEERED)).command.speed == 0.0
    assert answered(driver, standing(steering=0.6 - 0.9 * STEERED)).command.speed == 0.2
    assert answered(driver, standing(steering=0.0)).command.speed == 0.2, "once"
    driver.resume()
    assert answered(driver, standing(steering=0.0)).command.speed == 0.0, "and again after a stop"


@pytest.mark.parametrize(
    ("steering", "away", "speed"),
    [(0.6, 6.1, 0.0), (0.6, 5.9, 0.2), (-0.6, -6.1, 0.0), (-0.6, -5.9, 0.2), (math.radians(6), 6.0, 0.2)],
)
def test_wheels_are_turned_to_within_6_degrees_on_either_side(steering: float, away: float, speed: float) -> None:
    taker = Taker()
    taker.command = DriveCommand(speed=0.2, steering=steering)
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    assert answered(driver, standing(steering=steering - math.radians(away))).command.speed == speed


def test_wheels_are_not_waited_for_longer_than_three_turns_to_their_limit_take() -> None:
    taker = Taker()
    taker.command = DriveCommand(speed=0.2, steering=0.6)
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    assert answered(driver, replace(standing(), dt=3 * 60 / 33)).command.speed == 0.0
    assert answered(driver, replace(standing(), dt=0.001)).command.speed == 0.2


def test_the_end_is_that_of_the_present_part() -> None:
    taker, route = Taker(), three_point_turn()
    driver = PartByPart(taker, route, 5.0, ROBOT)
    assert driver.end == pytest.approx(5.0 + route.begins[1])
    answered(driver, standing())
    taker.finished = True
    answered(driver, standing())
    answered(driver, standing())
    assert driver.end == pytest.approx(5.0 + route.begins[2])


def test_the_end_is_where_the_follower_says_that_its_path_ends() -> None:
    taker = Taker()
    driver = PartByPart(taker, straight(2.0), 5.0, ROBOT)
    answered(driver, standing())
    taker.paths[-1] = straight(1.5).parts[0].path
    answered(driver, standing())
    assert driver.end == pytest.approx(6.5, abs=0.01)


def test_a_follower_that_fails_or_answers_what_it_must_not_is_a_fault() -> None:
    taker = Taker()
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    answered(driver, standing())
    taker.command = "forwards"  # type: ignore[assignment]
    garbage = driver.step(standing())
    taker.paths.clear()
    raised = driver.step(standing())
    assert isinstance(garbage, Fault)
    assert isinstance(raised, Fault)
    assert (garbage.id, garbage.device, raised.id) == ("PLG-06", "follower", "PLG-02")
    assert "command='forwards'" in garbage.text
    assert "(IndexError('list index out of range') at test_parts.py:" in raised.text


@pytest.mark.parametrize("command", [DriveCommand(speed=math.nan, steering=0.6), DriveCommand(steering=math.nan)])
def test_a_command_that_is_no_number_is_seen_also_while_the_wheels_are_turned(command: DriveCommand) -> None:
    taker = Taker()
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    taker.command = command
    seen = answered(driver, standing(steering=0.0)).command
    assert not math.isfinite(seen.speed + seen.steering)


def test_wheels_that_the_robot_cannot_turn_so_far_are_not_waited_for() -> None:
    taker = Taker()
    taker.command = DriveCommand(speed=0.2, steering=9.0)
    driver = PartByPart(taker, straight(2.0), 0.0, ROBOT)
    assert answered(driver, standing(steering=math.radians(60))).command.speed == 0.2
    driver.resume()
    speeds = [answered(driver, standing()).command.speed for _ in range(300)]
    assert speeds[0] == 0.0
    assert speeds.index(0.2) * PERIOD == pytest.approx(3 * 60 / 33, abs=0.05)


def test_a_follower_that_cannot_start_on_a_later_part_is_a_fault() -> None:
    taker = Taker()
    driver = PartByPart(taker, three_point_turn(), 0.0, ROBOT)
    answered(driver, standing())
    taker.finished = True
    answered(driver, standing())

    def start(path: Path, snapshot: Snapshot) -> None:
        raise ValueError("no second path")

    taker.start = start  # type: ignore[method-assign]
    fault = driver.step(standing())
    assert isinstance(fault, Fault)
    assert (fault.id, fault.device) == ("PLG-02", "follower")
    assert "start: ValueError('no second path')" in fault.text


# ---------------------------------------------------------------------------------------------- in mode follow


def test_mode_follow_goes_on_in_the_part_where_an_earlier_run_stopped() -> None:
    taker, route = Taker(), three_point_turn()
    done = route.begins[1] + 0.4
    pose = route.parts[1].path.at(0.4)
    steps = shared(FollowStep(route=route, follower=taker, nearest=True), done=done)
    player = Player(FollowMode(steps))
    heading = route.parts[1].heading_at(0.4)
    wish = player.tick(odometry=Odometry(pose=Pose(x=pose.x, y=pose.y, heading=heading), steering=0.05))
    assert wish.command == DriveCommand(speed=-0.2, steering=-0.05)
    assert wish.tracking is not None
    assert wish.tracking.arc_length == pytest.approx(done, abs=0.02)
    assert wish.tracking.length == pytest.approx(route.length)
    assert taker.paths[0].length == pytest.approx(route.parts[1].path.length - 0.4, abs=0.02)
    assert taker.seen[0].pose.pose.heading == pytest.approx(math.remainder(heading + math.pi, math.tau))


def test_mode_follow_is_done_after_the_last_part() -> None:
    taker = Taker()
    steps = shared(FollowStep(route=three_point_turn(), follower=taker))
    player = Player(FollowMode(steps))
    for _ in range(2):
        player.tick()
        taker.finished = True
        assert player.tick().event is None
    player.tick()
    taker.finished = True
    assert player.tick().event is Event.DONE
    assert (taker.starts, steps.current) == (3, None)


def test_mode_follow_that_was_stopped_goes_on_in_the_same_part() -> None:
    taker = Taker()
    player = Player(FollowMode(shared(FollowStep(route=three_point_turn(), follower=taker))))
    player.tick()
    taker.finished = True
    player.tick()
    player.tick()
    player.enter()
    wish = player.tick()
    assert taker.starts == 2
    assert wish.command.speed == pytest.approx(-0.2)


def test_a_follower_that_drives_on_beyond_a_reversal_is_a_fault() -> None:
    taker, route = Taker(), three_point_turn()
    player = Player(FollowMode(shared(FollowStep(route=route, follower=taker))))
    player.tick()
    taker.arc_length = route.parts[0].path.length
    assert player.tick(odometry=Odometry(distance=1.0)).fault is None
    assert player.tick(odometry=Odometry(distance=1.19)).fault is None
    assert fault_of(player.tick(odometry=Odometry(distance=1.21))) == ("PTH-08", "")
