"""Random scenes of what stands around a robot, its scanner, and how it drives there, as badly as it may.

What drives is the obstacle stop and the gate of artemis. What judges is no part of it: rays, outline and motion are
computed here, in steps of 10 ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from artemis.motion.limits import Gate
from artemis.motion.obstacles import ObstacleStop
from artemis.mounting import Mounting, Outline
from artemis.scan import ObstacleRules, Scan
from artemis.testing.contracts import ROBOT
from artemis.values import DriveCommand, LocatedPose, Odometry, Pose, Sensed, SetPoints, Snapshot, Verdict, Wish
from artemis.vehicle import RobotFile

Array = NDArray[np.float64]

OUTLINE = Outline(front_m=0.73, rear_m=0.15, half_width_m=0.27)
BEAMS, FIELD, LEAST, FARTHEST = 541, math.radians(135.0), 0.5, 20.0
SCANNER = Mounting(
    plugin="lms1xx", x_m=0.6, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=LEAST, host="scanner"
)  # type: ignore[call-arg]
ANGLES = np.linspace(-FIELD, FIELD, BEAMS)
PERIOD, STEP = 0.02, 0.01
"""Of the scanner and the robot's ticks, and of what is computed here [s]."""
LOOKED = 1.5
"""What is farther from the rear axle is not near [m]."""
DELAY = 2
"""Ticks until the wheels do what left the gate."""
LOST, RARE = 0.2, 0.85
"""Share of the beams that return nothing: in every fourth random scene, and in those with a thin leg."""
HALL: Array = np.array([[-9.0, -6.0, 9.0, -6.0], [9.0, -6.0, 9.0, 6.0], [9.0, 6.0, -9.0, 6.0], [-9.0, 6.0, -9.0, -6.0]])
"""Segments [m]."""
THICK = 0.03
"""Of walls [m]: one without thickness is not seen by a scanner that looks along it."""
STANDS = 5
"""Ticks without motion, after which the robot knows that it stands."""


@cache
def robot_with_scanner() -> RobotFile:
    """ARTEMIS with a scanner at its front."""
    return ROBOT.model_copy(update={"outline": OUTLINE, "scanners": {"front": SCANNER}})


@dataclass(slots=True)
class Scene:
    """Segments, shape (n, 4), and circles, shape (m, 3) [m]; how fast each circle moves, shape (m, 2) [m/s]."""

    segments: Array = field(default_factory=lambda: np.zeros((0, 4)))
    circles: Array = field(default_factory=lambda: np.zeros((0, 3)))
    moves: Array = field(default_factory=lambda: np.zeros((0, 2)))
    _points: Array = field(init=False, repr=False)
    """Of the segments, 5 mm apart."""

    def __post_init__(self) -> None:
        pieces = [np.zeros((2, 0))]
        for ax, ay, bx, by in self.segments.tolist():
            share = np.linspace(0.0, 1.0, int(math.hypot(bx - ax, by - ay) / 0.005) + 2)
            pieces.append(np.array([ax + share * (bx - ax), ay + share * (by - ay)]))
        self._points = np.concatenate(pieces, axis=1)
        if not len(self.moves):
            self.moves = np.zeros((len(self.circles), 2))

    @property
    def fastest(self) -> float:
        """Of what moves [m/s]."""
        return float(np.hypot(*self.moves.T).max(initial=0.0))

    def move(self, time: float) -> None:
        """What moves goes on [s]."""
        self.circles[:, :2] += self.moves * time

    def ranges(self, x: float, y: float, heading: float) -> Array:
        """Of all beams from a place [m], the farthest where nothing is."""
        c, s = np.cos(heading + ANGLES), np.sin(heading + ANGLES)
        best = np.full(BEAMS, FARTHEST)
        if len(self.segments):
            ax, ay, bx, by = self.segments.T[:, :, None]
            ex, ey, qx, qy = bx - ax, by - ay, ax - x, ay - y
            across = c * ey - s * ex
            across = np.where(np.abs(across) < 1e-12, 1e-12, across)
            far, along = (qx * ey - qy * ex) / across, (qx * s - qy * c) / across
            hit = (far > 0) & (along >= 0) & (along <= 1)
            best = np.minimum(best, np.where(hit, far, FARTHEST).min(axis=0))
        if len(self.circles):
            px, py, radius = self.circles.T[:, :, None]
            qx, qy = px - x, py - y
            near = qx * c + qy * s
            rest = radius * radius - (qx * qx + qy * qy - near * near)
            far = near - np.sqrt(np.maximum(rest, 0.0))
            best = np.minimum(best, np.where((rest > 0) & (far > 0), far, FARTHEST).min(axis=0))
        return np.asarray(best)

    def distance(self, x: float, y: float, heading: float) -> float:
        """Of the outline to the nearest thing within `LOOKED`, else less than to any [m]; negative: it is touched."""
        c, s = math.cos(heading), math.sin(heading)
        found = [LOOKED - math.hypot(OUTLINE.front_m, OUTLINE.half_width_m)]
        dx, dy = self._points[0] - x, self._points[1] - y
        if (near := np.abs(dx) + np.abs(dy) < 1.5 * LOOKED).any():
            found.append(float(_outside(dx[near], dy[near], c, s).min()))
        if len(self.circles):
            px, py, radius = self.circles.T
            found.append(float((_outside(px - x, py - y, c, s) - radius).min()))
        return min(found)


