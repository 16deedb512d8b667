"""`artemis path record`: a path file of what was driven in a run."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np

from artemis.commands.path_files import comments, keeps_up, refuse_smoothing, say, write_files
from artemis.commands.wholeness import tell_missing
from artemis.errors import ConfigError, shown
from artemis.mission.problems import nearest
from artemis.motion.arrays import Array
from artemis.motion.path_points import distinct
from artemis.motion.route import SHORTEST as SHORTEST_PART
from artemis.motion.route import Part, Route, noise_words
from artemis.motion.track import SHORTEST, SPACING, Track, loop_end
from artemis.motion.waypoints import Leg, PathRows, deviation, drawn, highest_speed, legs_of, rows_of
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.states.outline import numbered
from artemis.values import Mode, Pose, Request
from artemis.vehicle import RobotFile

LEAP = 0.2
"""A robot that is so far [m] from where it was last seen has been driven in between: there a new path begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawing:
    """How a path is made of points."""

    smoothing: float | None = None
    """Wavelength [m] of which the amplitude is halved; None: as of `artemis.motion.path.path_from_points`."""
    spacing: float = SPACING
    """Between the points of the file [m]."""
    close_within: float = 0.0
    """A path that ends so near its beginning [m] is closed."""
    with_speed: bool = False

    def problems(self) -> list[str]:
        """What makes no sense."""
        problems = refuse_smoothing(self.smoothing)
        if not 0.01 <= self.spacing <= 0.5:
            problems.append(f"--spacing {self.spacing:g}: expected 0.01 to 0.5 m")
        if not 0 <= self.close_within <= 5:
            problems.append(f"--close-within {self.close_within:g}: expected 0 to 5 m")
        return problems


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedPart:
    """What of a run is wanted: a path by its name, a time, or all that was driven by hand."""

    name: str | None = None
    begin: float | None = None
    """Run time [s]."""
    end: float | None = None
    on_map: Path | None = None
    """A map that was made of the run: poses by it, instead of the run's own."""

    def words(self) -> str:
        """For a file's header."""
        if self.name is not None:
            return f"recorded as {self.name}"
        return "driven by hand" if self.begin is None and self.end is None else "driven"


@dataclass(slots=True)
class DrivenTicks:
    """What was driven without a gap, tick by tick."""

    frame: str
    """Of the poses."""
    poses: list[Pose] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    """Of the virtual front wheel [m/s], forward positive."""
    times: list[float] = field(default_factory=list)
    """Run time [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What was driven without a gap, as a path file."""

    rows: PathRows
    driven: str
    """When it was driven, and in which direction."""
    off: float
    """Largest distance of what was driven from the path [m]."""
    frame: str
    smoothing: float
    """Longest wavelength [m] of which the amplitude was halved."""
    noise: list[str]
    """What smoothing did about noise, in words."""

    def words(self, robot: RobotFile) -> list[str]:
        """What to know of it."""
        route = self.rows.route
        slowest = min((part.path for part in route.parts), key=lambda path: highest_speed(path, robot)[0])
        return [
            f"{route.length:.2f} m{', closed' if route.closed else ''}, driven {self.driven}",
            f"at most {1000 * self.off:.1f} mm from what was driven",
            *self.noise,
            keeps_up(slowest, *highest_speed(slowest, robot)),
        ]


def record_path(
    run: Path, output: Path, choice: RecordedPart, drawing: Drawing, *, speed: float | None = None, force: bool = False
) -> int:
    """Make a path file of what was driven in a run; 1 if the robot cannot follow it.

    Args:
        run: Folder of a run, or its recording.
        output: The file; `-1`, `-2` ... are added to its name where there are gaps in what was driven.
        choice: What of the run.
        drawing: How the path is made.
        speed: Must be possible on the path [m/s]; None: only its shape matters.
        force: Overwrite files.

    Raises:
        ConfigError: a value makes no sense, nothing was driven, a file is there already or cannot be written.
        RecordingError: the recording cannot be read.
    """
    problems = drawing.problems()
    if speed is not None and not 0 < speed < math.inf:
        problems.append(f"--speed {speed:g}: expected more than 0 m/s")
    if problems:
        raise ConfigError(problems)
    recording = Recording(run)
    robot = recording.robot
    parts = list(_parts(recording, choice, drawing.spacing))
    names = [output] if len(parts) == 1 else [output.with_stem(f"{output.stem}-{n + 1}") for n in range(len(parts))]
    made = {file: _made(*part, drawing, str(file)) for file, part in zip(names, parts, strict=True)}
    write_files(
        {file: _header(recording, choice, drawing, part) + part.rows.text for file, part in made.items()}, force
    )
    failed = False
    for file, part in made.items():
        impossible = part.rows.route.problems(robot, min(speed or 0.0, robot.limits.speed_m_s))
        if speed is not None and speed > robot.limits.speed_m_s:
            impossible.append(f"{speed:g} m/s is more than the robot can: {robot.limits.speed_m_s:g} m/s")
        say(file, [*part.words(robot), *impossible])
        failed = failed or bool(impossible)
    tell_missing(recording)
    return int(failed)


