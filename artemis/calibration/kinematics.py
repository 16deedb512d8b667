"""What is calibrated of a machine, and how it moves: the odometry of a whole run at once, for any parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from artemis.axles import OWN_SIDES, Geometry
from artemis.calibration.wheel_log import WheelLog
from artemis.linkage import MeasuredLinkage
from artemis.motion.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Kinematics:
    """True measures of a machine, relative to what its log was counted with.

    Left and right are those of the motors; of one in the middle both are the same.
    """

    distance_left: float = 1.0
    """True distance per counted distance of the left driven wheel."""
    distance_right: float = 1.0
    zero_left: float = 0.0
    """Counted angle at which the left wheel truly stands straight [rad, left positive]."""
    zero_right: float = 0.0
    scale_left: float = 1.0
    """True change of angle per counted one."""
    scale_right: float = 1.0
    wheelbase: float
    """[m]."""
    kingpin_distance: float
    """Distance of the kingpins [m]."""
    scrub_radius: float
    """Contact point outboard of the kingpin [m]."""
    front_driven: bool = True
    one_steers: bool = False
    """One motor steers: it turns as far as the virtual front wheel, or as its linkage says."""
    linkage: MeasuredLinkage | None = None
    differential: bool = False
    rear_track: float | None = None
    """Of a machine with one front wheel [m]; None: as far apart as the front wheels."""

    @classmethod
    def of(cls, geometry: Geometry) -> Kinematics:
        """The machine as it is described, counted as it is."""
        return cls(
            wheelbase=geometry.wheelbase_m,
            kingpin_distance=geometry.kingpin_distance_m,
            scrub_radius=geometry.scrub_radius_m,
            front_driven=geometry.driven_axle == "front",
            one_steers=geometry.sides("steering") != OWN_SIDES,
            linkage=MeasuredLinkage(geometry) if isinstance(geometry.linkage, tuple) else None,
            differential=geometry.differential,
            rear_track=geometry.track_m if geometry.front_wheels == 1 else None,
        )

    @property
    def track(self) -> float:
        """Distance of the wheels' contact points [m]."""
        return self.kingpin_distance + 2.0 * self.scrub_radius if self.rear_track is None else self.rear_track


@dataclass(frozen=True, slots=True)
class Parameter:
    """One direction in which a machine may differ from its description.

    Left and right are fitted as mean and difference: a body's motion shows the one far better than the other.
    """

    name: str
    band: float
    """How far machines plausibly are from their description: one standard deviation."""
    needs: str
    """What runs must contain to show it."""
    seen: float = 1 / 3
    """It is estimated if the runs narrow its band to this share."""


MAIN = 0.8
"""Share for what every machine has wrong: better estimated with a wide interval than kept, the bands limit it."""
ONE_WHEEL = (
    Parameter("distance", 0.02, "a longer distance, or a more accurate truth", MAIN),
    Parameter("zero", radians(1.5), "a longer distance, or a more accurate truth", MAIN),
    Parameter("wheelbase", 0.04, "curves", MAIN),
    Parameter("scale", 0.01, "steering angles beyond 30 degrees, to both sides"),
)
"""Of a machine whose one front wheel is driven and steered; "zero" in rad, the others relative."""
TWO_WHEELS = (
    *ONE_WHEEL,
    Parameter("scrub radius", 0.1, "steering at standstill, or large angles"),
    Parameter("scale difference", 0.01, "steering angles beyond 30 degrees, to both sides"),
    Parameter("distance difference", 0.01, "large angles to both sides, and a truth of the rear axle's centre"),
    Parameter(
        "zero difference", radians(0.7), "`artemis calibrate steering`: the motion of the body hardly depends on it"
    ),
    Parameter(
        "kingpin distance",
        0.02,
        "a measurement of the kingpins: the motion of the body depends on it as on the wheelbase",
    ),
)
"""Of a machine with two; differences are left less right. Of parameters that look alike, the later one is held."""


def parameters_of(geometry: Geometry) -> tuple[Parameter, ...]:
    """Those in which a machine with such wheels may differ."""
    pair, single = geometry.sides("steering") == OWN_SIDES, geometry.sides("traction") != OWN_SIDES
    unknown = {"distance difference"} if single else set()
    if not pair:
        unknown |= {"scrub radius", "scale difference", "zero difference", "kingpin distance"}
    return tuple(each for each in TWO_WHEELS if each.name not in unknown)


