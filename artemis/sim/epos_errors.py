"""Device errors of a simulated EPOS: table, error register, error history (EPOS firmware specification 2010, 12.2)."""

from __future__ import annotations

from enum import Enum
from functools import partial
from typing import NamedTuple

from artemis.sim.dictionary import AbortCode, AccessRefused, Dictionary, key_of

HISTORY_LENGTH = 5

OVER_VOLTAGE, UNDER_VOLTAGE = 0x3210, 0x3220
CAN_PASSIVE, LIFE_GUARD, PDO_LENGTH = 0x8120, 0x8130, 0x8210
FOLLOWING_ERROR, HALL_NOT_FOUND, POSITION_LIMIT, OVERLOADED = 0x8611, 0xFF04, 0xFF09, 0xFF0B


class Reaction(Enum):
    """What an error does to the motor."""

    NONE = "none"
    QUICK_STOP = "ramp with 0x6085, then power off"
    POWER_OFF = "power off at once"


class EposError(NamedTuple):
    """Bits in the error register 0x1001, and the reaction."""

    register: int
    reaction: Reaction


GENERIC = EposError(0x01, Reaction.POWER_OFF)
"""Also stands for codes that are not in the table."""

ERRORS = {
    0x1000: GENERIC,
    0x2310: EposError(0x02, Reaction.POWER_OFF),
    OVER_VOLTAGE: EposError(0x04, Reaction.POWER_OFF),
    UNDER_VOLTAGE: EposError(0x04, Reaction.POWER_OFF),
    0x4210: EposError(0x08, Reaction.POWER_OFF),
    0x5113: EposError(0x04, Reaction.POWER_OFF),
    0x6100: EposError(0x20, Reaction.POWER_OFF),
    0x6320: EposError(0x20, Reaction.POWER_OFF),
    0x7320: EposError(0x20, Reaction.POWER_OFF),
    0x8110: EposError(0x10, Reaction.QUICK_STOP),
    0x8111: EposError(0x10, Reaction.QUICK_STOP),
    CAN_PASSIVE: EposError(0x10, Reaction.QUICK_STOP),
    LIFE_GUARD: EposError(0x10, Reaction.QUICK_STOP),
    0x8150: EposError(0x10, Reaction.NONE),
    0x81FD: EposError(0x10, Reaction.QUICK_STOP),
    0x81FE: EposError(0x10, Reaction.QUICK_STOP),
    0x81FF: EposError(0x10, Reaction.QUICK_STOP),
    PDO_LENGTH: EposError(0x10, Reaction.QUICK_STOP),
    FOLLOWING_ERROR: EposError(0x20, Reaction.QUICK_STOP),
    0xFF01: EposError(0x80, Reaction.POWER_OFF),
    0xFF02: EposError(0x80, Reaction.POWER_OFF),
    0xFF03: EposError(0x80, Reaction.POWER_OFF),
    HALL_NOT_FOUND: EposError(0x80, Reaction.POWER_OFF),
    0xFF06: EposError(0x80, Reaction.QUICK_STOP),
    0xFF07: EposError(0x80, Reaction.QUICK_STOP),
    0xFF08: EposError(0x80, Reaction.QUICK_STOP),
    POSITION_LIMIT: EposError(0x80, Reaction.QUICK_STOP),
    0xFF0A: EposError(0x80, Reaction.POWER_OFF),
    OVERLOADED: EposError(0x20, Reaction.POWER_OFF),
}


class ErrorMemory:
    """Which errors are active, and the last five that came."""

    def __init__(self, dictionary: Dictionary) -> None:
        self.active: set[int] = set()
        self.register = 0
        """Object 0x1001."""
        self.history: list[int] = []
        """Newest first."""
        self._bus_was_reset = False
        getters = dictionary.getters
        getters[key_of(0x1001, 0)] = lambda: self.register
        getters[key_of(0x1003, 0)] = lambda: len(self.history)
        for place in range(HISTORY_LENGTH):
            getters[key_of(0x1003, place + 1)] = partial(self._entry, place)
        dictionary.checks[key_of(0x1003, 0)] = _judge_cleared
        dictionary.written[key_of(0x1003, 0)] = lambda _: self.history.clear()

    def reset(self) -> None:
        """Power-up or node reset: nothing ever happened."""
        self.clear()
        self.history.clear()

    def add(self, code: int) -> bool:
        """Note an error; False when it is active already and so is no new event."""
        if code in self.active:
            return False
        self.active.add(code)
        self.register |= ERRORS.get(code, GENERIC).register
        self.history = [code, *self.history][:HISTORY_LENGTH]
        if code == CAN_PASSIVE:
            self._bus_was_reset = False
        return True

    def note_bus_reset(self) -> None:
        """NMT Reset Communication: what 0x8120 waits for before a fault reset is taken."""
        self._bus_was_reset = True

    def may_clear(self) -> bool:
        """A fault reset is enough: no 0x8120 before NMT Reset Communication, no 0xFF04 before Reset Node."""
        return HALL_NOT_FOUND not in self.active and (CAN_PASSIVE not in self.active or self._bus_was_reset)

    def clear(self) -> None:
        """Fault reset: nothing is active any more; the history stays."""
        self.active.clear()
        self.register = 0

    def _entry(self, place: int) -> int:
        return self.history[place] if place < len(self.history) else 0


def _judge_cleared(number: int) -> None:
    """Object 0x1003:0 takes no number but 0."""
    if number:
        raise AccessRefused(AbortCode.RANGE)
