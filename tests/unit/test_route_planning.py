"""Routes on small maps: free by the outline, at the goal, with zones, obstacles and a start that is not free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace as replace_in
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.ndimage import distance_transform_edt  # scipy has no types

from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.loading import load_model
from artemis.motion.arrays import Array
from artemis.motion.planned_route import unpacked_route
from artemis.mounting import Outline
from artemis.route_planning import planner
from artemis.route_planning.curves import rolled, shortest
from artemis.route_planning.device import warm_up
from artemis.route_planning.floor import CELL, Floor, clearance, floor_from, goal_problem, resampled
from artemis.route_planning.obstacle_layer import PlacedScan, known_ground, placed_returns, sees_behind, standing
from artemis.route_planning.planner import PlannedRoute, RouteRequest, plan_route
from artemis.route_planning.search import MOST_BACK, TOO_LONG
from artemis.route_planning.zones import MapZone
from artemis.scan import Scan
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis_lab.bench.floor_plans import small_plan

ROBOT = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml", RobotFile)
FRONT, REAR, HALF = 0.68, 0.12, 0.27
START, GOAL = Pose(x=0.8, y=1.0), Pose(x=4.1, y=1.0)


def floor(*boxes: tuple[float, float, float, float], zones: tuple[MapZone, ...] = (), turned: float = 0.0) -> Floor:
    """5 x 3 m with walls around; boxes by their corners [m]."""
    cells = np.zeros((60, 100), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for x0, y0, x1, y1 in boxes:
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 100
    return floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, turned)), zones)


def planned(on: Floor, start: Pose = START, goal: Pose = GOAL, **keys: object) -> PlannedRoute:
    return plan_route(RouteRequest(floor=on, robot=ROBOT, start=start, goal=goal, speed=0.5, **keys))  # type: ignore[arg-type]


def room(occupied: NDArray[np.bool_], pose: Pose) -> float:
    """From the outline to the nearest corner, edge or middle of an occupied cell [m]."""
    rows, columns = np.nonzero(occupied)
    points = np.concatenate(
        [np.column_stack([columns + a, rows + b]) * CELL for a in (0.0, 0.5, 1.0) for b in (0.0, 0.5, 1.0)]
    ) - (pose.x, pose.y)
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    ahead, beside = points @ (c, s), np.abs(points @ (-s, c)) - HALF
    ahead = np.maximum(ahead - FRONT, -REAR - ahead)
    outside = np.hypot(np.maximum(ahead, 0), np.maximum(beside, 0))
    return float(np.where((ahead > 0) | (beside > 0), outside, np.maximum(ahead, beside)).min())


@pytest.mark.parametrize(
    ("boxes", "goal"),
    [
        ((), Pose(x=2.0, y=2.2, heading=math.pi)),
        (((2.0, 0.0, 2.2, 1.5),), GOAL),
        (((2.0, 0.0, 2.2, 1.5),), Pose(x=1.0, y=2.0, heading=-2.0)),
    ],
)
def test_a_route_is_free_drivable_and_ends_at_the_goal(
    boxes: tuple[tuple[float, float, float, float], ...], goal: Pose
) -> None:
    on = floor(*boxes)
    found = planned(on, goal=goal)
    route = unpacked_route(found.values)

    poses = route.poses(0.02)
    assert min(room(on.occupied, pose) for pose in poses) >= 0.05
    assert route.problems(ROBOT, 0.5) == []
    assert math.hypot(poses[-1].x - goal.x, poses[-1].y - goal.y) <= 0.03
    assert abs(math.remainder(poses[-1].heading - goal.heading, math.tau)) <= math.radians(3)
    assert "radius 0.50 m" in found.detail


def test_a_route_keeps_off_what_the_straight_one_would_pass_closely() -> None:
    on = floor((2.4, 1.35, 2.7, 1.65))
    route = unpacked_route(planned(on, goal=Pose(x=3.6, y=1.0)).values)

    assert min(room(on.occupied, pose) for pose in route.poses(0.02)) >= 0.18
    assert len(route.parts) == 1


def test_a_goal_behind_a_wall_is_told_without_a_search() -> None:
    found = planned(floor((2.5, 0.0, 2.7, 3.0)))
    assert (found.values, found.expanded) == ((), 0)
    assert found.detail == "no path leads there, however the robot turns"


@pytest.mark.parametrize("margin", [0.05, 0.1])
def test_a_robot_that_stands_in_a_wall_of_the_map_is_told_so(margin: float) -> None:
    found = planned(floor((0.0, 0.0, 2.0, 3.0)), margin=margin)
    assert found.values == ()
    assert found.detail == (
        "no path leads there, however the robot turns; where the robot stands, the map shows a wall, a keep-out zone, "
        "or unknown ground: is its pose right?"
    )


def test_a_margin_for_which_no_path_is_wide_enough_is_named() -> None:
    on = floor((2.0, 0.0, 2.2, 1.0), (2.0, 2.0, 2.2, 3.0))
    goal = Pose(x=3.4, y=1.5)
    assert planned(on, goal=goal).values
    found = planned(on, goal=goal, margin=0.4)
    assert found.values == ()
    assert found.detail == (
        "no path leads there that has room for 40 cm around the robot's outline: "
        "a smaller `margin_m` of `obstacles` may help"
    )


def test_a_goal_that_is_hard_to_get_into_is_sought_from_there() -> None:
    """By a search from the start alone it is hardly found."""
    cells = small_plan("clutter", 113).content.cells
    on = floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))
    start = Pose(x=4.406474801287613, y=5.403271395871308, heading=1.3283234343261283)
    goal = Pose(x=7.771846070216147, y=7.349908002249883, heading=-1.8058398171609729)
    found = planned(on, start, goal)
    assert found.values, found.detail
    assert found.expanded < 10_000
    poses = unpacked_route(found.values).poses(0.02)
    assert min(room(on.occupied, pose) for pose in poses) >= 0.05
    assert math.hypot(poses[0].x - start.x, poses[0].y - start.y) <= 0.01
    assert math.hypot(poses[-1].x - goal.x, poses[-1].y - goal.y) <= 0.03


@pytest.mark.parametrize(("known_behind", "most"), [(None, 26_000), (0.13, 42_000)])
def test_a_plan_that_fails_searches_so_many_poses_and_says_so(
    monkeypatch: pytest.MonkeyPatch, known_behind: float | None, most: int
) -> None:
    def search(*given: object) -> tuple[Array, int, int]:
        assert isinstance(given[13], int)
        return np.empty((0, 4)), TOO_LONG, given[13]

    monkeypatch.setattr(planner, "search", search)
    found = planned(floor(), known_behind=known_behind)
    assert (found.values, found.expanded) == ((), most)
    assert found.detail == f"no route was found among {most} poses, down to a radius of 0.34 m"


@pytest.mark.parametrize(
    ("seed", "start", "goal"),
    [
        (116, Pose(x=1.617878598375188, y=5.591013487833701, heading=2.191913411926841),
         Pose(x=2.51555369885, y=3.504490745792145, heading=-0.4879766055650946)),
        (6201, Pose(x=7.120903617093258, y=1.9410600343502755, heading=-1.277397081996305),
         Pose(x=6.105889749951234, y=2.078639549920461, heading=2.1175032616896003)),
    ],
)  # fmt: skip
def test_a_route_leaves_the_robot_something_to_miss_its_end_by(seed: int, start: Pose, goal: Pose) -> None:
    """A last piece shorter than the steering takes, and the fit turns the end by 2.4 degrees of the 3 allowed."""
    cells = small_plan("rooms", seed).content.cells
    on = floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))
    end = unpacked_route(planned(on, start, goal).values).poses(0.02)[-1]
    assert math.hypot(end.x - goal.x, end.y - goal.y) <= 0.03
    assert abs(math.remainder(end.heading - goal.heading, math.tau)) <= math.radians(1.5)


def test_a_robot_at_its_goal_has_arrived() -> None:
    assert planned(floor(), goal=Pose(x=0.82, y=1.0, heading=0.02)).arrived


def test_a_keep_out_zone_is_driven_around_and_a_slow_one_slowly() -> None:
    left = ((2.0, 0.0), (2.4, 0.0), (2.4, 1.5), (2.0, 1.5))
    around = planned(floor(zones=(MapZone(kind="keep-out", corners=left),)))
    slow = planned(
        floor(zones=(MapZone(kind="slow", speed_m_s=0.2, corners=((2.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0))),))
    )

    assert max(pose.y for pose in unpacked_route(around.values).poses(0.05)) > 1.7
    path = unpacked_route(slow.values).parts[0].path
    speeds, x = path.speeds(0.5), path.x
    assert speeds[(x > 2.1) & (x < 2.9)].max() <= 0.2 + 1e-6
    assert speeds[(x > 1.2) & (x < 1.5)].max() > 0.4


def test_routes_like_a_zone_that_is_preferred() -> None:
    lane = MapZone(kind="prefer", corners=((0.5, 1.6), (4.5, 1.6), (4.5, 2.2), (0.5, 2.2)))
    far = [max(p.y for p in unpacked_route(planned(on).values).poses(0.05)) for on in (floor(), floor(zones=(lane,)))]
    assert far[0] < 1.3 < far[1]


def test_a_start_in_a_zone_or_at_a_wall_is_left() -> None:
    zone = MapZone(kind="keep-out", corners=((0.5, 0.5), (1.0, 0.5), (1.0, 1.5), (0.5, 1.5)))
    assert planned(floor(zones=(zone,))).values
    assert planned(floor(), start=Pose(x=0.8, y=0.05 + HALF + 0.02)).values


def stands(placed_scans: Sequence[PlacedScan], on: Floor) -> NDArray[np.int64]:
    return standing(placed_scans, ROBOT.scanners, on, clearance(on.occupied))


def test_what_stands_on_the_floor_is_driven_around() -> None:
    ranges = np.full(541, 1500, "<u2")
    ranges[:250] = ranges[291:] = 0
    scan = Scan(
        source="front", time=0.0, start_angle=-math.radians(135), increment=math.radians(0.5), ranges=ranges.tobytes()
    )
    seen = [PlacedScan(0.5 * number, START, scan) for number in range(6)]
    on = floor()

    rows, columns = stands(seen, on)
    assert len(rows)
    assert np.all(np.abs(np.hypot((columns + 0.5) * CELL - 1.4, (rows + 0.5) * CELL - 1.0) - 1.5) < 0.2)
    assert stands(seen[:3], on).size == 0  # for a second only
    assert stands([*seen[:2], replace(seen[2], time=9.0)], on).size == 0  # with a gap
    free, beside = planned(on), planned(on, placed_scans=tuple(seen))
    assert unpacked_route(beside.values).length > unpacked_route(free.values).length + 0.05


def seen_at(metres: float, time: float, half: int = 20) -> PlacedScan:
    """What so many beams to both sides of the one ahead meet."""
    ranges = np.full(541, 0, "<u2")
    ranges[270 - half : 271 + half] = round(1000 * metres)
    first, step = -math.radians(135), math.radians(0.5)
    return PlacedScan(
        time, START, Scan(source="front", time=time, start_angle=first, increment=step, ranges=ranges.tobytes())
    )


def test_what_was_seen_through_since_does_not_stand_there_any_more() -> None:
    stood = [seen_at(1.5, 0.5 * number) for number in range(6)]
    on = floor()
    assert stands([*stood, seen_at(0.9, 3.0)], on).size  # hidden by something nearer
    assert stands([*stood, seen_at(0.0, 3.0)], on).size  # nothing returned
    assert not stands([*stood, seen_at(2.5, 3.0, 30)], on).size


def test_a_route_that_is_free_again_is_kept_and_one_that_is_not_is_planned_anew() -> None:
    on = floor()
    present, under_way = planned(on).values, Pose(x=1.0, y=1.0)
    stood = tuple(seen_at(1.5, 0.5 * number) for number in range(6))
    kept = planned(on, start=under_way, present=present, placed_scans=(*stood, seen_at(2.5, 3.0, 30)))
    assert (kept.values, kept.expanded) == (present, 0)
    assert kept.detail == "the rest of the route is free"
    assert planned(on, start=under_way, present=present, placed_scans=stood).values != present
    beside = planned(on, start=Pose(x=1.0, y=1.4), present=present)
    assert beside.values != present  # somebody has moved the robot


def around(x0: float, x1: float, **keys: object) -> MapZone:
    """A zone across the whole room."""
    corners = ((x0, 0.0), (x1, 0.0), (x1, 3.0), (x0, 3.0))
    return MapZone.model_validate({"kind": "keep-out", "corners": corners, **keys})


def blocked(
    on: Floor, present: tuple[int, ...], *, keep: bool = True, seek: bool = True, before: Floor | None = None
) -> PlannedRoute:
    """Where something stands all across the way of a robot that is under way; before: the floor without zones."""
    seen = tuple(seen_at(1.5, 0.5 * number, 120) for number in range(6))
    under_way = Pose(x=1.0, y=1.0)
    return planned(on, start=under_way, present=present, placed_scans=seen, keep=keep, seek=seek, before=before)


def test_where_something_stands_in_the_only_way_the_present_route_is_given_back() -> None:
    walled = floor((0.05, 1.6, 5.0, 2.9))
    present = planned(walled).values
    for keep in (True, False):
        found = blocked(walled, present, keep=keep)
        assert (found.values, found.only_present) == (present, True)
        assert found.detail


def test_a_zone_that_is_new_on_the_only_way_takes_the_present_route() -> None:
    boxes = (0.05, 1.6, 5.0, 2.9)
    walled, shut = floor(boxes), floor(boxes, zones=(around(3.0, 3.2),))
    present = planned(walled).values
    for keep in (True, False):
        found = blocked(shut, present, before=walled, keep=keep)
        assert (found.values, found.only_present) == ((), False)
        assert found.detail.endswith("a zone that is new is in the way of the present one")
    beside = floor(boxes, zones=(around(4.95, 5.0),))
    assert blocked(beside, present, before=walled).values == present, "it touches nothing that is new"
    slow = floor(boxes, zones=(around(3.0, 3.2, kind="slow", speed_m_s=0.1),))
    assert blocked(slow, present, before=walled).values == ()
    assert blocked(slow, present, before=slow).values == present


def test_a_route_that_is_only_checked_is_given_back_if_the_robot_is_on_it() -> None:
    on = floor()
    present = planned(on).values
    found = blocked(on, present, seek=False)
    assert (found.values, found.only_present, found.expanded) == (present, True, 0)
    assert planned(on, start=Pose(x=1.0, y=1.4), present=present, seek=False).values == ()


def test_a_route_that_is_free_but_too_fast_for_a_new_zone_is_planned_anew() -> None:
    on, slow = floor(), floor(zones=(around(2.0, 3.0, kind="slow", speed_m_s=0.1),))
    present, under_way = planned(on).values, Pose(x=1.0, y=1.0)
    assert planned(slow, start=under_way, present=present, before=on).values not in ((), present)
    fast = floor(zones=(around(2.0, 3.0, kind="slow", speed_m_s=0.8),))
    assert planned(fast, start=under_way, present=present, before=on).values == present


def test_goals_are_refused_in_walls_and_outside() -> None:
    assert goal_problem(floor(), ROBOT, GOAL, 0.05) is None
    assert "cannot stand there" in str(goal_problem(floor(), ROBOT, Pose(x=4.6, y=1.0), 0.05))
    assert "outside" in str(goal_problem(floor(), ROBOT, Pose(x=7.0, y=1.0), 0.05))


@pytest.mark.parametrize(
    ("goal", "beyond"),
    [
        (Pose(x=4.0, y=1.5), False),
        (Pose(x=4.4, y=1.5), True),
        (Pose(x=2.5, y=0.2), True),
        (Pose(x=0.4, y=1.5), False),
        (Pose(x=0.4, y=1.5, heading=math.pi), True),
    ],
)
def test_a_goal_at_which_the_outline_reaches_beyond_the_map_is_refused_with_this_reason(
    goal: Pose, beyond: bool
) -> None:
    """What lies beyond the edge is nowhere free: neither for the check nor for the planner."""
    cells = np.zeros((60, 100), np.int8)
    on = floor_from(OccupancyMap(cells=cells, resolution=CELL, origin=(0.0, 0.0, 0.0)))
    problem, found = goal_problem(on, ROBOT, goal, 0.05), planned(on, Pose(x=1.5, y=1.5), goal)
    if beyond:
        words = "its outline and 5 cm around it reach beyond the edge of the map"
        assert problem == f"the robot cannot stand there: {words}"
        assert found.detail == f"the robot cannot stand at the goal: {words}"
    else:
        assert problem is None
        assert found.values


def test_masks_keep_what_they_hold_in_cells_of_another_size() -> None:
    fine, rough = np.zeros((20, 20), bool), np.zeros((4, 4), bool)
    fine[7, 13], rough[1, 2] = True, True
    assert np.argwhere(resampled(fine, 0.02)).tolist() == [[2, 5], [3, 5]]
    assert np.argwhere(resampled(rough, 0.10)).tolist() == [[2, 4], [2, 5], [3, 4], [3, 5]]


def test_clearance_in_little_that_is_free_is_that_of_the_whole() -> None:
    free = np.zeros((30, 40), bool)
    free[5:17, 30:] = free[8, 20:30] = True
    framed = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    whole = np.asarray(np.maximum(CELL * framed - CELL * math.sqrt(0.5), 0.0), np.float32)
    assert np.array_equal(clearance(~free), whole)
    assert not clearance(np.ones((3, 4), bool)).any()


def test_zones_say_what_they_need() -> None:
    corners = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    with pytest.raises(ValidationError, match="belong together"):
        MapZone(kind="slow", corners=corners)
    with pytest.raises(ValidationError, match="belong together"):
        MapZone(kind="prefer", corners=corners, speed_m_s=0.2)


def test_curves_lead_where_they_should() -> None:
    dice, word = np.random.default_rng(4), np.zeros(6)
    for _ in range(300):
        x, y, heading = dice.uniform(-5, 5), dice.uniform(-5, 5), dice.uniform(-3, 3)
        assert shortest(x, y, heading, 0.0, np.array([2.0, 1.0, 0.2]), word) < 1e8
        pose = 0.0, 0.0, 0.0
        for length, bend in zip(word[:3], word[3:], strict=True):
            pose = rolled(*pose, length, bend)
        assert math.hypot(pose[0] - x, pose[1] - y) < 1e-6
        assert abs(math.remainder(pose[2] - heading, math.tau)) < 1e-6


def test_what_a_robot_sees_while_it_turns_is_where_it_is() -> None:
    """A round wall, 3 m around a robot that turns with 1.5 rad/s: the scanner measures for 15 ms."""
    turn, speed, beam_time, now = 1.5, 0.5, 0.015 / 541, 10.0
    mounting, bearings = ROBOT.scanners["front"], np.radians(np.arange(-135.0, 135.5, 0.5))
    times, ranges = now - 0.030 + beam_time * np.arange(541), []
    for time, bearing in zip(times.tolist(), bearings.tolist(), strict=True):
        x, y, heading = rolled(0.0, 0.0, 0.0, speed * (time - now), turn / speed)
        px, py = x + mounting.x_m * math.cos(heading), y + mounting.x_m * math.sin(heading)
        along = px * math.cos(heading + bearing) + py * math.sin(heading + bearing)
        ranges.append(round(1000.0 * (math.sqrt(along * along - px * px - py * py + 9.0) - along)))
    scan = Scan(
        source="front",
        time=times[0],
        beam_time=beam_time,
        start_angle=bearings[0],
        increment=bearings[1] - bearings[0],
        ranges=np.array(ranges, "<u2").tobytes(),
    )
    still, moving = PlacedScan(now, Pose(), scan), PlacedScan(now, Pose(), scan, speed, turn)
    raw, deskewed = (np.hypot(*placed_returns(each, mounting).T) for each in (still, moving))
    assert len(deskewed) == 541
    assert np.abs(deskewed - 3.0).max() < 0.002
    assert np.abs(raw - 3.0).max() > 0.01


WALLS = np.full(541, 4000, "<u2")


def scan_with(ranges: NDArray[np.uint16], time: float, mask: tuple[int, int] | None = None) -> Scan:
    if mask is not None:
        ranges = ranges.copy()
        ranges[mask[0] : mask[1]] = 300
    first, step = -math.radians(135), math.radians(0.5)
    return Scan(source="front", time=time, start_angle=first, increment=step, ranges=ranges.tobytes())


def test_ground_is_known_where_the_robot_drove_and_where_it_saw_nothing_from_nearby() -> None:
    on = floor()
    driven = [PlacedScan(0.5 * n, Pose(x=1.0 + 0.2 * n, y=1.5), scan_with(WALLS, 0.5 * n)) for n in range(11)]

    def is_known(x: float, y: float, scans: list[PlacedScan]) -> bool:
        row, column = on.cells_of(np.array([[x, y]]))
        return bool(known_ground(scans, ROBOT, on)[row[0], column[0]])

    assert is_known(1.0, 1.5, driven), "the outline was there"
    assert is_known(3.0, 1.5, driven)
    assert is_known(1.9, 2.3, driven), "seen beside the way"
    assert not is_known(0.7, 1.5, driven), "behind the robot when it began"
    assert not is_known(1.9, 2.7, driven), "too far away for thin things"
    older = PlacedScan(60.0, Pose(x=3.2, y=1.5), scan_with(WALLS, 60.0))
    assert not is_known(1.0, 1.5, [*driven, older]), "a minute ago"
    near = WALLS.copy()
    near[271:] = 400  # something stands on the left
    beside = [PlacedScan(each.time, each.pose, scan_with(near, each.time)) for each in driven]
    assert not is_known(1.9, 2.3, beside)


@pytest.mark.parametrize("driven", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_route_begins_backwards_over_known_ground_if_there_is_some(driven: bool) -> None:
    """A robot that stands before a wall may go back along what it drove; one that woke up there has not seen it."""
    on = floor((2.4, 0.0, 2.6, 2.2))
    start, goal = Pose(x=1.6, y=0.8), Pose(x=0.8, y=2.0, heading=math.pi)
    came = [PlacedScan(0.5 * n, Pose(x=0.6 + 0.1 * n, y=0.8), scan_with(WALLS, 0.5 * n)) for n in range(11)]
    seen = tuple(came if driven else came[-1:])
    known, found = known_ground(seen, ROBOT, on), planned(on, start, goal, placed_scans=seen, known_behind=0.15)
    (first, *_) = unpacked_route(found.values).parts
    assert first.backward
    row, column = on.cells_of(np.column_stack([first.path.x, first.path.y])[:40] - (REAR - 0.01, 0.0))
    assert known[row, column].all() == driven


def looking(*mountings: dict[str, object], scan: Scan | None = None) -> tuple[RobotFile, tuple[PlacedScan, ...]]:
    """The robot with scanners of 270 degrees that differ from its own by these keys, and a scan of each."""
    own = ROBOT.scanners["front"]
    scanners = {f"scanner {n}": own.model_copy(update=keys) for n, keys in enumerate(mountings)}
    scans = (PlacedScan(1.0, START, replace(scan or scan_with(WALLS, 1.0), source=name)) for name in scanners)
    return ROBOT.model_copy(update={"scanners": scanners}), tuple(scans)


BACK: dict[str, object] = {"heading_deg": 180.0}


@pytest.mark.parametrize(
    ("mountings", "sees"),
    [
        ((BACK,), True),
        (({},), False),
        (({}, BACK), True),
        (({"heading_deg": 90.0},), False),
        (({"y_m": 0.27, "heading_deg": 45.0}, {"y_m": -0.27, "heading_deg": -45.0}), False),  # not right behind it
        (({**BACK, "mask": ((-0.4, 0.4),)},), False),
        (({**BACK, "mask": ((1.2, 1.8),)},), False),
    ],
)
def test_scanners_see_behind_if_they_look_at_all_of_it(mountings: tuple[dict[str, object], ...], sees: bool) -> None:
    robot, scans = looking(*mountings)
    assert sees_behind(scans, robot) == sees
    assert not sees_behind((), robot)


def test_where_a_scanner_looks_back_no_ground_behind_has_to_be_known() -> None:
    robot, scans = looking(BACK)
    goal = Pose(x=2.0, y=1.0)
    back = RouteRequest(floor=floor(), robot=robot, start=Pose(x=3.6, y=1.0), goal=goal, speed=0.5, placed_scans=scans)
    anywhere, seen = (plan_route(replace_in(back, known_behind=behind)) for behind in (None, 0.15))
    assert anywhere.values == seen.values
    blind = planned(
        floor(), back.start, goal, placed_scans=(PlacedScan(1.0, START, scan_with(WALLS, 1.0)),), known_behind=0.15
    )
    assert blind.values != seen.values


@pytest.mark.parametrize("heading", [0.0, 0.7, 1.3])
def test_a_scanner_that_looks_all_around_sees_behind_however_it_is_turned(heading: float) -> None:
    around = np.full(360, 4000, "<u2").tobytes()
    scan = Scan(source="", time=1.0, start_angle=-math.pi, increment=math.radians(1.0), ranges=around)
    robot, scans = looking({"heading_deg": heading}, scan=scan)
    assert sees_behind(scans, robot)
    known = known_ground(scans, robot, floor())
    assert known.any()


@pytest.mark.slow
def test_a_search_from_the_goal_drives_backwards_over_unknown_ground_only_as_far_as_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The shortest route would go back 2.8 m to a goal at a wall, where nobody has looked."""
    monkeypatch.setattr(planner, "BY_TURNS", ((True, planner.GREEDIER, 8_000),))
    on = floor_from(small_plan("clutter", 7).content)
    start, goal = Pose(x=4.607, y=4.230, heading=-2.867), Pose(x=2.48, y=0.594, heading=-0.019)
    seen = (PlacedScan(1.0, start, scan_with(WALLS, 1.0)),)

    def farthest_back(**keys: object) -> float:
        parts = unpacked_route(planned(on, start, goal, placed_scans=seen, **keys).values).parts
        return max(part.path.length for part in parts if part.backward)

    assert farthest_back() > 2.0
    assert farthest_back(known_behind=0.15) < MOST_BACK + 0.1


