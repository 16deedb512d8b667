"""The speed that obstacles leave: a robot that drives as it is told, and a scanner that sees what it can."""

import math
from collections import deque
from math import inf, radians

import numpy as np
import pytest
from msgspec.structs import replace as changed

from artemis.motion.beams import LOST
from artemis.motion.lane import unseen_ahead
from artemis.motion.obstacles import BLOCKED_TIME, REVERSE_SPEED, UNKNOWN_SPEED, UNSEEING_SPEED, ObstacleStop
from artemis.scan import Clearance, ObstacleRules, Scan
from artemis.values import DriveCommand, LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict, Wish
from artemis.vehicle import RobotFile
from artemis_lab.bench.obstacle_persons import Pedestrian, Walk, crossed, stepped_aside, stepped_in
from artemis_lab.bench.obstacle_scenes import (
    ANGLES,
    BEAMS,
    FIELD,
    OUTLINE,
    PERIOD,
    SCANNER,
    Driver,
    ScanErrors,
    Scene,
    Steady,
    corridor,
    drive,
    random_drive,
    random_scene,
    rarely_seen,
    robot_with_scanner,
    straight,
)

STOP = ObstacleRules(mode="stop")
FRONT = OUTLINE.front_m


def wall(ahead: float, turned: float = 0.0) -> Scene:
    """So far ahead of the front edge [m], turned by [rad]."""
    dx, dy = -3.0 * math.sin(turned), 3.0 * math.cos(turned)
    return Scene(np.array([[FRONT + ahead + dx, dy, FRONT + ahead - dx, -dy]]))


class Watch:
    """An obstacle stop that is asked tick by tick."""

    def __init__(self, rules: ObstacleRules = STOP, least: float = 0.5, robot: RobotFile | None = None) -> None:
        robot = robot or robot_with_scanner()
        mounted = robot.scanners["front"].model_copy(update={"least_range_m": least})
        self.stop = ObstacleStop(robot.model_copy(update={"scanners": {"front": mounted}}), [rules])
        self.rules, self.tick = rules, 0
        self.odometry, self.standing, self.reset_pose = Odometry(distance=0.0), False, False

    def drive(self, distance: float, heading: float = 0.0) -> None:
        pose = self.odometry.pose
        there = Pose(x=pose.x + distance * math.cos(heading), y=pose.y + distance * math.sin(heading), heading=heading)
        self.odometry = Odometry(pose=there, distance=self.odometry.distance + distance)

    def look(
        self, ranges: np.ndarray | None = None, command: float = 0.5, speed: float = 0.0, steering: float = 0.0
    ) -> Clearance | None:
        """One tick, with a scan [m] if there is one."""
        now = self.tick * PERIOD
        scans: tuple[Scan, ...] = ()
        if ranges is not None:
            packed = np.round(1000.0 * ranges).astype("<u2").tobytes()
            scans = (
                Scan(
                    source="front", time=now, start_angle=-FIELD, increment=2 * FIELD / (len(ranges) - 1), ranges=packed
                ),
            )
        snapshot = Snapshot(
            sensed=Sensed(index=self.tick, time=now, scans=scans),
            dt=PERIOD,
            pose=LocatedPose(pose=self.odometry.pose),
            odometry=self.odometry,
            standing=self.standing,
            set_points=SetPoints(speed=speed),
            verdict=Verdict(),
        )
        self.tick += 1
        wish = Wish(command=DriveCommand(speed=command, steering=steering), reset_pose=self.reset_pose)
        return self.stop.look(wish, SetPoints(speed=speed), snapshot, self.rules)

    def known(self) -> "Watch":
        """After it has driven for long enough to know what is near."""
        for _ in range(30):
            self.look(np.zeros(BEAMS))
            self.drive(0.02)
        return self


def ahead(distance: float) -> np.ndarray:
    """A wall so far ahead of the scanner, and nothing else."""
    return np.where(np.abs(ANGLES) < 0.9, distance / np.cos(ANGLES), 0.0)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("turned", [-75, -40, 0, 30, 60, 75])
@pytest.mark.parametrize("speed", [0.1, 0.7])
def test_stands_before_a_wall(turned: int, speed: float) -> None:
    outcome = drive(wall(1.5, radians(turned)), Steady(speed), 100 + turned, seconds=3.0 + 1.8 / speed)

    assert 0.05 <= outcome.nearest <= 0.30


