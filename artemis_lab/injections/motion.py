"""Wheels, steering, potentiometers, ground and supply that are not as they should be: RUN-.., STE-.., PWR-.., EST-.."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated, Literal

from pydantic import Field

from artemis.config import Config
from artemis.drive_states import DriveState
from artemis.families import FAMILIES
from artemis.sim.epos4 import SimEpos4
from artemis.sim.wheels import PotentiometerFailure, SteeredWheel
from artemis_lab.injections.fault_bus import RX_PDO_1, Direction, Rule
from artemis_lab.injections.stage import Count, Injection, Lasting, Needs, Nothing, Positive, Stage, Undo, together

WITH_MEMORY = [family.name for family in FAMILIES.values() if family.memory]
"""Families whose drives keep numbers of the user's own."""
PROFILE_VELOCITY = 3
"""Mode of operation (object 0x6060)."""
RAMP_PERIOD = 0.05
"""A battery sinks in steps of this length [s]."""


class Gain(Lasting):
    """So many times the speed that was asked for; negative: the other way."""

    gain: float = 2.0


class Slope(Lasting):
    """How steep the ground falls; negative: rises."""

    slope_deg: Annotated[float, Field(ge=-30, le=30)] = 5.0


class Fade(Lasting):
    """Highest deceleration that is left."""

    deceleration_m_s2: Annotated[float, Field(ge=0)] = 0.1


class Slip(Lasting):
    """Share of its distance that the wheel loses."""

    slip: Annotated[float, Field(gt=0, lt=0.9)] = 0.4


class Counter(Config):
    """Where the position counter stands."""

    before_wrap: Annotated[int, Field(ge=0)] = 1000
    """So many counts before 2**31."""


class Kept(Config):
    """What a drive keeps of its first potentiometer."""

    zero_uv: Annotated[int, Field(ge=1, le=5_000_000)] = 2_600_000


class PositionJump(Lasting):
    """Which bit of the position is wrong, and in how many readings."""

    bit: Annotated[int, Field(ge=0, le=31)] = 20
    count: Count | None = 1
    """None: all."""


class Offset(Lasting):
    """What one potentiometer shows too much."""

    potentiometer: Literal[1, 2] = 1
    offset_v: float = 0.1
    drift_v_s: float = 0.0


class Rail(Lasting):
    """What one potentiometer shows, whatever the angle."""

    potentiometer: Literal[1, 2] = 1
    voltage: Annotated[float, Field(ge=0, le=10)] = 5.0


class Angle(Config):
    """By which a coupling slips, left positive."""

    angle_deg: Annotated[float, Field(ge=-90, le=90)] = 6.0


class LowVoltage(Lasting):
    """Of the batteries without load, and the time in which they get there."""

    voltage: Annotated[float, Field(gt=0, le=60)] = 21.0
    within_s: Annotated[float, Field(ge=0)] = 2.0


class CriticalVoltage(LowVoltage):
    """Below what a drive needs."""

    voltage: Annotated[float, Field(gt=0, le=60)] = 7.0


class Sag(LowVoltage):
    """At once, and not for long."""

    voltage: Annotated[float, Field(gt=0, le=60)] = 18.0
    within_s: Annotated[float, Field(ge=0)] = 0.0
    duration_s: Positive | None = 0.2


class Pressed(Lasting):
    """What the emergency stop opens."""

    opens: Literal["supply", "sto"] | None = None
    """The batteries' switch, or the safe torque off inputs; None: these, where every drive has them."""


class Carried(Config):
    """Where to: ahead, to the left, and counter-clockwise."""

    x_m: float = 0.0
    y_m: float = 0.5
    heading_deg: float = 0.0


class Running(Config):
    """How fast the motor turns."""

    speed_rpm: int = 500


def _turn_otherwise(stage: Stage, node: str | None, p: Gain) -> Undo:
    axis = stage.drive(node).axis
    axis.fail(gain=p.gain)
    return partial(axis.fail, gain=1.0)


def _tilt(stage: Stage, node: str | None, p: Slope) -> Undo:
    def level(slope: float) -> None:
        stage.world.slope = slope

    level(math.radians(p.slope_deg))
    return partial(level, 0.0)


