"""The true vehicle: what the ground makes of its wheels, of which the front ones are steered and some driven.

The motion of a rigid body on its wheels (rear axle centre, u forward, omega counter-clockwise; the rear wheels do not
slide sideways) has to satisfy, for kingpins at (L, ±B/2) and contact points R outboard of them,

    front wheel rolls    (u -+ omega B/2) cos(delta) + omega L sin(delta) -+ R (omega + d delta/dt) = rolling speed
    front wheel grips   -(u -+ omega B/2) sin(delta) + omega L cos(delta)                           = 0
    rear wheel rolls      u -+ omega S/2                                                            = rolling speed

(upper sign left), of which the driven wheels' rolling and the front wheels' grip are more than two equations: the
vehicle moves as fits all of them best, by least squares. For wheels set as an Ackermann pair all are met exactly.
One front wheel is a pair on one kingpin (B = R = 0). A differential gives only the mean of both rolling speeds.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Chassis:
    """Where the wheels truly are [m], and which of them are driven."""

    wheelbase: float
    track: float
    scrub_radius: float
    front_driven: bool
    front_wheels: int = 2
    differential: bool = False

    @property
    def half_kingpin(self) -> float:
        """Half of the distance of the kingpins [m]."""
        return 0.5 * self.track - self.scrub_radius if self.front_wheels == 2 else 0.0


class Vehicle:
    """A pose that moves when wheels turn."""

    def __init__(
        self,
        chassis: Chassis,
        *,
        steering: tuple[float, float],
        dice: random.Random,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
        slip: float = 0.0,
    ) -> None:
        """Stand at `pose`.

        Args:
            chassis: The vehicle's true measures.
            steering: Angles of the left and right front wheel [rad], left positive.
            dice: Draws each driven wheel's loss in each step.
            pose: x, y [m] and heading [rad] of the rear axle's centre.
            slip: Share of its distance that a driven wheel loses, on average.
        """
        self.x, self.y, self.heading = pose
        self.distance = 0.0
        """Distance of the rear axle's centre in the last step [m], forward positive."""
        self.turn = 0.0
        """Change of the heading in the last step [rad]."""
        self._chassis = chassis
        self._left, self._right = steering
        self._slip = slip
        self._dice = dice

    def move(self, steering_left: float, steering_right: float, distance_left: float, distance_right: float) -> None:
        """Move one step.

        Args:
            steering_left: Angle of the left front wheel after the step [rad].
            steering_right: Angle of the right front wheel after the step [rad].
            distance_left: What the left driven wheel rolled in the step [m], forward positive.
            distance_right: What the right driven wheel rolled in the step [m].
        """
        turned_left, turned_right = steering_left - self._left, steering_right - self._right
        if distance_left == distance_right == turned_left == turned_right == 0.0:
            self.distance = self.turn = 0.0
            return
        if self._slip:
            distance_left *= 1.0 - self._dice.uniform(0.0, 2.0 * self._slip)
            distance_right *= 1.0 - self._dice.uniform(0.0, 2.0 * self._slip)
        left, right = 0.5 * (self._left + steering_left), 0.5 * (self._right + steering_right)
        self._left, self._right = steering_left, steering_right
        if self._chassis.differential:
            fit = fit_differential(self._chassis, left, right, 0.5 * (distance_left + distance_right))
        elif self._chassis.front_driven:
            scrub = self._chassis.scrub_radius
            fit = fit_front_driven(
                self._chassis, left, right, distance_left + scrub * turned_left, distance_right - scrub * turned_right
            )
        else:
            fit = fit_rear_driven(self._chassis, left, right, distance_left, distance_right)
        self.distance, self.turn = fit
        self._roll(*fit)

    def _roll(self, distance: float, turn: float) -> None:
        """Move along an arc of length `distance` [m] that turns by `turn` [rad]: exact for constant curvature."""
        half = 0.5 * turn
        chord = distance * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        self.x += chord * math.cos(self.heading + half)
        self.y += chord * math.sin(self.heading + half)
        self.heading += turn


