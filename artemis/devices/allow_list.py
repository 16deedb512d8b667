"""The last line in software before the wire: which frames may leave in which mode. Default is silence.

Each identifier has a rule for length and content. A frame that breaks it is a fault of the program: it is held back.
"""

from __future__ import annotations

from collections.abc import Callable

from artemis.devices.can_bus import Frame
from artemis.devices.canopen import HEARTBEAT, NMT, RXPDO, SDO_REQUEST, SYNC, NmtCommand
from artemis.devices.epos_objects import Units
from artemis.devices.epos_state import Controlword
from artemis.drive_states import Nmt
from artemis.families.objects import CONTROLWORD, DEVICE_TYPE, TARGET_VELOCITY, Object
from artemis.values import Mode
from artemis.vehicle import RobotFile

DRIVING = frozenset({Mode.TELEOP, Mode.FOLLOW, Mode.ACT})
"""Targets of the driven wheels may rise."""
FALLING = frozenset({Mode.READY, Mode.CALIBRATE, Mode.QUICKSTOP})
"""They may only fall, to zero."""
SERVICE = frozenset({Mode.INIT, Mode.QUICKSTOP, Mode.FAULT, Mode.END})
"""NMT commands may leave."""
QUIET = frozenset({Mode.READY, Mode.TELEOP, Mode.FOLLOW, Mode.ACT})
"""No SDO transfer: it waits until the robot is at rest in another mode. Only voltages and temperatures are read."""
MARGIN = 0.05
"""A wheel's target may rise by this much while the robot slows down: it no longer rolls about its kingpin [m/s]."""
TOLERANCE = 1.02
"""Of the wheel speed's limit."""
MOST = 2
"""Frames of one identifier in a tick, but for NMT and SDO."""
_STOPPED = (Mode.FAULT, Mode.END)
_FUNCTION = 0x780
"""Function code of an identifier; the rest is the node id (CiA 301 7.3.3)."""
_NMT_COMMANDS = frozenset(NmtCommand)
_OFF_WORDS = frozenset({Controlword.DISABLE_VOLTAGE, Controlword.QUICK_STOP, Controlword.FAULT_RESET})
_DOWNLOAD, _UPLOAD, _ABORT, _SPECIFIER = 0x20, 0x40, 0x80, 0xE0
"""Client commands in the first byte of a request: initiate download, initiate upload, abort (CiA 301 7.2.4.3)."""

Rule = Callable[[bytes], str | None]
"""Given a frame's data: what is wrong with it, or None."""


