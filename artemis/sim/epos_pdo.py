"""Process data of a simulated EPOS: four PDOs each way; of another drive as many as it has objects for.

Sources: CiA 301 7.2.2; EPOS firmware specification 2010, 14.12 to 14.31.
Mappings are turned into packers when they change, so that a frame costs no search.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Collection
from itertools import count

from artemis.devices.can_bus import Frame
from artemis.motion.totals import total
from artemis.sim.dictionary import FORMATS, SIZES, AbortCode, AccessRefused, Dictionary, key_of
from artemis.sim.epos_objects import INVALID, TPDO_COB_IDS

NO_RTR = 1 << 30
LOWEST_ID, HIGHEST_ID = 0x181, 0x57F
SYNCHRONOUS, ON_REQUEST, ON_CHANGE = 1, 253, 255
INHIBIT_UNIT = 1e-4
"""Object 0x1800:3 counts in this [s]."""
LONGEST_BITS = 64
CONTROLWORD = key_of(0x6040, 0)


class ReceivePdo:
    """A PDO that the drive receives."""

    def __init__(self, dictionary: Dictionary, number: int) -> None:
        cob_id = dictionary.number(0x1400 + number, 1)
        self.id = cob_id & 0x7FF
        self.synchronous = dictionary.number(0x1400 + number, 2) == SYNCHRONOUS
        packer, keys = _packer(dictionary, 0x1600 + number)
        self.valid = not cob_id & INVALID and bool(keys)
        self.length = packer.size
        self.unpack = packer.unpack_from
        """The values of a frame's data in the order of the mapping; there may be more data."""
        self.writers = [(at, dictionary.setter(key)) for at, key in enumerate(keys) if key != CONTROLWORD]
        """Where each object is in the mapping, and how it is written; but for the controlword."""
        self.commands = [(at, dictionary.setter(key)) for at, key in enumerate(keys) if key == CONTROLWORD]
        """The same of the controlword."""


class TransmitPdo:
    """A PDO that the drive sends."""

    def __init__(self, dictionary: Dictionary, number: int) -> None:
        cob_id = dictionary.number(0x1800 + number, 1)
        self.id = cob_id & 0x7FF
        self.type = dictionary.number(0x1800 + number, 2)
        self.inhibit = dictionary.number(0x1800 + number, 3) * INHIBIT_UNIT
        packer, keys = _packer(dictionary, 0x1A00 + number)
        self.valid = not cob_id & INVALID and bool(keys)
        self.rtr_allowed = not cob_id & NO_RTR
        self.sent: Frame | None = None
        """What went out last; None: nothing since the node became operational."""
        self.inhibited_until = -math.inf
        self._pack = packer.pack
        self._getters = tuple(dictionary.getter(key) for key in keys)
        self._frame = Frame(self.id)

    def sample(self) -> Frame:
        """The mapped objects as they are now; the same frame again as long as nothing changes."""
        numbers = []
        for get in self._getters:  # a comprehension costs a call
            numbers.append(get())
        data = self._pack(*numbers)
        if data != self._frame.data:
            self._frame = Frame(self.id, data)
        return self._frame


