"""States of a drive: its device, what is wanted of it, and its node on the bus."""

from __future__ import annotations

from enum import Enum


class DriveState(Enum):
    """Device states of a first-generation EPOS (firmware specification 2010, 8.1.1)."""

    START = "start"
    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    REFRESH = "refresh"
    MEASURE_INIT = "measure init"
    OPERATION_ENABLE = "operation enable"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_DISABLED = "fault reaction active (disabled)"
    FAULT_REACTION_ENABLED = "fault reaction active (enabled)"
    FAULT = "fault"
    UNKNOWN = "unknown"

    __hash__ = object.__hash__  # the one of Enum is a function in Python, and every tick looks up by states and goals


POWERED = (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ENABLED)
"""The power stage is on: the motor may turn, and brakes."""


class Goal(Enum):
    """What is wanted of a drive, from whatever state it is in."""

    DISABLED = "disabled"
    ENABLED = "enabled"
    HOLD = "hold"  # stay enabled if enabled, off if off: for steering while the robot comes to rest
    QUICK_STOPPED = "quick-stopped"
    FAULT_RESET = "fault reset"

    __hash__ = object.__hash__


class Nmt(Enum):
    """NMT states of a node, with the codes of its heartbeat (CiA 301)."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F
