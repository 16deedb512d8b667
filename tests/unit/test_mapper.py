"""Whole maps of small worlds whose truth is known: accuracy, loops that close or stay open, the same map again."""

from __future__ import annotations

import gzip
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from office import OFFICE

from artemis.errors import ConfigError
from artemis.mapping.carmen import read_carmen
from artemis.mapping.laser import Reading, surface_points
from artemis.mapping.mapper import Mapper
from artemis.mapping.se2 import Array, between, compose
from artemis_lab.bench.laser_worlds import ANGLES, SETTINGS, box, driven, odometry, readings, scan, seen, walls

ROUND = driven([(-2, -3), (0, -3), (0, 1), (-5, 1), (-5, -1), (-2, 1.0), (0, 1), (0, -3), (-2, -3)], step=0.25)


def mapped(given: list[Reading]) -> Mapper:
    mapper = Mapper(replace(SETTINGS, cells=1024))
    for reading in given:
        mapper.add(reading)
    mapper.finish()
    return mapper


def errors(mapper: Mapper, true: Array) -> Array:
    """Distances of all poses from the true ones [m], after the first is made equal."""
    off = between(between(true[0], true), mapper.trajectory()[1])
    return np.asarray(np.hypot(off[:, 0], off[:, 1]))


@pytest.fixture(scope="module")
def drifting() -> list[Reading]:
    """Wheels that count 10 % too little and turn by 5 degrees per metre."""
    return readings(OFFICE, ROUND, odometry(ROUND, [0.9] * (len(ROUND) - 1), np.radians(5)))


@pytest.fixture(scope="module")
def made(drifting: list[Reading]) -> Mapper:
    return mapped(drifting)


def test_a_map_is_right_to_centimetres_though_the_odometry_is_metres_off(made: Mapper, drifting: list[Reading]) -> None:
    last = drifting[-1].odometry
    assert last is not None
    assert np.hypot(*between(between(ROUND[0], ROUND[-1]), last)[:2]) > 1.0
    off = errors(made, ROUND)
    assert off.mean() < 0.02
    assert off.max() < 0.06
    assert made.counts.unmatched == 0
    assert len(made.graph.loops) > 3


def test_the_same_readings_give_the_same_map(made: Mapper, drifting: list[Reading]) -> None:
    again = mapped(drifting)
    assert np.array_equal(again.keys.poses, made.keys.poses)
    assert np.array_equal(again.trajectory()[1], made.trajectory()[1])


def test_a_map_needs_no_odometry() -> None:
    off = errors(mapped(readings(OFFICE, ROUND, None)), ROUND)
    assert off.mean() < 0.02
    assert off.max() < 0.08


def test_readings_without_a_scan_get_poses_too(drifting: list[Reading]) -> None:
    given = [reading if number % 3 == 0 else replace(reading, points=None) for number, reading in enumerate(drifting)]
    mapper = mapped(given)
    times, poses = mapper.trajectory()
    assert times.tolist() == [reading.time for reading in given]
    assert np.isfinite(poses).all()
    assert errors(mapper, ROUND).mean() < 0.03
    assert errors(mapper, ROUND).max() < 0.12


def test_standing_still_costs_no_memory() -> None:
    poses = np.repeat(ROUND[:1], 300, axis=0)
    mapper = mapped(readings(OFFICE, poses, np.zeros((300, 3))))
    assert len(mapper.keys) == 1
    assert len(mapper._tracker.stations.keys) == 1
    assert len(mapper.trajectory()[0]) == 300


def kept_of(step: float, metres: float) -> int:
    """Bytes that mapping keeps of a straight drive with a scan every so many metres, its loops not looked for."""
    poses = driven([(-5.0, 0.0), (-5.0 + metres, 0.0)], step)
    counted = odometry(poses, [1.0] * (len(poses) - 1))
    mapper = Mapper(replace(SETTINGS, cells=512, farthest=8.0), later=lambda work, key: work(key))
    tracemalloc.start()
    begin = 0
    for number, (pose, wheels) in enumerate(zip(poses, counted, strict=True)):
        mapper.add(Reading(time=0.02 * number, odometry=wheels, points=scan(OFFICE, pose)))
        if number == len(poses) // 4:  # tables grow in leaps at first
            begin = tracemalloc.get_traced_memory()[0]
    kept = tracemalloc.get_traced_memory()[0] - begin
    tracemalloc.stop()
    return kept


