"""Paths for the centre of the rear axle: read, smoothed, sampled at constant arc length, projected onto."""

from __future__ import annotations

import copy
import math

import numpy as np
from msgspec import Struct

from artemis.errors import ConfigError
from artemis.motion.arrays import Array, wrapped
from artemis.motion.cubic import spline
from artemis.motion.demand import steering_per_distance
from artemis.motion.noise import Drawn, Noise, noise_of
from artemis.motion.path_points import MIN_STEP, cusps, read_points
from artemis.motion.samples import Samples
from artemis.motion.spline import parameter_from_arc, smoothed, smoothed_between_halts
from artemis.vehicle import RobotFile

SPACING = 0.02
"""Arc length between samples [m]; the real spacing is a little less, so that they end with the path."""
SMOOTHING = 0.3
"""Wavelength [m] of which smoothing halves the amplitude. A drivable circle (r > 0.3 m) moves by less than 1 mm, while
the noise of a tenth of a millimetre, which curvature would multiply, goes. Points with more are smoothed by more."""
SHAPE = 2.0
"""Smoothing moves half of the points by no more than this many standard deviations of their noise; it would change the
shape of the path, not the noise."""
WINDOW = 0.3


class PathPoint(Struct, frozen=True, kw_only=True):
    """A point of a path. Heading is that of the tangent, in (-pi, pi]; curvature [1/m] is positive to the left."""

    arc_length: float
    x: float
    y: float
    heading: float
    curvature: float


class Projection(PathPoint, frozen=True, kw_only=True):
    """The point of a path that is nearest to a robot."""

    cross_track: float
    """How far the robot is to the left of the tangent [m]."""


class Path:
    """A curve sampled at constant arc length; made by `path_from_csv` or `path_from_points`.

    Attributes:
        x, y: samples [m], frame of the odometry. A closed path repeats its first sample at its end.
        heading: of the tangent [rad], continuous (not wrapped).
        curvature: [1/m], left positive.
        speed: recorded speed of the virtual front wheel [m/s], or None.
        spacing: arc length between samples [m].
        closed: the end joins the start.
        laps: how often a closed path is driven; the rest of one may end before its last lap does.
        drawn: the points that it was made of; None: it was made of none.
    """

    def __init__(
        self,
        x: Array,
        y: Array,
        heading: Array,
        curvature: Array,
        *,
        spacing: float,
        closed: bool = False,
        speed: Array | None = None,
        drawn: Drawn | None = None,
    ) -> None:
        self.x, self.y, self.heading, self.curvature, self.speed = x, y, heading, curvature, speed
        self.spacing, self.closed, self.laps = spacing, closed, 1
        self.drawn = drawn
        self._samples = Samples(
            x.tolist(), y.tolist(), heading.tolist(), curvature.tolist(), spacing=spacing, closed=closed
        )
        self._speed: list[float] = [] if speed is None else speed.tolist()
        self._last = len(x) - 1
        self._driven = 0.0

    @property
    def arc_length(self) -> Array:
        """Arc length of the samples of one lap [m], shape (n,)."""
        return np.linspace(0.0, self._last * self.spacing, self._last + 1)

    @property
    def length(self) -> float:
        """Distance from the start to the end of the last lap [m]."""
        return self._last * self.spacing * self.laps - self._driven

    def duration(self, speed: float) -> float:
        """How long all laps take [s] at a speed [m/s], or the path's own where that is lower."""
        return self.length * float(np.mean(1 / self.speeds(speed)))

    def speeds(self, top: float) -> Array:
        """Speed at the samples [m/s], shape (n,): `top`, or the path's own where that is lower."""
        return np.minimum(top, np.full_like(self.x, np.inf) if self.speed is None else self.speed)

    def with_speed(self, speed: Array) -> Path:
        """The same path with other speeds of its own [m/s], shape (n,)."""
        path = copy.copy(self)
        path.speed, path._speed = speed, speed.tolist()  # noqa: SLF001
        return path

    def with_laps(self, laps: int) -> Path:
        """The same path, driven `laps` times.

        Raises:
            ConfigError: several laps of a path that is not closed, or none.
        """
        if laps < 1 or (laps > 1 and not self.closed):
            raise ConfigError(f"laps: {laps} is not possible: " + ("at least 1" if laps < 1 else "the path is open"))
        path = copy.copy(self)
        path.laps = laps
        return path

    def rest(self, arc_length: float) -> Path:
        """What is left of the path from an arc length [m] on, at least its last piece: the very same curve.

        It begins at the sample before. A closed path stays closed, begins there, and ends where it always did: it is
        then less than its laps long.
        """
        samples = min(max(int(arc_length / self.spacing), 0), round(self.length / self.spacing) - 1)
        if samples == 0:
            return self
        laps, first = divmod(samples, self._last) if self.closed else (0, samples)
        turn = float(self.heading[-1] - self.heading[0])
        rest = Path(
            self._from(first, self.x),
            self._from(first, self.y),
            self._from(first, self.heading, turn),
            self._from(first, self.curvature),
            spacing=self.spacing,
            closed=self.closed,
            speed=None if self.speed is None else self._from(first, self.speed),
            drawn=self.drawn,
        )
        rest.laps = self.laps - laps
        rest._driven = self._driven + first * self.spacing if self.closed else 0.0
        return rest

    def _from(self, first: int, samples: Array, step: float = 0.0) -> Array:
        """The samples from the `first` on; around a closed path, `step` higher behind its seam."""
        if not self.closed:
            return samples[first:]
        return np.concatenate([samples[first:], samples[1 : first + 1] + step])

    def at(self, arc_length: float) -> PathPoint:
        """The point at an arc length [m]. A closed path goes on with its next lap, an open one straight."""
        index = round(arc_length / self.spacing)
        if not self.closed:
            index = min(max(index, 0), self._last)
        x, y, heading, curvature = self._samples.at(index, arc_length - index * self.spacing)
        return PathPoint(arc_length=arc_length, x=x, y=y, heading=heading, curvature=curvature)

    def speed_at(self, arc_length: float) -> float:
        """Recorded speed [m/s] at an arc length; infinite where none was recorded."""
        if not self._speed:
            return math.inf
        index = round(arc_length / self.spacing)
        return self._speed[index % self._last if self.closed else min(max(index, 0), self._last)]

    def begun_at(self, arc_length: float, done: float) -> Path:
        """What is left when the path is begun at an arc length [m], with `done` [m] of it behind.

        Of a closed path: all its laps from there, but for what is done. Of an open one: the rest, as by `rest`.
        """
        if not self.closed:
            return self.rest(arc_length)
        path = copy.copy(self.rest(arc_length))
        laps, driven = divmod(done, self.spacing * self._last)
        path.laps, path._driven = self.laps - int(laps), driven  # noqa: SLF001
        return path

    def nearest(self, x: float, y: float) -> float:
        """Arc length [m] of the point of the first lap that is nearest to (x, y)."""
        index = int(np.argmin(np.hypot(self.x - x, self.y - y)))
        return max(self.project(x, y, index * self.spacing).arc_length, 0.0)

    def project(self, x: float, y: float, near: float, window: float = WINDOW) -> Projection:
        """The nearest point of the path within `window` [m] of arc length around `near`.

        Costs the same for every length of path, and stays on its branch where the path crosses itself. Arc length
        counts on over laps; before the start and after the end of an open path it goes on along the tangent.
        """
        index, rest = self._samples.nearest(x, y, near, window)
        foot_x, foot_y, heading, curvature = self._samples.at(index, rest)
        return Projection(
            arc_length=index * self.spacing + rest,
            x=foot_x,
            y=foot_y,
            heading=heading,
            curvature=curvature,
            cross_track=(y - foot_y) * math.cos(heading) - (x - foot_x) * math.sin(heading),
        )


