"""The host's end of the wire: everything that leaves passes here, and everything that arrives is written down."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Protocol

from artemis.devices.allow_list import AllowList
from artemis.devices.can_bus import Frame, FrameBus
from artemis.devices.canopen import EMERGENCY
from artemis.devices.device import Report
from artemis.devices.objects import ObjectAccess
from artemis.devices.sdo import SdoClient
from artemis.devices.serial_line import SerialLine
from artemis.devices.tally import Tally
from artemis.errors import DeviceBusy, DeviceLost, ProtocolError
from artemis.values import BusHealth, Mode, Sensed
from artemis.vehicle import RobotFile

LOST = "COM-22"
_AFTER_EMERGENCIES = EMERGENCY + 0x80
"""Of what has a handler, only emergencies are below this."""
_WELL = Sensed(index=0, time=0.0).bus
"""The default itself, which is left out of recordings."""


def _unheard(id: str, device: str, seen: str) -> None:
    """Outside of a run nobody asks: drives on a lost bus do not answer."""


class Counted(Protocol):
    """A node that counts its malformed frames."""

    tally: Tally


class BusGateway:
    """The only owner of the bus. Holds back what must not leave in the present mode."""

    def __init__(self, robot: RobotFile, bus: FrameBus) -> None:
        self._bus = bus
        self.mode = Mode.INIT
        """In the last tick."""
        self.judged = False
        """In the last tick, and in no fault: the drives answer."""
        self._allow = AllowList(robot)
        self._traffic: list[tuple[bool, Frame]] = []
        self._foreign: list[int] = []
        self._blocked: list[str] = []
        self._refused = self._refused_now = 0
        self._error_frames = bus.error_frames
        self._report: Report = _unheard
        self.handlers: dict[int, tuple[Counted, Callable[[Frame], None]]] = {}
        """What to do with a frame, by its identifier."""

    def begin(self, mode: Mode, *, judged: bool = False) -> None:
        """A tick in `mode` begins to write; `judged`: what the drives do not tell is a fault."""
        self.mode, self.judged = mode, judged and mode is not Mode.FAULT
        self._allow.begin(mode)

    def listen(self, wake: Callable[[], None] = lambda: None, report: Report = _unheard) -> None:
        """Take frames in as they arrive. `wake` is called where they cannot wait; `report`, where the bus is lost."""

        def hear() -> None:
            if self.look():
                wake()

        self._report = report
        self._bus.listen(hear)

    def look(self) -> bool:
        """Take in what waits; whether it cannot wait for a tick: an emergency, or a lost bus, which is reported."""
        try:
            return self.take_in()
        except DeviceLost as error:
            self.lose(error)
            return True

    def take_in(self) -> bool:
        """Hand every waiting frame to its handler; whether one was an emergency (not "errors gone").

        Frames that only we may send are noticed.

        Raises:
            DeviceLost: the adapter is gone.
        """
        urgent, traffic, handlers, ours = False, self._traffic, self.handlers, self._allow.ours
        for frame in self._bus.receive():
            traffic.append((False, frame))
            identifier = frame.id
            known = handlers.get(identifier)
            if known is None:
                if identifier in ours:
                    self._foreign.append(identifier)
            elif not frame.rtr:
                node, handler = known
                try:
                    handler(frame)
                except ProtocolError:
                    node.tally.malformed += 1
                if identifier < _AFTER_EMERGENCIES and frame.data[:2] != b"\0\0":
                    urgent = True
        return urgent

    def lose(self, error: DeviceLost) -> None:
        """Report that the adapter is gone."""
        self._report(LOST, "", error.problem)

    def send(self, frame: Frame) -> None:
        """Queue a frame, if it may leave; one that the adapter has no room for is dropped and counted.

        Raises:
            DeviceLost: the adapter is gone.
        """
        if (problem := self._allow.problem(frame)) is not None:
            self._blocked.append(f"{problem}; {_where_from()}")
            return
        try:
            self._bus.send(frame)
        except DeviceBusy:
            self._refused_now += 1
            self._refused = max(self._refused, self._refused_now)
        else:
            self._refused_now = 0
            self._traffic.append((True, frame))

    def objects(self, name: str, node_id: int) -> ObjectAccess:
        """Access to the objects of a node: by SDO, or over a serial line."""
        if isinstance(self._bus, SerialLine):
            return self._bus.objects(name, node_id)
        return SdoClient(name, node_id, self.send)

    async def sent(self) -> None:
        """Return once the bus may be closed: an adapter sends what it was given, a serial line does that by itself."""
        if isinstance(self._bus, SerialLine):
            await self._bus.sent()

    def close(self) -> None:
        """Give the bus back; harmless when repeated."""
        self._bus.close()

    def health(self) -> BusHealth:
        """How the bus has been since the last call."""
        errors, self._error_frames = self._bus.error_frames - self._error_frames, self._bus.error_frames
        if not (errors or self._foreign or self._refused or self._blocked):
            return _WELL
        foreign, blocked, refused = tuple(self._foreign), tuple(self._blocked), self._refused
        self._foreign, self._blocked, self._refused = [], [], 0
        return BusHealth(foreign=foreign, refused=refused, error_frames=errors, blocked=blocked)

    def take_traffic(self) -> list[tuple[bool, Frame]]:
        """Every frame on the bus since the last call, each with whether we sent it; those have no time."""
        traffic, self._traffic = self._traffic, []
        return traffic


def _where_from() -> str:
    """The places in the program that led to the frame, innermost first."""
    stack = traceback.extract_stack(limit=8)[:-2]
    return " < ".join(f"{place.name}:{place.lineno}" for place in reversed(stack))
