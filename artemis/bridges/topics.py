"""What a run publishes for other programs: messages of the standard types of ROS from a tick, before any transport.

Frames are those of REP 103 and 105: `map` -> `odom` (once a localizer found the robot) -> `base_link`, and of that the
wheels and the scanners. `base_link` is on the ground below the centre of the rear axle, x ahead, y to the left, z up.
Units are metres, radians, seconds, volts, amperes. A pose without meaning is not published.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from math import atan2, cos, nan, pi, sin
from typing import TYPE_CHECKING, Any, NamedTuple

from artemis.battery import BatteryState
from artemis.bridges.diagnostics import diagnosis, signature
from artemis.bridges.names import part_of_name
from artemis.motion.ackermann import Ackermann
from artemis.motion.planned_route import route_poses
from artemis.motion.poses import placed, seen_from
from artemis.motion.route import Route
from artemis.scan import Scan
from artemis.values import DriveFeedback, JobKind, Pose, Tick
from artemis.vehicle import RobotFile

if TYPE_CHECKING:
    from artemis.mapping.occupancy import ShownMap

BASE, ODOM, MAP = "base_link", "odom", "map"
SLOW_PERIOD = 1.0
"""Diagnostics, the battery and the goal come at least this often [s]."""
PATH_SPACING = 0.05
"""Of the poses of a path [m]."""
_SIDES = {"left": 1.0, "right": -1.0}

Content = dict[str, Any]
"""A message: values by the names of its fields; times are {"sec", "nanosec"}, a message in it is such a mapping."""


class Topic(NamedTuple):
    """A stream of messages of one type."""

    name: str
    """As it is before a transport resolves it: relative, but for `/tf`, `/tf_static` and `/diagnostics`."""
    type: str
    """Such as `nav_msgs/msg/Odometry`."""
    latched: bool = False
    """A later subscriber gets the last one."""


class Told(NamedTuple):
    """One message of a topic."""

    topic: Topic
    content: Content


ODOMETRY = Topic("odom", "nav_msgs/msg/Odometry")
POSE = Topic("pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
TRANSFORMS = Topic("/tf", "tf2_msgs/msg/TFMessage")
FIXED_TRANSFORMS = Topic("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
JOINTS = Topic("joint_states", "sensor_msgs/msg/JointState")
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
PATH = Topic("path", "nav_msgs/msg/Path", latched=True)
GOAL = Topic("goal", "geometry_msgs/msg/PoseStamped")
BATTERY = Topic("battery", "sensor_msgs/msg/BatteryState")
GRID = Topic("map", "nav_msgs/msg/OccupancyGrid", latched=True)
SCAN_TYPE = "sensor_msgs/msg/LaserScan"


class Topics:
    """Turns the ticks of one run into messages.

    Attributes:
        topics: All that there may be messages of.
    """

    def __init__(
        self,
        robot: RobotFile,
        routes: Mapping[int, Route] | None = None,
        *,
        every: int = 1,
        transforms: bool = True,
        map: Callable[[], ShownMap | None] = lambda: None,
    ) -> None:
        """Begin.

        Args:
            robot: its geometry, drives and scanners.
            routes: the paths of the mission's steps that are known before the run, by the step's number.
            every: of odometry, pose, transforms and joints only each n-th is published.
            transforms: whether transforms are published at all; another program may do that.
            map: the run's map as it is at present, the same object until it changes.
        """
        self._robot, self._routes, self._every, self._transforms = robot, routes or {}, every, transforms
        map()  # what is known is read before the run
        self._map = map
        self._shown_map: ShownMap | None = None
        self._model = Ackermann(robot.geometry)
        self._joints = _Joints(robot)
        alone = len(robot.scanners) == 1
        self._scans = {
            name: Topic("scan" if alone else f"{part_of_name(name)}/scan", SCAN_TYPE) for name in robot.scanners
        }
        self._count = 0
        self._slow_at = 0.0
        self._signature: object = None
        self._shown_step: int | None = None
        self._goal: tuple[Pose, str] | None = None
        """Where the path that is shown ends, and its frame."""
        self._goal_is_new = False
        named = (ODOMETRY, POSE, JOINTS, DIAGNOSTICS, PATH, GOAL, BATTERY, GRID)
        tf = (TRANSFORMS, FIXED_TRANSFORMS) if transforms else ()
        self.topics: tuple[Topic, ...] = (*named, *tf, *self._scans.values())

    def begin(self, stamp: int) -> Iterator[Told]:
        """What holds for the whole run; `stamp` [ns since 1970]."""
        if self._transforms:
            yield Told(FIXED_TRANSFORMS, {"transforms": [*self._joints.fixed(stamp), *self._mounted(stamp)]})
        yield from self._grid(stamp)

    def tell(self, tick: Tick, stamp: int, wanted: Collection[str] | None = None) -> Iterator[Told]:
        """The messages of a tick.

        Args:
            tick: the next one.
            stamp: its time [ns since 1970].
            wanted: names of the topics with subscribers; latched ones are published anyway. None: all.
        """

        def heard(topic: Topic) -> bool:
            return wanted is None or topic.name in wanted

        if self._count % self._every == 0:
            yield from self._motion(tick, stamp, heard)
        self._count += 1
        for scan in tick.snapshot.sensed.scans:
            topic = self._scans.get(scan.source)
            if topic is not None and heard(topic):
                yield Told(topic, _scan(scan, stamp + round((scan.time - tick.snapshot.time) * 1e9)))
        yield from self._path(tick, stamp)
        yield from self._planned(tick, stamp)
        yield from self._slow(tick, stamp, heard)

    # ------------------------------------------------------------------------------------------ each tick

    def _motion(self, tick: Tick, stamp: int, heard: Any) -> Iterator[Told]:  # noqa: ANN401 (a predicate)
        snapshot = tick.snapshot
        odometry, located = snapshot.odometry, snapshot.pose
        localized = located.frame == MAP and not located.lost
        if heard(ODOMETRY) and not odometry.lost:
            twist = {"linear": {"x": odometry.speed * cos(odometry.steering)}}
            twist["angular"] = {"z": odometry.speed * sin(odometry.steering) / self._model.wheelbase}
            pose = {"pose": _pose(odometry.pose)}
            content = {"header": _header(stamp, ODOM), "child_frame_id": BASE, "pose": pose, "twist": {"twist": twist}}
            yield Told(ODOMETRY, content)
        if heard(POSE) and localized:
            where = {"pose": _pose(located.pose), "covariance": _covariance(located.covariance)}
            yield Told(POSE, {"header": _header(stamp, MAP), "pose": where})
        if self._transforms and heard(TRANSFORMS):
            moving = []
            if localized and not odometry.lost:
                moving.append(_transform(stamp, MAP, ODOM, placed(located.pose, seen_from(odometry.pose, Pose()))))
            elif self._shown_map is not None and self._shown_map.odometry is not None:
                moving.append(_transform(stamp, MAP, ODOM, self._shown_map.odometry))
            if not odometry.lost:
                moving.append(_transform(stamp, ODOM, BASE, odometry.pose))
            moving += self._joints.steered(stamp, snapshot.sensed.drives)
            yield Told(TRANSFORMS, {"transforms": moving})
        if heard(JOINTS) and (joints := self._joints.state(snapshot.sensed.drives)):
            yield Told(JOINTS, {"header": _header(stamp, ""), **joints})

    # ------------------------------------------------------------------------------------------ now and then

    def _slow(self, tick: Tick, stamp: int, heard: Any) -> Iterator[Told]:  # noqa: ANN401 (a predicate)
        time, battery = tick.snapshot.time, tick.snapshot.sensed.battery_v
        due, new = time >= self._slow_at, signature(tick)
        changed, self._signature = new != self._signature, new
        if due:
            self._slow_at = time + SLOW_PERIOD
            yield from self._grid(stamp)
        if (due or changed) and heard(DIAGNOSTICS):
            yield Told(DIAGNOSTICS, {"header": _header(stamp, ""), "status": diagnosis(self._robot, tick)})
        if due and battery is not None and heard(BATTERY):
            yield Told(BATTERY, {"header": _header(stamp, BASE), **self._battery(battery, tick.snapshot.battery)})
        goal_due, self._goal_is_new = due or self._goal_is_new, False
        if goal_due and self._goal is not None and heard(GOAL):
            pose, frame = self._goal  # published again for later subscribers, until the path ends
            yield Told(GOAL, {"header": _header(stamp, frame), "pose": _pose(pose)})

    def _battery(self, volts: float, known: BatteryState | None) -> Content:
        """What is measured and estimated of it: currents out of it are negative [A], charges in Ah, shares 0 to 1."""
        unknown = dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity", "percentage"), nan)
        content = {"voltage": volts, "present": True, **unknown}
        if (battery := self._robot.battery) is not None:
            content["capacity"] = battery.capacity_ah
            if known is not None:
                content["percentage"], content["charge"] = known.charge, known.charge * battery.capacity_ah
                content["current"] = -known.watts / volts if volts else nan
        return content

    def _grid(self, stamp: int) -> Iterator[Told]:
        """The map, where it is another one than before."""
        if (shown := self._map()) is None or shown is self._shown_map:
            return
        self._shown_map, content = shown, shown.content
        rows, columns = content.cells.shape
        x, y, heading = content.origin
        about = {
            "map_load_time": _time(stamp),
            "resolution": content.resolution,
            "width": columns,
            "height": rows,
            "origin": _pose(Pose(x=x, y=y, heading=heading)),
        }
        yield Told(GRID, {"header": _header(stamp, MAP), "info": about, "data": content.cells.ravel()})

    def _path(self, tick: Tick, stamp: int) -> Iterator[Told]:
        """The path of a step that begins, and where it ends; after the last one an empty path."""
        if (step := tick.position.step) == self._shown_step:
            return
        shown, self._shown_step = self._shown_step is not None, step
        route = self._routes.get(step)
        poses = [] if route is None else route.poses(PATH_SPACING)
        if poses or shown:
            yield from self._path_told(poses, tick.snapshot.pose.frame, stamp)

    def _planned(self, tick: Tick, stamp: int) -> Iterator[Told]:
        """A route that was planned for the present step, and where it ends."""
        for result in tick.snapshot.sensed.results:
            if result.kind is JobKind.PLAN and result.values:
                yield from self._path_told(route_poses(result.values), MAP, stamp)

    def _path_told(self, poses: Sequence[Pose], frame: str, stamp: int) -> Iterator[Told]:
        stamped = [{"header": _header(stamp, frame), "pose": _pose(pose)} for pose in poses]
        yield Told(PATH, {"header": _header(stamp, frame), "poses": stamped})
        self._goal, self._goal_is_new = (poses[-1], frame) if poses else None, True

    def _mounted(self, stamp: int) -> Iterator[Content]:
        for name, mounting in self._robot.scanners.items():
            place = Pose(x=mounting.x_m, y=mounting.y_m, heading=mounting.heading)
            yield _transform(stamp, BASE, name, place, mounting.height_m)


class _Joints:
    """The wheels: their places, steering angles and turns. A wheel's frame turns with its steering, not as it rolls."""

    def __init__(self, robot: RobotFile) -> None:
        geometry, self._driven = robot.geometry, robot.geometry.driven_axle
        self._half, self._kingpin = geometry.track_m / 2, geometry.kingpin_distance_m / 2
        self._wheelbase, self._scrub = geometry.wheelbase_m, geometry.scrub_radius_m
        self._radius: dict[str, float] = {}
        for side in _SIDES:
            drive = robot.drive_at("traction", side)[1]
            turn = robot.metres_per_count(side) * drive.sensor.counts_per_turn * drive.gear_ratio
            self._radius[side] = turn / (2 * pi)
        self._radius["middle"] = self._radius["left"]
        self._traction = {robot.drive_at("traction", side)[0]: side for side in robot.sides("traction")}
        self._steering = {robot.drive_at("steering", side)[0]: side for side in robot.sides("steering")}
        self._model, self._single = Ackermann(geometry), geometry.front_wheels == 1

    def fixed(self, stamp: int) -> Iterator[Content]:
        """The rear wheels."""
        for side, sign in _SIDES.items():
            yield _transform(stamp, BASE, f"rear_{side}_wheel", Pose(y=sign * self._half), self._radius[side])

    def steered(self, stamp: int, drives: tuple[DriveFeedback, ...]) -> list[Content]:
        """The front wheels, each on its kingpin; those that were received."""
        frames = []
        for drive in drives:
            if (turned := self._steering.get(drive.name)) is not None and drive.age is not None:
                for side, angle in self._turned(turned, drive.position):
                    sign = _SIDES.get(side, 0)
                    x, y = self._wheelbase - sign * self._scrub * sin(angle), self._kingpin + self._scrub * cos(angle)
                    wheel = Pose(x=x, y=sign * y, heading=angle)
                    frames.append(_transform(stamp, BASE, _named("front", side, "wheel"), wheel, self._radius[side]))
        return frames

    def _turned(self, side: str, angle: float) -> list[tuple[str, float]]:
        """The front wheels that a steering motor turns, with their angles [rad]; on a linkage those of a true pair."""
        if side != "middle":
            return [(side, angle)]
        steering = self._model.steering_from_left(angle)
        if self._single:
            return [(side, steering)]
        s, c, half = sin(steering), cos(steering), self._kingpin / self._wheelbase
        return [(side, atan2(s, c - sign * half * s)) for side, sign in _SIDES.items()]

    def state(self, drives: tuple[DriveFeedback, ...]) -> Content:
        """Names, positions [rad] and velocities [rad/s] of the joints whose drives were received."""
        names, positions, velocities = [], [], []
        for drive in drives:
            if drive.age is None:
                continue
            if (side := self._steering.get(drive.name)) is not None:
                names.append(_named("front", side, "steering"))
                radius = 1.0
            elif (side := self._traction.get(drive.name)) is not None:
                names.append(_named(self._driven, side, "wheel"))
                radius = self._radius[side]
            else:
                continue
            positions.append(drive.position / radius)
            velocities.append(drive.velocity / radius)
        return {"name": names, "position": positions, "velocity": velocities} if names else {}


