"""One motor axis: shaft, sensor and regulators. Pure physics of what an EPOS moves; it knows no objects and no frames.

Everything is told of the motor shaft in the drive's own units: counts, rpm, rpm/s, mA.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import Any

from artemis.drive_schema import Drive
from artemis.sim.regulators import Regulators

NOMINAL_VOLTAGE = 24.0
"""Supply at which a motor reaches its no-load speed [V]."""
OUTPUT_SHARE = 0.9
"""Highest output voltage as a share of the supply (EPOS hardware reference, 6.1)."""
_SPEED_SHARE_PER_VOLT = OUTPUT_SHARE / NOMINAL_VOLTAGE
SPEED_LAG = 0.003
"""Time constant of the closed speed loop [s] with the gains of the robot file; the regulators run every 1 ms."""
POSITION_GAIN = 50.0
"""Gain of the closed position loop [1/s], likewise: a moving demand is followed 1/50 s behind."""
STILL_RPM = 0.5
"""A regulated shaft slower than this, with nothing demanded of it, stands."""
CURRENT_FILTER_HZ = 50.0
"""Low pass of the averaged current (EPOS firmware specification 2010, object 0x2027)."""
VELOCITY_FILTER_HZ = 5.0
"""Low pass of the averaged velocity (object 0x2028)."""


class Regulation(Enum):
    """What the power stage is asked to do with the motor."""

    OFF = "no current: the shaft coasts"
    VELOCITY = "ramp to the target velocity"
    PROFILE = "trapezoidal profile to the target position"
    POSITION = "hold the target position at once, no ramp"
    EVEN = "reach the target position at an even speed, the profile's"
    CURRENT = "the target is the current"


# Looking a member up in its class costs more than all the physics of a step.
_OFF, _VELOCITY, _PROFILE, _POSITION = Regulation.OFF, Regulation.VELOCITY, Regulation.PROFILE, Regulation.POSITION
_EVEN = Regulation.EVEN


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """What the motor has to move, told as the motor current [mA] that it costs."""

    inertia: float
    """mA per rpm/s of acceleration."""
    friction: float
    """mA at any speed (and to break away)."""
    viscous: float
    """mA per rpm."""


LOADS = {
    # Half of a 40 kg robot on a 0.24 m wheel behind a gear of 50, and the rotor, at 70.5 mN·m/A; rolling resistance.
    "traction": Load(inertia=0.63, friction=300.0, viscous=0.1),
    # A small rotor before a self-locking worm: next to nothing to accelerate, much to rub.
    "steering": Load(inertia=0.0054, friction=250.0, viscous=0.01),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """What is wrong with an axis: unknown to its drive, but for its gains."""

    blocked: bool = False
    """The shaft is held by an obstacle."""
    clamped: bool = False
    """The shaft is held by the drive's own brake."""
    gain: float = 1.0
    """The shaft is regulated to so many times the velocity asked for; negative: it turns the other way."""
    braking: float = math.inf
    """Highest deceleration under regulation [rpm/s]."""
    regulators: Regulators | None = None
    """Loops with other gains than those of the robot file; None: as the constants above say."""

    @property
    def held(self) -> bool:
        """The shaft cannot turn."""
        return self.blocked or self.clamped

    def braked(self, before: float, after: float, dt: float) -> float:
        """The velocity `after` a step, as far as the deceleration that is left allows."""
        most = self.braking * dt
        if before > 0.0:
            return max(after, before - most)
        return min(after, before + most) if before < 0.0 else after


def rolled(load: Load, before: float, push: float, dt: float) -> float:
    """Velocity [rpm] of a load after `dt` [s] under a `push` [mA], against its friction."""
    drag = load.friction + load.viscous * abs(before)
    if before == 0.0:
        if abs(push) <= load.friction:
            return 0.0
        return (push - math.copysign(load.friction, push)) * dt / load.inertia
    after = before + (push - math.copysign(drag, before)) * dt / load.inertia
    if after * before < 0.0 and abs(push) <= load.friction:
        return 0.0  # friction stops a shaft, it never turns it back
    return after


