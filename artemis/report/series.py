"""Tables from a recording: everything that the figures and the summary of a run show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import hypot, inf, isfinite, nan, sqrt
from operator import attrgetter

import numpy as np

from artemis.mapping.occupancy import OccupancyMap
from artemis.motion.arrays import Array
from artemis.motion.path import Path
from artemis.motion.poses import placed, seen_from
from artemis.recording.journal import Entry
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.report.around import DrivenAround
from artemis.report.bus_load import BusLoad
from artemis.report.cross_track import GivenErrors, TruePlaces, TruePoses, routes_of
from artemis.report.known_map import known_map
from artemis.report.mission_times import MissionTimes
from artemis.report.rows import Errors, Rows
from artemis.values import DriveFeedback, Mode, Pose, SetPoints, Tracking
from artemis.vehicle import RobotFile

_DOING = (Mode.CALIBRATE.value, Mode.TELEOP.value, Mode.FOLLOW.value, Mode.ACT.value)


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
    set_point: Array
    measured: Array
    temperature: Array
    """Of its power stage [°C]; nan: not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """A run over time. Arrays have one row a tick, of a long run the rows that matter (`rows`); NaN: no value."""

    time: Array
    """Run time [s], shape (n,)."""
    moment: Array
    """When the drives measured what the poses are computed from, at the SYNC before [s of the run]."""
    estimated: Array
    """Where the robot believed to be: x, y [m], heading [rad]; shape (n, 3)."""
    source: str
    """Of these poses at the end: `odometry`, or a localizer's name."""
    std: Array
    """Standard deviation of the estimated position, along its worst direction [m]; nan where it is unknown."""
    std_heading: Array
    """That of the heading [rad]."""
    quality: Array
    """Of the last fix, as the localizer told it, 0 to 1; nan before the first."""
    map: OccupancyMap | None
    """On which the robot was localised."""
    odometry: Array
    """Pose by odometry alone; with a localizer laid onto its first pose."""
    true: Array
    """True pose, likewise, at the moment that the estimated one is of."""
    distance: float
    """Distance of the rear axle centre, forward and back [m]."""
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
    feedback: Array
    """What the follower adds to that [rad]; nan likewise."""
    late: Array
    """How late each tick began [s]."""
    slowed: Array
    """Speed that an obstacle left, where that was less than was wished [m/s]; nan elsewhere."""
    around: DrivenAround
    """What was seen there, and routes that were planned."""
    volts: Array
    """Supply voltage under load [V]; nan where none was measured, or the robot file describes no battery."""
    charge: Array
    """Of the battery, 0 to 1; nan likewise."""
    charge_std: Array
    watts: Array
    """Taken of it [W]."""
    joules: float | None
    """Taken of it in the run [J]; None likewise."""
    waited: float
    """How long the robot stood for obstacles [s]."""
    ticks: int
    """All of them."""
    error: Errors
    """Cross-track error by the estimated pose [m], over all ticks."""
    true_error: Errors
    """The same by the true pose."""
    given_error: Errors
    """Distance from the path as it was given, before smoothing and rounding [m], by the estimated pose, over all ticks;
    none where that path was followed as it was given."""
    true_given_error: Errors
    """The same by the true pose."""
    error_end: float | None
    """Distance of the last estimated from the last true position [m]."""
    odometry_error_max: float | None
    """Greatest distance of the position by `odometry` alone from the true one [m]; None also without a localizer."""
    modes: tuple[Interval, ...]
    steps: tuple[Interval, ...]
    """Of the modes those that do what the mission wants."""
    mission: MissionTimes
    """Where the mission was."""
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


def read_series(recording: Recording, *, every_tick: bool = False) -> Series:
    """Read a recording once and lay its values out over time.

    `every_tick`: with a row for each of them, however many there are: 0.2 kB for each.
    """
    reader = _Reader(recording, every_tick)
    for each in recording.ticks_and_frames():
        if isinstance(each, TickRecord):
            reader.see(each)
        else:
            reader.bus.add(each.data, of_tick=each.tick == reader.index)
    return reader.series()


_COLUMNS = (
    *("time", "moment"),
    *("x", "y", "heading"),
    *("odometry_x", "odometry_y", "odometry_heading"),
    *("true_x", "true_y", "true_heading"),
    *("arc_length", "cross_track", "true_arc_length", "true_cross_track"),
    *("std", "std_heading", "quality"),
    *("speed", "planned_speed", "feedforward", "feedback", "late", "slowed"),
)
"""Those before the set-points and measured values of the drives."""
_AT = {name: number for number, name in enumerate(_COLUMNS)}
_OF_BATTERY = ("volts", "charge", "charge_std", "watts")
"""The last ones of a robot whose file describes its battery."""
_NO_POSE = Pose(x=nan, y=nan, heading=nan)
_MEASURED = {"traction": attrgetter("velocity"), "steering": attrgetter("position")}
_NOT_FOLLOWING = nan, nan, nan, nan, nan