def _outside(dx: Array, dy: Array, c: float, s: float) -> Array:
    x, y = c * dx + s * dy, c * dy - s * dx
    ahead, beside = np.maximum(-OUTLINE.rear_m - x, x - OUTLINE.front_m), np.abs(y) - OUTLINE.half_width_m
    outside = np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0))
    return np.where((ahead > 0) | (beside > 0), outside, np.maximum(ahead, beside))


def box(x: float, y: float, length: float, width: float, turn: float) -> list[list[float]]:
    """The four sides of a box, or of a wall: its middle [m], and how far it is turned [rad]."""
    c, s = math.cos(turn), math.sin(turn)
    corners = [(x + u * length * c - v * width * s, y + u * length * s + v * width * c)
               for u, v in ((0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5))]  # fmt: skip
    return [[*corners[corner], *corners[(corner + 1) % 4]] for corner in range(4)]


def random_scene(dice: np.random.Generator) -> Scene:
    """A wall at any angle, poles of 2 cm, boxes, a corridor with a door, or some of each."""
    kind, segments, circles = dice.integers(5), [], []
    if kind in (0, 4):
        ahead, turn = OUTLINE.front_m + dice.uniform(1.2, 3.0), dice.uniform(-1.3, 1.3)
        segments += box(ahead, 0.0, 6.0, THICK, turn + math.pi / 2.0)
    if kind in (1, 4):
        circles += [[dice.uniform(1.3, 3.5), dice.uniform(-1.5, 1.5), 0.01] for _ in range(5)]
    if kind == 2:
        for _ in range(3):
            x, y, turn = dice.uniform(1.4, 3.5), dice.uniform(-1.6, 1.6), dice.uniform(0, math.tau)
            length, width = dice.uniform(0.1, 0.5, 2).tolist()
            segments += box(x, y, length, width, turn)
    if kind == 3:
        wide, end = dice.uniform(0.45, 0.9), dice.uniform(1.5, 4.0)
        door = dice.uniform(-wide, 0.3)
        for side in (-1.0, 1.0):
            segments += box(2.0, side * (wide + THICK / 2.0), 8.0, THICK, 0.0)
        segments += box(end, (door - wide) / 2.0, THICK, door + wide, 0.0)
        circles.append([dice.uniform(1.3, 4.0), dice.uniform(-wide, wide), 0.01])
    return Scene(np.array(segments).reshape(-1, 4), np.array(circles).reshape(-1, 3))


@dataclass(slots=True, kw_only=True)
class Passage:
    """Of a drive."""

    nearest: float = math.inf
    """Least distance between the outline and anything [m]."""
    speed: float = 0.0
    """Of the robot then [m/s]."""
    contact: float | None = None
    """Speed of the robot when something was touched first [m/s]."""
    driven: float = 0.0
    """[m]."""
    slowed: int = 0
    """How often its speed fell below 90 % of the wished one for what it saw."""
    fastest: float = 0.0