class AllowList:
    """Judges every frame that is about to leave. `begin` tells it the mode at each tick."""

    def __init__(self, robot: RobotFile) -> None:
        self._mode = Mode.INIT
        self._ceiling = 0.0
        self._asked: dict[int, float] = {}
        self._nodes = {0, *(drive.node_id for drive in robot.drives.values())}
        self._top = TOLERANCE * robot.limits.wheel_speed_m_s
        self._rules: dict[int, Rule] = {
            NMT: self._nmt,
            SYNC: _of_length(0),
            HEARTBEAT + robot.host_node_id: _exactly(bytes((Nmt.OPERATIONAL.value,))),
        }
        source = robot.supply_source
        for name, drive in robot.drives.items():
            node, driven = drive.node_id, drive.role == "traction"
            units = abs(Units(robot, drive).velocity) if driven else 0.0
            self._rules[RXPDO[0] + node] = self._set_point(node, units)
            self._rules[RXPDO[1] + node] = self._stop
            supply = source.object if source and source.drive == name else None
            self._rules[SDO_REQUEST + node] = self._sdo(supply, drive.tables.temperature)
        self.ours = frozenset(self._rules)
        """Identifiers that nobody but us may send."""
        counted = [identifier for identifier in self._rules if identifier & _FUNCTION not in (NMT, SDO_REQUEST)]
        self._none_sent = dict.fromkeys(counted, 0)
        self._sent = self._none_sent.copy()

    def begin(self, mode: Mode) -> None:
        """A tick in `mode` begins to write."""
        self._sent = self._none_sent.copy()
        if mode in DRIVING:
            self._ceiling = self._top
        elif mode in FALLING:
            fastest = max(self._asked.values(), default=0.0)
            self._ceiling = min(self._ceiling, fastest + MARGIN) if fastest else 0.0
        else:
            self._ceiling = 0.0
        self._mode = mode

    def problem(self, frame: Frame) -> str | None:
        """Why `frame` must not leave now; None: it may."""
        identifier, sent = frame.id, self._sent
        rule = self._rules.get(identifier)
        if rule is None or frame.rtr:
            return self._told(frame, "is not a frame of artemis")
        if (before := sent.get(identifier)) is not None:
            sent[identifier] = before + 1
            if before >= MOST:
                return self._told(frame, f"was sent {before + 1} times in one tick")
        wrong = rule(frame.data)
        return None if wrong is None else self._told(frame, wrong)

    def _told(self, frame: Frame, wrong: str) -> str:
        return f"0x{frame.id:03X} [{frame.data.hex(' ')}] in {self._mode.value}: {wrong}"

    def _nmt(self, data: bytes) -> str | None:
        if len(data) != 2 or data[0] not in _NMT_COMMANDS or data[1] not in self._nodes:
            return "is no NMT command to a node of the robot file"
        if data[0] == NmtCommand.STOP:
            return "NMT Stop also stops the drive's messages: never"
        return None if self._mode in SERVICE else "NMT commands only while nothing drives"

    def _set_point(self, node: int, units: float) -> Rule:
        """Controlword and set-point of a node; `units`: of the drive per m/s of a driven wheel, 0 for a steered one."""
        if not units:
            return _of_length(6)
        rounding = 1.0 / units

        def judge(data: bytes) -> str | None:
            if len(data) != 6:
                return "is no set-point"
            if self._mode in _STOPPED and data[0] not in _OFF_WORDS:
                return "may only stop, switch off or reset"
            speed = abs(int.from_bytes(data[2:], "little", signed=True)) / units
            self._asked[node] = speed
            if speed > (self._ceiling + rounding if self._ceiling else 0.0):
                return f"target of {speed:.2f} m/s, at most {self._ceiling:.2f}"
            return None

        return judge

    def _stop(self, data: bytes) -> str | None:
        return None if data == _word(Controlword.QUICK_STOP) else "is no quick stop"

    def _sdo(self, *measured: Object | None) -> Rule:
        """SDO requests to a node; `measured`: what is read of it in every mode.

        Reading it includes an abort after a lost answer, and the look at 0x1000 with which the client falls in step.
        """
        read = {(object.index, object.subindex) for object in measured if object is not None}

        def judge(data: bytes) -> str | None:
            if len(data) != 8:
                return "is no SDO request"
            command = data[0] & _SPECIFIER
            if self._mode in QUIET:
                index, subindex = int.from_bytes(data[1:3], "little"), data[3]
                known = (index, subindex) in read or (bool(read) and index == DEVICE_TYPE.index)
                return None if known and command in (_UPLOAD, _ABORT) else "no SDO transfer while the robot may move"
            if command != _DOWNLOAD:
                return None
            index, value = int.from_bytes(data[1:3], "little"), data[4:]
            if index == TARGET_VELOCITY.index and any(value):
                return "a target velocity other than 0 goes through the gate"
            if index == CONTROLWORD.index and value[0] not in _OFF_WORDS:
                return "a drive is enabled by its set-point frame alone"
            return None

        return judge


def _word(command: Controlword) -> bytes:
    return int(command).to_bytes(2, "little")


def _of_length(length: int) -> Rule:
    return lambda data: None if len(data) == length else "has the wrong length"


def _exactly(content: bytes) -> Rule:
    return lambda data: None if data == content else "has the wrong content"
