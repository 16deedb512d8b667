"""What one scanner makes of its scans: only what stands there, and in the end all of it."""

import msgspec
import numpy as np
import pytest

from artemis.motion.beams import FEW, least_beside
from artemis.motion.points import placed_points
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View
from artemis.scan import Scan
from artemis.values import Pose
from artemis_lab.bench.obstacle_scenes import ANGLES, BEAMS, FARTHEST, FIELD, HALL, OUTLINE, PERIOD, SCANNER, Scene

BOX = Rectangle(-OUTLINE.rear_m, OUTLINE.front_m, OUTLINE.half_width_m)
SLIT = np.array([[-2.0, 1.0, 1.8, 1.0], [2.2, 1.0, 6.0, 1.0], [-2.0, 2.0, 6.0, 2.0]])
"""A wall with a slit in it, through which one sees another wall: now this part of it, now that."""
CORRIDOR = np.array([[-2.0, 0.45, 6.0, 0.45], [-2.0, -0.45, 6.0, -0.45]])
"""Beside the robot it is too near to be seen: pieces of it that go along with the robot are all that one sees there."""
SPEED = 0.5


def seen(scene: Scene, pose: Pose, time: float, dice: np.random.Generator) -> Scan:
    """From a pose of the robot, with noise."""
    x, y = placed_points(pose, np.array([[SCANNER.x_m], [SCANNER.y_m]]))[:, 0]
    ranges = scene.ranges(x, y, pose.heading)
    measured = np.where(ranges < FARTHEST, ranges + dice.normal(0.0, 0.012, BEAMS), 0.0)
    packed = np.where(measured >= 0.5, np.round(1000.0 * measured), 0.0).astype("<u2").tobytes()
    return Scan(source="front", time=time, start_angle=-FIELD, increment=ANGLES[1] - ANGLES[0], ranges=packed)


def moves(scene: Scene, seconds: float) -> bool:
    """Whether anything seems to, to a robot that drives straight ahead."""
    view, dice = View(SCANNER, BOX, 1.65, 1.1), np.random.default_rng(1)
    found = False
    for tick in range(round(seconds / PERIOD)):
        pose = Pose(x=SPEED * PERIOD * tick)
        view.move(pose, replaced=True)
        view.take(seen(scene, pose, tick * PERIOD, dice), tick * PERIOD, SPEED, 0.0, creeping=False)
        found = found or view.sees_motion
        scene.move(PERIOD)
    return found


@pytest.mark.parametrize(("walls", "seconds"), [(SLIT, 4.0), (CORRIDOR, 2.0)])
def test_what_comes_into_view_does_not_move(walls: np.ndarray, seconds: float) -> None:
    assert not moves(Scene(walls), seconds)


@pytest.mark.parametrize("walk", [(-1.0, 0.0), (0.0, -0.6), (-0.5, -0.5), (1.5, 0.0)])
def test_a_person_before_a_wall_moves(walk: tuple[float, float]) -> None:
    person = np.array([[2.0 - walk[0], 0.6 - walk[1], 0.15]])

    assert moves(Scene(SLIT[2:], person, np.array([walk])), 1.5)


def test_what_is_remembered_may_leave_the_surroundings_before_it_is_forgotten() -> None:
    """Odometry may jump within the time in which remembered points are not looked at."""
    view, dice = View(SCANNER, BOX, 1.65, 1.1), np.random.default_rng(1)
    wall = Scene(np.array([[1.2, -1.0, 1.2, 1.0]]))
    for tick, x in enumerate((0.0, 0.02, 9.0)):
        pose, time = Pose(x=x), tick * PERIOD
        view.move(pose, replaced=True)
        view.take(seen(wall, Pose(), time, dice), time, 0.0, 0.0, creeping=False)

    points, _, kept, _ = view.around()
    assert points.shape[1] > kept.shape[1] > 0
    assert kept[0].min() < -7.0 < 0.5 < kept[0].max()


def kept_of(scene: Scene, view: View | None = None) -> np.ndarray:
    """What a view remembers of what stood around the robot when the run began."""
    view, dice = view or View(SCANNER, BOX, 1.65, 1.1), np.random.default_rng(1)
    for tick in range(3):
        view.take(seen(scene, Pose(), tick * PERIOD, dice), tick * PERIOD, 0.0, 0.0, creeping=False)
    return view.around()[2]


def test_a_wall_beside_the_robot_goes_on_to_behind_it() -> None:
    """Where the field of view ends."""
    kept = kept_of(Scene(np.array([[-2.0, 0.32, 6.0, 0.32]])))

    assert kept[0].min() < -OUTLINE.rear_m
    assert np.abs(kept[1] - 0.32).max() < 0.05


def test_legs_are_no_wall() -> None:
    """Between two of them, and beyond, nothing is remembered."""
    legs = np.array([[SCANNER.x_m + 0.54, 0.12, 0.05], [SCANNER.x_m + 0.54, -0.12, 0.05]])

    kept = kept_of(Scene(circles=legs))

    assert (np.abs(np.abs(kept[1]) - 0.12) < 0.08).all()


