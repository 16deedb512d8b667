"""Drives made of the `canopen` package's `LocalNode`, which nobody here wrote, on a wire in memory and virtual time.

The package's are the SDO server, the NMT slave, the PDO maps, the EMCY producer and the heartbeats. Added is what it
leaves to a device: the objects (EPOS firmware specification 2010, chapter 14), the device states (8.1; CiA 402), SYNC,
the heartbeat consumer, and the rules for changing a mapping (CiA 301, 7.5.2.36).

The servo is perfect: a steering motor stands at its set-point after each SYNC, a traction motor turns at its own.
"""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import canopen
from canopen.objectdictionary import ODRecord, ODVariable
from canopen.objectdictionary.datatypes import (
    INTEGER8,
    INTEGER16,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
)
from canopen.sdo.exceptions import SdoAbortedError

from artemis.devices.can_bus import Frame
from artemis.drive_schema import Drive
from artemis.vehicle import RobotFile

SYNC, HEARTBEAT = 0x080, 0x700
NOT_VALID = 1 << 31
HEARTBEAT_LOST = 0x8130
WRONG_STATE, NOT_SUPPORTED = 0x08000022, 0x06010000

VARIABLES = {
    0x1000: (UNSIGNED32, 0x00020192),
    0x100C: (UNSIGNED16, 0),
    0x100D: (UNSIGNED8, 0),
    0x1017: (UNSIGNED16, 0),
    0x2028: (INTEGER32, 0),
    0x2062: (INTEGER32, 0),
    0x6040: (UNSIGNED16, 0),
    0x6041: (UNSIGNED16, 0),
    0x6060: (INTEGER8, 1),
    0x6061: (INTEGER8, 1),
    0x6064: (INTEGER32, 0),
    0x6065: (UNSIGNED32, 2000),
    0x6078: (INTEGER16, 0),
    0x607F: (UNSIGNED32, 25000),
    0x6083: (UNSIGNED32, 10000),
    0x6084: (UNSIGNED32, 10000),
    0x6085: (UNSIGNED32, 10000),
    0x6086: (INTEGER16, 0),
    0x60FF: (INTEGER32, 0),
    0x6402: (UNSIGNED16, 10),
}
RECORDS = {
    0x1003: (UNSIGNED32,) * 5,
    0x1016: (UNSIGNED32,) * 2,
    0x1018: (UNSIGNED32,) * 4,
    0x2003: (UNSIGNED16,) * 2,
    0x200C: (UNSIGNED32,) * 4,
    0x207C: (INTEGER16,) * 2,
    0x2210: (UNSIGNED16,) * 2,
    0x607D: (INTEGER32,) * 2,
    0x60F6: (INTEGER16,) * 2,
    0x60F9: (INTEGER16,) * 2,
    0x60FB: (INTEGER16,) * 3,
    0x6410: (UNSIGNED16, UNSIGNED16, UNSIGNED8, UNSIGNED16, UNSIGNED16),
    **{0x1400 + number: (UNSIGNED32, UNSIGNED8) for number in range(4)},
    **{0x1800 + number: (UNSIGNED32, UNSIGNED8) for number in range(4)},
    **{0x1600 + number: (UNSIGNED32,) * 8 for number in range(4)},
    **{0x1A00 + number: (UNSIGNED32,) * 8 for number in range(4)},
}
READ_ONLY = {0x1018, 0x2003, 0x2028, 0x207C, 0x6041, 0x6061, 0x6064, 0x6078}

# Statuswords of the device states (EPOS firmware specification 2010, 8.1.1).
DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x0140, 0x0121, 0x0123, 0x0137, 0x0117, 0x0108
REMOTE = 0x0200


def described() -> canopen.ObjectDictionary:
    """The objects of a drive that a host may want."""
    objects = canopen.ObjectDictionary()

    def variable(index: int, sub: int, kind: int, default: int = 0) -> ODVariable:
        made = ODVariable(f"object {index:04X}:{sub}", index, sub)
        made.data_type, made.default = kind, default
        made.access_type = "ro" if index in READ_ONLY else "rw"
        return made

    for index, (kind, default) in VARIABLES.items():
        objects.add_object(variable(index, 0, kind, default))
    for index, kinds in RECORDS.items():
        record = ODRecord(f"record {index:04X}", index)
        record.add_member(variable(index, 0, UNSIGNED8))
        for sub, kind in enumerate(kinds, 1):
            record.add_member(variable(index, sub, kind))
        objects.add_object(record)
    return objects


