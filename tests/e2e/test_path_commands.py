"""`artemis path record|show|import` as processes and in process: good files, broken ones, and what is left behind."""

from __future__ import annotations

import itertools
import json
import math
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import MISSIONS, ROBOT, artemis, artemis_here, only_run

from artemis import cli
from artemis.commands.path_record import Drawing, RecordedPart, record_path
from artemis.commands.path_show import show_paths
from artemis.errors import ConfigError, RecordingError
from artemis.motion.path import path_from_csv
from artemis.motion.route import route_from_csv

PATHS = MISSIONS / "paths"
TABLE = """time_s, x, y, enable, done
0.0, 0, 0, 0, 0
9.0, 0, 0.5, 1, 0
14.0, -0.3, 0.5, 1, 0
18.0, 0, 0, 1, 0
20.0, 0, -0.5, 1, 0
24.0, 0, 0, 1, 0
26.0, 0, 0.2, 1, 0
26.5, 0, 0, 1, 0
28.0, 0, 0, 0, 0
28.5, 0, 0, 0, 1
"""
"""Forwards, to the left, backwards, and a little forwards again."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds `run`, in which the robot was driven to and fro by hand."""
    folder = tmp_path_factory.mktemp("by_hand")
    shutil.copy(ROBOT, folder)
    (folder / "stick.csv").write_text(TABLE)
    mission = {
        "mission": "by-hand",
        "robot": ROBOT.name,
        "bus": "simulation",
        "inputs": {"stick": {"plugin": "scripted", "file": "stick.csv"}},
        "steps": [
            {"calibrate": {"steering": "from_potentiometers"}},
            {"teleop": {"input": "stick", "until": {"button": "done"}}},
        ],
    }
    (folder / "mission.yaml").write_text(json.dumps(mission, indent=1))
    done = artemis("run", folder / "mission.yaml")
    assert done.returncode == 0, done.stderr
    (folder / "run").symlink_to(only_run(folder))
    return folder


def record(
    folder: Path,
    output: Path,
    choice: RecordedPart = RecordedPart(),  # noqa: B008  (frozen)
    drawing: Drawing = Drawing(),  # noqa: B008
    speed: float | None = None,
) -> int:
    return record_path(folder / "run", output, choice, drawing, speed=speed)


