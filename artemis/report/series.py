"""Tables from a recording: everything that the figures and the summary of a run show."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from math import nan

import numpy as np

from artemis.motion.path import Path
from artemis.motion.spline import Array
from artemis.recording.journal import Entry
from artemis.recording.mcap_reader import Recording
from artemis.report.bus_load import measure_bus_load
from artemis.report.cross_track import follow_true_pose, routes_of
from artemis.values import DriveFeedback, Mode, Pose, SetPoints, Tracking
from artemis.vehicle import Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """From `begin` to `end` [s] something had one value."""

    value: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """One drive over time: speed [m/s] of a traction wheel or angle [rad] of a steered one; shape (n,)."""

    role: str
    side: str
    set_point: Array
    measured: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """A run over time. Arrays have one row a tick, NaN where there is no value."""

    time: Array
    """Run time [s], shape (n,)."""
    estimated: Array
    """Pose by odometry: x, y [m], heading [rad]; shape (n, 3), frame `odom`."""
    true: Array
    """True pose, likewise."""
    distance: float
    """Way of the rear axle centre, forward and back [m]."""
    speed: Array
    """Of the virtual front wheel [m/s], measured."""
    wheels: dict[str, Wheel]
    """By the name of the drive."""
    arc_length: Array
    """Place on the path by the estimated pose [m]."""
    cross_track: Array
    """Distance from the path by the estimated pose [m], left positive."""
    true_arc_length: Array
    true_cross_track: Array
    """The same by the true pose."""
    planned_speed: Array
    """That the path allowed, by the follower's plan [m/s]; nan where nothing was followed, or without a plan."""
    feedforward: Array
    """Steering for the path's curvature alone [rad]; nan likewise."""
    set_points: Array
    """Speed [m/s] and angle [rad] of the virtual front wheel that left the gate, shape (n, 2)."""
    late: Array
    """How late each tick began [s]."""
    modes: tuple[Interval, ...]
    steps: tuple[Interval, ...]
    """Of the modes those that do what the mission wants."""
    drive_states: dict[str, tuple[Interval, ...]]
    """By the name of the drive."""
    paths: tuple[Path, ...]
    """Every path that was followed."""
    entries: tuple[Entry, ...]
    frames: int
    bus_time: Array
    """Middles of the bins of `bus_load` [s], shape (m,)."""
    bus_load: Array
    """Share of the time that the bus was busy, each frame counted with its most stuff bits."""
    finished: bool
    """The ordered end was reached."""
    placed: int
    """First tick after the present place was last made the origin of the odometry."""


def read_series(recording: Recording) -> Series:
    """Read a recording once and lay its values out over time."""
    table = _read_table(recording)
    time, true, tracking = table.columns(0, 1)[:, 0], table.columns(5, 8), table.columns(8, 11)
    following = np.array([mode is Mode.FOLLOW for mode in table.modes], dtype=bool) & np.isfinite(tracking[:, 0])
    paths, projected = follow_true_pose(routes_of(recording), following, table.steps, tracking, true)
    modes = _intervals(time, [mode.value for mode in table.modes])
    doing = {Mode.CALIBRATE.value, Mode.TELEOP.value, Mode.FOLLOW.value}
    frames, bus_time, bus_load = measure_bus_load(recording, time, table.indices)
    return Series(
        time=time,
        estimated=table.columns(2, 5),
        true=true,
        distance=_distance(table.columns(11, 12)[:, 0], table.resets),
        speed=table.columns(12, 13)[:, 0],
        wheels=_wheels(table, recording.robot),
        arc_length=np.where(following, tracking[:, 0], np.nan),
        cross_track=np.where(following, tracking[:, 1], np.nan),
        true_arc_length=projected[:, 0],
        true_cross_track=projected[:, 1],
        planned_speed=np.where(following, table.columns(13, 14)[:, 0], np.nan),
        feedforward=np.where(following, table.columns(14, 15)[:, 0], np.nan),
        set_points=table.columns(15, 17),
        late=table.columns(1, 2)[:, 0],
        modes=modes,
        steps=tuple(interval for interval in modes if interval.value in doing),
        drive_states={name: _intervals(time, states) for name, states in table.states.items()},
        paths=tuple(paths),
        entries=recording.events(),
        frames=frames,
        bus_time=bus_time,
        bus_load=bus_load,
        finished=table.finished,
        placed=table.resets[-1] + 1 if table.resets else 0,
    )


