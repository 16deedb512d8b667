"""`artemis map`: built of a log or a run, shown, edited; what cannot be is refused."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np
import pytest
from laser_worlds import ANGLES, OFFICE, SETTINGS, driven, odometry, seen
from typer.testing import CliRunner

from artemis.cli import app
from artemis.commands.map_readings import _reading
from artemis.errors import ConfigError
from artemis.mapping.graph_file import read_graph
from artemis.mapping.laser import ScannerPlace
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OCCUPIED
from artemis.scan import Scan

WAY = driven([(-2, -3), (0, -3), (0, 1), (0, -3), (-2, -3)], 0.25)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "office.clf"
    half = np.radians(np.arange(-90, 90))
    counted = odometry(WAY, [0.95] * (len(WAY) - 1))
    with file.open("w") as out:
        for number, (pose, wheels) in enumerate(zip(WAY, counted, strict=True)):
            ranges = " ".join(f"{each:.3f}" for each in seen(OFFICE, pose, half))
            x, y, heading = wheels
            out.write(f"FLASER 180 {ranges} 0 0 0 {x:.4f} {y:.4f} {heading:.5f} {0.1 * number:.2f} host 0\n")
    return file


def call(*words: str | Path) -> str:
    done = CliRunner().invoke(app, ["map", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def refused(*words: str | Path) -> str:
    with pytest.raises(ConfigError) as caught:
        CliRunner().invoke(app, ["map", *map(str, words)], catch_exceptions=False, standalone_mode=False)
    return str(caught.value)


def test_a_map_is_built_shown_and_edited(log: Path, tmp_path: Path) -> None:
    made, edited = tmp_path / "office.yaml", tmp_path / "edited.yaml"
    assert "matched nowhere" in call("build", log, "-o", made)
    assert OCCUPIED in read_map(made).cells
    shown = call("show", made, "-o", tmp_path / "a.png")
    assert "key scans" in shown
    assert (tmp_path / "a.png").stat().st_size > 10_000
    loops = read_graph(made.with_suffix(".graph")).graph.loops
    assert loops
    number = next(iter(loops))
    edits = ("--undo-loop", str(number), "--rotate", "90", "--crop=-8,-8,8,8", "--no-go", "1,1,2,1,2,2,1,2")
    call("edit", made, "-o", edited, *edits)
    assert number not in read_graph(edited.with_suffix(".graph")).graph.loops
    cells = read_map(edited)
    rows, columns = cells.cell_of(np.array([[1.5, 1.5]]))
    assert cells.cells[rows[0], columns[0]] == OCCUPIED
    edited.with_suffix(".graph").unlink()
    assert "none: there is no edited.graph" in call("show", edited, "-o", tmp_path / "b.svg")


def test_two_runs_make_one_map(log: Path, tmp_path: Path) -> None:
    call("build", log, log, "-o", tmp_path / "two.yaml", "--without-odometry")
    assert len(read_graph(tmp_path / "two.graph").trajectory) == 2 * len(WAY)


def test_what_cannot_be_is_refused(log: Path, tmp_path: Path) -> None:
    made = tmp_path / "m.yaml"
    assert "name the map .yaml" in refused("build", log, "-o", tmp_path / "m.png")
    assert "expected 0.005 to 1 m" in refused("build", log, "-o", made, "--resolution", "7")
    assert "--mounting 1,2: expected 3 numbers" in refused("build", log, "-o", made, "--mounting", "1,2")
    assert "cannot be read" in refused("build", tmp_path / "none.clf", "-o", made)
    (tmp_path / "empty.clf").write_text("# nothing\n")
    assert "no scan has a point" in refused("build", tmp_path / "empty.clf", "-o", made)
    call("build", log, "-o", made)
    assert "exists already" in refused("build", log, "-o", made)
    assert "name it .png" in refused("show", made, "-o", tmp_path / "m.txt")
    other = tmp_path / "n.yaml"
    assert "no loop 999" in refused("edit", made, "-o", other, "--undo-loop", "999")
    assert "nothing of the map lies there" in refused("edit", made, "-o", other, "--crop", "90,90,99,99")
    assert "--no-go 1,1,2: expected 6 numbers or more" in refused("edit", made, "-o", other, "--no-go", "1,1,2")
    made.with_suffix(".graph").unlink()
    assert "no such file" in refused("edit", made, "-o", other, "--undo-loop", "1")


def test_a_scan_is_turned_back_by_what_the_robot_turned_while_it_lasted() -> None:
    """A robot on the spot turns by 1 rad/s while its scanner needs 40 ms: ignored, bearings err by 2.3 degrees."""
    lasting, rate = 0.04, 1.0
    share = np.arange(len(ANGLES)) / (len(ANGLES) - 1)
    ranges = np.array(
        [
            seen(OFFICE, np.array([0.0, 0.0, rate * lasting * (part - 0.5)]), ANGLES[k : k + 1])[0]
            for k, part in enumerate(share)
        ]
    )
    value = Scan(
        source="front",
        time=1.0,
        beam_time=lasting / (len(ANGLES) - 1),
        start_angle=float(ANGLES[0]),
        increment=float(ANGLES[1] - ANGLES[0]),
        ranges=(1000 * ranges).round().astype("<u2").tobytes(),
    )
    way = deque((0.02 * k, np.array([0.0, 0.0, rate * (0.02 * k - 1.02)])) for k in range(60))
    reading = _reading(value, way, SETTINGS, ScannerPlace())
    assert reading.odometry == pytest.approx([0, 0, 0], abs=1e-9)
    assert reading.time == pytest.approx(1.02)
    assert reading.points is not None
    at_once = seen(OFFICE, np.zeros(3), np.arctan2(reading.points[:, 1], reading.points[:, 0]))
    assert np.abs(np.hypot(*reading.points[:, :2].T) - at_once).max() < 0.002
