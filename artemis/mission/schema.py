"""What a mission file may say, each part on its own; `loading` checks how the parts fit together."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, model_validator

from artemis import vehicle
from artemis.config import Config
from artemis.mission.waypoints import Waypoints
from artemis.supervision.catalogue import ROWS

Positive = Annotated[float, Field(gt=0)]
FileName = Annotated[str, Field(min_length=1)]
"""Relative to the folder of the mission file, and inside of it."""


def _check_name(name: str) -> str:
    if not re.fullmatch("[a-z0-9-]{1,64}", name):
        raise ValueError("expected at most 64 small letters, digits and hyphens")
    return name


Angle = Annotated[float, Field(ge=-45, le=45)]
"""[degrees]."""
Name = Annotated[str, AfterValidator(_check_name), Field(json_schema_extra={"pattern": "^[a-z0-9-]{1,64}$"})]


class PluginUse(Config):
    """A plugin by its name; every other key belongs to the plugin."""

    model_config = ConfigDict(extra="allow")
    plugin: str

    @property
    def options(self) -> dict[str, object]:
        """The plugin's own keys."""
        return dict(self.model_extra or {})


class FollowerUse(PluginUse):
    """A path follower; artemis' own unless another is named."""

    plugin: str = "frenet"


class BusWords(Config):
    """A real CAN bus in python-can's own words; words beside `interface` are the interface's."""

    model_config = ConfigDict(extra="allow")
    interface: str

    @property
    def words(self) -> dict[str, object]:
        """All words, `interface` among them."""
        return {"interface": self.interface, **(self.model_extra or {})}


def _kind_of_bus(bus: object) -> str | None:
    if isinstance(bus, dict | BusWords):
        return "<words>"
    return "<simulation>" if bus == "simulation" else None


Bus = Annotated[
    Annotated[Literal["simulation"], Tag("<simulation>")] | Annotated[BusWords, Tag("<words>")],
    Discriminator(
        _kind_of_bus,
        custom_error_type="bus",
        custom_error_message="simulation, or python-can's words such as {interface: socketcan, channel: can0}",
    ),
]


class Reference(Config):
    """True angle of each front wheel, measured from outside."""

    left: Angle | None = None
    right: Angle | None = None


LARGEST_UNSEEN_DEG = 5.0
"""A wheel that is farther off stands visibly askew: the reference, or the wheel that is meant, is probably wrong."""


class MeasureSteering(Config):
    """Find zero and slope of the potentiometers: turn each wheel by 45 degrees to both sides and read them."""

    wheels: Literal["left", "right", "both"] = "both"
    reference_deg: Reference = Reference()
    """True angle of a wheel, left positive, while it shows 0 (of one with new potentiometers: as it is found). Without
    it a person turns the wheel until it stands straight."""
    potentiometers: Literal["known", "new"] = "known"
    """New: nothing that they say now is believed; the wheels are aligned by hand or reference alone."""
    save: Literal["nothing", "ask", "drives"] = "nothing"
    """What to do with the result in the drives' memory; ask: whoever is at the terminal."""

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
    """Regulator gains of a drive to try; those that are left out stay as the robot file says."""

    current: vehicle.PiGains | None = None
    velocity: vehicle.PiGains | None = None
    position: vehicle.PidGains | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        if not self.model_dump(exclude_none=True):
            raise ValueError("expected at least one of current, velocity, position")
        return self


class Turn(Config):
    """Turn the wheels and back at rest, to see how the steering drives follow."""

    side: Literal["left", "right"] = "left"
    """Whose angle is meant."""
    angle_deg: Annotated[float, Field(gt=0, le=20)] = 5.0
    """To the left."""


class Calibrate(Config):
    """Align the wheels, or measure what the robot has to know of itself: exactly one key."""

    steering: (
        Annotated[
            Annotated[Literal["from_potentiometers"], Tag("<word>")] | Annotated[MeasureSteering, Tag("<measured>")],
            Discriminator(_kind_of_steering),
        ]
        | None
    ) = None
    """Align the wheels, or measure their potentiometers."""
    gains: Annotated[dict[str, NewGains], Field(min_length=1)] | None = None
    """Try other regulator gains, by drive: until the run ends, or a fault has the drives configured anew."""
    turn: Turn | None = None
    """Turn the wheels by a step."""

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        _check_one_key(self, "calibrate")
        return self


class Recorded(Config):
    """A path that an earlier step of the same mission recorded."""

    recorded: Name
    close_within_m: Annotated[float, Field(ge=0, le=2)] = 0.0
    """If it ends so near its beginning, in about the same direction, it goes on there: for several laps."""


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

    @property
    def wanted(self) -> dict[str, Any]:
        """How its path is wanted: words of `artemis.motion.fitting.route_for`, and of `FollowStep`."""
        lines = isinstance(self.path, Waypoints)
        return {
            "laps": self.laps,
            "from_end": self.from_end,
            "backward": None if self.direction is None else self.direction == "backward",
            "round_corners": float(lines) if self.round_corners_m is None else self.round_corners_m,
            "allow_slowdown": lines if self.allow_slowdown is None else self.allow_slowdown,
        }


class Wait(Config):
    """Stand still."""

    seconds: Positive


class Until(Config):
    """When driving by hand is over: either key."""

    button: Literal["done"] | None = None
    seconds: Positive | None = None

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        _check_one_key(self, "until")
        return self


