"""Points from tables, GPX files and waypoints of ROS, and path files made of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from artemis.commands.path_formats import READERS, read_csv, read_gpx, read_nav2
from artemis.commands.path_import import import_path
from artemis.errors import ConfigError
from artemis.motion.path import path_from_csv
from artemis.motion.route import route_from_csv


def problems_of(kind: str, text: str | bytes) -> list[str]:
    raw = text if isinstance(text, bytes) else text.encode()
    with pytest.raises(ConfigError) as caught:
        READERS[kind](raw, "f")
    return caught.value.problems


# ---------------------------------------------------------------------------------------------- tables


@pytest.mark.parametrize(
    ("text", "heading"),
    [
        ("x,y\n0,0\n1,2\n", None),
        ("Y;X\n0;0\n2;1\n", None),
        ("x_m y_m yaw\n0 0 0.5\n1 2 1.5\n", [0.5, 1.5]),
        ("x\ty\ttheta_deg\n0\t0\t90\n1\t2\t-180\n", [math.pi / 2, -math.pi]),
        ("time, x, y, z, heading_rad\n7, 0, 0, 3, 0.5\n8, 1, 2, 3, 1.5\n", [0.5, 1.5]),
        ("\ufeff# made by hand\n0,0\n1,2\n", None),
    ],
)
def test_tables_are_read_with_any_separator_and_usual_names(text: str, heading: list[float] | None) -> None:
    given = read_csv(text.encode(), "f")
    assert (given.x.tolist(), given.y.tolist()) == ([0.0, 1.0], [0.0, 2.0])
    assert (given.heading is None) is (heading is None)
    if given.heading is not None and heading is not None:
        assert given.heading.tolist() == pytest.approx(heading)
    assert given.notes == (["not used: z, time"] if "time" in text else [])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "f:1:1: no rows: expected a line with the columns, such as x,y, and rows below it, such as 0,0.5"),
        ("x,y,colour\n0,0,1\n", "f:1:5: unknown column 'colour'"),
        ("x,y\n0,0\n1,zwei\n", "f:3:3: y: expected a finite number, found 'zwei'"),
        ("x,y\n0,0\n1,inf\n", "f:3:3: y: expected a finite number"),
        ("x,y\n0,0\n1\n", "f:3:1: expected 2 columns"),
        ("x,y,yaw,yaw_deg\n0,0,0,0\n", "f:1:1: a heading both in rad and in degrees"),
        ("0,0,0,0,0\n1,0,0,0,0\n", "f:1:1: 5 columns without names: write their names in a first line"),
        ("x,y,yaw,theta\n0,0,0,0\n", "f:1:9: second column for heading"),
        (b"x,y\n0,0\n1,\xff\n", "f:3:3: byte 0xff is not UTF-8"),
    ],
)
def test_what_is_no_table_of_points_is_refused_with_its_place(text: str | bytes, expected: str) -> None:
    assert problems_of("csv", text)[0].startswith(expected)


# ---------------------------------------------------------------------------------------------- GPX

GPX = '<?xml version="1.0"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>\n'


def track(*points: tuple[float, float], name: str = "trk") -> str:
    rows = "".join(f'\n<trkpt lat="{lat:.9f}" lon="{lon:.9f}"><ele>1</ele></trkpt>' for lat, lon in points)
    return f"<{name}><trkseg>{rows}</trkseg></{name}>"


def test_a_track_is_read_in_metres_to_east_and_north_of_its_first_point() -> None:
    given = read_gpx(GPX.format(track((45.0, 10.0), (45.001, 10.0), (45.001, 10.001))).encode(), "f")
    assert given.x.tolist() == pytest.approx([0.0, 0.0, 78.847], abs=1e-3)
    assert given.y.tolist() == pytest.approx([0.0, 111.132, 111.132], abs=1e-3)
    assert given.places == ["f:3:1", "f:4:1", "f:5:1"]
    assert "45.0000000, 10.0000000" in given.notes[0]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_gpx_is_read_in_the_encoding_it_declares(encoding: str) -> None:
    text = GPX.replace('"1.0"?', f'"1.0" encoding="{encoding}"?').format("<!-- ü -->" + track((1.0, 2.0), (1.1, 2.0)))
    assert len(read_gpx(text.encode(encoding), "f").x) == 2


def test_segments_are_joined_and_routes_stand_in_for_tracks() -> None:
    two = "<trk>" + track((1, 2), (1.1, 2), name="x")[3:-4] + track((1.2, 2), name="y")[3:-4] + "</trk>"
    given = read_gpx(GPX.format(two).encode(), "f")
    assert len(given.x) == 3
    assert given.notes[1] == "2 segments were joined; the widest gap is 11057.46 m (f:5:1)"
    route = '<rte><rtept lat="1" lon="2"/><rtept lat="1.1" lon="2"/></rte>'
    assert len(read_gpx(GPX.format(route).encode(), "f").x) == 2
    assert len(read_gpx(GPX.format(route + track((5, 5))).encode(), "f").x) == 1


BOMB = '<!DOCTYPE gpx [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>\n<gpx>&b;</gpx>'
OUTSIDE = '<!DOCTYPE gpx SYSTEM "file:///etc/passwd"><gpx/>'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "f:1:1: not XML"),
        ("x,y\n0,0\n", "f:1:1: not XML"),
        ("<gpx>\n<trk></gpx>", "f:2:8: not XML: mismatched tag"),
        ("<kml>\n</kml>", "f:1:1: expected a GPX file"),
        (BOMB, "f:1:15: a document type (<!DOCTYPE) is refused"),
        (BOMB.encode("utf-16"), "f:1:"),
        (OUTSIDE, "f:1:42: a document type (<!DOCTYPE) is refused"),
        ('<?xml version="1.0" encoding="no-such"?><gpx/>', "f:1:"),
        ("<gpx></gpx>", "f:1:1: no track, no route and no waypoints"),
        (GPX.format('\n<trk><trkseg><trkpt lat="1" /></trkseg></trk>'), "f:3:14: lon: expected -180 to 180 de"),
        (GPX.format('\n<trk><trkseg><trkpt lat="north" lon="1"/></trkseg></trk>'), "f:3:14: lat: expected -90 to 90"),
        (GPX.format('<trk><trkpt lat="91" lon="1"/></trk>'), "f:2:67: lat: expected -90 to 90 degrees, found '91'"),
        (GPX.format('<trk><trkpt lat="nan" lon="1"/></trk>'), "f:2:67: lat: expected -90 to 90 degrees, found 'nan'"),
        (GPX.format(track((1, 2)) + track((1, 2))), "f:1:1: 2 tracks"),
    ],
)  # fmt: skip
def test_what_is_no_track_is_refused_with_its_place(text: str | bytes, expected: str) -> None:
    found = problems_of("gpx", text)
    assert found[0].startswith(expected), found


def test_a_track_full_of_errors_gives_a_short_message() -> None:
    found = problems_of("gpx", GPX.format('<trkpt lat="" lon=""/>' * 500))
    assert len(found) == 21
    assert "980 more problems" in found[-1]


# ---------------------------------------------------------------------------------------------- waypoints of ROS

POSES = [
    "- {position: {x: 0, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: 1}}",
    "- {position: {x: 3, y: 1.5, z: 0}, orientation: {x: 0, y: 0, z: 0.70710678, w: 0.70710678}}",
]
STAMPED = """waypoints:
  - header: {frame_id: map, stamp: {sec: 1}}
    pose:
      position: {x: 0.0, y: 0.0}
      orientation: {yaw: 0.0}
  - pose:
      position: {x: 3.0, y: 1.5}
      orientation: {yaw: 1.5707963}
