"""What to command a drive: (state, goal) -> controlword. Pure tables.

Source: EPOS firmware specification, April 2010, 8.1.2 (transitions), 14.59 (controlword); CiA 402, 6.2, has the same
commands, and fewer states. How a statusword tells the state is a matter of the drive's family.
"""

from __future__ import annotations

from enum import IntEnum

from artemis.drive_states import DriveState, Goal


class Controlword(IntEnum):
    """Controlwords (low byte), as the application notes of the maker use them."""

    DISABLE_VOLTAGE = 0x00
    SHUTDOWN = 0x06
    QUICK_STOP = 0x0B
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


_OFF, _READY, _STOP, _ON, _RESET = (
    Controlword.DISABLE_VOLTAGE,
    Controlword.SHUTDOWN,
    Controlword.QUICK_STOP,
    Controlword.ENABLE_OPERATION,
    Controlword.FAULT_RESET,
)
_S, _D, _E, _H, _Q, _R = DriveState, Goal.DISABLED, Goal.ENABLED, Goal.HOLD, Goal.QUICK_STOPPED, Goal.FAULT_RESET

COMMANDS: dict[DriveState, dict[Goal, Controlword]] = {
    _S.START: {_D: _OFF, _E: _OFF, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.NOT_READY: {_D: _OFF, _E: _OFF, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.SWITCH_ON_DISABLED: {_D: _OFF, _E: _READY, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.READY: {_D: _OFF, _E: _ON, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.SWITCHED_ON: {_D: _OFF, _E: _ON, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.REFRESH: {_D: _OFF, _E: _ON, _H: _ON, _Q: _STOP, _R: _OFF},
    _S.MEASURE_INIT: {_D: _OFF, _E: _ON, _H: _ON, _Q: _STOP, _R: _OFF},
    _S.OPERATION_ENABLE: {_D: _OFF, _E: _ON, _H: _ON, _Q: _STOP, _R: _OFF},
    _S.QUICK_STOP_ACTIVE: {_D: _OFF, _E: _ON, _H: _STOP, _Q: _STOP, _R: _OFF},
    _S.FAULT_REACTION_DISABLED: {_D: _OFF, _E: _OFF, _H: _OFF, _Q: _OFF, _R: _OFF},
    _S.FAULT_REACTION_ENABLED: {_D: _OFF, _E: _STOP, _H: _STOP, _Q: _STOP, _R: _STOP},  # let the drive finish its ramp
    _S.FAULT: {_D: _OFF, _E: _OFF, _H: _OFF, _Q: _OFF, _R: _RESET},
    _S.UNKNOWN: {_D: _OFF, _E: _STOP, _H: _STOP, _Q: _STOP, _R: _OFF},
}
"""What to command in each state to come nearer to each goal. A fault is reset only where that is the goal."""


def controlword(state: DriveState, goal: Goal, last: int = 0) -> int:
    """The controlword (0x6040) that leads from `state` towards `goal`.

    A fault reset is a rising edge of bit 7: after `last` had it set, it is lowered first, so that repeated calls
    repeat the edge.
    """
    command = COMMANDS[state][goal]
    return _OFF if command is _RESET and last & _RESET else command
