"""The drive function of a simulated EPOS: what each mode of operation asks of the motor axis.

Sources: EPOS firmware specification 2010, chapter 9 and 14.59 to 14.93; application note "Device Programming" 2009.
"""

from __future__ import annotations

import math
from math import floor

from artemis.drive_schema import Gains
from artemis.sim.axis import STILL_RPM, Axis, Regulation
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_errors import FOLLOWING_ERROR, OVERLOADED, POSITION_LIMIT
from artemis.sim.epos_objects import HIGHEST, LOWEST, OFF
from artemis.sim.regulators import regulators_for

PROFILE_POSITION, PROFILE_VELOCITY, HOMING = 1, 3, 6
POSITION, VELOCITY, CURRENT = -1, -2, -3

NEW_SET_POINT, AT_ONCE, RELATIVE, HALT = 0x0010, 0x0020, 0x0040, 0x0100  # controlword bits 4, 5, 6, 8
BIT_10, LIMIT_ACTIVE, BIT_12, BIT_13, REFERENCED = 0x0400, 0x0800, 0x1000, 0x2000, 0x8000  # statusword

PRESENT_PLACE = 35
"""Homing method: the present place becomes the home position."""
NO_HOMING = 0
SPEED_WINDOW_RPM = 10.0
"""Target velocity counts as reached within this; the specification names no window."""

FINE_VELOCITY = 0x0008
"""0x2008 bit 3: velocity from the time between encoder pulses."""

# What is needed after every step and every SYNC, found once.
_PROFILE, _HOLDING, _RAMPING = Regulation.PROFILE, Regulation.POSITION, Regulation.VELOCITY
_MISCELLANEOUS = key_of(0x2008, 0)
_POSITION_SETTING = key_of(0x2062, 0)
_TARGET_VELOCITY = key_of(0x60FF, 0)
_TOP_VELOCITY = key_of(0x607F, 0)
_ACCELERATION = key_of(0x6083, 0)
_DECELERATION = key_of(0x6084, 0)
_GAINS = tuple(
    key_of(index, sub) for index, subs in ((0x60F6, 2), (0x60F9, 2), (0x60FB, 3)) for sub in range(1, subs + 1)
)