@pytest.mark.parametrize(("clear", "margin"), [(0.5, 0.08), (1.0, 0.08), (1.0, 1.0)])
def test_a_great_distance_to_keep_slows_down_on_no_free_path(clear: float, margin: float) -> None:
    rules = ObstacleRules(mode="stop", clear=clear, margin=margin)

    assert Watch(rules).known().look(np.zeros(BEAMS), command=0.7, speed=0.7) is None
    outcome = drive(wall(3.0), Steady(0.7), 3, seconds=6.0, rules=rules)
    assert clear + margin - 0.05 <= 3.0 - outcome.driven <= clear + margin + 0.1
    assert outcome.fastest == pytest.approx(0.7)


def test_a_slow_robot_looks_as_far_as_it_is_to_stand_off() -> None:
    robot = robot_with_scanner()
    slow = robot.limits.model_copy(update={"speed_m_s": 0.1, "deceleration_m_s2": 2.0})
    far = ObstacleRules(mode="stop", clear=1.0, margin=1.0)
    watch = Watch(far, robot=robot.model_copy(update={"limits": slow})).known()
    x, y = FRONT + 1.95 - SCANNER.x_m, OUTLINE.half_width_m + 0.95
    pole = np.where(np.abs(ANGLES - math.atan2(y, x)) < 0.02, math.hypot(x, y), 0.0)
    watch.look(pole, speed=0.1)

    found = watch.look(pole, speed=0.1)

    assert found is not None
    assert found.speed == 0.0


@pytest.mark.parametrize("aside", [-0.3, -0.15, 0.0, 0.3])
def test_stands_before_a_pole_of_2_cm(aside: float) -> None:
    scene = Scene(circles=np.array([[FRONT + 1.0, aside, 0.01]]))

    assert 0.05 <= drive(scene, Steady(0.7), 3, seconds=3.0).nearest <= 0.25


@pytest.mark.parametrize("seed", [5, 24, 34])
def test_a_narrow_corridor_goes_on_beside_the_start(seed: int) -> None:
    """Its direction behind the scanner is that of few beams; with one seed the first scan comes late."""
    outcome = straight(seed, corridor(0.90, 100.0), 3.0, dust=0.0)

    assert outcome.slowed == 0
    assert outcome.driven > 2.9


@pytest.mark.parametrize("seed", [301, pytest.param(5, marks=pytest.mark.exhaustive)])
def test_a_narrow_corridor_is_driven_without_slowing_down(seed: int) -> None:
    outcome = drive(corridor(0.90, 40.0), Steady(0.7), seed, seconds=12.0, errors=ScanErrors(dust=0.0))

    assert outcome.slowed == 0
    assert outcome.fastest == pytest.approx(0.7)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("seed", range(2000, 2040))
def test_touches_nothing_that_stands(seed: int) -> None:
    outcome = random_drive(seed, seconds=6.0, reverse=0.15)

    assert outcome is None or outcome.nearest >= 0.01


@pytest.mark.sampled(5)
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("gap", [0.03, 0.09, 0.12])
@pytest.mark.parametrize("turned", [0, 5, 17])
def test_a_wall_beside_the_start_goes_on_within_the_least_range(turned: int, gap: float, side: int) -> None:
    """It crosses the way, and was never seen where the robot would touch it: nearest it is so far from a corner [m]."""
    s, c = math.sin(radians(turned)), math.cos(radians(turned))
    far = max(s * x + c * y for x in (OUTLINE.front_m, -OUTLINE.rear_m) for y in (OUTLINE.half_width_m,)) + gap
    middle, along = np.array([s * far, side * c * far]), np.array([3.0 * c, side * -3.0 * s])
    scene = Scene(np.array([[*(middle - along), *(middle + along)]]))
    assert scene.distance(0.0, 0.0, 0.0) == pytest.approx(gap, abs=0.001)

    nearest = [drive(scene, Steady(0.7, side * radians(25.0)), seed, seconds=3.0).nearest for seed in range(3)]

    assert min(nearest) > 0.6 * gap


def seen(scene: Scene) -> np.ndarray:
    """What the scanner sees of a scene from the start: nothing where it is too near."""
    ranges = scene.ranges(SCANNER.x_m, 0.0, 0.0)
    return np.where((ranges < SCANNER.least_range_m) | (ranges >= 20.0), 0.0, ranges)


