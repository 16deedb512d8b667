"""The device state machine of a simulated EPOS4: CiA 402's, with option codes and a wait for standstill.

Sources: EPOS4 communication guide 2019; public tables that quote its firmware specification. Inferred: what shows while
a ramp leads out of Operation Enabled (still that state), and that only ramps wait for standstill.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from artemis.drive_states import DriveState
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos4_motion import Epos4Motion
from artemis.sim.epos_errors import ErrorMemory, Reaction
from artemis.sim.epos_power import CYCLE, PATTERNS, TRANSITIONS, DeviceCommand, PowerStage, command_of

PATTERNS_4 = {state: pattern & ~0x4100 for state, pattern in PATTERNS.items()}
"""Statusword bits 6 to 0 in each state: those of the first generation without its bits 8 and 14."""
TRANSITIONS_4 = {
    key: DriveState.OPERATION_ENABLE if following is DriveState.REFRESH else following
    for key, following in TRANSITIONS.items()
}
"""Current offsets are measured within transition 3: Refresh and Measure Init do not exist."""

SLOW_RAMP, QUICK_RAMP = 0x6084, 0x6085
"""Indices of the decelerations."""
CUT: None = None
_SHUTDOWN = {0: CUT, 1: SLOW_RAMP}
_DISABLE = {0: CUT, 1: SLOW_RAMP}
_FAULT = {0: CUT, 1: SLOW_RAMP, 2: QUICK_RAMP}
_ABORT = {2: CUT, 3: QUICK_RAMP}
"""What the values of 0x605B, 0x605C, 0x605E and 0x6007 brake with."""
HOLDING_BRAKE = 24
"""Function of a digital output, object 0x3151."""
_ENABLED = DriveState.OPERATION_ENABLE


class Epos4Power(PowerStage):
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
        super().__init__(
            motion,
            errors,
            refresh=0.0,
            measure=measure,
            cause_remains=cause_remains,
            patterns=PATTERNS_4,
            transitions=TRANSITIONS_4,
        )
        self._drive_function = motion
        self._number = dictionary.number
        self._may_power = may_power
        self._target: DriveState | None = None
        """Where a ramp, or the measurement of offsets, leads to."""
        self._ramp_end: float | None = None
        self._standing_since: float | None = None
        self.brake_closed = True
        """State of a holding brake; it clamps where an output is set to it."""
        dictionary.getters[key_of(0x3158, 3)] = lambda: int(self.brake_closed)

    def command(self, controlword: int, now: float) -> tuple[int, bool]:
        """Obey a controlword; while a ramp leads out of operation only a harder stop acts at once."""
        if self.ramping and self.state is _ENABLED:
            if command_of(controlword) not in (DeviceCommand.DISABLE_VOLTAGE, DeviceCommand.QUICK_STOP):
                self._waiting = controlword
                return 0, False
            self._waiting, self._target = None, None
            if self.due < math.inf:
                self.due = math.inf
        return super().command(controlword, now)

    def fail(self, code: int, now: float) -> None:
        """React to a device error: classes "power off", by 0x605E, by 0x6007, warning."""
        reaction = self._errors.reaction(code)
        if reaction in (Reaction.NONE, Reaction.WARNING):
            return
        if self.state in (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED):
            return
        ramp = CUT
        if reaction is Reaction.FAULT_OPTION:
            ramp = _FAULT[self._number(0x605E)]
        elif reaction is Reaction.ABORT_OPTION:
            ramp = _ABORT[self._number(0x6007)]
        if ramp is not CUT:
            if self.state is DriveState.FAULT_REACTION_ENABLED:
                return
            if self.state in (_ENABLED, DriveState.QUICK_STOP_ACTIVE):
                self._enter(DriveState.FAULT_REACTION_ENABLED)
                self._drive_function.brake(ramp)
                self._target = DriveState.FAULT
                return
        self._enter(DriveState.FAULT_REACTION_DISABLED)
        self.due = now + CYCLE

    def advance(self, now: float) -> tuple[int, bool]:
        """Do the automatic transitions that are due; returns like `command` for a controlword that had to wait."""
        if self.due <= now:
            following, self._target = self._target, None
            if following is not None:
                self._enter(following)
            elif self.state is DriveState.FAULT_REACTION_DISABLED:
                self._enter(DriveState.FAULT)
            else:
                self.due = math.inf
        if self._waiting is None or self.due < math.inf or self.ramping:
            return 0, False
        waiting, self._waiting = self._waiting, None
        return self.command(waiting, now)

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

    def _follow(self, following: DriveState, now: float) -> None:
        """Leave Operation Enabled as the option codes say; measure offsets on the way to it."""
        if self.state is DriveState.SWITCH_ON_DISABLED and not self._may_power():
            return
        if self.state is DriveState.READY and following in (DriveState.SWITCHED_ON, _ENABLED):
            self._enter(DriveState.SWITCHED_ON)
            self._target, self.due = following, now + self._measure
            return
        ramp = CUT
        if self.state is _ENABLED and following is DriveState.READY:
            ramp = _SHUTDOWN[self._number(0x605B)]
        elif self.state is _ENABLED and following is DriveState.SWITCHED_ON:
            ramp = _DISABLE[self._number(0x605C)]
        if ramp is CUT:
            self._enter(following)
        else:
            self._drive_function.brake(ramp)
            self._target, self.ramping, self._idle = following, True, None
            self._ramp_end = self._standing_since = None

    def _enter(self, state: DriveState, due: float = math.inf) -> None:
        super()._enter(state, due)
        self._target = self._ramp_end = self._standing_since = None
        self.brake_closed = state not in (
            _ENABLED,
            DriveState.QUICK_STOP_ACTIVE,
            DriveState.FAULT_REACTION_ENABLED,
        )
        self._motion.axis.fail(clamped=self.brake_closed and self._has_brake())

    def _has_brake(self) -> bool:
        return any(self._number(0x3151, sub) == HOLDING_BRAKE for sub in (1, 2, 3))
