"""Kinematics of a car with steered front wheels, as seen by its virtual front wheel.

The virtual wheel stands in the middle of the front axle; its speed v [m/s] and angle alpha [rad, left positive] are
what artemis commands. The pose belongs to the centre of the rear axle. With L the wheelbase, B the distance of the
kingpins and kappa = tan(alpha) / L the curvature of the rear axle's path, a kingpin's direction is
atan2(kappa L, 1 -+ kappa B/2) (left, right). All formulas here carry the factor cos(alpha), so none is singular:
they hold for both signs, straight ahead, in reverse, and for an inner wheel turned beyond 90 degrees. They agree with
thesis equations 3.3 and 3.5 to 3.9 (whose 3.4 prints arctan for acot) and add what rolls when an offset kingpin turns.

Left and right are those of the motors. One steering motor in the middle stands for both sides, and turns as the virtual
wheel: kingpins without distance (its linkage may be measured: `MeasuredLinkage`). One traction motor in the middle
likewise: behind a differential it turns at the mean of both wheels.
"""

from __future__ import annotations

from math import atan, atan2, cos, hypot, sin, sqrt, tan

from artemis.axles import Geometry
from artemis.linkage import MeasuredLinkage


class Ackermann:
    """Exact relations between the virtual front wheel and the wheels. Angles in rad, speeds in m/s.

    Attributes:
        wheelbase: Distance of the axles [m].
        scrub_radius: How far a driven wheel rolls per radian that its kingpin turns [m]; 0 if the rear is driven.
    """

    def __init__(self, geometry: Geometry) -> None:
        self.wheelbase = geometry.wheelbase_m
        self._front_driven = geometry.driven_axle == "front"
        self.scrub_radius = geometry.scrub_radius_m if self._front_driven else 0.0
        # the following in wheelbases
        self._kingpin = geometry.steered_kingpin_distance_m / (2.0 * self.wheelbase)
        self._arm = geometry.kingpin_distance_m / (2.0 * self.wheelbase)
        self._outboard = self.scrub_radius / self.wheelbase
        self._half_track = geometry.track_m / (2.0 * self.wheelbase)
        self._differential = geometry.differential
        measured = isinstance(geometry.linkage, tuple)
        self._linkage = MeasuredLinkage(geometry) if measured else None

    # ------------------------------------------------------------------------------------------ angles

    def steering_from_curvature(self, curvature: float) -> float:
        """Angle of the virtual wheel for a curvature of the rear axle's path [1/m]."""
        return atan(curvature * self.wheelbase)

    def wheel_angles(self, steering: float) -> tuple[float, float]:
        """Angles (left, right) at which no wheel slips sideways (thesis eq. 3.3, 3.5); of one motor its own, twice."""
        if self._linkage is not None:
            angle = self._linkage.motor(steering)
            return angle, angle
        s, c = sin(steering), cos(steering)
        offset = self._kingpin * s
        return atan2(s, c - offset), atan2(s, c + offset)

    def steering_from_left(self, angle: float) -> float:
        """Angle of the virtual wheel that belongs to the left wheel's; rises with it."""
        if self._linkage is not None:
            return self._linkage.steering(angle)
        s = sin(angle)
        return atan2(s, cos(angle) + self._kingpin * s)

    def steering_from_right(self, angle: float) -> float:
        """Angle of the virtual wheel that belongs to the right wheel's; rises with it."""
        if self._linkage is not None:
            return self._linkage.steering(angle)
        s = sin(angle)
        return atan2(s, cos(angle) - self._kingpin * s)

    def steering_from_wheel_angles(self, left: float, right: float) -> float:
        """Angle of the virtual wheel from both measured wheel angles: the mean of their curvatures."""
        return atan((tan(self.steering_from_left(left)) + tan(self.steering_from_right(right))) / 2.0)

    def wheel_rates(self, steering: float, rate: float) -> tuple[float, float]:
        """Rates (left, right) [rad/s] that keep the wheels a pair while the virtual wheel turns at `rate` [rad/s].

        The derivative of `wheel_angles`, (sin(delta) / sin(alpha))^2, in a form that holds at zero; thesis eq. 3.17
        takes the ratio of the whole changes instead.
        """
        if self._linkage is not None:
            rate /= self._linkage.slope(steering)
            return rate, rate
        s, c = sin(steering), cos(steering)
        offset = self._kingpin * s
        return rate / (s * s + (c - offset) ** 2), rate / (s * s + (c + offset) ** 2)

    # ------------------------------------------------------------------------------------------ speeds

    def speed_ratios(self, steering: float) -> tuple[float, float]:
        """Rolling speed of each driven wheel (left, right) per speed of the virtual wheel, at a constant angle.

        Front: arm of the kingpin about the turning point, less or more the scrub radius (thesis eq. 3.8, 3.9).
        Rear: cos(alpha) (1 -+ kappa S/2), S the track. With a differential the mean of both, twice.
        """
        s, c = sin(steering), cos(steering)
        if self._differential:
            mean = (hypot(s, c - self._arm * s) + hypot(s, c + self._arm * s)) / 2.0 if self._front_driven else c
            return mean, mean
        if self._front_driven:
            offset, outboard = self._arm * s, self._outboard * s
            return hypot(s, c - offset) - outboard, hypot(s, c + offset) + outboard
        offset = self._half_track * s
        return c - offset, c + offset

    def wheel_speeds(
        self, speed: float, steering: float, rate_left: float = 0.0, rate_right: float = 0.0
    ) -> tuple[float, float]:
        """Rolling speeds (left, right) of the driven wheels.

        A front wheel stands outboard of its kingpin: turning it to the left at `rate` [rad/s] rolls the left one back
        and the right one forward by scrub_radius * rate, also when the robot stands (missing in thesis eq. 3.8, 3.9).
        """
        return self.rolling_speeds(speed, self.speed_ratios(steering), rate_left, rate_right)

    def rolling_speeds(
        self, speed: float, ratios: tuple[float, float], rate_left: float, rate_right: float
    ) -> tuple[float, float]:
        """As `wheel_speeds`, where the `speed_ratios` of the angle are known."""
        left, right = ratios
        return speed * left - self.scrub_radius * rate_left, speed * right + self.scrub_radius * rate_right

    def twist_from_wheels(
        self, speed_left: float, speed_right: float, steering: float, rate_left: float = 0.0, rate_right: float = 0.0
    ) -> tuple[float, float]:
        """Inverse of `wheel_speeds`: least squares over both driven wheels; takes distances for speeds as well.

        Returns:
            Speed of the virtual wheel, and how far each wheel is from rolling with it (root mean square, >= 0).
        """
        left, right = self.speed_ratios(steering)
        rolled_left = speed_left + self.scrub_radius * rate_left
        rolled_right = speed_right - self.scrub_radius * rate_right
        square = left * left + right * right
        speed = (left * rolled_left + right * rolled_right) / square
        return speed, abs(right * rolled_left - left * rolled_right) / sqrt(2.0 * square)
