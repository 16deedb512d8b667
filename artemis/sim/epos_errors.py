"""Device errors of a simulated EPOS: error register, error history; the first generation's table.

Source: EPOS firmware specification 2010, 12.2. Other tables are in `epos4_errors.py` and `cia402.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
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
    FAULT_OPTION = "as object 0x605E says"  # CiA 402
    ABORT_OPTION = "as object 0x6007 says"  # CiA 402
    WARNING = "none; see bit 7 of the statusword"  # EPOS4


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

    def __init__(
        self,
        dictionary: Dictionary,
        table: Mapping[int, EposError] = ERRORS,
        *,
        until_bus_reset: Collection[int] = (CAN_PASSIVE,),
        until_node_reset: Collection[int] = (HALL_NOT_FOUND,),
    ) -> None:
        """`table`: by code; `until_bus_reset`, `until_node_reset`: codes for which a fault reset waits for these."""
        self.active: set[int] = set()
        self.register = 0
        """Object 0x1001."""
        self.history: list[int] = []
        """Newest first."""
        self._table = table
        self._until_bus_reset = frozenset(until_bus_reset)
        self._until_node_reset = frozenset(until_node_reset)
        self._bus_was_reset = False
        getters = dictionary.getters
        getters[key_of(0x1001, 0)] = lambda: self.register
        getters[key_of(0x1003, 0)] = lambda: len(self.history)
        for place in range(HISTORY_LENGTH):
            getters[key_of(0x1003, place + 1)] = partial(self._entry, place)
        dictionary.checks[key_of(0x1003, 0)] = _judge_cleared
        dictionary.written[key_of(0x1003, 0)] = lambda _: self.forget()

    def reset(self) -> None:
        """Power-up or node reset: nothing ever happened."""
        self.clear()
        self.history.clear()

    def add(self, code: int) -> bool:
        """Note an error; False when it is active already and so is no new event."""
        if code in self.active:
            return False
        self.active.add(code)
        self.register |= self._table.get(code, GENERIC).register
        self.history = [code, *self.history][:HISTORY_LENGTH]
        if code in self._until_bus_reset:
            self._bus_was_reset = False
        return True

    def end(self, code: int) -> None:
        """An error is over without a fault reset."""
        self.active.discard(code)
        self.register = 0
        for left in self.active:
            self.register |= self._table.get(left, GENERIC).register

    def note_bus_reset(self) -> None:
        """NMT Reset Communication: what some errors wait for before a fault reset is taken."""
        self._bus_was_reset = True

    def may_clear(self) -> bool:
        """A fault reset is enough: no error waits for NMT Reset Communication or Reset Node."""
        if not self.active.isdisjoint(self._until_node_reset):
            return False
        return self._bus_was_reset or self.active.isdisjoint(self._until_bus_reset)

    def reaction(self, code: int) -> Reaction:
        """What an error does to the motor."""
        return self._table.get(code, GENERIC).reaction

    def forget(self) -> None:
        """The history is cleared."""
        self.history.clear()

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