# --------------------------------------------------------------------------------------------------- one pass over it


@dataclass(slots=True)
class _Table:
    """Numbers of every tick in one flat array (a long run has millions), and what is no number."""

    width: int
    numbers: array[float]
    indices: list[int]
    modes: list[Mode]
    steps: list[int]
    """Of the mission, done at each tick."""
    states: dict[str, list[str]]
    resets: list[int]
    finished: bool = False

    def columns(self, first: int, end: int) -> Array:
        """Some columns, shape (ticks, end - first)."""
        return np.asarray(self.numbers, dtype=np.float64).reshape(-1, self.width)[:, first:end]


_FIXED = 17
"""Columns before those of the drives: time, late, estimated pose (3), true pose (3), tracking (3), distance, speed,
planned speed, feed-forward, commanded speed and steering."""
_NO_POSE = Pose(x=nan, y=nan, heading=nan)
_NO_TRACKING = Tracking(arc_length=nan, cross_track=nan, length=nan)


def _read_table(recording: Recording) -> _Table:
    drives = recording.robot.drives
    table = _Table(_FIXED + 2 * len(drives), array("d"), [], [], [], {name: [] for name in drives}, [])
    for tick in recording.ticks():
        sensed, odometry, points = tick.snapshot.sensed, tick.snapshot.odometry, tick.set_points
        estimated, true = odometry.pose, tick.true_pose or _NO_POSE
        tracking = tick.wish.tracking or _NO_TRACKING
        table.numbers.extend((sensed.time, sensed.late, estimated.x, estimated.y, estimated.heading))
        table.numbers.extend((true.x, true.y, true.heading))
        table.numbers.extend((tracking.arc_length, tracking.cross_track, tracking.length))
        table.numbers.extend((odometry.distance, odometry.speed))
        table.numbers.extend((_or_nan(tracking.planned_speed), _or_nan(tracking.feedforward)))
        table.numbers.extend((points.speed, points.steering))
        heard = {drive.name: drive for drive in sensed.drives}
        for name, drive in drives.items():
            feedback = heard.get(name) or DriveFeedback(name=name)
            measured = feedback.velocity if drive.role == "traction" else feedback.position
            set_point = _set_point(points, drive.role, drive.side)
            table.numbers.extend((set_point, nan if feedback.age is None else measured))
            table.states[name].append(feedback.state.value)
        if tick.wish.reset_pose:
            table.resets.append(len(table.modes))
        table.indices.append(sensed.index)
        table.modes.append(tick.mode)
        table.steps.append(tick.position.step)
        table.finished = tick.wish.finished
    return table


def _or_nan(value: float | None) -> float:
    return nan if value is None else value


def _set_point(set_points: SetPoints, role: str, side: str) -> float:
    if role == "traction":
        return set_points.speed_left if side == "left" else set_points.speed_right
    return set_points.steering_left if side == "left" else set_points.steering_right


def _wheels(table: _Table, robot: Robot) -> dict[str, Wheel]:
    wheels = {}
    for number, (name, drive) in enumerate(robot.drives.items()):
        set_point, measured = table.columns(_FIXED + 2 * number, _FIXED + 2 * number + 2).T
        wheels[name] = Wheel(role=drive.role, side=drive.side, set_point=set_point, measured=measured)
    return wheels


def _distance(way: Array, resets: list[int]) -> float:
    """Sum of the steps of `way`, but for those behind a reset of the pose."""
    steps = np.abs(np.diff(way))
    steps[[index for index in resets if index < len(steps)]] = 0.0
    return float(np.sum(steps))


def _intervals(time: Array, values: list[str]) -> tuple[Interval, ...]:
    """Unbroken stretches of one value; each ends where the next begins, the last with the last tick."""
    if not values:
        return ()
    changes = [index for index in range(len(values)) if index == 0 or values[index] != values[index - 1]]
    ends = [*changes[1:], len(values) - 1]
    return tuple(
        Interval(value=values[begin], begin=float(time[begin]), end=float(time[end]))
        for begin, end in zip(changes, ends, strict=True)
    )
