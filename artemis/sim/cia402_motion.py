"""What the device profile CiA 402 adds to the drive function: cyclic synchronous modes, and units that a drive chooses.

Sources: CiA 402 (objects, modes 3, 8 and 9, option codes); for the EPOS4, which has them too, those of `epos4_motion`.
Inferred: set-points of SDO requests are taken without interpolation; position limits 0 and 0 are off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from artemis.drive_schema import Drive
from artemis.families.cia402 import Cia402
from artemis.sim.axis import STILL_RPM, Axis, Regulation
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_motion import BIT_10, BIT_12, BIT_13, HALT, HOMING, LIMIT_ACTIVE, Motion

CYCLIC_POSITION, CYCLIC_VELOCITY = 8, 9
POSITION_SET_POINT = key_of(0x607A, 0), key_of(0x60B0, 0)
VELOCITY_SET_POINT = key_of(0x60FF, 0), key_of(0x60B1, 0)
"""Target and offset of both modes."""
SLOW_RAMP, QUICK_RAMP = 0x6084, 0x6085
"""Indices of the decelerations."""
HARDEST_RAMP = 0
"""Stands for none: as hard as the current limit allows."""


class CyclicMotion(Motion):
    """Modes of operation of a drive with cyclic synchronous modes."""

    crowded_error: ClassVar[int] = 0
    set_points: ClassVar[Mapping[int, tuple[int, int]]] = {
        CYCLIC_POSITION: POSITION_SET_POINT,
        CYCLIC_VELOCITY: VELOCITY_SET_POINT,
    }
    """Target and offset by mode."""

    def __init__(
        self,
        dictionary: Dictionary,
        axis: Axis,
        *,
        clip_position: bool,
        gains: tuple[int, ...],
        nominal_gains: tuple[int, ...] | None,
    ) -> None:
        """Stand still. Arguments as of `Motion`."""
        self.rpm_s = 1.0
        """Unit of the drive's accelerations [rpm/s]."""
        self._period = 0.0
        """Of interpolation [s]; 0: set-points act at once."""
        self._silence = 0.0
        """Since the last set-point [s]."""
        self._at_once = False
        self._top = math.inf
        """Highest speed of the motor [rpm]."""
        self._speed_limited = False
        super().__init__(dictionary, axis, clip_position=clip_position, gains=gains, nominal_gains=nominal_gains)

    # ------------------------------------------------------------------------------------------ what can be read

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        super().describe()
        axis, getters, written = self.axis, self._dictionary.getters, self._dictionary.written
        getters[key_of(0x606B, 0)] = lambda: self._shown(axis.demand_velocity)
        getters[key_of(0x606C, 0)] = lambda: self._shown(axis.velocity)
        getters[key_of(0x60F4, 0)] = lambda: round(axis.lag)
        for mode, (target, offset) in self.set_points.items():
            self._dictionary.checks[target] = self._note_request
            written[target] = self._taker(mode, counts=True)
            written[offset] = self._taker(mode, counts=False)

    def status_bits(self) -> int:
        """The statusword's bits 10, 12 and 13 of the present mode, 11 and 15."""
        bits = super().status_bits()
        if self._speed_limited:
            bits |= LIMIT_ACTIVE
        if self.mode == HOMING:
            bits &= ~BIT_10
            if -STILL_RPM < self.axis.velocity < STILL_RPM:
                bits |= BIT_10
        elif self.mode in self.set_points:
            if self.commanded and not self._controlword & HALT:
                bits |= BIT_12
            if self._followed_badly:
                bits |= BIT_13
        return bits

    def _shown(self, velocity: float) -> int:
        """A velocity [rpm] in the drive's unit."""
        return max(-0x80000000, min(0x7FFFFFFF, round(velocity / self.rpm)))

    # ------------------------------------------------------------------------------------------ life and power

    def position_limits(self) -> tuple[float, float]:
        """Objects 0x607D [counts]; infinite: off."""
        if not (self._dictionary.number(0x607D, 1) or self._dictionary.number(0x607D, 2)):
            return -math.inf, math.inf
        return super().position_limits()

    def engage(self) -> None:
        """Operation Enabled begins."""
        self._silence = 0.0
        super().engage()

    def brake(self, ramp: int) -> None:
        """Ramp down with the deceleration of this index, or `HARDEST_RAMP`."""
        self.commanded = False
        self.axis.deceleration = self._ramp(ramp) if ramp else math.inf
        self.axis.regulate(Regulation.VELOCITY, 0.0)

    def quick_stop(self) -> None:
        """Ramp down with 0x6085 in every mode, and stay there with power."""
        self.brake(QUICK_RAMP)

    # ------------------------------------------------------------------------------------------ commands

    def command(self, controlword: int) -> int:
        """Obey the mode's bits of a controlword; returns the device error that it causes, or 0."""
        changed = controlword ^ self._controlword
        error = super().command(controlword)
        if changed & HALT and self.commanded and self.mode in self.set_points:
            self.set_direct(self.mode)
        return error

    def _set_velocity(self) -> None:
        axis = self.axis
        axis.acceleration, axis.deceleration = self._acceleration(0x6083), self._acceleration(SLOW_RAMP)
        top = min(self._dictionary.number(0x607F) * self.rpm, self._top)
        target = 0.0 if self._controlword & HALT else self._dictionary.number(0x60FF) * self.rpm
        self._speed_limited = abs(target) > top
        axis.regulate(Regulation.VELOCITY, max(-top, min(top, target)))

    def _acceleration(self, index: int) -> float:
        """Of a profile [rpm/s]."""
        return self._ramp(index)

    def _ramp(self, index: int) -> float:
        """Of a stop [rpm/s]."""
        return self._dictionary.number(index) * self.rpm_s

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
            axis.deceleration = self._ramp(SLOW_RAMP)
            axis.regulate(Regulation.VELOCITY, 0.0)
            return
        target, offset = self.set_points[mode]
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
            axis.regulate(Regulation.CURRENT, self._current_of(wanted))

    def _current_of(self, torque: int) -> float:
        """The current [mA] of a torque [thousandths of the rated one], which belongs to the rated current."""
        return torque * self.axis.continuous_current / 1000.0

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