def test_a_door_through_which_something_is_seen_is_no_wall() -> None:
    ahead, beyond = FRONT + 0.25, FRONT + 6.0
    door = [[ahead, side * 0.45, ahead, side * 3.0] for side in (1, -1)]
    door += [[beyond, 3.0, beyond, -3.0], *([ahead, side * 3.0, beyond, side * 3.0] for side in (1, -1))]
    watch, ranges = Watch(), seen(Scene(np.array(door)))
    assert ranges[ranges > 0.0].min() < SCANNER.least_range_m + 0.1, "its posts are where a gap would begin"

    found = [watch.look(ranges) for _ in range(3)][-1]

    assert found is not None
    assert found.distance > 0.5


def test_nothing_stands_where_the_robot_does() -> None:
    """What is seen far to both sides of a gap may lie on the far sides of the robot."""
    poles = Scene(circles=np.array([[SCANNER.x_m - 0.05, 0.6, 0.05], [SCANNER.x_m - 0.05, -0.6, 0.05]]))
    watch = Watch()

    found = [watch.look(seen(poles)) for _ in range(3)][-1]

    assert found is not None
    assert found.speed == UNKNOWN_SPEED


def test_beams_that_return_nothing_hide_no_wall() -> None:
    """A fifth of them: of a wall that is too near at first."""
    outcome = random_drive(500556, reverse=0.3)

    assert outcome is not None
    assert outcome.nearest > 0.03


@pytest.mark.exhaustive
def test_scenes_would_be_touched_without_it() -> None:
    seed, touched = 2000, 0
    for number in range(seed, seed + 12):
        dice = np.random.default_rng(number)
        scene = random_scene(dice)
        rules = ObstacleRules(mode="stop", margin=-0.3, clear=-5.0)
        touched += drive(scene, Driver(dice, 0.7, radians(60.0)), number, seconds=6.0, rules=rules).nearest < 0.0

    assert touched >= 4


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", range(30))
def test_a_person_who_crosses_meets_a_robot_that_stands(seed: int) -> None:
    outcome = crossed(seed)

    assert outcome.nearest > 0.0 or outcome.speed <= 0.1


def test_no_scan_no_motion() -> None:
    for mode in ("stop", "slow"):
        watch = Watch(ObstacleRules(mode=mode))
        found = [watch.look(command=command) for command in (0.5, -0.5) for _ in range(10)]

        assert found == [Clearance(speed=0.0, distance=0.0, no_scan=True)] * 20


def test_an_old_scan_slows_down_and_then_stops() -> None:
    watch = Watch().known()
    speeds = []
    watch.look(ahead(1.2))
    watch.look(ahead(1.2))
    for _ in range(round(LOST / PERIOD) + 2):
        found = watch.look()
        speeds.append(found.speed if found else inf)

    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] > 0.3
    assert speeds[-1] == 0.0


HALL = np.array([[-6.0, -6.0, 7.0, -6.0], [7.0, -6.0, 7.0, 6.0], [7.0, 6.0, -6.0, 6.0], [-6.0, 6.0, -6.0, -6.0]])
WALKED = 3.0
"""A person is seen for so far [m]."""


def steps_up(
    watch: Watch, to: tuple[float, float], walk: tuple[float, float], *, walls: bool, least: float = 0.5
) -> Scene:
    """A person, 0.3 m wide, comes to a robot that stands, with a velocity [m/s], and stays at a place [m] for 2 s."""
    time = WALKED / math.hypot(*walk)
    begin = [to[0] - time * walk[0], to[1] - time * walk[1], 0.15]
    scene = Scene(HALL if walls else np.zeros((0, 4)), np.array([begin]), np.array([walk]))
    dice = np.random.default_rng(1)
    for _ in range(round(time / PERIOD)):
        scene.move(PERIOD)
        watch.look(noisy(scene, dice, least), command=0.0)
    scene.moves = np.zeros((1, 2))
    for _ in range(100):
        watch.look(noisy(scene, dice, least), command=0.0)
    return scene


def noisy(scene: Scene, dice: np.random.Generator, least: float = 0.5) -> np.ndarray:
    """What the scanner of a robot at the origin measures [m]."""
    ranges = scene.ranges(SCANNER.x_m, 0.0, 0.0)
    measured = np.where(ranges < 20.0, ranges + dice.normal(0.0, 0.012, BEAMS), 0.0)
    return np.where(measured < least, 0.0, measured)


