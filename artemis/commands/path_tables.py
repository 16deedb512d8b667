"""Points of a path from tables of others: columns by their usual names and units, ROS and TUM among them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from artemis.commands.path_given import Given, from_places, heading_of, text_of
from artemis.motion.arrays import Array
from artemis.motion.columns import layout_of
from artemis.motion.table import Table, without_rows

MAX_COLUMNS = 200
"""A message of ROS with two covariances has about ninety."""
NAMES = {
    name: meaning
    for meaning, names in {
        "x": "x tx px pos_x x_pos position_x x_position pose_x easting east utm_x",
        "y": "y ty py pos_y y_pos position_y y_position pose_y northing north utm_y",
        "z": "z tz pz pos_z z_pos position_z z_position pose_z alt altitude ele elevation height",
        "lat": "lat latitude",
        "lon": "lon lng long longitude",
        "heading": "heading yaw theta",
        "heading_deg": "heading_deg yaw_deg theta_deg",
        "speed": "speed v velocity",
        "time": "time t timestamp stamp secs nsecs sec nanosec time_ns timestamp_ns time_ms timestamp_ms",
        "qx": "qx q_x orientation_x",
        "qy": "qy q_y orientation_y",
        "qz": "qz q_z orientation_z",
        "qw": "qw q_w orientation_w",
        "index": "index id seq s frame_id child_frame_id frame name",
    }.items()
    for name in names.split()
}
"""What a header may call a column, without its unit."""
SHOWN = ("x_m", "y_m", "x_mm", "y_mm", "heading_rad", "heading_deg", "speed_m_s", "time_s", "lat", "lon")
"""Some of them, for messages."""
FAR_APART = 5.0
"""Where neighbouring points are farther apart (by the median), metres are not assumed."""
UNUSED = ("z", "time")
"""Columns that are known, and mean nothing for a path."""
UNITS = {
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "metres": 1.0, "meters": 1.0, "meter": 1.0, "metre": 1.0},
    "angle": {"rad": 1.0, "deg": np.pi / 180, "°": np.pi / 180, "degrees": np.pi / 180, "degree": np.pi / 180},
    "speed": {"m/s": 1.0, "m_s": 1.0, "mps": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6},
    "time": dict.fromkeys(("s", "sec", "ms", "us", "ns"), 1.0),
}
"""Of each kind of quantity, in m, rad and m/s; of times nothing is used."""
KINDS = {"x": "length", "y": "length", "z": "length", "heading": "angle", "speed": "speed", "time": "time"}
_IN_BRACKETS = re.compile(r"(.*?)[\s_]*[\[(<]\s*([^\])>]*?)\s*[\])>]")
_QUOTED_NUMBER = re.compile(r'"\s*([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)\s*"')
_QUATERNION = ("qx", "qy", "qz", "qw")


class HeaderNames(Mapping[str, str]):
    """What a header may call a column: `NAMES`, with a unit behind, or as ROS has it; "" for one that is not read.

    Names of ROS are those of a message's field: `field.pose.pose.position.x` (rostopic), `/odom/pose/pose/position/x`
    (PlotJuggler). Of a message only position and orientation are read.
    """

    def __iter__(self) -> Iterator[str]:
        return iter(SHOWN)

    def __len__(self) -> int:
        return len(SHOWN)

    def __getitem__(self, written: str) -> str:
        """Raises KeyError: nobody knows this name, or its unit."""
        return _meaning(written)[0]


def _meaning(written: str) -> tuple[str, float]:
    """Name of a column here, and its unit in m, rad and m/s. KeyError: nobody knows them."""
    written = written.strip().lstrip("%_").strip()
    base, unit = _parted(written)
    parts = [part for part in re.split(r"[./]", written) if part]
    name = _of_message(*parts[-2:]) if unit is None and len(parts) > 1 else NAMES[base]
    factor = UNITS[KINDS[name]][unit] if unit is not None and name in KINDS else 1.0
    return ("" if name == "index" else name), factor


def _of_message(around: str, field: str) -> str:
    """A field of a message of ROS, and what it is a field of."""
    if around in ("position", "translation") and field in ("x", "y", "z"):
        return field
    if around in ("orientation", "rotation") and field in ("x", "y", "z", "w"):
        return f"q{field}"
    return NAMES.get(field, "") if around == "field" or field in ("latitude", "longitude") else ""


def _parted(written: str) -> tuple[str, str | None]:
    """Name and unit of a column."""
    if match := _IN_BRACKETS.fullmatch(written):
        return match[1].replace(" ", "_"), match[2] or None
    written = written.replace(" ", "_")
    if written not in NAMES:
        for unit in sorted((unit for kind in UNITS.values() for unit in kind), key=len, reverse=True):
            if written.endswith(f"_{unit}") and written[: -len(unit) - 1] in NAMES:
                return written[: -len(unit) - 1], unit
    return written, None


def read_csv(raw: bytes, source: str) -> Given:
    """A table with columns x and y, or latitude and longitude, and if they are there heading and speed.

    Names and units as of `HeaderNames`; without a header as of `layout_of`. A comma is read as a decimal point where it
    cannot separate columns.

    Raises:
        ConfigError: every problem found, with file:line:column.
    """
    text, commas = _with_points(text_of(raw, source))
    table = Table(text, source, HeaderNames(), required=(), layout=layout_of, max_columns=MAX_COLUMNS)
    columns = {name: np.array(values) for name, values in table.columns.items()}
    geographic = {"lat", "lon"} <= columns.keys() and not {"x", "y"} & columns.keys()
    missing = [name for name in (("lat", "lon") if geographic else ("x", "y")) if name not in columns]
    if table.is_empty:
        table.report_file(without_rows(("x", "y")))
    elif missing and (table.header or len(columns) < 3):
        table.report_file(f"expected the columns x, y (or lat, lon); no {', '.join(missing)}")
    if "heading" in columns and "heading_deg" in columns:
        table.report_file("a heading both in rad and in degrees; keep one of them, and name every column")
    table.raise_problems()
    meanings = {written: _meaning(written) for written in table.header}
    for name, factor in meanings.values():
        if name:
            columns[name] = columns[name] * factor
    if "heading_deg" in columns:
        columns["heading"] = np.radians(columns["heading_deg"])
    places = [f"{source}:{line}:1" for line in table.lines]
    if geographic:
        _check_places(table, columns)
        given = from_places([list(zip(columns["lat"].tolist(), columns["lon"].tolist(), places, strict=True))])
    else:
        _check_unit(table, columns)
        given = Given(x=columns["x"], y=columns["y"], heading=_heading(table, columns), places=places)
    given.speed = columns.get("speed")
    given.notes = [*_notes(table, columns, meanings, commas), *given.notes]
    return given


def _notes(
    table: Table, columns: dict[str, Array], meanings: Mapping[str, tuple[str, float]], commas: bool
) -> list[str]:
    """What was understood in which way."""
    notes = ["a comma was read as a decimal point"] if commas else []
    if not table.header and len(columns) > 2:
        notes.append(f"columns without names, read as {', '.join(table.columns)}: nothing else fits their numbers")
    scaled = [f"{written} times {factor:.4g}" for written, (_, factor) in meanings.items() if factor != 1.0]
    notes += [f"units: {', '.join(scaled)}"] if scaled else []
    unused = [name for name in UNUSED if name in columns]
    skipped = [written for written, (name, _) in meanings.items() if not name]
    unused += skipped if len(skipped) <= 3 else [f"{len(skipped)} other columns"]
    unused += ["heading"] if "lat" in columns and "heading" in columns else []
    return [*notes, f"not used: {', '.join(unused)}"] if unused else notes


def _heading(table: Table, columns: dict[str, Array]) -> Array | None:
    """From its column, or from quaternions."""
    if "heading" in columns or not set(_QUATERNION) <= columns.keys():
        return columns.get("heading")
    rotation = np.array([columns[name] for name in _QUATERNION])
    length = np.linalg.norm(rotation, axis=0)
    if not length.any() or not (rotation[:3].any()):  # nobody filled them in
        return None
    for row in np.flatnonzero(np.abs(length - 1) > 0.05).tolist():
        table.report(row, f"expected a quaternion of length 1, found {length[row]:.3g}", "qx")
    table.raise_problems()
    return heading_of(*rotation)


def _check_unit(table: Table, columns: dict[str, Array]) -> None:
    """Points that are far apart may be in millimetres: then their unit has to be given, as a message of ROS has it.

    Raises:
        ConfigError: it is not.
    """
    steps = np.hypot(np.diff(columns["x"]), np.diff(columns["y"]))
    gap = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    given = [written for written in table.header if _parted(written)[1] is not None or re.search(r"[./]", written)]
    if gap > FAR_APART and not {"x", "y"} <= {_meaning(written)[0] for written in given}:
        table.report_file(
            f"neighbouring points are {gap:.4g} units apart, and no unit is given: name the columns x_mm,y_mm if that "
            "is millimetres, or x_m,y_m if it is metres"
        )
        table.raise_problems()


def _check_places(table: Table, columns: dict[str, Array]) -> None:
    """Latitude and longitude are in degrees, and somewhere on Earth."""
    for name, bound in (("lat", 90), ("lon", 180)):
        for row in np.flatnonzero(np.abs(columns[name]) > bound).tolist():
            table.report(row, f"{name}: expected -{bound} to {bound} degrees, found {columns[name][row]:g}", name)
    if not len(columns["lat"]):
        table.report_file("no points")
    table.raise_problems()


def _with_points(text: str) -> tuple[str, bool]:
    """The text with decimal points instead of commas where quotes, semicolons, tabs or blanks separate its columns."""
    without = _QUOTED_NUMBER.sub(r'"\1.\2"', text)
    if without != text:
        return without, True
    rows = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    numbers = [line for line in rows if re.search(r"\d", line) and not re.search(r"[A-Za-z]{2}", line)]
    cell = r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?"
    line_of_numbers = re.compile(rf"\s*{cell}(?:(?:\s*;\s*|\s+){cell})+\s*;?\s*")
    if not any("," in line for line in numbers) or not all(line_of_numbers.fullmatch(line) for line in numbers):
        return text, False
    return re.sub(r"(?<=\d),(?=\d)", ".", text), True
