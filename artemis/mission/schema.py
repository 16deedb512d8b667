"""What a mission file may say, each part on its own; `loading` checks how the parts fit together."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from artemis.config import Config, OpenConfig, Quantity
from artemis.mission.actions import A_LIST, FileName, PluginUse
from artemis.mission.keys import Name
from artemis.mission.obstacles import Obstacles
from artemis.mission.words import MissionPart, Step
from artemis.supervision.catalogue import ROWS

SLOWEST = 25
"""Ticks per second."""


class BusWords(OpenConfig):
    """A real CAN bus in python-can's own words; words beside `interface` are the interface's."""

    interface: str
    """Name of the interface in python-can, such as socketcan; every other key is an option of it."""

    @model_validator(mode="after")
    def _a_channel(self) -> Self:
        if self.interface == "socketcan" and not any(key.startswith("chan") for key in self.options):  # or misspelt
            raise ValueError("socketcan needs a channel, such as channel: can0 (without one nothing can be sent)")
        return self

    @property
    def words(self) -> dict[str, object]:
        """All words, `interface` among them."""
        return {"interface": self.interface, **self.options}


class SerialWords(Config):
    """A serial line to the first drive, which is the gateway to the others on CAN. Nothing is driven over it."""

    serial: Annotated[str, Field(min_length=1)]
    """The port, such as /dev/ttyUSB0."""
    baud: Literal[9600, 14400, 19200, 38400, 57600, 115200] = 115200
    """As the drive is set (object 0x2002) [bit/s]."""
    protocol: Literal["epos1", "epos4"] = "epos1"
    """What the first drive speaks: RS232 of the first generation, or USB and RS232 of an EPOS4."""


def _kind_of_bus(bus: object) -> str | None:
    if isinstance(bus, SerialWords) or (isinstance(bus, dict) and "serial" in bus and "interface" not in bus):
        return "<serial>"
    if isinstance(bus, dict) and "serial" in bus:
        return None
    if isinstance(bus, dict | BusWords):
        return "<words>"
    return "<simulation>" if bus == "simulation" else None


Bus = Annotated[
    Annotated[Literal["simulation"], Tag("<simulation>")]
    | Annotated[BusWords, Tag("<words>")]
    | Annotated[SerialWords, Tag("<serial>")],
    Discriminator(
        _kind_of_bus,
        custom_error_type="bus",
        custom_error_message="simulation, python-can's options such as {interface: socketcan, channel: can0}, "
        "or a serial line such as {serial: /dev/ttyUSB0, baud: 115200}",
    ),
]


class Supervision(Config):
    """How short a quick stop has to be, and whether the run waits for an operator."""

    stop_distance_m: Annotated[float, Field(gt=0, le=10)] = 0.6
    """A quick stop from the highest speed of the mission must need no more than this."""
    wait_for_arm: bool = False
    """The drives are enabled only once an operator arms; otherwise the start of the run is the first arm."""


class RecoveryPolicy(Config):
    """How one fault is met: stricter than the fault table, never milder."""

    reaction: Literal["W", "L", "S2", "S1", "S0"] | None = None
    """At least the table's: warn, limit, controlled stop, quick stop, off."""
    after_s: Annotated[float, Field(ge=0)] | None = None
    """How long the row's last limit may be exceeded; at most the table's time."""
    retries: Annotated[int, Field(ge=0)] | None = None
    """Automatic recoveries, at most the table's number; then a person is needed."""
    resume: Literal["wait", "continue"] = "wait"
    """After an automatic recovery: wait for arm, or resume where the robot stopped."""


class Operation(Config):
    """Something a simulated operator does."""

    at_s: Annotated[float, Field(ge=0)]
    """Run time."""
    do: Literal[
        "quickstop",
        "acknowledge",
        "arm",
        "end",
        "accept",
        "left_degree",
        "right_degree",
        "left_tenth",
        "right_tenth",
        "answer",
    ]
    """accept to right_tenth: what a person does who calibrates the steering."""
    answer: str | None = None
    """To a question of the mission, with `do: answer`."""

    @model_validator(mode="after")
    def _an_answer(self) -> Self:
        if (self.do == "answer") != (self.answer is not None):
            raise ValueError("do: answer and answer: TEXT belong together")
        return self