"""


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(POSES),
        "\n".join(["header: {frame_id: map}", "poses:", *POSES]),
        STAMPED,
        "- {x: 0, y: 0, yaw: 0}\n- {x: 3, y: 1.5, yaw: 1.5707963}\n",
        "poses: [{position: {x: 0, y: 0}, yaw: 0.0}, {position: {x: 3, y: 1.5}, yaw: 1.5707963}]\n",
    ],
)
def test_poses_are_read_in_every_usual_form(text: str) -> None:
    given = read_nav2(text.encode(), "f")
    assert (given.x.tolist(), given.y.tolist()) == ([0.0, 3.0], [0.0, 1.5])
    assert given.heading is not None
    assert given.heading.tolist() == pytest.approx([0.0, math.pi / 2])
    assert given.notes == (["not used: header"] if "header" in text else [])


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 0.4, 2.5])
def test_a_quaternion_is_a_yaw_also_on_a_slope(yaw: float) -> None:
    pitch = 0.2  # first turned about z, then about the new y
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    orientation = f"{{x: {-sy * sp:.9f}, y: {cy * sp:.9f}, z: {sy * cp:.9f}, w: {cy * cp:.9f}}}"
    given = read_nav2(f"- {{position: {{x: 0, y: 0}}, orientation: {orientation}}}".encode(), "f")
    assert given.heading is not None
    assert given.heading[0] == pytest.approx(yaw)


def test_orientations_that_nobody_filled_in_are_none() -> None:
    empty = "- {position: {x: 0, y: 0}, orientation: {x: 0, y: 0, z: 0, w: 0}}\n"
    assert read_nav2(empty.encode() * 2, "f").heading is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "f:1:1: expected keys and values, found None"),
        ("3", "f:1:1: expected keys and values, found 3"),
        ("poses:\n", "f:1:1: poses: expected a list of poses, found None"),
        ("poses: []\n", "f:1:1: no poses"),
        ("map: {}\n", "f:1:1: map: unknown key; known are poses, waypoints"),
        ("poses: []\nwaypoints: []\n", "f:1:1: expected a list of poses, under"),
        ("- {x: 0}\n", "f:1:3: [0].y: expected a number, found none"),
        ("- {x: 0, y: true}\n", "f:1:10: [0].y: expected a number, found True"),
        ("- {x: 0, y: 1e300}\n", "f:1:10: [0].y: expected a number"),
        ("- {x: 0, y: .nan}\n", "f:1:10: [0].y: expected a finite number, found .nan"),
        ("- {position: {x: 0, y: 0}, orientation: {x: 0, y: 0, z: 0, w: 7}}\n", "f:1:28: [0].orientation: expected a"),
        ("- {position: {x: 0, y: 0}, orientation: {z: 0}}\n", "f:1:28: [0].orientation.w: expected"),
        ("- {position: {x: 0, y: 0}, yaw: 0, orientation: {yaw: 0}}\n", "f:1:28: [0].yaw: a yaw and an orientation"),
        ("- {position: [0, 0]}\n", "f:1:4: [0].position: expected keys and values"),
        ("- {pose: 3}\n", "f:1:4: [0].pose: expected keys and values, found 3"),
        ("- {x: 0, y: 0, yaw: 0}\n- {x: 1, y: 0}\n", "f:2:3: [1]: no orientation, but other poses have one"),
        ("- {x: 0, y: 0, speed: 0}\n", "f:1:16: [0].speed: unknown key"),
        ("- a: [\n", "f:2:1: not YAML"),
    ],
)  # fmt: skip
def test_what_are_no_poses_is_refused_with_its_place(text: str, expected: str) -> None:
    found = problems_of("nav2", text)
    assert found[0].startswith(expected), found


# ---------------------------------------------------------------------------------------------- import


def imported(tmp_path: Path, text: str, name: str = "in.csv", **options: bool) -> str:
    (tmp_path / name).write_text(text)
    import_path(tmp_path / name, tmp_path / "out.csv", None, force=True, **options)
    return (tmp_path / "out.csv").read_text()


LINE = "x,y,speed\n" + "".join(f"{0.5 * i},0,{0.2 + 0.02 * i}\n" for i in range(9))


def test_an_imported_table_is_the_same_way(tmp_path: Path) -> None:
    path = path_from_csv(imported(tmp_path, LINE), "out.csv")
    assert path.length == pytest.approx(4.0)
    assert np.abs(path.y).max() < 1e-9
    assert path.speed is None


def test_what_was_imported_is_imported_again_as_it_is(tmp_path: Path) -> None:
    wave = "x,y\n" + "".join(f"{0.1 * i},{math.sin(0.1 * i)}\n" for i in range(80))
    once = path_from_csv(imported(tmp_path, wave), "out.csv")
    again = path_from_csv(imported(tmp_path, (tmp_path / "out.csv").read_text()), "out.csv")
    assert again.length == pytest.approx(once.length, abs=1e-3)
    assert np.abs(np.interp(once.x, again.x, again.y) - once.y).max() < 1e-3


def test_speeds_are_kept_when_asked_and_turn_with_the_path(tmp_path: Path) -> None:
    path = path_from_csv(imported(tmp_path, LINE, with_speed=True), "out.csv")
    assert (path.speed_at(0.0), path.speed_at(4.0)) == pytest.approx((0.2, 0.36), abs=0.003)
    path = path_from_csv(imported(tmp_path, LINE, with_speed=True, reverse=True), "out.csv")
    assert (path.speed_at(0.0), path.speed_at(4.0)) == pytest.approx((0.36, 0.2), abs=0.003)
    assert (path.x[0], path.x[-1]) == pytest.approx((4.0, 0.0))


def test_a_path_is_moved_to_where_a_run_begins(tmp_path: Path) -> None:
    bend = "x,y\n" + "".join(f"{5 + math.sin(0.1 * i)},{3 - math.cos(0.1 * i)}\n" for i in range(30))
    path = path_from_csv(imported(tmp_path, bend, origin=True), "out.csv")
    assert (path.x[0], path.y[0]) == pytest.approx((0.0, 0.0), abs=5e-3)
    assert path.heading[0] == pytest.approx(0.0, abs=0.05)
    assert path.curvature[50] == pytest.approx(1.0, abs=0.01)
    assert path.y[-1] > 0.5


@pytest.mark.parametrize("reverse", [False, True])
def test_a_way_driven_backwards_stays_so_and_is_driven_forwards_the_other_way(tmp_path: Path, reverse: bool) -> None:
    text = "x,y,yaw_deg\n" + "".join(f"{0.5 * i},0,180\n" for i in range(5))
    (part,) = route_from_csv(imported(tmp_path, text, reverse=reverse), "out.csv").parts
    assert part.backward is not reverse
    assert part.path.x[-1] == pytest.approx(0.0 if reverse else 2.0)


def test_a_way_with_reversals_is_joined_part_by_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "x,y\n" + "".join(f"{x},{0.1 * x}\n" for x in (5, 8, 11, 8.5, 6, 9))
    there, back, again = route_from_csv(imported(tmp_path, text, origin=True), "out.csv").parts
    assert [part.backward for part in (there, back, again)] == [False, True, False]
    assert (there.path.x[0], there.path.y[0], there.path.heading[0]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)
    assert [p.path.length for p in (there, back, again)] == pytest.approx([6.03, 5.025, 3.015], abs=0.01)
    assert "14.07 m, driven forwards, backwards, forwards, from 6 points of in.csv" in capsys.readouterr().out


def test_a_way_that_begins_backwards_is_moved_so_that_the_robot_faces_along_x(tmp_path: Path) -> None:
    text = "x,y,yaw_deg\n" + "".join(f"3,{0.5 * i},-90\n" for i in range(5))
    (part,) = route_from_csv(imported(tmp_path, text, origin=True), "out.csv").parts
    assert part.backward
    assert (part.path.x[-1], part.path.y[-1], part.heading_at(0.0)) == pytest.approx((-2.0, 0.0, 0.0), abs=1e-4)


def test_headings_that_are_all_0_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    imported(tmp_path, "x,y,yaw\n0,0,0\n-1,0,0\n-2,0,0\n")
    assert "every heading is 0: taken as not given" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y\n", "in.csv:1:1: no rows"),
        ("x,y\n1,1\n1,1\n", "in.csv:1:1: 1 distinct points"),
        ("x,y,yaw\n0,0,0.1\n1,0,3\n2,0,0\n", "in.csv:3:1: the heading points across the path"),
        ("x,y,yaw\n0,0,90\n0,1,90\n0,2,90\n", "in.csv:2:1: heading 90: expected rad, these are degrees"),
        ("x,y\n0,0\n1,0\n2,0\n1.43,0.82\n", "in.csv:4:1: the robot would turn by 55 deg on the spot"),
        ("x,y,v\n0,0,0.1\n1,0,-0.3\n2,0,0.1\n", "in.csv:3:1: speed: expected more than 0 m/s, found -0.3"),
        ("x_m,y_m\n0,0\n50000,0\n", "in.csv: path of 50000 m"),
        ("x_m,y_m\n0,0\n1e308,0\n", "in.csv: more than"),
    ],
)
def test_points_that_are_no_path_are_refused_and_nothing_is_written(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        imported(tmp_path, text)
    assert caught.value.problems[0].startswith(f"{tmp_path}/{expected}")
    assert [file.name for file in tmp_path.iterdir()] == ["in.csv"]


def test_speeds_that_are_not_there_cannot_be_kept(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no speeds in it"):
        imported(tmp_path, "x,y\n0,0\n1,0\n", with_speed=True)
