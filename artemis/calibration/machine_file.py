"""Runs of somebody else's machine: tables of numbers, and a small file that says what their columns mean."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from artemis.calibration.kinematics import Kinematics
from artemis.calibration.wheel_log import LEAST_TICKS, WheelLog
from artemis.config import Config
from artemis.motion.arrays import Array
from artemis.motion.table import Table
from artemis.motion.trajectory import Trajectory
from artemis.vehicle import Positive

Column = Literal[
    "time",
    "distance",
    "distance_left",
    "distance_right",
    "steering",
    "steering_left",
    "steering_right",
    "true_x",
    "true_y",
    "true_heading",
    "-",
]
TRUTH = ("true_x", "true_y", "true_heading")


class Machine(Config):
    """One driven and steered front wheel (columns `distance`, `steering`), or two (`..._left`, `..._right`)."""

    machine: str
    columns: Annotated[list[Column], Field(min_length=3)]
    """Of the tables, in their order; `-` is passed over. Time in s, the true pose in m and rad."""
    counts: Literal["each_row", "running"]
    """Distances are counted since the row before, or since the beginning."""
    metres_per_count: float
    """Negative if forward counts negative."""
    radians_per_steering_unit: float
    """Negative if right counts positive."""
    steering_zero: float = 0.0
    """In the table's unit."""
    wheelbase_m: Positive
    track_m: Positive | None = None
    """Of two wheels; with one there is none."""
    scrub_radius_m: Annotated[float, Field(ge=0)] = 0.0
    driven_axle: Literal["front", "rear"] = "front"

    @model_validator(mode="after")
    def _complete(self) -> Self:
        wanted = {"time", *self.sides}
        given = [name for name in self.columns if name != "-"]
        if missing := wanted - set(given):
            raise ValueError(f"columns: {', '.join(sorted(missing))} is missing")
        if surplus := set(given) - wanted - set(TRUTH):
            raise ValueError(f"columns: {', '.join(sorted(surplus))} is not of this machine")
        if len(set(given)) < len(given):
            raise ValueError("columns: duplicate column")
        if 0 < len(set(given) & set(TRUTH)) < (2 if "true_heading" not in given else 3):
            raise ValueError("columns: of the true pose there must be true_x and true_y")
        if not self.metres_per_count or not self.radians_per_steering_unit:
            raise ValueError("a count and a steering unit cannot be worth 0")
        if self.one_wheel and (self.track_m or self.scrub_radius_m or self.driven_axle == "rear"):
            raise ValueError("track_m, scrub_radius_m and a driven rear axle need columns of a left and a right wheel")
        if not self.one_wheel and (self.track_m or 0.0) <= 2 * self.scrub_radius_m:
            raise ValueError("track_m must be more than twice scrub_radius_m")
        return self

    @property
    def sides(self) -> tuple[str, ...]:
        """The columns of distances, left and right, and of angles."""
        if self.one_wheel:
            return "distance", "distance", "steering", "steering"
        return "distance_left", "distance_right", "steering_left", "steering_right"

    @property
    def one_wheel(self) -> bool:
        """Whether left and right are one wheel."""
        return "distance" in self.columns or "steering" in self.columns

    @property
    def kinematics(self) -> Kinematics:
        """As described."""
        return Kinematics(
            wheelbase=self.wheelbase_m,
            kingpin_distance=(self.track_m or 0.0) - 2 * self.scrub_radius_m,
            scrub_radius=self.scrub_radius_m,
            front_driven=self.driven_axle == "front",
        )


def log_from_table(text: str, source: str, machine: Machine) -> tuple[WheelLog, Trajectory | None]:
    """A run from a table, with its truth if the table holds it. A first line of words is passed over.

    Raises:
        ConfigError: every problem found, with file:line:column.
    """
    names = [name if name != "-" else f"column {number}" for number, name in enumerate(machine.columns, 1)]
    table = Table(_without_header(text), source, dict(zip(names, names, strict=True)), required=names)
    columns = {name: np.array(values) for name, values in table.columns.items()}
    if table.complete:
        for row in np.flatnonzero(np.diff(columns["time"]) <= 0) + 1:
            table.report(int(row), "time: expected later than the row before", "time")
        if len(columns["time"]) < LEAST_TICKS:
            table.report_file(f"{len(columns['time'])} rows; expected at least {LEAST_TICKS}")
    table.raise_problems()
    sides = machine.sides
    distances = [_distance(columns[name], machine) for name in sides[:2]]
    angles = [(columns[name] - machine.steering_zero) * machine.radians_per_steering_unit for name in sides[2:]]
    time = columns["time"]
    log = WheelLog(
        name=source,
        time=time,
        distance_left=distances[0],
        distance_right=distances[1],
        steering_left=angles[0],
        steering_right=angles[1],
    )
    if "true_x" not in columns:
        return log, None
    heading = columns.get("true_heading", np.full(len(time), np.nan))
    return log, Trajectory(time=time, poses=np.column_stack([columns["true_x"], columns["true_y"], heading]))


def _distance(counts: Array, machine: Machine) -> Array:
    summed = np.cumsum(counts) if machine.counts == "each_row" else counts
    return np.asarray(machine.metres_per_count * summed)


def _without_header(text: str) -> str:
    """The text with a first line of words made a comment, so that line numbers stay."""
    body = text.removeprefix("\ufeff")
    first = body.lstrip().partition("\n")[0]
    cells = first.replace(";", ",").split(",")
    return f"#{body.lstrip()}" if first and all(not _is_number(cell) for cell in cells) else body


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
