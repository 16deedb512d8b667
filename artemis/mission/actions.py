"""The steps of a mission that do something, as its file writes them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from artemis import drive_schema
from artemis.config import Config, OpenConfig
from artemis.mission.keys import Name, Positive, check_one_key
from artemis.mission.obstacles import Obstacles
from artemis.motion.path_points import MIN_STEP


def _not_empty(parts: tuple[Any, ...]) -> tuple[Any, ...]:
    if not parts:
        raise ValueError("expected a list of at least one")
    return parts


A_LIST = (Field(strict=False, json_schema_extra={"minItems": 1}), AfterValidator(_not_empty))
"""Of a tuple: in a file it is a list, and not empty."""
FileName = Annotated[str, Field(min_length=1)]
"""Relative to the folder of the mission file, and inside of it."""


Angle = Annotated[float, Field(ge=-45, le=45)]
"""[degrees]."""


class PluginUse(OpenConfig):
    """A plugin by its name; every other key belongs to the plugin."""

    plugin: str
    """Its name: `artemis plugins` lists them. Every other key is the plugin's own."""


class FollowerUse(PluginUse):
    """A path follower; artemis' own unless another is named."""

    plugin: str = "frenet"
    """Its name."""


class Reference(Config):
    """True angle of each front wheel, measured from outside."""

    left: Angle | None = None
    """Of the left wheel."""
    right: Angle | None = None
    """Of the right wheel."""
    middle: Angle | None = None
    """Of what a single steering motor turns."""


LARGEST_UNSEEN_DEG = 5.0
"""A wheel that is farther off stands visibly askew: the reference, or the wheel that is meant, is probably wrong."""


class MeasureSteering(Config):
    """Find zero and slope of the potentiometers: turn each wheel by 45 degrees to both sides and read them."""

    wheels: Literal["left", "right", "middle", "both"] = "both"
    """Which are measured; middle: what a single steering motor turns, as `both` on such a robot."""
    reference_deg: Reference = Reference()
    """True angle of a wheel, left positive, while it shows 0 (of one with new potentiometers: as it is found). Without
    it a person turns the wheel until it stands straight."""
    potentiometers: Literal["known", "new"] = "known"
    """New: nothing that they say now is believed; the wheels are aligned by hand or reference alone."""
    save: Literal["nothing", "ask", "drives"] = "nothing"
    """What to do with the result in the drives' memory; ask: ask the operator at the terminal."""

    @model_validator(mode="after")
    def _unseen(self) -> Self:
        if self.potentiometers == "new" or self.save != "drives":
            return self
        for side, angle in self.reference_deg:
            if abs(angle or 0.0) > LARGEST_UNSEEN_DEG:
                raise ValueError(
                    f"reference_deg.{side} is {angle:g}: a zero that is wrong by more than {LARGEST_UNSEEN_DEG:g} "
                    "degrees is not saved unless a person agrees: write save: ask (or potentiometers: new)"
                )
        return self

    @model_validator(mode="after")
    def _both(self) -> Self:
        if self.potentiometers == "new" and self.wheels != "both":
            raise ValueError("with new potentiometers both wheels are measured: leave `wheels` out")
        return self


def _kind_of_steering(steering: object) -> str:
    return "<measured>" if isinstance(steering, dict | MeasureSteering) else "<word>"


class NewGains(Config):
    """Regulator gains of a drive to try, as the robot file has them; those that are left out stay as it says."""

    current: Annotated[tuple[drive_schema.AnyGain, drive_schema.AnyGain], Field(strict=False)] | None = None
    """P and I of the current regulator."""
    velocity: Annotated[tuple[drive_schema.AnyGain, drive_schema.AnyGain], Field(strict=False)] | None = None
    """P and I of the velocity regulator."""
    position: (
        Annotated[tuple[drive_schema.AnyGain, drive_schema.AnyGain, drive_schema.AnyGain], Field(strict=False)] | None
    ) = None
    """P, I and D of the position regulator."""

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if not self.model_dump(exclude_none=True):
            raise ValueError("expected at least one of current, velocity, position")
        return self


