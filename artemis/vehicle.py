"""The robot as its file describes it: everything that is true of one machine. No default for geometry or identity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import degrees, radians
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from artemis.axles import (
    OWN_SIDES,
    SWITCH_MARGIN_DEG,
    AbsoluteEncoder,
    AnyAngleSource,
    Calibration,
    Geometry,
    HardStop,
    HomeSwitch,
    Potentiometers,
    proportions,
)
from artemis.battery import Battery, VoltageInput
from artemis.config import Config, Inconsistent, Quantity
from artemis.drive_numbers import asked_of_steering, asked_of_traction, misfits, voltage_problems
from artemis.drive_schema import Drive, drive_problems
from artemis.errors import similar
from artemis.families.objects import Object
from artemis.linkage import MeasuredLinkage
from artemis.mounting import Mounting, Outline
from artemis.yaml_file import KeyPath

Positive = Annotated[float, Field(gt=0)]
Speed = Annotated[float, Quantity(0.02, 20.0, "m/s")]
WishedSpeed = Annotated[float, Quantity(0.001, 20.0, "m/s")]
"""Of a follower or an input; how fast a robot may drive, its file says."""
Acceleration = Annotated[float, Quantity(0.05, 30.0, "m/s²")]

ROLES = ("traction", "steering")


class Limits(Config):
    """What the machine may do. Steering rate and wheel speed are per wheel."""

    speed_m_s: Speed
    """Highest speed of the virtual front wheel, forwards and backwards."""
    wheel_speed_m_s: Speed
    """Highest speed of each driven wheel: in a curve the outer one is faster than the virtual front wheel."""
    acceleration_m_s2: Acceleration
    """Of the virtual front wheel, when it becomes faster."""
    deceleration_m_s2: Acceleration
    """Of the virtual front wheel, when it becomes slower and in a controlled stop."""
    quick_stop_deceleration_m_s2: Acceleration
    """Of each driven wheel: the drives' own quick stop."""
    steering_deg: Annotated[float, Quantity(5.0, 79.0, "degrees")]
    """Largest angle of the virtual front wheel, to either side."""
    steering_rate_wheel_deg_s: Annotated[float, Quantity(2.0, 720.0, "degrees/s")]
    """How fast a steering motor turns its wheel at most."""


class SupplySource(NamedTuple):
    """What measures the supply voltage."""

    drive: str
    object: Object
    volts_per_unit: float


