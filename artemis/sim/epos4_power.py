"""The device state machine of a simulated EPOS4: CiA 402's, with a wait for standstill and inputs that allow torque.

Sources: EPOS4 communication guide 2019; public tables that quote its firmware specification.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from artemis.drive_states import DriveState
from artemis.sim.cia402_motion import QUICK_RAMP
from artemis.sim.cia402_power import ABORT_CONNECTION, CUT, ProfilePower
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos4_motion import Epos4Motion
from artemis.sim.epos_errors import ErrorMemory

_ABORT = {2: CUT, 3: QUICK_RAMP}
"""What the values of 0x6007 brake with: both end in a fault."""
HOLDING_BRAKE = 24
"""Function of a digital output, object 0x3151."""


class Epos4Power(ProfilePower):
    """Device state of one EPOS4."""

    def __init__(
        self,
        motion: Epos4Motion,
        errors: ErrorMemory,
        dictionary: Dictionary,
        *,
        measure: float,
        cause_remains: Callable[[], bool],
        may_power: Callable[[], bool],
    ) -> None:
        """`measure`: time of transition 3 [s]; `may_power`: whether the inputs allow to leave Switch On Disabled."""
        super().__init__(motion, errors, dictionary, measure=measure, cause_remains=cause_remains)
        self._may_power = may_power
        self._ramp_end: float | None = None
        self._standing_since: float | None = None
        dictionary.getters[key_of(0x3158, 3)] = lambda: int(self.brake_closed)

    def finish_ramp(self, now: float) -> None:
        """The ramp has ended, and the motor stands or was waited for long enough (0x30E0): what it led to follows."""
        if not self.ramping or self.due < math.inf:
            return
        axis, number = self._motion.axis, self._number
        if axis.demand_velocity != 0.0:
            return
        if self._ramp_end is None:
            self._ramp_end = now
        if abs(axis.velocity) > number(0x30E0, 1) * self._drive_function.rpm:
            self._standing_since = None
        elif self._standing_since is None:
            self._standing_since = now
        waited = now - self._ramp_end >= number(0x30E0, 3) * 1e-3
        stands = self._standing_since is not None and now - self._standing_since >= number(0x30E0, 2) * 1e-3
        if waited or stands:
            self.brake_closed = True
            self.due = now + (number(0x3158, 1) * 1e-3 if self._has_brake() else 0.0)

    def disallow(self) -> None:
        """The inputs do not allow torque any longer: without torque the way to operation begins anew."""
        if self.state in (DriveState.READY, DriveState.SWITCHED_ON):
            self._enter(DriveState.SWITCH_ON_DISABLED)

    def _ramp_without_connection(self) -> int | None:
        return _ABORT[self._number(ABORT_CONNECTION)]

    def _follow(self, following: DriveState, now: float) -> None:
        if self.state is not DriveState.SWITCH_ON_DISABLED or self._may_power():
            super()._follow(following, now)

    def _begin_ramp(self, following: DriveState) -> None:
        super()._begin_ramp(following)
        self._ramp_end = self._standing_since = None

    def _enter(self, state: DriveState, due: float = math.inf) -> None:
        super()._enter(state, due)
        self._ramp_end = self._standing_since = None

    def _has_brake(self) -> bool:
        return any(self._number(0x3151, sub) == HOLDING_BRAKE for sub in (1, 2, 3))
