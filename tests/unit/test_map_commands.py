"""`artemis map`: built of a log or a run, shown, edited; what cannot be is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
from map_command import call, refused
from office import OFFICE

from artemis.commands import map_edit
from artemis.commands.map_files import write_map
from artemis.commands.map_kept import painted, say_moved
from artemis.commands.path_record import MapTrajectory
from artemis.errors import ConfigError
from artemis.mapping.graph_file import read_graph
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OCCUPIED, OccupancyMap, occupancy
from artemis.mapping.se2 import Array, between
from artemis.route_planning.zones import MapZones
from artemis_lab.bench.laser_worlds import driven, odometry, seen, walls

DRIVE = driven([(-2, -3), (0, -3), (0, 1), (0, -3), (-2, -3)], 0.25)


def written(file: Path, way: Array, scale: float, world: Array = OFFICE) -> Path:
    """A log of a drive whose wheels count so much of each step."""
    half = np.radians(np.arange(-90, 90))
    counted = odometry(way, [scale] * (len(way) - 1))
    with file.open("w") as out:
        for number, (pose, wheels) in enumerate(zip(way, counted, strict=True)):
            ranges = " ".join(f"{each:.3f}" for each in seen(world, pose, half))
            x, y, heading = wheels
            out.write(f"FLASER 180 {ranges} 0 0 0 {x:.4f} {y:.4f} {heading:.5f} {0.1 * number:.2f} host 0\n")
    return file


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("log") / "office.clf", DRIVE, 0.95)


@pytest.fixture(scope="module")
def built(log: Path) -> Path:
    """A map of it."""
    made = log.parent / "begun.yaml"
    call("build", log, "-o", made)
    return made


@pytest.fixture
def begun(built: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    for suffix in (".yaml", ".pgm", ".graph"):
        copy(built.with_suffix(suffix), tmp_path)
    return tmp_path / built.name


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
    assert "notice" not in call("edit", made, "-o", edited, *edits)
    assert number not in read_graph(edited.with_suffix(".graph")).graph.loops
    cells = read_map(edited)
    rows, columns = cells.cell_of(np.array([[1.5, 1.5]]))
    assert cells.cells[rows[0], columns[0]] == OCCUPIED
    again = call("edit", edited, "-o", tmp_path / "again.yaml", "--undo-loop", str([each for each in loops][1]))
    assert "was edited by hand, or only rotated by an earlier version (then nothing is lost)" in again
    assert ": the image is drawn again from its graph, without that" in again
    edited.with_suffix(".graph").unlink()
    assert "none: there is no edited.graph" in call("show", edited, "-o", tmp_path / "b.svg")


def test_the_graph_of_a_map_knows_where_the_robot_was(begun: Path, tmp_path: Path) -> None:
    by_map = MapTrajectory(begun)
    count = len(DRIVE) // 2
    middle = by_map.at(0.1 * count)
    assert middle is not None
    true = between(DRIVE[0], DRIVE[count])  # the map begins where the robot did
    assert (middle.x, middle.y) == pytest.approx(true[:2], abs=0.03)
    assert by_map.at(-1.0) is None
    assert by_map.at(1e3) is None
    with pytest.raises(ConfigError, match="knows where the robot was"):
        MapTrajectory(tmp_path / "other.yaml")


def test_two_runs_make_one_map(log: Path, tmp_path: Path) -> None:
    call("build", log, log, "-o", tmp_path / "two.yaml", "--without-odometry")
    assert len(read_graph(tmp_path / "two.graph").trajectory) == 2 * len(DRIVE)


def test_a_further_run_may_begin_anywhere_on_the_map(log: Path, tmp_path: Path) -> None:
    """It begins elsewhere than the first one ended, and looks the other way."""
    way = driven([(0, 0), (0, 1), (0, -2)], 0.25)
    told = call("build", log, written(tmp_path / "b.clf", way, 1.0), "-o", tmp_path / "two.yaml")
    assert "b.clf: begins 3.5 m from where the one before ended" in told
    true = np.concatenate([DRIVE, way])
    off = between(between(true[0], true), read_graph(tmp_path / "two.graph").trajectory[:, 1:])
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1


def test_a_further_run_from_elsewhere_is_refused(log: Path, tmp_path: Path) -> None:
    tent = walls([(-2, -1), (7, -2), (3, 4), (-2, -1)])
    elsewhere = written(tmp_path / "e.clf", driven([(0, 0), (3, 0)], 0.25), 1.0, tent)
    said = refused("build", log, elsewhere, "-o", tmp_path / "two.yaml")
    assert "e.clf: its first scans fit neither where the run before ended nor" in said
    assert "name the runs in an order in which each begins where those before have been" in said
    assert not (tmp_path / "two.yaml").exists()


def test_what_cannot_be_is_refused(log: Path, begun: Path, tmp_path: Path) -> None:
    assert "name the map .yaml" in refused("build", log, "-o", tmp_path / "m.png")
    assert "expected 0.005 to 1 m" in refused("build", log, "-o", tmp_path / "m.yaml", "--resolution", "7")
    assert "cannot be read" in refused("build", tmp_path / "none.clf", "-o", tmp_path / "m.yaml")
    (tmp_path / "empty.clf").write_text("# nothing\n")
    assert "no scan has a point" in refused("build", tmp_path / "empty.clf", "-o", tmp_path / "m.yaml")
    assert "exists already" in refused("build", log, "-o", begun)
    zones = tmp_path / "new.zones.yaml"
    zones.write_text("places: {}\n")
    assert "new.zones.yaml: exists already" in refused("build", log, "-o", tmp_path / "new.yaml")
    told = call("build", log, "-o", tmp_path / "new.yaml", "--force")
    assert "new.zones.yaml stays: its zones and places count on the new map" in told
    assert "name it .png" in refused("show", begun, "-o", tmp_path / "m.txt")
    other = tmp_path / "n.yaml"
    assert "no loop 999" in refused("edit", begun, "-o", other, "--undo-loop", "999")
    assert "nothing of the map lies there" in refused("edit", begun, "-o", other, "--crop", "90,90,99,99")
    away = "100,100,200,200,300,100"
    assert f"--no-go {away}: nothing of the map lies there" in refused("edit", begun, "-o", other, "--no-go", away)
    assert "-1e+300 is farther than 1e+06 m" in refused("edit", begun, "-o", other, "--crop=-1e300,-1,1e300,1")
    assert "1e+09 is farther than 1e+06 m" in refused("edit", begun, "-o", other, "--no-go", "1e9,0,0,1,1,1")
    assert not other.exists()
    assert "expected two opposite corners" in refused("edit", begun, "-o", other, "--crop", "1,1,1,5")
    assert "is an image: name the YAML file" in refused("show", begun.with_suffix(".pgm"))
    assert "--no-go 1,1,2: expected 6 numbers or more" in refused("edit", begun, "-o", other, "--no-go", "1,1,2")
    begun.with_suffix(".graph").unlink()
    assert "no such file" in refused("edit", begun, "-o", other, "--undo-loop", "1")


def test_a_map_that_would_be_too_large_is_not_rotated(tmp_path: Path) -> None:
    large, other = tmp_path / "large.yaml", tmp_path / "other.yaml"
    write_map(large, OccupancyMap(cells=np.zeros((1, 20_000), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0)), None)
    said = refused("edit", large, "-o", other, "--rotate", "45")
    assert "--rotate 45: 14143 x 14143 cells; a map has 100000000 at most" in said
    assert not other.exists()


@pytest.mark.slow
def test_a_map_is_gone_on_with(begun: Path, tmp_path: Path) -> None:
    """The second run begins in the middle of the map, drives where the first was, and on into another room."""
    more = tmp_path / "more.yaml"
    further = driven([(0, 0.5), (0, 1.0), (0, 4.0), (3, 4.5), (0, 4), (0, 0)], 0.25)
    second = written(tmp_path / "second.clf", further, 1.05)
    call("build", second, "--continue", begun, "-o", more)
    old, new = read_graph(begun.with_suffix(".graph")), read_graph(more.with_suffix(".graph"))
    assert len(new.keys) > len(old.keys) + 5
    assert len(new.trajectory) == len(DRIVE) + len(further)
    across = [each for each in new.graph.loops.values() if each.first < len(old.keys) <= each.second]
    assert len(across) > 3
    true = np.concatenate([DRIVE, further])
    off = between(between(true[0], true), new.trajectory[:, 1:])
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    again = tmp_path / "again.yaml"
    call("build", second, "--continue", begun, "-o", again)
    assert again.with_suffix(".graph").read_bytes() == more.with_suffix(".graph").read_bytes()


ZONES = """# by the caretaker
zones:
  - {name: stairs, kind: keep-out, corners: [[1, 1], [2, 1], [2, 2]]}