def _parts(recording: Recording, choice: RecordedPart, spacing: float) -> Iterator[tuple[DrivenTicks, list[Leg]]]:
    """What was chosen of a run, piece by piece without a gap.

    Raises:
        ConfigError: it is nothing that makes a path.
    """
    found = False
    too_short = 0.0
    for driven in _stretches(recording, choice):
        legs = legs_of(driven.poses, spacing)
        for nudge, grouped in groupby(legs, key=lambda leg: leg.length < SHORTEST_PART):
            piece = list(grouped)
            length = sum(leg.length for leg in piece)
            if not nudge and length >= SHORTEST:
                found = True
                yield driven, piece
            else:
                too_short = max(too_short, length)
                place = f"{driven.times[piece[0].kept[0]]:.2f} s to {driven.times[piece[-1].kept[-1]]:.2f} s"
                least = SHORTEST_PART if nudge else SHORTEST
                sys.stdout.write(f"left out: {length:.2f} m, {place}; at least {least:g} m are needed\n")
    if not found:
        what = f"at most {too_short:.2f} m in one piece" if too_short else f"nothing was {choice.words()}"
        hint = "choose another time with --from and --to" if choice.name is None else "was it driven?"
        missing = f"; the recording is not whole: {recording.missing}" if recording.missing else ""
        raise ConfigError(f"{recording.path}: no path in it: {what}; {hint}{missing}")


def _stretches(recording: Recording, choice: RecordedPart) -> list[DrivenTicks]:
    chosen = _Chosen(recording, choice)
    by_map = None if choice.on_map is None else MapTrajectory(choice.on_map)
    stretches: list[DrivenTicks] = []
    for tick in recording.ticks():
        placed, located = tick.wish.reset_pose, tick.snapshot.pose
        wanted = chosen.takes(tick)
        if placed or chosen.begins_anew:
            stretches.clear()
        if not wanted or placed or (located.lost and by_map is None):
            continue
        pose, frame = located.pose, located.frame
        if by_map is not None:
            found, frame = by_map.at(tick.snapshot.time), "map"
            if found is None:
                continue
            pose = found
        last = stretches[-1].poses[-1] if stretches and stretches[-1].frame == frame else None
        if last is None or math.hypot(pose.x - last.x, pose.y - last.y) > LEAP:
            stretches.append(DrivenTicks(frame=frame))
        stretches[-1].poses.append(pose)
        stretches[-1].speeds.append(tick.snapshot.odometry.speed)
        stretches[-1].times.append(tick.snapshot.time)
    return stretches


class MapTrajectory:
    """Where the robot was on the map that was made of its run, by the map's graph."""

    def __init__(self, file: Path) -> None:
        """Read the graph beside a map's YAML file.

        Raises:
            ConfigError: there is none, or it is broken.
        """
        from artemis.mapping.graph_file import SUFFIX, read_graph  # imports scipy, which few paths need

        graph = file.with_suffix(SUFFIX)
        if not graph.exists():
            raise ConfigError(f"{graph}: no such file; the graph of a map knows where the robot was")
        self._times, *self._rows = read_graph(graph).trajectory.T
        self._rows[2] = np.unwrap(self._rows[2])

    def at(self, time: float) -> Pose | None:
        """At a run time [s]; None: the map does not know."""
        if not self._times[0] <= time <= self._times[-1]:
            return None
        x, y, heading = (float(np.interp(time, self._times, row)) for row in self._rows)
        return Pose(x=x, y=y, heading=math.remainder(heading, math.tau))


