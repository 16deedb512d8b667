"""A simulated EPOS2: the node of `epos` with the objects in which that generation differs.

Sources: those of `families/epos2`. Of the option codes only the values are taken that the first generation's reactions
are: a fault ramps down, shutdown and disable operation cut the power. How it reacts to the errors that the first
generation does not have is an assumption.
"""

from __future__ import annotations

from functools import cache

from artemis.drive_schema import Drive
from artemis.sim.dictionary import Dictionary, ObjectEntry, key_of, row
from artemis.sim.epos import SimEpos
from artemis.sim.epos_errors import ERRORS, EposError, Reaction
from artemis.sim.epos_objects import I16, U16, U32, objects

AUTOMATIC = 9
"""Code of object 0x2001: the bit rate that is heard."""
OWN = (
    row(0x2001, 0, U16, "rw", 0, choices=frozenset({*range(7), AUTOMATIC})),
    row(0x2210, 1, U32, "rw cfg dis", 500, 16, 2_500_000),
    row(0x605B, 0, I16, "rw cfg", 0, 0, 0),
    row(0x605C, 0, I16, "rw cfg", 0, 0, 0),
    row(0x605E, 0, I16, "rw cfg", 2, 2, 2),
)


@cache
def objects2(node_id: int, hardware_version: int, firmware: int, serial_number: int) -> tuple[ObjectEntry, ...]:
    """All objects of one drive as it leaves the factory; arguments as of `objects`."""
    own = {key_of(entry.index, entry.sub): entry for entry in OWN}
    first = objects(node_id, hardware_version, firmware, serial_number)
    return (*(entry for entry in first if key_of(entry.index, entry.sub) not in own), *OWN)


ERRORS_2: dict[int, EposError] = {
    **ERRORS,
    0x5114: EposError(0x04, Reaction.POWER_OFF),
    0xFF0C: EposError(0x20, Reaction.QUICK_STOP),
    **dict.fromkeys((0xFF0D, 0xFF0F, 0xFF10, 0xFF11, 0xFF12), EposError(0x20, Reaction.POWER_OFF)),
}


class SimEpos2(SimEpos):
    """One simulated EPOS2."""

    known_errors = ERRORS_2

    def _make_dictionary(self, drive: Drive) -> Dictionary:
        serial = self.node_id if drive.serial_number is None else drive.serial_number
        entries = objects2(self.node_id, drive.hardware_version, self.settings.firmware, serial)
        return Dictionary(entries, power_off=lambda: self._power.power_off)