class ProcessData:
    """All PDOs of one drive. `changed` is told when an identifier, a type or a mapping is another."""

    def __init__(
        self, dictionary: Dictionary, *, pre_operational: Callable[[], bool], changed: Callable[[], None]
    ) -> None:
        self._dictionary = dictionary
        self._count = pdos_of(dictionary)
        self._pre_operational = pre_operational
        self._changed = changed
        self.received: list[ReceivePdo] = []
        self.transmitted: list[TransmitPdo] = []
        self.on_sync: list[TransmitPdo] = []
        self.on_change: list[TransmitPdo] = []
        self._waiting: dict[ReceivePdo, tuple[int, ...]] = {}
        """Newest values of each synchronous PDO since the last SYNC."""
        self._watch_objects()

    def start(self) -> None:
        """Build everything from the dictionary."""
        self.received = [ReceivePdo(self._dictionary, number) for number in range(self._count)]
        self.transmitted = [TransmitPdo(self._dictionary, number) for number in range(self._count)]
        self._sort()

    def restart(self) -> None:
        """The node becomes operational: event-driven PDOs are sent anew, nothing waits for a SYNC."""
        self._waiting.clear()
        for pdo in self.transmitted:
            pdo.sent, pdo.inhibited_until = None, -math.inf

    def rebuild_transmitted(self) -> None:
        """Look up anew how each mapped object is read."""
        if self.transmitted:
            self.transmitted = [TransmitPdo(self._dictionary, number) for number in range(self._count)]
            self._sort_transmitted()
            self._changed()

    def receive(self, pdo: ReceivePdo, data: bytes) -> bool:
        """Take a frame; False when it is shorter than its mapping."""
        if len(data) < pdo.length:
            return False
        values = pdo.unpack(data)
        if pdo.synchronous:
            self._waiting[pdo] = values
        else:
            _take_effect(((pdo, values),))
        return True

    def sync(self) -> None:
        """What came for this SYNC takes effect."""
        _take_effect(self._waiting.items())
        self._waiting.clear()

    def change_samples(self, now: float) -> tuple[list[Frame], float]:
        """Event-driven PDOs whose content changed, and when those that are inhibited may follow (inf: none waits)."""
        samples, due = [], math.inf
        for pdo in self.on_change:
            frame = pdo.sample()
            if frame == pdo.sent:
                continue
            if now < pdo.inhibited_until:
                due = min(due, pdo.inhibited_until)
                continue
            pdo.sent, pdo.inhibited_until = frame, now + pdo.inhibit
            samples.append(frame)
        return samples, due

    def restore_identifiers(self, node_id: int) -> None:
        """Object 0x1011:5: default COB-IDs into the dictionary, without effect before store and restart."""
        for number in range(min(self._count, len(TPDO_COB_IDS))):
            self._dictionary.values[key_of(0x1400 + number, 1)] = 0x200 + 0x100 * number + node_id
            self._dictionary.values[key_of(0x1800 + number, 1)] = TPDO_COB_IDS[number] + node_id

    def _sort(self) -> None:
        self._sort_transmitted()
        self._waiting.clear()
        self._changed()

    def _sort_transmitted(self) -> None:
        valid = [pdo for pdo in self.transmitted if pdo.valid]
        self.on_sync = [pdo for pdo in valid if pdo.type == SYNCHRONOUS]
        self.on_change = [pdo for pdo in valid if pdo.type == ON_CHANGE]

    # ------------------------------------------------------------------------------------------ rules of the objects

    def _watch_objects(self) -> None:
        checks, written = self._dictionary.checks, self._dictionary.written
        for number in range(self._count):
            for parameters, mapping, last in ((0x1400, 0x1600, 2), (0x1800, 0x1A00, 3)):
                checks[key_of(parameters + number, 1)] = judge_identifier
                for sub in range(1, last + 1):
                    written[key_of(parameters + number, sub)] = self._rebuilder(parameters, number)
                for sub in range(self._dictionary.entries[key_of(mapping + number, 0)].maximum + 1):
                    key = key_of(mapping + number, sub)
                    checks[key] = (
                        self._judge_length(mapping + number) if sub == 0 else self._judge_place(mapping + number)
                    )
                    written[key] = self._rebuilder(parameters, number)

    def _rebuilder(self, parameters: int, number: int) -> Callable[[int], None]:
        def rebuild(_: int) -> None:
            if parameters == 0x1400:
                self.received[number] = ReceivePdo(self._dictionary, number)
            else:
                self.transmitted[number] = TransmitPdo(self._dictionary, number)
            self._sort()

        return rebuild

    def _judge_place(self, index: int) -> Callable[[int], None]:
        """A place is written in Pre-Operational, while sub 0 is 0, with an object that exists and fits."""

        def judge(mapped: int) -> None:
            self._judge_nmt()
            if self._dictionary.number(index, 0):
                raise AccessRefused(AbortCode.UNSUPPORTED_ACCESS)
            if mapped:
                self._judge_mapped(mapped, receive=index < 0x1A00)

        return judge

    def _judge_length(self, index: int) -> Callable[[int], None]:
        def judge(count: int) -> None:
            self._judge_nmt()
            places = [self._dictionary.number(index, sub) for sub in range(1, count + 1)]
            for mapped in places:
                self._judge_mapped(mapped, receive=index < 0x1A00)
            if total(mapped & 0xFF for mapped in places) > LONGEST_BITS:
                raise AccessRefused(AbortCode.PDO_TOO_LONG)

        return judge

    def _judge_nmt(self) -> None:
        if not self._pre_operational():
            raise AccessRefused(AbortCode.NMT_STATE)

    def _judge_mapped(self, mapped: int, *, receive: bool) -> None:
        entry = self._dictionary.entries.get(mapped >> 8)
        if entry is None or not (entry.receive if receive else entry.transmit):
            raise AccessRefused(AbortCode.NOT_MAPPABLE)
        if mapped & 0xFF != 8 * SIZES[entry.type]:
            raise AccessRefused(AbortCode.NOT_MAPPABLE)


def _take_effect(received: Collection[tuple[ReceivePdo, tuple[int, ...]]]) -> None:
    """Write all set-points first, then the controlwords: what these start is what came with them."""
    for pdo, values in received:
        for at, write in pdo.writers:
            write(values[at])
    for pdo, values in received:
        for at, write in pdo.commands:
            write(values[at])


def pdos_of(dictionary: Dictionary) -> int:
    """How many PDOs the drive has each way."""
    return next(number for number in count() if key_of(0x1400 + number, 1) not in dictionary.entries)


def judge_identifier(cob_id: int) -> None:
    """Bits 10 to 0 are 0x181 to 0x57F, or 0 in a PDO that is not valid; bits 29 to 11 are 0."""
    allowed = LOWEST_ID <= cob_id & 0x7FF <= HIGHEST_ID or (cob_id & INVALID and not cob_id & 0x7FF)
    if cob_id & 0x3FFFF800 or not allowed:
        raise AccessRefused(AbortCode.RANGE)


def _packer(dictionary: Dictionary, index: int) -> tuple[struct.Struct, list[int]]:
    """Layout of a mapping and the keys of its objects."""
    mapped = [dictionary.number(index, sub) for sub in range(1, dictionary.number(index, 0) + 1)]
    keys = [place >> 8 for place in mapped]
    return struct.Struct("<" + "".join(FORMATS[dictionary.entries[key].type] for key in keys)), keys