def at_origin() -> Watch:
    """A robot that has driven there, and stands."""
    watch = Watch(ObstacleRules(mode="stop", unseen_reverse=True)).known()
    watch.odometry = Odometry(pose=Pose(x=10.0), distance=10.0)  # nothing of what it has seen is near
    watch.look(np.zeros(BEAMS))
    watch.odometry = Odometry(distance=20.0)
    return watch


@pytest.mark.sampled(4)
@pytest.mark.parametrize("gap", [0.06, 0.17, 0.3])
@pytest.mark.parametrize("walk", [(-0.2, 0.0), (-0.8, 0.1), (-1.5, 0.0), (-0.7, 0.7), (-1.0, -0.5)])
@pytest.mark.parametrize("walls", [True, False])
def test_who_steps_up_to_a_robot_that_stands_is_not_forgotten(
    gap: float, walk: tuple[float, float], walls: bool
) -> None:
    watch = at_origin()
    scene = steps_up(watch, (FRONT + gap + 0.15, 0.0), walk, walls=walls)
    dice = np.random.default_rng(2)

    found = [watch.look(noisy(scene, dice)) for _ in range(10)][-1]

    assert found is not None
    assert found.speed == 0.0
    back = [watch.look(noisy(scene, dice), command=-0.5) for _ in range(60)][-1]
    assert back is not None
    assert back.speed > 0.0


@pytest.mark.sampled(7)
@pytest.mark.parametrize("seed", [280, *range(40), 299, 505])
def test_who_steps_before_a_robot_that_brakes_is_not_forgotten(seed: int) -> None:
    """And stays there, or goes on within the least range: on open ground as well, where nothing shows that he came."""
    outcome = stepped_in(seed)

    assert outcome is None or not outcome.contact


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", [2, *range(12), 17, 27, 53, 59])
def test_who_steps_aside_before_a_robot_that_stands_is_not_forgotten(seed: int) -> None:
    """It stopped for him nearer than it sees, and what he hides now was seen before."""
    outcome = stepped_aside(seed)

    assert outcome.driven > 0.5
    assert not outcome.contact


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", [1, 2, 5, 6, 9, 12, 15, 18, 28, 49])
def test_a_thin_post_that_comes_from_the_side_is_not_forgotten(seed: int) -> None:
    """A tube of a rollator: it goes on through beams in which it was never seen, and stays."""
    dice = np.random.default_rng(seed)
    walk, turn = dice.uniform(0.8, 1.4), math.radians(dice.uniform(20, 60)) * (1 if dice.random() < 0.5 else -1)
    speed = float(dice.choice([0.3, 0.7]))
    x, y = 0.8 * speed + FRONT + dice.uniform(0.0, 0.3), dice.uniform(-0.2, 0.2)
    vx, vy = -walk * math.cos(turn), -walk * math.sin(turn)
    post, stays = np.array([[x - 1.5 * vx, y - 1.5 * vy, 0.015]]), Walk(vx, vy, gap=dice.uniform(0.12, 0.3))

    outcome = drive(Pedestrian(HALL, post, walks=deque([stays])), Steady(speed), seed, seconds=8.0)

    assert outcome.contact is None


def test_what_is_put_down_before_a_robot_that_stands_is_not_missed() -> None:
    """From above, nearer than the scanner sees: all beams towards it are lost at once."""
    watch, dice = at_origin(), np.random.default_rng(1)
    near = [[FRONT + x, y, FRONT + u, v] for x, y, u, v in ((0.15, -0.2, 0.15, 0.2), (0.3, -0.2, 0.3, 0.2))]
    for scene in (Scene(HALL), Scene(np.concatenate((HALL, np.array(near))))):
        found = [watch.look(noisy(scene, dice)) for _ in range(20)][-1]
        assert (found is None) == (scene.segments is HALL)

    assert found is not None
    assert found.speed == 0.0
    assert [watch.look(noisy(Scene(HALL), dice)) for _ in range(70)][-1] is None


