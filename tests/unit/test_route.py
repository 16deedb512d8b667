"""Routes with reversals: read, directed, begun somewhere, and what no robot can drive."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion.path import path_from_points
from artemis.motion.route import Part, Route, route_from_csv
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

ROOT = FilePath(__file__).parents[2]


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(load(ROOT / "missions" / "robots" / "artemis.yaml").data)


def line(begin: float, end: float, *, backward: bool = False) -> Part:
    x = np.linspace(begin, end, 21)
    return Part(path=path_from_points(x, 0 * x, closed=False), backward=backward)


def to_and_fro() -> Route:
    """2 m ahead, 1.5 m back, 1 m ahead, along x."""
    return Route((line(0.0, 2.0), line(2.0, 0.5, backward=True), line(0.5, 1.5)))


def ring(*, backward: bool = False) -> Route:
    angles = np.linspace(0.0, math.tau, 101)
    return Route((Part(path=path_from_points(np.sin(angles), 1 - np.cos(angles)), backward=backward),))


def csv(*points: tuple[float, ...]) -> str:
    names = ["x", "y", "heading", "speed"][: len(points[0])]
    return ",".join(names) + "\n" + "".join(",".join(map(str, point)) + "\n" for point in points)


def directions(text: str) -> list[bool]:
    return [part.backward for part in route_from_csv(text, "p.csv").parts]


def problems_of(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        route_from_csv(text, "p.csv")
    return caught.value.problems


# ---------------------------------------------------------------------------------------------- reading


def test_a_path_without_headings_begins_forwards_and_each_reversal_changes_that() -> None:
    assert directions(csv((0, 0), (0.5, 0), (1, 0))) == [False]
    assert directions(csv((0, 0), (0.5, 0), (1, 0), (0.6, 0.01), (0.2, 0.0), (0.7, 0))) == [False, True, False]


def test_headings_say_which_parts_are_driven_backwards() -> None:
    there, back = [(x / 10, 0, 3.1) for x in range(11)], [(x / 10, 0, -3.1) for x in range(9, 4, -1)]
    assert directions(csv(*there)) == [True]
    assert directions(csv(*there, *back)) == [True, False]
    turned = [(x, y, heading + math.pi) for x, y, heading in (*there, *back)]
    assert directions(csv(*turned)) == [False, True]


def test_parts_meet_and_know_the_robots_heading() -> None:
    route = route_from_csv((ROOT / "missions/paths/three_point_turn.csv").read_text(), "turn.csv")
    assert [part.backward for part in route.parts] == [False, True, False]
    for before, after in zip(route.parts, route.parts[1:], strict=False):
        end, begin = before.path.at(before.path.length), after.path.at(0.0)
        assert (end.x, end.y) == pytest.approx((begin.x, begin.y), abs=1e-3)
        assert before.heading_at(before.path.length) == pytest.approx(after.heading_at(0.0), abs=0.01)
    assert [part.path.curvature[-1] for part in route.parts[:2]] == pytest.approx([1.6, 1.6], abs=0.05)
    assert [math.degrees(part.heading_at(part.path.length)) for part in route.parts[:2]] == pytest.approx(
        [60, 120], abs=3
    )
    assert abs(math.degrees(route.parts[2].heading_at(route.parts[2].path.length))) == pytest.approx(180, abs=0.5)


def test_speeds_stay_with_their_points() -> None:
    text = csv(*((x / 10, 0, 0, 0.1 + x / 20) for x in range(11)), *((x / 10, 0, 0, 0.9) for x in range(9, -1, -1)))
    there, back = route_from_csv(text, "p.csv").parts
    assert (there.path.speed_at(0.0), there.path.speed_at(0.5)) == pytest.approx((0.1, 0.35))
    assert back.path.speed_at(0.5) == pytest.approx(0.9)


def test_a_loop_that_is_driven_to_and_fro_is_not_closed() -> None:
    angles = [0.1 * number for number in range(63)]
    points = [(math.sin(a), 1 - math.cos(a)) for a in angles]
    assert route_from_csv(csv(*points), "p.csv").closed
    assert not route_from_csv(csv(*points, points[-3], points[-6]), "p.csv").closed


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            csv((0, 0, 0), (0.5, 0, 1.7), (1, 0, 0)),
            "p.csv:3:7: heading 1.70 rad points across the path; expected along or against it",
        ),
        # along the path only as degrees: 180 rad would be backwards, and 90 rad forwards
        (
            csv((0, 0, 180), (-0.5, 0, 180), (-1, 0, 180)),
            "p.csv:2:5: heading 180: expected rad, these are degrees: call the column heading_deg, and read the file "
            "by `artemis path import`",
        ),
        (csv((0, 0, 90), (0, 0.5, 90), (0, 1, 90)), "p.csv:2:5: heading 90: expected rad"),
        # the heading turns round where the distance does not
        (csv(*((x / 10, 0, 0) for x in range(6)), *((x / 10, 0, 3.1) for x in range(6, 11))), "p.csv:"),
        # the path reverses, and the robot with it
        (csv((0, 0, 0), (0.5, 0, 0), (1, 0, 0), (0.5, 0.01, 3.1), (0, 0.02, 3.1)), "p.csv:"),
        (
            csv((0, 0), (0.5, 0), (1, 0), (0.7, 0.43), (0.4, 0.86)),
            "p.csv:4:1: the robot would turn by 55 deg on the spot here; expected a curve, or a reversal",
        ),
        (
            csv((0, 0), (0.5, 0), (1, 0), (0.97, 0), (1.5, 0)),
            "p.csv:5:1: reverses twice within 0.030 m; expected at least 0.05 m in one direction",
        ),
        (csv((0, 0), (0.5, 0), (2, 0), (1.5, 0)), "p.csv:4:1: 1.50 m from the point before"),
    ],
)
def test_what_no_robot_can_drive_is_refused_with_its_place(text: str, expected: str) -> None:
    assert problems_of(text)[0].startswith(expected)


# ---------------------------------------------------------------------------------------------- directions


def test_from_its_end_a_route_has_the_same_poses_in_the_opposite_order() -> None:
    angles = np.linspace(0.0, 2.0, 41)
    bend = Part(path=path_from_points(np.sin(angles), 1 - np.cos(angles), speed=0.1 + angles))
    route = Route((line(-1.0, 0.0), bend))
    back = route.directed(from_end=True, backward=None)
    assert [part.backward for part in back.parts] == [True, True]
    assert back.length == pytest.approx(route.length)
    begins = zip(route.begins, route.parts, strict=True), zip(back.begins, back.parts, strict=True)
    there, again = ([(begin, part) for begin, part in pairs] for pairs in begins)
    for place in np.linspace(0.05, route.length - 0.05, 23).tolist():
        one, other = (_at(pairs, distance) for pairs, distance in ((there, place), (again, route.length - place)))
        assert one == pytest.approx(other, abs=2e-3)
    assert back.parts[0].path.speed_at(0.3) == pytest.approx(bend.path.speed_at(bend.path.length - 0.3), abs=1e-6)


def _at(pairs: list[tuple[float, Part]], place: float) -> tuple[float, float, float]:
    begin, part = [pair for pair in pairs if pair[0] <= place][-1]
    point = part.path.at(place - begin)
    return point.x, point.y, part.heading_at(place - begin)


def test_from_its_end_and_again_it_is_the_route() -> None:
    route = to_and_fro()
    again = route.directed(from_end=True, backward=None).directed(from_end=True, backward=None)
    for one, other in zip(route.parts, again.parts, strict=True):
        assert one.backward is other.backward
        assert (one.path.x == other.path.x).all()
        assert (one.path.curvature == other.path.curvature).all()


@pytest.mark.parametrize(
    ("from_end", "backward", "expected"),
    [
        (False, None, [False, True, False]),
        (False, False, [False, True, False]),
        (False, True, [True, False, True]),
        (True, None, [True, False, True]),
        (True, False, [False, True, False]),
        (True, True, [True, False, True]),
    ],
)
def test_a_mission_says_where_it_begins_and_with_which_end_ahead(
    from_end: bool, backward: bool | None, expected: list[bool]
) -> None:
    route = to_and_fro().directed(from_end=from_end, backward=backward)
    assert [part.backward for part in route.parts] == expected
    assert route.parts[0].path.x[0] == pytest.approx(1.5 if from_end else 0.0)


def test_laps_are_for_a_closed_path_in_one_direction() -> None:
    assert ring(backward=True).with_laps(3).length == pytest.approx(3 * math.tau, abs=2e-3)
    with pytest.raises(ConfigError, match="has reversals"):
        to_and_fro().with_laps(2)
    with pytest.raises(ConfigError, match="open"):
        Route((line(0.0, 1.0),)).with_laps(2)
    assert to_and_fro().with_laps(1).length == pytest.approx(4.5)


# ---------------------------------------------------------------------------------------------- begun somewhere


@pytest.mark.parametrize(
    ("done", "count", "x"), [(0.0, 3, 0.0), (1.2, 3, 1.2), (2.0, 2, 2.0), (2.6, 2, 1.4), (4.0, 1, 1.0), (9.0, 1, 1.5)]
)
def test_the_rest_of_a_route_begins_in_its_part(done: float, count: int, x: float) -> None:
    route = to_and_fro()
    rest = route.rest(done)
    assert len(rest.parts) == count
    assert [part.backward for part in rest.parts] == [part.backward for part in route.parts[3 - count :]]
    assert rest.length == pytest.approx(max(4.5 - done, 0.0), abs=0.021)
    assert rest.parts[0].path.at(0.0).x == pytest.approx(x, abs=0.021)


@pytest.mark.parametrize(("x", "expected"), [(0.1, 0.1), (1.8, 1.8), (-1.0, 0.0), (2.5, 2.0)])
def test_the_nearest_place_of_a_route_is_its_first(x: float, expected: float) -> None:
    assert to_and_fro().nearest(x, 0.2) == pytest.approx(expected, abs=1e-6)


def test_the_nearest_place_may_be_in_a_later_part() -> None:
    x = np.linspace(1.0, 0.0, 21)
    aside = Part(path=path_from_points(x, 0.5 * (1 - x) ** 2, closed=False), backward=True)
    route = Route((line(0.0, 1.0), aside))
    place = route.nearest(0.0, 0.6)
    assert place == pytest.approx(route.length, abs=0.1)
    assert route.begun_at(place, 0.0).parts[0].backward


def test_all_laps_of_a_closed_route_are_driven_from_wherever_it_is_begun() -> None:
    route = ring(backward=True).with_laps(2)
    begun = route.begun_at(1.0, 0.0)
    assert begun.parts[0].backward
    assert begun.length == pytest.approx(route.length)
    assert route.begun_at(1.0, 5.0).length == pytest.approx(route.length - 5.0)
    assert route.rest(5.0).length == pytest.approx(route.length - 5.0, abs=0.02)


def test_viewers_see_the_robots_poses() -> None:
    poses = to_and_fro().poses(0.05)
    assert len(poses) == pytest.approx(90, abs=3)
    assert {round(abs(pose.heading), 6) for pose in poses} == {0.0}
    assert max(pose.x for pose in poses) == pytest.approx(2.0)
    assert len(Route((line(0.0, 500.0),)).poses(0.05)) == 2000


def test_problems_name_their_part(robot: RobotFile) -> None:
    angles = np.linspace(0.0, 1.5, 31)
    sharp = Part(path=path_from_points(0.2 * np.sin(angles), 0.2 * (1 - np.cos(angles)), smoothing=0.0))
    assert Route((sharp,)).problems(robot, 0.1)[0].startswith("too sharp at")
    assert Route((line(-1.0, 0.0), sharp)).problems(robot, 0.1)[0].startswith("part 2: too sharp at")
    assert to_and_fro().problems(robot, 0.7) == []


def test_an_arc_may_begin_and_end_at_standstill_with_its_whole_curvature(robot: RobotFile) -> None:
    angles = np.linspace(0.0, 2.0, 41)
    arc = path_from_points(0.6 * np.sin(angles), 0.6 * (1 - np.cos(angles)))
    assert Route((Part(path=arc),)).problems(robot, 0.7) == []
    x = np.concatenate([np.linspace(-1.0, -0.05, 20), 0.6 * np.sin(angles)])
    y = np.concatenate([np.zeros(20), 0.6 * (1 - np.cos(angles))])
    (problem,) = Route((Part(path=path_from_points(x, y)),)).problems(robot, 0.7)
    assert problem.startswith("too fast at 0.9")