class RobotFile(Config):
    """A whole robot file."""

    robot: Annotated[str, Field(min_length=1)]
    """Its name, as reports, pages and messages show it."""
    geometry: Geometry
    limits: Limits
    calibration: Calibration
    drives: Annotated[dict[str, Drive], Field(min_length=1)]
    """The nodes, by names of the robot's own: one of each role on each side, or one in the middle."""
    bitrate: Literal[1000000, 800000, 500000, 250000, 125000, 50000, 20000] = 1000000
    """Of the CAN bus [bit/s]: that of every drive."""
    host_node_id: Annotated[int, Field(ge=1, le=127)] = 127
    """The identifier of the host's heartbeat is 0x700 plus this."""
    outline: Outline | None = None
    """Of the whole robot, for what must not touch anything; a robot with scanners needs it."""
    battery: Battery | None = None
    """What feeds the drives; if left out, charge and range are not known."""
    scanners: dict[Annotated[str, Field(min_length=1)], Mounting] = Field(default_factory=dict)
    """Laser scanners, by names of the robot's own."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        problems = [
            *_families(self),
            *_nodes(self),
            *_sides(self),
            *proportions(self.geometry),
            *_body(self),
            *_supply(self),
        ]
        if not problems:
            problems = [*_traction(self), *_steering(self), *_limits(self.limits), *_numbers(self)]
        if problems:
            raise Inconsistent(problems)
        return self

    def sides(self, role: str) -> tuple[str, ...]:
        """Where the drives of a role act: left and right, or one in the middle."""
        return self.geometry.sides(role)

    def drive_at(self, role: str, side: str) -> tuple[str, Drive]:
        """Name and description of the drive with this role that acts on the wheels of a side."""
        return next((n, d) for n, d in self.drives.items() if d.role == role and d.side in (side, "middle"))

    @property
    def places(self) -> tuple[int, ...]:
        """Where traction left, traction right, steering left, steering right stand in the order of the drives.

        A drive in the middle stands for both sides.
        """
        names = list(self.drives)
        places = [(role, side) for role in ("traction", "steering") for side in OWN_SIDES]
        return tuple(names.index(self.drive_at(role, side)[0]) for role, side in places)

    @property
    def errors(self) -> dict[str, Mapping[int, str]]:
        """Rows of the fault table by EMCY error code, for each drive: generations give a code different meanings."""
        return {name: drive.tables.errors for name, drive in self.drives.items()}

    def metres_per_count(self, side: str) -> float:
        """Distance of a driven wheel per count [m]; of both behind a differential, the mean."""
        traction = self.calibration.traction
        own = traction.left_m_per_count if side == "left" else traction.right_m_per_count
        found = traction.middle_m_per_count if self.sides("traction") != OWN_SIDES else own
        assert found is not None, "checked when the file was read"
        return found

    def angle_source(self, side: str) -> AnyAngleSource:
        """How the angle of the steering motor that turns the wheel of a side becomes known."""
        steering = self.calibration.steering
        own = steering.left if side == "left" else steering.right
        found = steering.middle if self.sides("steering") != OWN_SIDES else own
        assert found is not None, "checked when the file was read"
        return found

    def potentiometers(self, side: str) -> Potentiometers:
        """Potentiometer calibration of the steering motor that turns the wheel of a side, where it has any."""
        found = self.angle_source(side)
        assert isinstance(found, Potentiometers), "asked only where it has them"
        return found

    @property
    def supply_source(self) -> SupplySource | None:
        """The analog input that the battery's description names, else the first drive that measures it; None: none."""
        if self.battery is not None and (given := self.battery.measured) is not None:
            family = self.drives[given.drive].tables
            return SupplySource(given.drive, family.analog[given.input - 1], given.divider / family.analog_scale)
        return next(
            (
                SupplySource(name, drive.tables.supply, 1.0 / drive.tables.supply_scale)
                for name, drive in self.drives.items()
                if drive.tables.supply is not None
            ),
            None,
        )

    @property
    def has_potentiometers(self) -> bool:
        """Whether potentiometers measure the angles of the steering motors."""
        return isinstance(self.angle_source("left"), Potentiometers)

    def sent(self, drive: Drive) -> tuple[tuple[Object, ...], ...]:
        """TxPDO 1 and 2 of a drive: what else measures its wheel's angle stands in the place of the potentiometers."""
        family, (status, details) = drive.tables, drive.tables.sent[drive.role]
        measures = self.angle_object(drive)
        if measures is None:
            return status, details
        return status, (measures, *(object for object in details if object not in family.analog))

    def angle_object(self, drive: Drive) -> Object | None:
        """What else than potentiometers measures the angle of the wheel that a drive steers; None: nothing."""
        source = self.angle_source(drive.side) if drive.role == "steering" else None
        if isinstance(source, AbsoluteEncoder):
            return drive.tables.absolute
        return drive.tables.inputs if isinstance(source, HomeSwitch) else None


Problems = Iterator[tuple[KeyPath, str]]


def _families(robot: RobotFile) -> Problems:
    """Each drive has what its family needs, and nothing that it does not know."""
    for name, drive in robot.drives.items():
        for key, text in drive_problems(drive):
            yield ("drives", name, *key), text


def _nodes(robot: RobotFile) -> Problems:
    """Each node has an id of its own, and each place one drive."""
    owner: dict[int, str] = {}
    for name, drive in robot.drives.items():
        if (other := owner.setdefault(drive.node_id, name)) != name:
            yield ("drives", name, "node_id"), f"{drive.node_id} is the id of {other}, too: each node has its own"
    if robot.host_node_id in owner:
        yield (
            ("host_node_id",),
            f"{robot.host_node_id} is the id of {owner[robot.host_node_id]}, too: each node has its own",
        )


_WHERE = {"left": "on the left", "right": "on the right", "middle": "in the middle"}


def _sides(robot: RobotFile) -> Problems:
    """Each place has one drive, and what was measured of it."""
    found: Counter[tuple[str, str]] = Counter((drive.role, drive.side) for drive in robot.drives.values())
    needed = [(role, side) for role in ROLES for side in robot.sides(role)]
    wrong = [place for place in dict.fromkeys([*needed, *found]) if found[place] != (place in needed)]
    if wrong:
        seen = ", ".join(
            f"found {found[place] or 'no'} {place[0]} drive{'s' if found[place] > 1 else ''} {_WHERE[place[1]]}"
            for place in wrong
        )
        yield ("drives",), f"expected {_expected(robot)}, {seen}"
    for role, key, suffix in (("steering", "steering", ""), ("traction", "traction", "_m_per_count")):
        measured = getattr(robot.calibration, key)
        for side in _WHERE:
            given = getattr(measured, f"{side}{suffix}") is not None
            at = ("calibration", key, f"{side}{suffix}")
            if given and side not in robot.sides(role):
                yield at, f"there is no {role} drive {_WHERE[side]}: leave it out"
            elif not given and side in robot.sides(role):
                yield at, "this key is missing"