class _Reader:
    """Sees every tick of a recording once."""

    def __init__(self, recording: Recording, every_tick: bool) -> None:
        self._recording, robot = recording, recording.robot
        self._true_poses = TruePoses(recording)
        self._states = {name: _Spans() for name in robot.drives}
        self._drives = [
            (name, attrgetter(drive.set_point), self._states[name], _MEASURED[drive.role])
            for name, drive in robot.drives.items()
        ]
        self._entries = recording.events()
        faults = [entry.time for entry in self._entries if entry.kind == "fault"]
        ticks = None if every_tick else recording.number
        self._warm = _measuring_temperature(robot)
        width = len(_COLUMNS) + 2 * len(self._drives) + len(self._warm) + (len(_OF_BATTERY) if robot.battery else 0)
        self._error, self._true_error = Errors(), Errors()
        errors = {_AT["cross_track"]: self._error, _AT["true_cross_track"]: self._true_error}
        self._rows = Rows(width, _AT["x"], _AT["y"], ticks, faults, errors)
        self._true_places = TruePlaces(routes_of(recording))
        self._around = DrivenAround(robot)
        self._modes = _Spans()
        self._mission = MissionTimes(recording.mission)
        self.bus = BusLoad(recording.number, recording.duration)
        self.index = -1
        """Of the last tick."""
        self._ticks, self._time = 0, 0.0
        """How many there were, and the run time [s] of the last."""
        self._given, self._true_given = GivenErrors(), GivenErrors()
        self._error_end: float | None = None
        self._odometry_error_max: float | None = None
        self._distance = self._waited = 0.0
        self._joules: float | None = None
        self._driven: float | None = None
        """By the odometry, before this tick [m]; None: unknown, or counted anew."""
        self._placed_after = -inf
        self._finished, self._source, self._quality = False, "", nan
        self._located: tuple[Pose, Pose] | None = None
        """The first pose in a map, and that of the odometry then."""

    def see(self, tick: TickRecord) -> None:
        """The next tick."""
        snapshot, points = tick.snapshot, tick.set_points
        sensed, odometry, time = snapshot.sensed, snapshot.odometry, snapshot.sensed.time
        located, estimated = snapshot.pose, snapshot.pose.pose
        moment, true = self._true_poses.of(tick)
        by_wheels = odometry.pose if located.frame == "odom" else self._laid(odometry.pose, estimated, true)
        tracking = tick.wish.tracking if tick.mode is Mode.FOLLOW else None
        if tracking is not None and not isfinite(tracking.arc_length):
            tracking = None
        true_arc_length, true_cross_track = self._true_places.find(tick.position.step, tracking, true)
        followed = _NOT_FOLLOWING if tracking is None else _followed(tracking, points)
        arc_length, cross_track, planned_speed, feedforward, feedback = followed
        self._given.add(estimated, self._true_places.given)
        self._true_given.add(true, self._true_places.given)
        if true is not None:
            self._error_end = hypot(estimated.x - true.x, estimated.y - true.y)
        for fix in sensed.fixes:
            self._quality = fix.quality
        clearance = points.clearance
        slowed = clearance is not None and clearance.speed < abs(tick.wish.command.speed) and clearance.distance < inf
        self._around.see(tick, slowed=slowed)
        self._waited += snapshot.dt if clearance is not None and clearance.holds else 0.0
        at = true or _NO_POSE
        row = [
            *(time, moment, estimated.x, estimated.y, estimated.heading),
            *(by_wheels.x, by_wheels.y, by_wheels.heading, at.x, at.y, at.heading),
            *(arc_length, cross_track, true_arc_length, true_cross_track),
            *_stds(located.covariance),
            *(self._quality, odometry.speed, planned_speed, feedforward, feedback, sensed.late),
            clearance.speed if clearance is not None and slowed else nan,
        ]
        heard = {drive.name: drive for drive in sensed.drives}
        for name, set_point, states, measured in self._drives:
            drive = heard.get(name) or DriveFeedback(name=name)
            row += (set_point(points), nan if drive.age is None else measured(drive))
            if drive.state is not states.value:
                states.begin(time, drive.state)
        row += _temperatures(self._warm, heard)
        if (battery := snapshot.battery) is not None:
            self._joules = battery.joules
        if self._recording.robot.battery:
            row += [nan if battery is None else getattr(battery, name) for name in _OF_BATTERY]
        self._rows.add(row)
        if self._driven is not None:
            self._distance += abs(odometry.distance - self._driven)
        self._driven = odometry.distance
        if tick.wish.reset_pose:
            self._driven, self._placed_after, self._located = None, time, None
        if tick.mode is not self._modes.value:
            self._modes.begin(time, tick.mode)
        self._mission.see(tick)
        self.bus.tick(time)
        self.index, self._finished, self._source = sensed.index, tick.wish.finished, located.source
        self._ticks, self._time = self._ticks + 1, time

    def _laid(self, by_wheels: Pose, estimated: Pose, true: Pose | None) -> Pose:
        """The pose by odometry alone in the frame of the localizer, laid onto its first pose."""
        self._located = self._located or (estimated, by_wheels)
        laid = placed(self._located[0], seen_from(self._located[1], by_wheels))
        if true is not None:
            self._odometry_error_max = max(self._odometry_error_max or 0.0, hypot(laid.x - true.x, laid.y - true.y))
        return laid

    def series(self) -> Series:
        """All that was seen."""
        table = self._rows.table()
        columns = {name: table[:, number] for name, number in _AT.items()}
        unknown = np.full(len(table), nan)
        for number, name in enumerate(reversed(_OF_BATTERY), 1):
            columns[name] = table[:, -number] if self._recording.robot.battery else unknown
        modes = self._modes.intervals(self._time)
        bus_time, bus_load = self.bus.shares(self._recording.robot.bitrate)
        return Series(
            time=columns["time"],
            moment=columns["moment"],
            estimated=table[:, _AT["x"] : _AT["heading"] + 1],
            source=self._source,
            std=columns["std"],
            std_heading=columns["std_heading"],
            quality=columns["quality"],
            map=known_map(self._recording),
            odometry=table[:, _AT["odometry_x"] : _AT["odometry_heading"] + 1],
            true=table[:, _AT["true_x"] : _AT["true_heading"] + 1],
            distance=self._distance,
            speed=columns["speed"],
            wheels=_wheels(table, self._recording.robot),
            arc_length=columns["arc_length"],
            cross_track=columns["cross_track"],
            true_arc_length=columns["true_arc_length"],
            true_cross_track=columns["true_cross_track"],
            planned_speed=columns["planned_speed"],
            feedforward=columns["feedforward"],
            feedback=columns["feedback"],
            late=columns["late"],
            slowed=columns["slowed"],
            volts=columns["volts"],
            charge=columns["charge"],
            charge_std=columns["charge_std"],
            watts=columns["watts"],
            joules=self._joules,
            around=self._around,
            waited=self._waited,
            ticks=self._ticks,
            error=self._error,
            true_error=self._true_error,
            given_error=self._given.finish(),
            true_given_error=self._true_given.finish(),
            error_end=self._error_end,
            odometry_error_max=self._odometry_error_max,
            modes=modes,
            steps=tuple(interval for interval in modes if interval.value in _DOING),
            mission=self._mission,
            drive_states={name: spans.intervals(self._time) for name, spans in self._states.items()},
            paths=tuple(self._true_places.paths),
            entries=self._entries,
            frames=self.bus.frames,
            bus_time=bus_time,
            bus_load=bus_load,
            finished=self._finished,
            placed=int(np.searchsorted(columns["time"], self._placed_after, side="right")),
        )


