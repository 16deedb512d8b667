"""How a robot stands on its wheels: axles, who steers and who drives them, and what of that was measured."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from artemis.config import Config, Inconsistent, Quantity
from artemis.yaml_file import KeyPath

Length = Annotated[float, Quantity(0.1, 10.0, "m")]
Inset = Annotated[float, Quantity(0.0, 2.0, "m")]
Voltage = Annotated[float, Quantity(0.0, 10.0, "V")]
Slope = Annotated[float, Quantity(5.0, 2000.0, "degrees/V", signed=True)]
Rolled = Annotated[float, Quantity(1e-12, 0.1, "m per count")]
Voltages = Annotated[tuple[Voltage, Voltage], Field(strict=False)]  # YAML knows only lists
Slopes = Annotated[tuple[Slope, Slope], Field(strict=False)]
WheelAngle = Annotated[float, Quantity(0.0, 89.0, "degrees", signed=True)]

Side = Literal["left", "right", "middle"]
"""Where a drive acts: on one wheel of its axle, or in the middle: on the only one, or by a linkage or differential on
both."""
OWN_SIDES, MIDDLE = ("left", "right"), ("middle",)


class LinkageRow(Config):
    """One position of a linkage, measured at the wheels; angles are left positive."""

    motor_deg: Annotated[float, Quantity(0.0, 180.0, "degrees", signed=True)]
    """Of what the steering motor turns, behind its gear."""
    left_deg: WheelAngle
    """Of the left wheel, at this position of the motor."""
    right_deg: WheelAngle
    """Of the right wheel, likewise."""


LinkageTable = Annotated[tuple[LinkageRow, ...], Field(strict=False, min_length=3)]
Linkage = Annotated[
    Annotated[Literal["ackermann"], Tag("<word>")] | Annotated[LinkageTable, Tag("<table>")],
    Discriminator(lambda given: "<word>" if isinstance(given, str) else "<table>"),
]
"""`ackermann`: both wheels always turn about one point, and the motor turns as far as the virtual front wheel."""


class Geometry(Config):
    """Where the wheels are. Kingpins stand `track_m - 2 * scrub_radius_m` apart on the front axle."""

    wheelbase_m: Length
    """Distance of the front axle's centre from that of the rear axle."""
    track_m: Length
    """Distance of the contact points of the driven axle's wheels; the other axle counts only by its kingpins."""
    scrub_radius_m: Inset
    """Distance of the contact point outboard of the kingpin; 0 with one front wheel."""
    driven_axle: Literal["front", "rear"]
    """Which wheels the traction motors turn; front: the steered ones."""
    front_wheels: Literal[1, 2] = 2
    """1: a tricycle."""
    linkage: Linkage | None = None
    """By it one motor steers both front wheels: `ackermann`, or a table measured from lock to lock; if left out, each
    front wheel has a steering motor."""
    differential: bool = False
    """One motor drives both wheels of the driven axle by it; else each driven wheel has a motor."""

    @property
    def kingpin_distance_m(self) -> float:
        """Distance of the kingpins [m] (thesis equation 3.6); 0 with one front wheel."""
        return self.track_m - 2 * self.scrub_radius_m if self.front_wheels == 2 else 0.0

    @property
    def steered_kingpin_distance_m(self) -> float:
        """The same as steering motors see it: one in the middle turns as far as the virtual front wheel."""
        return self.kingpin_distance_m if self.sides("steering") == OWN_SIDES else 0.0

    def sides(self, role: str) -> tuple[str, ...]:
        """Where the drives of a role (`steering`, `traction`) act: left and right, or one in the middle."""
        single = self.front_wheels == 1
        if role == "steering":
            return MIDDLE if single or self.linkage is not None else OWN_SIDES
        return MIDDLE if self.differential or (single and self.driven_axle == "front") else OWN_SIDES

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems = [*_surplus(self), *(_turning(self.linkage) if isinstance(self.linkage, tuple) else ())]
        if problems:
            raise Inconsistent(problems)
        return self