@pytest.mark.parametrize(
    ("before", "after", "counts"),
    [
        (4000, 4000, True),
        (1000, 4000, False),
        (4000, 1000, False),
        (1000, 0, True),
        (0, 4000, True),
        (0, 0, True),
        (1750, 4000, True),
    ],
)
def test_what_a_beam_measures_between_two_things_is_nowhere(before: int, after: int, counts: bool) -> None:
    """It meets the edge of what is near, and what is behind it; a pole is nearer than both of its neighbours."""
    ranges = WALLS.copy()
    ranges[250:270], ranges[270], ranges[271:290] = before, 1800, after
    returns = placed_returns(PlacedScan(1.0, Pose(), scan_with(ranges, 1.0)), ROBOT.scanners["front"])
    assert bool((np.abs(returns[:, 0] - 0.56 - 1.8) < 0.01).any()) == counts


@pytest.mark.parametrize(("near", "mask"), [(300, ()), (600, ((-1.0, -0.1),))])
def test_a_mixed_pixel_beside_the_robots_own_parts_or_what_is_too_near_is_nowhere(
    near: int, mask: tuple[tuple[float, float], ...]
) -> None:
    """They count for nothing themselves, but how far they are is known."""
    ranges, mounting = WALLS.copy(), ROBOT.scanners["front"].model_copy(update={"mask": mask})
    ranges[268:270], ranges[270] = near, 1800
    returns = placed_returns(PlacedScan(1.0, Pose(), scan_with(ranges, 1.0)), mounting)
    assert not (np.abs(returns[:, 0] - 0.56 - 1.8) < 0.01).any()