def test_a_surface_goes_on_across_the_seam_of_a_scanner_that_looks_all_around() -> None:
    """Its first beam points ahead, where a wall is too near."""
    view, wall = View(SCANNER, BOX, 1.65, 1.1), SCANNER.x_m + 0.42
    angles = np.arange(720) * np.radians(0.5)
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(angles) > 0.1, 0.42 / np.cos(angles), 0.0)
    packed = np.where(ranges >= 0.5, np.round(1000.0 * ranges), 0.0).astype("<u2").tobytes()
    for tick in range(3):
        scan = Scan(source="front", time=tick * PERIOD, start_angle=0.0, increment=np.radians(0.5), ranges=packed)
        view.take(scan, tick * PERIOD, 0.0, 0.0, creeping=False)

    kept = view.around()[2]
    assert (np.abs(kept[0] - wall) < 0.03).all()
    assert np.diff(np.sort(kept[1])).max() < 0.06


@pytest.mark.parametrize("aside", [-0.21, -0.12, 0.03, 0.12, 0.29])
def test_beams_a_degree_apart_do_not_forget_a_leg_of_a_chair(aside: float) -> None:
    """It hides two or three of them within the least range."""
    view, dice = View(SCANNER, BOX, 1.65, 1.1), np.random.default_rng(1)
    leg = np.array([[1.4, aside, 0.0125]])
    for tick in range(45):
        pose, time = Pose(x=0.3 * 0.04 * tick), 0.04 * tick
        fine = seen(Scene(HALL, leg), pose, time, dice)
        view.move(pose, replaced=True)
        packed = fine.millimetres[::2].astype("<u2").tobytes()
        scan = msgspec.structs.replace(fine, increment=2 * fine.increment, ranges=packed)
        view.take(scan, time, 0.3, 0.0, creeping=False)

    there = view.around()[2] + np.array([[pose.x], [pose.y]]) - leg[0, :2, np.newaxis]
    assert np.hypot(*there).min(initial=np.inf) < 0.05


@pytest.mark.parametrize(
    ("empty", "least"),
    [((20 + FEW,), 0.0), ((20 - FEW, 21 - FEW), 0.0), ((24, 25), 3000.0), ((15,), 3000.0), ((24, 25, 26), 0.0)],
)
def test_beams_without_a_return_hide_something_if_they_are_three_or_next_to_it(
    empty: tuple[int, ...], least: float
) -> None:
    ranges = np.full(41, 3000.0)
    ranges[list(empty)] = 0.0

    assert least_beside(ranges, 12)[20] == least


@pytest.mark.parametrize("beams", [3, 5, 10])
def test_a_scanner_of_few_beams_is_no_error(beams: int) -> None:
    view, dice = View(SCANNER, BOX, 1.65, 1.1), np.random.default_rng(1)
    for tick in range(40):
        ranges = np.where(dice.random(beams) < 0.5, dice.uniform(500.0, 3000.0, beams), 0.0).astype("<u2")
        packed = ranges.tobytes()
        view.take(
            Scan(source="front", time=0.02 * tick, start_angle=-1.0, increment=2.0 / (beams - 1), ranges=packed),
            0.02 * tick, 0.0, 0.0, creeping=True,
        )  # fmt: skip

    assert view.around()[0].shape[1] <= beams


def test_a_scanner_whose_first_angle_wavers_is_not_blind() -> None:
    view = View(SCANNER, BOX, 1.65, 1.1)
    for tick in range(40):
        packed = np.full(41, 1000, "<u2").tobytes()
        start = -0.2 + 1e-7 * (tick % 2)
        scan = Scan(source="front", time=0.02 * tick, start_angle=start, increment=0.01, ranges=packed)
        view.take(scan, 0.02 * tick, 0.2, 0.0, creeping=False)

    assert view.around()[0].shape == (2, 41)


def test_who_walks_behind_a_mask_before_a_robot_that_stands_is_not_remembered() -> None:
    """On open ground, where nothing would show that he has gone."""
    masked = SCANNER.model_copy(update={"mask": [(-5.0, 5.0)]})
    view, dice = View(masked, BOX, 1.65, 1.1), np.random.default_rng(1)
    for tick in range(100):
        person = Scene(circles=np.array([[1.8, -1.0 + 0.02 * tick, 0.15]]))
        view.take(seen(person, Pose(), 0.02 * tick, dice), 0.02 * tick, 0.0, 0.0, creeping=True)

    assert not view.around()[2].size


@pytest.mark.parametrize("speed", [0.0, 0.5, 0.7])
def test_who_crosses_far_ahead_of_a_robot_that_has_stopped_does_not_come_near(speed: float) -> None:
    """On open ground, after a drive in which nothing was near."""
    view, x = View(SCANNER, BOX, 1.65, 1.1), 0.0
    for tick in range(250):
        ranges = np.zeros(BEAMS, "<u2")
        if tick >= 100:
            first = 200 + (tick - 100)
            ranges[first : first + 20] = 2000
            speed = max(speed - 0.02, 0.0)
        x += speed * PERIOD
        view.move(Pose(x=x), replaced=True)
        time, packed = PERIOD * tick, ranges.tobytes()
        scan = Scan(source="front", time=time, start_angle=-FIELD, increment=ANGLES[1] - ANGLES[0], ranges=packed)
        view.take(scan, time, speed, 0.0, creeping=speed < 0.1)

    assert not view.around()[2].size