def _stds(covariance: tuple[float, ...]) -> tuple[float, float]:
    """Of a position along its worst direction [m], and of a heading [rad]."""
    if len(covariance) != 6:
        return nan, nan
    xx, xy, _, yy, _, hh = covariance
    return sqrt((xx + yy) / 2 + hypot((xx - yy) / 2, xy)), sqrt(hh)


def _followed(tracking: Tracking, set_points: SetPoints) -> tuple[float, ...]:
    """Arc length, cross-track, planned speed, feed-forward, and what feedback adds to it."""
    planned = nan if tracking.planned_speed is None else tracking.planned_speed
    feedforward = nan if tracking.feedforward is None else tracking.feedforward
    front = -1.0 if set_points.speed < 0 else 1.0  # a follower is shown the other end as the front
    feedback = front * set_points.steering - feedforward
    return tracking.arc_length, tracking.cross_track, planned, feedforward, feedback


def _wheels(table: Array, robot: RobotFile) -> dict[str, Wheel]:
    wheels, warm = {}, _measuring_temperature(robot)
    unknown = np.full(len(table), nan)
    for number, (name, drive) in enumerate(robot.drives.items()):
        set_point, measured = table[:, len(_COLUMNS) + 2 * number :].T[:2]
        at = len(_COLUMNS) + 2 * len(robot.drives)
        temperature = table[:, at + warm.index(name)] if name in warm else unknown
        wheels[name] = Wheel(role=drive.role, set_point=set_point, measured=measured, temperature=temperature)
    return wheels


def _temperatures(names: Sequence[str], heard: Mapping[str, DriveFeedback]) -> list[float]:
    told = [heard[name].temperature_c if name in heard else None for name in names]
    return [nan if temperature is None else temperature for temperature in told]


def _measuring_temperature(robot: RobotFile) -> list[str]:
    """Drives that measure their own."""
    return [name for name, drive in robot.drives.items() if drive.tables.temperature is not None]


class _Spans:
    """Unbroken stretches of one value; each ends where the next begins."""

    def __init__(self) -> None:
        self.value: Enum | None = None
        self._begun: list[tuple[float, Enum]] = []

    def begin(self, time: float, value: Enum) -> None:
        """Another value from this tick on."""
        self.value = value
        self._begun.append((time, value))

    def intervals(self, end: float) -> tuple[Interval, ...]:
        """The last one ends with the last tick [s]."""
        ends = [*(time for time, _ in self._begun[1:]), end]
        return tuple(
            Interval(value=value.value, begin=begin, end=end)
            for (begin, value), end in zip(self._begun, ends, strict=False)
        )