def _fade(stage: Stage, node: str | None, p: Fade) -> Undo:
    drives = stage.drives(node, "traction")
    for drive in drives:
        side = stage.robot.drives[drive.name].side
        metres_per_turn = stage.robot.metres_per_count(side) * drive.axis.counts_per_turn
        drive.axis.fail(braking=60.0 * p.deceleration_m_s2 / metres_per_turn)
    return together([partial(drive.axis.fail, braking=math.inf) for drive in drives])


def _block(role: str) -> Callable[[Stage, str | None, Lasting], Undo]:
    def block(stage: Stage, node: str | None, _: Lasting) -> Undo:
        axes = [drive.axis for drive in stage.drives(node, role)]
        for axis in axes:
            axis.fail(blocked=True)
        return together([partial(axis.fail, blocked=False) for axis in axes])

    return block


def _spin(stage: Stage, node: str | None, p: Slip) -> Undo:
    wheel = stage.world.driven[stage.drive(node).name]
    wheel.spin(p.slip)
    return partial(wheel.spin, 0.0)


def _switch_off(stage: Stage, node: str | None, _: Nothing) -> None:
    stage.drive(node).failures.force_state(DriveState.SWITCH_ON_DISABLED)


def _count_from(stage: Stage, node: str | None, p: Counter) -> None:
    stage.drive(node).failures.count_on_from((1 << 31) - p.before_wrap)


def _jump(stage: Stage, node: str | None, p: PositionJump) -> Undo:
    left = p.count

    def shown(position: int) -> int:
        nonlocal left
        if left == 0:
            return position
        left = None if left is None else left - 1
        return position ^ 1 << p.bit

    return stage.drive(node).failures.misreport(0x6064, 0, shown)


def _ignore_set_points(stage: Stage, node: str | None, _: Lasting) -> Undo:
    return stage.rule(Rule(ids=RX_PDO_1, node=stage.node_id(node), direction=Direction.FROM_HOST, drop=True))


def _wheel(stage: Stage, node: str | None) -> SteeredWheel:
    return stage.world.steered[stage.drive(node).name]


def _fail_potentiometer(stage: Stage, node: str | None, number: int, failure: PotentiometerFailure) -> Undo:
    failures = _wheel(stage, node).failures
    failures[number - 1] = failure

    def restore() -> None:
        failures.pop(number - 1, None)

    return restore


def _offset(stage: Stage, node: str | None, p: Offset) -> Undo:
    failure = PotentiometerFailure(since=stage.now, offset=p.offset_v, drift=p.drift_v_s)
    return _fail_potentiometer(stage, node, p.potentiometer, failure)


def _rail(stage: Stage, node: str | None, p: Rail) -> Undo:
    return _fail_potentiometer(stage, node, p.potentiometer, PotentiometerFailure(stuck=p.voltage))


def _freeze(stage: Stage, node: str | None, _: Lasting) -> Undo:
    wheel = _wheel(stage, node)
    wheel.freeze()
    return wheel.failures.clear


def _slip_coupling(stage: Stage, node: str | None, p: Angle) -> None:
    _wheel(stage, node).slip_coupling(math.radians(p.angle_deg))


def _detach(stage: Stage, node: str | None, _: Lasting) -> Undo:
    wheel = _wheel(stage, node)
    wheel.couple(False)
    return partial(wheel.couple, True)


def _sink(stage: Stage, node: str | None, p: LowVoltage) -> Undo:
    world, before = stage.world, stage.world.battery_v
    steps = max(1, round(p.within_s / RAMP_PERIOD))
    share = iter(range(1, steps + 1))

    def sink() -> None:
        world.battery_v = before + (p.voltage - before) * next(share) / steps

    ramp = stage.repeat(sink, RAMP_PERIOD, steps)

    def charge() -> None:
        ramp()
        world.battery_v = before

    return charge


def _press(stage: Stage, node: str | None, p: Pressed) -> Undo:
    drives = [drive for drive in stage.world.nodes if isinstance(drive, SimEpos4)]
    if p.opens == "supply" or (p.opens is None and len(drives) < len(stage.world.nodes)):
        before, stage.world.battery_v = stage.world.battery_v, 0.0
        return lambda: setattr(stage.world, "battery_v", before)
    if not drives:
        raise ValueError("no drive has safe torque off inputs: `opens: supply`")
    for drive in drives:
        drive.open_sto(True, stage.now)
    return together([partial(_close_sto, stage, drive) for drive in drives])


