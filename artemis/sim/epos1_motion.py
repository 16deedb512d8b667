"""What the first generation of the EPOS adds to the drive function: modes -1 to -3, and its own objects.

Source: EPOS firmware specification 2010, chapter 9 and 14.59 to 14.93.
"""

from __future__ import annotations

import math
from math import floor

from artemis.drive_schema import Gains
from artemis.sim.axis import Axis, Regulation
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_motion import Motion, int16

POSITION, VELOCITY, CURRENT = -1, -2, -3
PRESENT_PLACE = 35
"""Homing method: the present place becomes the home position."""
NO_HOMING = 0
HOME_INPUT = 4
"""Digital input that has the function home switch from the factory (object 0x2070)."""
FINE_VELOCITY = 0x0008
"""0x2008 bit 3: velocity from the time between encoder pulses."""

_HOLDING = Regulation.POSITION
_MISCELLANEOUS = key_of(0x2008, 0)
_POSITION_SETTING = key_of(0x2062, 0)
GAINS = tuple(
    key_of(index, sub) for index, subs in ((0x60F6, 2), (0x60F9, 2), (0x60FB, 3)) for sub in range(1, subs + 1)
)


class Epos1Motion(Motion):
    """Modes of operation of one EPOS of the first generation."""

    def __init__(self, dictionary: Dictionary, axis: Axis, *, clip_position: bool, gains: Gains | None) -> None:
        """`gains`: those with which the loops of `axis` are tuned; None: the drive's own."""
        nominal = None if gains is None else gains.numbers
        super().__init__(dictionary, axis, clip_position=clip_position, gains=GAINS, nominal_gains=nominal)

    def encoder_counter(self) -> int:
        """The raw 16-bit counter (0x2020), untouched by homing."""
        return (floor(self.axis.position + 0.5) - self._power_up) & 0xFFFF

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

    def inputs(self) -> int:
        """Object 0x2071:1: bits by the functions of the digital inputs, of which only the home switch's is wired."""
        number, bit = self._dictionary.number, 1 << self._dictionary.number(0x2070, HOME_INPUT)
        level = bit if self.axis.home else 0
        return (level ^ number(0x2071, 3)) & number(0x2071, 2) & bit

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        super().describe()
        axis, getters, written = self.axis, self._dictionary.getters, self._dictionary.written
        getters[key_of(0x2020, 0)] = self.encoder_counter
        getters[key_of(0x2027, 0)] = lambda: int16(axis.current_averaged)
        getters[key_of(0x2028, 0)] = lambda: round(axis.velocity_averaged)
        getters[key_of(0x2071, 1)] = self.inputs
        getters[key_of(0x20F4, 0)] = lambda: int16(axis.lag)
        getters[key_of(0x6069, 0)] = lambda: self.counts_per_ms() * 1000
        getters[key_of(0x606B, 0)] = lambda: round(axis.demand_velocity)
        getters[key_of(0x606C, 0)] = self.velocity
        getters[key_of(0x6078, 0)] = lambda: int16(axis.current)
        written[key_of(0x2062, 0)] = lambda _: self._set(POSITION)
        written[key_of(0x206B, 0)] = lambda _: self._set(VELOCITY)
        written[key_of(0x2030, 0)] = lambda _: self._set(CURRENT)
        for sub in (1, 2, 4, 5):
            written[key_of(0x6410, sub)] = lambda _: self.configure()

    def read_limits(self) -> None:
        """Take over the motor data, object 0x6410."""
        number, axis = self._dictionary.number, self.axis
        axis.continuous_current = float(number(0x6410, 1))
        axis.output_current = float(number(0x6410, 2))
        axis.current_mode_rpm = float(number(0x6410, 4))
        axis.thermal_time = number(0x6410, 5) * 0.1

    def _set(self, mode: int) -> None:
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

    def set_direct(self, mode: int) -> None:
        """A mode without a ramp begins with what its set-point object still holds."""
        if mode in (POSITION, VELOCITY):
            self._set(mode)
        elif mode == CURRENT:
            self.axis.regulate(Regulation.CURRENT, 0.0)  # 0x2030 is evaluated when it is written
        else:
            self.axis.deceleration = float(self._dictionary.number(0x6084))
            self.axis.regulate(Regulation.VELOCITY, 0.0)  # diagnostic, master encoder, step/direction: stands still

    def home(self) -> None:
        """Method 35 succeeds where it stands, method 0 needs nothing; all others miss their switches: homing error."""
        method = self._dictionary.number(0x6098)
        self._homed = method in (PRESENT_PLACE, NO_HOMING)
        self._homing_failed = not self._homed
        if method == PRESENT_PLACE:
            self._count_from(floor(self.axis.position + 0.5) - self._dictionary.number(0x2081))
        self.referenced = self.referenced or self._homed