places:
  dock: {x_m: 1, y_m: 0, heading_deg: 0}
"""


def test_zones_and_places_go_with_a_map_that_is_continued(log: Path, begun: Path, tmp_path: Path) -> None:
    more = tmp_path / "more.yaml"
    (tmp_path / "begun.zones.yaml").write_text(ZONES)
    told = call("build", log, "--continue", begun, "-o", more)
    assert (tmp_path / "more.zones.yaml").read_text() == ZONES
    assert "more.zones.yaml: 1 zones, 1 places" in told
    assert "the walls around it moved" not in told
    (tmp_path / "begun.zones.yaml").unlink()
    told = call("build", log, "--continue", begun, "-o", more, "--force")
    assert "more.zones.yaml: removed, as" in told
    (tmp_path / "begun.zones.yaml").write_text("zones: 1\n")
    assert "begun.zones.yaml:1:1: zones" in refused("build", log, "--continue", begun, "-o", tmp_path / "third.yaml")


def test_painted_areas_are_not_lost_unasked(log: Path, begun: Path, tmp_path: Path) -> None:
    shut, more = (tmp_path / f"{name}.yaml" for name in ("shut", "more"))
    call("edit", begun, "-o", tmp_path / "turned.yaml", "--rotate", "30")
    call("build", log, "--continue", tmp_path / "turned.yaml", "-o", tmp_path / "on.yaml")  # drawn anew: not painted
    call("edit", begun, "-o", shut, "--no-go", "1,1,2,1,2,2,1,2")
    assert "were edited by hand: the image is drawn again from its graph, without that" in (
        said := refused("build", log, "--continue", shut, "-o", more)
    )
    assert said.endswith("; with --force it is continued, and what was edited is lost")
    assert not more.exists()
    assert "were edited by hand" in call("build", log, "--continue", shut, "-o", more, "--force")


@pytest.mark.parametrize(
    ("places", "lost"),
    [
        ([(row, 5) for row in range(10, 29)], True),
        ([(10, 5), (11, 6), (10, 7)], True),
        ([(10, 5), (11, 5)], False),
        ([(3 * number, 5) for number in range(20)], False),
        ([(3 * number, 5) for number in range(21)], True),
    ],
    ids=["line", "corner", "pair", "few single ones", "many single ones"],
)
def test_single_cells_differ_by_rounding_and_lines_are_painted(
    built: Path, places: list[tuple[int, int]], lost: bool
) -> None:
    graph = read_graph(built.with_suffix(".graph"))
    drawn = occupancy(graph.keys)
    cells = drawn.cells.copy()
    cells[tuple(zip(*places, strict=True))] = OCCUPIED
    said = painted(Path("m.yaml"), replace(drawn, cells=cells), graph)
    assert said.startswith(f"{len(places)} cells of m.yaml were edited by hand" if lost else "")
    assert bool(said) is lost


def test_a_map_that_an_earlier_version_rotated_can_be_continued(log: Path, begun: Path, tmp_path: Path) -> None:
    """It turned the image cell by cell, and the graph."""
    turned, more = (tmp_path / f"{name}.yaml" for name in ("turned", "more"))
    graph = read_graph(begun.with_suffix(".graph"))
    graph.turned(0.5)
    write_map(turned, read_map(begun).rotated(0.5), graph)
    said = refused("build", log, "--continue", turned, "-o", more)
    assert "was edited by hand, or only rotated by an earlier version (then nothing is lost)" in said
    assert "with --force it is continued" in said
    call("build", log, "--continue", turned, "-o", more, "--force")


def test_who_moves_walls_says_which_zones_and_places_stay(capsys: pytest.CaptureFixture[str]) -> None:
    """The key scan beside the zone turns by 0.1 rad; the one beside the place goes by less than a cell."""
    slow = {"kind": "slow", "speed_m_s": 0.2, "corners": [[1, 0], [2, 0], [2, 1]]}
    known = MapZones.model_validate({"zones": [slow], "places": {"dock": {"x_m": 9, "y_m": 0, "heading_deg": 0}}})
    old = np.array([[0.0, 0.0, 0.0], [9.0, 1.0, 1.0]])
    say_moved(known, old, old + np.array([[0.0, 0.0, 0.1], [0.04, 0.0, 0.0]]), 0.05)
    far = 2 * np.sin(0.05) * np.hypot(2, 1)
    said = f"zone 1: the walls around it moved by {far:.2f} m, it stays: check it"
    assert capsys.readouterr().out.splitlines() == [f"{'notice':<12}{said}"]


def test_an_undone_loop_says_what_stays(begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "begun.zones.yaml").write_text(ZONES)
    moved: list[tuple[MapZones, float]] = []

    def note(known: MapZones, old: Array, new: Array, cell: float) -> None:
        moved.append((known, float(np.abs(new - old).max())))

    monkeypatch.setattr(map_edit, "say_moved", note)
    number = next(iter(read_graph(tmp_path / "begun.graph").graph.loops))
    call("edit", begun, "-o", tmp_path / "other.yaml", "--undo-loop", str(number), "--rotate", "90")
    ((known, most),) = moved
    assert list(known.places) == ["dock"]
    assert 0.0 < most < 0.1, "of the loop alone, not of the rotation"


def test_a_map_is_not_continued_from_elsewhere(log: Path, begun: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    tent = walls([(-2, -1), (7, -2), (3, 4), (-2, -1)])
    elsewhere = written(tmp_path / "e.clf", driven([(0, 0), (3, 0)], 0.25), 1.0, tent)
    assert "its first scans fit nowhere on" in refused("build", elsewhere, "--continue", begun, "-o", other)
    begun.with_suffix(".graph").unlink()
    assert "continued from its graph" in refused("build", log, "--continue", begun, "-o", other)