def path_from_csv(text: str, source: str, *, spacing: float = SPACING, smoothing: float | None = None) -> Path:
    """Read the curve of a path file without reversals: columns x, y [m], optionally heading [rad] and speed [m/s].

    Args:
        text: the whole file: comma, semicolon or blanks between cells, header optional, `#` starts a comment.
        source: its name, for messages.
        spacing: arc length between samples [m].
        smoothing: wavelength [m] of which the amplitude is halved; 0 goes exactly through the points, None: as of
            `path_from_points`.

    Raises:
        ConfigError: every problem found, with file:line:column (faults PTH-01, PTH-02, PTH-04).
    """
    points = read_points(text, source)
    for index, turn in cusps(points.x, points.y):
        points.report(index, f"the path reverses here ({math.degrees(turn):.0f} deg); split it")
    points.table.raise_problems()
    return path_from_points(points.x, points.y, speed=points.speed, spacing=spacing, smoothing=smoothing)


def path_from_points(
    x: Array,
    y: Array,
    *,
    speed: Array | None = None,
    spacing: float = SPACING,
    smoothing: float | None = None,
    closed: bool | None = None,
    between_halts: bool = False,
) -> Path:
    """Lay a smooth curve through points that are at least `MIN_STEP` apart, and sample it.

    Args:
        x: coordinates [m], shape (n,), n >= 2.
        y: likewise.
        speed: speed of the virtual front wheel at the points [m/s], or None.
        spacing: arc length between samples [m].
        smoothing: wavelength [m] of which the amplitude is halved; 0 goes exactly through the points. None:
            `SMOOTHING`, and of points that jitter as much as their noise needs.
        closed: whether it goes on from its end to its start; None: if they meet.
        between_halts: it is open, and keeps its curvature up to its ends, as between two reversals.
    """
    points = np.column_stack([x, y])
    closed = not between_halts and _is_closed(points) if closed is None else closed
    if closed and math.dist(points[0], points[-1]) >= MIN_STEP:
        points = np.vstack([points, points[:1]])
        speed = None if speed is None else np.append(speed, speed[0])
    elif closed:
        points[-1] = points[0]
    parameter = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    noise = noise_of(*points.T) if smoothing is None else Noise()
    wavelength = noise.wavelength(SMOOTHING) if smoothing is None else smoothing
    smooth = _smooth(parameter, points, wavelength, closed, between_halts)
    while wavelength > SMOOTHING and smoothing is None and _shifted(points, smooth) > SHAPE * noise.deviation:
        wavelength = max(SMOOTHING, 0.8 * wavelength)
        smooth = _smooth(parameter, points, wavelength, closed, between_halts)
    curve = spline(parameter, smooth, closed=closed)
    sampled, arc = parameter_from_arc(curve, parameter[-1], spacing)
    (px, py), (dx, dy), (ddx, ddy) = curve(sampled).T, curve(sampled, 1).T, curve(sampled, 2).T
    return Path(
        px,
        py,
        np.unwrap(np.arctan2(dy, dx)),
        (dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3,
        spacing=arc / (len(sampled) - 1),
        closed=closed,
        speed=None if speed is None else np.interp(sampled, parameter, speed),
        drawn=Drawn(points=points, moved=np.hypot(*(smooth - points).T), smoothing=wavelength, noise=noise),
    )


def _smooth(parameter: Array, points: Array, wavelength: float, closed: bool, between_halts: bool) -> Array:
    if wavelength == 0:
        return points
    if between_halts:
        return smoothed_between_halts(parameter, points, wavelength)
    return smoothed(parameter, points, wavelength, closed)


def _shifted(points: Array, smooth: Array) -> float:
    """Distance by which half of the points were moved [m]."""
    return float(np.median(np.hypot(*(smooth - points).T)))


def check_drivable(path: Path, robot: RobotFile, speed: float) -> list[str]:
    """Why a robot cannot follow a path at a speed of its virtual front wheel [m/s]; empty if it can (PTH-03)."""
    limits, problems = robot.limits, []
    bound = math.tan(math.radians(limits.steering_deg)) / robot.geometry.wheelbase_m
    worst = int(np.argmax(np.abs(path.curvature)))
    if abs(path.curvature[worst]) > bound:
        problems.append(
            f"too sharp at {place_on(path, worst)}: curvature {path.curvature[worst]:.2f} 1/m, "
            f"possible {bound:.2f} 1/m ({limits.steering_deg:g} deg of steering); widen the curve"
        )
    turn, own = steering_demand(path, robot)
    rate = turn * np.minimum(speed, own)
    worst, possible = int(np.argmax(rate)), limits.steering_rate_wheel_deg_s
    needed = math.degrees(rate[worst])
    if needed > possible:
        speed = min(speed, float(own[worst]))
        problems.append(
            f"too fast at {place_on(path, worst)}: a wheel would steer with {needed:.0f} deg/s, possible {possible:g} "
            f"deg/s; drive at most {speed * possible / needed:.2f} m/s"
        )
    return problems


def steering_demand(path: Path, robot: RobotFile) -> tuple[Array, Array]:
    """What a path asks of the steering, each of shape (n,).

    An open path begins and ends at standstill. There the wheels are turned first, and where smoothing leads the
    curvature to 0 nobody has to follow.

    Returns:
        How far a wheel is steered for each metre [rad/m], 0 next to the ends of an open path; and the highest speed of
        the virtual front wheel there [m/s], by the path's own speeds and from and to standstill.
    """
    turn = steering_per_distance(path.curvature, path.spacing, robot.geometry)
    own = path.speeds(np.inf)
    if not path.closed:
        ends = min(round(SMOOTHING / 2 / path.spacing), len(turn))
        turn[:ends] = turn[len(turn) - ends :] = 0.0
        distance, limits = path.arc_length, robot.limits
        own = np.minimum(own, np.sqrt(2 * limits.acceleration_m_s2 * distance))
        own = np.minimum(own, np.sqrt(2 * limits.deceleration_m_s2 * distance[::-1]))
    return turn, own


def place_on(path: Path, index: int) -> str:
    """A sample of a path, for people."""
    return f"{index * path.spacing:.2f} m (x {path.x[index]:.2f} m, y {path.y[index]:.2f} m)"


def _is_closed(points: Array) -> bool:
    """The end is within a spacing of the start, and the tangents agree."""
    steps = np.diff(points, axis=0)
    spacing = float(np.median(np.hypot(*steps.T)))
    seam = points[0] - points[-1]
    if len(points) < 4 or math.hypot(*seam) > 1.5 * spacing:
        return False
    directions = [steps[-1], seam, steps[0]] if math.hypot(*seam) >= MIN_STEP else [steps[-1], steps[0]]
    headings = np.array([math.atan2(step[1], step[0]) for step in directions])
    return bool(np.all(np.abs(wrapped(np.diff(headings))) <= math.radians(60)))