class Wire(canopen.Network):
    """The nodes' network, and a `FrameBus` for a host: each end's frames reach the other at once, in order."""

    def __init__(self) -> None:
        super().__init__()
        self._loop = asyncio.get_running_loop()
        self._inbox: list[Frame] = []
        self._wake: Callable[[], None] = lambda: None
        self.error_frames = 0
        self.seen: list[Frame] = []
        """Everything that the host sent."""

    # ------------------------------------------------------------------------------------------ for the host

    def send(self, frame: Frame) -> None:
        self.seen.append(frame)
        self._loop.call_soon(lambda: self.notify(frame.id, bytearray(frame.data), self._loop.time()))

    def receive(self) -> list[Frame]:
        frames, self._inbox = self._inbox, []
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        self._wake = wake

    def close(self) -> None:
        self._wake = lambda: None

    # ------------------------------------------------------------------------------------------ for the nodes

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._loop.call_soon(self._arrive, Frame(can_id, bytes(data), remote, self._loop.time()))

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> Any:  # noqa: ANN401
        return Beat(self, can_id, data, period)

    def _arrive(self, frame: Frame) -> None:
        self._inbox.append(frame)
        if not 0x180 <= frame.id <= 0x57F:
            self._wake()


class Beat:
    """A periodic message as the package wants it, on the loop's time."""

    def __init__(self, wire: Wire, can_id: int, data: bytes, period: float) -> None:
        self._wire, self._can_id, self._data, self._period = wire, can_id, bytes(data), period
        self._timer: asyncio.TimerHandle | None = None
        self._beat()

    def _beat(self) -> None:
        self._wire.send_message(self._can_id, self._data)
        self._timer = self._wire._loop.call_later(self._period, self._beat)

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def update(self, data: bytes) -> None:
        self._data = bytes(data)


class States(NamedTuple):
    """Statuswords of the device states."""

    disabled: int
    ready: int
    switched_on: int
    enabled: int
    quick_stop: int
    fault: int