@pytest.mark.parametrize("beside", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wall_that_is_seen_at_a_grazing_angle_stands_there(beside: float, side: float) -> None:
    """Two neighbouring beams are up to half a metre apart on it; noise as of an LMS100."""
    bearings = np.radians(np.arange(541) * 0.5 - 135.0)
    with np.errstate(divide="ignore"):
        true = beside / np.sin(side * bearings)
    dice = np.random.default_rng(3)
    for _ in range(20):
        noisy = true + dice.normal(0.0, 0.012, 541)
        ranges = np.where((true > 0.0) & (true < 4.0), 1000.0 * noisy, 8000.0).astype("<u2")
        wall = placed_returns(PlacedScan(1.0, Pose(), scan_with(ranges, 1.0)), ROBOT.scanners["front"])
        at = np.sort(wall[np.abs(wall[:, 1] - side * beside) < 0.03, 0] - 0.56)
        assert at[-1] > 3.4
        assert np.diff(at[at > 0.6]).max() < 0.65, "a hole in the wall"


@pytest.mark.parametrize("size", [0.5, 1.0, 3.0])
def test_warming_up_plans_fits_and_packs_a_route(size: float) -> None:
    """Whatever the robot: one that returned before it searched would leave the compilation to the first plan."""
    outline = Outline(front_m=size * FRONT, rear_m=size * REAR, half_width_m=size * HALF)
    found = warm_up(ROBOT.model_copy(update={"outline": outline}))
    assert found.values, found.detail
    assert found.expanded > 0


def test_scans_that_show_nothing_on_the_map_are_no_obstacle() -> None:
    nothing = [PlacedScan(0.5 * n, START, scan_with(np.zeros(541, "<u2"), 0.5 * n)) for n in range(6)]
    assert stands(nothing, floor()).size == 0
