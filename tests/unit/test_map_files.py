"""Maps as files: what is written is read again, what others write is read, what is damaged is refused where it is."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from office import OFFICE

from artemis.errors import ConfigError
from artemis.mapping.graph_file import MapGraph, read_graph
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.map_file import map_files, read_map, read_pgm
from artemis.mapping.mapper import Mapper
from artemis.mapping.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap, occupancy
from artemis.mapping.se2 import compose
from artemis.whole_files import write_bytes
from artemis_lab.bench.laser_worlds import SETTINGS, driven, readings

YAML = "image: m.pgm\nresolution: 0.1\norigin: [-1, -2, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
CELLS = np.array([[-1, 0, 100], [0, 0, -1]], np.int8)


def placed(folder: Path, yaml: str, pgm: bytes) -> Path:
    (folder / "m.yaml").write_text(yaml)
    (folder / "m.pgm").write_bytes(pgm)
    return folder / "m.yaml"


@given(rows=st.integers(1, 20), columns=st.integers(1, 20), seed=st.integers(0, 1000), x=st.floats(-1e3, 1e3))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_written_map_is_read_again(tmp_path: Path, rows: int, columns: int, seed: int, x: float) -> None:
    cells = np.random.default_rng(seed).choice(np.array([UNKNOWN, FREE, OCCUPIED], np.int8), (rows, columns))
    path = tmp_path / "map.yaml"
    write_bytes(map_files(path, OccupancyMap(cells=cells, resolution=0.05, origin=(x, -2.25, 0.5))))
    again = read_map(path)
    assert np.array_equal(again.cells, cells)
    assert again.resolution == 0.05
    assert again.origin == pytest.approx((x, -2.25, 0.5))


def test_the_written_files_are_those_of_the_savers(tmp_path: Path) -> None:
    files = map_files(tmp_path / "hall.yaml", OccupancyMap(cells=CELLS, resolution=0.05, origin=(-1.5, 2.0, 0.0)))
    assert files[tmp_path / "hall.pgm"] == b"P5\n# artemis 0.050 m/pix\n3 2\n255\n\xfe\xfe\xcd\xcd\xfe\x00"
    assert files[tmp_path / "hall.yaml"].decode() == (
        "image: hall.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def test_image_programs_read_what_map_server_makes_cells_of(tmp_path: Path) -> None:
    """By Pillow and PyYAML, and map_server's rule (wiki.ros.org/map_server): the first row has the highest y."""
    image = pytest.importorskip("PIL.Image", reason="Pillow comes with the extra figures")
    write_bytes(map_files(tmp_path / "hall.yaml", OccupancyMap(cells=CELLS, resolution=0.05, origin=(0.0, 0.0, 0.0))))
    facts = yaml.safe_load((tmp_path / "hall.yaml").read_text())
    with image.open(tmp_path / facts["image"]) as opened:
        assert (opened.format, opened.mode, opened.size) == ("PPM", "L", (3, 2))
        occupied = (255 - np.asarray(opened)[::-1].astype(float)) / 255
    assert not facts["negate"]
    cells = np.select([occupied > facts["occupied_thresh"], occupied < facts["free_thresh"]], [100, 0], -1)
    assert np.array_equal(cells, CELLS)


@pytest.mark.parametrize(
    "pgm", [b"P5 # c\n3 #d\n2\n# e\n255\n\xfe\xfe\xcd\xcd\xfe\x00", b"P2\n3 2 255\n254 254 205\n# x\n205 254 0\n"]
)
def test_text_bytes_and_comments_are_read(tmp_path: Path, pgm: bytes) -> None:
    assert np.array_equal(read_map(placed(tmp_path, YAML, pgm)).cells, CELLS)