class Axis:
    """A motor shaft with its sensor under the regulators of its drive; the world steps it.

    The drive sets the profile attributes and calls `regulate`; the world sets `analog`, `encoder`, `home`,
    `supply_voltage`, `failure` and `load_current`.
    """

    def __init__(self, drive: Drive, load: Load | None = None) -> None:
        self.counts_per_turn = drive.sensor.counts_per_turn
        self.counts_per_rpm_s = drive.sensor.counts_per_turn / 60.0
        """Counts per second at 1 rpm."""
        self.load = LOADS[drive.role] if load is None else load
        self.no_load_rpm = float(drive.motor.max_speed_rpm)

        self.position = 0.0
        """Counts since the axis was made, with their fraction; not changed by homing or a power cycle."""
        self.velocity = 0.0
        """rpm."""
        self.current = 0.0
        """Motor current [mA], signed like the torque."""
        self.velocity_averaged = 0.0
        self.current_averaged = 0.0
        self.heat = 0.0
        """Winding model of the I²t limit: low pass of the squared current [mA²]."""

        self.analog: tuple[float, float] = (0.0, 0.0)
        """Voltage at the analog inputs 1 and 2 [V]."""
        self.encoder: tuple[int, int] | None = None
        """What an absolute encoder at the load counts, and its bits of one turn; None: there is none, or no contact."""
        self._home = False
        self.on_home: Callable[[], None] = lambda: None
        """Called after `home` has changed."""
        self.supply_voltage = NOMINAL_VOLTAGE
        self.failure: Failure | None = None
        self.load_current = 0.0
        """Outer torque against positive motion, as motor current [mA]: a slope, a push."""

        self.regulation = Regulation.OFF
        self.target = 0.0
        """rpm, counts or mA, as `regulation` says."""
        self.profile_velocity = 0.0
        self.acceleration = 10000.0
        self.deceleration = 10000.0
        self.halted = False
        """A profile brakes and stays where it comes to rest."""
        self.demand_velocity = 0.0
        self.demand_position = 0.0
        self.continuous_current = math.inf
        self.output_current = math.inf
        self.thermal_time = 1.0
        """Time constant of the winding [s], far longer than a step."""
        self.current_mode_rpm = math.inf
        """Speed limit of `Regulation.CURRENT`."""
        self.after_step: Callable[[float], None] | None = None
        """Called with `dt` at the end of each step: the drive's supervision."""
        # With more than 30 attributes Python would find every one of them slower.
        self._tuned_for = 0.0
        self._blends = _blends_of(0.0)

    def regulate(self, regulation: Regulation, target: float) -> None:
        """Change what the regulators do; demands start from where the shaft is and how fast it turns."""
        if regulation is not self.regulation:
            self.demand_velocity = self.velocity if self.regulation is not Regulation.VELOCITY else self.demand_velocity
            self.demand_position = self.position
            self.regulation = regulation
            if self.failure is not None and self.failure.regulators is not None:
                self.failure.regulators.forget()
        self.target = target

    def fail(self, **changes: Any) -> None:  # noqa: ANN401 (of any field)
        """Change what is wrong: the fields of `Failure`."""
        failure = replace(self.failure or Failure(), **changes)
        self.failure = None if failure == Failure() else failure

    def tune(self, gains: Sequence[int], regulators: Regulators | None) -> None:
        """Take over gains, in the order of the objects, and what is assumed of loops that have them."""
        self.fail(regulators=regulators)

    @property
    def home(self) -> bool:
        """Level at the digital input that has the function home switch when a drive leaves the factory."""
        return self._home

    @home.setter
    def home(self, level: bool) -> None:
        if level is not self._home:
            self._home = level
            self.on_home()

    @property
    def limiting(self) -> bool:
        """The I²t limit holds the current down (EPOS firmware specification 2010, 9.12.1)."""
        return self.heat > self.continuous_current * self.continuous_current

    @property
    def top_rpm(self) -> float:
        """Highest speed at the present supply [rpm]."""
        return self.no_load_rpm * _SPEED_SHARE_PER_VOLT * self.supply_voltage

    @property
    def arrived(self) -> bool:
        """The demand has reached the target (or rest, when halted)."""
        if self.regulation is Regulation.PROFILE and not self.halted:
            return self.demand_position == self.target
        if self.regulation is Regulation.VELOCITY:
            return self.demand_velocity == self.target
        return self.demand_velocity == 0.0

    @property
    def lag(self) -> float:
        """Following error: demand minus actual position [counts]; 0 unless a position is regulated."""
        if self.regulation in (Regulation.PROFILE, Regulation.POSITION, Regulation.EVEN):
            return self.demand_position - self.position
        return 0.0

    def step(self, dt: float) -> None:
        """Move on by `dt` seconds (1 to 10 ms) under the present regulation, load and supply."""
        if dt <= 0.0:
            return
        if dt != self._tuned_for:
            self._tuned_for = dt
            self._blends = _blends_of(dt)
        speed_blend, velocity_blend, current_blend = self._blends
        before, regulation = self.velocity, self.regulation
        if regulation is _VELOCITY:
            wanted = self.demand_velocity
            if wanted != self.target:
                wanted = self.demand_velocity = self._ramped(wanted, self.target, dt)
            current, after = self._regulated(before, wanted, speed_blend, dt)
        elif regulation is _POSITION or regulation is _PROFILE or regulation is _EVEN:
            if regulation is _PROFILE:
                self._advance_profile(dt)
            elif regulation is _EVEN:
                self._advance_evenly(dt)
            else:
                self.demand_position, self.demand_velocity = self.target, 0.0
            error = self.demand_position - self.position
            wanted = self.demand_velocity + POSITION_GAIN * error / self.counts_per_rpm_s
            current, after = self._regulated(before, wanted, speed_blend, dt)
        else:
            current, after = self._unregulated(before, dt)
        if before or after:
            self.position += (before + after) * 0.5 * dt * self.counts_per_rpm_s
        if regulation is not _POSITION and regulation is not _PROFILE and regulation is not _EVEN:
            self.demand_position = self.position
        self.velocity, self.current = after, current
        self.heat += (current * current - self.heat) * dt / self.thermal_time
        self.velocity_averaged += (after - self.velocity_averaged) * velocity_blend
        self.current_averaged += (current - self.current_averaged) * current_blend
        if self.after_step is not None:
            self.after_step(dt)

    def _unregulated(self, before: float, dt: float) -> tuple[float, float]:
        """Current and velocity after `dt` of coasting or of a given current."""
        if self.regulation is _OFF:
            current, after = 0.0, self._rolled(before, 0.0, dt) if before or self.load_current else 0.0
        else:
            current = self._within_limit(self.target)
            after = self._rolled(before, current, dt)
            top = min(self.current_mode_rpm, self.no_load_rpm * _SPEED_SHARE_PER_VOLT * self.supply_voltage)
            after = max(-top, min(top, after))
        return current, 0.0 if self.failure is not None and self.failure.held else after

    def _regulated(self, before: float, wanted: float, blend: float, dt: float) -> tuple[float, float]:
        """Current and velocity after `dt` of a speed loop that asks for the velocity `wanted`."""
        failure = self.failure
        if failure is not None:
            if failure.held:
                return self._within_limit(math.copysign(math.inf, wanted)) if wanted else 0.0, 0.0
            wanted *= failure.gain
            if failure.regulators is not None:
                torque, wanted, blend = self._detuned(failure.regulators, wanted, blend, dt)
                if not torque:
                    return 0.0, self._rolled(before, 0.0, dt)
        top = self.no_load_rpm * _SPEED_SHARE_PER_VOLT * self.supply_voltage
        if not -top <= wanted <= top:
            wanted = math.copysign(top, wanted)
        after = before + (wanted - before) * blend
        if -STILL_RPM < after < STILL_RPM and -STILL_RPM < wanted < STILL_RPM and self.demand_velocity == 0.0:
            after = 0.0
        if failure is not None:
            after = failure.braked(before, after, dt)
        load = self.load
        current = load.inertia * (after - before) / dt + self.load_current
        if after > 0.0:
            current += load.viscous * after + load.friction
        elif after < 0.0:
            current += load.viscous * after - load.friction
        size = current if current >= 0.0 else -current
        if size <= self.continuous_current and size <= self.output_current:
            return current, after
        limited = self._within_limit(current)
        return limited, after if limited == current else self._rolled(before, limited, dt)

    def _detuned(self, regulators: Regulators, wanted: float, blend: float, dt: float) -> tuple[bool, float, float]:
        """Whether there is torque at all; what becomes of the velocity asked for, and of the speed loop's low pass."""
        if self.regulation is _VELOCITY:
            loop = regulators.velocity
            if loop is None:
                return False, 0.0, 0.0
            return True, loop.shaped(wanted, self.velocity, dt), 1.0 - math.exp(-dt * loop.stiffness / SPEED_LAG)
        loop = regulators.position
        if loop is None:
            return False, 0.0, 0.0
        error = loop.shaped(self.demand_position, self.position, dt) - self.position
        return True, self.demand_velocity + loop.stiffness * POSITION_GAIN * error / self.counts_per_rpm_s, blend

    def _within_limit(self, current: float) -> float:
        """`current` as far as the I²t model and the output limit let it be."""
        limit = min(self.output_current, self.continuous_current) if self.limiting else self.output_current
        return max(-limit, min(limit, current))

    def _rolled(self, before: float, current: float, dt: float) -> float:
        """Velocity after `dt` with this motor current against load and friction."""
        return rolled(self.load, before, current - self.load_current, dt)

    def _ramped(self, velocity: float, target: float, dt: float) -> float:
        """`velocity` moved towards `target`; a change of sign brakes to 0 first."""
        if velocity == target:
            return target
        turning = velocity * target < 0.0
        slowing = turning or abs(target) < abs(velocity)
        goal = 0.0 if turning else target
        change = (self.deceleration if slowing else self.acceleration) * dt
        if goal > velocity:
            return velocity + change if velocity + change < goal else goal
        return velocity - change if velocity - change > goal else goal

    def _advance_profile(self, dt: float) -> None:
        """One step of the trajectory generator: as fast as still lets it stop at the target."""
        before = self.demand_velocity
        if self.halted:
            after = self._ramped(before, 0.0, dt)
        else:
            remaining = (self.target - self.demand_position) / self.counts_per_rpm_s  # rpm * s
            distance, towards = abs(remaining), before if remaining > 0.0 else -before
            brake = self.deceleration * dt
            if -STILL_RPM < towards <= brake and distance <= 0.5 * (abs(towards) * dt + 1.0 / self.counts_per_rpm_s):
                self.demand_position, self.demand_velocity = self.target, 0.0
                return
            # Fastest v from which, after this step at (before + v) / 2, the deceleration stops at the target.
            square = 0.25 * brake * brake + self.deceleration * (2.0 * distance - towards * dt)
            stoppable = max(0.0, math.sqrt(square) - 0.5 * brake) if square > 0.0 else 0.0
            after = self._ramped(before, math.copysign(min(self.profile_velocity, stoppable), remaining), dt)
        self.demand_position += (before + after) * 0.5 * dt * self.counts_per_rpm_s
        self.demand_velocity = after

    def _advance_evenly(self, dt: float) -> None:
        """One step towards the target at the profile's velocity [rpm]."""
        step = self.profile_velocity * dt * self.counts_per_rpm_s
        remaining = self.target - self.demand_position
        if -step < remaining < step:
            self.demand_position, step = self.target, remaining
        else:
            step = math.copysign(step, remaining)
            self.demand_position += step
        self.demand_velocity = step / (dt * self.counts_per_rpm_s)


@lru_cache(maxsize=8)
def _blends_of(dt: float) -> tuple[float, float, float]:
    """How much of the step a low pass goes in `dt`: speed loop, averaged velocity, averaged current."""
    return (
        1.0 - math.exp(-dt / SPEED_LAG),
        1.0 - math.exp(-dt * math.tau * VELOCITY_FILTER_HZ),
        1.0 - math.exp(-dt * math.tau * CURRENT_FILTER_HZ),
    )
