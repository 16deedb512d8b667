"""The located pose: late fixes, wrong ones, none, and how the pose is corrected while the robot moves."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence

import pytest
from core_builders import NAMES, PERIOD, ROBOT, STEERING, drive, sensed
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from artemis.motion.localisation import AGREEING_TIME, CORRECTION, KEPT, LOST_DISTANCE, TURNING, Localisation
from artemis.motion.odometry import move
from artemis.motion.perception import Perception
from artemis.motion.poses import placed, seen_from
from artemis.values import LocatedPose, Odometry, Pose, PoseFix, Sensed, SetPoints, Verdict

SURE = (2.5e-5, 0.0, 0.0, 2.5e-5, 0.0, 7.6e-5)
"""5 mm and 0.5 degrees."""
MAP_FROM_ODOM = Pose(x=2.0, y=-1.0, heading=0.7)


def fix(time: float, pose: Pose, covariance: tuple[float, ...] = SURE) -> PoseFix:
    return PoseFix(time=time, pose=pose, covariance=covariance, source="camera")


class Drive:
    """A robot on a circle, 0.5 m/s; its odometry turns `bend` [rad/m] too little and does not know of the map."""

    def __init__(self, bend: float = 0.0, speed: float = 0.5) -> None:
        self.localisation = Localisation(PERIOD)
        self.tick, self.bend, self.speed = -1, bend, speed
        self.true, self.odometry = [MAP_FROM_ODOM], Odometry()
        self.shown: list[LocatedPose] = []

    @property
    def time(self) -> float:
        return self.tick * PERIOD

    def fix(self, tick: int | None = None, **off: float) -> PoseFix:
        """Where it was at a tick."""
        number = max(self.tick, 0) if tick is None else tick
        true = self.true[number]
        seen = Pose(x=true.x + off.get("x", 0.0), y=true.y + off.get("y", 0.0), heading=true.heading)
        return fix(number * PERIOD, seen)

    def go(self, *fixes: PoseFix, at_once: bool = False, unheard: bool = False) -> LocatedPose:
        """One tick."""
        self.tick += 1
        if self.tick:
            distance = self.speed * PERIOD
            self.true.append(move(self.true[-1], distance, 0.8 * distance))
            pose = move(self.odometry.pose, distance, (0.8 - self.bend) * distance)
            self.odometry = replace(self.odometry, pose=pose, distance=self.odometry.distance + distance)
        self.localisation.move(self.time, self.odometry)
        self.localisation.take(fixes, self.time)
        dt = PERIOD if self.tick else 0.0
        self.shown.append(
            self.localisation.located(self.time, dt, at_once=at_once, unheard=unheard, odometry=self.odometry)
        )
        return self.shown[-1]

    def go_on(self, ticks: int) -> LocatedPose:
        for _ in range(ticks):
            self.go()
        return self.shown[-1]


def apart(pose: LocatedPose, true: Pose) -> float:
    return math.dist((pose.pose.x, pose.pose.y), (true.x, true.y))


# ---------------------------------------------------------------------------------------------- without fixes


def rolled(time: float, left: float, right: float, angle: float) -> Sensed:
    distances = dict(zip(NAMES, (left, right), strict=False))
    found = tuple(
        drive(name, position=angle if name in STEERING else distances[name], age=0.0, frames=1) for name in NAMES
    )
    return sensed(time, drives=found)


@given(st.lists(st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.7, 0.7)), max_size=30))
def test_without_a_localizer_the_pose_is_that_of_the_odometry(steps: list[tuple[float, float, float]]) -> None:
    perception, left, right = Perception(ROBOT, PERIOD), 0.0, 0.0
    for number, (step_left, step_right, angle) in enumerate(steps):
        left, right = left + step_left, right + step_right
        seen = perception.perceive(rolled(number * PERIOD, left, right, angle), Verdict(), SetPoints())
        assert seen.pose == LocatedPose(pose=seen.odometry.pose, lost=seen.odometry.lost)


def test_with_a_localizer_that_found_nothing_yet_the_place_is_not_known() -> None:
    perception = Perception(ROBOT, PERIOD, localized=True)
    seen = perception.perceive(rolled(0.0, 0.0, 0.0, 0.0), Verdict(), SetPoints())
    assert seen.pose == LocatedPose(pose=seen.odometry.pose, lost=True)
    assert not seen.odometry.lost


def test_perception_gives_the_fixes_of_every_tick_their_place() -> None:
    perception = Perception(ROBOT, PERIOD, localized=True)
    for number in range(3):
        found = fix(number * PERIOD, MAP_FROM_ODOM)
        sample = replace(rolled(number * PERIOD, 0.0, 0.0, 0.0), fixes=(found,), urgent=number == 1)
        seen = perception.perceive(sample, Verdict(), SetPoints())
    assert (seen.pose.frame, seen.pose.source, seen.pose.unused) == ("map", "camera", 0)
    assert seen.pose.pose == MAP_FROM_ODOM
    assert seen.pose.age == 0.0


# ---------------------------------------------------------------------------------------------- when fixes come


def test_the_first_fix_places_the_robot_at_once() -> None:
    car = Drive()
    car.go()
    found = car.go(car.fix())
    assert apart(found, car.true[-1]) < 1e-12
    assert (found.frame, found.source, found.lost, found.covariance[0] >= SURE[0]) == ("map", "camera", False, True)
    assert found.age == pytest.approx(PERIOD)


def test_a_late_fix_is_placed_at_its_own_time() -> None:
    car = Drive()
    car.go_on(60)
    late = car.go(car.fix(10))
    assert apart(late, car.true[-1]) < 1e-9
    assert late.age == pytest.approx(1.0)


def test_a_fix_between_two_ticks_is_placed_between_them() -> None:
    car = Drive()
    car.go_on(20)
    half = move(car.true[10], car.speed * PERIOD / 2, 0.8 * car.speed * PERIOD / 2)
    assert apart(car.go(fix(10.5 * PERIOD, half)), car.true[-1]) < 1e-5


def test_fixes_that_are_too_old_or_from_the_future_are_counted_and_not_used() -> None:
    car = Drive()
    car.go_on(round(KEPT / PERIOD) + 20)
    assert car.go(car.fix(2)).unused == 1
    assert car.go(replace(car.fix(), time=car.time + 5 * PERIOD)).unused == 2
    assert car.shown[-1].frame == "odom"
    assert car.go(car.fix()).unused == 2


def test_a_fix_just_ahead_of_the_odometry_waits_for_it() -> None:
    car = Drive()
    car.go_on(10)
    ahead = replace(car.fix(), time=car.time + 1.4 * PERIOD)
    assert car.go(ahead).frame == "odom"
    assert car.go().frame == "map"
    assert car.shown[-1].unused == 0


def played(arrivals: Iterable[tuple[int, PoseFix]], ticks: int, at_once: bool) -> LocatedPose:
    """Fixes that arrive at these ticks."""
    car, by_tick = Drive(bend=0.05), list(arrivals)
    for tick in range(ticks):
        car.go(*(found for arrival, found in by_tick if arrival == tick), at_once=at_once)
    return car.shown[-1]


@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), min_size=1, max_size=12, unique_by=lambda f: f[0]),
    st.integers(0, 1000),
)
def test_late_fixes_in_any_order_give_the_same_pose_as_on_time(fixes: Sequence[tuple[int, int]], seed: int) -> None:
    car, dice = Drive(), random.Random(seed)
    car.go_on(61)
    found = [
        (tick, delay, car.fix(tick, x=dice.gauss(0, 0.005) + dice.choice((0, 0, 0.6)), y=dice.gauss(0, 0.005)))
        for tick, delay in fixes
    ]
    on_time = played([(tick, one) for tick, _, one in found], 90, at_once=True)
    late = played(dice.sample([(min(tick + delay, 85), one) for tick, delay, one in found], len(found)), 90, True)
    assert apart(late, on_time.pose) < 1e-9
    assert math.remainder(late.pose.heading - on_time.pose.heading, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert late.covariance == pytest.approx(on_time.covariance, rel=1e-9)
    assert (late.unused, late.age) == (on_time.unused, on_time.age)


def test_the_same_fixes_give_the_same_bits() -> None:
    dice = random.Random(3)
    car = Drive()
    car.go_on(60)
    found = [(tick + 4, car.fix(tick, x=dice.gauss(0, 0.01))) for tick in range(0, 60, 5)]
    assert played(found, 80, False) == played(found, 80, False)


# ---------------------------------------------------------------------------------------------- corrections


@given(st.lists(st.tuples(st.integers(0, 8), st.floats(-2, 2), st.floats(-2, 2), st.floats(-1, 1)), max_size=60))
def test_while_the_robot_moves_its_pose_never_jumps(fixes: list[tuple[int, float, float, float]]) -> None:
    """The first fix sets it; whatever comes then, right or wrong, on time or late."""
    car = Drive()
    car.go(car.fix(0))
    for delay, x, y, turn in fixes:
        before, odom = car.shown[-1].pose, car.odometry.pose
        true = car.true[max(car.tick - delay, 0)]
        wrong = Pose(x=true.x + x, y=true.y + y, heading=true.heading + turn)
        car.go(fix(max(car.tick - delay, 0) * PERIOD, wrong))
        expected = placed(before, seen_from(odom, car.odometry.pose))
        assert apart(car.shown[-1], expected) <= CORRECTION * PERIOD + 1e-12
        turned = math.remainder(car.shown[-1].pose.heading - expected.heading, math.tau)
        assert abs(turned) <= TURNING * PERIOD + 1e-12


def test_a_correction_is_complete_after_its_time_and_at_once_at_standstill() -> None:
    car, standing = Drive(), Drive()
    for each in (car, standing):
        each.go(each.fix(0))
        each.go_on(100)
        each.localisation._shown = (each.odometry.pose, replace(each.true[-1], x=each.true[-1].x + 0.05))
    assert apart(car.go(car.fix()), car.true[-1]) > 0.04
    assert apart(standing.go(standing.fix(), at_once=True), standing.true[-1]) < 0.01
    car.go_on(round(0.05 / CORRECTION / PERIOD))
    assert apart(car.shown[-1], car.true[-1]) < 0.01


def test_noise_is_averaged_and_a_bent_odometry_followed() -> None:
    dice, car, errors = random.Random(1), Drive(bend=0.05), []
    for tick in range(1000):
        noise = {"x": dice.gauss(0, 0.005), "y": dice.gauss(0, 0.005)}
        car.go(*([car.fix(tick - 5, **noise)] if tick % 5 == 0 and tick else []))
        errors.append(apart(car.shown[-1], car.true[-1]) if tick > 50 else 0.0)
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) < 0.006
    assert max(errors) < 0.02


# ---------------------------------------------------------------------------------------------- wrong fixes


def test_what_fixes_of_a_place_have_in_common_does_not_average_away() -> None:
    there, here = Drive(speed=0.0), Drive(speed=0.0)
    common = (4e-4, 0.0, 0.0, 4e-4, 0.0, 1e-4)
    for _ in range(200):
        here.go(replace(here.fix(), covariance=(5e-4, 0.0, 0.0, 5e-4, 0.0, 2e-4), common=common), at_once=True)
        there.go(replace(there.fix(), covariance=(5e-4, 0.0, 0.0, 5e-4, 0.0, 2e-4)), at_once=True)
    without, told = there.shown[-1].covariance, here.shown[-1].covariance
    assert without[0] < 4e-4 < told[0]
    assert told == pytest.approx([own + shared for own, shared in zip(without, common, strict=True)])
    assert here.shown[-1].pose == there.shown[-1].pose, "what is told of the pose is the same"


def test_a_heading_that_is_common_to_all_fixes_counts_where_the_odometry_carries_the_pose_on() -> None:
    robot = Drive()
    robot.go(replace(robot.fix(), common=(1e-9, 0.0, 0.0, 1e-9, 0.0, 1e-2)))
    plain = Drive()
    plain.go(plain.fix())
    aside, own = robot.go_on(100).covariance, plain.go_on(100).covariance
    assert aside[0] + aside[3] > own[0] + own[3] + 2e-3


def test_the_true_pose_lies_in_the_stated_ellipse_as_often_as_it_should() -> None:
    """Each place, 1 m long, has an error of its own that all fixes there share. The weight of a fix counts it, too."""
    dice, inside, without, runs = random.Random(5), 0, 0, 150
    common, white = 1e-4, 2.5e-5
    for _ in range(runs):
        robot, off = Drive(speed=0.5), (0.0, 0.0)
        for tick in range(200):
            if tick % 100 == 0:
                off = dice.gauss(0, common**0.5), dice.gauss(0, common**0.5)
            found = []
            if tick % 5 == 1:
                true = robot.true[robot.tick]
                noise = dice.gauss(0, white**0.5), dice.gauss(0, white**0.5)
                at = replace(true, x=true.x + off[0] + noise[0], y=true.y + off[1] + noise[1])
                spread = (common + white, 0.0, 0.0, common + white, 0.0, 1e-5)
                shared = (common, 0.0, 0.0, common, 0.0, 1e-9)
                found = [PoseFix(time=robot.time, pose=at, covariance=spread, common=shared, source="map")]
            located = robot.go(*found)
        true, (xx, xy, _, yy, _, _) = robot.true[robot.tick], located.covariance
        x, y = located.pose.x - true.x, located.pose.y - true.y
        inside += within_95_percent(x, y, xx, xy, yy)
        without += within_95_percent(x, y, xx - common, xy, yy - common)
    assert 0.95 * runs <= inside < runs
    assert without < 0.9 * runs, "what is averaged over fixes of one place is too sure"


def within_95_percent(x: float, y: float, xx: float, xy: float, yy: float) -> bool:
    """Chi-square with two degrees of freedom."""
    return (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy) < 5.99


def test_a_jump_is_not_believed_at_once() -> None:
    car = Drive()
    car.go(car.fix(0))
    for _ in range(20):
        car.go(car.fix())
    for _ in range(10):
        found = car.go(car.fix(x=0.5))
    assert apart(found, car.true[-1]) < 1e-3
    assert found.unused == 10
    for _ in range(3):
        found = car.go(car.fix())
    assert (found.unused, apart(found, car.true[-1]) < 1e-3) == (10, True)
    assert found.age == pytest.approx(PERIOD)


def test_fixes_that_go_on_to_agree_are_believed() -> None:
    """Somebody has carried the robot away."""
    car = Drive()
    for _ in range(20):
        car.go(car.fix())
    jumped = car.tick
    while car.shown[-1].age is not None and (car.tick - jumped) * PERIOD < AGREEING_TIME - PERIOD:
        car.go(car.fix(x=0.5))
    assert apart(car.shown[-1], car.true[-1]) < 1e-3
    for _ in range(5):
        car.go(car.fix(x=0.5))
    assert car.shown[-1].age == pytest.approx(PERIOD)
    for _ in range(round(0.5 / CORRECTION / PERIOD)):
        car.go(car.fix(x=0.5))
    there = car.true[-1]
    assert apart(car.shown[-1], replace(there, x=there.x + 0.5)) < 1e-3


def test_wrong_fixes_that_do_not_agree_are_never_believed() -> None:
    dice, car = random.Random(2), Drive()
    for _ in range(20):
        car.go(car.fix())
    for _ in range(150):
        car.go(car.fix(x=dice.uniform(0.5, 3), y=dice.uniform(-3, 3)))
    assert apart(car.shown[-1], car.true[-1]) < 1e-3
    assert car.shown[-1].unused == 150


# ---------------------------------------------------------------------------------------------- no fixes any more


def test_without_fixes_the_odometry_goes_on_and_the_pose_is_less_and_less_sure() -> None:
    car = Drive()
    for _ in range(20):
        car.go(car.fix())
    spread = car.shown[-1].covariance
    for seconds in (1, 2, 3):
        found = car.go_on(50)
        assert all(found.covariance[index] > spread[index] for index in (0, 3, 5))
        assert found.age == pytest.approx(seconds + PERIOD, abs=1e-6)
        assert not found.lost
        assert apart(found, car.true[-1]) < 1e-3
        spread = found.covariance


def test_the_place_is_lost_after_a_way_without_fixes_until_the_next_one() -> None:
    car = Drive(bend=0.05)
    for _ in range(20):
        car.go(car.fix())
    car.go_on(round(LOST_DISTANCE / (car.speed * PERIOD)) - 2)
    assert not car.shown[-1].lost
    assert car.go_on(10).lost
    car.go(car.fix())
    found = car.go()
    assert (found.lost, apart(found, car.true[-1]) < 0.02) == (False, True)


def test_at_rest_the_place_is_not_lost() -> None:
    car = Drive(speed=0.0)
    car.go(car.fix(0))
    found = car.go_on(3000)
    assert not found.lost
    assert found.age == pytest.approx(60.0)


def test_wheels_that_roll_unheard_make_it_unknown_while_they_do() -> None:
    car = Drive()
    car.go(car.fix(0))
    assert car.go(unheard=True).lost
    assert not car.go().lost


def test_after_wheels_rolled_uncounted_only_a_new_fix_tells() -> None:
    car = Drive()
    for _ in range(20):
        car.go(car.fix())
    car.localisation.forget()
    assert car.go(car.fix(15)).lost
    assert car.go().lost
    assert apart(car.go(car.fix()), car.true[-1]) < 1e-3
    assert not car.shown[-1].lost


def test_when_the_odometry_gets_its_origin_the_pose_stays() -> None:
    car = Drive(speed=0.0)
    for _ in range(10):
        car.go(car.fix())
    before = car.shown[-1]
    car.odometry = Odometry(pose=Pose(x=7.0, y=8.0, heading=-2.0))
    car.localisation.reset(car.odometry.pose)
    after = car.go()
    assert apart(after, before.pose) < 1e-12
    assert math.remainder(after.pose.heading - before.pose.heading, math.tau) == pytest.approx(0.0, abs=1e-12)
    car.speed = 0.5
    for _ in range(50):
        car.go(car.fix())
    assert apart(car.shown[-1], car.true[-1]) < 1e-3
    assert car.shown[-1].unused == 0


# ---------------------------------------------------------------------------------------------- doubt


def test_a_lost_localizer_takes_the_pose_back_until_its_next_fix() -> None:
    drive = Drive()
    drive.go(drive.fix())
    drive.go_on(10)
    lost = drive.go(replace(drive.fix(), covariance=(), doubt=1.0))
    assert (lost.lost, lost.age) == (True, None)
    assert drive.go(replace(drive.fix(5), doubt=0.0)).lost, "of before it was lost"
    assert drive.shown[-1].unused == 1
    found = drive.go(drive.fix(x=3.0))
    assert not found.lost
    assert apart(found, drive.true[-1]) == pytest.approx(3.0, abs=0.05), "believed at once"


def test_a_lost_localizer_of_the_future_is_lost_now_and_not_until_then() -> None:
    drive = Drive()
    drive.go(drive.fix())
    drive.go_on(10)
    assert drive.go(replace(drive.fix(), time=drive.time + 3600.0, covariance=(), doubt=1.0)).lost
    drive.go_on(2)
    assert not drive.go(drive.fix()).lost


def test_a_fix_without_a_covariance_tells_nothing_of_the_pose() -> None:
    drive, other = Drive(), Drive()
    for each, fixes in ((drive, (replace(fix(0.2, Pose(x=9.0)), covariance=(), doubt=0.9),)), (other, ())):
        each.go(each.fix())
        each.go_on(10)
        each.go(*fixes)
    assert drive.go() == other.go()


@pytest.mark.parametrize(("off", "contradicts"), [(0.25, False), (0.5, True)])
def test_fixes_that_say_that_it_is_far_away_contradict_the_pose_until_they_are_believed(
    off: float, contradicts: bool
) -> None:
    drive = Drive()
    for _ in range(20):
        drive.go(drive.fix())
    spans = [drive.go(drive.fix(x=off)).contradicted for _ in range(60)]
    assert (max(spans) > 0.0) is contradicts
    assert spans[-1] == 0.0
    if contradicts:
        grown = spans[: spans.index(max(spans)) + 1]
        assert grown == sorted(grown)
        assert max(spans) == pytest.approx(AGREEING_TIME, abs=2 * PERIOD)
    assert drive.go().contradicted == 0.0
