"""The device state machine of the profile CiA 402, with its option codes.

Source: CiA 402 (states, transitions, objects 0x6007, 0x605A, 0x605B, 0x605C, 0x605E). Inferred: what shows while a ramp
leads out of Operation Enabled (still that state), and that only ramps wait for standstill.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from artemis.drive_states import POWERED, DriveState
from artemis.sim.axis import STILL_RPM
from artemis.sim.cia402_motion import HARDEST_RAMP, QUICK_RAMP, SLOW_RAMP, CyclicMotion
from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_errors import ErrorMemory, Reaction
from artemis.sim.epos_power import CYCLE, PATTERNS, TRANSITIONS, DeviceCommand, PowerStage, command_of

PATTERNS_402 = {state: pattern & ~0x4100 for state, pattern in PATTERNS.items()}
"""Statusword bits 6 to 0 in each state: those of the first generation of the EPOS without its bits 8 and 14."""
TRANSITIONS_402 = {
    key: DriveState.OPERATION_ENABLE if following is DriveState.REFRESH else following
    for key, following in TRANSITIONS.items()
}
"""Refresh and Measure Init do not exist."""

ABORT_CONNECTION, QUICK_STOP, SHUTDOWN, DISABLE_OPERATION, FAULT_REACTION = 0x6007, 0x605A, 0x605B, 0x605C, 0x605E
CUT: None = None
_SHUTDOWN = {0: CUT, 1: SLOW_RAMP}
_FAULT = {0: CUT, 1: SLOW_RAMP, 2: QUICK_RAMP, 3: HARDEST_RAMP, 4: HARDEST_RAMP}
"""What the values of 0x605B and 0x605C, and of 0x605E, brake with."""
_QUICK_STOP = {
    code + stays: (ramp, bool(stays))
    for stays in (0, 4)
    for code, ramp in ((1, SLOW_RAMP), (2, QUICK_RAMP), (3, HARDEST_RAMP), (4, HARDEST_RAMP))
}
"""What those of 0x605A brake with, and whether Quick Stop Active lasts beyond standstill; 0 cuts the power."""
FAULT_SIGNAL = 1
_COMMANDS = {2: 0x0000, 3: 0x0002}
"""Of 0x6007: 0 is no action, others give a command: disable voltage, quick stop."""
DEFAULTS = {ABORT_CONNECTION: FAULT_SIGNAL, QUICK_STOP: 2, SHUTDOWN: 0, DISABLE_OPERATION: 1, FAULT_REACTION: 2}
"""What a drive does that does not have the object."""
QUICK_STOP_CODES, FAULT_CODES = frozenset({0, *_QUICK_STOP}), frozenset(_FAULT)
ABORT_CODES = frozenset({0, FAULT_SIGNAL, *_COMMANDS})
_ENABLED = DriveState.OPERATION_ENABLE
_BRAKED = (_ENABLED, DriveState.QUICK_STOP_ACTIVE)


class ProfilePower(PowerStage):
    """Device state of one drive of the profile."""

    def __init__(
        self,
        motion: CyclicMotion,
        errors: ErrorMemory,
        dictionary: Dictionary,
        *,
        measure: float,
        cause_remains: Callable[[], bool],
    ) -> None:
        """`measure`: time of transition 3 [s], in which the offsets of the currents are measured."""
        super().__init__(
            motion,
            errors,
            refresh=0.0,
            measure=measure,
            cause_remains=cause_remains,
            patterns=PATTERNS_402,
            transitions=TRANSITIONS_402,
        )
        self._drive_function = motion
        self._number = dictionary.number
        self._has = dictionary.entries.__contains__
        self._target: DriveState | None = None
        """Where a ramp, or transition 3, leads to."""
        self.brake_closed = True
        """State of a holding brake, where there is one."""

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
            ramp = _FAULT[self._option(FAULT_REACTION)]
        elif reaction is Reaction.ABORT_OPTION:
            ramp = self._ramp_without_connection()
        if ramp is not CUT:
            if self.state is DriveState.FAULT_REACTION_ENABLED:
                return
            if self.state in _BRAKED:
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
        """The ramp has ended, and the motor stands: what it led to follows."""
        if self.ramping and self.due == math.inf:
            axis = self._motion.axis
            if axis.demand_velocity == 0.0 and abs(axis.velocity) < STILL_RPM:
                self.due = now

    def _option(self, index: int) -> int:
        return self._number(index) if self._has(key_of(index, 0)) else DEFAULTS[index]

    def _ramp_without_connection(self) -> int | None:
        """What it brakes with where a lost connection is a fault."""
        return _FAULT[self._option(FAULT_REACTION)]

    def _follow(self, following: DriveState, now: float) -> None:
        """Leave Operation Enabled as the option codes say."""
        if self.state is DriveState.QUICK_STOP_ACTIVE and following is _ENABLED and self._target is not None:
            return  # what leaves Quick Stop Active by itself does not go back
        if self.state is DriveState.READY and following in (DriveState.SWITCHED_ON, _ENABLED):
            self._enter(DriveState.SWITCHED_ON)
            self._target, self.due = following, now + self._measure
            return
        ramp = CUT
        if self.state is _ENABLED and following is DriveState.READY:
            ramp = _SHUTDOWN[self._option(SHUTDOWN)]
        elif self.state is _ENABLED and following is DriveState.SWITCHED_ON:
            ramp = _SHUTDOWN[self._option(DISABLE_OPERATION)]
        if ramp is CUT:
            self._enter(following)
        else:
            self._drive_function.brake(ramp)
            self._begin_ramp(following)

    def _begin_ramp(self, following: DriveState) -> None:
        """The motor is braked, and then this state follows."""
        self._target, self.ramping, self._idle = following, True, None

    def _enter(self, state: DriveState, due: float = math.inf) -> None:
        super()._enter(state, due)
        self._target = None
        self.brake_closed = state not in POWERED
        self._motion.axis.fail(clamped=self.brake_closed and self._has_brake())

    def _has_brake(self) -> bool:
        return False


class Cia402Power(ProfilePower):
    """Device state of a drive that the robot file describes."""

    def __init__(
        self,
        motion: CyclicMotion,
        errors: ErrorMemory,
        dictionary: Dictionary,
        *,
        measure: float,
        cause_remains: Callable[[], bool],
        brake: bool,
    ) -> None:
        """`brake`: one closes where the power is cut."""
        self._brake = brake
        super().__init__(motion, errors, dictionary, measure=measure, cause_remains=cause_remains)

    def fail(self, code: int, now: float) -> None:
        """React to a device error; a lost connection may be a command instead of a fault, or nothing."""
        option = self._option(ABORT_CONNECTION)
        if self._errors.reaction(code) is not Reaction.ABORT_OPTION or option == FAULT_SIGNAL:
            super().fail(code, now)
            return
        self._errors.end(code)
        if option in _COMMANDS:
            self.command(_COMMANDS[option], now)

    def _enter(self, state: DriveState, due: float = math.inf) -> None:
        """Quick Stop Active as 0x605A says."""
        code = self._option(QUICK_STOP)
        if state is not DriveState.QUICK_STOP_ACTIVE:
            super()._enter(state, due)
        elif code not in _QUICK_STOP:
            super()._enter(DriveState.SWITCH_ON_DISABLED, due)
        else:
            super()._enter(state, due)
            ramp, stays = _QUICK_STOP[code]
            self._drive_function.brake(ramp)
            if not stays:
                self._begin_ramp(DriveState.SWITCH_ON_DISABLED)

    def _has_brake(self) -> bool:
        return self._brake
