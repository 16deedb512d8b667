"""What was driven, or given as points, becomes a path file."""

from __future__ import annotations

import itertools
import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.demand import steering_per_distance
from artemis.motion.geodesy import local_metres
from artemis.motion.joining import bulge, join
from artemis.motion.path import Path, check_drivable, path_from_csv, path_from_points
from artemis.motion.path_facts import demand_of, facts_of
from artemis.motion.path_points import cusps
from artemis.motion.points import points_from
from artemis.motion.route import Part, Route, route_from_csv
from artemis.motion.waypoints import deviation, drawn, highest_speed, largest_distance, legs_of, rows_of
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis.yaml_file import load


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(load(FilePath(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").data)


def straight(*places: float, step: float = 0.004) -> list[Pose]:
    """Along x from one place to the next [m], as densely as a run has its ticks."""
    xs = np.concatenate([np.linspace(a, b, round(abs(b - a) / step) + 1) for a, b in itertools.pairwise(places)])
    return [Pose(x=x) for x in xs.tolist()]


def only(path: Path, *, backward: bool = False) -> Route:
    return Route((Part(path=path, backward=backward),))


def eight(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    angle = np.linspace(0.0, math.tau, count + 1)
    return 2 * np.sin(angle), 1.2 * np.sin(2 * angle)


# ---------------------------------------------------------------------------------------------- legs


def test_legs_end_exactly_where_the_robot_turned_back() -> None:
    poses = straight(0.0, 1.0, 0.2, 2.0)
    legs = legs_of(poses, 0.05)
    assert [leg.backward for leg in legs] == [False, True, False]
    assert [leg.length for leg in legs] == pytest.approx([1.0, 0.8, 1.8])
    ends = [(poses[leg.kept[0]].x, poses[leg.kept[-1]].x) for leg in legs]
    assert ends == [(0.0, 1.0), (1.0, 0.2), (0.2, 2.0)]


def test_five_centimetres_back_are_a_leg() -> None:
    assert [leg.backward for leg in legs_of(straight(0.0, 1.0, 0.95, 2.0), 0.05)] == [False, True, False]


def test_the_points_of_a_leg_have_the_spacing_that_was_asked_for() -> None:
    poses = straight(0.0, 1.0)
    for spacing in (0.02, 0.05, 0.3):
        (leg,) = legs_of(poses, spacing)
        steps = np.diff([poses[index].x for index in leg.kept])
        assert steps[:-1].min() >= spacing
        assert steps.max() < spacing + 0.008


def test_a_robot_that_stands_or_trembles_makes_no_leg() -> None:
    assert legs_of([], 0.05) == []
    assert legs_of([Pose()], 0.05) == []
    assert legs_of([Pose()] * 100, 0.05) == []
    trembling = [Pose(x=0.004 * (index % 2)) for index in range(100)]
    assert legs_of(trembling, 0.05) == []
    (leg,) = legs_of([*trembling, *straight(0.0, 1.0), *(Pose(x=1.0 - 0.004 * (i % 2)) for i in range(50))], 0.05)
    assert not leg.backward


# ---------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize("smoothing", [0.0, 0.3, 1.0])
def test_a_file_is_read_as_the_curve_that_was_written(smoothing: float) -> None:
    x, y = eight()
    rows = rows_of(only(drawn(x, y, spacing=0.05, smoothing=smoothing)), "eight.csv")
    again = path_from_csv(rows.text, "eight.csv")
    assert again.closed
    assert (again.x == rows.path.x).all()
    off, _ = deviation(x, y, again)
    exact = min(math.dist((a, b), (c, d)) for a, b in [(x[70], y[70])] for c, d in zip(again.x, again.y, strict=True))
    assert off >= exact - 0.01
    assert off < (0.002 if smoothing < 0.5 else 0.05)


def test_headings_of_a_file_point_along_the_path_or_against_it() -> None:
    curve = drawn(np.linspace(0, 2, 21), np.zeros(21), spacing=0.05, smoothing=0.3)
    assert ",0.00000\n" in rows_of(only(curve), "f.csv").text
    backward = rows_of(only(curve, backward=True), "b.csv").text
    assert ",3.14159\n" in backward
    assert [part.backward for part in route_from_csv(backward, "b.csv").parts] == [True]


def test_a_file_of_a_way_with_reversals_is_read_as_it_was_written() -> None:
    there, back, again = (
        drawn(np.linspace(a, b, 21), 0.1 * np.linspace(a, b, 21) ** 2, spacing=0.05, smoothing=0.3)
        for a, b in ((0.0, 1.5), (1.5, 0.5), (0.5, 2.0))
    )
    parts = (Part(path=there, backward=True), Part(path=back), Part(path=again, backward=True))
    rows = rows_of(Route(parts), "z.csv")
    assert [part.backward for part in rows.route.parts] == [True, False, True]
    for part, read in zip(parts, rows.route.parts, strict=True):
        assert read.path.length == pytest.approx(part.path.length, abs=1e-3)
        assert deviation(part.path.x, part.path.y, read.path)[0] < 0.002
    lines = rows.text.splitlines()
    assert len(lines) == 1 + len(there.x) + len(back.x) + len(again.x) - 2, "neighbours share a row"


def test_a_way_whose_parts_turn_on_the_spot_is_not_written() -> None:
    east, north = (
        drawn(x, y, spacing=0.05, smoothing=0.3)
        for x, y in ((np.linspace(0, 1, 11), np.zeros(11)), (np.full(11, 1.0), np.linspace(0, 1, 11)))
    )
    with pytest.raises(ConfigError, match="its reversals are not found again"):
        rows_of(Route((Part(path=east), Part(path=north))), "f.csv")


def test_speeds_of_a_file_are_never_too_low_to_get_on() -> None:
    x = np.linspace(0, 2, 21)
    speed = np.concatenate([[0.0], np.full(19, 0.5), [0.0]])
    rows = rows_of(only(drawn(x, 0 * x, spacing=0.05, smoothing=0.3, speed=speed)), "f.csv", with_speed=True)
    assert rows.path.speed is not None
    assert rows.path.speed.min() == pytest.approx(0.1)
    assert rows.path.speed.max() == pytest.approx(0.5)
    assert rows.text.startswith("x_m,y_m,heading_rad,speed_m_s\n")
    unasked = rows_of(only(drawn(x, 0 * x, spacing=0.05, smoothing=0.3, speed=speed)), "f.csv")
    assert unasked.path.speed is None


@pytest.mark.parametrize(
    ("x", "y", "words"),
    [
        ([0.0], [0.0], "1 distinct points"),
        ([0.0, 0.0015], [0.0, 0.0], "path of 0.0015 m"),
        ([0.0, 30_000.0], [0.0, 0.0], "path of 30000 m; expected at most 20000 m"),
        ([0.0, 1e300], [0.0, 0.0], "off; expected coordinates in metres"),
        ([0.0, math.inf], [0.0, 0.0], "off; expected coordinates in metres"),
        ([0.0, 1.0, 0.2], [0.0, 0.0, 0.01], "reverses at x 1.00 m, y 0.00 m"),
    ],
)
def test_points_that_make_no_path_are_refused(x: list[float], y: list[float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        drawn(np.array(x), np.array(y), spacing=0.05, smoothing=0.3)


@pytest.mark.parametrize("repeated", [False, True])
def test_a_way_there_and_back_is_no_loop(repeated: bool) -> None:
    x = np.array([0.0, 1.0, 2.0] + ([1.0, 0.0] if repeated else []))
    with pytest.raises(ConfigError, match="reverses at"):
        drawn(x, 0 * x, spacing=0.05, smoothing=0.3, closed=True)


# ---------------------------------------------------------------------------------------------- distances


def test_the_distance_from_a_line_is_that_of_its_nearest_piece() -> None:
    line = np.column_stack([np.linspace(0, 1, 51), np.zeros(51)])
    points = np.array([(0.505, 0.03), (0.2, -0.01), (1.3, 0.4)])
    assert largest_distance(points, line) == pytest.approx((0.5, 2))
    assert largest_distance(points[:2], line) == pytest.approx((0.03, 0))


def test_a_second_branch_nearby_does_not_count_for_a_point_on_the_first() -> None:
    first = np.column_stack([np.arange(0, 1, 0.02), np.zeros(50)])
    second = np.column_stack([np.arange(0.01, 1, 0.02), np.full(50, 0.006)])
    assert largest_distance(np.array([(0.51, 0.0)]), np.vstack([first, second]))[0] < 1e-9


# ---------------------------------------------------------------------------------------------- what a robot can do


def test_the_highest_speed_is_where_the_check_begins_to_refuse(robot: RobotFile) -> None:
    path = path_from_points(*eight())
    highest, at = highest_speed(path, robot)
    assert at is not None
    assert 0.1 < highest < robot.limits.speed_m_s
    assert check_drivable(path, robot, highest * 0.999) == []
    assert "too fast" in check_drivable(path, robot, highest * 1.001)[0]


def test_a_straight_way_bounds_no_speed(robot: RobotFile) -> None:
    path = path_from_points(np.linspace(0, 3, 31), np.zeros(31))
    assert highest_speed(path, robot) == (robot.limits.speed_m_s, None)


def test_a_path_that_is_slow_itself_bounds_nothing(robot: RobotFile) -> None:
    x, y = eight()
    assert highest_speed(path_from_points(x, y, speed=np.full(len(x), 0.05)), robot)[1] is None


def test_the_inner_wheel_turns_more_than_the_virtual_one(robot: RobotFile) -> None:
    curvature = np.linspace(0.0, 1.5, 301)
    geometry = robot.geometry
    angle = np.arctan(geometry.wheelbase_m * curvature)
    virtual = np.gradient(angle, 0.01) * np.cos(angle)
    ratio = steering_per_distance(curvature, 0.01, geometry)[5:-5] / virtual[5:-5]
    assert (ratio > 1.0).all()
    assert ratio.max() < 1.35


# ---------------------------------------------------------------------------------------------- latitude and longitude


@pytest.mark.parametrize(
    ("latitude", "north", "east"),
    [  # length of a degree in metres, by tables of the ellipsoid
        (0.0, 110_574.3, 111_319.5),
        (15.0, 110_649.0, 107_550.7),
        (45.0, 111_132.0, 78_846.8),
        (60.0, 111_412.2, 55_800.0),
    ],
)
def test_a_degree_has_its_known_length(latitude: float, north: float, east: float) -> None:
    around = np.radians([latitude, latitude + 0.001, latitude - 0.001])
    x, y = local_metres(around, np.radians([10.0, 10.001, 9.999]))
    assert 1000 * y[1] == pytest.approx(north, abs=1.5)
    assert 1000 * x[1] == pytest.approx(east, abs=1.5)
    assert (x[2], y[2]) == pytest.approx((-x[1], -y[1]))
    assert (x[0], y[0]) == (0.0, 0.0)


def test_a_way_may_pass_the_date_line() -> None:
    x, _ = local_metres(np.radians([0.0, 0.0, 0.0]), np.radians([179.9999, -179.9999, 179.9998]))
    assert x == pytest.approx([0.0, 22.264, -11.132], abs=1e-3)


# ---------------------------------------------------------------------------------------------- waypoints


def test_waypoints_far_apart_are_joined_densely_through_each_of_them() -> None:
    x, y = np.array([0.0, 5.0, 9.0, 9.0]), np.array([0.0, 0.0, 3.0, 9.0])
    path = rows_of(only(join(x, y, closed=False)), "w.csv").path
    assert np.hypot(np.diff(path.x), np.diff(path.y)).max() < 0.05
    assert deviation(x, y, path)[0] < 0.001
    most, corner = bulge(x, y, path)
    assert 0.1 < most < 1.0
    assert corner in (1, 2)


def test_a_straight_way_has_no_corners() -> None:
    x, y = np.array([0.0, 5.0, 12.0]), np.zeros(3)
    assert bulge(x, y, join(x, y, closed=False))[0] < 1e-9


@pytest.mark.parametrize("repeated", [False, True])
def test_waypoints_become_a_loop_if_asked(repeated: bool) -> None:
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), *([(0.0, 0.0)] if repeated else [])]
    x, y = np.array(corners).T
    path = rows_of(only(join(x, y, closed=True)), "w.csv").path
    assert path.closed
    assert 16.0 < path.length < 18.0
    assert deviation(x, y, path)[0] < 0.002
    assert bulge(x, y, path)[0] == pytest.approx(bulge(np.roll(x[:4], 1), np.roll(y[:4], 1), path)[0], abs=1e-3)


def test_sparse_waypoints_whose_ends_are_a_step_apart_stay_open() -> None:
    angle = np.radians(np.arange(0, 360, 45))
    assert not join(5 * np.cos(angle), 5 * np.sin(angle), closed=False).closed


def test_a_place_sees_itself_at_the_origin() -> None:
    points = np.array([[3.0, 3.0 + math.cos(0.7)], [-2.0, -2.0 + math.sin(0.7)]])
    assert points_from(Pose(x=3.0, y=-2.0, heading=0.7), points).ravel() == pytest.approx([0.0, 1.0, 0.0, 0.0])


def test_cusps_are_sharp_turns() -> None:
    ((index, turn),) = cusps(np.array([0.0, 1.0, 2.0, 1.0]), np.array([0.0, 0.0, 0.0, 0.1]))
    assert (index, turn) == pytest.approx((2, 3.042), abs=1e-3)
    assert cusps(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0])) == []


# ---------------------------------------------------------------------------------------------- facts


def csv(x: list[float], y: list[float], heading: list[float] | None = None) -> str:
    columns = [x, y] if heading is None else [x, y, heading]
    rows = "\n".join(",".join(map(str, row)) for row in zip(*columns, strict=True))
    return ("x,y" if heading is None else "x,y,heading") + f"\n{rows}\n"


def test_a_path_that_reverses_is_told_part_by_part() -> None:
    facts = facts_of(csv([0, 0.5, 1, 1.5, 1, 0.5, 0], [0.0, 0, 0, 0, 0.01, 0, 0]), "p.csv")
    assert [part.backward for part in facts.parts] == [False, True]
    assert [part.path.length for part in facts.parts] == pytest.approx([1.5, 1.5], abs=0.01)
    assert facts.reversals == [(5, 1.5, 0.0)]


def test_headings_tell_what_is_driven_backwards() -> None:
    facts = facts_of(csv([0, 0.5, 1, 0.5, 0], [0.0, 0, 0, 0, 0], [math.pi] * 5), "p.csv")
    assert [part.backward for part in facts.parts] == [True, False]


def test_gaps_and_distances_are_told() -> None:
    (part,) = facts_of(csv([0, 0.1, 0.2, 1.9, 2.0], [0.0, 0.01, 0.0, 0.0, 0.0]), "p.csv").parts
    assert (part.points, part.gap) == pytest.approx((5, 1.7))
    assert 0.002 < part.off < 0.01


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y\n0,0\n", "p.csv:1:1: 1 distinct"),
        ("x,y\n0,0\n1,?\n", "p.csv:3:3"),
        ("0,0\n99999,0\n", "p.csv:1:1: path of"),
    ],
)
def test_what_is_no_table_of_a_path_has_no_facts(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        facts_of(text, "p.csv")


def test_a_demand_is_that_of_the_speed(robot: RobotFile) -> None:
    path: Path = path_from_points(*eight())
    fast, slow = demand_of(path, robot, 0.2), demand_of(path, robot, 0.1)
    assert fast.rate == pytest.approx(2 * slow.rate)
    assert fast.steering == slow.steering == pytest.approx(math.atan(0.56 * np.abs(path.curvature).max()))
    at_most = demand_of(path, robot, None)
    assert at_most.speed == at_most.highest
    assert math.degrees(at_most.rate) == pytest.approx(robot.limits.steering_rate_wheel_deg_s)
    assert at_most.problems == []
    assert demand_of(path, robot, 0.7).problems
