"""Path files made of what other programs write: the same way from each of them."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.commands.path_formats import SUFFIXES
from artemis.commands.path_import import import_path
from artemis.errors import ConfigError
from artemis.motion.columns import layout_of
from artemis.motion.path import path_from_csv
from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import as_tum
from artemis.motion.waypoints import distances

POINTS = [(0.1 * i, 0.5 * math.sin(0.1 * i)) for i in range(60)]
HEADINGS = [math.atan2(math.cos(0.1 * i) * 0.05, 0.1) for i in range(60)]
TIMES = [0.1 * i for i in range(60)]
LATITUDE, LONGITUDE = 49.78, 9.97
NORTH, EAST = 111_218.0, 71_995.0
"""Metres a degree there."""
PLACES = [(LATITUDE + y / NORTH, LONGITUDE + x / EAST) for x, y in POINTS]


def rows(line: str, comma: bool = False) -> str:
    text = "".join(
        line.format(i=i, t=t, x=x, y=y, mx=1000 * x, my=1000 * y, h=h, d=math.degrees(h), s=math.sin(h / 2),
                    c=math.cos(h / 2), lat=lat, lon=lon) + "\n"
        for i, (t, (x, y), h, (lat, lon)) in enumerate(zip(TIMES, POINTS, HEADINGS, PLACES, strict=True))
    )  # fmt: skip
    return text.replace(".", ",") if comma else text


COVARIANCE = ",".join(f"field.pose.covariance{i}" for i in range(36))
ROSTOPIC = (
    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id,"
    "field.pose.pose.position.x,field.pose.pose.position.y,field.pose.pose.position.z,"
    "field.pose.pose.orientation.x,field.pose.pose.orientation.y,field.pose.pose.orientation.z,"
    f"field.pose.pose.orientation.w,{COVARIANCE},field.twist.twist.linear.x\n"
)
TABLES = {
    "time_first.csv": rows("{t:.3f},{x:.4f},{y:.4f}"),
    "heading_last.csv": rows("{x:.4f},{y:.4f},{h:.4f}"),
    "degrees.txt": rows("{x:.4f} {y:.4f} {d:.2f}"),
    "four.csv": rows("{t:.3f};{x:.4f};{y:.4f};{h:.4f}"),
    "plain.tum": rows("{t:.6f} {x:.6f} {y:.6f} 0 0 0 {s:.9f} {c:.9f}"),
    "commented.txt": "# timestamp tx ty tz qx qy qz qw\n" + rows("{t} {x:.6f} {y:.6f} 0 0 0 {s:.9f} {c:.9f}"),
    "semicolons.csv": "x;y\n" + rows("{x:.4f};{y:.4f}", comma=True),
    "tabs.tsv": "x\ty\n" + rows("{x:.4f}\t{y:.4f}", comma=True),
    "quoted.csv": "x,y\n" + rows('"{x:.4f}";"{y:.4f}"', comma=True).replace(";", ","),
    "millimetres.csv": "x_mm,y_mm\n" + rows("{mx:.2f},{my:.2f}"),
    "bare.txt": rows("{x:.4f} {y:.4f}", comma=True),
    "brackets.csv": '"time [s]","x [mm]","y [mm]","yaw [deg]"\n' + rows("{t},{mx:.2f},{my:.2f},{d:.3f}"),
    "suffix.csv": "t,pos_x_mm,pos_y_mm\n" + rows("{t},{mx:.2f},{my:.2f}"),
    "prefix.csv": "t,pos_x,pos_y\n" + rows("{t},{x:.4f},{y:.4f}"),
    "rostopic.csv": ROSTOPIC
    + rows("{i}00,{i},{i}00,odom,base,{x:.4f},{y:.4f},0,0,0,{s:.6f},{c:.6f}," + ",".join(["0.0"] * 36) + ",0.3"),
    "juggler.csv": "__time,/odom/pose/pose/position/x,/odom/pose/pose/position/y\n" + rows("{t},{x:.4f},{y:.4f}"),
    "turtle.csv": "%time,field.x,field.y,field.theta,field.linear_velocity\n" + rows("{i},{x:.4f},{y:.4f},{h:.4f},1"),
}
GEOGRAPHIC = {
    "gps.csv": "timestamp,lat,lon,alt\n" + rows("{i},{lat:.9f},{lon:.9f},200"),
    "fix.csv": "%time,field.header.frame_id,field.latitude,field.longitude\n" + rows("{i},gps,{lat:.9f},{lon:.9f}"),
    "wpt.gpx": "<gpx>" + rows('<wpt lat="{lat:.9f}" lon="{lon:.9f}"/>') + "</gpx>",
    "line.kml": '<kml xmlns="http://www.opengis.net/kml/2.2"><LineString><coordinates>\n'
    + rows("{lon:.9f},{lat:.9f},0")
    + "</coordinates></LineString></kml>",
    "track.kml": '<kml xmlns:gx="http://www.google.com/kml/ext/2.2"><gx:Track>'
    + rows("<when>2026</when><gx:coord>{lon:.9f} {lat:.9f} 0</gx:coord>")
    + "</gx:Track></kml>",
    "points.kml": "<kml>" + rows("<Point><coordinates>{lon:.9f},{lat:.9f}</coordinates></Point>") + "</kml>",
    "line.geojson": json.dumps({"type": "LineString", "coordinates": [(lon, lat) for lat, lon in PLACES]}),
    "points.json": json.dumps({
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [lon, lat, 3.0]}}
            for lat, lon in PLACES
        ],
    }),
    "gps.yaml": "waypoints:\n" + rows("- {{latitude: {lat:.9f}, longitude: {lon:.9f}, yaw: 0.0}}"),
}  # fmt: skip
ODOMETRY = """header: {{seq: {i}, stamp: {{secs: 17, nsecs: 5}}, frame_id: "odom"}}
child_frame_id: "base_link"
pose:
  pose:
    position: {{x: {x:.5f}, y: {y:.5f}, z: 0.0}}
    orientation: {{x: 0.0, y: 0.0, z: {s:.8f}, w: {c:.8f}}}
  covariance: [1e-05, 0.0]