def test_a_scan_without_any_return_hides_nothing() -> None:
    """In a hall with an opening to open ground, beside which the beams never show anything."""
    watch, dice = at_origin(), np.random.default_rng(1)
    opening = np.array([[7.0, -6.0, 7.0, -0.5], [7.0, 0.5, 7.0, 6.0], [7.0, 6.0, -6.0, 6.0], [-6.0, -6.0, 7.0, -6.0]])
    for blank in (*[False] * 20, True, *[False] * 70):
        found = watch.look(np.zeros(BEAMS) if blank else noisy(Scene(opening), dice))

    assert found is None


@pytest.mark.parametrize("scans", [1, 2, 5])
def test_who_walks_away_on_open_ground_hides_behind_nothing(scans: int) -> None:
    """Of a scanner that gives one scan in so many ticks."""
    watch, dice = at_origin(), np.random.default_rng(1)
    person = Scene(circles=np.array([[FRONT + 1.0, 0.0, 0.15]]), moves=np.array([[0.2, 1.5]]))
    for tick in range(250):
        if tick > 100:
            person.move(PERIOD)
        found = watch.look(noisy(person, dice) if tick % scans == 0 else None)

    assert found is None


def test_what_is_put_down_while_the_robot_starts_is_not_missed() -> None:
    """What is lost in the last scan below 0.1 m/s is judged in the next one."""
    watch, dice = at_origin(), np.random.default_rng(1)
    near = np.array([[FRONT + 0.15, -0.2, FRONT + 0.15, 0.2]])
    box = Scene(np.concatenate((HALL, near)))
    for scene, speed in ((Scene(HALL), 0.0),) * 20 + ((Scene(HALL), 0.05), (box, 0.12), (box, 0.12)):
        watch.odometry = changed(watch.odometry, speed=speed)
        found = watch.look(noisy(scene, dice), speed=speed)

    assert found is not None
    assert found.speed == 0.0


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", [6, *range(5), 25, 27])
def test_a_leg_from_which_few_beams_return_is_not_touched(seed: int) -> None:
    assert 0.05 < rarely_seen(seed).nearest < 0.5


def test_who_goes_away_again_is_forgotten() -> None:
    watch = at_origin()
    scene = steps_up(watch, (FRONT + 0.32, 0.0), (-1.0, 0.0), walls=True)
    scene.moves, dice = np.array([[0.7, 0.7]]), np.random.default_rng(2)

    for _ in range(150):
        scene.move(PERIOD)
        found = watch.look(noisy(scene, dice))

    assert found is None


def test_a_wall_that_noise_hides_now_and_then_has_not_come_nearer() -> None:
    """Beside a robot that stands."""
    watch, dice = at_origin(), np.random.default_rng(1)
    for side in (0.48, 0.5, 0.52):
        for _ in range(1000):
            found = watch.look(noisy(Scene(np.array([[-6.0, side, 6.0, side]])), dice))

        assert found is None


@pytest.mark.parametrize("speed", [0.05, 0.08])
def test_a_door_frame_that_a_slow_robot_drives_through_has_not_come_nearer(speed: float) -> None:
    frame = [[1.5, side * 0.4, 1.5, side * 3.0] for side in (1, -1)]
    frame += [[1.6, side * 0.4, 1.6, side * 3.0] for side in (1, -1)] + [[1.5, 0.4, 1.6, 0.4], [1.5, -0.4, 1.6, -0.4]]
    scene = Scene(np.concatenate((np.array(frame), HALL)))

    assert drive(scene, Steady(speed), 3, seconds=2.0 / speed).driven > 1.95


def test_waiting_goes_on_over_gaps_between_scans() -> None:
    watch = Watch(least=0.1).known()
    for _ in range(5):
        for _ in range(100):
            found = watch.look(ahead(0.2))
        gap = [watch.look() for _ in range(30)]

    assert gap[-1] == Clearance(speed=0.0, distance=0.0, no_scan=True)
    assert found is not None
    assert found.blocked > 10.0


@pytest.mark.parametrize("least", [0.0, 0.5])
def test_what_is_shown_within_the_least_range_counts_at_any_speed(least: float) -> None:
    """A device reports more than it has to."""
    watch, found = at_origin(), []
    person = Scene(circles=np.array([[FRONT + 0.41, 0.0, 0.15]]))
    for _ in range(3):
        watch.odometry = changed(watch.odometry, speed=0.5, distance=watch.odometry.distance + 0.01)
        found.append(watch.look(noisy(person, np.random.default_rng(1), least), speed=0.5))

    assert (found[-1] is not None) == (least == 0.0)