Problems = Iterator[tuple[KeyPath, str]]


def _surplus(geometry: Geometry) -> Problems:
    """What a robot with such wheels has not, or what of it is not computed."""
    single, front = geometry.front_wheels == 1, geometry.driven_axle == "front"
    if single and geometry.linkage is not None:
        yield ("linkage",), "one front wheel needs no linkage: leave it out"
    if single and front and geometry.differential:
        yield ("differential",), "one driven wheel needs no differential: leave it out"
    if single and geometry.scrub_radius_m:
        yield ("scrub_radius_m",), f"expected 0 with one front wheel, found {geometry.scrub_radius_m:g}"
    elif front and geometry.scrub_radius_m and (geometry.linkage is not None or geometry.differential):
        text = (
            "expected 0 for driven front wheels with a linkage or a differential (what they roll when they are steered"
        )
        yield ("scrub_radius_m",), f"{text} is known only of wheels with their own motors)"


def _turning(table: tuple[LinkageRow, ...]) -> Problems:
    """A linkage turns both wheels with the motor, all in one sense, and passes straight ahead."""
    for key in ("motor_deg", "left_deg", "right_deg"):
        angles = [getattr(row, key) for row in table]
        for number, (before, after) in enumerate(pairwise(angles), 1):
            if after <= before:
                text = f"expected more than {before:g}, the one before: each angle rises from row to row"
                yield ("linkage", number, key), f"{text}, found {after:g}"
        if not angles[0] < 0.0 < angles[-1]:
            yield ("linkage",), f"expected {key} to both sides of straight ahead, found {angles[0]:g} to {angles[-1]:g}"


def proportions(geometry: Geometry) -> Problems:
    """Lengths that no robot has together; the keys are those of its file."""
    if geometry.kingpin_distance_m < 0:
        yield (
            ("geometry", "scrub_radius_m"),
            f"{geometry.scrub_radius_m:g} m is more than half of track_m ({geometry.track_m:g} m)",
        )
    if geometry.track_m > 3 * geometry.wheelbase_m:
        yield (
            ("geometry", "track_m"),
            f"expected at most three times wheelbase_m ({geometry.wheelbase_m:g} m), found {geometry.track_m:g} m",
        )


class Potentiometers(Config):
    """One steered wheel. Both potentiometers, angle = slope * (voltage - zero), and the encoder of its motor."""

    zero_v: Voltages
    """What each potentiometer shows while the wheel stands straight."""
    slope_deg_per_v: Slopes
    """Of each potentiometer, positive where its voltage rises when the wheel turns to the left."""
    scale: Annotated[float, Quantity(0.5, 2.0, "")] = 1.0
    """True change of the wheel's angle per change that the encoder counts through the gear."""
    supply_v: Annotated[float, Quantity(1.0, 10.0, "V")] = 5.0
    """Between the ends of both: what is nearer than 2 % of it to an end is open or shorted (STE-04)."""


class ByHand(Config):
    """Nothing measures the angle: whenever the drives are brought up a person sets the wheels straight."""

    angle: Literal["by_hand"]
    """A person sets the wheels straight whenever the drives are brought up."""
    scale: Annotated[float, Quantity(0.5, 2.0, "")] = 1.0
    """As in `Potentiometers`."""


class HardStop(Config):
    """Nothing measures the angle: whenever the drives are brought up the motor looks for the end of its travel."""

    angle: Literal["hard_stop"]
    """Whenever the drives are brought up the motor turns to one end of its travel, until it is held."""
    stop_deg: Annotated[float, Quantity(5.0, 179.0, "degrees", signed=True)]
    """Where it is held, by what the motor turns, left positive: the sign says which of both ends it looks for."""
    travel_deg: Annotated[float, Quantity(10.0, 358.0, "degrees")] | None = None
    """How far the motor turns from there to its other end; measured at each start, too, if it is stated."""
    scale: Annotated[float, Quantity(0.5, 2.0, "")] = 1.0
    """As in `Potentiometers`."""


