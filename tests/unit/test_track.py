"""What is driven by hand becomes points, and those a path."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.path import Path, path_from_csv
from artemis.motion.route import Route, route_from_csv
from artemis.motion.track import ANGLE, SPACING, Track, loop_end
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis.yaml_file import load


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(load(FilePath(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").data)


def track_of(poses: list[Pose]) -> Track:
    track = Track()
    for pose in poses:
        track.add(pose)
    return track


def line(length: float, step: float = 0.013) -> list[Pose]:
    return [Pose(x=step * index) for index in range(round(length / step) + 1)]


def circle(turn: float, radius: float = 1.5) -> list[Pose]:
    """Poses a centimetre apart around a circle to the left, from the origin along x, for `turn` [rad]."""
    angles = np.linspace(0.0, turn, round(turn * radius / 0.01) + 1)
    return [
        Pose(x=radius * math.sin(angle), y=radius * (1 - math.cos(angle)), heading=math.remainder(angle, math.tau))
        for angle in angles.tolist()
    ]


# ---------------------------------------------------------------------------------------------- points


def test_points_are_kept_by_distance() -> None:
    track = track_of(line(1.0))
    assert [pose.x for pose in track.poses] == pytest.approx([0.052 * index for index in range(20)])
    assert SPACING == 0.05


def test_points_are_kept_by_angle() -> None:
    track = track_of([Pose(heading=math.radians(1.001 * degrees)) for degrees in range(31)])
    assert [round(math.degrees(pose.heading)) for pose in track.poses] == [0, 5, 10, 15, 20, 25, 30]
    assert math.radians(5) == ANGLE


def test_the_angle_between_points_is_the_short_way_round() -> None:
    assert len(track_of([Pose(heading=math.radians(179)), Pose(heading=math.radians(-179))]).poses) == 1
    assert len(track_of([Pose(heading=math.radians(179)), Pose(heading=math.radians(-175))]).poses) == 2


def test_a_robot_that_stands_adds_one_point() -> None:
    assert len(track_of([Pose(x=1.0)] * 500).poses) == 1


def test_the_spacing_can_be_chosen_and_add_says_what_it_kept() -> None:
    track = Track(spacing=0.5)
    assert [track.add(Pose(x=x)) for x in (0.0, 0.4, 0.5, 0.9, 1.0)] == [True, False, True, False, True]


def test_a_recording_that_is_begun_anew_while_driving_knows_nothing_of_before() -> None:
    track = Track()
    for number, pose in enumerate(line(0.5)):
        track.see(pose, pressed=number == 20)
    assert [round(pose.x, 3) for pose in track.poses[:2]] == [0.26, 0.312]
    assert track.poses[-1].x == pytest.approx(0.468)


# ---------------------------------------------------------------------------------------------- legs


def test_one_direction_is_one_leg() -> None:
    assert [(len(poses), backward) for poses, backward in track_of(line(1.0)).legs()] == [(20, False)]
    assert Track().legs() == []
    assert track_of([Pose()]).legs() == []


def test_a_leg_ends_where_the_direction_changes_and_the_next_begins_there() -> None:
    there = line(1.0)
    legs = track_of([*there, *reversed(there), *there]).legs()
    assert [backward for _, backward in legs] == [False, True, False]
    assert legs[0][0][-1] is legs[1][0][0]
    assert legs[1][0][-1] is legs[2][0][0]


def test_backwards_is_told_by_the_heading_not_by_the_axis() -> None:
    west = [Pose(x=-pose.x, heading=math.pi) for pose in line(1.0)]
    assert [backward for _, backward in track_of(west).legs()] == [False]
    assert [backward for _, backward in track_of([Pose(x=-pose.x) for pose in line(1.0)]).legs()] == [True]


# ---------------------------------------------------------------------------------------------- the path


def only(route: Route) -> Path:
    """The path of a route that is driven forwards."""
    (part,) = route.parts
    assert not part.backward
    return part.path


def test_the_path_is_what_was_driven(robot: RobotFile) -> None:
    path = only(track_of(circle(4.0)).route(robot, 0.1))
    assert not path.closed
    assert path.length == pytest.approx(6.0, abs=0.05)
    distance = np.hypot(path.x, path.y - 1.5)
    assert np.abs(distance - 1.5).max() < 0.005


@pytest.mark.parametrize(
    ("turn", "close_within", "closed"),
    [
        (math.tau - 0.3, 0.5, True),
        (math.tau - 0.3, 0.4, False),  # 0.45 m are missing
        (math.tau + 0.3, 0.5, True),  # beyond the start
        (math.tau + 0.3, 0.4, False),
        (math.pi, 4.0, False),  # the other way
        (0.5, 5.0, False),  # hardly begun
    ],
)
def test_ends_that_nearly_meet_are_closed_if_asked(
    robot: RobotFile, turn: float, close_within: float, closed: bool
) -> None:
    path = only(track_of(circle(turn)).route(robot, 0.1, close_within))
    assert path.closed is closed
    if closed:
        assert path.length == pytest.approx(math.tau * 1.5, abs=0.02)
        assert np.abs(np.hypot(path.x, path.y - 1.5) - 1.5).max() < 0.01


def test_ends_in_opposite_directions_are_not_closed() -> None:
    turned = [*line(1.0), *(Pose(x=pose.x, y=0.1, heading=math.pi) for pose in reversed(line(1.0)))]
    assert loop_end(turned, 0.2) is None


def test_an_end_that_comes_from_the_side_is_not_closed() -> None:
    across = [Pose(x=-0.1, y=0.05 * index - 0.3, heading=math.pi / 2) for index in range(7)]
    assert loop_end([*line(1.0), *across], 0.5) is None


def test_what_lies_beyond_the_start_is_left_out_of_a_closed_path() -> None:
    poses = circle(math.tau + 0.3)
    count = loop_end(poses, 0.5)
    assert count is not None
    gap = math.hypot(poses[count - 1].x, poses[count - 1].y)
    assert 0 < gap < 0.05
    assert poses[count - 1].x < 0.0


def test_a_loop_driven_backwards_is_closed_in_its_own_direction() -> None:
    poses = [Pose(x=-p.x, y=p.y, heading=-p.heading) for p in circle(math.tau + 0.3)]
    count = loop_end(poses, 0.5, backward=True)
    assert count is not None
    assert poses[count - 1].x > 0.0


def test_no_poses_make_no_loop() -> None:
    assert loop_end([], 1.0) is None
    assert loop_end([Pose()] * 10, 1.0) == 10  # standing on one place: refused as too short


def there_and_back() -> list[Pose]:
    """A metre and 32 mm along x, as ticks see it; back to the left, backwards; and forwards again."""
    there = [Pose(x=0.004 * index) for index in range(259)]
    angles = [0.004 * index / 0.8 for index in range(1, 200)]
    back = [Pose(x=1.032 - 0.8 * math.sin(a), y=0.8 * (1 - math.cos(a)), heading=-a) for a in angles]
    return [*there, *[there[-1]] * 20, *back, *[back[-1]] * 20, *reversed(back)]


def test_what_was_driven_to_and_fro_is_a_route_whose_reversals_are_where_the_robot_turned_back(
    robot: RobotFile,
) -> None:
    track = track_of(there_and_back())
    route = track.route(robot, 0.1)
    first, second, third = route.parts
    assert [part.backward for part in route.parts] == [False, True, False]
    assert (first.path.x[-1], first.path.y[-1]) == pytest.approx((1.032, 0.0), abs=1e-3)
    assert (second.path.x[0], second.path.y[0]) == pytest.approx((1.032, 0.0), abs=1e-3)
    assert second.path.length == pytest.approx(0.796, abs=0.005)
    assert (third.path.x[0], third.path.y[0]) == pytest.approx((second.path.x[-1], second.path.y[-1]), abs=1e-3)
    again = route_from_csv(track.as_csv(), "track.csv")
    assert [part.backward for part in again.parts] == [False, True, False]
    assert again.length == pytest.approx(route.length, abs=0.01)


def test_a_way_driven_backwards_only_is_one_part_and_may_be_closed(robot: RobotFile) -> None:
    poses = [Pose(x=-p.x, y=p.y, heading=-p.heading) for p in circle(math.tau - 0.2)]
    (part,) = track_of(poses).route(robot, 0.1, 0.5).parts
    assert part.backward
    assert part.path.closed
    (part,) = track_of(poses).route(robot, 0.1).parts
    assert not part.path.closed


def test_a_short_way_back_is_no_part(robot: RobotFile) -> None:
    x = [*np.arange(0.0, 1.0, 0.004), *np.arange(1.0, 0.97, -0.004), *np.arange(0.97, 2.0, 0.004)]
    route = track_of([Pose(x=float(place)) for place in x]).route(robot, 0.1)
    assert only(route).length == pytest.approx(2.0, abs=0.06)


# ---------------------------------------------------------------------------------------------- what is no path


def nothing() -> Track:
    return Track()


def short() -> Track:
    return track_of(line(0.25))


def sharp() -> Track:
    return track_of(circle(3.0, radius=0.2))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (nothing, "only 0.00 m"),
        (short, "only 0.21 m were recorded, at least 0.3 m are needed"),
        (sharp, "too sharp at"),
    ],
)
def test_what_cannot_be_followed_is_refused(robot: RobotFile, make: Callable[[], Track], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make().route(robot, 0.1)


def test_standing_and_turning_on_the_spot_is_too_short(robot: RobotFile) -> None:
    with pytest.raises(ConfigError, match=r"only 0\.00 m"):
        track_of([Pose(heading=math.radians(degrees)) for degrees in range(90)]).route(robot, None)


def test_without_a_speed_the_robots_highest_counts(robot: RobotFile) -> None:
    bend = track_of([*line(1.0), *(Pose(x=1.0 + p.x, y=p.y, heading=p.heading) for p in circle(2.0, radius=0.6))])
    assert bend.route(robot, 0.05).length > 2.0
    with pytest.raises(ConfigError, match="too fast at"):
        bend.route(robot, None)


def test_the_file_of_a_track_is_read_as_its_path(robot: RobotFile) -> None:
    track = track_of(circle(4.0))
    path, again = only(track.route(robot, 0.1)), path_from_csv(track.as_csv(), "track.csv")
    assert again.length == pytest.approx(path.length, abs=1e-3)
    assert np.abs(np.interp(path.arc_length, again.arc_length, again.x) - path.x).max() < 2e-3