def altered(base: Kinematics, values: dict[str, float]) -> Kinematics:
    """The machine that differs from `base` by some parameters (those that are not given: not at all)."""

    def both(name: str) -> tuple[float, float]:
        mean, half = values.get(name, 0.0), values.get(f"{name} difference", 0.0) / 2.0
        return mean + half, mean - half

    distance, zero, scale = both("distance"), both("zero"), both("scale")
    return replace(
        base,
        distance_left=base.distance_left * (1.0 + distance[0]),
        distance_right=base.distance_right * (1.0 + distance[1]),
        zero_left=base.zero_left + zero[0],
        zero_right=base.zero_right + zero[1],
        scale_left=base.scale_left * (1.0 + scale[0]),
        scale_right=base.scale_right * (1.0 + scale[1]),
        wheelbase=base.wheelbase * (1.0 + values.get("wheelbase", 0.0)),
        kingpin_distance=base.kingpin_distance * (1.0 + values.get("kingpin distance", 0.0)),
        scrub_radius=base.scrub_radius * (1.0 + values.get("scrub radius", 0.0)),
    )


def dead_reckoned(log: WheelLog, machine: Kinematics) -> Array:
    """Poses of the rear axle's centre, from the origin: x, y [m], heading [rad, not wrapped]; shape (n, 3).

    Each step is the rigid motion that fits the rolling of both driven wheels and the grip of both steered ones best,
    by least squares, with the angles in the middle of the step by the parabola through the last three. Wheels that
    are a pair fit exactly, and then it is what `Odometer` does. Wheels that are none by the fitted parameters (they
    were set by the described ones) fight each other, which `Odometer` does not know.
    """
    left = machine.scale_left * (log.steering_left - machine.zero_left)
    right = machine.scale_right * (log.steering_right - machine.zero_right)
    if machine.one_steers:
        left, right = _on_one_motor(machine, left)
    roll_left = machine.distance_left * np.diff(log.distance_left)
    roll_right = machine.distance_right * np.diff(log.distance_right)
    if machine.front_driven:
        roll_left += machine.scrub_radius * np.diff(left)
        roll_right -= machine.scrub_radius * np.diff(right)
    distance, turn = _rigid_motion(machine, _amid(left), _amid(right), roll_left, roll_right)
    heading = np.append(0.0, np.cumsum(turn))
    chord, direction = distance * np.sinc(turn / (2.0 * np.pi)), heading[:-1] + turn / 2.0
    x, y = np.cumsum(chord * np.cos(direction)), np.cumsum(chord * np.sin(direction))
    return np.column_stack([np.append(0.0, x), np.append(0.0, y), heading])


def _on_one_motor(machine: Kinematics, motor: Array) -> tuple[Array, Array]:
    """Angles of both front wheels [rad]: the pair about the turning point to which their motor is turned.

    What a linkage is off that pair, the odometry does not know either.
    """
    if machine.linkage is not None:
        motor = np.array([machine.linkage.steering(angle) for angle in motor.tolist()])
    offset = machine.kingpin_distance / (2.0 * machine.wheelbase) * np.sin(motor)
    return np.arctan2(np.sin(motor), np.cos(motor) - offset), np.arctan2(np.sin(motor), np.cos(motor) + offset)


def _amid(angle: Array) -> Array:
    """Mean of the angle over each step, as `Odometer` takes it (Adams-Moulton)."""
    change = np.diff(angle)
    return np.asarray(angle[1:] - change / 2.0 - (change - np.append(0.0, change[:-1])) / 12.0)


def _rigid_motion(machine: Kinematics, left: Array, right: Array, along: Array, beside: Array) -> tuple[Array, Array]:
    """Distance of the rear axle's centre [m] and turn [rad] in each step, from the wheels' angles and rolled distances.

    Rows of u (distance) and w (turn), kingpins at (L, ±B/2), contact points R outboard, upper sign left:
    front wheel rolls u cos(d) + w (L sin(d) -+ B/2 cos(d) -+ R), front wheel grips -u sin(d) + w (L cos(d) ±
    B/2 sin(d)) = 0, rear wheel rolls u -+ w S/2, S the track. A differential gives the mean of both rolling rows.
    """
    length, half, scrub = machine.wheelbase, machine.kingpin_distance / 2.0, machine.scrub_radius
    rolls, rows = [], []
    for angle, rolled, side in ((left, along, 1.0), (right, beside, -1.0)):
        sin, cos = np.sin(angle), np.cos(angle)
        if machine.front_driven:
            rolls.append((cos, length * sin - side * (half * cos + scrub), rolled))
        else:
            rolls.append((np.ones_like(angle), np.full_like(angle, -side * machine.track / 2.0), rolled))
        rows.append((-sin, length * cos + side * half * sin, np.zeros_like(angle)))
    if machine.differential:
        rolls = [tuple((a + b) / 2.0 for a, b in zip(*rolls, strict=True))]
    rows += rolls
    u, w, r = (np.array(column) for column in zip(*rows, strict=True))
    uu, uw, ww, ur, wr = (np.sum(product, axis=0) for product in (u * u, u * w, w * w, u * r, w * r))
    determinant = uu * ww - uw * uw
    return (ur * ww - wr * uw) / determinant, (uu * wr - uw * ur) / determinant
