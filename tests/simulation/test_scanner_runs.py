"""Whole runs with a simulated LMS100: its scans are true, recorded, replayed, and change nothing else."""

from __future__ import annotations

import json
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace
from rig import CALIBRATE, MISSIONS, Run, follow, run, write_mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.scan import Scan
from artemis.values import Pose

pytestmark = pytest.mark.short_alignment

STEPS = [CALIBRATE, follow(0.4)]
WORLD = {"walls": [{"points": [[-3, -2], [6, -2], [6, 2], [-3, 2], [-3, -2]]}]}


def driven(folder: Path, robot: str = "artemis_lms100.yaml", **simulation: Any) -> Run:  # noqa: ANN401 (of a mission)
    done = run(write_mission(folder, STEPS, robot=robot, simulation={"seed": 3, **simulation}))
    assert done.status == 0
    return done


def scans_of(done: Run) -> list[tuple[float, Scan]]:
    return [(seen.time, scan) for seen in done.seen for scan in seen.tick.snapshot.sensed.scans]


@pytest.mark.slow
def test_scans_are_recorded_and_replay_bit_for_bit(tmp_path: Path) -> None:
    done = driven(tmp_path, world=WORLD)
    scans = scans_of(done)
    assert len(scans) > 300
    assert {scan.source for _, scan in scans} == {"front"}
    assert done.outcome is not None
    read = [scan for tick in Recording(done.outcome.run.path).ticks() for scan in tick.snapshot.sensed.scans]
    assert read == [scan for _, scan in scans]
    replayed = done.recompute()
    assert (replayed.ticks, replayed.difference) == (len(done.seen), None)