class InjectedFault(OpenConfig):
    """Something that goes wrong in a simulated run; every other key is a parameter of the fault."""

    at_s: Annotated[float, Field(ge=0)]
    """Run time."""
    inject: str
    """Row of the fault table."""
    node: str | None = None
    """The drive to which it happens, by its name in the robot file."""


class Simulation(Config):
    """What stands in for the world when the bus is simulated."""

    seed: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] = 0
    """Of everything random: in a fast simulation the same seed gives the same run, bit for bit."""
    pace: Literal["fast", "real_time"] | None = None
    """Faster than real time, or not; if left out, in real time if an input needs a person or a device."""
    true_robot: dict[str, object] = Field(default_factory=dict)
    """How the simulated machine differs from the robot file, unknown to the software."""
    world: dict[str, object] | None = None
    """What the scanners see: walls, poles, boxes, persons, a map; if left out, a hall of 16 x 16 m around (0, 0)."""
    inputs: dict[str, PluginUse] = Field(default_factory=dict)
    """Stand-ins for inputs of the mission, by the same names."""
    scanners: dict[str, PluginUse] = Field(default_factory=dict)
    """Stand-ins for scanners of the robot, by the same names."""
    localizer: PluginUse | None = None
    """Stand-in for the mission's localizer, or the only one."""
    operator: Annotated[tuple[Operation, ...], Field(strict=False)] = ()
    """What a simulated operator does, and when."""
    faults: Annotated[tuple[InjectedFault, ...], Field(strict=False)] = ()
    """What goes wrong, and when."""


class Mapping(Config):
    """A map is made of what one scanner sees in the run; at its end it is written into the run's folder."""

    scanner: Name | None = None
    """Its name in the robot file; if left out, the robot has one."""
    file: Annotated[str, Field(min_length=1)] | None = None
    """Written there, too: a YAML file in the mission's folder; its image and its graph lie beside it."""
    replace: bool = False
    """The file may exist: it is overwritten."""
    resolution_m: Annotated[float, Quantity(0.005, 1.0, "m")] = 0.05
    """Side of a cell."""


class Mission(Config):
    """A mission: which robot does what, on which bus."""

    mission: Name
    """Its name, also of its runs' folders."""
    robot: FileName
    """The robot file, in the mission's folder or below."""
    bus: Bus
    """`simulation`, options of python-can such as {interface: socketcan, channel: can0}, or a serial line."""
    tick_hz: Annotated[int, Field(ge=SLOWEST, le=200)] = 50
    """Ticks per second: how often the robot senses and decides, and its drives get set-points."""
    inputs: dict[str, PluginUse] = Field(default_factory=dict)
    """What drives the robot by hand, by names of the mission's own: joysticks, the keyboard, other programs."""
    observers: dict[str, PluginUse] = Field(default_factory=dict)
    """What else sees the run, by names of the mission's own."""
    localizer: PluginUse | None = None
    """Reports where the robot is; if left out, its odometry does. With one, paths lie in the frame of its map."""
    steps: Annotated[tuple[Step, ...], *A_LIST]
    """What the robot does, in this order."""
    parts: dict[Name, MissionPart] = Field(default_factory=dict)
    """Steps that are written once, by the name with which steps `call` them."""
    obstacles: Obstacles | None = None
    """What the robot does about what its scanners see; if left out, a robot that has any stops in time."""
    mapping: Mapping | None = None
    """Make a map of what a scanner sees; if left out, none is made."""
    supervision: Supervision = Supervision()
    recovery: Annotated[
        dict[str, RecoveryPolicy], Field(json_schema_extra={"propertyNames": {"enum": sorted(ROWS)}})
    ] = Field(default_factory=dict)
    """How faults are met, by their ids in the fault table; if left out, as the table says."""
    simulation: Simulation = Simulation()
    record: FileName = "runs/"
    """Folder for the runs' folders."""
