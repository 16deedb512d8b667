"""The drive function of a simulated EPOS: what the modes of operation that all generations have ask of the motor axis.

Sources: EPOS firmware specification 2010, chapter 9 and 14.59 to 14.93; application note "Device Programming" 2009.
What others add is in `epos1_motion.py`, `cia402_motion.py` and `epos4_motion.py`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from math import floor
from typing import ClassVar

from artemis.sim.axis import STILL_RPM, Axis, Regulation
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_errors import FOLLOWING_ERROR, OVERLOADED, POSITION_LIMIT
from artemis.sim.epos_objects import HIGHEST, LOWEST, OFF
from artemis.sim.regulators import regulators_for

PROFILE_POSITION, PROFILE_VELOCITY, HOMING = 1, 3, 6

NEW_SET_POINT, AT_ONCE, RELATIVE, HALT = 0x0010, 0x0020, 0x0040, 0x0100  # controlword bits 4, 5, 6, 8
BIT_10, LIMIT_ACTIVE, BIT_12, BIT_13, REFERENCED = 0x0400, 0x0800, 0x1000, 0x2000, 0x8000  # statusword

SPEED_WINDOW_RPM = 10.0
"""Target velocity counts as reached within this; the specification names no window."""

# What is needed after every step and every SYNC, found once.
_PROFILE, _HOLDING, _RAMPING, _EVEN = Regulation.PROFILE, Regulation.POSITION, Regulation.VELOCITY, Regulation.EVEN
_TARGET_VELOCITY = key_of(0x60FF, 0)
_TOP_VELOCITY = key_of(0x607F, 0)
_ACCELERATION = key_of(0x6083, 0)
_DECELERATION = key_of(0x6084, 0)


class Motion(ABC):
    """Modes of operation of one drive. Positions here are the drive's counter: 0 at power-up, moved by homing.

    A generation ties its own objects in `describe`, and has limits, modes without a ramp and homing methods of its own.
    """

    position_limit_error: ClassVar[int] = POSITION_LIMIT
    """Code for a place beyond 0x607D."""
    crowded_error: ClassVar[int] = OVERLOADED
    """Code for a set-point with no place to wait; 0: it is only not acknowledged."""

    def __init__(
        self,
        dictionary: Dictionary,
        axis: Axis,
        *,
        clip_position: bool,
        gains: tuple[int, ...],
        nominal_gains: tuple[int, ...] | None,
    ) -> None:
        """Stand still.

        Args:
            dictionary: Its objects.
            axis: What it moves.
            clip_position: Position limits clip the set-point.
            gains: Keys of the regulators' gains, in the order of `regulators_for`.
            nominal_gains: Those with which the loops of `axis` are tuned; None: the drive's own.
        """
        self.axis = axis
        self.mode = PROFILE_POSITION
        self.commanded = False
        """Operation Enable: set-points are obeyed."""
        self.referenced = False
        self._dictionary = dictionary
        self._values = dictionary.values
        self._clip_position = clip_position
        self._zero = 0
        self._power_up = 0
        self._controlword = 0
        self._queued: tuple[int, bool] | None = None
        self._acknowledged = False
        self._homed = self._homing_failed = self._followed_badly = False
        self._limits: tuple[float, float] | None = None
        self._following_limit = math.inf
        self._window: float | None = None
        self._inside = 0.0
        self.rpm = 1.0
        """Unit of the drive's velocities [rpm]."""
        self._gain_keys = gains
        self._factory_gains = self._gains()
        self._nominal_gains = self._factory_gains if nominal_gains is None else nominal_gains
        # The same as the axis counts it, for what is looked at after every step: from the first to below the second.
        self._counter_range = self._allowed_range = (-math.inf, math.inf)
        self.describe()

    # ------------------------------------------------------------------------------------------ what can be read

    def position(self) -> int:
        """Position actual value (0x6064) [counts]."""
        return floor(self.axis.position + 0.5) - self._zero

    def position_demand(self) -> int:
        """Output of the trajectory generator (0x6062) [counts]."""
        demand = floor(self.axis.demand_position + 0.5) - self._zero
        return max(LOWEST, min(HIGHEST, demand))

    def status_bits(self) -> int:
        """The statusword's bits 10, 12 and 13 of the present mode, 11 and 15."""
        axis = self.axis
        bits = REFERENCED if self.referenced else 0
        if axis.heat > axis.continuous_current * axis.continuous_current:
            bits |= LIMIT_ACTIVE
        mode = self.mode
        if mode == PROFILE_VELOCITY:
            if -STILL_RPM < axis.velocity < STILL_RPM:
                bits |= BIT_12
            if axis.regulation is _RAMPING and abs(axis.velocity - axis.target) < SPEED_WINDOW_RPM:
                bits |= BIT_10
        elif mode == PROFILE_POSITION:
            if axis.regulation is _PROFILE and self._reached():
                bits |= BIT_10
            if self._acknowledged:
                bits |= BIT_12
            if self._followed_badly:
                bits |= BIT_13
        elif mode == HOMING:
            if self._homed:
                bits |= BIT_10 | BIT_12
            if self._homing_failed:
                bits |= BIT_13
        return bits

    def _reached(self) -> bool:
        axis = self.axis
        if axis.halted:
            return axis.velocity == 0.0
        if self._window is None:
            return axis.arrived and self._queued is None
        return self._inside * 1000.0 >= self._dictionary.number(0x6068) and self._in_window(self._window)

    def _in_window(self, window: float) -> bool:
        return abs(self.axis.target - self.axis.position) <= window

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        getters, written = self._dictionary.getters, self._dictionary.written
        getters[key_of(0x6061, 0)] = lambda: self.mode
        getters[key_of(0x6062, 0)] = self.position_demand
        getters[key_of(0x6064, 0)] = self.position
        written[key_of(0x6060, 0)] = self._change_mode
        for index, subs in ((0x6065, (0,)), (0x6067, (0,)), (0x607D, (1, 2))):
            for sub in subs:
                written[key_of(index, sub)] = lambda _: self.configure()
        for key in self._gain_keys:
            written[key] = lambda _: self._tune(self._gains())

    # ------------------------------------------------------------------------------------------ life and power

    def start(self) -> None:
        """Power-up or node reset: the counter is 0 where the shaft is."""
        self._zero = self._power_up = floor(self.axis.position + 0.5)
        self.referenced = self._followed_badly = False
        self._controlword = 0
        self.release()
        self._leave_mode()
        self.mode = self._dictionary.number(0x6060)
        self.configure()
        gains = self._gains()  # a drive of which nobody has set them is simulated as if it were tuned
        self._tune(self._nominal_gains if gains == self._factory_gains else gains)

    def configure(self) -> None:
        """Take over limits from the dictionary."""
        number = self._dictionary.number
        self.read_limits()
        limits = self.position_limits()
        self._limits = None if limits == (-math.inf, math.inf) else limits
        following, window = number(0x6065), number(0x6067)
        self._following_limit = math.inf if following == OFF else float(following)
        self._window = None if window == OFF else float(window)
        self._count_from(self._zero)

    @abstractmethod
    def read_limits(self) -> None:
        """Take over what a generation has objects of its own for."""

    def position_limits(self) -> tuple[float, float]:
        """Objects 0x607D [counts]: one at the end of its range is off, which is an infinite one."""
        low, high = self._dictionary.number(0x607D, 1), self._dictionary.number(0x607D, 2)
        return -math.inf if low == LOWEST else float(low), math.inf if high == HIGHEST else float(high)

    def _gains(self) -> tuple[int, ...]:
        return tuple(self._values[key] for key in self._gain_keys)

    def _tune(self, gains: tuple[int, ...]) -> None:
        """Take over the regulators' gains."""
        self.axis.tune(gains, regulators_for(gains, self._nominal_gains))

    def _count_from(self, zero: int) -> None:
        """Make `zero`, as the axis counts, the place at which the position actual value is 0."""
        self._zero = zero
        self._counter_range = zero + LOWEST - 0.5, zero + HIGHEST + 0.5
        low, high = (-math.inf, math.inf) if self._limits is None or self._clip_position else self._limits
        self._allowed_range = zero + low - 0.5, zero + high + 0.5

    def count_on_from(self, position: int) -> None:
        """Failure: the counter jumps; the position actual value is `position` [counts] where the shaft is."""
        self._count_from(floor(self.axis.position + 0.5) - position)

    def engage(self) -> None:
        """Operation Enable begins: a mode that needs no command obeys at once what its set-point object still holds."""
        self.commanded = True
        self._begin_mode()

    def release(self) -> None:
        """Power off: the shaft coasts."""
        self.commanded = False
        self._queued, self._acknowledged = None, False
        self.axis.regulate(Regulation.OFF, 0.0)

    def quick_stop(self) -> None:
        """Ramp down with 0x6085 in the profile modes, as hard as the current allows in others; then stand still.

        For the current mode the specification says nothing; it stops like the other two.
        """
        self.commanded = False
        self.axis.deceleration = math.inf if self.mode < 0 else float(self._dictionary.number(0x6085))
        self.axis.regulate(Regulation.VELOCITY, 0.0)

    def fault_stop(self) -> None:
        """Ramp of a fault reaction: 0x6085 in every mode."""
        self.brake(0x6085)

    def brake(self, ramp: int) -> None:
        """Ramp down with the deceleration of this index."""
        self.commanded = False
        self.axis.deceleration = float(self._dictionary.number(ramp))
        self.axis.regulate(Regulation.VELOCITY, 0.0)

    def forgive(self) -> None:
        """Fault reset: the following error in bit 13 is history."""
        self._followed_badly = False

    # ------------------------------------------------------------------------------------------ commands

    def note(self, controlword: int) -> None:
        """Remember a controlword that was a matter of the device state machine, for the edge of bit 4 and for halt."""
        self._controlword = controlword

    def command(self, controlword: int) -> int:
        """Obey the mode's bits of a controlword; returns the device error that it causes, or 0."""
        rising = controlword & ~self._controlword & NEW_SET_POINT
        self._controlword = controlword
        if not self.commanded:
            return 0
        if self.mode == PROFILE_VELOCITY:
            self._set_velocity()
        elif self.mode == PROFILE_POSITION:
            return self._handshake(bool(rising))
        elif self.mode == HOMING and rising:
            self.home()
        return 0

    def _set_velocity(self) -> None:
        values, axis = self._values, self.axis
        axis.acceleration = float(values[_ACCELERATION])
        axis.deceleration = float(values[_DECELERATION])
        top = values[_TOP_VELOCITY]
        target = 0 if self._controlword & HALT else values[_TARGET_VELOCITY]
        axis.regulate(_RAMPING, float(max(-top, min(top, target))))

    def _handshake(self, rising: bool) -> int:
        """Set-point handshake of the profile position mode; a set-point may have no place to wait."""
        axis, controlword = self.axis, self._controlword
        axis.halted = bool(controlword & HALT)
        if axis.halted:
            axis.deceleration = float(self._dictionary.number(0x6084))
        if rising:
            set_point = (self._dictionary.number(0x607A), bool(controlword & RELATIVE))
            if controlword & AT_ONCE or (axis.arrived and self._queued is None):
                self._queued = None
                self._begin_profile(*set_point)
            elif self._queued is None:
                self._queued = set_point
            else:
                return self.crowded_error
            self._acknowledged = True
        elif not controlword & NEW_SET_POINT and self._queued is None:
            self._acknowledged = False
        return 0

    def _begin_profile(self, target: int, relative: bool) -> None:
        number, axis = self._dictionary.number, self.axis
        axis.profile_velocity = float(min(number(0x6081), number(0x607F)))
        axis.acceleration, axis.deceleration = float(number(0x6083)), float(number(0x6084))
        if relative:
            target += self.position_demand()
        self._inside = 0.0
        axis.regulate(Regulation.PROFILE, self._clipped(target) + self._zero)

    def _clipped(self, target: float) -> float:
        if self._limits is None or not self._clip_position:
            return target
        return max(self._limits[0], min(self._limits[1], target))

    @abstractmethod
    def set_direct(self, mode: int) -> None:
        """A mode without a ramp begins with what its set-point object still holds."""

    @abstractmethod
    def home(self) -> None:
        """Begin homing."""

    def _change_mode(self, mode: int) -> None:
        if mode == self.mode:
            return
        self._leave_mode()
        self.mode = mode
        if self.commanded:
            self._begin_mode()

    def _leave_mode(self) -> None:
        self._queued, self._acknowledged = None, False
        self._homed = self._homing_failed = False

    def _begin_mode(self) -> None:
        axis = self.axis
        if self.mode == PROFILE_VELOCITY:
            self._set_velocity()
        elif self.mode in (PROFILE_POSITION, HOMING):
            axis.halted = False
            axis.deceleration = float(self._dictionary.number(0x6084))
            distance = axis.velocity * abs(axis.velocity) / (2.0 * axis.deceleration) * axis.counts_per_rpm_s
            axis.regulate(Regulation.PROFILE, float(floor(axis.position + distance + 0.5)))
        else:
            self.set_direct(self.mode)

    # ------------------------------------------------------------------------------------------ supervision

    def supervise(self, dt: float) -> int:
        """After each step: start what was queued, wrap the counter, watch the limits; returns a device error or 0."""
        axis = self.axis
        position = axis.position
        low, high = self._counter_range
        if not low <= position < high:
            self._count_from(self._zero + (1 << 32 if position >= high else -(1 << 32)))
            self.referenced = False
        if not self.commanded:
            return 0
        low, high = self._allowed_range
        demand = axis.demand_position
        if not (low <= position < high and low <= demand < high) and self.mode != HOMING:
            return self.position_limit_error
        regulation = axis.regulation
        if regulation is _HOLDING or regulation is _PROFILE or regulation is _EVEN:
            limit = self._following_limit
            if not -limit <= demand - position <= limit:
                self._followed_badly = True
                return FOLLOWING_ERROR
            if self._window is not None:
                self._inside = self._inside + dt if self._in_window(self._window) else 0.0
            if self._queued is not None and axis.arrived:
                set_point, self._queued = self._queued, None
                self._begin_profile(*set_point)
                if not self._controlword & NEW_SET_POINT:
                    self._acknowledged = False
        return 0


def int16(value: float) -> int:
    """The nearest number of an INTEGER16."""
    return round(value) if -32768.0 <= value <= 32767.0 else 32767 if value > 0.0 else -32768
