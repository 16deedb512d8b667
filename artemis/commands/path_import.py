"""`artemis path import`: a path file of a file of others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from artemis.commands.path_files import comments, refuse_smoothing, refuse_taken, say, write_files
from artemis.commands.path_formats import READERS, SUFFIXES, Given
from artemis.errors import ConfigError, shown
from artemis.motion.columns import DEGREES, is_in_degrees
from artemis.motion.joining import bulge, join
from artemis.motion.path_points import MAX_GAP, distinct
from artemis.motion.points import points_from
from artemis.motion.route import Part, Route, Stretch, across, noise_words, stretches, turns_on_the_spot
from artemis.motion.table import MAX_CHARACTERS
from artemis.motion.track import SPACING
from artemis.motion.waypoints import deviation, drawn, rows_of
from artemis.states.follow import START_ANGLE, START_DISTANCE
from artemis.values import Pose
from artemis.yaml_file import read

SHOWN_BULGE = 0.005
"""A curve that leaves the straight lines between its points by less [m] is not reported."""


def import_path(
    file: Path,
    output: Path,
    kind: str | None,
    *,
    smoothing: float | None = None,
    closed: bool = False,
    reverse: bool = False,
    origin: bool = False,
    with_speed: bool = False,
    force: bool = False,
) -> None:
    """Convert a file of another program to a path file.

    Args:
        file: What to read.
        output: The path file.
        kind: One of `READERS`; None: by the suffix.
        smoothing: Wavelength [m] of which the amplitude is halved; None: as of `path_from_points`.
        closed: It goes on from its end to its start.
        reverse: From its last point to its first, with the robot's headings as they are.
        origin: Moved so that it begins at 0, 0, the robot facing along x.
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
    given = _checked(READERS[kind](read(file, MAX_CHARACTERS), str(file)), str(file))
    given = _turned(given) if reverse else given
    if with_speed and given.speed is None:
        raise ConfigError(f"{file}: no speeds in it; leave --with-speed out")
    found = stretches(given.x, given.y, given.heading)
    if closed and len(found) > 1:
        raise ConfigError(f"{given.places[found[1][0]]}: the path reverses here, so it cannot be --closed")
    try:
        route = _joined(given, found, closed, smoothing)
        if origin:
            begin = route.parts[0].path
            place = Pose(x=float(begin.x[0]), y=float(begin.y[0]), heading=route.parts[0].heading_at(0.0))
            given.x, given.y = points_from(place, np.array([given.x, given.y]))
            route = _joined(given, found, closed, smoothing)
    except ConfigError as error:
        raise ConfigError([f"{file}: {problem}" for problem in error.problems]) from error
    if problems := [f"{given.places[found[part][0]]}: {words}" for part, words in turns_on_the_spot(route.parts)]:
        raise ConfigError(problems)
    rows = rows_of(route, str(output), with_speed=with_speed)
    words = [*_words(given, found, rows.route, file.name), *noise_words(route), *given.notes]
    made = f"Made of {file.name} ({kind}){', turned round' if reverse else ''}{', moved' if origin else ''}"
    write_files({output: comments([made, *words]) + rows.text}, force)
    say(output, words)


def _joined(given: Given, found: Sequence[Stretch], closed: bool, smoothing: float | None) -> Route:
    """Smooth curves through the points, one for each direction."""
    parts = []
    for first, last, backward in found:
        piece = slice(first, last + 1)
        x, y, speed = given.x[piece], given.y[piece], None if given.speed is None else given.speed[piece]
        if len(found) == 1:
            curve = join(x, y, closed=closed, smoothing=smoothing, speed=speed)
        else:
            curve = drawn(x, y, spacing=SPACING, smoothing=smoothing, speed=speed, between_halts=True)
        parts.append(Part(path=curve, backward=backward))
    return Route(tuple(parts))


def _words(given: Given, found: Sequence[Stretch], route: Route, name: str) -> list[str]:
    """What to know of a path made of points."""
    pieces = [(first, given.x[first : last + 1], given.y[first : last + 1]) for first, last, _ in found]
    paths = [part.path for part in route.parts]
    off = max((*deviation(x, y, path), first) for (first, x, y), path in zip(pieces, paths, strict=True))
    directions = ["backwards" if part.backward else "forwards" for part in route.parts]
    driven = f", driven {', '.join(directions)}" if "backwards" in directions else ""
    words = [
        f"{route.length:.2f} m{', closed' if route.closed else ''}{driven}, from {len(given.x)} points of {name}",
        f"the points are at most {1000 * off[0]:.1f} mm off the curve ({given.places[off[1] + off[2]]})",
    ]
    if np.hypot(np.diff(given.x), np.diff(given.y)).max() > MAX_GAP:
        bulges = [(*bulge(x, y, path), first) for (first, x, y), path in zip(pieces, paths, strict=True)]
        most, corner, first = max(bulges)
        if most >= SHOWN_BULGE:
            place = given.places[corner + first]
            words.append(f"the curve leaves the straight lines between them by up to {most:.2f} m ({place})")
    begin, heading = paths[0].at(0.0), route.parts[0].heading_at(0.0)
    if math.hypot(begin.x, begin.y) > START_DISTANCE or abs(heading) > START_ANGLE:
        words.append(
            f"begins at x {begin.x:.2f} m, y {begin.y:.2f} m, {math.degrees(heading):.0f} deg, but a run at 0, 0 "
            "along x: --origin moves it there"
        )
    return words


def _checked(given: Given, source: str) -> Given:
    """The distinct points; headings only if they say something.

    Raises:
        ConfigError: too few points, headings across the path, speeds that are none.
    """
    x, y, kept = distinct(given.x, given.y)
    if len(kept) < 2:
        raise ConfigError(f"{source}:1:1: {len(kept)} distinct points; expected at least 2")
    places = [given.places[index] for index in kept]
    notes = list(given.notes)
    heading = None if given.heading is None else given.heading[kept]
    problems = []
    if heading is not None and not np.any(heading):
        notes.append("every heading is 0: taken as not given")
        heading = None
    elif heading is not None and is_in_degrees(x, y, heading):
        problems.append(f"{places[0]}: heading {heading[0]:g}: {DEGREES}")
    elif heading is not None:
        problems += [
            f"{places[index]}: the heading points across the path; one in degrees is called heading_deg"
            for index in across(x, y, heading, stretches(x, y, heading))[:3]
        ]
    speed = given.speed if given.speed is None else given.speed[kept]
    if speed is not None:
        problems += [
            f"{places[index]}: speed: expected more than 0 m/s, found {speed[index]:g}"
            for index in np.flatnonzero(speed <= 0)[:3]
        ]
    if problems:
        raise ConfigError(problems)
    return Given(x=x, y=y, heading=heading, speed=speed, places=places, notes=notes)


def _turned(given: Given) -> Given:
    """The same points from the last to the first."""
    heading, speed = (None if column is None else column[::-1] for column in (given.heading, given.speed))
    x, y, places = given.x[::-1], given.y[::-1], given.places[::-1]
    return Given(x=x, y=y, heading=heading, speed=speed, places=places, notes=given.notes)