def refused(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command line says of arguments that it refuses."""
    monkeypatch.setattr(sys, "argv", ["artemis", *arguments])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code == cli.REFUSED
    return capsys.readouterr().err


# ---------------------------------------------------------------------------------------------- record


def test_a_run_becomes_a_file_with_its_reversals(folder: Path, tmp_path: Path) -> None:
    done = artemis_here("path", "record", folder / "run", "-o", tmp_path / "distance.csv")
    assert done.returncode == 0, done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["distance.csv"]
    text = (tmp_path / "distance.csv").read_text()
    assert re.search(
        r"distance\.csv: \d\.\d\d m, driven forwards, backwards, 9\.\d+ s to 2\d\.\d\d s of the run", done.stdout
    )
    assert "left out: 0.0" in done.stdout
    head = [line for line in text.splitlines() if line.startswith("#")]
    run = (folder / "run").resolve().name
    assert head[0].endswith(f"centre of the rear axle in the frame of the odometry of the run {run}")
    day = f"{run[:4]}-{run[4:6]}-{run[6:8]}"
    assert re.fullmatch(
        rf"# of {day} [\d:]+ UTC, driven by hand, forwards, backwards, [\d.]+ s to [\d.]+ s of the run\.", head[1]
    )
    assert re.fullmatch(r"# Length [\d.]+ m; a point every 0\.05 m; smoothing 0\.3 m;", head[2])
    assert re.fullmatch(r"# read again, the curve is at most [\d.]+ mm from what was driven\.", head[3])
    assert "# Where the headings point against the way it is driven backwards." in head
    there, back = route_from_csv(text, "distance.csv").parts
    assert (there.backward, back.backward) == (False, True)
    assert (there.path.x[0], there.path.y[0]) == pytest.approx((0.0, 0.0), abs=0.01)
    assert min(there.path.length, back.path.length) > 1.0


def test_a_file_that_is_there_is_kept_unless_forced(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "distance.csv").write_text("mine")
    kept = artemis_here("path", "record", folder / "run", "-o", tmp_path / "distance.csv")
    assert kept.returncode == 2
    assert kept.stderr == f"{tmp_path}/distance.csv: exists already; choose another name or --force\n"
    assert (tmp_path / "distance.csv").read_text() == "mine"
    forced = artemis_here("path", "record", folder / "run", "-o", tmp_path / "distance.csv", "--force")
    assert forced.returncode == 0
    assert (tmp_path / "distance.csv").read_text().startswith("# Path of the centre")
    assert [file.name for file in tmp_path.iterdir()] == ["distance.csv"]


def test_a_time_of_the_run_can_be_chosen(folder: Path, tmp_path: Path) -> None:
    assert record(folder, tmp_path / "part.csv", RecordedPart(begin=10.0, end=13.0)) == 0
    (line,) = re.findall(r"driven, forwards, ([\d.]+) s to ([\d.]+) s", (tmp_path / "part.csv").read_text())
    assert (float(line[0]), float(line[1])) == pytest.approx((10.0, 13.0), abs=0.05)


def test_spacing_and_speeds_are_as_asked(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "part.csv"
    drawing = Drawing(spacing=0.2, with_speed=True)
    assert record_path(folder / "run", file, RecordedPart(begin=9.0, end=13.0), drawing) == 0
    rows = [line.split(",") for line in file.read_text().splitlines() if line[:1] in "-0123456789"]
    steps = [math.dist(map(float, a[:2]), map(float, b[:2])) for a, b in itertools.pairwise(rows)]
    assert max(steps) < 0.2005
    assert min(steps) > 0.15
    speeds = [float(row[3]) for row in rows]
    assert speeds[0] == 0.1  # from standstill
    assert 0.3 < max(speeds) < 0.36


def test_a_speed_that_is_too_fast_for_the_steering_is_a_failure(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bend.csv"
    assert record(folder, file, RecordedPart(begin=10.0, end=17.0), speed=0.7) == 1
    assert "too fast at" in capsys.readouterr().out
    file.unlink()
    assert record(folder, file, RecordedPart(begin=10.0, end=17.0), speed=0.1) == 0
    file.unlink()
    assert record(folder, file, RecordedPart(begin=10.0, end=17.0), speed=5.0) == 1
    assert "more than the robot can" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        (RecordedPart(begin=100.0), "nothing was driven; choose another time"),
        (RecordedPart(begin=9.0, end=9.5), "at most 0.0"),
        (RecordedPart(name="eight"), "no path 'eight' was recorded; no step of its mission has `record:`"),
    ],
)
def test_what_is_no_path_is_refused(folder: Path, tmp_path: Path, choice: RecordedPart, words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        record(folder, tmp_path / "out.csv", choice)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "drawing", "speed"),
    [
        ("spacing", Drawing(spacing=0.0), None),
        ("spacing", Drawing(spacing=7.0), None),
        ("smoothing", Drawing(smoothing=-1.0), None),
        ("smoothing", Drawing(smoothing=math.nan), None),
        ("close-within", Drawing(close_within=-1.0), None),
        ("speed", Drawing(), 0.0),
        ("speed", Drawing(), math.inf),
    ],
)
def test_values_without_sense_are_refused(
    folder: Path, tmp_path: Path, option: str, drawing: Drawing, speed: float | None
) -> None:
    with pytest.raises(ConfigError, match=f"--{option} .*: expected"):
        record(folder, tmp_path / "out.csv", RecordedPart(), drawing, speed)


def test_a_recording_that_was_cut_gives_what_is_whole(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (folder / "run" / "recording.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    assert record_path(cut, tmp_path / "part.csv", RecordedPart(), Drawing()) == 0
    assert "the recording is not whole: the file is cut off" in capsys.readouterr().out
    (file,) = tmp_path.glob("part*.csv")
    assert "# The recording is not whole: the file is cut off" in file.read_text()
    assert path_from_csv(file.read_text(), "part.csv").length > 0.3
    cut.write_bytes(whole[:1000])
    with pytest.raises(RecordingError, match="nothing of a run can be read"):
        record_path(cut, tmp_path / "none.csv", RecordedPart(), Drawing())


def test_name_and_time_are_not_mixed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(["path", "record", "run", "-o", "o.csv", "--name", "a", "--from", "3"], monkeypatch, capsys)
    assert "not by both" in said


# ---------------------------------------------------------------------------------------------- show


def test_a_path_is_shown_in_numbers_and_drawn(tmp_path: Path) -> None:
    figure = tmp_path / "eight.png"
    done = artemis_here("path", "show", PATHS / "figure_eight.csv", "--robot", ROBOT, "-o", figure)
    assert done.returncode == 0, done.stderr
    assert "  length    16.010 m, closed, driven forwards\n" in done.stdout
    assert "  points    321, at most 0.050 m apart, at most 0.2 mm off the curve\n" in done.stdout
    assert "  extent    x -2.70 to 2.70 m, y -2.30 to 2.30 m\n" in done.stdout
    assert "  tightest  radius 0.73 m at " in done.stdout
    assert re.search(r"steering  37\.\d deg, ARTEMIS can 60 deg", done.stdout)
    assert re.search(r"drivable  the steering keeps up to 0\.\d\d m/s", done.stdout)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert len(figure.read_bytes()) > 10_000


@pytest.mark.parametrize(("speed", "status"), [(0.2, 0), (0.7, 1)])
def test_a_speed_that_a_path_does_not_allow_is_a_problem(
    speed: float, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show_paths([PATHS / "slalom.csv"], ROBOT, speed, None) == status
    assert ("problem   too fast at" in capsys.readouterr().out) is bool(status)


def test_a_path_that_follow_refuses_is_shown_with_the_reasons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "zigzag.csv"
    file.write_text("x,y\n0,0\n0.5,0\n1,0\n2.5,0\n1.5,0.1\n0.5,0\n0,0\n")
    assert show_paths([file], None, None, tmp_path / "z.svg") == 1
    shown = capsys.readouterr().out
    assert "zigzag.csv, part 2\n  length    2.5" in shown
    assert "driven backwards" in shown
    assert "at most 1.500 m apart" in shown
    assert "  reversals line 5 (x 2.50 m, y 0.00 m)\n" in shown
    assert f"{file}:5:1: 1.50 m from the point before" in shown
    assert (tmp_path / "z.svg").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["none.csv"], "none.csv: file not found"),
        (["bad.csv"], "bad.csv:2:3: y: expected a finite number, found 'b'"),
        (["good.csv", "--robot", "good.csv"], "good.csv:"),
        (["good.csv", "--speed", "0.3"], "--speed 0.3: expected up to 20 m/s, and a robot with --robot"),
        (["good.csv", "-o", "figure.doc"], "figure.doc: no figure can be drawn as that"),
        (["good.csv", "-o", "no/figure.png"], "no/figure.png: cannot be written"),
    ],
)
def test_what_cannot_be_shown_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.csv").write_text("x,y\n0,b\n")
    Path("good.csv").write_text("0,0\n1,0\n")
    assert refused(["path", "show", *arguments], monkeypatch, capsys).startswith(expected)


# ---------------------------------------------------------------------------------------------- import


def gpx() -> str:
    points = [(49.783 + 0.00002 * i, 9.973 + 0.00003 * math.sin(0.3 * i)) for i in range(30)]
    rows = "\n".join(f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"/>' for lat, lon in points)
    return f'<gpx version="1.1" creator="test"><trk><trkseg>\n{rows}\n</trkseg></trk></gpx>\n'


def poses() -> str:
    return "poses:\n" + "".join(f"- position: {{x: {3 * i}, y: {i % 2}}}\n" for i in range(5))


@pytest.mark.parametrize(
    ("name", "make", "length"),
    [
        ("distance.gpx", gpx, 67.0),
        ("distance.yaml", poses, 12.9),
        ("distance.csv", lambda: "x;y\n0;0\n5;0\n9;3\n", 10.2),
    ],
)
def test_a_file_of_others_becomes_a_path_that_a_mission_accepts(
    tmp_path: Path, name: str, make: Callable[[], str], length: float
) -> None:
    shutil.copytree(MISSIONS, tmp_path / "m", ignore=shutil.ignore_patterns("runs"))
    (tmp_path / name).write_text(make())
    output = tmp_path / "m" / "paths" / "imported.csv"
    done = artemis_here("path", "import", tmp_path / name, "-o", output, "--origin")
    assert done.returncode == 0, done.stderr
    assert f"from {make().count('trkpt') or len(make().splitlines()) - 1} points of {name}" in done.stdout
    path = path_from_csv(output.read_text(), "imported.csv")
    assert path.length == pytest.approx(length, rel=0.05)
    mission = (MISSIONS / "figure_eight.yaml").read_text()
    mission = mission.replace("paths/figure_eight.csv", "paths/imported.csv")
    mission = re.sub(r"laps: \d+", "laps: 1", re.sub(r"speed_m_s: [\d.]+", "speed_m_s: 0.1", mission))
    (tmp_path / "m" / "imported.yaml").write_text(mission)
    checked = artemis_here("check", tmp_path / "m" / "imported.yaml")
    assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize(
    ("name", "text", "options", "expected"),
    [
        ("w.gpx", "<!DOCTYPE a [<!ENTITY b 'c'>]>\n<gpx/>", [], "w.gpx:1:13: a document type (<!DOCTYPE) is refused"),
        ("w.gpx", "<gpx>\n<trk>", [], "w.gpx:2:6: not XML: no element found"),
        ("w.yaml", "poses:\n- {x: 1}\n", [], "w.yaml:2:3: poses[0].y: expected a number, found none"),
        ("w.csv", "x,y\n1,\n", [], "w.csv:2:3: y: expected a finite number, found ''"),
        ("w.csv", "x,y\n0,0\n1,0\n0,0.01\n", ["--closed"], "w.csv:3:1: the path reverses here, so it cannot be"),
        ("w.kmz", "<kml/>", [], "w.kmz: its suffix says nothing of its format; choose with --format csv|gpx|kml"),
        ("w.csv", "x,y\n", ["--format", "shp"], "w.csv: no format 'shp'; choose with --format csv|gpx|kml|geo"),
        ("w.csv", "0,0\n1,0\n", ["--smoothing", "9"], "--smoothing 9: expected 0 to 5 m"),
        ("w.csv", "0,0\n1,0\n", ["--closed"], "w.csv: reverses at"),
    ],
)  # fmt: skip
def test_a_broken_file_is_refused_with_its_place_and_nothing_is_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    text: str,
    options: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    assert refused(["path", "import", name, "-o", "out.csv", *options], monkeypatch, capsys).startswith(expected)
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_an_import_overwrites_only_when_forced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    out.write_text("mine")
    line = ["path", "import", str(PATHS / "straight.csv"), "-o"]
    assert "exists already" in refused([*line, str(out)], monkeypatch, capsys)
    assert "is a folder" in refused([*line, str(tmp_path)], monkeypatch, capsys)
    assert "no such folder" in refused([*line, str(tmp_path / "no" / "o.csv")], monkeypatch, capsys)
    assert out.read_text() == "mine"
    assert artemis_here(*line, out, "--force").returncode == 0
    assert path_from_csv(out.read_text(), "out.csv").length == pytest.approx(8.0)
    assert list(tmp_path.iterdir()) == [out]