class Cia402Motion(CyclicMotion):
    """Modes of operation of a drive that the robot file describes; its maker's tool has told it its motor and gains."""

    def __init__(self, dictionary: Dictionary, axis: Axis, drive: Drive, words: Cia402) -> None:
        """Stand still. Position limits clip the set-point, as the profile has them."""
        self._motor = drive.motor
        self._interpolates = words.interpolation_period
        super().__init__(dictionary, axis, clip_position=True, gains=(), nominal_gains=())
        self.rpm, self.rpm_s = 1.0 / words.velocity_units_per_rpm, 1.0 / words.acceleration_units_per_rpm_s

    def describe(self) -> None:
        """Tie the objects of motion to this object."""
        super().describe()
        if self._interpolates:
            for sub in (1, 2):
                self._dictionary.written[key_of(0x60C2, sub)] = lambda _: self.configure()

    def read_limits(self) -> None:
        """Take over motor data and the interpolation period."""
        number, axis, motor = self._dictionary.number, self.axis, self._motor
        axis.continuous_current = float(motor.continuous_current_ma)
        axis.output_current = float(motor.output_current_ma)
        axis.thermal_time = motor.thermal_time_constant_s
        self._top = axis.current_mode_rpm = float(motor.max_speed_rpm)
        if self._interpolates:
            self._period = number(0x60C2, 1) * 10.0 ** number(0x60C2, 2)

    def _lead_to(self, target: float) -> None:
        super()._lead_to(self._clipped(target - self._zero) + self._zero)

    def home(self) -> None:
        """Nobody can begin it: object 0x6060 takes no homing mode."""
