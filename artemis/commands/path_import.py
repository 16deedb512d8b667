"""`artemis path import`: a path file of a file of others."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from artemis.commands.path_files import comments, refuse_smoothing, refuse_taken, say, write_files
from artemis.commands.path_formats import READERS, SUFFIXES, Given
from artemis.errors import ConfigError, shown
from artemis.motion.joining import Placement, against, bulge, join
from artemis.motion.path import MAX_GAP, SMOOTHING, moving
from artemis.motion.path import Path as Curve
from artemis.motion.table import MAX_CHARACTERS
from artemis.motion.waypoints import cusps, deviation, rows_of
from artemis.states.follow import START_ANGLE, START_DISTANCE
from artemis.yaml_file import read


def import_path(
    file: Path,
    output: Path,
    kind: str | None,
    *,
    smoothing: float = SMOOTHING,
    closed: bool = False,
    reverse: bool = False,
    origin: bool = False,
    with_speed: bool = False,
    force: bool = False,
) -> None:
    """Make a path file of a file of others.

    Args:
        file: What to read.
        output: The path file.
        kind: One of `READERS`; None: by the suffix.
        smoothing: Wavelength [m] of which the amplitude is halved.
        closed: It goes on from its end to its start.
        reverse: It is driven the other way round.
        origin: Moved so that it begins at 0, 0 along x.
        with_speed: Keep the speeds.
        force: Overwrite a file.

    Raises:
        ConfigError: everything wrong with the file, with file:line:column; nothing is written then.
    """
    if problems := refuse_smoothing(smoothing):
        raise ConfigError(problems)
    kind = kind or SUFFIXES.get(file.suffix.lower(), "")
    if kind not in READERS:
        problem = f"no format {shown(kind)}" if kind else "its suffix says nothing of its format"
        raise ConfigError(f"{file}: {problem}; choose with --format {'|'.join(READERS)}")
    refuse_taken([output], force)
    given = _checked(READERS[kind](read(file, MAX_CHARACTERS), str(file)), str(file), reverse)
    if reverse:
        given = _turned(given)
    if with_speed and given.speed is None:
        raise ConfigError(f"{file}: no speeds in it; leave --with-speed out")
    try:
        curve = join(given.x, given.y, closed=closed, smoothing=smoothing, speed=given.speed)
        if origin:
            place = Placement(float(curve.x[0]), float(curve.y[0]), float(curve.heading[0]))
            given.x, given.y = place.of_points(given.x, given.y)
            curve = join(given.x, given.y, closed=closed, smoothing=smoothing, speed=given.speed)
    except ConfigError as error:
        raise ConfigError([f"{file}: {problem}" for problem in error.problems]) from error
    rows = rows_of(curve, str(output), with_speed=with_speed)
    words = [*_words(given, rows.path, file.name), *given.notes]
    made = f"Made of {file.name} ({kind}){', turned round' if reverse else ''}{', moved' if origin else ''}"
    write_files({output: comments([made, *words]) + rows.text}, force)
    say(output, words)


def _words(given: Given, path: Curve, name: str) -> list[str]:
    """What to know of a path made of points."""
    off, worst = deviation(given.x, given.y, path)
    words = [
        f"{path.length:.2f} m{', closed' if path.closed else ''}, from {len(given.x)} points of {name}",
        f"the points are at most {1000 * off:.1f} mm off the curve ({given.places[worst]})",
    ]
    if np.hypot(np.diff(given.x), np.diff(given.y)).max() > MAX_GAP:
        most, corner = bulge(given.x, given.y, path)
        words.append(f"the curve leaves the straight lines between them by up to {most:.2f} m ({given.places[corner]})")
    begin = path.at(0.0)
    if math.hypot(begin.x, begin.y) > START_DISTANCE or abs(begin.heading) > START_ANGLE:
        words.append(
            f"begins at x {begin.x:.2f} m, y {begin.y:.2f} m, {math.degrees(begin.heading):.0f} deg, but a run at 0, 0 "
            "along x: --origin moves it there"
        )
    return words


def _checked(given: Given, source: str, reverse: bool) -> Given:
    """The distinct points; headings only if they say something.

    Raises:
        ConfigError: too few points, a way that reverses or is driven backwards, speeds that are none.
    """
    kept = moving(given.x, given.y)
    x, y = given.x[kept], given.y[kept]
    if len(kept) < 2:
        raise ConfigError(f"{source}:1:1: {len(kept)} distinct points; expected at least 2")
    places = [given.places[index] for index in kept]
    notes = list(given.notes)
    problems = [
        f"{places[index]}: the way reverses here ({math.degrees(turn):.0f} deg); split it"
        for index, turn in cusps(x, y)
    ]
    if given.heading is not None and not np.any(given.heading):
        notes.append("every heading is 0: taken as not given")
    elif given.heading is not None:
        wrong = against(x, y, given.heading[kept])
        if len(wrong) == len(kept) and not reverse:
            problems.append(f"{places[0]}: every heading points against the way; drive it the other way with --reverse")
        elif 0 < len(wrong) < len(kept):
            hint = "drive forwards all the way; a heading in degrees is called heading_deg"
            problems += [f"{places[index]}: the heading points against the way; {hint}" for index in wrong[:3]]
    speed = given.speed if given.speed is None else given.speed[kept]
    if speed is not None:
        problems += [
            f"{places[index]}: speed: expected more than 0 m/s, found {speed[index]:g}"
            for index in np.flatnonzero(speed <= 0)[:3]
        ]
    if problems:
        raise ConfigError(problems)
    return Given(x=x, y=y, speed=speed, places=places, notes=notes)


def _turned(given: Given) -> Given:
    """The same points from the last to the first."""
    speed = None if given.speed is None else given.speed[::-1]
    return Given(x=given.x[::-1], y=given.y[::-1], speed=speed, places=given.places[::-1], notes=given.notes)
