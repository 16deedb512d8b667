"""Trajectories from files of others, where the truth comes from, and as such a file: tables and TUM.

TUM is the text format of the RGB-D benchmark of TU München (Sturm et al. 2012): `timestamp tx ty tz qx qy qz qw`.
"""

from __future__ import annotations

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.table import Table
from artemis.motion.trajectory import Trajectory

CSV_NAMES = (
    {name: "time" for name in ("time_s", "time", "t", "timestamp")}
    | {name: "x" for name in ("x_m", "x")}
    | {name: "y" for name in ("y_m", "y")}
    | {name + unit: "heading" for unit in ("_rad", "") for name in ("heading", "yaw", "theta")}
    | {name + "_deg": "heading_deg" for name in ("heading", "yaw", "theta")}
)
TUM_NAMES = {"timestamp": "time", "tx": "x", "ty": "y", "tz": "z"} | {name: name for name in ("qx", "qy", "qz", "qw")}
UNIT_TOLERANCE = 0.05
"""Quaternions may be shorter or longer by this: files round."""
MAX_TILT = 10.0
"""A frame whose z axis is not upwards, or a tracker that lies on its side, is tilted by more [deg]."""


def truth_from(text: str, source: str) -> Trajectory:
    """The trajectory in a file: TUM if its name ends so or it has eight numbers between blanks, else a table.

    A table has columns time_s, x_m, y_m and, if known, heading_rad or heading_deg; without a header in this order.
    Where every quaternion of TUM is 0 0 0 1, the heading is not known.

    Args:
        text: the whole file.
        source: its name, for messages.

    Raises:
        ConfigError: every problem found, with file:line:column.
    """
    return _from_tum(text, source) if _is_tum(text, source) else _from_csv(text, source)


def as_tum(trajectory: Trajectory) -> str:
    """The rows of a TUM file; where the heading is not known, the quaternion is 0 0 0 1."""
    half = np.nan_to_num(trajectory.poses[:, 2]) / 2
    rows = np.column_stack([trajectory.time, trajectory.poses[:, :2], np.sin(half), np.cos(half)])
    return "".join(f"{t:.9f} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}\n" for t, x, y, qz, qw in rows.tolist())


def _is_tum(text: str, source: str) -> bool:
    filled = (line.partition("#")[0].split() for line in text.removeprefix("\ufeff").splitlines())
    first = next((cells for cells in filled if cells), [])
    return source.removesuffix(".gz").endswith(".tum") or (len(first) == len(TUM_NAMES) and "," not in "".join(first))


def _from_csv(text: str, source: str) -> Trajectory:
    table = Table(text, source, CSV_NAMES, required=("time", "x", "y"))
    if "heading" in table.columns and "heading_deg" in table.columns:
        table.report_file("a heading both in rad and in degrees; keep one of them, and name every column")
    columns = {name: np.array(values) for name, values in table.columns.items()}
    if "heading_deg" in columns:
        columns["heading"] = np.radians(columns["heading_deg"])
    return _checked(table, columns, columns.get("heading"))


def _from_tum(text: str, source: str) -> Trajectory:
    table = Table(text, source, TUM_NAMES, required=tuple(TUM_NAMES.values()))
    columns = {name: np.array(values) for name, values in table.columns.items()}
    if not table.complete:
        return _checked(table, columns, None)
    qx, qy, qz, qw = (columns[name] for name in ("qx", "qy", "qz", "qw"))
    length = np.sqrt(qx**2 + qy**2 + qz**2 + qw**2)
    unit = np.abs(length - 1) <= UNIT_TOLERANCE
    square = np.where(unit, length, 1.0) ** 2
    tilt = np.degrees(np.arccos(np.clip(1 - 2 * (qx**2 + qy**2) / square, -1.0, 1.0)))
    for row in np.flatnonzero(~unit):
        table.report(int(row), f"expected a quaternion of length 1, found {length[row]:.3g}", "qx")
    for row in np.flatnonzero(unit & (tilt > MAX_TILT)):
        problem = f"tilted by {tilt[row]:.0f} degrees; expected a turn about z, which points upwards"
        table.report(int(row), problem, "qx")
    known = ((qz != 0.0) | (qw != 1.0)).any()
    heading = np.arctan2(2 * (qw * qz + qx * qy), square - 2 * (qy**2 + qz**2))
    return _checked(table, columns, heading if known else None)


def _checked(table: Table, columns: dict[str, Array], heading: Array | None) -> Trajectory:
    if "time" in columns:
        time = columns["time"]
        for row in np.flatnonzero(np.diff(time) <= 0) + 1:
            problem = f"time {time[row]:.12g} s follows {time[row - 1]:.12g} s; expected a later one"
            table.report(int(row), problem, "time")
    table.raise_problems()
    if not len(columns["time"]):
        raise ConfigError(f"{table.source}:1:1: no poses")
    unknown = np.full(len(columns["time"]), np.nan)
    poses = np.column_stack([columns["x"], columns["y"], unknown if heading is None else heading])
    return Trajectory(time=columns["time"], poses=poses)