@pytest.mark.parametrize("end", [b"\n", b" \r\n", b"\n\n\n\n"])
def test_a_line_end_behind_the_pixels_is_none(end: bytes) -> None:
    assert read_pgm(b"P5 3 2 255 \xfe\xfe\xcd\xcd\xfe\x00" + end, "x").tolist() == [[254, 254, 205], [205, 254, 0]]


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ("", [0, -1, -1, 100]),
        ("mode: trinary\n", [0, -1, -1, 100]),
        ("mode: scale\n", [0, 2, 91, 100]),
        ("mode: raw\n", [-1, -1, 100, 0]),
    ],
)
def test_every_mode_is_read(tmp_path: Path, extra: str, expected: list[int]) -> None:
    pgm = b"P2 4 1 255 254 203 100 0"
    assert read_map(placed(tmp_path, YAML + extra, pgm)).cells[0].tolist() == expected
    negated = YAML.replace("negate: 0", "negate: 1") + extra
    turned = b"P2 4 1 255 1 52 155 255"
    assert read_map(placed(tmp_path, negated, turned)).cells[0].tolist() == expected


def test_a_map_whose_unknown_cells_would_be_free_is_refused(tmp_path: Path) -> None:
    wide = YAML.replace("0.196", "0.25")
    negated = wide.replace("negate: 0", "negate: 1")
    for text, pgm in ((wide, b"P2 3 1 255 254 205 0"), (negated, b"P2 3 1 255 1 50 255")):
        with pytest.raises(ConfigError) as caught:
            read_map(placed(tmp_path, text, pgm))
        assert "m.yaml:6:1: free_thresh: 0.25 makes free what savers write for unknown" in str(caught.value)
        assert "1 of 3 cells" in str(caught.value)
        assert "write free_thresh: 0.196" in str(caught.value)


@pytest.mark.parametrize(("mode", "grey"), [("trinary", 254), ("scale", 205)])
def test_a_wide_threshold_is_no_error_without_unknown_cells(tmp_path: Path, mode: str, grey: int) -> None:
    yaml = YAML.replace("0.196", "0.25") + f"mode: {mode}\n"
    assert read_map(placed(tmp_path, yaml, f"P2 2 1 255 {grey} 0".encode())).cells[0].tolist() == [0, 100]


@pytest.mark.parametrize("text", ["{}\n", "- 1\n", "zones: []\nplaces: {}\n", "robot: x\n"])
def test_another_file_than_a_maps_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_map(tmp_path / "m.yaml")
    (problem,) = refused.value.problems
    assert problem.startswith(f"{tmp_path / 'm.yaml'}:1:1: expected image, resolution, origin")
    assert problem.endswith("; is it the YAML file of a map?")


def test_a_map_with_fewer_greys_is_read() -> None:
    assert read_pgm(b"P2 3 1 15 0 7 15", "x").tolist() == [[0, 119, 255]]