@pytest.mark.parametrize("steering", [-0.8, 0.0, 0.8])
def test_rolls_away_from_what_is_within_the_margin(steering: float) -> None:
    watch = Watch(ObstacleRules(mode="stop", unseen_reverse=True), least=0.1).known()
    near = [watch.look(ahead(OUTLINE.front_m - SCANNER.x_m + 0.05), steering=steering) for _ in range(5)][-1]

    back = [watch.look(ahead(0.18), command=-0.5, steering=steering) for _ in range(60)][-1]

    assert near is not None
    assert near.speed == 0.0
    assert back is not None
    assert back.speed == REVERSE_SPEED


def test_a_robot_that_turns_about_itself_leaves_nothing_behind() -> None:
    """Where the turning centre lies within the outline, what stands before it may come to stand beside it."""
    robot = robot_with_scanner()
    limits = robot.limits.model_copy(update={"steering_rate_wheel_deg_s": 2000.0, "steering_deg": 85.0})
    watch = Watch(
        ObstacleRules(mode="stop", unseen_reverse=True), 0.1, robot.model_copy(update={"limits": limits})
    ).known()

    found = [watch.look(ahead(0.18), command=-0.5, steering=radians(85.0)) for _ in range(60)][-1]

    assert found is not None
    assert found.speed == 0.0


def test_starts_slowly_after_it_stood_for_long() -> None:
    """Somebody may have stepped up from where no scanner looks."""
    watch, speeds = Watch().known(), []
    for watch.standing, seconds in ((True, 4.8), (False, 0.02), (True, 5.2), (False, 0.02)):
        for _ in range(round(seconds / PERIOD)):
            found = watch.look(np.zeros(BEAMS))
        speeds.append(inf if found is None else found.speed)
    assert speeds == [inf, inf, UNKNOWN_SPEED, UNKNOWN_SPEED]

    for _ in range(30):
        watch.drive(0.02)
        found = watch.look(np.zeros(BEAMS))
    assert found is None


def test_slow_does_not_back_over_what_it_has_not_seen() -> None:
    watch = Watch(ObstacleRules(mode="slow"))
    found = [watch.look(np.zeros(BEAMS), command=-0.5) for _ in range(5)][-1]

    assert found is not None
    assert found.speed == 0.0
    assert found.unseen


def test_a_pose_that_is_reset_says_nothing_about_what_was_driven() -> None:
    watch = Watch().known()
    watch.look(np.zeros(BEAMS))
    watch.reset_pose = True
    watch.look(np.zeros(BEAMS))
    watch.reset_pose, watch.odometry = False, Odometry(distance=0.0)

    found = [watch.look(np.zeros(BEAMS)) for _ in range(3)][-1]

    assert found is not None
    assert found.speed == UNKNOWN_SPEED