class Teleop(Config):
    """Drive by hand with one of the mission's inputs."""

    input: str
    until: Until
    record: Name | None = None
    """Record the path that is driven under this name: all of it, or what lies between two presses of the record
    button. It is kept in the run's folder, and a later step may follow it."""


class Stop(Config):
    """End the mission: stand, drives off. Only as the last step."""


Action = Calibrate | Follow | Wait | Teleop | Stop


class Step(Config):
    """One step of the mission: a mapping with exactly one key."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})
    calibrate: Calibrate | None = None
    follow: Follow | None = None
    wait: Wait | None = None
    teleop: Teleop | None = None
    stop: Stop | None = None

    @property
    def action(self) -> Action:
        """What the step's only key holds."""
        (key,) = self.model_fields_set
        action: Action = getattr(self, key)
        return action

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        _check_one_key(self, "a step")
        return self


def _check_one_key(config: Config, name: str) -> None:
    keys = sorted(config.model_fields_set)
    if len(keys) != 1:
        choice = ", ".join(type(config).model_fields)
        raise ValueError(f"{name} has exactly one key of {choice}; found {', '.join(keys) or 'none'}")
    if getattr(config, keys[0]) is None:
        raise ValueError(f"{keys[0]} is empty; write its keys, or {{}} where it has none")


def _check_steps(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    if not steps:
        raise ValueError("expected at least one step")
    steerings = [step.calibrate.steering for step in steps if step.calibrate is not None]
    measured = [steering for steering in steerings if isinstance(steering, MeasureSteering)] if len(steps) > 1 else []
    if any(one.potentiometers == "new" for one in measured):
        raise ValueError("new potentiometers are calibrated in a mission of their own, without other steps")
    if any(one.save != "nothing" for one in measured):
        raise ValueError(
            "what is saved holds from the next start on: no other step may stand beside a calibration "
            "with save: drives or ask"
        )
    return steps


class Supervision(Config):
    """How careful the robot is."""

    stop_distance_m: Annotated[float, Field(gt=0, le=10)] = 0.6
    """A quick stop from the highest speed of the mission must need no more than this."""


class RecoveryPolicy(Config):
    """How one fault is met: stricter than the fault table, never milder."""

    reaction: Literal["W", "L", "S2", "S1", "S0"] | None = None
    """At least the table's: warn, limit, controlled stop, quick stop, off."""
    after_s: Annotated[float, Field(ge=0)] | None = None
    """How long the row's last limit may be exceeded; at most the table's time."""
    retries: Annotated[int, Field(ge=0)] | None = None
    """Automatic recoveries, at most the table's number; then a person is needed."""
    resume: Literal["wait", "continue"] = "wait"
    """After an automatic recovery: wait for arm, or go on where the robot stopped."""


class Operation(Config):
    """Something a simulated operator does."""

    at_s: Annotated[float, Field(ge=0)]
    """Run time."""
    do: Literal[
        "quickstop", "acknowledge", "arm", "end", "accept", "left_degree", "right_degree", "left_tenth", "right_tenth"
    ]
    """The last five: what a person does who calibrates the steering."""


class InjectedFault(Config):
    """Something that goes wrong in a simulated run; every other key is a parameter of the fault."""

    model_config = ConfigDict(extra="allow")
    at_s: Annotated[float, Field(ge=0)]
    """Run time."""
    inject: str
    """Row of the fault table."""
    node: str | None = None
    """The drive to which it happens, by its name in the robot file."""

    @property
    def options(self) -> dict[str, object]:
        """The fault's own keys."""
        return dict(self.model_extra or {})


class Simulation(Config):
    """What stands in for the world when the bus is simulated."""

    seed: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = 0
    pace: Literal["fast", "real_time"] | None = None
    """Faster than real time, or not; nothing: in real time if an input needs a person or a device."""
    true_robot: dict[str, object] = Field(default_factory=dict)
    """How the simulated machine differs from the robot file, unknown to the software."""
    inputs: dict[str, PluginUse] = Field(default_factory=dict)
    """Stand-ins for inputs of the mission, by the same names."""
    localizer: PluginUse | None = None
    """Stand-in for the mission's localizer, or the only one."""
    operator: Annotated[tuple[Operation, ...], Field(strict=False)] = ()
    faults: Annotated[tuple[InjectedFault, ...], Field(strict=False)] = ()
    """What goes wrong, and when."""


class Mission(Config):
    """A mission: which robot does what, on which bus."""

    mission: Name
    """Its name, also of its runs' folders."""
    robot: FileName
    bus: Bus
    tick_hz: Annotated[int, Field(ge=25, le=200)] = 50
    inputs: dict[str, PluginUse] = Field(default_factory=dict)
    observers: dict[str, PluginUse] = Field(default_factory=dict)
    """What else sees the run, by names of the mission's own."""
    localizer: PluginUse | None = None
    """Tells where the robot is; None: its odometry does. Paths then lie in the frame of the localizer's map."""
    steps: Annotated[
        tuple[Step, ...], Field(strict=False, json_schema_extra={"minItems": 1}), AfterValidator(_check_steps)
    ]
    supervision: Supervision = Supervision()
    recovery: Annotated[
        dict[str, RecoveryPolicy], Field(json_schema_extra={"propertyNames": {"enum": sorted(ROWS)}})
    ] = Field(default_factory=dict)
    """By the fault's id in the fault table."""
    simulation: Simulation = Simulation()
    record: FileName = "runs/"
    """Folder for the runs' folders."""
