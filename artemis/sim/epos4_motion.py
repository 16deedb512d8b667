"""What the EPOS4 adds to the drive function: cyclic synchronous modes, velocity units, its own objects.

Sources: the EPOS4's EDS; its communication guide 2019; the maker's note "EPOS4 and ROS 2" 2024; public tables that
quote its firmware specification. Inferred: set-points of SDO requests are taken without interpolation; numbers keep
their digits when the unit 0x60A9 changes; position limits 0 and 0 are off, as from the factory.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from math import floor
from typing import ClassVar

from artemis.sim.axis import Axis, Regulation
from artemis.sim.cia402_motion import CyclicMotion
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos4_errors import MISSED_SET_POINT, NEGATIVE_SWITCH, POSITION_LIMIT_4, POSITIVE_SWITCH
from artemis.sim.epos4_homing import Homing
from artemis.sim.epos_motion import HALT, HOMING, NEW_SET_POINT, int16

CYCLIC_TORQUE = 10
SSI = 3
"""Byte 1 of object 0x3000:1."""
PRESENT_PLACE = 37
"""Homing method: the present place becomes the home position, with or without power."""
NEGATIVE_LIMIT, POSITIVE_LIMIT = 0, 1
"""Functions of digital inputs, object 0x3142."""

GAINS = tuple(
    key_of(index, sub) for index, subs in ((0x30A0, 2), (0x30A2, 2), (0x30A1, 3)) for sub in range(1, subs + 1)
)
_LIMITS = (
    *((0x3001, sub) for sub in (1, 2, 4, 5)),
    *((index, 0) for index in (0x6080, 0x60A9)),
    (0x60C2, 1),
)
_SENSOR_TYPES = key_of(0x3000, 1)
_SENSORS = ((0x3000, 1), (0x3000, 2), (0x3010, 1), (0x3010, 2), (0x3012, 2), (0x3020, 1), (0x301A, 1))


class Epos4Motion(CyclicMotion):
    """Modes of operation of one EPOS4."""

    position_limit_error: ClassVar[int] = POSITION_LIMIT_4
    set_points: ClassVar[Mapping[int, tuple[int, int]]] = {
        **CyclicMotion.set_points,
        CYCLIC_TORQUE: (key_of(0x6071, 0), key_of(0x60B2, 0)),
    }

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
        self.reads_ssi = False
        """An SSI encoder is configured as sensor 2."""
        self.homing = Homing(dictionary, axis, active.__contains__)
        super().__init__(dictionary, axis, clip_position=False, gains=GAINS, nominal_gains=nominal_gains)

    # ------------------------------------------------------------------------------------------ what can be read

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        super().describe()
        axis, getters, written = self.axis, self._dictionary.getters, self._dictionary.written
        getters[key_of(0x60E5, 1)] = lambda: self._shown(axis.velocity)
        for index, sub in ((0x30D3, 1), (0x60E5, 9)):
            getters[key_of(index, sub)] = lambda: self._shown(axis.velocity_averaged)
        getters[key_of(0x60E4, 1)] = self.position
        getters[key_of(0x60E4, 2)] = getters[key_of(0x3012, 9)] = self.absolute_position
        getters[key_of(0x30D0, 0)] = lambda: round(axis.current)
        getters[key_of(0x30D1, 1)] = lambda: round(axis.current_averaged)
        getters[key_of(0x30D1, 2)] = lambda: round(axis.current)
        getters[key_of(0x6076, 0)] = self.rated_torque
        getters[key_of(0x6077, 0)] = lambda: self._per_mille(axis.current)
        getters[key_of(0x30D2, 1)] = lambda: self._per_mille(axis.current_averaged)
        getters[key_of(0x3000, 5)] = self.resolution
        getters[key_of(0x3000, 6)] = lambda: round(self._top)
        for index, sub in _LIMITS:
            written[key_of(index, sub)] = lambda _: self.configure()
        for index, sub in _SENSORS:
            written[key_of(index, sub)] = lambda _: self._count_anew()

    def rated_torque(self) -> int:
        """Motor rated torque (0x6076) [µN·m]: 0 while nobody has told the torque constant."""
        return self._values[key_of(0x3001, 1)] * self._values[key_of(0x3001, 5)] // 1000

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
        self._look_for_ssi()

    def release(self) -> None:
        """Power off: the shaft coasts."""
        self.homing.stop()
        super().release()

    def brake(self, ramp: int) -> None:
        """Ramp down with the deceleration of this index."""
        self.homing.stop()
        super().brake(ramp)

    def _leave_mode(self) -> None:
        self.homing.stop()
        super()._leave_mode()

    def _count_anew(self) -> None:
        """The sensors are others."""
        self._look_for_ssi()
        self.count_on_from(0)
        self.lose_reference()

    def _look_for_ssi(self) -> None:
        self.reads_ssi = self._values[_SENSOR_TYPES] & 0xFF00 == SSI << 8

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
        return super().command(controlword)

    def _begin_profile(self, target: int, relative: bool) -> None:
        number, axis = self._dictionary.number, self.axis
        axis.profile_velocity = min(number(0x6081), number(0x607F), number(0x6080)) * self.rpm
        axis.acceleration, axis.deceleration = self._acceleration(0x6083), self._acceleration(0x6084)
        if relative:
            target += self.position_demand()
        self._inside = 0.0
        axis.regulate(Regulation.PROFILE, float(target + self._zero))

    def _acceleration(self, index: int) -> float:
        """Of a profile [rpm/s]."""
        return float(min(self._dictionary.number(index), self._dictionary.number(0x60C5)))

    def _current_of(self, torque: int) -> float:
        return torque * self._dictionary.number(0x3001, 1) / 1000.0 if self.rated_torque() else 0.0

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
        if self._period and self.mode in self.set_points:
            self._silence += dt
            if self._silence > self._period * (1.0 + self._tolerance):
                self._silence = 0.0
                return MISSED_SET_POINT
        return 0