class Driver:
    """Wishes of somebody who does not look: another speed and angle every now and then."""

    def __init__(self, dice: np.random.Generator, top: float, largest: float, reverse: float = 0.0) -> None:
        self._dice, self._top, self._largest, self._reverse = dice, top, largest, reverse
        self._until, self._command = 0.0, DriveCommand()

    def command(self, time: float) -> DriveCommand:
        """At a time [s]."""
        if time >= self._until:
            dice = self._dice
            self._until = time + dice.uniform(0.2, 1.6)
            speed = dice.uniform(0.3, self._top) * (-1.0 if dice.random() < self._reverse else 1.0)
            turned = dice.random() < 0.7
            self._command = DriveCommand(
                speed=float(speed), steering=float(dice.uniform(-self._largest, self._largest)) if turned else 0.0
            )
        return self._command


@dataclass(slots=True, kw_only=True)
class ScanErrors:
    """What is wrong with the scanner and the odometry."""

    noise: float = 0.012
    bias: float = 0.03
    dust: float = 5e-4
    slip: float = 0.02
    late: float = 0.03
    """Some scans come one tick late."""
    lost: float = 0.0
    """Share of the beams that return nothing, from whatever stands there."""


def drive(
    scene: Scene,
    driver: Driver,
    seed: int,
    *,
    seconds: float = 8.0,
    rules: ObstacleRules | None = None,
    errors: ScanErrors | None = None,
    start: Pose | None = None,
) -> Passage:
    """What comes of it. The robot begins at the origin, or at `start`."""
    robot, dice = robot_with_scanner(), np.random.default_rng(seed)
    rules, errors = rules or ObstacleRules(mode="stop", free_after=0.0), errors or ScanErrors()
    watch, gate = ObstacleStop(robot, [rules]), Gate(robot, PERIOD)
    wheelbase, top = robot.geometry.wheelbase_m, robot.limits.speed_m_s
    x, y, heading = (start.x, start.y, start.heading) if start else (0.0, 0.0, 0.0)
    odometry, last, outcome = Odometry(distance=1.0), SetPoints(), Passage()  # it has seen what is near
    waiting = [last] * DELAY
    bias, slip = dice.uniform(-errors.bias, errors.bias), dice.uniform(-errors.slip, errors.slip)
    held: list[Scan] = []
    slow, near, still = False, 0.0, 0
    for tick in range(round(seconds / PERIOD)):
        now = tick * PERIOD
        away = SCANNER.x_m * math.cos(heading), SCANNER.x_m * math.sin(heading)
        held.append(_scan(scene.ranges(x + away[0], y + away[1], heading), now, bias, errors, dice))
        scans = () if dice.random() < errors.late else tuple(held)
        held = held if not scans else []
        wish = Wish(command=driver.command(now))
        still = still + 1 if odometry.speed == 0.0 else 0
        snapshot = _snapshot(tick, scans, odometry, last, standing=still >= STANDS)
        clearance = watch.look(wish, last, snapshot, rules)
        ceiling = math.inf if clearance is None else clearance.speed
        last = gate.limit(wish.command, last, PERIOD, ceiling, stop=abs(last.speed) > ceiling)
        waiting.append(last)
        points = waiting.pop(0)
        for _ in range(round(PERIOD / STEP)):
            x, y, heading = _rolled(x, y, heading, points.speed * STEP, points.steering, wheelbase)
            scene.move(STEP)
            near -= STEP * (scene.fastest + 3.0 * abs(points.speed))
            if near < outcome.nearest:  # it may have come nearer since it was looked
                near = scene.distance(x, y, heading)
                if near < outcome.nearest:
                    outcome.nearest, outcome.speed = near, abs(points.speed)
                    if near < 0.0 and outcome.contact is None:
                        outcome.contact = abs(points.speed)
        outcome.driven += abs(points.speed) * PERIOD
        outcome.fastest = max(outcome.fastest, abs(points.speed))
        was_slow, slow = slow, bool(tick) and ceiling < 0.9 * min(abs(wish.command.speed), top)  # first comes a scan
        outcome.slowed += slow and not was_slow
        pose = odometry.pose
        counted = points.speed * PERIOD * (1.0 + slip)
        there = _rolled(pose.x, pose.y, pose.heading, counted, points.steering, wheelbase)
        odometry = Odometry(
            pose=Pose(x=there[0], y=there[1], heading=there[2]),
            speed=points.speed,
            steering=points.steering,
            distance=odometry.distance + counted * math.cos(points.steering),
        )
    return outcome


