"""A simulated drive on a test rig: one node, one axis, no bus; SDO requests built by hand."""

from __future__ import annotations

import struct

from artemis.devices.can_bus import Frame
from artemis.drive_schema import Drive, Motor, Sensor
from artemis.drive_states import DriveState
from artemis.sim.axis import Axis
from artemis.sim.drive_node import simulated_drive
from artemis.sim.epos4 import SimEpos4
from artemis.sim.epos_settings import SimSettings

STEP = 0.001

TRACTION = Drive(
    node_id=2,
    role="traction",
    side="left",
    mirrored=False,
    hardware_version=0x6210,
    serial_number=12345678,
    motor=Motor(
        type="ec_block",
        pole_pairs=12,
        continuous_current_ma=5000,
        output_current_ma=10000,
        thermal_time_constant_s=52.6,
        max_speed_rpm=3190,
    ),
    sensor=Sensor(type="hall", counts_per_turn=72),
    gear_ratio=50,
)
STEERING = Drive(
    node_id=3,
    role="steering",
    side="left",
    mirrored=False,
    hardware_version=0x6010,
    motor=Motor(
        type="dc",
        pole_pairs=1,
        continuous_current_ma=1000,
        output_current_ma=2000,
        thermal_time_constant_s=13.0,
        max_speed_rpm=6000,
    ),
    sensor=Sensor(type="encoder_3_channel", counts_per_turn=2000),
    gear_ratio=946,
)

TRACTION_4, STEERING_4 = (
    drive.model_copy(
        update={
            "family": "epos4",
            "hardware_version": 0x6150,
            "motor": drive.motor.model_copy(update={"torque_constant_mnm_per_a": 70.5}),
        }
    )
    for drive in (TRACTION, STEERING)
)
"""The same motors on an EPOS4 50/5."""


class Aborted(Exception):
    """The node refused a request."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"0x{code:08X}")


class Rig:
    def __init__(self, drive: Drive = TRACTION, *, boot: bool = True, settings: SimSettings | None = None) -> None:
        self.axis = Axis(drive)
        self.node = simulated_drive(drive, self.axis, name="rig", settings=settings)
        self.id = drive.node_id
        self.now = 0.0
        self.heard: list[tuple[float, Frame]] = []
        self.node.power_on(0.0)
        if boot:
            self.run(self.node.boot_time + 0.01)
            self.heard.clear()

    def run(self, seconds: float) -> None:
        """Let time pass in steps of 1 ms."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.axis.step(STEP)
            self.node.advance(self.now)
            self._drain()

    def send(self, identifier: int, data: bytes = b"", *, rtr: bool = False) -> None:
        self.node.receive(Frame(identifier, data, rtr), self.now)
        self._drain()

    def _drain(self) -> None:
        self.heard += self.node.outbox
        self.node.outbox.clear()

    def take(self, identifier: int) -> list[bytes]:
        """Data of all frames with this identifier since the last call."""
        self._drain()
        found = [frame.data for _, frame in self.heard if frame.id == identifier]
        self.heard = [item for item in self.heard if item[1].id != identifier]
        return found

    def emergencies(self) -> list[int]:
        return [int.from_bytes(data[:2], "little") for data in self.take(0x80 + self.id)]

    def request(self, data: bytes) -> bytes:
        """One SDO frame there and one back."""
        self.send(0x600 + self.id, data.ljust(8, b"\0"))
        (answer,) = self.take(0x580 + self.id)
        if answer[0] == 0x80:
            raise Aborted(int.from_bytes(answer[4:], "little"))
        return answer

    def write(self, index: int, sub: int, code: str, value: int) -> None:
        """Expedited write; `code` is the type as the struct module names it."""
        data = struct.pack("<" + code, value)
        self.request(struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, sub) + data)

    def read(self, index: int, sub: int, code: str) -> int:
        answer = self.request(struct.pack("<BHB", 0x40, index, sub))
        size = struct.calcsize("<" + code)
        assert answer[0] == 0x43 | (4 - size) << 2
        (value,) = struct.unpack_from("<" + code, answer, 4)
        assert isinstance(value, int)
        return value

    def refusal(self, index: int, sub: int, code: str, value: int) -> int:
        """Abort code of a write; 0 when it was taken."""
        try:
            self.write(index, sub, code, value)
        except Aborted as aborted:
            return aborted.code
        return 0

    def nmt(self, command: int, node: int = 0) -> None:
        self.send(0x000, bytes((command, node)))

    def control(self, word: int) -> None:
        self.write(0x6040, 0, "H", word)

    def state(self) -> DriveState:
        return self.node.state

    @property
    def status(self) -> int:
        return self.read(0x6041, 0, "H")

    def enable(self, mode: int = 3) -> None:
        self.write(0x6060, 0, "b", mode)
        self.control(0x0006)
        self.control(0x000F)
        self.run(0.012)
        assert self.status & 0x006F == 0x0027

    @property
    def epos4(self) -> SimEpos4:
        assert isinstance(self.node, SimEpos4)
        return self.node

    def map_target(self, index: int) -> None:
        """The first PDO that it receives carries this target [i32], and acts at SYNC; the node becomes operational."""
        self.nmt(0x80)
        self.map(0x1600, index << 16 | 0x20)
        self.write(0x1400, 2, "B", 1)
        self.nmt(0x01)

    def set_point(self, target: int) -> None:
        """A target in that PDO, and SYNC."""
        self.send(0x200 + self.id, struct.pack("<i", target))
        self.send(0x080)

    def map(self, index: int, *objects: int) -> None:
        """Change a mapping the way a client must."""
        self.write(index, 0, "B", 0)
        for place, mapped in enumerate(objects):
            self.write(index, place + 1, "I", mapped)
        self.write(index, 0, "B", len(objects))