twist: {{twist: {{linear: {{x: 0.3}}}}}}
---"""
POSES = {
    "echo.yaml": rows(ODOMETRY),
    "panel.yaml": "waypoints:\n"
    + rows("  waypoint{i}:\n    pose: [{x:.4f}, {y:.4f}, 0]\n    orientation: [{c:.6f}, 0, 0, {s:.6f}]"),
    "pairs.yaml": "waypoints:\n" + rows("- [{x:.4f}, {y:.4f}]"),
    "path.yaml": "header: {frame_id: map}\nposes:\n"
    + rows("- {{header: {{frame_id: map}}, pose: {{position: {{x: {x:.4f}, y: {y:.4f}, z: 0.0}}}}}}")
    + "---\n",
}
LINE = np.column_stack([np.interp(np.linspace(0, 59, 1201), np.arange(60), column) for column in np.array(POINTS).T])


def imported(folder: FilePath, name: str, text: str, **options: bool) -> str:
    (folder / name).write_text(text)
    import_path(folder / name, folder / "out.csv", None, force=True, **options)
    return (folder / "out.csv").read_text()


def refused(folder: FilePath, name: str, text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        imported(folder, name, text)
    return [problem.removeprefix(f"{folder}/") for problem in caught.value.problems]


@pytest.mark.parametrize("name", [*TABLES, *POSES])
def test_the_same_way_in_metres(tmp_path: FilePath, name: str) -> None:
    path = path_from_csv(imported(tmp_path, name, {**TABLES, **POSES}[name]), "out.csv")
    assert path.length == pytest.approx(6.23, abs=0.02)
    assert distances(np.column_stack([path.x, path.y]), LINE).max() < 2e-3


@pytest.mark.parametrize("name", GEOGRAPHIC)
def test_the_same_way_on_earth(tmp_path: FilePath, name: str) -> None:
    text = imported(tmp_path, name, GEOGRAPHIC[name])
    path = path_from_csv(text, "out.csv")
    assert distances(np.column_stack([path.x, path.y]), LINE).max() < 5e-3
    assert "# x is east and y north of 49.7800000, 9.9700000 (WGS 84)\n" in text


def test_what_artemis_exports_it_reads(tmp_path: FilePath) -> None:
    poses = np.column_stack([np.array(POINTS), HEADINGS])
    text = as_tum(Trajectory(time=np.array(TIMES), poses=poses))
    assert path_from_csv(imported(tmp_path, "run.tum", text), "out.csv").length == pytest.approx(6.23, abs=0.02)


def test_what_was_assumed_is_told(tmp_path: FilePath) -> None:
    assert "read as time, x, y: nothing else fits" in imported(tmp_path, "a.csv", TABLES["time_first.csv"])
    assert "a comma was read as a decimal point" in imported(tmp_path, "a.csv", TABLES["semicolons.csv"])
    assert "units: x [mm] times 0.001, y [mm] times 0.001" in imported(tmp_path, "a.csv", TABLES["brackets.csv"])
    assert "not used: z, time, 41 other columns" in imported(tmp_path, "a.csv", TABLES["rostopic.csv"])


@pytest.mark.parametrize(
    ("header", "gap"), [("x,y\n", "105.5"), ("", "105.5"), ("tx ty\n", "105.5"), ("x_mm,y\n", "33.61")]
)
def test_points_far_apart_need_a_unit(tmp_path: FilePath, header: str, gap: str) -> None:
    separator = " " if " " in header else ","
    text = header + rows("{mx:.2f},{my:.2f}").replace(",", separator)

    (problem,) = refused(tmp_path, "a.csv", text)

    assert problem == (
        f"a.csv:1:1: neighbouring points are {gap} units apart, and no unit is given: name the columns x_mm,y_mm if "
        "that is millimetres, or x_m,y_m if it is metres"
    )


def test_a_message_has_its_unit(tmp_path: FilePath) -> None:
    far = "field.pose.position.x,field.pose.position.y\n" + "".join(f"{10 * i},0\n" for i in range(5))

    assert "40.00 m, from 5 points" in imported(tmp_path, "a.csv", far)


def test_a_curve_on_the_straight_lines_is_not_said_to_leave_them(tmp_path: FilePath) -> None:
    straight = "".join(f"{0.05 * i + 2 * (i > 20):.2f},0\n" for i in range(40))

    assert "leaves the straight lines" not in imported(tmp_path, "a.csv", "x,y\n" + straight)
    assert "leaves the straight lines" in imported(tmp_path, "a.csv", "x,y\n0,0\n3,0\n5,2\n5,5\n")


def test_decimal_commas_between_commas_are_named_once(tmp_path: FilePath) -> None:
    found = refused(tmp_path, "a.csv", "x,y\n" + "".join(f"0,{50 * i:03d},0.0000\n" for i in range(1, 30)))

    assert found == [
        "a.csv:2:7: expected 2 columns (x, y), found 3: a comma separates columns: write a point in a number, or "
        "semicolons between columns"
    ]


def test_quotes_hold_a_decimal_comma(tmp_path: FilePath) -> None:
    assert "a comma was read as a decimal point" in imported(tmp_path, "a.csv", TABLES["quoted.csv"])
    with pytest.raises(
        ConfigError, match=r"^p\.csv:2:1: x: expected a finite number, found '0,0000': write a point inst"
    ) as caught:
        path_from_csv(TABLES["quoted.csv"], "p.csv")
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("name", ["seg.gpx", "seg.kml", "seg.geojson"])
def test_how_wide_the_gap_between_segments_is_told(tmp_path: FilePath, name: str) -> None:
    pieces = PLACES[:20], PLACES[35:]
    if name.endswith("gpx"):
        parts = ["".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lat, lon in piece) for piece in pieces]
        text = "<gpx><trk>" + "".join(f"<trkseg>{part}</trkseg>" for part in parts) + "</trk></gpx>"
    elif name.endswith("kml"):
        parts = [" ".join(f"{lon},{lat}" for lat, lon in piece) for piece in pieces]
        text = "".join(f"<LineString><coordinates>{part}</coordinates></LineString>" for part in parts)
        text = f"<kml><MultiGeometry>{text}</MultiGeometry></kml>"
    else:
        lines = [[(lon, lat) for lat, lon in piece] for piece in pieces]
        text = json.dumps({"type": "MultiLineString", "coordinates": lines})
    assert "# 2 segments were joined; the widest gap is 1.73 m (" in imported(tmp_path, name, text)


HARD = ": write their names in a first line"


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.csv", rows("{t:.2f},{t:.3f},0"), f"a.csv:1:1: 3 columns without names can be x, y, z or time, x, y{HARD}"),
        ("a.csv", rows("{t:.2f},0,0"), f"a.csv:1:1: 3 columns without names can be x, y, heading or time, x, y{HARD}"),
        ("a.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n" * 3, f"a.txt:1:1: 12 columns without names{HARD}"),
        ("a.csv", "x,y\n0,0,1,5\n1,0,2,5\n", "a.csv:2:5: expected 2 columns (x, y), found 4: a comma separates"),
        ("a.csv", "x [ft],y [ft]\n0,0\n1,1\n", "a.csv:1:1: expected the columns x, y"),
        ("a.csv", "lat,lon\n91,0\n0,0\n", "a.csv:2:1: lat: expected -90 to 90 degrees, found 91"),
        ("a.csv", "lat,lon\n", "a.csv:1:1: no rows: expected a line with the columns"),
        ("a.csv", "x,y,colour\n0,0,1\n", "a.csv:1:5: unknown column 'colour'"),
        ("a.kml", "<gpx/>", "a.kml:1:1: expected a KML file, which begins with <kml>; found <'gpx'>"),
        ("a.kml", '<!DOCTYPE kml [<!ENTITY a "a">]><kml>&a;</kml>', "a.kml:1:15: a document type (<!DOCTYPE) is"),
        ("a.kml", "<kml><Point><coordinates>200,0</coordinates></Point></kml>", "a.kml:1:31: lon: expected -180 to"),
        ("a.kml", "<kml><Polygon/></kml>", "a.kml:1:1: no line, no track and no point"),
        ("a.json", '{"type": "Feature",', "a.json:1:20: not JSON"),
        ("a.json", "[" * 100_000, "a.json:1:1: not GeoJSON: nested too deep"),
        ("a.json", "null", "a.json: $: expected GeoJSON with a type such as FeatureCollection, found None"),
        ("a.json", '{"type": "Polygon", "coordinates": []}', "a.json: $: an area (Polygon) is no path"),
        ("a.json", '{"type": "LineString", "coordinates": [[500, 300]]}', "a.json: $.coordinates[0]: expected"),
        ("a.json", '{"type": "LineString", "coordinates": 3}', "a.json: $: coordinates: expected lists"),
        (
            "a.geojson",
            '{"type": "Feature", "properties": {"startid": 0}, "geometry": null}',
            "a.geojson: $: a route graph of Nav2 is no path",
        ),
        ("a.yaml", "---\n---\n", "a.yaml:1:1: expected keys and values, found None"),
        ("a.yaml", "position: {x: 0, y: 0}\n---\nposition: {x: 1}\n", "a.yaml:3:1: position.y: expected"),
        ("a.yaml", "waypoints: [[0, 0, 3]]\n", "a.yaml:1:13: waypoints[0]: 3 numbers; expected x and y"),
        ("a.yaml", "waypoints: {w: {pose: [0, 0], orientation: [1, 0, 0]}}", "a.yaml:1:13: waypoints.w: expected"),
        ("a.yaml", "waypoints: [{latitude: 91, longitude: 0}, {latitude: 1, longitude: 0}]", "a.yaml:1:13: expected"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_a_line(tmp_path: FilePath, name: str, text: str, expected: str) -> None:
    found = refused(tmp_path, name, text)
    assert found[0].startswith(expected), found
    assert len(found) <= 3
    assert not (tmp_path / "out.csv").exists()


def test_columns_without_names_in_a_path_that_is_followed() -> None:
    path = path_from_csv(TABLES["heading_last.csv"], "p.csv")
    assert path.length == pytest.approx(6.23, abs=0.02)
    with pytest.raises(
        ConfigError, match=r"p\.csv:1:1: columns without names that can only be time, x, y: `artemis path"
    ):
        path_from_csv(TABLES["time_first.csv"], "p.csv")
    with pytest.raises(
        ConfigError, match=r"^p\.csv:2:1: x: expected a finite number, found '0,0000': write a point inst"
    ):
        path_from_csv(TABLES["semicolons.csv"], "p.csv")
    with pytest.raises(ConfigError, match="tables of others are read by `artemis path import`"):
        path_from_csv(TABLES["suffix.csv"], "p.csv")


def test_a_log_is_not_taken_for_headings() -> None:
    columns = [[float(cell) for cell in line.split(",")] for line in TABLES["time_first.csv"].splitlines()]
    assert layout_of(list(zip(*columns, strict=True))) == ("time", "x", "y")
    turned = [(y, x, h) for (x, y), h in zip(POINTS, HEADINGS, strict=True)]  # headings of another path
    assert isinstance(layout_of(list(zip(*turned, strict=True))), str)


def test_every_suffix_has_a_reader() -> None:
    assert {"csv", "gpx", "kml", "geojson", "nav2"} == set(SUFFIXES.values())
