"""Invariant I14: what truly stands and walks around a robot with scanners is not touched by it.

Outline, things and poses are the true ones; geometry is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from artemis_lab.campaign.monitor.evidence import LATE_SCANS, Evidence, Injected, Violation
from artemis_lab.campaign.monitor.expected import Expected, expectation
from artemis_lab.campaign.monitor.frames import DRIVING
from artemis_lab.campaign.monitor.motion import CUT_OFF, PUSHED, STALLS, UNPOWERED

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STANDS = 0.05
"""A robot that is slower stands [m/s]."""
CREEPS = 0.12
"""With `obstacles: slow` it touches what stands no faster [m/s]."""
UNSOUND = (*PUSHED, *UNPOWERED, *CUT_OFF, *STALLS)
"""A robot with such a fault may not brake as it should."""
ASTRAY = ("STE", "CAL", "RUN")
"""Nor one with such a fault roll as it is steered."""
NEAR = 1.2
"""It stands for nothing farther from its outline [m]."""
UNSEEN, CRAWLS = 0.5, 0.16
"""What stood nearer to its outline [m] when the run began may have been too near for a scanner: nobody knows of it,
and the robot drives no faster [m/s] at first."""
WALKS_ON = 2.0
"""Somebody who walks comes so much nearer meanwhile [m]."""

SOON, KNOWN_LATE, LATEST = 0.04, (0.5, 2.9), 0.15
"""A scan is a tick old, and its answer one more [s]. Scans that come late from some time on are known to between these
[s] after it: the robot slows down first, and in the end they may as well come of a clock that was set back. For later
ones than the last of these [s] it stops."""
BELIEVED = 0.01
"""Of what it keeps away from things it may be wrong by so much [m]: 30 mm of systematic error, and noise."""


class _Moments(NamedTuple):
    """The true robot, an entry for each look."""

    time: Floats
    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    speed: Floats


class _Thing(NamedTuple):
    """Something: a segment, or something round."""

    name: str
    ends: Floats
    """x, y of both ends [m], shape (2, 2); of what is round its middle twice, at each moment: shape (2, 2, n)."""
    radius: float
    there: Flags
    """At each moment."""
    walks: Flags


def touches_nothing(e: Evidence) -> Iterator[Violation]:
    """I14: nothing that stands is touched; by somebody who walks a robot that stands, or whose wheels are not sound."""
    if not e.world or not e.looks:
        return
    moments = _moments(e)
    helpless = [(i.time, _drives_again(e, i)) for i in e.injected if _helps_not(i, expectation(i, e))]
    begins = [0, *np.searchsorted(moments.time, [end for _, end in helpless if end < moments.time[-1]]).tolist()]
    slow, blind_back = e.rules.get("mode") == "slow", e.rules.get("unseen_reverse") == "allowed"
    for thing in _things(e.world, moments.time):
        touched, unseen = _within(e, thing, moments, 0.0), bool(_within(e, thing, moments, UNSEEN)[begins].any())
        for at in np.flatnonzero(touched[1:] & ~touched[:-1]) + 1:
            time, speed = float(moments.time[at]), float(moments.speed[at])
            allowed = STANDS if thing.walks[at] else 0.0
            allowed = max(allowed, CREEPS if slow else 0.0, CRAWLS if unseen else 0.0)
            excused = any(begin <= time < end for begin, end in helpless) or (blind_back and speed < 0.0)
            if abs(speed) > allowed and not excused:
                yield Violation("I14", time, f"touches {thing.name} at {speed:+.2f} m/s")
                return


def stands_for_something(e: Evidence) -> Iterator[Violation]:
    """I14: a sound robot that drives forward stands only for what is near."""
    if not e.world or not e.looks:
        return
    first = min((i.time for i in e.injected), default=math.inf)
    moments = _moments(e)
    things = _things(e.world, moments.time)
    near = NEAR + (WALKS_ON if any(thing.walks.any() for thing in things) else 0.0)
    for line in e.journal.of("fault"):
        if line.data["id"] != "LAS-08" or line.time >= first or _backwards(e, line.time):
            continue
        at = int(np.searchsorted(moments.time, line.time, side="right")) - 1
        one = _Moments(*(part[at : at + 1] for part in moments))
        if not any(_within(e, thing, one, near, at)[0] for thing in things):
            yield Violation("I14", line.time, f"stands for an obstacle, and nothing is within {near:.1f} m")
            return


def stands_in_time(e: Evidence) -> Iterator[Violation]:
    """I14: while its scans come late, a sound robot is no faster than it stands for what they show then."""
    if not e.world or not e.looks or e.rules.get("mode", "stop") != "stop":
        return
    sound = min((i.time for i in e.injected if i.id != LATE_SCANS), default=math.inf)
    moments = _moments(e)
    late = np.zeros(len(moments.time))
    for injected in e.injected:
        seconds = float(injected.options.get("seconds", math.inf))
        if injected.id == LATE_SCANS and seconds <= LATEST and not injected.options.get("within_s"):
            first, last = (injected.time + after for after in KNOWN_LATE)
            during = (moments.time >= first) & (moments.time < min(last, injected.until, sound))
            late = np.where(during, SOON + seconds, late)
    speed = np.maximum(moments.speed, 0.0)
    ahead = speed * late + speed * speed / (2.0 * e.robot.limits.deceleration_m_s2)
    heading = np.unwrap(np.arctan2(moments.sin, moments.cos))
    turned = np.gradient(heading, moments.time) / np.maximum(speed, STANDS) * ahead
    middle = heading + turned / 2.0
    there = moments._replace(
        x=moments.x + ahead * np.cos(middle),
        y=moments.y + ahead * np.sin(middle),
        cos=np.cos(heading + turned),
        sin=np.sin(heading + turned),
    )
    kept = e.rules.get("margin_m", 0.08) + e.rules.get("clear_m", 0.05) - BELIEVED
    for thing in _things(e.world, moments.time):
        hit = _within(e, thing, there, kept) & (speed > STANDS) & (late > 0.0) & ~thing.walks
        if hit.any():
            at = int(np.flatnonzero(hit)[0])
            time, fast = float(moments.time[at]), float(speed[at])
            yield Violation("I14", time, f"cannot stand before {thing.name} any more, at {fast:.2f} m/s")
            return


def _helps_not(injected: Injected, expected: Expected) -> bool:
    return expected.coasts or injected.id in UNSOUND or injected.id.startswith(ASTRAY)


def _drives_again(e: Evidence, injected: Injected) -> float:
    """When the robot drives again, brought up from the start; infinite where its wheels are wrong from then on."""
    if injected.id in PUSHED or injected.id.startswith(ASTRAY):
        return math.inf
    stopped = e.journal.next_mode(injected.time, "fault")
    again = None if stopped is None else e.journal.next_mode(stopped, *DRIVING)
    return math.inf if again is None else again


def _backwards(e: Evidence, time: float) -> bool:
    """It was told to drive backwards last."""
    told = [speed for sent in e.targets.values() for at, speed in sent if time - 1.0 <= at <= time and speed != 0.0]
    return not told or min(told) < 0.0


def _moments(e: Evidence) -> _Moments:
    table = np.array([(look.time, look.x, look.y, look.heading, look.speed) for look in e.looks]).T
    time, x, y, heading, speed = table
    return _Moments(time, x, y, np.cos(heading), np.sin(heading), speed)


def _within(e: Evidence, thing: _Thing, moments: _Moments, margin: float, first: int | None = None) -> Flags:
    """When a thing is within the robot's outline and a margin [m]; `first`: of a single moment, its number."""
    part = slice(None) if first is None else slice(first, first + 1)
    ends = thing.ends if thing.ends.ndim == 2 else thing.ends[:, :, part]
    (ax, ay), (bx, by) = (_seen_from(moments, *end) for end in ends)
    outline = e.robot.outline
    assert outline is not None
    margin += thing.radius
    rear, front, half = -outline.rear_m - margin, outline.front_m + margin, outline.half_width_m + margin
    begin, end = np.zeros(len(ax)), np.ones(len(ax))
    with np.errstate(divide="ignore", invalid="ignore"):
        for at, along, low, high in ((ax, bx - ax, rear, front), (ay, by - ay, -half, half)):
            shares = np.array([(low - at) / along, (high - at) / along])
            beside = np.abs(along) < 1e-12
            inside = (at >= low) & (at <= high)
            begin = np.maximum(begin, np.where(beside, np.where(inside, 0.0, 2.0), shares.min(axis=0)))
            end = np.minimum(end, np.where(beside, 1.0, shares.max(axis=0)))
    found = (begin <= end) & thing.there[part]
    if thing.radius:  # the corners of what is round are none
        outside = np.hypot(
            np.maximum(np.maximum(-outline.rear_m - ax, ax - outline.front_m), 0.0),
            np.maximum(np.abs(ay) - outline.half_width_m, 0.0),
        )
        found &= outside <= margin
    return np.asarray(found)