def _named(axle: str, side: str, what: str) -> str:
    """Of a joint or frame; one in the middle has no side."""
    return f"{axle}_{what}" if side == "middle" else f"{axle}_{side}_{what}"


def _time(stamp: int) -> Content:
    sec, nanosec = divmod(stamp, 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


def _header(stamp: int, frame: str) -> Content:
    return {"stamp": _time(stamp), "frame_id": frame}


def _turn(heading: float) -> Content:
    return {"z": sin(heading / 2), "w": cos(heading / 2)}


def _pose(pose: Pose) -> Content:
    return {"position": {"x": pose.x, "y": pose.y}, "orientation": _turn(pose.heading)}


def _transform(stamp: int, parent: str, child: str, pose: Pose, height: float = 0.0) -> Content:
    moved = {"translation": {"x": pose.x, "y": pose.y, "z": height}, "rotation": _turn(pose.heading)}
    return {"header": _header(stamp, parent), "child_frame_id": child, "transform": moved}


def _covariance(of: tuple[float, ...]) -> list[float]:
    """That of x, y and heading within the one of x, y, z, roll, pitch, yaw, row by row."""
    full = [0.0] * 36
    if of:
        xx, xy, xh, yy, yh, hh = of
        for row, column, value in ((0, 0, xx), (0, 1, xy), (0, 5, xh), (1, 1, yy), (1, 5, yh), (5, 5, hh)):
            full[6 * row + column] = full[6 * column + row] = value
    return full


def _scan(scan: Scan, stamp: int) -> Content:
    """No return is published as 0 m, below `range_min`, so that it is not taken for free space."""
    ranges = scan.millimetres * 1e-3
    return {
        "header": _header(stamp, scan.source),
        "angle_min": scan.start_angle,
        "angle_max": scan.start_angle + scan.increment * (len(ranges) - 1),
        "angle_increment": scan.increment,
        "time_increment": scan.beam_time,
        "range_min": 0.001,
        "range_max": 65.535,
        "ranges": ranges,
        "intensities": scan.strengths,
    }