def test_memory_grows_with_the_metres_not_with_the_scans() -> None:
    """At 50 scans a second and 0.5 m/s: 100 scans a metre of 180 beams, 5.8 kB each as they come."""
    metres = 3.0
    slow, fast = kept_of(0.02, metres), kept_of(0.01, metres)
    assert fast < 0.75 * metres * 100_000
    assert fast < 1.2 * slow


def test_a_scan_costs_the_same_after_a_long_drive() -> None:
    """Of two hours of odometry at 50 Hz nothing is copied when a scan is added: counted in bytes, at the peak."""
    peaks = []
    for before in (0, 360_000):
        mapper = Mapper(replace(SETTINGS, cells=512, farthest=8.0))
        for number, x in enumerate((-2.0, -1.9)):
            pose = np.array([x, 0.0, 0.0])
            reading = Reading(time=0.02 * number, odometry=pose, points=scan(OFFICE, pose))
            if number:
                for _ in range(before):
                    mapper.add(Reading(time=0.0, odometry=pose))
                tracemalloc.start()
            mapper.add(reading)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 100_000


def test_a_scan_that_sees_nothing_leaves_it_to_the_odometry(drifting: list[Reading]) -> None:
    blind = [replace(r, points=np.empty((0, 4))) if 20 <= n < 24 else r for n, r in enumerate(drifting)]
    mapper = mapped(blind)
    assert mapper.counts.unmatched == 4
    assert errors(mapper, ROUND).max() < 0.25


def test_a_loop_that_is_undone_leaves_the_map_usable(drifting: list[Reading]) -> None:
    mapper = mapped(drifting)
    for number in list(mapper.graph.loops):
        mapper.graph.remove(number)
        mapper.solve()
    assert mapper.graph.loops == {}
    assert errors(mapper, ROUND).max() < 0.3


def ring(width: float, height: float, corridor: float, door: float) -> Array:
    """A corridor around a block, with equal niches at equal distances: everything looks alike, but its corners."""
    parts = [box(0, 0, width, height), box(corridor, corridor, width - 2 * corridor, height - 2 * corridor)]
    for x in np.arange(4, width - 4, door):
        parts.append(walls([(x, 0), (x, 0.35), (x + 0.9, 0.35), (x + 0.9, 0)]))
        parts.append(walls([(x, height), (x, height - 0.35), (x + 0.9, height - 0.35), (x + 0.9, height)]))
    return np.concatenate(parts)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("first", "second"), [(0.95, 0.95), (0.85, 1.05), (0.75, 1.1)])
def test_a_loop_in_a_corridor_is_found_or_left_open_but_never_wrong(first: float, second: float) -> None:
    true = driven([(1, 1), (39, 1), (39, 13), (1, 13), (1, 1), (20, 1)], step=0.3)
    scales = np.where(np.arange(len(true) - 1) < 0.43 * len(true), first, second)
    mapper = mapped(readings(ring(40, 14, 2, 4), true, odometry(true, scales)))
    assert wrong_loops(mapper, true) == []
    assert first < 0.9 or mapper.graph.loops, "a small drift is closed"


def wrong_loops(mapper: Mapper, true: Array) -> list[tuple[int, int, float]]:
    """Ends of those loops that are off by more than 0.3 m, and by how much [m]."""
    of, found = mapper.key_readings, []
    for link in mapper.graph.loops.values():
        off = between(between(true[of[link.first]], true[of[link.second]]), link.motion)
        if np.hypot(off[0], off[1]) >= 0.3:
            found.append((link.first, link.second, float(np.hypot(off[0], off[1]))))
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize(("scale", "turn"), [(1.0, 0.0), (0.97, 0.3), (0.8, 0.0), (1.15, 0.5)])
def test_no_loop_of_a_building_of_a_kilometre_is_wrong(scale: float, turn: float) -> None:
    """Four equal corridors side by side, joined at their ends, driven there and back."""
    long, apart = 110.0, 12.0
    parts = [box(0, apart * n, long, 2) for n in range(4)]
    for n in range(4):
        for x in np.arange(4, long - 4, 4.0):
            y = apart * n
            parts.append(walls([(x, y), (x, y - 0.35), (x + 0.9, y - 0.35), (x + 0.9, y)]))
    world = np.concatenate(parts)
    for n in range(3):  # doors from corridor to corridor at alternating ends
        x = long - 2.5 if n % 2 == 0 else 0.5
        world = np.concatenate([opened(world, x, apart * n + 2), box(x, apart * n + 2, 2.0, apart - 2)[1::2]])
        world = opened(world, x, apart * (n + 1))
    corners = [(1.0, 1.0)]
    for n in range(4):
        end = long - 1.5 if n % 2 == 0 else 1.5
        corners += [(end, apart * n + 1.0)] + ([(end, apart * (n + 1) + 1.0)] if n < 3 else [])
    true = driven(corners + corners[-2::-1], step=0.4)
    assert np.hypot(*np.diff(true[:, :2], axis=0).T).sum() > 900
    mapper = mapped(readings(world, true, odometry(true, [scale] * (len(true) - 1), np.radians(turn))))
    assert wrong_loops(mapper, true) == []


