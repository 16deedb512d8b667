"""The device state machine of a simulated EPOS: that of the first generation, which is not quite CiA 402's.

Source: EPOS firmware specification 2010, 8.1. The profile's is made of it in `cia402_power.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum

from artemis.drive_states import DriveState
from artemis.sim.epos_errors import ErrorMemory, Reaction
from artemis.sim.epos_motion import Motion

CYCLE = 0.001
"""The device works its states off once per millisecond: a disabled fault reaction lasts that long [s]."""
FAULT_RESET = 0x0080

PATTERNS = {
    DriveState.START: 0x0000,
    DriveState.NOT_READY: 0x0100,
    DriveState.SWITCH_ON_DISABLED: 0x0140,
    DriveState.READY: 0x0121,
    DriveState.SWITCHED_ON: 0x0123,
    DriveState.REFRESH: 0x4123,
    DriveState.MEASURE_INIT: 0x4133,
    DriveState.OPERATION_ENABLE: 0x0137,
    DriveState.QUICK_STOP_ACTIVE: 0x0117,
    DriveState.FAULT_REACTION_DISABLED: 0x010F,
    DriveState.FAULT_REACTION_ENABLED: 0x011F,
    DriveState.FAULT: 0x0108,
}
"""The statusword's bits 14, 8 and 6 to 0 in each state (firmware specification, table 1)."""

POWER_OFF = {
    DriveState.START,
    DriveState.NOT_READY,
    DriveState.SWITCH_ON_DISABLED,
    DriveState.READY,
    DriveState.SWITCHED_ON,
    DriveState.FAULT,
}
"""States in which objects that need a disabled power stage may be written."""