class Motion:
    """Modes of operation of one drive. Positions here are the drive's counter: 0 at power-up, moved by homing."""

    def __init__(self, dictionary: Dictionary, axis: Axis, *, clip_position: bool, gains: Gains | None) -> None:
        """`gains`: those with which the loops of `axis` are tuned; None: the drive's own."""
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
        self._factory_gains = self._gains()
        self._nominal_gains = gains.numbers if gains is not None else self._factory_gains
        # The same as the axis counts it, for what is looked at after every step: from the first to below the second.
        self._counter_range = self._allowed_range = (-math.inf, math.inf)
        self._describe()

    # ------------------------------------------------------------------------------------------ what can be read

    def position(self) -> int:
        """Position actual value (0x6064) [counts]."""
        return floor(self.axis.position + 0.5) - self._zero

    def encoder_counter(self) -> int:
        """The raw 16-bit counter (0x2020), untouched by homing."""
        return (floor(self.axis.position + 0.5) - self._power_up) & 0xFFFF

    def position_demand(self) -> int:
        """Output of the trajectory generator (0x6062) [counts]."""
        demand = floor(self.axis.demand_position + 0.5) - self._zero
        return max(LOWEST, min(HIGHEST, demand))

    def counts_per_ms(self) -> int:
        """Counts in the last millisecond: all that the drive knows of a speed at short notice."""
        axis = self.axis
        place = axis.position + 0.5
        return floor(place) - floor(place - axis.velocity * axis.counts_per_rpm_s * 0.001)

    def velocity(self) -> int:
        """Velocity actual value (0x606C) [rpm], in steps of 1 count/ms unless 0x2008 bit 3 asks for finer ones."""
        if self._values[_MISCELLANEOUS] & FINE_VELOCITY:
            return round(self.axis.velocity)
        return round(self.counts_per_ms() * 60000 / self.axis.counts_per_turn)

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

    def _describe(self) -> None:
        """Tie the objects of motion to this object."""
        axis, getters, written = self.axis, self._dictionary.getters, self._dictionary.written
        getters[key_of(0x2020, 0)] = self.encoder_counter
        getters[key_of(0x2027, 0)] = lambda: _int16(axis.current_averaged)
        getters[key_of(0x2028, 0)] = lambda: round(axis.velocity_averaged)
        getters[key_of(0x20F4, 0)] = lambda: _int16(axis.lag)
        getters[key_of(0x6061, 0)] = lambda: self.mode
        getters[key_of(0x6062, 0)] = self.position_demand
        getters[key_of(0x6064, 0)] = self.position
        getters[key_of(0x6069, 0)] = lambda: self.counts_per_ms() * 1000
        getters[key_of(0x606B, 0)] = lambda: round(axis.demand_velocity)
        getters[key_of(0x606C, 0)] = self.velocity
        getters[key_of(0x6078, 0)] = lambda: _int16(axis.current)
        written[key_of(0x6060, 0)] = self._change_mode
        written[key_of(0x2062, 0)] = lambda _: self._set_direct(POSITION)
        written[key_of(0x206B, 0)] = lambda _: self._set_direct(VELOCITY)
        written[key_of(0x2030, 0)] = lambda _: self._set_direct(CURRENT)
        for index, subs in ((0x6065, (0,)), (0x6067, (0,)), (0x607D, (1, 2)), (0x6410, (1, 2, 4, 5))):
            for sub in subs:
                written[key_of(index, sub)] = lambda _: self.configure()
        for key in _GAINS:
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
        number, axis = self._dictionary.number, self.axis
        axis.continuous_current = float(number(0x6410, 1))
        axis.output_current = float(number(0x6410, 2))
        axis.current_mode_rpm = float(number(0x6410, 4))
        axis.thermal_time = number(0x6410, 5) * 0.1
        low, high = number(0x607D, 1), number(0x607D, 2)
        limits = (-math.inf if low == LOWEST else low, math.inf if high == HIGHEST else high)
        self._limits = None if limits == (-math.inf, math.inf) else limits
        following, window = number(0x6065), number(0x6067)
        self._following_limit = math.inf if following == OFF else float(following)
        self._window = None if window == OFF else float(window)
        self._count_from(self._zero)

    def _gains(self) -> tuple[int, ...]:
        return tuple(self._values[key] for key in _GAINS)

    def _tune(self, gains: tuple[int, ...]) -> None:
        """Take over the regulators' gains."""
        self.axis.fail(regulators=regulators_for(gains, self._nominal_gains))

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
        """Operation Enable begins: modes 3, -1 and -2 obey at once what their set-point object still holds."""
        self.commanded = True
        self._begin_mode()

    def release(self) -> None:
        """Power off: the shaft coasts."""
        self.commanded = False
        self._queued, self._acknowledged = None, False
        self.axis.regulate(Regulation.OFF, 0.0)

    def quick_stop(self) -> None:
        """Ramp down with 0x6085 in the profile modes, as hard as the current allows in the others; then stand still.

        For the current mode the specification says nothing; it stops like the other two.
        """
        self.commanded = False
        self.axis.deceleration = math.inf if self.mode < 0 else float(self._dictionary.number(0x6085))
        self.axis.regulate(Regulation.VELOCITY, 0.0)

    def fault_stop(self) -> None:
        """Ramp of a fault reaction: 0x6085 in every mode."""
        self.commanded = False
        self.axis.deceleration = float(self._dictionary.number(0x6085))
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
            self._home()
        return 0

    def _set_velocity(self) -> None:
        values, axis = self._values, self.axis
        axis.acceleration = float(values[_ACCELERATION])
        axis.deceleration = float(values[_DECELERATION])
        top = values[_TOP_VELOCITY]
        target = 0 if self._controlword & HALT else values[_TARGET_VELOCITY]
        axis.regulate(_RAMPING, float(max(-top, min(top, target))))

    def _handshake(self, rising: bool) -> int:
        """Set-point handshake of the profile position mode; a set-point with no place to wait overloads the device."""
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
                return OVERLOADED
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

    def _set_direct(self, mode: int) -> None:
        """A set-point of the modes without a ramp takes effect as it is written."""
        if not self.commanded or self.mode != mode:
            return
        if mode == POSITION:
            target = float(self._clipped(self._values[_POSITION_SETTING]) + self._zero)
            self.axis.regulate(_HOLDING, target)
            self.axis.demand_position = target
        elif mode == VELOCITY:
            self.axis.acceleration = self.axis.deceleration = math.inf
            self.axis.regulate(Regulation.VELOCITY, float(self._dictionary.number(0x206B)))
        else:
            self.axis.regulate(Regulation.CURRENT, float(self._dictionary.number(0x2030)))

    def _home(self) -> None:
        """Method 35 succeeds where it stands, method 0 needs nothing; all others miss their switches: homing error."""
        method = self._dictionary.number(0x6098)
        self._homed = method in (PRESENT_PLACE, NO_HOMING)
        self._homing_failed = not self._homed
        if method == PRESENT_PLACE:
            self._count_from(floor(self.axis.position + 0.5) - self._dictionary.number(0x2081))
        self.referenced = self.referenced or self._homed

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
        elif self.mode in (POSITION, VELOCITY):
            self._set_direct(self.mode)
        elif self.mode == CURRENT:
            axis.regulate(Regulation.CURRENT, 0.0)  # 0x2030 is evaluated when it is written
        elif self.mode in (PROFILE_POSITION, HOMING):
            axis.halted = False
            axis.deceleration = float(self._dictionary.number(0x6084))
            distance = axis.velocity * abs(axis.velocity) / (2.0 * axis.deceleration) * axis.counts_per_rpm_s
            axis.regulate(Regulation.PROFILE, float(floor(axis.position + distance + 0.5)))
        else:
            axis.deceleration = float(self._dictionary.number(0x6084))
            axis.regulate(Regulation.VELOCITY, 0.0)  # diagnostic, master encoder, step/direction: stands still

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
            return POSITION_LIMIT
        regulation = axis.regulation
        if regulation is _HOLDING or regulation is _PROFILE:
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


def _int16(value: float) -> int:
    return round(value) if -32768.0 <= value <= 32767.0 else 32767 if value > 0.0 else -32768