@pytest.mark.parametrize(
    ("yaml", "pgm", "problem"),
    [
        (YAML + "colour: 1\n", b"", "m.yaml:7:1: colour: unknown key"),
        (
            YAML.replace("resolution: 0.1", "resolution: -1"),
            b"",
            "m.yaml:2:1: resolution: expected a number from 0.0001 to 100, not -1",
        ),
        (YAML.replace("-2, 0", "-2"), b"", "m.yaml:3:1: origin: expected [x, y, yaw], not [-1, -2]"),
        (YAML + "mode: grey\n", b"", "m.yaml:7:1: mode: expected trinary, scale, raw, not 'grey'"),
        (YAML.replace("negate: 0", "negate: 2"), b"", "m.yaml:4:1: negate: expected 0 or 1, not 2"),
        (YAML.replace("0.196", "0.9"), b"", "free_thresh: is above occupied_thresh"),
        (YAML.replace("image: m.pgm\n", ""), b"", "m.yaml:1:1: image: this key is missing"),
        (YAML.replace("m.pgm", "3"), b"", "m.yaml:1:1: image: expected the name of a PGM file, not 3"),
        (YAML.replace("resolution: 0.1\n", ""), b"", "m.yaml:1:1: resolution: this key is missing"),
        (YAML.replace("origin: [-1, -2, 0]\n", ""), b"", "m.yaml:1:1: origin: this key is missing"),
        (YAML.replace("free_thresh: 0.196\n", ""), b"", "m.yaml:1:1: free_thresh: this key is missing"),
        (YAML.replace("0.65", ""), b"", "m.yaml:5:1: occupied_thresh: expected a number from 0 to 1, not nothing"),
        (YAML, b"\x89PNG\r\n", "m.pgm:1: begins with b'\\x89PNG'; expected a PGM image (P2 or P5) of 8 bits: "),
        (YAML, b"\x89PNG\r\n", "`convert m.pgm -depth 8 NEW.pgm` (ImageMagick; from version 7: `magick`) writes one"),
        (YAML, b"P5\n3 ", "m.pgm:2: ends in its header"),
        (YAML, b"P5\n3 x 255\n", "m.pgm:2: expected width, height and the highest value"),
        (YAML, b"P5\n3 2 65535\n", "m.pgm:2: its highest value is 65535; expected a PGM image (P2 or P5) of 8 bits: `"),
        (YAML, b"P5\n3 2 0\n", "m.pgm:2: its highest value is 0; expected 1 to 255"),
        (YAML, b"P5\n3 2 70000\n", "m.pgm:2: its highest value is 70000; expected 1 to 255"),
        (YAML, b"P5\n0 0\n255\n", "m.pgm:3: 0 x 0 pixels; expected 1 x 1 at least"),
        (YAML, b"P5\n-5 5\n255\n", "m.pgm:3: -5 x 5 pixels; expected 1 x 1 at least"),
        (YAML, b"P5\n99999 99999\n255\n", "m.pgm:3: 99999 x 99999 pixels; expected 100000000 at most"),
        (YAML, b"P5\n3 2 255\n\x00\x00", "m.pgm: cut off: 2 of 6 pixels"),
        (YAML, b"P2\n3 2 15\n1 2 3 4 5 77\n", "m.pgm: a pixel of 77; the header says 0 to 15"),
        (YAML, b"P5\n3 2 255\n" + 10 * b"\xfe", "m.pgm: 10 pixels instead of 3 x 2: are width and height"),
        (YAML, b"P5\n3 2 255\n" + 6 * b"\xfe" + 5 * b"\n", "m.pgm: 11 pixels instead of 3 x 2"),
        (YAML, b"P2\n3 2 255\n1 2 3 4 5 6 7 8\n", "m.pgm: 8 pixels instead of 3 x 2"),
        (YAML, b"P2\n3 2 255\n1 2 3 4 5 99999999999999999999999\n", "m.pgm: a pixel of 99999999999999999999999; the"),
        (YAML, b"P2\n3 2 255\n1 -9 3 4 5 6\n", "m.pgm: a pixel of -9; the header says 0 to 255"),
        (YAML, b"P2\n3 2 255\n1 2 3 99999999999999999999999 x 6\n", "m.pgm:2: pixels that are no numbers follow"),
        (YAML, b"P2\n3 2 15\n1 2 3 x 5 7\n", "m.pgm:2: pixels that are no numbers follow"),
    ],
)
def test_a_damaged_map_is_refused_where_it_is(tmp_path: Path, yaml: str, pgm: bytes, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_map(placed(tmp_path, yaml, pgm))
    assert problem in str(caught.value)


def test_files_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").mkdir()
    with pytest.raises(ConfigError, match="cannot be written"):
        write_bytes({tmp_path / "none" / "a.pgm": b"1", tmp_path / "c.yaml": b"2"})
    assert [file.name for file in tmp_path.iterdir()] == ["b.yaml"]


def test_a_map_is_rotated_cropped_and_closed() -> None:
    cells = np.zeros((20, 40), np.int8)
    cells[5, 30] = OCCUPIED
    old = OccupancyMap(cells=cells, resolution=0.1, origin=(1.0, 2.0, 0.0))
    (point,) = old.points()
    assert point == pytest.approx([4.05, 2.55])
    turned = old.rotated(np.pi / 2)
    assert turned.cells.shape == (40, 20)
    assert turned.points()[0] == pytest.approx([-2.55, 4.05], abs=0.051)
    cut = old.cropped((3.5, 2.0), (4.5, 3.0))
    assert cut.points()[0] == pytest.approx(point)
    assert cut.cells.shape == (11, 11)
    with pytest.raises(ValueError, match="nothing"):
        old.cropped((50, 50), (60, 60))
    with pytest.raises(ValueError, match="nothing of the map lies there"):
        old.closed([(50.0, 50.0), (60.0, 50.0), (60.0, 60.0)])
    zone = old.closed([(1.0, 2.0), (2.0, 2.0), (2.0, 3.0), (1.0, 3.0)])
    assert (zone.cells == OCCUPIED).sum() == 101
    assert (zone.cells[:10, :10] == OCCUPIED).all()


def turned_at_once(old: OccupancyMap, angle: float) -> NDArray[np.int8]:
    """Its cells, by the middles of all new cells at the same time."""
    height, width = old.cells.shape
    corners = np.array([(0, 0, 0), (width, 0, 0), (width, height, 0), (0, height, 0)]) * old.resolution
    placed = compose(compose([0.0, 0.0, angle], old.origin), corners)[:, :2]
    low, high = placed.min(0), placed.max(0)
    columns, rows = np.ceil((high - low) / old.resolution - 1e-9).astype(int)
    row, column = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    centres = np.stack([low[0] + (column + 0.5) * old.resolution, low[1] + (row + 0.5) * old.resolution], 1)
    row, column = old.cell_of(compose([0.0, 0.0, -angle], np.c_[centres, np.zeros(len(centres))])[:, :2])
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    cells = np.full(len(row), UNKNOWN, np.int8)
    cells[inside] = old.cells[row[inside], column[inside]]
    return cells.reshape(rows, columns)


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2, -2.0])
def test_a_map_is_rotated_piece_by_piece_as_all_at_once(angle: float) -> None:
    cells = np.random.default_rng(1).choice(np.array([UNKNOWN, FREE, OCCUPIED], np.int8), (500, 700))
    old = OccupancyMap(cells=cells, resolution=0.05, origin=(-3.013, 7.7, 0.2))
    assert np.array_equal(old.rotated(angle).cells, turned_at_once(old, angle))