def test_one_beam_once_is_dust_but_not_while_creeping() -> None:
    dust = np.zeros(BEAMS)
    dust[BEAMS // 2] = 0.4
    found = []
    for speed in (0.5, 0.05):
        watch = Watch(least=0.1).known()
        pose = watch.odometry.pose
        watch.odometry = Odometry(pose=pose, distance=watch.odometry.distance, speed=speed)
        watch.look(np.zeros(BEAMS), speed=speed)
        found += [watch.look(dust, speed=speed), watch.look(dust, speed=speed)]

    moving, moving_again, creeping, _ = found
    assert moving is None
    assert moving_again is not None
    assert creeping is not None


def test_a_slower_scanner_may_take_longer() -> None:
    watch = Watch().known()
    for tick in range(50):
        found = watch.look(ahead(4.0) if tick % 5 == 0 else None)
        assert found is None or found.speed > 0.5, tick

    silent = [watch.look() for _ in range(15)]

    assert [each is not None and each.speed == 0.0 for each in silent] == [tick >= 8 for tick in range(15)]


def test_another_number_of_beams_is_another_view() -> None:
    watch = Watch().known()
    backwards = [watch.look(np.zeros(beams), command=-0.5) for beams in (BEAMS, 271, 271, 1081, 1081)]

    assert all(found is not None and found.speed > 0.0 for found in backwards)


def test_starts_slowly_for_what_stood_too_near_to_be_seen() -> None:
    watch = Watch()
    watch.look(np.zeros(BEAMS))

    found = watch.look(np.zeros(BEAMS))

    assert found is not None
    assert found.speed == UNKNOWN_SPEED


def test_is_blocked_after_a_moment_and_free_after_a_second() -> None:
    watch = Watch(least=0.1).known()
    blocked = [watch.look(ahead(0.2)) for _ in range(10)]
    assert [bool(it and it.blocked) for it in blocked] == [tick * PERIOD >= BLOCKED_TIME for tick in range(10)]

    free = [watch.look(np.full(BEAMS, 10.0)) for _ in range(60)]

    still = [bool(it and it.blocked) for it in free]
    assert 48 <= sum(still) <= 52
    assert still == sorted(still, reverse=True)


def test_by_hand_nobody_waits() -> None:
    watch = Watch(ObstacleRules(mode="stop", free_after=0.0), least=0.1).known()
    blocked = [watch.look(ahead(0.2)) for _ in range(10)]

    free = watch.look(np.full(BEAMS, 10.0))

    assert blocked[-1] is not None
    assert blocked[-1].blocked > 0.0
    assert free is None


def test_slow_creeps_on_and_off_does_not_look() -> None:
    slow, off = Watch(ObstacleRules(mode="slow"), least=0.1).known(), Watch(ObstacleRules(mode="off"))
    slow.look(ahead(0.2))

    found = slow.look(ahead(0.2))

    assert found is not None
    assert found.speed == 0.1
    assert off.look(ahead(0.55)) == Clearance(speed=UNSEEING_SPEED)


def test_what_leaves_the_view_is_remembered_until_it_is_seen_to_be_gone() -> None:
    watch = Watch().known()
    for far in np.arange(0.60, 0.30, -0.02):
        near = ahead(far)
        found = watch.look(np.where(near < 0.5, 0.0, near))
        watch.drive(0.02)
    assert found is not None
    assert found.speed < 0.3

    behind = np.full(BEAMS, 3.0)
    for _ in range(70):
        found = watch.look(behind)

    assert found is None


def test_backwards_only_over_known_ground() -> None:
    watch = Watch().known()  # 0.6 m

    back = watch.look(np.zeros(BEAMS), command=-0.5)
    unknown = Watch()
    unknown.look(np.zeros(BEAMS), command=-0.5)

    assert back is not None
    assert 0.05 < back.speed <= REVERSE_SPEED
    found = unknown.look(np.zeros(BEAMS), command=-0.5)
    assert found is not None
    assert found.speed == 0.0
    allowed = Watch(ObstacleRules(mode="stop", unseen_reverse=True)).known().look(np.zeros(BEAMS), command=-0.5)
    assert allowed is not None
    assert allowed.speed == REVERSE_SPEED


def test_wheels_that_roll_uncounted_forget_what_was_seen() -> None:
    watch = Watch().known()
    for _ in range(5):
        watch.look(ahead(0.55))

    watch.odometry = Odometry(lost=True, uncounted=True)
    watch.look(np.zeros(BEAMS))
    watch.odometry = Odometry(lost=True)
    found = watch.look(np.zeros(BEAMS))

    assert found is not None
    assert found.speed in (0.0, UNKNOWN_SPEED)


def test_a_place_that_was_lost_once_does_not_forget_what_is_seen() -> None:
    watch = Watch().known()
    watch.odometry = changed(watch.odometry, lost=True)
    for _ in range(5):
        found = watch.look(ahead(0.55))
    assert found is not None
    assert found.speed > UNKNOWN_SPEED


def mounted(**changes: object) -> RobotFile:
    """ARTEMIS with its scanner mounted otherwise."""
    scanner = SCANNER.model_copy(update=changes)
    return robot_with_scanner().model_copy(update={"scanners": {"front": scanner}})


BACKWARDS = mounted(x_m=0.1, heading_deg=180.0)
MASKED = mounted(mask=((-27.0, 27.0),))
FIELDS = {"front": (-135.0, 135.0)}


def driven_until_it_stands(watch: Watch, command: float = 0.5) -> tuple[float, Clearance]:
    """Drive between far walls as fast as it may until that is blocked; how far [m], and why."""
    driven = 0.0
    for _ in range(1000):
        found = watch.look(np.full(BEAMS, 9.0), command=command)
        if found is not None and found.blocked:
            return driven, found
        step = PERIOD * min(abs(command), inf if found is None else found.speed)
        driven += step
        watch.drive(math.copysign(step, command))
    return inf, Clearance()


@pytest.mark.parametrize(("robot", "most"), [(BACKWARDS, 0.0), (MASKED, 0.38), (mounted(mask=((-2, 2),)), 0.38)])
def test_forwards_only_over_known_ground_where_no_scanner_looks(robot: RobotFile, most: float) -> None:
    """At the start nobody knows what is within the least range, be it masked or not."""
    watch = Watch(robot=robot)
    driven, found = driven_until_it_stands(watch)
    assert driven <= most
    assert (found.speed, found.unseen) == (0.0, True)

    for _ in range(25):  # backwards, by hand of somebody who sees
        watch.drive(-0.02)
        watch.look(np.full(BEAMS, 9.0), command=0.0)
    again, found = driven_until_it_stands(watch)
    assert 0.35 < again < 0.6
    assert found.unseen


def test_a_robot_that_looks_back_reverses_as_fast_as_it_can_stop() -> None:
    watch = Watch(robot=BACKWARDS)
    for _ in range(30):
        watch.look(np.zeros(BEAMS), command=0.0)
        watch.drive(-0.02)
    assert watch.look(np.zeros(BEAMS), command=-0.7, speed=-0.7) is None


def test_what_a_mask_hides_behind_a_robot_that_looks_back_is_not_known() -> None:
    watch = Watch(robot=mounted(x_m=0.1, heading_deg=180.0, mask=((-27.0, 27.0),)))
    driven, found = driven_until_it_stands(watch, command=-0.5)
    assert driven < 0.3
    assert (found.speed, found.unseen) == (0.0, True)


@pytest.mark.parametrize("mask", [((30.0, 34.0), (-40.0, -36.0)), ((20.0, 24.0),), ((-90.0, -40.0),)])
def test_what_a_mask_beside_the_way_hides_was_seen_before(mask: tuple[tuple[float, float], ...]) -> None:
    robot = mounted(mask=mask)
    assert unseen_ahead(robot, FIELDS) is None
    watch = Watch(robot=robot)
    assert driven_until_it_stands(watch)[0] == inf
    found = watch.look(np.full(BEAMS, 9.0), command=0.7, speed=0.7)
    assert found is None or found.speed > 0.5


@pytest.mark.parametrize("mask", [((10.0, 16.0),), ((4.0, 9.0),)])
def test_what_a_mask_hides_at_the_start_and_the_least_range_afterwards_is_never_seen(
    mask: tuple[tuple[float, float], ...],
) -> None:
    """At y = 12 cm the sector from 10 to 16 degrees begins 68 cm ahead of the scanner, and ends 42 cm ahead of it."""
    robot = mounted(mask=mask)
    assert unseen_ahead(robot, FIELDS) is not None
    driven, found = driven_until_it_stands(Watch(robot=robot))
    assert 0.3 < driven < 0.4
    assert found.unseen


def test_what_a_masked_beam_shows_makes_nothing_known() -> None:
    watch = Watch(robot=mounted(mask=((-10.0, 10.0),)))
    for _ in range(30):
        found = watch.look(np.full(BEAMS, 5.0))  # nothing is in their way: the scanner is simulated
        watch.drive(0.02)
    assert found is not None
    assert found.unseen


def test_what_goes_behind_a_mask_is_remembered() -> None:
    watch = Watch(robot=mounted(mask=((20.0, 40.0),))).known()
    bearing = 18.0
    while bearing < 29.0:
        thing = np.where(np.abs(np.degrees(ANGLES) - bearing) < 1.5, 0.8, 0.0)
        watch.look(np.where((np.degrees(ANGLES) > 20.0) & (np.degrees(ANGLES) < 40.0), 0.0, thing), command=0.0)
        pose = watch.odometry.pose
        turned = Pose(x=pose.x, y=pose.y, heading=pose.heading - radians(0.5))
        watch.odometry = Odometry(pose=turned, distance=watch.odometry.distance)
        bearing += 0.5
    for _ in range(10):
        found = watch.look(np.zeros(BEAMS), command=0.5, steering=0.8)
    assert found is not None
    assert found.distance < 0.3