def _expected(robot: RobotFile) -> str:
    """The drives that a geometry needs."""
    middle = [role for role in ROLES if robot.sides(role) != OWN_SIDES]
    sides = [role for role in ROLES if role not in middle]
    words = [f"{' and '.join(f'one {role}' for role in sides)} drive on each side"] if sides else []
    words += [f"{' and '.join(f'one {role}' for role in middle)} drive in the middle"] if middle else []
    return " and ".join(words)


def _body(robot: RobotFile) -> Problems:
    """The outline is around the wheels; a scanner has no drive's name."""
    geometry = robot.geometry
    if (outline := robot.outline) is not None:
        if outline.front_m <= geometry.wheelbase_m:
            text = f"expected more than wheelbase_m ({geometry.wheelbase_m:g} m): it counts from the rear axle"
            yield ("outline", "front_m"), f"{text}, found {outline.front_m:g} m"
        if outline.half_width_m <= geometry.track_m / 2:
            text = f"expected more than half of track_m ({geometry.track_m / 2:g} m), found {outline.half_width_m:g} m"
            yield ("outline", "half_width_m"), text
    elif robot.scanners:
        yield ("scanners",), "a robot with a scanner stops for what it sees: describe its `outline` too"
    for name in robot.scanners:
        if name in robot.drives:
            yield ("scanners", name), "a drive has this name: give the scanner another one"


def _supply(robot: RobotFile) -> Problems:
    """The battery is read by an input that is there, free, and reads so much."""
    given: VoltageInput | None = robot.battery.measured if robot.battery is not None else None
    if robot.battery is None or given is None:
        return
    key, drive = ("battery", "measured"), robot.drives.get(given.drive)
    if drive is None:
        yield (*key, "drive"), f"there is no drive {given.drive!r}; {similar(given.drive, robot.drives)}"
    elif drive.role == "steering":
        yield (*key, "drive"), f"the analog inputs of {given.drive} read potentiometers: take those of a traction drive"
    elif not drive.tables.analog:
        yield (*key, "drive"), f"no analog input of {given.drive} is known: give its `cia402.analog_inputs`"
    elif (full := robot.battery.curve_v[-1][1] / given.divider) > HIGHEST_INPUT:
        yield (
            (*key, "divider"),
            f"a full battery would show {full:.3g} V; the analog input reads 0 to {HIGHEST_INPUT:g} V",
        )


HIGHEST_INPUT = 5.0
"""What the analog inputs of every family read at least [V]."""
_CIRCUMFERENCE = Quantity(0.05, 10.0, "m a turn")
"""Of a driven wheel."""


def _traction(robot: RobotFile) -> Problems:
    """Metres per count, encoder and gear make a wheel, on both sides the same; the motor reaches the speed."""
    around = {}
    for side in robot.sides("traction"):
        name, drive = robot.drive_at("traction", side)
        rolled, counts = robot.metres_per_count(side), drive.counts_per_wheel_turn
        around[side] = rolled * counts
        key = "calibration", "traction", f"{side}_m_per_count"
        try:
            _CIRCUMFERENCE.check(around[side])
        except ValueError as error:
            product = f"{rolled:g} m x {counts:g} counts (counts_per_turn x gear_ratio of {name})"
            yield key, f"{product}: {error}; is it in millimetres, or one of the others wrong?"
            return
        turns = drive.motor.max_speed_rpm / drive.gear_ratio / 60
        wanted, highest = robot.limits.wheel_speed_m_s, turns * around[side]
        if wanted > highest:
            reason = f"max_speed_rpm {drive.motor.max_speed_rpm} rpm, gear_ratio {drive.gear_ratio:g}"
            text = f"{wanted:g} m/s is more than {name} reaches: {highest:.3g} m/s ({reason}, "
            yield ("limits", "wheel_speed_m_s"), f"{text}{around[side]:.3g} m a turn)"
    if len(around) == 2 and not 0.8 <= around["left"] / around["right"] <= 1.25:
        both = f"{around['left']:.4g} m (left) and {around['right']:.4g} m around"
        yield key, f"makes wheels of {both}; expected about the same"