class DeviceCommand(Enum):
    """Device control commands (firmware specification, 14.59)."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on, or disable operation"
    ENABLE = "switch on and enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"


TRANSITIONS = {
    (DriveState.SWITCH_ON_DISABLED, DeviceCommand.SHUTDOWN): DriveState.READY,
    (DriveState.READY, DeviceCommand.SWITCH_ON): DriveState.SWITCHED_ON,
    (DriveState.READY, DeviceCommand.ENABLE): DriveState.REFRESH,  # through Switched On
    (DriveState.READY, DeviceCommand.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,
    (DriveState.READY, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,
    (DriveState.SWITCHED_ON, DeviceCommand.ENABLE): DriveState.REFRESH,
    (DriveState.SWITCHED_ON, DeviceCommand.SHUTDOWN): DriveState.READY,
    (DriveState.SWITCHED_ON, DeviceCommand.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,
    (DriveState.SWITCHED_ON, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,
    (DriveState.OPERATION_ENABLE, DeviceCommand.SWITCH_ON): DriveState.SWITCHED_ON,
    (DriveState.OPERATION_ENABLE, DeviceCommand.SHUTDOWN): DriveState.READY,
    (DriveState.OPERATION_ENABLE, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,
    (DriveState.OPERATION_ENABLE, DeviceCommand.QUICK_STOP): DriveState.QUICK_STOP_ACTIVE,
    (DriveState.QUICK_STOP_ACTIVE, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,
    (DriveState.QUICK_STOP_ACTIVE, DeviceCommand.ENABLE): DriveState.OPERATION_ENABLE,
}
"""Transitions 2 to 12 and 16 (firmware specification, 8.1.2); the automatic ones and faults are in `PowerStage`."""


def command_of(controlword: int) -> DeviceCommand | None:
    """Which command a controlword gives; None when its low byte has none of the patterns (bit 7 set)."""
    if controlword & 0x80:
        return None
    if not controlword & 0x02:
        return DeviceCommand.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return DeviceCommand.QUICK_STOP
    if not controlword & 0x01:
        return DeviceCommand.SHUTDOWN
    return DeviceCommand.ENABLE if controlword & 0x08 else DeviceCommand.SWITCH_ON


class PowerStage:
    """Device state of one drive; switches the drive function on and off."""

    def __init__(
        self,
        motion: Motion,
        errors: ErrorMemory,
        *,
        refresh: float,
        measure: float,
        cause_remains: Callable[[], bool],
        patterns: Mapping[DriveState, int] = PATTERNS,
        transitions: Mapping[tuple[DriveState, DeviceCommand], DriveState] = TRANSITIONS,
    ) -> None:
        self.state = DriveState.START
        self.due = math.inf
        """Time at which an automatic transition ends the present state [s]."""
        self._motion = motion
        self._errors = errors
        self._refresh = refresh
        self._measure = measure
        self._cause_remains = cause_remains
        self.ramping = False
        """The motor is braked, and what follows when it stands is still to come."""
        self._patterns = patterns
        self._transitions = transitions
        self._controlword = 0
        self._waiting: int | None = None
        self._refused: frozenset[DriveState] = frozenset()
        self._idle: int | None = None
        """A controlword that asks for no transition in the present state: found once, met in every cycle."""
        self.pattern = patterns[self.state]
        """Statusword bits of the present state."""

    @property
    def power_off(self) -> bool:
        """The power stage is disabled."""
        return self.state in POWER_OFF

    def start(self, state: DriveState) -> None:
        """Power-up (`START`) or node reset (`NOT_READY`)."""
        self._controlword, self._waiting = 0, None
        self._enter(state)

    def initialised(self) -> None:
        """End of the initialisation: transition 1."""
        self._enter(DriveState.SWITCH_ON_DISABLED)

    def command(self, controlword: int, now: float) -> tuple[int, bool]:
        """Obey a controlword.

        Args:
            controlword: Object 0x6040.
            now: Time [s].

        Returns:
            The device error that it causes (0: none), and whether it was a fault reset that was taken.
        """
        if controlword == self._idle:
            self._controlword = controlword
            return self._motion.command(controlword), False
        if self.due < math.inf:  # a command is completed before the next is handled
            self._waiting = controlword
            return 0, False
        rising = controlword & ~self._controlword & FAULT_RESET
        self._controlword = controlword
        if rising and self.state is not DriveState.FAULT_REACTION_ENABLED:
            self._motion.note(controlword)
            return 0, self._reset_fault()
        command = command_of(controlword)
        following = None if command is None else self._transitions.get((self.state, command))
        if following is None or following in self._refused:
            self._idle = controlword
            return self._motion.command(controlword), False
        self._motion.note(controlword)
        self._follow(following, now)
        return 0, False

    def refuse(self, states: frozenset[DriveState]) -> None:
        """Failure: commands, and fault resets, that lead to these states are not obeyed."""
        self._refused, self._idle = states, None

    def force(self, state: DriveState) -> None:
        """Failure: a change of state that nothing asked for."""
        self._enter(state)

    def fail(self, code: int, now: float) -> None:
        """React to a device error."""
        reaction = self._errors.reaction(code)
        if reaction is Reaction.NONE or self.state in (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED):
            return
        if reaction is Reaction.QUICK_STOP:
            if self.state is DriveState.FAULT_REACTION_ENABLED:
                return
            if self.state in (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE):
                self._enter(DriveState.FAULT_REACTION_ENABLED)
                return
        self._enter(DriveState.FAULT_REACTION_DISABLED)
        self.due = now + CYCLE

    def advance(self, now: float) -> tuple[int, bool]:
        """Do the automatic transitions that are due; returns like `command` for a controlword that had to wait."""
        while self.due <= now:
            if self.state is DriveState.REFRESH:
                self._enter(DriveState.MEASURE_INIT, self.due + self._measure)
            elif self.state is DriveState.MEASURE_INIT:
                self._enter(DriveState.OPERATION_ENABLE)
            else:
                self._enter(DriveState.FAULT)
        if self._waiting is None or self.due < math.inf:
            return 0, False
        waiting, self._waiting = self._waiting, None
        return self.command(waiting, now)

    def finish_ramp(self, now: float) -> None:
        """Transition 18, when the ramp of the enabled fault reaction has ended."""
        if self.ramping and self._motion.axis.demand_velocity == 0.0:
            self._enter(DriveState.FAULT)

    def _follow(self, following: DriveState, now: float) -> None:
        """A command leads to this state."""
        self._enter(following)
        if following is DriveState.REFRESH:
            self.due = now + self._refresh

    def _reset_fault(self) -> bool:
        """Transition 15; an error without reaction (0x8150) is reset in every state, and changes none."""
        if not self._errors.active or self._cause_remains() or not self._errors.may_clear():
            return False
        if self.state is DriveState.FAULT and DriveState.SWITCH_ON_DISABLED in self._refused:
            return False
        self._errors.clear()
        self._motion.forgive()
        if self.state is DriveState.FAULT:
            self._enter(DriveState.SWITCH_ON_DISABLED)
        return True

    def _enter(self, state: DriveState, due: float = math.inf) -> None:
        self.state, self.due = state, due
        self.pattern, self._idle = self._patterns[state], None
        self.ramping = state is DriveState.FAULT_REACTION_ENABLED
        if state is DriveState.OPERATION_ENABLE:
            self._motion.engage()
        elif state is DriveState.QUICK_STOP_ACTIVE:
            self._motion.quick_stop()
        elif state is DriveState.FAULT_REACTION_ENABLED:
            self._motion.fault_stop()
        else:
            self._motion.release()
