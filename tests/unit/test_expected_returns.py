"""A scanner that is covered slowly; and what else makes returns vanish: where a robot drives, and what moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from artemis.mounting import Mounting
from artemis.scan import Scan
from artemis.supervision.scanners import ScannerMeasures
from artemis.values import Odometry, Pose

Segment = tuple[float, float, float, float]
Scene = Callable[[float], Sequence[Segment]]
Way = Callable[[float], Pose]
Change = Callable[[float, NDArray[np.float64]], None]
PERIOD, BEAMS, AHEAD = 0.02, 541, 0.5
PLACE = Mounting(plugin="lms1xx", x_m=AHEAD, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=0.5)
ANGLES = np.radians(np.arange(BEAMS) * 0.5 - 135.0)
LONG: Segment = (-30, -4, 30, -4)
"""A wall to the right; without it nothing returns at first, and somebody has to look."""
ROOM: list[Segment] = [(-3, -2, 7, -2), (7, -2, 7, 2), (7, 2, -3, 2), (-3, 2, -3, -2)]


def cast(x: float, y: float, heading: float, walls: Sequence[Segment]) -> NDArray[np.float64]:
    """Distances [m] to the walls; infinite: there is none."""
    found = np.full(BEAMS, np.inf)
    c, s = np.cos(heading + ANGLES), np.sin(heading + ANGLES)
    for x1, y1, x2, y2 in walls:
        ux, uy, px, py = x2 - x1, y2 - y1, x1 - x, y1 - y
        cross = c * uy - s * ux
        with np.errstate(divide="ignore", invalid="ignore"):
            along, part = (px * uy - py * ux) / cross, (px * s - py * c) / cross
        found = np.where((along > 0) & (part >= 0) & (part <= 1) & (along < found), along, found)
    return found


def nothing(time: float, metres: NDArray[np.float64]) -> None:
    """No cover."""


def stand(time: float) -> Pose:
    return Pose()


def look(
    scene: Scene,
    way: Way = stand,
    change: Change = nothing,
    *,
    seconds: float = 8.0,
    short: bool = False,
    mounting: Mounting = PLACE,
    turned: bool = False,
) -> tuple[list[tuple[float, str]], ScannerMeasures]:
    """When and how LAS-06 was found, of a robot that goes its way; `short`: what is too near is measured too short."""
    dice, watched, found = np.random.default_rng(1), ScannerMeasures({"front": mounting}), []
    for number in range(round(seconds / PERIOD)):
        time, pose = number * PERIOD, way(number * PERIOD)
        x, y = pose.x + AHEAD * cos(pose.heading), pose.y + AHEAD * sin(pose.heading)
        metres = cast(x, y, pose.heading, scene(time)) + dice.normal(0.0, 0.012, BEAMS)
        dust = dice.random(BEAMS) < 5e-4
        metres[dust] = dice.uniform(0.6, 2.0, np.count_nonzero(dust))
        metres[metres < 0.5] = np.maximum(metres[metres < 0.5], 0.02) if short else np.inf
        metres[metres > 20.0] = np.inf
        change(time, metres)
        millimetres = np.rint(1000.0 * np.where(metres < np.inf, metres, 0.0)).astype("<u2")
        scan = Scan(
            source="front",
            time=time,
            beam_time=PERIOD / 720,
            start_angle=radians(135.0 if turned else -135.0),
            increment=radians(-0.5 if turned else 0.5),
            ranges=(millimetres[::-1] if turned else millimetres).tobytes(),
            counter=number,
        )
        sensed: Any = SimpleNamespace(time=time + PERIOD, scans=(scan,))
        readings = watched.read(sensed, Odometry(pose=pose))
        found += [(time, words) for id, _, _, words in readings if id == "LAS-06"]
    return found, watched


def room(time: float) -> Sequence[Segment]:
    return ROOM


def sheet(first: float, width: float, seconds: float, value: float = np.inf) -> Change:
    """From 3 s on something slides over the window, from an angle on [degrees], and takes so long."""

    def cover(time: float, metres: NDArray[np.float64]) -> None:
        share = min(1.0, max(0.0, (time - 3.0) / seconds))
        begin = round((first + 135.0) / 0.5)
        metres[begin : begin + round(width * share / 0.5)] = value

    return cover


def ahead(speed: float, *, until: float = 1e3) -> Way:
    return lambda time: Pose(x=speed * min(time, until))


def around(time: float) -> Pose:
    """A circle to the left, 0.5 m/s on a radius of half a metre."""
    return Pose(x=0.5 * sin(time), y=0.5 - 0.5 * cos(time), heading=(time + pi) % (2 * pi) - pi)


@pytest.mark.parametrize("value", [np.inf, 0.04])
@pytest.mark.parametrize("way", [stand, ahead(0.5), around])
@pytest.mark.parametrize(("first", "width", "seconds"), [(-80, 160, 0.8), (-135, 270, 1.1), (-135, 120, 3.0)])
def test_a_cover_that_slides_over_the_window(
    way: Way, first: float, width: float, seconds: float, value: float
) -> None:
    found, watched = look(room, way, sheet(first, width, seconds, value))
    assert found
    assert found[0][0] == pytest.approx(3.0 + seconds * 60.0 / width, abs=0.7)
    assert found[-1][0] > 7.9, "until it is taken away"
    assert watched.accept("front") == (width < 270)


@pytest.mark.parametrize("turned", [False, True])
def test_a_cover_of_short_values_comes_at_once(turned: bool) -> None:
    found, watched = look(room, change=sheet(-135, 270, 0.01, 0.04), turned=turned)
    assert found[0][0] == pytest.approx(3.0, abs=0.03)
    assert not watched.accept("front")


def test_what_is_uncovered_sees_again() -> None:
    def cover(time: float, metres: NDArray[np.float64]) -> None:
        if time < 5.0:
            sheet(-135, 270, 1.0)(time, metres)

    found, _ = look(room, change=cover)
    assert 4.9 < found[-1][0] < 5.1


def test_slowly_covered_scanner_of_a_large_hall_is_not_accepted() -> None:
    hall = [(-12, -12, 12, -12), (12, -12, 12, 12), (12, 12, -12, 12), (-12, 12, -12, -12)]
    _, watched = look(lambda time: hall, change=sheet(-135, 270, 1.1))
    assert not watched.accept("front")


def test_odometry_that_begins_anew_uncovers_nothing() -> None:
    found, watched = look(
        room, lambda time: Pose(x=0.0 if time < 6.0 else 9.0, heading=0.0 if time < 6.0 else 2.0), sheet(-135, 270, 1.1)
    )
    assert found[-1][0] > 7.9
    assert not watched.accept("front")


def test_odometry_that_begins_anew_covers_nothing() -> None:
    """The robot is as far from the middle of the room as before, on the other side, and does not know it."""
    found, _ = look(room, lambda time: Pose(x=0.0 if time < 4.0 else 4.0, heading=0.0 if time < 4.0 else 1.0))
    assert not found


def opening(time: float) -> Sequence[Segment]:
    """A room with a gap of 1.5 m to open ground, 2 m away."""
    return [(-3, -2, 7, -2), (7, -2, 7, 2), (7, 2, 1.5, 2), (0, 2, -3, 2), (-3, 2, -3, -2)]


def gate(time: float) -> Sequence[Segment]:
    """A hall that is left through a gate of 3 m at x = 2 m."""
    return [
        (-6, -3, 2, -3),
        (2, -3, 2, -1.5),
        (2, 1.5, 2, 3),
        (2, 3, -6, 3),
        (-6, 3, -6, -3),
        (2, 3, 2, 9),
        (2, -3, 2, -9),
    ]


def container(time: float) -> Sequence[Segment]:
    return [(-1, 1.2, 3, 1.2), (3, 1.2, 3, 3.6), LONG]


def narrow(half: float) -> Scene:
    """Open ground, then a passage with walls so far to both sides."""
    return lambda time: [
        (1.5, half, 9, half),
        (1.5, half, 1.5, 4),
        (1.5, -half, 9, -half),
        (1.5, -half, 1.5, -4),
        *ROOM,
    ]


def door(time: float) -> Sequence[Segment]:
    """A sliding door of a metre, a metre ahead, opens to open ground within two seconds."""
    left = max(0.0, 1.0 - max(0.0, time - 3.0) / 2.0)
    return [(1.5, -3, 1.5, -0.5), (1.5, -0.5, 1.5, -0.5 + left), (1.5, 0.5, 1.5, 3), LONG]


def person(x: float, y: float) -> list[Segment]:
    half = 0.25
    return [(x - half, y, x + half, y), (x, y - half, x, y + half)]


def crossing(time: float) -> Sequence[Segment]:
    return [*person(1.5, -4.0 + 1.5 * time), LONG]


def leaving(time: float) -> Sequence[Segment]:
    """Somebody stands ahead for some seconds, and goes."""
    return [*person(1.3, max(0.0, 1.5 * (time - 4.0))), LONG]


def standing_close(time: float) -> Sequence[Segment]:
    """Somebody comes near, stands nearer than the least range, and goes."""
    return [*ROOM, *person(max(0.9, 3.0 - 1.0 * time) if time < 5.0 else 0.9 + (time - 5.0), 0.0)]


def truck(time: float) -> Sequence[Segment]:
    """Drives past, in the open."""
    x = -20.0 + 5.0 * time
    return [(x, 2.0, x + 6.0, 2.0), (x + 6.0, 2.0, x + 6.0, 4.5), (x, 2.0, x, 4.5), LONG]


@pytest.mark.parametrize("short", [False, True])
@pytest.mark.parametrize(
    ("scene", "way"),
    [
        (room, stand),
        (room, ahead(0.7, until=7.0)),
        (room, around),
        (opening, stand),
        (opening, around),
        (opening, ahead(0.5)),
        (gate, ahead(0.7)),
        (container, ahead(0.7)),
        (narrow(0.45), ahead(0.5, until=12.0)),
        (narrow(0.3), ahead(0.5)),
        (narrow(0.3), ahead(-0.3)),
        (narrow(0.3), ahead(0.5, until=5.0)),
        (door, stand),
        (crossing, stand),
        (leaving, stand),
        (standing_close, stand),
        (truck, stand),
    ],
)
def test_what_is_no_cover(scene: Scene, way: Way, short: bool) -> None:
    assert look(scene, way, seconds=10.0, short=short)[0] == []