def test_a_large_map_is_rotated_in_little_memory() -> None:
    old = OccupancyMap(cells=np.zeros((1500, 2000), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    tracemalloc.start()
    try:
        turned = old.rotated(np.pi / 2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert turned.cells.shape == (2000, 1500)
    assert peak < 3e6 + 40e6, "the new map, and what a piece of it takes"


def test_a_map_that_would_be_too_large_is_not_rotated() -> None:
    old = OccupancyMap(cells=np.zeros((8000, 8000), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="11314 x 11314 cells; a map has 100000000 at most"):
        old.rotated(np.pi / 4)


def test_a_graph_is_kept_with_its_map(tmp_path: Path) -> None:
    mapper = Mapper(SETTINGS)
    for reading in readings(OFFICE, driven([(-2, -3), (0, -3), (0, 1)]), None):
        mapper.add(reading)
    mapper.finish()
    times, poses = mapper.trajectory()
    kept = MapGraph(mapper.keys, mapper.graph, np.c_[times, poses])
    path = tmp_path / "m.graph"
    path.write_bytes(kept.packed())
    again = read_graph(path)
    assert np.array_equal(again.keys.poses, mapper.keys.poses)
    assert again.graph.links.keys() == mapper.graph.links.keys()
    assert np.array_equal(again.trajectory, kept.trajectory)
    assert again.packed() == path.read_bytes()
    made, remade = (occupancy(each) for each in (mapper.keys, again.keys))
    assert (made.cells != remade.cells).mean() < 1e-3
    assert OCCUPIED in made.cells
    again.turned(0.5)
    assert again.keys.poses[:, 2] == pytest.approx((mapper.keys.poses[:, 2] + 0.5 + np.pi) % (2 * np.pi) - np.pi)
    for damaged in (b"", b"\x93\x01", path.read_bytes()[:-9], b"P5"):
        path.write_bytes(damaged)
        with pytest.raises(ConfigError, match=r"m\.graph: "):
            read_graph(path)


def test_a_map_of_nothing_is_refused() -> None:
    for points, problem in (
        (np.empty((0, 4)), "no scan has a point"),
        (np.full((1, 4), 1e5), "over 100002 x 100002"),
    ):
        keys = KeyScans()
        keys.append(points, np.zeros(3), np.zeros(2))
        with pytest.raises(ValueError, match=problem):
            occupancy(keys)
