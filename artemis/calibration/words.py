"""A fit in words: the values of the machine before and after, how sure they are, and what is held and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, sqrt

import numpy as np

from artemis.calibration.fit import Fit
from artemis.calibration.knowledge import QUANTILE, Estimates
from artemis.calibration.score import Score

Weights = Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueRow:
    """One value of the machine, all four as they are shown."""

    name: str
    nominal: str
    fitted: str
    half_width: str
    """Of the 95 % interval."""


def rows_of(found: Estimates, metres_per_count: tuple[float, float]) -> list[ValueRow]:
    """Every value that was fitted or held, in the units of a robot file.

    Args:
        found: by a fit.
        metres_per_count: as described, left and right.

    Left and right are one where nothing that may differ between them is a parameter.
    """
    known = {each.parameter.name for each in found.estimates}
    base, machine = found.base, found.machine
    rows = []
    one, two = (("", 1.0),), ((" left", 1.0), (" right", -1.0))
    driven, sides = (two if f"{what} difference" in known else one for what in ("distance", "zero"))
    for (side, sign), count in zip(driven, metres_per_count, strict=False):
        old, new = ((each.distance_right if sign < 0 else each.distance_left) * count for each in (base, machine))
        width = _half_width(found, {"distance": 1.0, "distance difference": sign / 2}) * count
        rows.append(_row(f"metres per count{side}", old, new, width, ".5e", ".1e"))
    if sides is two:
        old, new = (degrees(each.zero_left + each.zero_right) / 2.0 for each in (base, machine))
        rows.append(
            _row("steering zero, mean [deg]", old, new, degrees(_half_width(found, {"zero": 1.0})), ".3f", ".3f")
        )
    for side, sign in sides:
        old, new = (degrees(each.zero_right if sign < 0 else each.zero_left) for each in (base, machine))
        width = degrees(_half_width(found, {"zero": 1.0, "zero difference": sign / 2}))
        rows.append(_row(f"steering zero{side} [deg]", old, new, width, ".3f", ".3f"))
    for side, sign in sides:
        old, new = ((each.scale_right if sign < 0 else each.scale_left) for each in (base, machine))
        width = _half_width(found, {"scale": 1.0, "scale difference": sign / 2})
        rows.append(_row(f"steering scale{side}", old, new, width, ".5f", ".5f"))
    lengths: list[tuple[str, float, float]] = [("wheelbase", base.wheelbase, machine.wheelbase)]
    lengths += [("kingpin distance", base.kingpin_distance, machine.kingpin_distance)]
    lengths += [("scrub radius", base.scrub_radius, machine.scrub_radius)]
    for name, old, new in [row for row in lengths if row[0] in known]:
        rows.append(_row(f"{name} [m]", old, new, _half_width(found, {name: 1.0}) * old, ".5f", ".5f"))
    if isinstance(found, Fit):
        for estimate in found.estimates[-3:] if found.knows_heading else found.estimates[-3:-1]:
            name, turn = estimate.parameter.name, "heading" in estimate.parameter.name
            value, width = (degrees(each) if turn else each for each in (estimate.value, estimate.half_width))
            unit = "deg" if turn else "m"
            rows.append(_row(f"{name} [{unit}]", 0.0, value, width, ".4f", ".4f"))
    return rows


def held_of(found: Estimates) -> list[tuple[str, str]]:
    """What is held as described, and why."""
    return [(each.parameter.name, each.reason) for each in found.estimates if not each.seen]


def score_rows(scores: Sequence[tuple[str, Score]]) -> list[tuple[str, ...]]:
    """Name, runs, distance, errors: mean, its share of the distance, largest, at the end."""
    return [
        (
            name,
            str(each.runs),
            f"{each.distance:.2f} m",
            f"{1000 * each.mean:.1f} mm",
            f"{each.mean / each.distance:.2%}" if each.distance else "",
            f"{1000 * each.max:.1f} mm",
            f"{1000 * each.end:.1f} mm",
        )
        for name, each in scores
    ]


def as_text(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with aligned columns, words to the left and numbers to the right."""
    table = [list(head), *(list(row) for row in rows)]
    columns = []
    for column in zip(*table, strict=True):
        width, to_the_left = max(map(len, column)), column[-1][:1].isalpha()
        columns.append([cell.ljust(width) if to_the_left else cell.rjust(width) for cell in column])
    return "".join("  ".join(row).rstrip() + "\n" for row in zip(*columns, strict=True))


def _row(name: str, old: float, new: float, width: float, digits: str, few: str) -> ValueRow:
    return ValueRow(name=name, nominal=f"{old:{digits}}", fitted=f"{new:{digits}}", half_width=f"{width:{few}}")


def _half_width(found: Estimates, weights: Weights) -> float:
    """Of a weighted sum of parameters."""
    names = [each.parameter.name for each in found.estimates]
    vector = np.array([weights.get(name, 0.0) for name in names])
    variance = float(vector @ found.covariance @ vector)
    return QUANTILE * sqrt(max(variance, 0.0))
