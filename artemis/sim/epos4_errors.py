"""Device errors of a simulated EPOS4.

Sources: public tables that quote the EPOS4 firmware specification of 2021 and later; they agree but for 0xFF01. What
loses the reference to the home position is theirs, too.
"""

from __future__ import annotations

from collections.abc import Iterable

from artemis.sim.dictionary import Dictionary, key_of
from artemis.sim.epos_errors import (
    CAN_PASSIVE,
    FOLLOWING_ERROR,
    LIFE_GUARD,
    OVER_VOLTAGE,
    PDO_LENGTH,
    UNDER_VOLTAGE,
    EposError,
    ErrorMemory,
    Reaction,
)

HOT, SSI_FRAME = 0x4210, 0x738D
MISSED_SET_POINT, POSITION_LIMIT_4, STO_OPEN = 0x8250, 0x8A82, 0x8A88
NEGATIVE_SWITCH, POSITIVE_SWITCH, OVERLOADED_4 = 0x8A80, 0x8A81, 0xFF01
_OFF, _FAULT, _ABORT = Reaction.POWER_OFF, Reaction.FAULT_OPTION, Reaction.ABORT_OPTION


def _all(codes: Iterable[int], register: int, reaction: Reaction) -> dict[int, EposError]:
    return dict.fromkeys(codes, EposError(register, reaction))


ERRORS_4: dict[int, EposError] = {
    **_all((0x1000, *range(0x1080, 0x1089), 0x1090), 0x01, _OFF),
    **_all((0x2310, 0x2320), 0x02, _OFF),
    **_all((OVER_VOLTAGE, UNDER_VOLTAGE, 0x5113), 0x04, _OFF),
    **_all((HOT, 0x4380), 0x08, _OFF),
    **_all((0x5280, 0x5281, 0x5282, *range(0x5480, 0x5484), 0x6080), 0x01, _OFF),
    0x6081: EposError(0x01, _ABORT),
    **_all((*range(0x6180, 0x61F1, 0x10), 0x6380), 0x01, _OFF),
    0x6320: EposError(0x01, _FAULT),
    **_all((0x7320, *range(0x7380, 0x7383), *range(0x7388, 0x738B), 0x738C, SSI_FRAME), 0x20, _OFF),
    **_all((0x7390, 0x7391, 0x7392), 0x20, _OFF),
    **_all((0x8110, 0x8111, CAN_PASSIVE, LIFE_GUARD, 0x8150, 0x81FD, 0x81FE, 0x81FF), 0x10, _ABORT),
    **_all((PDO_LENGTH, MISSED_SET_POINT), 0x10, _ABORT),
    **_all((FOLLOWING_ERROR, NEGATIVE_SWITCH, POSITIVE_SWITCH, POSITION_LIMIT_4), 0x80, _FAULT),
    **_all((STO_OPEN, 0x8A8A, 0x8A8B, 0xFF02, 0xFF0B), 0x01, _OFF),
    OVERLOADED_4: EposError(0x00, Reaction.WARNING),
    0xFF10: EposError(0x20, _FAULT),
    **_all((*range(0xFF11, 0xFF19), *range(0xFF19, 0xFF25)), 0x20, _OFF),
}
OVERLOAD_IS_ERROR = EposError(0x01, _OFF)
"""What 0xFF01 is to firmware that knows no warning."""
UNREFERENCED = frozenset({0x7380, 0x7381, 0x7382, 0x7388, 0x7389, 0x738A, 0x7392, 0xFF02})
"""Errors that lose the reference to the home position."""


class Epos4Errors(ErrorMemory):
    """Error memory of an EPOS4: with warnings, and the last error in object 0x603F.

    A fault reset waits for NMT Reset Communication after 0x8120 and 0x8130.
    """

    def __init__(self, dictionary: Dictionary, *, overload_warns: bool) -> None:
        table = ERRORS_4 if overload_warns else {**ERRORS_4, OVERLOADED_4: OVERLOAD_IS_ERROR}
        super().__init__(dictionary, table, until_bus_reset=(CAN_PASSIVE, LIFE_GUARD), until_node_reset=())
        self.last = 0
        dictionary.getters[key_of(0x603F, 0)] = lambda: self.last

    @property
    def warns(self) -> bool:
        """A warning is active."""
        return any(self.reaction(code) is Reaction.WARNING for code in self.active)

    def add(self, code: int) -> bool:
        """Note an error; False when it is active already and so is no new event."""
        new = super().add(code)
        if new:
            self.last = code
        return new

    def clear(self) -> None:
        """Fault reset: nothing is active any more; the history stays."""
        super().clear()
        self.last = 0

    def forget(self) -> None:
        """The history is cleared, and warnings are taken back."""
        super().forget()
        self.active = {code for code in self.active if self.reaction(code) is not Reaction.WARNING}
