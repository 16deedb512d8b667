"""What the obstacle stop has to reach, and what it does: contacts, slow-downs for nothing, and what a look costs."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from math import inf, radians
from types import FrameType
from typing import NamedTuple

import numpy as np

from artemis.clock import cpu_time
from artemis.motion.obstacles import ObstacleStop
from artemis.scan import ObstacleRules, Scan
from artemis.values import (
    DriveCommand,
    LocatedPose,
    Odometry,
    Pose,
    Sensed,
    SetPoints,
    Snapshot,
    Verdict,
    Wish,
)
from artemis_lab.bench.obstacle_persons import crossed, stepped_aside, stepped_in
from artemis_lab.bench.obstacle_scenes import (
    BEAMS,
    FIELD,
    PERIOD,
    RARE,
    Array,
    Passage,
    Scene,
    corridor,
    random_drive,
    rarely_seen,
    robot_with_scanner,
    straight,
)

SECONDS, BACKWARDS = 8.0, 0.3
"""Of a drive in a random scene [s]; share of the wishes that are to drive backwards;"""
SECONDS_AROUND, BACKWARDS_AROUND = 16.0, 0.5
"""likewise where things also stand behind the robot."""
LEAST_DISTANCE = 0.01
"""To what stands [m]."""
SLOW, FEW = 0.1, 0.03
"""A contact with a person who walks is slow below this [m/s]; of all contacts fewer than this share are faster."""
WIDTH, DUST = 0.90, 5e-4
"""Of a corridor [m]; share of the beams that show dust."""
PIECE = 50.0
"""A kilometre is driven in such pieces [m], each with noise and errors of its own."""
MEDIAN, SLOWEST = 100.0, 250.0
"""What half of the looks and 99 % of them may cost [us]."""


class Bar(NamedTuple):
    """A row of the table."""

    name: str
    bar: str
    measured: str
    met: bool


@contextmanager
def workers(number: int) -> Iterator[Executor]:
    """So many processes."""
    with ProcessPoolExecutor(number, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield pool


def _outcomes(
    pool: Executor, drive: Callable[[int], Passage | None], scenes: int, first: int, done: Callable[[], object]
) -> Iterator[tuple[int, Passage]]:
    """Of the drives with so many seeds: the seed and what came of it, where there was a drive."""
    for seed, outcome in enumerate(pool.map(drive, range(first, first + scenes), chunksize=10), first):
        done()
        if outcome is not None:
            yield seed, outcome


def standing(pool: Executor, scenes: int, first: int, done: Callable[[], object], *, around: bool = False) -> Bar:
    """Worst driving forwards and backwards in random scenes from a seed on; `around`: something stands behind, too."""
    seconds, reverse = (SECONDS_AROUND, BACKWARDS_AROUND) if around else (SECONDS, BACKWARDS)
    drive = partial(random_drive, seconds=seconds, reverse=reverse, around=around)
    found = dict(_outcomes(pool, drive, scenes, first, done))
    contacts = [seed for seed, outcome in found.items() if outcome.nearest < 0.0]
    nearest = min([outcome.nearest for outcome in found.values()], default=inf)
    kilometres = sum([outcome.driven for outcome in found.values()]) / 1000.0
    words = f"{len(contacts)} of {len(found)} scenes, {kilometres:.1f} km; least {100 * nearest:.1f} cm"
    close = [seed for seed, outcome in found.items() if outcome.nearest < LEAST_DISTANCE]
    words += f"; seeds {', '.join(map(str, close[:5]))}" if close else ""
    name = f"contacts with what stands{', also behind' if around else ''}"
    return Bar(name, "0, least distance >= 1 cm", words, not close)


def persons(pool: Executor, scenes: int, first: int, done: Callable[[], object]) -> Bar:
    """A person who crosses and never yields."""
    drives = _outcomes(pool, crossed, scenes, first, done)
    contacts = [outcome.contact for _, outcome in drives if outcome.contact is not None]
    fast = len([speed for speed in contacts if speed > SLOW])
    share = fast / max(1, len(contacts))
    words = f"{fast} of {len(contacts)} contacts in {scenes} scenes ({100 * share:.1f} %)"
    return Bar("person crossing at 1.5 m/s, contact faster than 0.1 m/s", "< 3 % of contacts", words, share < FEW)


def who_stays(pool: Executor, scenes: int, first: int, done: Callable[[], object]) -> Bar:
    """A person who steps in where the robot brakes, or aside before it, where the scanner sees nothing."""
    contacts: list[str] = []
    for drive in (stepped_in, stepped_aside):
        drives = _outcomes(pool, drive, scenes, first, done)
        contacts += [f"{drive.__name__}({seed})" for seed, it in drives if it.contact]  # a robot that stands may be
    words = f"{len(contacts)} in {2 * scenes} scenes"
    words += f": {', '.join(contacts[:5])}" if contacts else ""
    return Bar("person who steps in or aside, contact while driving", "0", words, not contacts)


def legs(pool: Executor, scenes: int, first: int, done: Callable[[], object]) -> Bar:
    """Thin ones, from which few beams return."""
    drives = _outcomes(pool, rarely_seen, scenes, first, done)
    contacts = [seed for seed, outcome in drives if outcome.contact is not None]
    words = f"{len(contacts)} in {scenes} scenes"
    words += f"; seeds {', '.join(map(str, contacts[:5]))}" if contacts else ""
    name = f"thin leg, {100 * (1 - RARE):.0f} % of the beams return, contact"
    return Bar(name, "0", words, not contacts)


def slow_downs(pool: Executor, metres: float, first: int, done: Callable[[], object]) -> Iterator[Bar]:
    """For nothing: in a corridor, and for dust."""
    long, open_ground = corridor(WIDTH, 2.0 * PIECE), Scene()
    for name, scene, dust, most in (
        (f"corridor of {WIDTH:.2f} m", long, 0.0, 0),
        (f"dust of {DUST:g} a beam", open_ground, DUST, 1),
    ):
        pieces = max(1, round(metres / PIECE))
        drive = partial(straight, scene=scene, distance=PIECE, dust=dust)
        found = []
        for outcome in pool.map(drive, range(first, first + pieces)):
            done()
            found.append(outcome)
        slowed, driven = sum([each.slowed for each in found]), sum([each.driven for each in found])
        bar = f"{'no slow-down' if not most else '<= 1 slow-down'} in 1 km"
        yield Bar(name, bar, f"{slowed} in {driven / 1000.0:.2f} km", slowed <= most * driven / 1000.0 + 1e-9)


def cost(looks: int) -> Bar:
    """Of looks with 541 beams that all end near, and wheels that turn."""
    times, peers, calls = look_times(looks)
    median, slowest = np.quantile(times, (0.5, 0.99))
    ratio = median / np.quantile(peers, 0.5)
    words = f"{median:.0f} us, {slowest:.0f} us; {ratio:.1f} x a numpy kernel of 60 operations; {calls} Python calls"
    bar = f"<= {MEDIAN:.0f} us median, <= {SLOWEST:.0f} us p99"
    return Bar("a look with 541 near beams", bar, words, median <= MEDIAN and slowest <= SLOWEST)


def look_times(looks: int) -> tuple[Array, Array, int]:
    """Of each look and of a kernel in numpy after it: processor time [us]; and how many Python functions one calls."""
    dice, rules = np.random.default_rng(1), ObstacleRules(mode="stop")
    stop = ObstacleStop(robot_with_scanner(), [rules])
    wish, last = Wish(command=DriveCommand(speed=0.5, steering=0.5)), SetPoints(speed=0.3, steering=0.2)
    times, peers, calls = [], [], 0

    def count(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event == "call"

    kernel = np.arange(float(BEAMS))
    for number in range(looks + 2):
        snapshot = _all_near(number, dice)
        if number == looks + 1:
            before = sys.getprofile()
            sys.setprofile(count)
            stop.look(wish, last, snapshot, rules)
            sys.setprofile(before)
            break
        begin = cpu_time()
        stop.look(wish, last, snapshot, rules)
        end = cpu_time()
        for _ in range(20):
            kernel = np.sqrt(kernel * kernel + 1.0)
        times.append(end - begin)
        peers.append(cpu_time() - end)
    return 1e6 * np.array(times[1:]), 1e6 * np.array(peers[1:]), calls


def _all_near(number: int, dice: np.random.Generator) -> Snapshot:
    """A tick in which all beams end within 1.5 m of the scanner."""
    now, distance = number * PERIOD, 0.006 * number
    ranges = 1.2 + 0.3 * np.sin(np.arange(BEAMS) / 20.0) + dice.normal(0.0, 0.012, BEAMS)
    scan = Scan(
        source="front",
        time=now - 0.018,
        beam_time=0.015 / BEAMS,
        start_angle=-FIELD,
        increment=2 * FIELD / (BEAMS - 1),
        ranges=np.round(1000.0 * ranges).astype("<u2").tobytes(),
        counter=number,
    )
    pose = Pose(x=distance, heading=radians(0.1 * number))
    return Snapshot(
        sensed=Sensed(index=number, time=now, scans=(scan,)),
        dt=PERIOD,
        pose=LocatedPose(pose=pose),
        odometry=Odometry(pose=pose, speed=0.3, steering=0.2, distance=distance),
        standing=False,
        set_points=SetPoints(),
        verdict=Verdict(),
    )