def opened(world: Array, x: float, y: float, width: float = 2.0) -> Array:
    """The world with a doorway in its walls along y, from x on."""
    kept = []
    for ax, ay, bx, by in world.tolist():
        low, high = min(ax, bx), max(ax, bx)
        if ay == by == y and low < x + width and high > x:
            kept += [(low, y, x, y)] if low < x else []
            kept += [(x + width, y, high, y)] if high > x + width else []
        else:
            kept.append((ax, ay, bx, by))
    return np.array(kept)


def test_a_scanner_may_be_mounted_anywhere() -> None:
    place = np.array([0.4, -0.1, 0.5])
    robot = np.array([0.5, 0.3, 0.2])
    level = surface_points(seen(OFFICE, compose(robot, place)), ANGLES, SETTINGS, place)
    world = compose(robot, np.c_[level[:, :2], np.zeros(len(level))])[:, :2]
    assert np.abs(seen_from_walls(world)).max() < 1e-6


def seen_from_walls(points: Array) -> Array:
    """Distance of each point from the nearest wall of the office [m]."""
    a, b = OFFICE[:, :2], OFFICE[:, 2:]
    share = (((points[:, None] - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(1)).clip(0, 1)
    return np.asarray(np.linalg.norm(points[:, None] - (a + share[..., None] * (b - a)), axis=2).min(1))


LASER = "FLASER 4 1.0 2.0 81.83 2.5 9 9 9 0.5 0.25 0.1 12.5 host 0.5\n"


def test_a_carmen_log_is_read(tmp_path: Path) -> None:
    log = tmp_path / "log.clf.gz"
    with gzip.open(log, "wt") as file:
        file.write("# a comment\nPARAM x 1\nODOM 1 2 0.5 0 0 0 11.5 host 0.1\n" + LASER)
    first, second = read_carmen(log, SETTINGS)
    assert (first.time, first.points) == (11.5, None)
    assert first.odometry == pytest.approx([1, 2, 0.5])
    assert second.time == 12.5
    assert second.odometry == pytest.approx([0.5, 0.25, 0.1])
    assert second.points is not None
    assert second.points[:, :2] == pytest.approx(np.array([[0, -1], [2**0.5, -(2**0.5)], [2.5 / 2**0.5, 2.5 / 2**0.5]]))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("ODOM 1 2 x 0 0 0 11.5 host 0.1\n", "log.clf:1: ODOM: could not convert string to float"),
        ("# fine\nODOM 1 2\n", "log.clf:2: ODOM: list index out of range"),
        ("# fine\n" + LASER.replace("FLASER 4", "FLASER 5"), "log.clf:2: FLASER: 15 fields; 5 beams need 16"),
        ("FLASER 1 1.0 0 0 0 0 0 0 1 h 0\n", "log.clf:1: FLASER: a scan of 1 beams; expected 2 at least"),
        (LASER.replace("0.25", "nan"), "log.clf:1: FLASER: 0.5 nan 0.1 is no pose"),
    ],
)
def test_a_damaged_carmen_log_is_refused_at_its_line(tmp_path: Path, text: str, problem: str) -> None:
    log = tmp_path / "log.clf"
    log.write_text(text)
    with pytest.raises(ConfigError) as caught:
        list(read_carmen(log, SETTINGS))
    assert problem in str(caught.value)


def test_a_log_that_is_no_log_is_refused(tmp_path: Path) -> None:
    for name, content in (("a.clf.gz", b"no gzip"), ("b.clf", b"\xff\xfe\x00")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigError, match=name):
            list(read_carmen(tmp_path / name, SETTINGS))
    with pytest.raises(ConfigError, match="No such file"):
        list(read_carmen(tmp_path / "none.clf", SETTINGS))