def fit_front_driven(
    chassis: Chassis, left: float, right: float, roll_left: float, roll_right: float
) -> tuple[float, float]:
    """Motion of a front-driven vehicle: distance of the rear axle's centre [m] and change of heading [rad].

    Args:
        chassis: The vehicle's measures.
        left: Angle of the left front wheel [rad].
        right: Angle of the right front wheel [rad].
        roll_left: Rolled distance of the left front wheel [m], without what its turning about the kingpin rolls.
        roll_right: The same of the right one.
    """
    length, scrub = chassis.wheelbase, chassis.scrub_radius
    half = chassis.half_kingpin
    cos_left, sin_left = math.cos(left), math.sin(left)
    cos_right, sin_right = math.cos(right), math.sin(right)
    arm_left = length * sin_left - half * cos_left - scrub
    arm_right = length * sin_right + half * cos_right + scrub
    # Normal equations; rolling and grip of one wheel are orthogonal, so their squared coefficients of u add up to 1.
    side = scrub * (cos_right - cos_left)
    square = 2.0 * (length * length + half * half + scrub * scrub)
    square += 2.0 * scrub * (length * (sin_right - sin_left) + half * (cos_left + cos_right))
    along = cos_left * roll_left + cos_right * roll_right
    about = arm_left * roll_left + arm_right * roll_right
    determinant = 2.0 * square - side * side
    return (along * square - about * side) / determinant, (2.0 * about - side * along) / determinant


def fit_rear_driven(
    chassis: Chassis, left: float, right: float, distance_left: float, distance_right: float
) -> tuple[float, float]:
    """Motion of a rear-driven vehicle: distance of the rear axle's centre [m] and change of heading [rad].

    Args:
        chassis: The vehicle's measures.
        left: Angle of the left front wheel [rad].
        right: Angle of the right front wheel [rad].
        distance_left: Rolled distance of the left rear wheel [m].
        distance_right: The same of the right one.
    """
    length, half_track, half = chassis.wheelbase, 0.5 * chassis.track, chassis.half_kingpin
    sin_left, sin_right = math.sin(left), math.sin(right)
    grip_left = length * math.cos(left) + half * sin_left
    grip_right = length * math.cos(right) - half * sin_right
    # Normal equations; the rear wheels' arms cancel beside the diagonal, the grip rows have 0 on the right.
    ahead = 2.0 + sin_left * sin_left + sin_right * sin_right
    side = -sin_left * grip_left - sin_right * grip_right
    square = 2.0 * half_track * half_track + grip_left * grip_left + grip_right * grip_right
    along = distance_left + distance_right
    about = half_track * (distance_right - distance_left)
    determinant = ahead * square - side * side
    return (along * square - about * side) / determinant, (ahead * about - side * along) / determinant


def fit_differential(chassis: Chassis, left: float, right: float, distance: float) -> tuple[float, float]:
    """Motion of a vehicle with a differential: distance of the rear axle's centre [m] and change of heading [rad].

    Args:
        chassis: The vehicle's measures; its driven front wheels have no scrub radius.
        left: Angle of the left front wheel [rad].
        right: Angle of the right front wheel [rad].
        distance: Mean of what both driven wheels rolled [m].
    """
    length, half = chassis.wheelbase, chassis.half_kingpin
    sin_left, cos_left, sin_right, cos_right = math.sin(left), math.cos(left), math.sin(right), math.cos(right)
    along, about = 1.0, 0.0
    if chassis.front_driven:
        along = 0.5 * (cos_left + cos_right)
        about = 0.5 * (length * (sin_left + sin_right) - half * (cos_left - cos_right))
    grip_left, grip_right = length * cos_left + half * sin_left, length * cos_right - half * sin_right
    # Normal equations of the mean's row and both wheels' grip rows, which have 0 on the right.
    ahead = along * along + sin_left * sin_left + sin_right * sin_right
    side = along * about - sin_left * grip_left - sin_right * grip_right
    square = about * about + grip_left * grip_left + grip_right * grip_right
    determinant = ahead * square - side * side
    return distance * (along * square - about * side) / determinant, distance * (
        ahead * about - side * along
    ) / determinant