class _Chosen:
    """Says of one tick after the other whether it belongs to what is wanted."""

    def __init__(self, recording: Recording, choice: RecordedPart) -> None:
        self.begins_anew = False
        self._choice = choice
        self._track = Track()  # of its button alone
        self._inputs: dict[int, list[str]] = {}
        if choice.name is None:
            return
        names: list[str] = []
        for index, (_, word, body) in enumerate(numbered(recording.mission.get("steps"))):
            if word == "teleop" and (name := body.get("record")):
                names.append(name)
                if name == choice.name:
                    self._inputs[index] = body.get("inputs") or [body["input"]]
        if not self._inputs:
            hint = nearest(choice.name, names, "recorded") if names else "; no step of its mission has `record:`"
            raise ConfigError(f"{recording.path}: no path {shown(choice.name)} was recorded{hint}")

    def takes(self, tick: TickRecord) -> bool:
        """By name: what mode teleop recorded, see there."""
        choice, time = self._choice, tick.snapshot.time
        if choice.name is None:
            if choice.begin is None and choice.end is None:
                return tick.mode is Mode.TELEOP
            return (choice.begin is None or time >= choice.begin) and (choice.end is None or time <= choice.end)
        sources = self._inputs.get(tick.position.step)
        if tick.mode is not Mode.TELEOP or sources is None:
            return False
        samples = (sample for sample in tick.snapshot.sensed.inputs if sample.source in sources)
        pressed = any(Request.RECORD in sample.requests for sample in samples)
        counts = self._track.records(pressed=pressed)
        self.begins_anew = (pressed and counts) or tick.wish.done == 0.0
        return counts


def _points(poses: Sequence[Pose]) -> tuple[Array, Array]:
    return np.array([pose.x for pose in poses]), np.array([pose.y for pose in poses])


def _made(driven: DrivenTicks, legs: Sequence[Leg], drawing: Drawing, source: str) -> Made:
    """Legs, each of which begins where the one before ends, as a path file named `source`."""
    whole, closed, counts = len(legs) == 1, None, [len(leg.kept) for leg in legs]
    if whole:
        poses = [driven.poses[index] for index in legs[0].kept]
        if (count := loop_end(poses, drawing.close_within, legs[0].backward)) is not None:
            closed, counts = True, [count]
    parts, off = [], 0.0
    for leg, count in zip(legs, counts, strict=True):
        kept = leg.kept[:count]
        speeds = np.abs([driven.speeds[index] for index in kept]) if drawing.with_speed else None
        try:
            x, y, own = distinct(*_points([driven.poses[index] for index in kept]))
            curve = drawn(
                x,
                y,
                spacing=drawing.spacing,
                smoothing=drawing.smoothing,
                closed=closed,
                speed=None if speeds is None else speeds[own],
                between_halts=not whole,
            )
        except ConfigError as error:
            raise ConfigError([f"{source}: {problem}" for problem in error.problems]) from error
        parts.append(Part(path=curve, backward=leg.backward))
    curves = [part.path.drawn for part in parts if part.path.drawn is not None]
    rows = rows_of(Route(tuple(parts)), source, with_speed=drawing.with_speed)
    for leg, count, part in zip(legs, counts, rows.route.parts, strict=True):
        off = max(off, deviation(*_points(driven.poses[leg.kept[0] : leg.kept[count - 1] + 1]), part.path)[0])
    directions = ", ".join("backwards" if leg.backward else "forwards" for leg in legs)
    end = driven.times[legs[-1].kept[counts[-1] - 1]]
    return Made(
        rows=rows,
        driven=f"{directions}, {driven.times[legs[0].kept[0]]:.2f} s to {end:.2f} s of the run",
        off=off,
        frame=driven.frame,
        smoothing=max(curve.smoothing for curve in curves),
        noise=noise_words(Route(tuple(parts))),
    )


def _header(recording: Recording, choice: RecordedPart, drawing: Drawing, made: Made) -> str:
    path = recording.path.resolve()
    run = path.parent.name if path.name == "recording.mcap" else path.name
    length = f"{made.rows.route.length:.3f} m{', closed' if made.rows.route.closed else ''}"
    frame = "odometry" if made.frame == "odom" else made.frame
    lines = [
        f"Path of the centre of the rear axle in the frame of the {frame} of the run {run}",
        f"of {recording.start:%Y-%m-%d %H:%M:%S} UTC, {choice.words()}, {made.driven}.",
        f"Length {length}; a point every {drawing.spacing:g} m; smoothing {made.smoothing:.3g} m;",
        f"read again, the curve is at most {1000 * made.off:.1f} mm from what was driven.",
    ]
    lines += [f"Noise: {words}" for words in made.noise]
    backward = any(part.backward for part in made.rows.route.parts)
    lines += ["Where the headings point against the way it is driven backwards."] if backward else []
    lines += [f"The recording is not whole: {recording.missing}."] if recording.missing else []
    return comments(lines)