class Turn(Config):
    """Turn the wheels and back at rest, to see how the steering drives follow."""

    side: Literal["left", "right", "middle"] | None = None
    """Whose angle is meant: of the left wheel, or of a single steering motor."""
    angle_deg: Annotated[float, Field(gt=0, le=20)] = 5.0
    """To the left."""


class Calibrate(Config):
    """Align the wheels, or measure what the robot has to know of itself: exactly one key."""

    steering: (
        Annotated[
            Annotated[Literal["from_potentiometers", "align"], Tag("<word>")]
            | Annotated[MeasureSteering, Tag("<measured>")],
            Discriminator(_kind_of_steering),
        ]
        | None
    ) = None
    """Align the wheels (`align`: a robot without potentiometers, as its file says), or measure their potentiometers."""
    gains: Annotated[dict[str, NewGains], Field(min_length=1)] | None = None
    """Try other regulator gains, by drive: until the run ends, or a fault has the drives configured anew."""
    turn: Turn | None = None
    """Turn the wheels by a step."""

    @property
    def sides(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """Sides of the steering that are named, each with its keys."""
        if isinstance(self.steering, MeasureSteering):
            if self.steering.wheels != "both":
                yield ("steering", "wheels"), self.steering.wheels
            for side, angle in self.steering.reference_deg:
                if angle is not None:
                    yield ("steering", "reference_deg", side), side
        if self.turn is not None and self.turn.side is not None:
            yield ("turn", "side"), self.turn.side

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        check_one_key(self, "calibrate")
        return self


Waypoint = Annotated[list[Annotated[float, Field(ge=-20_000, le=20_000)]], Field(min_length=2, max_length=2)]
"""x, y [m]."""


def _apart(waypoints: list[Waypoint]) -> list[Waypoint]:
    for number, (before, after) in enumerate(pairwise(waypoints), start=2):
        if math.dist(before, after) < MIN_STEP:
            raise ValueError(f"waypoint {number} is at the place of the one before; remove it")
    return waypoints


class Waypoints(Config):
    """A path of straight lines; a corner becomes the nearest curve that the robot can drive."""

    waypoints: Annotated[list[Waypoint], Field(min_length=2, max_length=1000), AfterValidator(_apart)]
    """Each [x, y] in metres, from where the robot stands when the run is armed."""


class Recorded(Config):
    """A path that an earlier step of the same mission recorded."""

    recorded: Name
    """Its name, as the step that recorded it has it in `record`."""
    close_within_m: Annotated[float, Field(ge=0, le=2)] = 0.0
    """If it ends this near its beginning, in about the same direction, it continues there: for several laps."""


def _kind_of_path(path: object) -> str:
    if isinstance(path, Waypoints) or (isinstance(path, dict) and "waypoints" in path):
        return "<waypoints>"
    return "<recorded>" if isinstance(path, dict | Recorded) else "<file>"


class Follow(Config):
    """Drive along a path to its end."""

    path: Annotated[
        Annotated[FileName, Tag("<file>")]
        | Annotated[Recorded, Tag("<recorded>")]
        | Annotated[Waypoints, Tag("<waypoints>")],
        Discriminator(_kind_of_path),
    ]
    """Table of x, y in metres, from where the robot stands when the run is armed; or {recorded: NAME}; or
    {waypoints: [[x, y], ...]}."""
    follower: FollowerUse
    """What steers and drives; `speed_m_s` and all other keys are those of the plugin."""
    laps: Annotated[int, Field(ge=1, le=10_000)] = 1
    """More than one only on a closed path."""
    start: Literal["beginning", "nearest"] = "beginning"
    """Where the path is begun: where it begins, or at its nearest point."""
    from_end: bool = False
    """From the path's last point to its first, headings as they are: what was driven forwards is driven backwards."""
    direction: Literal["forward", "backward"] | None = None
    """Which end of the robot is ahead when it begins; each reversal changes that. Goes before the path's headings, and
    before what `from_end` makes of them; without any of these: forward."""
    round_corners_m: Annotated[float, Field(ge=0, le=1)] | None = None
    """A corner that is too sharp for the robot becomes the nearest curve that it can drive, if that is no farther from
    the corner; 0: it is refused (PTH-03). If left out: 0, but 1 for waypoints."""
    allow_slowdown: bool | None = None
    """Where steering or a wheel cannot keep up the robot drives slower; false: the path is refused (PTH-03). If left
    out: false, but true for waypoints."""
    max_cross_track_m: Annotated[float, Field(gt=0, le=0.6)] = 0.6
    """Farther from the path than this the robot is lost and stops (fault PTH-06)."""
    obstacles: Obstacles | None = None
    """In this step; if left out, as in the mission."""

    @property
    def wanted(self) -> dict[str, Any]:
        """How its path is wanted: words of `artemis.motion.fitting.route_for`."""
        lines = isinstance(self.path, Waypoints)
        return {
            "laps": self.laps,
            "from_end": self.from_end,
            "backward": None if self.direction is None else self.direction == "backward",
            "round_corners": float(lines) if self.round_corners_m is None else self.round_corners_m,
            "allow_slowdown": lines if self.allow_slowdown is None else self.allow_slowdown,
        }


ConditionText = Annotated[str, Field(min_length=1, max_length=1000, json_schema_extra={"format": "condition"})]
"""One line over signals, such as `battery_v < 23.2 and not stick.done`."""
Text = Annotated[str, Field(min_length=1, max_length=1000)]


class Wait(Config):
    """Stand still: for a time, or until a condition holds."""

    seconds: Positive | None = None
    """Done after so long."""
    for_: ConditionText | None = Field(default=None, alias="for")
    """Done once this holds."""
    at_most_s: Positive | None = None
    """Of a condition: after so long the step ends with the outcome `timeout`."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.seconds is None) == (self.for_ is None):
            raise ValueError("wait has exactly one of seconds, for")
        if self.seconds is not None and self.at_most_s is not None:
            raise ValueError("at_most_s belongs to wait: {for: ...}; seconds are its own end")
        return self


Answer = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[^']+$")]


class Ask(Config):
    """Ask the operator at the terminal; the answer is the signal `answer`."""

    question: Text
    """What is asked, in words."""
    answers: Annotated[tuple[Answer, ...], *A_LIST, Field(max_length=9)]
    """Between which the person chooses, by number or by name."""
    at_most_s: Positive | None = None
    """After so long the step ends with the outcome `timeout`."""

    @model_validator(mode="after")
    def _different(self) -> Self:
        if len(set(self.answers)) < len(self.answers):
            raise ValueError("two answers are the same")
        return self


class Until(Config):
    """When driving by hand is over: either key."""

    button: Literal["done"] | None = None
    """The button `done` of the input."""
    seconds: Positive | None = None
    """So long."""

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        check_one_key(self, "until")
        return self


class Teleop(Config):
    """Drive by hand with one of the mission's inputs, or with several by priority."""

    input: str | None = None
    """One of the mission's `inputs`."""
    inputs: Annotated[tuple[str, ...], Field(strict=False, min_length=2)] | None = None
    """The first that is active has the robot; another one takes over once that was released, and its own controls
    were."""
    until: Until
    """When it is over."""
    record: Name | None = None
    """Record the path that is driven under this name: all of it, or what lies between two presses of the record
    button. It is kept in the run's folder, and a later step may follow it."""
    obstacles: Obstacles | None = None
    """In this step; if left out, as in the mission."""

    @property
    def names(self) -> tuple[str, ...]:
        """Its inputs, the one of the highest priority first."""
        return self.inputs or (self.input or "",)

    @model_validator(mode="after")
    def _input_or_inputs(self) -> Self:
        if (self.input is None) == (self.inputs is None):
            raise ValueError("expected input: NAME, or inputs: [FIRST, SECOND], the highest priority first")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"inputs: one of them twice: {', '.join(self.names)}")
        return self


class Stop(Config):
    """End the mission: stand, drives off. Only as the last step."""