def _close_sto(stage: Stage, drive: SimEpos4) -> None:
    drive.open_sto(False, stage.now)


def _carry(stage: Stage, node: str | None, p: Carried) -> None:
    stage.world.carry(p.x_m, p.y_m, math.radians(p.heading_deg))


def _keep_running(stage: Stage, node: str | None, p: Running) -> None:
    """As a host left it that died before the drive's watchdog was armed."""
    drive = stage.drive(node)
    scale = stage.robot.drives[drive.name].tables.velocity_scale

    def run() -> None:
        if drive.nmt is None:
            return  # without power nothing turns
        drive.poke(0x6060, 0, PROFILE_VELOCITY)
        drive.poke(0x60FF, 0, round(p.speed_rpm * scale))
        drive.failures.force_state(DriveState.OPERATION_ENABLE)

    stage.once_booted(drive, run)


def _remember(stage: Stage, node: str | None, p: Kept) -> None:
    drive = stage.drive(node)
    kept = stage.robot.drives[drive.name].tables.memory[0]
    stage.once_booted(drive, partial(drive.poke, kept.index, kept.subindex, p.zero_uv))


_EMERGENCY_STOP = Injection("the hardware emergency stop is pressed", _press, parameters=Pressed)

MOTION_INJECTIONS: dict[str, Injection] = {
    "RUN-01": Injection("motor turns faster than asked, or the other way", _turn_otherwise, Needs.TRACTION, Gain),
    "RUN-02": Injection("the robot stands on a slope", _tilt, parameters=Slope),
    "RUN-03": Injection("driven wheels hardly brake", _fade, Needs.NOTHING, Fade),
    "RUN-04": Injection("driven wheel is blocked", _block("traction"), Needs.TRACTION, Lasting),
    "RUN-05": Injection("driven wheel spins", _spin, Needs.TRACTION, Slip),
    "RUN-06": Injection("one driven wheel's drive switches itself off", _switch_off, Needs.TRACTION),
    "RUN-09": Injection("position counter is near its end", _count_from, Needs.DRIVE, Counter),
    "RUN-10": Injection("position jumps", _jump, Needs.DRIVE, PositionJump),
    "STE-01": Injection("steering drive hears no set-point", _ignore_set_points, Needs.STEERING, Lasting),
    "STE-02": Injection("steering is blocked", _block("steering"), Needs.STEERING, Lasting),
    "STE-03": Injection("a potentiometer is off", _offset, Needs.STEERING, Offset),
    "STE-04": Injection("a potentiometer is at a rail", _rail, Needs.STEERING, Rail),
    "STE-05": Injection("the coupling of motor and wheel slips", _slip_coupling, Needs.STEERING, Angle),
    "STE-06": Injection("the motor turns without its wheel", _detach, Needs.STEERING, Lasting),
    "STE-07": Injection("potentiometers are frozen", _freeze, Needs.STEERING, Lasting),
    "CAL-01": Injection("steering is blocked, while it aligns", _block("steering"), Needs.STEERING, Lasting),
    "CAL-02": Injection("drive keeps another calibration", _remember, Needs.STEERING, Kept, families=WITH_MEMORY),
    "SYS-10": Injection("drive is found turning", _keep_running, Needs.TRACTION, Running),
    "PTH-06": Injection("the robot is carried away", _carry, parameters=Carried),
    "PTH-07": Injection("both driven wheels are blocked", _block("traction"), parameters=Lasting),
    "PWR-01": Injection("the batteries get low", _sink, parameters=LowVoltage),
    "PWR-02": Injection("the batteries get too low for the drives", _sink, parameters=CriticalVoltage),
    "PWR-03": Injection("the supply voltage sags", _sink, parameters=Sag),
    "EST-01": _EMERGENCY_STOP,
    "EST-03": _EMERGENCY_STOP,
    "EST-04": _EMERGENCY_STOP,
}