def _seen_from(moments: _Moments, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    dx, dy = x - moments.x, y - moments.y
    return moments.cos * dx + moments.sin * dy, moments.cos * dy - moments.sin * dx


def _things(world: dict[str, Any] | Any, time: Floats) -> list[_Thing]:  # noqa: ANN401  (of a mission file)
    """All of a world, at these times [s]."""
    found = []
    never = np.zeros(len(time), bool)
    for wall in world.get("walls", ()):
        there = _there(wall, time)
        found += [_Thing("a wall", np.array(ends, float), 0.0, there, never) for ends in pairwise(wall["points"])]
    for box in world.get("boxes", ()):
        corners, there = _corners(box), _there(box, time)
        found += [_Thing("a box", np.array(ends), 0.0, there, never) for ends in pairwise([*corners, corners[0]])]
    for pole in world.get("poles", ()):
        middle = np.array([pole["x_m"], pole["y_m"]])
        found.append(_Thing("a pole", np.array([middle, middle]), pole["diameter_m"] / 2, _there(pole, time), never))
    for person in world.get("persons", ()):
        times, xs, ys = np.array(person["path"]).T
        places = np.array([np.interp(time, times, xs), np.interp(time, times, ys)])
        walks = (time >= times[0]) & (time <= times[-1]) if len(times) > 1 else never
        radius = person.get("diameter_m", 0.3) / 2
        found.append(_Thing("a person", np.array([places, places]), radius, _there(person, time), walks))
    return found


def _there(thing: dict[str, Any], time: Floats) -> Flags:
    until = thing.get("until_s")
    return np.asarray((time >= thing.get("from_s", 0.0)) & (time < (math.inf if until is None else until)))


def _corners(box: dict[str, Any]) -> list[tuple[float, float]]:
    turn = math.radians(box.get("heading_deg", 0.0))
    c, s = math.cos(turn), math.sin(turn)
    halves = [
        (u * box["length_m"] / 2, v * box["width_m"] / 2)
        for u, v in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
    ]
    return [(box["x_m"] + c * u - s * v, box["y_m"] + s * u + c * v) for u, v in halves]