SWITCH_MARGIN_DEG = 1.0
"""So far beyond a home switch the motor has to turn [degrees]: it meets it slowly, from there."""


class HomeSwitch(Config):
    """A switch at the drive's input for it: whenever the drives are brought up the motor looks for where it changes."""

    angle: Literal["home_switch"]
    """Whenever the drives are brought up the motor turns to where the drive's input changes."""
    switch_deg: Annotated[float, Quantity(0.0, 179.0, "degrees", signed=True)]
    """Where the input goes on when the motor turns to `on_side`, by what the motor turns, left positive."""
    on_side: Literal["left", "right"]
    """On this side of that angle the input is on, as far as the motor can turn; on the other side it is off."""
    scale: Annotated[float, Quantity(0.5, 2.0, "")] = 1.0
    """As in `Potentiometers`."""


class AbsoluteEncoder(Config):
    """An absolute encoder that turns with the wheel: its drive reads it."""

    angle: Literal["absolute_encoder"]
    """The drive reads an encoder that knows the wheel's angle after power-up, too."""
    bits: Annotated[int, Field(ge=8, le=30)]
    """Of one turn: it counts to 2 ** bits."""
    coding: Literal["gray", "binary"] = "gray"
    """Of what it sends to a drive that has to know it."""
    mirrored: bool
    """It counts up when the wheel turns to the right."""
    zero_deg: Annotated[float, Quantity(0.0, 360.0, "degrees", signed=True)]
    """What it shows of its turn while the wheel stands straight."""
    scale: Annotated[float, Quantity(0.5, 2.0, "")] = 1.0
    """As in `Potentiometers`."""


AnyAngleSource = Potentiometers | ByHand | HardStop | HomeSwitch | AbsoluteEncoder
_KINDS = {kind: f"<{kind.replace('_', ' ')}>" for kind in ("by_hand", "hard_stop", "home_switch", "absolute_encoder")}


def _kind_of_angle(given: object) -> str:
    kind = given.get("angle") if isinstance(given, dict) else getattr(given, "angle", None)
    return "<potentiometers>" if kind is None else _KINDS.get(str(kind), str(kind))


AngleSource = Annotated[
    Annotated[Potentiometers, Tag("<potentiometers>")]
    | Annotated[ByHand, Tag("<by hand>")]
    | Annotated[HardStop, Tag("<hard stop>")]
    | Annotated[HomeSwitch, Tag("<home switch>")]
    | Annotated[AbsoluteEncoder, Tag("<absolute encoder>")],
    Discriminator(_kind_of_angle),
]
"""How the angle of what a steering motor turns becomes known."""


class SteeringCalibration(Config):
    """Per steering motor, by its side. Of one in the middle the angle is that of its linkage, or of its wheel."""

    left: AngleSource | None = None
    """How the angle of the left wheel becomes known: by potentiometers, or as its key `angle` says."""
    right: AngleSource | None = None
    """The same of the right wheel."""
    middle: AngleSource | None = None
    """The same of a single steering motor, instead of `left` and `right`."""
    disagreement_deg: Annotated[float, Quantity(0.1, 30.0, "degrees")] = 3.0
    """The two potentiometers of a wheel may differ by this much (fault STE-03 beyond)."""


class TractionCalibration(Config):
    """Metres that a wheel rolls per encoder count; `middle`: the only driven wheel, or the mean of a differential's."""

    left_m_per_count: Rolled | None = None
    """Of the driven wheel on the left, if it has a motor of its own."""
    right_m_per_count: Rolled | None = None
    """Of the driven wheel on the right, if it has a motor of its own."""
    middle_m_per_count: Rolled | None = None
    """Of the only driven wheel, or the mean of both behind a differential."""


class Calibration(Config):
    """What was measured on this machine."""

    steering: SteeringCalibration
    traction: TractionCalibration
