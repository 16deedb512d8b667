"""What the frames on the wire say: the monitor's own reading of CiA 301, CiA 402 and the EPOS, shared with nobody.

Sources: CiA 301 (7.2.4.3 SDO, 7.2.7 EMCY, 7.2.8 NMT and heartbeat, 7.3.3 identifiers); CiA 402 (statusword); EPOS
firmware specification, April 2010, 8.1.1 (statusword) and 14 (objects). A drive of a later family shows its mode in the
seventh byte of TxPDO 1, one of the first generations in the last byte of TxPDO 2.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import NamedTuple, TypeVar

from artemis_lab.campaign.witness import Heard

NMT, SYNC = 0x000, 0x080
RESET_COMMUNICATION = b"\x82"
OPERATION_ENABLE, QUICK_STOP_ACTIVE = 0x0027, 0x0007
STATE_BITS = 0x006F
"""Of a statusword (CiA 402; the EPOS has more, without which these two are no other state)."""
FAULT_BIT = 0x0008
ENABLE, QUICK_STOP = 0x0F, 0x0B
"""Controlwords that ask for operation and for a quick stop."""
TARGET_VELOCITY, POSITION_SETTING, CONTROLWORD = 0x60FF, 0x2062, 0x6040
WATCHED_HOST, IDENTITY, VERSION, MODE_SHOWN, HISTORY = 0x1016, 0x1018, 0x2003, 0x6061, 0x1003
LOST_HEARTBEAT = 0x8130
"""EMCY code."""
BOOTS_WITHIN = 0.5
"""A drive says that it has booted so soon after a reset of its communication [s]: later, its supply was gone."""


class SetPoint(NamedTuple):
    """RxPDO 1: taken over at the next SYNC."""

    time: float
    controlword: int
    target: int
    """In the drive's unit of velocity, or counts."""


class Status(NamedTuple):
    """TxPDO 1."""

    time: float
    statusword: int
    position: int
    """Counts."""

    @property
    def enabled(self) -> bool:
        """Operation Enable."""
        return self.statusword & STATE_BITS == OPERATION_ENABLE

    @property
    def faulty(self) -> bool:
        """Fault, or on the way there."""
        return bool(self.statusword & FAULT_BIT)


class Transfer(NamedTuple):
    """A finished SDO transfer."""

    time: float
    write: bool
    object: int
    sub: int
    value: int
    """Unsigned."""


class StopFrame(NamedTuple):
    """RxPDO 2: a controlword that acts at once."""

    time: float
    controlword: int


class ModeShown(NamedTuple):
    """In process data."""

    time: float
    mode: int


class SeenEmergency(NamedTuple):
    """EMCY of 8 bytes (CiA 301, 7.2.7.3): one of another length says nothing of its drive."""

    time: float
    code: int


class Boot(NamedTuple):
    """Boot-up message."""

    time: float
    reset: bool
    """NMT Reset Communication of this node, or of all, came just before it."""


class WriteRequest(NamedTuple):
    """A request to write an object, whatever becomes of it."""

    time: float
    object: int
    value: int
    """Unsigned."""


Event = SetPoint | Status | Transfer | StopFrame | ModeShown | SeenEmergency | Boot | WriteRequest
Kind = TypeVar("Kind", bound=Event)


class NodeTalk:
    """Everything said by and to one drive, in the order of time."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.early_mode = False
        """The mode is shown in TxPDO 1."""
        self.reset = -inf
        """When its communication was reset last [s]."""

    def all(self, kind: type[Kind]) -> list[Kind]:
        """The events of one kind."""
        return [event for event in self.events if isinstance(event, kind)]


class Wire:
    """All talk, sorted by drive."""

    def __init__(self, heard: Iterable[Heard], nodes: Iterable[int], host: int) -> None:
        self.nodes = {node: NodeTalk() for node in nodes}
        self.beats: list[float] = []
        """When the host's heartbeat was heard [s]."""
        self.syncs: list[float] = []
        """When a SYNC was heard [s]."""
        self._pending: dict[int, bytes] = {}
        self._host = 0x700 + host
        for frame in heard:
            self._take(frame)

    def _take(self, frame: Heard) -> None:
        time, identifier, data = frame
        if identifier in (self._host, SYNC):
            (self.beats if identifier == self._host else self.syncs).append(time)
            return
        if identifier == NMT and data[:-1] == RESET_COMMUNICATION:
            for node, told in self.nodes.items():
                told.reset = time if data[-1] in (0, node) else told.reset
        talk = self.nodes.get(identifier & 0x7F)
        if talk is not None:
            self._hear(frame, talk)

    def _hear(self, frame: Heard, talk: NodeTalk) -> None:
        time, identifier, data = frame
        service = identifier & 0x780
        say = talk.events.append
        if service == 0x200 and len(data) == 6:
            say(SetPoint(time, _unsigned(data[:2]), _signed(data[2:])))
        elif service == 0x180 and len(data) in (6, 7):
            talk.early_mode = len(data) == 7
            talk.events += [Status(time, _unsigned(data[:2]), _signed(data[2:6])), *_shown(time, data[6:])]
        elif service == 0x280 and not talk.early_mode:
            talk.events += _shown(time, data[-1:])
        elif service == 0x300 and len(data) == 2:
            say(StopFrame(time, _unsigned(data)))
        elif service == 0x080 and len(data) == 8:
            say(SeenEmergency(time, _unsigned(data[:2])))
        elif service == 0x700 and data[:1] == b"\0":
            say(Boot(time, reset=time - talk.reset < BOOTS_WITHIN))
            talk.reset = -inf
        elif service == 0x600 and len(data) == 8:
            self._pending[identifier & 0x7F] = data
            if data[0] & 0xE2 == 0x22:
                say(WriteRequest(time, _unsigned(data[1:3]), _value(data)))
        elif service == 0x580 and len(data) == 8:
            self._answer(time, talk, self._pending.pop(identifier & 0x7F, None), data)

    def _answer(self, time: float, talk: NodeTalk, request: bytes | None, answer: bytes) -> None:
        """An expedited transfer that fits its request; an abort (first byte 0x80) tells nothing."""
        if request is None or request[1:4] != answer[1:4]:
            return
        index, sub = _unsigned(request[1:3]), request[3]
        if answer[0] == 0x60 and request[0] & 0xE2 == 0x22:
            talk.events.append(Transfer(time, True, index, sub, _value(request)))
        elif answer[0] & 0xE2 == 0x42 and request[0] == 0x40:
            talk.events.append(Transfer(time, False, index, sub, _value(answer)))


def _shown(time: float, mode: bytes) -> list[ModeShown]:
    """A byte of process data, or none."""
    return [ModeShown(time, _signed(mode))] if mode else []


def _value(carrier: bytes) -> int:
    """Up to 4 bytes, of which bits 2 and 3 of the first byte say how many are unused."""
    return _unsigned(carrier[4 : 8 - (carrier[0] >> 2 & 3)])


def _unsigned(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _signed(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)