def _snapshot(tick: int, scans: tuple[Scan, ...], odometry: Odometry, last: SetPoints, *, standing: bool) -> Snapshot:
    """Of a tick."""
    return Snapshot(
        sensed=Sensed(index=tick, time=tick * PERIOD, scans=scans),
        dt=PERIOD,
        pose=LocatedPose(pose=odometry.pose),
        odometry=odometry,
        standing=standing,
        set_points=last,
        verdict=Verdict(),
    )


def _rolled(
    x: float, y: float, heading: float, distance: float, steering: float, wheelbase: float
) -> tuple[float, ...]:
    """Where the rear axle is after the virtual front wheel rolled so far."""
    turn = distance * math.sin(steering) / wheelbase
    middle = heading + turn / 2.0
    ahead = distance * math.cos(steering)
    return x + ahead * math.cos(middle), y + ahead * math.sin(middle), heading + turn


def _scan(ranges: Array, now: float, bias: float, errors: ScanErrors, dice: np.random.Generator) -> Scan:
    seen = ranges < FARTHEST
    measured = ranges + np.where(seen, bias + dice.normal(0.0, errors.noise, BEAMS), 0.0)
    dusty = dice.random(BEAMS) < errors.dust
    measured = np.where(dusty, dice.uniform(0.2, 3.0, BEAMS), measured)
    there = (seen | dusty) & (measured >= LEAST)
    if errors.lost:
        there &= dice.random(BEAMS) >= errors.lost
    packed = np.where(there, np.round(1000.0 * measured), 0.0).astype("<u2").tobytes()
    return Scan(source="front", time=now, start_angle=-FIELD, increment=2 * FIELD / (BEAMS - 1), ranges=packed)


def behind(scene: Scene) -> Scene:
    """What stands still before the robot, turned around its middle."""
    ends = OUTLINE.front_m - OUTLINE.rear_m  # their sum, as the rear is behind the axle
    turned = np.array([ends, 0.0, ends, 0.0]) - scene.segments
    return Scene(turned, np.c_[ends - scene.circles[:, 0], -scene.circles[:, 1:2], scene.circles[:, 2]])


def random_drive(seed: int, seconds: float = 8.0, reverse: float = 0.0, *, around: bool = False) -> Passage | None:
    """In a random scene, or with one on each side; None: the robot would stand in it."""
    dice = np.random.default_rng(seed)
    scene = random_scene(dice)
    if around:
        other = behind(random_scene(dice))
        scene = Scene(np.r_[scene.segments, other.segments], np.r_[scene.circles, other.circles])
    if scene.distance(0.0, 0.0, 0.0) < 0.10:
        return None
    errors = ScanErrors(lost=LOST if seed % 4 == 0 else 0.0)
    return drive(scene, Driver(dice, 0.7, math.radians(60.0), reverse), seed, seconds=seconds, errors=errors)


class Steady(Driver):
    """Wishes one speed [m/s] and angle [rad]."""

    def __init__(self, speed: float, steering: float = 0.0) -> None:
        self._until, self._command = math.inf, DriveCommand(speed=speed, steering=steering)


def rarely_seen(seed: int) -> Passage:
    """At full speed to a leg of 2.5 to 4 cm, while few beams return; in a hall or on open ground."""
    dice = np.random.default_rng(seed)
    x, y, radius = dice.uniform([2.0, -0.25, 0.0125], [4.0, 0.25, 0.02])
    scene = Scene(HALL if dice.random() < 0.5 else np.zeros((0, 4)), np.array([[x, y, radius]]))
    return drive(scene, Steady(0.7), seed, seconds=x / 0.7 + 2.0, errors=ScanErrors(lost=RARE))


def straight(seed: int, scene: Scene, distance: float, dust: float) -> Passage:
    """Straight ahead at full speed [m]."""
    return drive(scene, Steady(0.7), seed, seconds=distance / 0.7 + 1.4, errors=ScanErrors(dust=dust))


def corridor(width: float, length: float) -> Scene:
    """From behind the robot, so wide and long [m]."""
    half = width / 2.0
    return Scene(np.array([[-2.0, half, length, half], [-2.0, -half, length, -half]]))