class LocalEpos(canopen.LocalNode):
    """One drive of the robot file on the wire, powered and in Pre-Operational."""

    states = States(DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT)
    set_point = 0x2062
    """Of a steering drive."""
    analog = 0x207C

    def __init__(self, wire: Wire, robot: RobotFile, drive: Drive, *, angle: float = 0.0) -> None:
        """`angle`: where a steered wheel truly stands [rad]."""
        super().__init__(drive.node_id, self.objects(drive))
        self.latched = False
        """No fault reset is taken."""
        self.drive, self.status, self.position = drive, self.states.disabled, 0.0
        self._loop = asyncio.get_running_loop()
        self._controlword = 0
        self._last_sync = 0.0
        self._subscribed: list[Any] = []
        self._waiting: list[Any] = []
        self._consumer = 0
        self._alarm: asyncio.TimerHandle | None = None
        self._measured: dict[tuple[int, int], Callable[[], int]] = {
            (0x6041, 0): lambda: self.status | (REMOTE if self.nmt.state == "OPERATIONAL" else 0),
            (0x6061, 0): lambda: int(self.sdo[0x6060].raw),  # type: ignore[union-attr]
            (0x6064, 0): lambda: round(self.position),
        }
        if drive.role == "steering":
            self._measure_angle(robot, angle)
        self.add_read_callback(lambda index, subindex, **_: self._measured.get((index, subindex), lambda: None)())
        self.add_write_callback(self._judge_mapping)
        self.add_write_callback(self._written)
        self.identify(drive)
        wire.add_node(self)
        wire.subscribe(0, self._hear_nmt)
        wire.subscribe(SYNC, self._hear_sync)
        self.nmt.state = "PRE-OPERATIONAL"

    def objects(self, drive: Drive) -> canopen.ObjectDictionary:
        """The objects of a drive that a host may want."""
        return described()

    def identify(self, drive: Drive) -> None:
        """Give the objects that say who it is their values."""
        self.put(0x1018, 1, 0xFB, 4)
        self.put(0x1018, 2, drive.hardware_version << 16, 4)
        self.put(0x2003, 1, 0x2033, 2)
        self.put(0x2003, 2, drive.hardware_version, 2)

    def put(self, index: int, sub: int, value: int, size: int) -> None:
        """Give an object a value of so many bytes."""
        self.set_data(index, sub, value.to_bytes(size, "little"))

    def value(self, index: int, sub: int = 0) -> int:
        """Present value of an object, as a client of the package sees it."""
        entry: Any = self.sdo[index]
        return int(entry[sub].raw if isinstance(self.object_dictionary[index], ODRecord) else entry.raw)

    def _measure_angle(self, robot: RobotFile, angle: float) -> None:
        calibration, counts = robot.potentiometers(self.drive.side), self.drive.sensor.counts_per_turn
        sign = -1 if self.drive.mirrored else 1

        def millivolts(channel: int) -> int:
            turned = sign * self.position / (counts * self.drive.gear_ratio) * 360
            shown = (math.degrees(angle) + turned) / calibration.slope_deg_per_v[channel]
            return round(1000 * (calibration.zero_v[channel] + shown))

        self._measured[self.analog, 1] = lambda: millivolts(0)
        self._measured[self.analog, 2] = lambda: millivolts(1)

    # ------------------------------------------------------------------------------------------ objects

    def _judge_mapping(self, index: int, subindex: int, **_: object) -> None:
        """A mapping changes in Pre-Operational, while its PDO is not valid, and its places while it has none."""
        if not (0x1600 <= index < 0x1604 or 0x1A00 <= index < 0x1A04):
            return
        if self.nmt.state != "PRE-OPERATIONAL" or not self.value(index - 0x200, 1) & NOT_VALID:
            raise SdoAbortedError(WRONG_STATE)
        if subindex and self.value(index, 0):
            raise SdoAbortedError(NOT_SUPPORTED)

    def _written(self, index: int, subindex: int, data: bytes, **_: object) -> None:
        if index == 0x6040:
            self._obey(int.from_bytes(data, "little"))
        elif (index, subindex) == (0x1016, 1):
            self._watch(int.from_bytes(data, "little"))

    def _obey(self, controlword: int) -> None:
        """Transitions of the device states (EPOS firmware specification 2010, 8.1.2)."""
        states = self.states
        rising = controlword & ~self._controlword
        self._controlword = controlword
        if self.status == states.fault:
            if rising & 0x80 and not self.latched:
                self.status = states.disabled
                self.emcy.reset()
        elif not controlword & 0x02:
            self.status = states.disabled
        elif not controlword & 0x04:
            self.status = states.quick_stop if self.status in (states.enabled, states.quick_stop) else states.disabled
        elif controlword & 0x0F == 0x06 and self.status != states.quick_stop:
            self.status = states.ready
        elif controlword & 0x0F == 0x07 and self.status in (states.ready, states.enabled):
            self.status = states.switched_on
        elif controlword & 0x0F == 0x0F and self.status != states.disabled:
            self.status = states.enabled

    # ------------------------------------------------------------------------------------------ the host's heartbeat

    def _watch(self, consumer: int) -> None:
        if self._consumer:
            self.network.unsubscribe(HEARTBEAT + (self._consumer >> 16), self._hear_heartbeat)
        if self._alarm is not None:
            self._alarm.cancel()
        self._consumer = consumer
        if consumer:
            self.network.subscribe(HEARTBEAT + (consumer >> 16), self._hear_heartbeat)

    def _hear_heartbeat(self, *_: object) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = self._loop.call_later((self._consumer & 0xFFFF) / 1000, self._miss_heartbeat)

    def _miss_heartbeat(self) -> None:
        self.status = self.states.fault
        self.emcy.send(HEARTBEAT_LOST, 0x11)

    # ------------------------------------------------------------------------------------------ process data

    def _hear_nmt(self, _can_id: int, data: bytearray, _time: float) -> None:
        """Start: the PDO maps are read from the objects. Whatever else: no PDOs."""
        if data[1] not in (0, self.id):
            return
        for pdo in self._subscribed:
            self.network.unsubscribe(pdo.cob_id, pdo.on_message)
        self._subscribed, self._waiting = [], []
        if self.nmt.state == "OPERATIONAL":
            self.rpdo.read()
            self.tpdo.read()
            for pdo in self.tpdo.values():
                if pdo.enabled:  # `read` has subscribed this node to what it sends
                    self.network.unsubscribe(pdo.cob_id, pdo.on_message)
            self._subscribed = [pdo for pdo in self.rpdo.values() if pdo.enabled]
            for pdo in self._subscribed:
                pdo.callbacks = [self._take]

    def _take(self, pdo: Any) -> None:  # noqa: ANN401 (the package's PdoMap)
        if pdo.trans_type == 1:
            self._waiting.append(pdo)
        else:
            self._apply(pdo)

    def _apply(self, pdo: Any) -> None:  # noqa: ANN401
        for entry in sorted(pdo, key=lambda entry: entry.index == 0x6040):  # the controlword last
            self.set_data(entry.index, entry.subindex, bytes(entry.get_data()))

    def _hear_sync(self, *_: object) -> None:
        if self.nmt.state != "OPERATIONAL":
            return
        for pdo in self._waiting:
            self._apply(pdo)
        self._waiting = []
        self._move()
        for pdo in self.tpdo.values():
            if pdo.enabled and pdo.trans_type == 1:
                for entry in pdo:
                    entry.set_data(self.get_data(entry.index, entry.subindex))
                pdo.transmit()

    def _move(self) -> None:
        now = self._loop.time()
        elapsed, self._last_sync = now - self._last_sync, now
        if self.status != self.states.enabled:
            return
        if self.drive.role == "steering":
            self.position = self.value(self.set_point)
        else:
            self.position += self.value(0x60FF) / 60 * self.drive.sensor.counts_per_turn * min(elapsed, 0.1)