def test_viewers_get_ten_scans_a_second_from_where_the_scanner_sits(tmp_path: Path) -> None:
    done = driven(tmp_path, world=WORLD)
    assert done.outcome is not None
    with done.outcome.run.recording.open("rb") as file:
        found = [
            (message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages(["/scan/front"])
            if schema is not None and schema.name == "foxglove.LaserScan"
        ]
    assert len(found) == pytest.approx(10 * done.outcome.duration, rel=0.15)
    _, told = found[50]
    assert (told["frame_id"], told["pose"]["position"]["x"]) == ("base_link", 0.56)
    assert (told["start_angle"], told["end_angle"]) == pytest.approx((-3 * pi / 4, 3 * pi / 4))
    assert told["ranges"] in [(scan.millimetres / 1000).tolist() for _, scan in scans_of(done)]


@pytest.mark.slow
def test_each_scan_is_sensed_once_soon_and_in_its_time(tmp_path: Path) -> None:
    scans = scans_of(driven(tmp_path, world=WORLD))
    for (_, one), (time, other) in pairwise(scans):
        assert other.counter == one.counter + 1
        assert other.time - one.time == pytest.approx(0.02, abs=5e-5)
        assert 0.0 < time - (other.time + 541 * other.beam_time) < 0.0225


@pytest.mark.slow
def test_a_scanner_changes_nothing_else(tmp_path: Path) -> None:
    """What it sees limits the speed; a mission that drives no faster than without looking drives the same."""
    robots: dict[str, dict[str, Any]] = {"artemis_lms100.yaml": {"world": WORLD}, "artemis.yaml": {}}
    steps = [CALIBRATE, follow(0.25)]
    with_one, without = (
        run(write_mission(tmp_path / robot, steps, robot=robot, obstacles="off", simulation={"seed": 3, **world}))
        for robot, world in robots.items()
    )
    assert [frame for _, frame in with_one.bus.sent] == [frame for _, frame in without.bus.sent]
    left = [replace(seen.tick.set_points, clearance=None) for seen in with_one.seen]
    assert left == [seen.tick.set_points for seen in without.seen]


@pytest.mark.slow
def test_the_same_seed_sees_the_same(tmp_path: Path) -> None:
    one, same = (scans_of(driven(tmp_path / name, world=WORLD)) for name in ("one", "same"))
    assert one == same


@pytest.mark.slow
def test_what_is_seen_is_where_it_is(tmp_path: Path) -> None:
    """Each beam from where the robot truly was then: on a wall, to the errors of the data sheet."""
    done = driven(tmp_path, world=WORLD)
    times = np.array([seen.time for seen in done.seen])
    poses = [seen.pose for seen in done.seen]
    errors = [error for _, scan in scans_of(done)[100:] for error in _errors(scan, times, poses)]
    assert len(errors) > 100_000
    assert np.mean(np.abs(errors) < 0.08) > 0.99
    assert abs(np.median(errors)) < 0.03


def _errors(scan: Scan, times: np.ndarray[Any, Any], poses: list[Pose]) -> list[float]:
    """How far the points of a scan are from the nearest wall of `WORLD` [m]; the scanner sits 0.56 m ahead."""
    at = scan.time + np.arange(541) * scan.beam_time
    x, y, heading = (np.interp(at, times, [getattr(pose, name) for pose in poses]) for name in ("x", "y", "heading"))
    angles = heading + scan.start_angle + np.arange(541) * scan.increment
    metres = scan.millimetres / 1000.0
    px = x + 0.56 * np.cos(heading) + metres * np.cos(angles)
    py = y + 0.56 * np.sin(heading) + metres * np.sin(angles)
    inside = np.minimum.reduce([px + 3.0, 6.0 - px, py + 2.0, 2.0 - py])
    found: list[float] = inside[metres > 0.0].tolist()
    return found


MAP_WORDS = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def test_a_map_and_a_stand_in(tmp_path: Path) -> None:
    rows = [[0 if row in (0, 39) or column in (0, 59) else 254 for column in range(60)] for row in range(40)]
    image = "P2 60 40 255\n" + "\n".join(" ".join(map(str, row)) for row in rows)
    words = f"image: hall.pgm\nresolution: 0.1\norigin: [-3.0, -2.0, 0.0]\n{MAP_WORDS}"
    stand_in = {"front": {"plugin": "lms1xx", "host": "127.0.0.1", "frequency_hz": 25, "resolution_deg": 0.25}}
    simulation = {"world": {"map_file": "hall.yaml"}, "scanners": stand_in}
    mission = write_mission(
        tmp_path, [{"wait": {"seconds": 12.0}}], {"hall.yaml": words, "hall.pgm": image}, "artemis_lms100.yaml",
        simulation=simulation,
    )  # fmt: skip
    scans = scans_of(run(mission))
    assert scans[0][0] > 10.0, "the motor changes its speed"
    _, last = scans[-1]
    assert len(last.millimetres) == 1081
    ahead, left = last.millimetres[540] / 1000, last.millimetres[900] / 1000
    assert (ahead, left) == (pytest.approx(3.0 - 0.1 - 0.56, abs=0.15), pytest.approx(1.9, abs=0.15))


@pytest.mark.parametrize(
    ("world", "problem"),
    [
        ({"walls": [{"points": [[0, 0]]}]}, "simulation.world.walls[0].points: expected a list of at least 2"),
        ({"wals": []}, "simulation.world.wals: unknown key; did you mean walls?"),
        ({"poles": [{"x_m": 1, "y_m": 0, "diameter_m": -0.1}]}, "leave the minus sign out"),
        (
            {"poles": [{"x_m": 3, "y_m": 0, "diameter_m": 0.3, "from_s": 5, "until_s": 3}]},
            "simulation.world.poles[0].until_s: expected more than from_s (5 s), found 3 s",
        ),
        (
            {"walls": [{"points": [[0, 1], [2, 1]], "until_s": 0}]},
            "simulation.world.walls[0].until_s: expected more than from_s (0 s), found 0 s",
        ),
        ({"persons": [{"path": [[2, 0, 0], [1, 0, 0]]}]}, "expected times that grow from place to place"),
        ({"map_file": "nowhere.yaml"}, "simulation.world.map_file: file not found: nowhere.yaml"),
        ({"map_file": "line.csv"}, "line.csv"),
        ({"map_file": "hall.yaml"}, "hall.pgm:1: begins with b'no'; expected a PGM image (P2 or P5)"),
        ({"map_file": "wrong.yaml"}, "wrong.yaml:1:1: resolutoin: unknown key; a map has image, resolution, origin"),
        ({"map_file": "../hall.yaml"}, "outside the mission's folder"),
    ],
)
def test_a_world_that_cannot_be_is_refused_with_its_place(
    tmp_path: Path, world: dict[str, object], problem: str
) -> None:
    files = {
        "hall.yaml": f"image: hall.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n{MAP_WORDS}",
        "hall.pgm": "no image",
        "wrong.yaml": f"resolutoin: 0.1\nimage: hall.pgm\norigin: [0, 0, 0]\n{MAP_WORDS}",
    }
    mission = write_mission(tmp_path, STEPS, files, "artemis_lms100.yaml", simulation={"world": world})
    with pytest.raises(ConfigError) as refused:
        load_mission(mission)
    assert problem in str(refused.value)


@pytest.mark.parametrize(
    ("world", "expected"),
    [
        (
            {"walls": [{"points": [["a", 1], [3, 1]]}]},
            ["walls[0].points[0][0]: expected a number, found 'a'"],
        ),
        (
            {"persons": [{"path": [[0, 5], [3, 5, 0, 1]]}]},
            [
                "persons[0].path[0]: expected [run time, x, y], found a list of 2",
                "persons[0].path[1]: expected [run time, x, y], found a list of 4",
            ],
        ),
        ({"walls": [{"points": [[0], [3, 1]]}]}, ["walls[0].points[0]: expected [x, y], found a list of 1"]),
        (
            {"walls": [{"points": [["a", 1]]}]},
            [
                "walls[0].points: expected a list of at least 2, found a list of 1",
                "walls[0].points[0][0]: expected a number, found 'a'",
            ],
        ),
    ],
)
def test_what_is_wrong_in_a_list_is_told_once(tmp_path: Path, world: dict[str, object], expected: list[str]) -> None:
    """Not also that the list is too short, for what is wrong in it counts, too."""
    with pytest.raises(ConfigError) as refused:
        load_mission(write_mission(tmp_path, STEPS, robot="artemis_lms100.yaml", simulation={"world": world}))
    assert [problem.partition(" simulation.world.")[2] for problem in refused.value.problems] == expected


@pytest.mark.parametrize(
    ("line", "instead", "problem"),
    [
        ("plugin: lms1xx", "plugin: lms1x", "scanners.front.plugin: artemis.scanners: no plugin 'lms1x'"),
        ("resolution_deg: 0.5", "resolution_deg: 0.25", "scanners.front: resolution_deg: 0.25 needs frequency_hz: 25"),
        ("host: 192.168.0.1", "hots: 192.168.0.1", "scanners.front.host: this key is missing"),
        ("host: 192.168.0.1", "host: a\n    upside_dwon: true", "unknown key; did you mean upside_down?"),
        ("host: 192.168.0.1", "host: a b", "scanners.front.host: expected a name or an address without blanks"),
    ],
)
def test_keys_of_a_scanner_are_checked_in_the_robot_file(tmp_path: Path, line: str, instead: str, problem: str) -> None:
    mission = write_mission(tmp_path, STEPS)
    text = (MISSIONS / "robots" / "artemis_lms100.yaml").read_text()
    assert line in text
    (tmp_path / "artemis.yaml").write_text(text.replace(line, instead))
    with pytest.raises(ConfigError) as refused:
        load_mission(mission)
    assert f"{tmp_path / 'artemis.yaml'}:" in str(refused.value)
    assert problem in str(refused.value)


@pytest.mark.parametrize(
    ("host", "is_same"), [("192.168.0.1", True), ("192.168.0.2", False), ("192.168.0.1\n    port: 2112", False)]
)
def test_two_scanners_cannot_be_one_device(tmp_path: Path, host: str, is_same: bool) -> None:
    mission = write_mission(tmp_path, STEPS)
    text = (MISSIONS / "robots" / "artemis_lms100.yaml").read_text()
    front = text[text.index("  front:") :]
    assert front.count("host: 192.168.0.1") == 1
    rear = front.replace("front:", "rear:", 1).replace("host: 192.168.0.1", f"host: {host}")
    (tmp_path / "artemis.yaml").write_text(f"{text.rstrip()}\n{rear}")
    if not is_same:
        load_mission(mission)
        return
    with pytest.raises(ConfigError) as refused:
        load_mission(mission)
    assert f"{tmp_path / 'artemis.yaml'}:" in str(refused.value)
    problem = "scanners.rear: 192.168.0.1:2111 is the address of front, too: each scanner has its own"
    assert problem in str(refused.value)


def test_names_are_told_apart(tmp_path: Path) -> None:
    observers = {"front": {"plugin": "csv"}}
    stand_ins = {"rear": {"plugin": "lms1xx", "host": "a"}}
    mission = write_mission(
        tmp_path, STEPS, robot="artemis_lms100.yaml", observers=observers, simulation={"scanners": stand_ins}
    )
    with pytest.raises(ConfigError) as refused:
        load_mission(mission)
    assert "observers.front: a scanner of the robot has this name" in str(refused.value)
    assert "simulation.scanners.rear: the robot has no such scanner" in str(refused.value)


def test_a_true_mounting_is_of_a_scanner_of_the_robot(tmp_path: Path) -> None:
    simulation = {"true_robot": {"scanners": {"rear": {"x_m": 0.1}}}}
    with pytest.raises(ConfigError, match=r"simulation.true_robot.scanners.rear: the robot has no such scanner"):
        load_mission(write_mission(tmp_path, STEPS, simulation=simulation))
