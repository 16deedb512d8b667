"""What a robot file says of the robot's body and of the laser scanners on it."""

from __future__ import annotations

from math import radians
from typing import Annotated, Self

from pydantic import Field, model_validator

from artemis.config import Config, OpenConfig, Quantity

Reach = Annotated[float, Quantity(0.0, 10.0, "m")]
Offset = Annotated[float, Quantity(0.0, 10.0, "m", signed=True)]
Degrees = Annotated[float, Quantity(0.0, 360.0, "degrees", signed=True)]
Sector = Annotated[tuple[Degrees, Degrees], Field(strict=False)]  # YAML knows only lists

LARGEST_MASK = 54.0
"""A fifth of 270 degrees: a scanner that is covered by more sees too little to be of use [degrees]."""


class Outline(Config):
    """The rectangle around the whole robot, with its wheels turned out to both sides."""

    front_m: Reach
    """Of its front edge, ahead of the centre of the rear axle."""
    rear_m: Reach
    """Of its rear edge, behind the centre of the rear axle."""
    half_width_m: Reach
    """From the middle to either side."""


class Mounting(OpenConfig):
    """One laser scanner: where it sits, and what it sees of the robot itself. Every other key is its plugin's.

    Its frame has x ahead of the scanner, and angles count counter-clockwise from there, seen from above; also of one
    that hangs upside down.
    """

    plugin: str
    """Of the group `artemis.scanners`."""
    x_m: Offset
    """Ahead of the centre of the rear axle."""
    y_m: Offset
    """To the left of it."""
    heading_deg: Degrees
    """Where the scanner's x axis points to; 0: ahead, left positive."""
    height_m: Reach
    """Of the plane that it scans, above the ground: it sees nothing below and nothing above."""
    upside_down: bool = False
    """It is mounted upside down: artemis mirrors what it measures."""
    least_range_m: Reach
    """Nearer than this it sees nothing (LMS100: 0.5)."""
    mask: Annotated[tuple[Sector, ...], Field(strict=False)] = ()
    """Sectors [from, to] in which the scanner sees the robot itself, in its frame [degrees], from right to left."""

    @property
    def heading(self) -> float:
        """[rad]."""
        return radians(self.heading_deg)

    @model_validator(mode="after")
    def _sectors(self) -> Self:
        before = -180.0
        for start, stop in self.mask:
            if not before <= start < stop <= 180.0:
                raise ValueError(
                    f"mask: [{start:g}, {stop:g}]: sectors go from right to left, in this order, within -180 to 180 "
                    "degrees, and do not overlap"
                )
            before = stop
        masked = sum(stop - start for start, stop in self.mask)
        if masked > LARGEST_MASK:
            raise ValueError(
                f"mask: {masked:g} degrees are masked, at most {LARGEST_MASK:g} can be: mount the scanner where it "
                "sees less of the robot"
            )
        return self
