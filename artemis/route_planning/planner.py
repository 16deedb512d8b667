"""A route from where the robot is to a pose on a floor: found, fitted to the robot, and looked at again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.angles import wrap
from artemis.motion.arrays import Array
from artemis.motion.planned_route import packed_route, planned_route
from artemis.motion.points import placed_points
from artemis.motion.route import Route
from artemis.route_planning.floor import (
    BESIDE,
    CELL,
    MARGIN,
    NEARNESS,
    NOT_FREE,
    Field,
    Floor,
    beyond_edge,
    clearance,
    covered,
    outline_box,
)
from artemis.route_planning.free_ground import FreeGround
from artemis.route_planning.heuristic import UNREACHABLE, cost_to_go
from artemis.route_planning.obstacle_layer import PlacedScan, known_ground, sees_behind, standing
from artemis.route_planning.present_route import PresentRoute, places
from artemis.route_planning.search import FOUND, NARROW, NO_WAY, are_free, search
from artemis.values import Pose
from artemis.vehicle import RobotFile

RADII = (1.55, 1.24, 1.053)
"""Least radius of the rear axle's path, as multiples of the robot's own, wheelbase / tan(steering): wide ones
are tried first, for the steering is to have something left. Of ARTEMIS they are 0.50, 0.40 and 0.34 m."""
GREEDY, GREEDIER = 1.5, 5.0
"""The heuristic counts so many times: routes may be about so much longer than the best, and are found far sooner."""
BY_TURNS = (
    (False, GREEDY, 1_000),
    (False, GREEDIER, 2_000),
    (True, GREEDIER, 2_000),
    (False, GREEDIER, 6_000),
    (True, GREEDIER, 5_000),
)
"""Whether they are sought from the goal, how greedily, and among how many: at a narrow end the search from the other
floods all that is in front of it. So it is done with the widest radius."""
NARROWER_TURNS = BY_TURNS[:3]
"""With each of the others: what is not found among 16,000 poses with the widest is rarely found at all."""
WIDE = 0.15
"""Where there is less room around the outline than so much more [m], a route costs more."""
NARROW_SPEED = 0.2
"""There the robot is no faster [m/s]: on the arc on which it would stop it must touch nothing."""
END_DISTANCE, END_ANGLE = 0.03, math.radians(3.0)
"""The robot is at the goal if it is at most so far from it [m, rad]."""
EXACT_ANGLE = math.radians(1.5)
"""A fitted route ends rather no more askew [rad]: to follow it takes the rest."""
RECOVERY = 0.5
"""Where no route begins, the robot may first go back so far along what it has just driven [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RouteRequest:
    """What is asked of the planner; poses in the frame of the map."""

    floor: Floor
    robot: RobotFile
    start: Pose
    goal: Pose
    speed: float
    """Highest, of the virtual front wheel [m/s]."""
    margin: float = MARGIN
    """Around the outline [m]."""
    placed_scans: tuple[PlacedScan, ...] = ()
    """What the scanners saw of late."""
    known_behind: float | None = None
    """Backwards rather only over ground that the scanners saw, or that the robot drove over, up to so much behind the
    outline [m]; None: over any. Scanners that look back see it while the robot drives."""
    driven: tuple[Pose, ...] = ()
    """What the robot has just driven, the oldest first: forwards, up to where it is."""
    present: tuple[int, ...] = ()
    """The route that it is on, as of `PlannedRoute`."""
    keep: bool = True
    """It is kept if the rest of it is free."""
    seek: bool = True
    """Another one is sought."""
    before: Floor | None = None
    """The floor for which it was planned, if the zones are others now."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRoute:
    """What came of it."""

    values: tuple[int, ...] = ()
    """As of `artemis.motion.planned_route.packed_route`; empty: there is no route, or none is needed."""
    arrived: bool = False
    """The robot is at the goal."""
    only_present: bool = False
    """There is no other route than the present one, on which something stands, but no new zone."""
    detail: str
    """The route, or why there is none, in words."""
    expanded: int = 0
    """Poses that were looked at."""

    def with_words(self, words: str) -> PlannedRoute:
        """The same with more to say; empty words: with no more."""
        return replace(self, detail=f"{self.detail}; {words}") if words else self


class _Try(NamedTuple):
    """How a route is sought."""

    radius: float
    """Least of the rear axle's path [m]."""
    from_goal: bool
    """The search begins at the goal."""
    greedy: float
    most: int
    over_known: bool = False
    """Backwards only over known ground; else wherever nothing stands."""


def plan_route(request: RouteRequest) -> PlannedRoute:
    """Plan a route; the robot needs an outline."""
    return _Planning(request).result()


def _end(route: Route) -> Pose:
    """Where a route ends."""
    last = route.parts[-1]
    end = last.path.at(last.path.length)
    return Pose(x=end.x, y=end.y, heading=last.heading_at(last.path.length))


class _Planning:
    def __init__(self, request: RouteRequest) -> None:
        self._request, self._floor = request, request.floor
        self._start, self._goal = self._floor.local(request.start), self._floor.local(request.goal)
        self._wide = outline_box(request.robot, request.margin + WIDE)
        occupied, clear = self._floor.occupied, clearance(self._floor.occupied)
        row, column = standing(request.placed_scans, request.robot.scanners, self._floor, clear)
        if row.size:
            occupied = occupied.copy()
            occupied[row, column] = True
            clear = clearance(occupied)
        self._ground = FreeGround(self._floor.occupied, occupied, clear, request.robot, request.margin, self._start)
        self._clear, self._box = clear, self._ground.box
        self._least = float(self._box[2]) - 2.0 * CELL
        bare = outline_box(request.robot, 0.0)
        self._seen = bare - (0.0, request.known_behind or 0.0, 0.0)
        self._known = self._anywhere = np.full_like(self._clear, np.inf)
        self._over_known = request.known_behind is not None and not sees_behind(request.placed_scans, request.robot)
        if self._over_known:
            known = known_ground(request.placed_scans, request.robot, self._floor)
            known |= covered(np.ones_like(known), self._start, bare)
            self._known = clearance(~known)
        self._expanded = 0
        self._reasons: list[str] = []
        self._askew: PlannedRoute | None = None
        """The first route that ends within the bars, but not exactly: taken if nothing better is found at once."""
        self._missed: Array | None = None
        """How far beside the goal the newest route ended that did not end exactly."""

    def result(self) -> PlannedRoute:
        """The route; where there is no other one the present one, unless it leads through a new zone."""
        found, request = self._found(), self._request
        if found.values or found.arrived or not request.present:
            return found
        present = PresentRoute(request.present, request.start, request.speed)
        if not request.seek and not present.is_on_it:
            return found
        if request.before is not None:
            if not present.is_allowed(self._floor, request.before, request.robot, request.margin):
                return replace(found, detail=f"{found.detail}, and a zone that is new is in the way of the present one")
        return replace(found, values=request.present, only_present=True)

    def _found(self) -> PlannedRoute:
        request = self._request
        away, turn = self._off_goal(request.start)
        if away <= END_DISTANCE and turn <= END_ANGLE:
            return PlannedRoute(arrived=True, detail="the robot is there already")
        if request.present and request.keep and self._rest_is_free():
            return PlannedRoute(values=request.present, detail="the rest of the route is free")
        if not request.seek:
            return PlannedRoute(detail="no other route is sought")
        if not self._floor.contains(self._goal):
            return PlannedRoute(detail="the goal lies outside of the map")
        if not self._ground.fits(self._goal):
            beyond = beyond_edge(self._floor, request.robot, self._goal, request.margin)
            at_edge = beyond and f"the robot cannot stand at the goal: {beyond}"
            return PlannedRoute(detail=at_edge or "something stands at the goal")
        nearness = 1.0 + NEARNESS * np.maximum(0.0, 1.0 - self._clear / BESIDE)
        slow = np.maximum(1.0, request.speed / self._floor.speed)
        self._cost = (self._floor.factor * nearness * slow).astype(np.float32)
        to_go = self._cost_to_go(self._ground.begun, self._goal)
        found = self._from(self._start, to_go, [])
        if found is None and (back := self._back()):
            found = self._from(self._floor.local(back[-1]), to_go, back)
        return found or PlannedRoute(detail=self._reasons[-1] + self._wrong_start(), expanded=self._expanded)

    def _wrong_start(self) -> str:
        """What is said besides if the robot stands where the map shows something."""
        if not covered(self._floor.occupied, self._start, outline_box(self._request.robot, 0.0), reach=0.0).any():
            return ""
        return f"; where the robot stands, the map shows {NOT_FREE}: is its pose right?"

    def _no_path(self, row: int, column: int) -> str:
        """Why the goal cannot be reached from a cell; the margin, if a robot with the usual one could get there."""
        margin = self._request.margin
        if margin > MARGIN and not self._wrong_start():
            to_go = self._cost_to_go(self._ground.begun, self._goal, self._least - margin + MARGIN)
            if to_go[row, column] <= UNREACHABLE:
                room = f"{100 * margin:.0f} cm around the robot's outline"
                return f"no path leads there that has room for {room}: a smaller `margin_m` of `obstacles` may help"
        return "no path leads there, however the robot turns"

    def _cost_to_go(self, clear: Field, pose: Array, least: float | None = None) -> Field:
        """As of `cost_to_go`, to a pose of the floor; where the outline has to be narrow, it costs as much more.

        `least`: radius [m]; None: that of the outline with the margin.
        """
        narrow = clear < self._wide[2] - 2.0 * CELL
        cost = np.where(narrow, np.float32(NARROW) * self._cost, self._cost)
        return cost_to_go(clear, cost, *self._cell_ahead(pose), CELL, self._least if least is None else least)

    def _from(self, start: Array, to_go: Field, back: Sequence[Pose]) -> PlannedRoute | None:
        """A route from a pose, after driving back to it."""
        row, column = self._cell_ahead(start)
        rows, columns = to_go.shape
        if not (0 <= row < rows and 0 <= column < columns):
            self._reasons.append("the robot is outside of the map")
            return None
        if to_go[row, column] > UNREACHABLE:
            self._reasons.append(self._no_path(row, column))
            return None
        begun, first_box = (self._clear, self._box) if back else (self._ground.begun, self._ground.first_box)
        over_known, from_start = not back and self._over_known, None
        for each in self._tries(over_known=over_known):
            if not each.from_goal:
                field, first = to_go, first_box
            elif begun is self._clear:
                if from_start is None:
                    from_start = self._cost_to_go(self._clear, start)
                field, first = from_start, self._box
            else:
                continue  # what does not count at the start is known only to a search that begins there
            some = False
            for aim in self._aims():
                ends = (aim, start) if each.from_goal else (start, aim)
                points = self._sought(each, ends, begun, field, first)
                if points is None:
                    break
                some = True
                if (found := self._taken(points, back, each.radius)) is not None:
                    return found
            if self._askew is not None and not some:
                break
        return self._askew and replace(self._askew, expanded=self._expanded)

    def _sought(self, each: _Try, ends: tuple[Array, Array], begun: Field, field: Field, first: Array) -> Array | None:
        """Places along a route as `search` gives it; None: there is none."""
        known = self._known if each.over_known else self._anywhere
        points, why, expanded = search(
            self._clear, begun, self._cost, field, *ends, self._box, first, self._wide,
            known, self._seen, each.radius, CELL, each.most,
            -1.0 if each.from_goal else 1.0, each.greedy,
        )  # fmt: skip
        self._expanded += expanded
        if why != FOUND:
            among = "" if why == NO_WAY else f" among {self._expanded} poses, down to"
            self._reasons.append(f"no route was found{among or ' with'} a radius of {each.radius:.2f} m")
            return None
        return np.asarray(points)

    def _aims(self) -> Iterator[Array]:
        """Where a search is to end: at the goal; then so far beside it as the fitted route ended on the other side."""
        self._missed = None
        yield self._goal
        if self._missed is not None:
            yield self._goal - self._missed

    def _tries(self, *, over_known: bool) -> Iterator[_Try]:
        """On wide curves, then on narrow ones."""
        robot = self._request.robot
        least = robot.geometry.wheelbase_m / math.tan(math.radians(robot.limits.steering_deg))
        widest = least * RADII[0]
        for known in (True, False) if over_known else (False,):
            yield from (_Try(widest, *turn, known) for turn in BY_TURNS)
        for share in RADII[1:] if self._askew is None else ():
            yield from (_Try(least * share, *turn) for turn in NARROWER_TURNS)

    def _taken(self, points: Array, back: Sequence[Pose], radius: float) -> PlannedRoute | None:
        """A route that was found, fitted to the robot; None: then it is none."""
        if back:
            backwards = [[*self._floor.local(pose), -1.0] for pose in back]
            points = np.concatenate([backwards, points[1:]])
        request = self._request
        on_map = placed_points(self._floor.origin, points[:, :2].T)
        wanted = np.column_stack([*on_map, self._speeds(points[:, :3]) * points[:, 3]])
        try:
            route = planned_route(wanted, request.robot, request.speed)
            problems = route.problems(request.robot, request.speed)
        except ConfigError as error:
            problems = list(error.problems)
        if not problems:
            problems = list(self._off(route))
        if problems:
            self._reasons.append(f"a route with a radius of {radius:.2f} m cannot be driven: {problems[0]}")
            return None
        reversals = len(route.parts) - 1
        words = f"{route.length:.1f} m, {reversals} reversal{'s' * (reversals != 1)}, radius {radius:.2f} m"
        found, end = PlannedRoute(values=packed_route(route), detail=words, expanded=self._expanded), _end(route)
        if self._off_goal(end)[1] <= EXACT_ANGLE:
            return found
        self._askew = self._askew or found
        self._missed = self._beside(end)
        return None

    def _beside(self, end: Pose) -> Array:
        """How far a pose of the map is beside the goal, in the frame of the floor: x, y [m], heading [rad]."""
        off = self._floor.local(end) - self._goal
        return np.array([off[0], off[1], wrap(float(off[2]))])

    def _off(self, route: Route) -> Iterator[str]:
        """Where a fitted route is not what was asked for."""
        away, turn = self._off_goal(_end(route))
        if away > END_DISTANCE or turn > END_ANGLE:
            yield f"it ends {100 * away:.1f} cm and {math.degrees(turn):.1f} degrees from the goal"
        driven, poses = places(route, self._request.speed)
        free = self._ground.are_free(self._floor.local_poses(poses), driven)
        blocked = driven[(driven >= CELL) & ~free]  # nearer: the robot is there
        if blocked.size:
            yield f"it is not free at {blocked[0]:.2f} m"

    def _rest_is_free(self) -> bool:
        """Whether the present route is free from where the robot is, and no faster than new zones want."""
        request = self._request
        present, before = PresentRoute(request.present, request.start, request.speed), request.before
        return present.is_free(self._floor, self._ground) and (before is None or present.is_slow(self._floor, before))

    def _off_goal(self, pose: Pose) -> tuple[float, float]:
        """How far a pose is from the goal [m], and by how much it is turned [rad]."""
        goal = self._request.goal
        return math.hypot(pose.x - goal.x, pose.y - goal.y), abs(wrap(pose.heading - goal.heading))

    def _speeds(self, poses: Array) -> Array:
        """Highest speed at poses of the floor [m/s]: by the zones, and slow where there is little room."""
        rows, columns = self._floor.speed.shape
        row = np.clip((poses[:, 1] / CELL).astype(int), 0, rows - 1)
        column = np.clip((poses[:, 0] / CELL).astype(int), 0, columns - 1)
        free = are_free(poses, self._clear, CELL, self._wide)
        highest = np.minimum(self._floor.speed[row, column], self._request.speed)
        return np.asarray(np.where(free, highest, np.minimum(highest, NARROW_SPEED)))

    def _cell_ahead(self, pose: Array) -> tuple[int, int]:
        """The cell of the point on the outline's middle line that is half a width ahead of its rear."""
        ahead = self._box[1] + self._box[2]
        x, y = pose[0] + ahead * math.cos(pose[2]), pose[1] + ahead * math.sin(pose[2])
        return math.floor(y / CELL), math.floor(x / CELL)

    def _back(self) -> list[Pose]:
        """From where the robot is back along what it has just driven; empty: it has not, or something stands there."""
        back, length = [self._request.start], 0.0
        for pose in reversed(self._request.driven):
            step = math.hypot(pose.x - back[-1].x, pose.y - back[-1].y)
            if step < CELL:
                continue
            if not self._ground.fits_first(self._floor.local(pose)):
                break
            back.append(pose)
            length += step
            if length >= RECOVERY:
                break
        return back if length > RECOVERY / 2 else []
