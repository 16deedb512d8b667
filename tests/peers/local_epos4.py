"""EPOS4 drives made of the `canopen` package's `LocalNode` and an EDS, on the wire of `local_epos`.

Added to what that one has: device states without the first generation's own, ranges of the EDS, option codes, PDOs that
keep their identifier while they are valid, and a lost heartbeat that only a reset of the communication forgives.
"""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

from pathlib import Path

import canopen
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from local_epos import NOT_VALID, LocalEpos, States, Wire

from artemis.drive_schema import Drive
from artemis.vehicle import RobotFile

EDS = Path(__file__).with_name("epos4.eds")
RANGE, READ_ONLY, UNSUPPORTED = 0x06090030, 0x06010002, 0x06010000
BOOT_TIME = 0.2
RESET_COMMUNICATION = 0x82
COMMUNICATION = range(0x1000, 0x2000)


class LocalEpos4(LocalEpos):
    """One drive of the robot file on the wire, powered and in Pre-Operational."""

    states = States(disabled=0x0040, ready=0x0021, switched_on=0x0033, enabled=0x0037, quick_stop=0x0017, fault=0x0008)
    set_point = 0x607A
    analog = 0x3160

    def __init__(self, wire: Wire, robot: RobotFile, drive: Drive, *, angle: float = 0.0) -> None:
        """`angle`: where a steered wheel truly stands [rad]."""
        super().__init__(wire, robot, drive, angle=angle)
        self.add_write_callback(self._judge)
        self._measured[0x3000, 5] = self._resolution

    def objects(self, drive: Drive) -> canopen.ObjectDictionary:
        """Those of the EDS."""
        return canopen.import_od(str(EDS), drive.node_id)

    def identify(self, drive: Drive) -> None:
        """As the robot file expects it."""
        version = drive.hardware_version
        self.put(0x1018, 2, version if version > 0xFFFF else version << 16, 4)

    def _resolution(self) -> int:
        halls_alone = not self.value(0x3000, 1) & 0xFF
        return 6 * self.value(0x3001, 3) if halls_alone else 4 * self.value(0x3010, 1)

    def _judge(self, index: int, subindex: int, od: ODVariable, data: bytes, **_: object) -> None:
        """Ranges; and a PDO that is valid keeps its identifier."""
        value = od.decode_raw(bytes(data))
        assert isinstance(value, int)
        if (od.min is not None and value < od.min) or (od.max is not None and value > od.max):
            raise SdoAbortedError(RANGE)
        if subindex == 1 and (0x1400 <= index < 0x1404 or 0x1800 <= index < 0x1804):
            present = self.value(index, 1)
            if not present & NOT_VALID and (present ^ value) & 0x7FF:
                raise SdoAbortedError(UNSUPPORTED)

    def _miss_heartbeat(self) -> None:
        super()._miss_heartbeat()
        self.latched = True
        if not self.value(0x1029, 1):
            self.nmt.state = "PRE-OPERATIONAL"

    def _hear_nmt(self, can_id: int, data: bytearray, time: float) -> None:
        if data[0] == RESET_COMMUNICATION and data[1] in (0, self.id):
            self.latched = False
            for index in [index for index in self.data_store if index in COMMUNICATION and index != 0x1018]:
                del self.data_store[index]
            self._watch(0)
            self._loop.call_later(BOOT_TIME, self._boot)
        super()._hear_nmt(can_id, data, time)

    def _boot(self) -> None:
        self.network.send_message(0x700 + self.drive.node_id, b"\0")
        self.nmt.state = "PRE-OPERATIONAL"