def _steering(robot: RobotFile) -> Problems:
    """The potentiometers show every angle, and the motor turns as fast as it has to."""
    limits = robot.limits
    if isinstance(robot.geometry.linkage, tuple):
        low, high = MeasuredLinkage(robot.geometry).reach
        if not low <= -limits.steering_deg < limits.steering_deg <= high:
            text = f"{limits.steering_deg:g} degrees are beyond the linkage's table: its ends turn the virtual wheel"
            yield ("limits", "steering_deg"), f"{text} to {low:.1f} and {high:.1f} degrees"
    for side in robot.sides("steering"):
        name, drive = robot.drive_at("steering", side)
        source = robot.angle_source(side)
        yield from _sources(robot, side, source)
        if isinstance(source, Potentiometers):
            for key, text in voltage_problems(source, limits.steering_deg, drive):
                yield ("calibration", "steering", side, *key), text
        highest = drive.motor.max_speed_rpm / drive.gear_ratio * 6
        if limits.steering_rate_wheel_deg_s > highest:
            yield (
                ("limits", "steering_rate_wheel_deg_s"),
                f"{limits.steering_rate_wheel_deg_s:g} degrees/s is more than the {highest:.3g} degrees/s of {name}: "
                f"max_speed_rpm {drive.motor.max_speed_rpm} rpm, gear_ratio {drive.gear_ratio:g}",
            )
        error = drive.lag_counts / drive.counts_per_wheel_turn * 360
        if drive.following_error_counts is not None and not 0.01 <= error <= 45:
            text = f"{drive.lag_counts} counts are {error:.3g} degrees of the wheel; expected 0.01 to 45"
            yield ("drives", name, "following_error_counts"), text


def _numbers(robot: RobotFile) -> Problems:
    """What each drive is told, and counts, fits into its objects."""
    limits = robot.limits
    for name, drive in robot.drives.items():
        if drive.role == "traction":
            speeds = limits.wheel_speed_m_s, limits.quick_stop_deceleration_m_s2
            asked = asked_of_traction(drive, robot.metres_per_count(drive.side), *speeds)
        else:
            asked = asked_of_steering(drive, robot.geometry, limits.steering_deg, robot.angle_source(drive.side))
        for key, text in misfits(drive, asked):
            yield ("drives", name, *key), text


def _sources(robot: RobotFile, side: str, source: AnyAngleSource) -> Problems:
    """All angles become known in one way, by what the drive can read; a stop is beyond every angle, a switch not."""
    key, limit = ("calibration", "steering", side), robot.limits.steering_deg
    name, drive = robot.drive_at("steering", side)
    if type(source) is not type(robot.angle_source("left")):
        yield key, "expected the same source of the angle as on the left"
    if isinstance(source, Potentiometers) and not drive.tables.analog:
        text = "this key is missing: a steered wheel has two potentiometers"
        yield ("drives", name, "cia402", "analog_inputs"), text
    if isinstance(source, AbsoluteEncoder) and drive.tables.absolute is None:
        if drive.cia402 is None:
            yield (*key, "angle"), f"{name} is of family {drive.family}, which reads no absolute encoder"
        else:
            yield ("drives", name, "cia402", "absolute_encoder"), "this key is missing: its angle is read there"
    if not isinstance(source, HardStop | HomeSwitch):
        return
    what = "hard stop" if isinstance(source, HardStop) else "home switch"
    if side != "middle":
        yield (*key, "angle"), f"only a single steering motor looks for a {what}, not one of a pair"
    if isinstance(robot.geometry.linkage, tuple):
        limit = max(abs(degrees(MeasuredLinkage(robot.geometry).motor(radians(end)))) for end in (-limit, limit))
    reach = f"the {limit:.3g} degrees to which limits.steering_deg lets the motor turn"
    if isinstance(source, HardStop) and abs(source.stop_deg) <= limit:
        yield (*key, "stop_deg"), f"expected beyond {reach}, found {source.stop_deg:g}"
    elif isinstance(source, HardStop) and (source.travel_deg or 360.0) - abs(source.stop_deg) <= limit:
        yield (*key, "travel_deg"), f"expected that it ends beyond {reach}, too, found {source.travel_deg:g}"
    if isinstance(source, HomeSwitch) and abs(source.switch_deg) > limit - SWITCH_MARGIN_DEG:
        margin = f"{SWITCH_MARGIN_DEG:g} degree or more"
        yield (*key, "switch_deg"), f"expected {margin} within {reach}, found {source.switch_deg:g}"


def _limits(limits: Limits) -> Problems:
    if limits.quick_stop_deceleration_m_s2 < limits.deceleration_m_s2:
        yield (
            ("limits", "quick_stop_deceleration_m_s2"),
            f"{limits.quick_stop_deceleration_m_s2:g} m/s² is softer than a controlled stop "
            f"(deceleration_m_s2: {limits.deceleration_m_s2:g} m/s²)",
        )
