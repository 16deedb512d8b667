"""A linkage that was measured: between the angle of its motor and the virtual front wheel's."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from math import atan2, ceil, cos, degrees, radians, sin

from artemis.axles import Geometry

STEP = 0.5
"""Between the rows of its table both wheels turn evenly with the motor: rows no farther apart than this [deg]."""


class MeasuredLinkage:
    """Straight lines between close rows, and beyond the first and the last. Angles in rad, left positive.

    Wheels on a real linkage are no exact pair. The virtual wheel's angle is that of the curvature kappa at which both
    together slip least, by least squares of the sideways speeds of `sim.vehicle`: u (kappa (L cos(delta) +- B/2
    sin(delta)) - sin(delta)), upper sign left.
    """

    def __init__(self, geometry: Geometry) -> None:
        """Of a geometry with a table."""
        assert isinstance(geometry.linkage, tuple)
        wheelbase, half = geometry.wheelbase_m, geometry.kingpin_distance_m / 2.0
        rows = [(row.motor_deg, row.left_deg, row.right_deg) for row in geometry.linkage]
        self._motor: list[float] = []
        self._steering: list[float] = []
        for begin, end in pairwise(rows):
            parts = ceil((end[0] - begin[0]) / STEP)
            for part in range(parts + 1 if end is rows[-1] else parts):
                motor, left, right = (radians(a + (b - a) * part / parts) for a, b in zip(begin, end, strict=True))
                grips = (wheelbase * cos(left) + half * sin(left), wheelbase * cos(right) - half * sin(right))
                turned = sin(left) * grips[0] + sin(right) * grips[1]
                self._motor.append(motor)
                self._steering.append(atan2(turned * wheelbase, grips[0] * grips[0] + grips[1] * grips[1]))

    @property
    def reach(self) -> tuple[float, float]:
        """Angles of the virtual wheel at the ends of the table [degrees]."""
        return degrees(self._steering[0]), degrees(self._steering[-1])

    def motor(self, steering: float) -> float:
        """Angle of the motor for an angle of the virtual wheel."""
        return _along(self._steering, self._motor, steering)

    def steering(self, motor: float) -> float:
        """Angle of the virtual wheel for an angle of the motor."""
        return _along(self._motor, self._steering, motor)

    def slope(self, steering: float) -> float:
        """How far the virtual wheel turns for each radian of the motor."""
        low = _row(self._steering, steering)
        turned = self._motor[low + 1] - self._motor[low]
        return (self._steering[low + 1] - self._steering[low]) / turned


def _row(table: list[float], at: float) -> int:
    return min(max(bisect_right(table, at) - 1, 0), len(table) - 2)


def _along(table: list[float], values: list[float], at: float) -> float:
    low = _row(table, at)
    share = (at - table[low]) / (table[low + 1] - table[low])
    return values[low] + share * (values[low + 1] - values[low])
