"""What the EPOS4 adds to the drive function: cyclic synchronous modes, velocity units, its own objects.

Sources: the EPOS4's EDS; its communication guide 2019; the maker's note "EPOS4 and ROS 2" 2024; public tables that
quote its firmware specification. Inferred: set-points of SDO requests are taken without interpolation; numbers keep
their digits when the unit 0x60A9 changes; position limits 0 and 0 are off, as from the factory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Set
from math import floor
from typing import ClassVar

from artemis.sim.axis import STILL_RPM, Axis, Regulation
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos4_errors import MISSED_SET_POINT, NEGATIVE_SWITCH, POSITION_LIMIT_4, POSITIVE_SWITCH
from artemis.sim.epos4_homing import Homing
from artemis.sim.epos_motion import BIT_10, BIT_12, BIT_13, HALT, HOMING, LIMIT_ACTIVE, NEW_SET_POINT, Motion, int16

CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE = 8, 9, 10
SSI = 3
"""Byte 1 of object 0x3000:1."""
PRESENT_PLACE = 37
"""Homing method: the present place becomes the home position, with or without power."""
NEGATIVE_LIMIT, POSITIVE_LIMIT = 0, 1
"""Functions of digital inputs, object 0x3142."""

GAINS = tuple(
    key_of(index, sub) for index, subs in ((0x30A0, 2), (0x30A2, 2), (0x30A1, 3)) for sub in range(1, subs + 1)
)
_SET_POINTS = {
    CYCLIC_POSITION: (key_of(0x607A, 0), key_of(0x60B0, 0)),
    CYCLIC_VELOCITY: (key_of(0x60FF, 0), key_of(0x60B1, 0)),
    CYCLIC_TORQUE: (key_of(0x6071, 0), key_of(0x60B2, 0)),
}
"""Target and offset of the cyclic modes."""
_LIMITS = (
    *((0x3001, sub) for sub in (1, 2, 4, 5)),
    *((index, 0) for index in (0x6080, 0x60A9)),
    (0x60C2, 1),
)
_SENSOR_TYPES = key_of(0x3000, 1)
_SENSORS = ((0x3000, 1), (0x3000, 2), (0x3010, 1), (0x3010, 2), (0x3012, 2), (0x3020, 1), (0x301A, 1))


class Epos4Motion(Motion):
    """Modes of operation of one EPOS4."""

    position_limit_error: ClassVar[int] = POSITION_LIMIT_4
    crowded_error: ClassVar[int] = 0

    def __init__(
        self,
        dictionary: Dictionary,
        axis: Axis,
        *,
        tolerance: float,
        active: Set[int],
        nominal_gains: tuple[int, ...] | None,
    ) -> None:
        """Stand still.

        Args:
            dictionary: Its objects.
            axis: What it moves.
            tolerance: How late a set-point may be, in interpolation periods.
            active: Functions of the digital inputs that are active, as they are at any time.
            nominal_gains: Those with which the loops of `axis` are tuned; None: the drive's own.
        """
        self._tolerance = tolerance
        self._active = active
        self._period = 0.0
        self._silence = 0.0
        self._at_once = False
        self._top = math.inf
        self._speed_limited = False
        self.homing = Homing(dictionary, axis, active.__contains__)
        super().__init__(dictionary, axis, clip_position=False, gains=GAINS, nominal_gains=nominal_gains)

    # ------------------------------------------------------------------------------------------ what can be read

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        super().describe()
        axis, getters, written = self.axis, self._dictionary.getters, self._dictionary.written
        getters[key_of(0x606B, 0)] = lambda: self._shown(axis.demand_velocity)
        for index, sub in ((0x606C, 0), (0x60E5, 1)):
            getters[key_of(index, sub)] = lambda: self._shown(axis.velocity)
        for index, sub in ((0x30D3, 1), (0x60E5, 9)):
            getters[key_of(index, sub)] = lambda: self._shown(axis.velocity_averaged)
        getters[key_of(0x60E4, 1)] = self.position
        getters[key_of(0x60E4, 2)] = getters[key_of(0x3012, 9)] = self.absolute_position
        getters[key_of(0x60F4, 0)] = lambda: round(axis.lag)
        getters[key_of(0x30D0, 0)] = lambda: round(axis.current)
        getters[key_of(0x30D1, 1)] = lambda: round(axis.current_averaged)
        getters[key_of(0x30D1, 2)] = lambda: round(axis.current)
        getters[key_of(0x6076, 0)] = self.rated_torque
        getters[key_of(0x6077, 0)] = lambda: self._per_mille(axis.current)
        getters[key_of(0x30D2, 1)] = lambda: self._per_mille(axis.current_averaged)
        getters[key_of(0x3000, 5)] = self.resolution
        getters[key_of(0x3000, 6)] = lambda: round(self._top)
        for mode, (target, offset) in _SET_POINTS.items():
            self._dictionary.checks[target] = self._note_request
            written[target] = self._taker(mode, counts=True)
            written[offset] = self._taker(mode, counts=False)
        for index, sub in _LIMITS:
            written[key_of(index, sub)] = lambda _: self.configure()
        for index, sub in _SENSORS:
            written[key_of(index, sub)] = lambda _: self._count_anew()

    def rated_torque(self) -> int:
        """Motor rated torque (0x6076) [µN·m]: 0 while nobody has told the torque constant."""
        return self._values[key_of(0x3001, 1)] * self._values[key_of(0x3001, 5)] // 1000

    @property
    def reads_ssi(self) -> bool:
        """An SSI encoder is configured as sensor 2."""
        return self._values[_SENSOR_TYPES] & 0xFF00 == SSI << 8

    def absolute_position(self) -> int:
        """What the SSI encoder counts, as many of its bits as the drive clocks in; the first is the highest."""
        if self.axis.encoder is None or not self.reads_ssi:
            return 0
        counts, bits = self.axis.encoder
        missing = bits - (self._values[key_of(0x3012, 0xB)] & 0x1F)
        return counts >> missing if missing > 0 else counts << -missing

    def resolution(self) -> int:
        """Main sensor resolution (0x3000:5) [increments per turn], as the sensors are configured; 0: none is."""
        values = self._values
        sensors, main = values[key_of(0x3000, 1)], values[key_of(0x3000, 2)] >> 16 & 0xF
        if main == 1 and sensors & 0xFF == 1:
            return 4 * values[key_of(0x3010, 1)]
        if main == 2 and sensors >> 8 & 0xFF == 1:
            return 4 * values[key_of(0x3020, 1)]
        if main == 2 and self.reads_ssi:
            return int(1 << (values[key_of(0x3012, 0xB)] & 0x1F))
        if main == 3 and sensors >> 16 & 0xFF == 0x10:
            return 6 * values[key_of(0x3001, 3)]
        return 0

    def status_bits(self) -> int:
        """The statusword's bits 10, 12 and 13 of the present mode, 11 and 15."""
        bits = super().status_bits()
        if self._speed_limited:
            bits |= LIMIT_ACTIVE
        if self.mode == HOMING:
            bits &= ~BIT_10
            if -STILL_RPM < self.axis.velocity < STILL_RPM:
                bits |= BIT_10
        elif self.mode in _SET_POINTS:
            if self.commanded and not self._controlword & HALT:
                bits |= BIT_12
            if self._followed_badly:
                bits |= BIT_13
        return bits

    def _shown(self, velocity: float) -> int:
        """A velocity [rpm] in the drive's unit."""
        return max(-0x80000000, min(0x7FFFFFFF, round(velocity / self.rpm)))

    def _per_mille(self, current: float) -> int:
        """A current [mA] as torque, in thousandths of the rated one."""
        return int16(1000.0 * current / self._values[key_of(0x3001, 1)]) if self.rated_torque() else 0

    # ------------------------------------------------------------------------------------------ life and power

    def read_limits(self) -> None:
        """Take over motor data, units and the interpolation period."""
        number, axis = self._dictionary.number, self.axis
        prefix = number(0x60A9) >> 24
        self.rpm = 10.0 ** (prefix - 256 if prefix else 0)
        axis.continuous_current = float(number(0x3001, 1))
        axis.output_current = float(number(0x3001, 2))
        axis.thermal_time = number(0x3001, 4) * 0.1
        self._top = axis.current_mode_rpm = number(0x6080) * self.rpm
        self._period = number(0x60C2, 1) * 1e-3

    def position_limits(self) -> tuple[float, float]:
        """Objects 0x607D [counts]; infinite: off."""
        if not (self._dictionary.number(0x607D, 1) or self._dictionary.number(0x607D, 2)):
            return -math.inf, math.inf
        return super().position_limits()

    def engage(self) -> None:
        """Operation Enabled begins."""
        self._silence = 0.0
        super().engage()

    def release(self) -> None:
        """Power off: the shaft coasts."""
        self.homing.stop()
        super().release()

    def brake(self, ramp: int) -> None:
        """Ramp down with the deceleration of this index."""
        self.homing.stop()
        super().brake(ramp)

    def quick_stop(self) -> None:
        """Ramp down with 0x6085 in every mode, and stay there with power."""
        self.brake(0x6085)

    def _leave_mode(self) -> None:
        self.homing.stop()
        super()._leave_mode()

    def _count_anew(self) -> None:
        """The sensors are others."""
        self.count_on_from(0)
        self.lose_reference()

    def lose_reference(self) -> None:
        """The place of the home position is not known any longer."""
        self.referenced = False

    # ------------------------------------------------------------------------------------------ commands

    def command(self, controlword: int) -> int:
        """Obey the mode's bits of a controlword; returns the device error that it causes, or 0."""
        changed = controlword ^ self._controlword
        if self.mode == HOMING and controlword & HALT and self.homing.runs:
            self.homing.stop()
            self.axis.regulate(Regulation.VELOCITY, 0.0)
        elif self.mode == HOMING and not self.commanded and controlword & changed & NEW_SET_POINT:
            if self._dictionary.number(0x6098) == PRESENT_PLACE:
                self._arrive_home()
        error = super().command(controlword)
        if changed & HALT and self.commanded and self.mode in _SET_POINTS:
            self.set_direct(self.mode)
        return error

    def _set_velocity(self) -> None:
        number, axis = self._dictionary.number, self.axis
        axis.acceleration, axis.deceleration = self._acceleration(0x6083), self._acceleration(0x6084)
        top = min(number(0x607F), number(0x6080))
        target = 0 if self._controlword & HALT else number(0x60FF)
        self._speed_limited = abs(target) > top
        axis.regulate(Regulation.VELOCITY, max(-top, min(top, target)) * self.rpm)

    def _begin_profile(self, target: int, relative: bool) -> None:
        number, axis = self._dictionary.number, self.axis
        axis.profile_velocity = min(number(0x6081), number(0x607F), number(0x6080)) * self.rpm
        axis.acceleration, axis.deceleration = self._acceleration(0x6083), self._acceleration(0x6084)
        if relative:
            target += self.position_demand()
        self._inside = 0.0
        axis.regulate(Regulation.PROFILE, float(target + self._zero))

    def _acceleration(self, index: int) -> float:
        return float(min(self._dictionary.number(index), self._dictionary.number(0x60C5)))

    def _note_request(self, _: int) -> None:
        """Only an SDO request is checked before it is written."""
        self._at_once = True

    def _taker(self, mode: int, *, counts: bool) -> Callable[[int], None]:
        def take(_: int) -> None:
            at_once, self._at_once = self._at_once, False
            if not self.commanded or self.mode != mode:
                return
            if counts:
                self._silence = 0.0
            period = self._period
            if at_once:
                self._period = 0.0
            self.set_direct(mode)
            self._period = period

        return take

    def set_direct(self, mode: int) -> None:
        """The target of a cyclic mode, with its offset: reached within the interpolation period, or at once."""
        axis = self.axis
        if self._controlword & HALT:
            axis.deceleration = float(self._dictionary.number(0x6084))
            axis.regulate(Regulation.VELOCITY, 0.0)
            return
        target, offset = _SET_POINTS[mode]
        wanted = self._values[target] + self._values[offset]
        self._speed_limited = False
        if mode == CYCLIC_POSITION:
            self._lead_to(float(wanted + self._zero))
        elif mode == CYCLIC_VELOCITY:
            speed = max(-self._top, min(self._top, wanted * self.rpm))
            self._speed_limited = speed != wanted * self.rpm
            axis.regulate(Regulation.VELOCITY, speed)
            change = abs(speed - axis.demand_velocity)
            axis.acceleration = axis.deceleration = change / self._period if self._period else math.inf
        else:
            nominal = self._dictionary.number(0x3001, 1) if self.rated_torque() else 0
            axis.regulate(Regulation.CURRENT, wanted * nominal / 1000.0)

    def _lead_to(self, target: float) -> None:
        """A target of the cyclic position mode, as the axis counts."""
        axis = self.axis
        if not self._period:
            axis.regulate(Regulation.POSITION, target)
            axis.demand_position = target
            return
        axis.regulate(Regulation.EVEN, target)
        speed = abs(target - axis.demand_position) / (self._period * axis.counts_per_rpm_s)
        self._speed_limited = speed > self._top
        axis.profile_velocity = min(speed, self._top)

    # ------------------------------------------------------------------------------------------ homing

    def home(self) -> None:
        """Begin homing; bits 12 and 13 say how it ends."""
        self._homed = self._homing_failed = False
        self.homing.begin(self._dictionary.number(0x6098), self.rpm)

    def _arrive_home(self) -> None:
        """This is the home position."""
        self._count_from(floor(self.axis.position + 0.5) - self._dictionary.number(0x30B0))
        self._homed = self.referenced = True

    # ------------------------------------------------------------------------------------------ supervision

    def supervise(self, dt: float) -> int:
        """After each step: homing, limits, limit switches and missed set-points; returns a device error or 0."""
        error = super().supervise(dt)
        if error or not self.commanded:
            return error
        if self.mode == HOMING:
            if self.homing.advance(self.axis.position):
                self._arrive_home()
            return 0
        demand = self.axis.demand_velocity
        if demand > 0.0 and POSITIVE_LIMIT in self._active:
            return POSITIVE_SWITCH
        if demand < 0.0 and NEGATIVE_LIMIT in self._active:
            return NEGATIVE_SWITCH
        if self._period and self.mode in _SET_POINTS:
            self._silence += dt
            if self._silence > self._period * (1.0 + self._tolerance):
                self._silence = 0.0
                return MISSED_SET_POINT
        return 0
