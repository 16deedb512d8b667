"""The `canopen` package, which nobody here wrote, as client of a simulated drive. The wire is a call, time virtual."""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

import struct
from operator import itemgetter
from pathlib import Path

import canopen
import pytest
import yaml
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402
from canopen.sdo.exceptions import SdoAbortedError

from artemis.devices.can_bus import Frame
from artemis.drive_schema import Drive
from artemis.drive_states import DriveState, Nmt
from artemis.sim.axis import Axis
from artemis.sim.drive_node import simulated_drive
from artemis.sim.epos import SimEpos
from artemis.vehicle import RobotFile

STEP = 0.001
ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"

VARIABLES = {
    0x1000: datatypes.UNSIGNED32,
    0x1001: datatypes.UNSIGNED8,
    0x1008: datatypes.VISIBLE_STRING,
    0x1017: datatypes.UNSIGNED16,
    0x2004: datatypes.UNSIGNED64,
    0x2020: datatypes.UNSIGNED16,
    0x6040: datatypes.UNSIGNED16,
    0x6041: datatypes.UNSIGNED16,
    0x6060: datatypes.INTEGER8,
    0x6061: datatypes.INTEGER8,
    0x6064: datatypes.INTEGER32,
    0x606C: datatypes.INTEGER32,
    0x6078: datatypes.INTEGER16,
    0x607F: datatypes.UNSIGNED32,
    0x6098: datatypes.INTEGER8,
    0x2081: datatypes.INTEGER32,
    0x6402: datatypes.UNSIGNED16,
    0x6502: datatypes.UNSIGNED32,
    0x607A: datatypes.INTEGER32,
    0x60FF: datatypes.INTEGER32,
}


def described() -> canopen.ObjectDictionary:
    """As much of the drive's objects as the client needs to know."""
    od = canopen.ObjectDictionary()

    def variable(index: int, sub: int, kind: int) -> ODVariable:
        made = ODVariable(f"object {index:04X}:{sub}", index, sub)
        made.data_type = kind
        return made

    for index, kind in VARIABLES.items():
        od.add_object(variable(index, 0, kind))
    identity = ODRecord("identity", 0x1018)
    for sub in range(1, 5):
        identity.add_member(variable(0x1018, sub, datatypes.UNSIGNED32))
    od.add_object(identity)
    for number in range(4):
        for base, subs in ((0x1400, (1, 2)), (0x1800, (1, 2, 3))):
            record = ODRecord(f"parameters {base + number:04X}", base + number)
            record.add_member(variable(base + number, 0, datatypes.UNSIGNED8))
            for sub in subs:
                kind = (datatypes.UNSIGNED32, datatypes.UNSIGNED8, datatypes.UNSIGNED16)[sub - 1]
                record.add_member(variable(base + number, sub, kind))
            od.add_object(record)
        for base in (0x1600, 0x1A00):
            mapping = ODRecord(f"mapping {base + number:04X}", base + number)
            mapping.add_member(variable(base + number, 0, datatypes.UNSIGNED8))
            for sub in range(1, 9):
                mapping.add_member(variable(base + number, sub, datatypes.UNSIGNED32))
            od.add_object(mapping)
    return od


class Wire(canopen.Network):
    """A network whose frames reach the simulated drives at once, and whose clock is moved by traffic."""

    def __init__(self, *drives: SimEpos) -> None:
        super().__init__()
        self.drives = drives
        self.now = 0.0
        for drive in drives:
            drive.power_on(0.0)

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        for drive in self.drives:
            drive.receive(Frame(can_id, bytes(data or b""), remote), self.now)
        self.run(STEP)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for drive in self.drives:
                drive.axis.step(STEP)
                drive.advance(self.now)
            self._deliver()

    def _deliver(self) -> None:
        waiting = [(ready, drive.name, frame) for drive in self.drives for ready, frame in drive.outbox]
        for drive in self.drives:
            drive.outbox.clear()
        for ready, _, frame in sorted(waiting, key=itemgetter(0, 1)):
            assert ready <= self.now
            self.notify(frame.id, bytearray(frame.data), ready)


def robot_drives() -> dict[str, Drive]:
    """The drives of the robot file."""
    return RobotFile.model_validate(yaml.safe_load(ROBOT.read_text(encoding="utf-8"))).drives


def made_of(drives: dict[str, Drive], *, booted: bool = True) -> Wire:
    """These drives on a wire."""
    nodes = [simulated_drive(drive, Axis(drive), name=name) for name, drive in drives.items()]
    network = Wire(*nodes)
    if booted:
        network.run(max(node.boot_time for node in nodes) + 0.01)
    return network


def wire(*names: str, booted: bool = True) -> Wire:
    drives = robot_drives()
    return made_of({name: drives[name] for name in names}, booted=booted)


@pytest.fixture
def network() -> Wire:
    return wire("traction-left")


@pytest.fixture
def node(network: Wire) -> BaseNode402:
    made = BaseNode402(1, described())
    network.add_node(made)
    return made


def test_a_scan_finds_all_drives() -> None:
    network = wire("traction-left", "traction-right", "steer-left", "steer-right")
    network.scanner.reset()
    network.scanner.search()
    assert sorted(network.scanner.nodes) == [1, 2, 3, 4]


def test_the_boot_up_is_seen_as_pre_operational() -> None:
    network = wire("traction-left", booted=False)
    node = BaseNode402(1, described())
    network.add_node(node)
    network.run(0.06)
    assert node.nmt.state == "PRE-OPERATIONAL"


def test_identity_and_segmented_objects_are_read(node: BaseNode402) -> None:
    assert node.sdo[0x1018][1].raw == 0xFB
    assert node.sdo[0x1018][2].raw == 0x62100000
    assert node.sdo[0x1018][3].raw == 0x20330000
    assert node.sdo[0x1008].raw == "EPOS"
    assert node.sdo[0x2004].raw == 1
    assert node.sdo.upload(0x2004, 0) == (1).to_bytes(8, "little")


def test_objects_are_written_expedited_and_in_segments(node: BaseNode402) -> None:
    node.sdo[0x60FF].raw = -1234
    assert node.sdo[0x60FF].raw == -1234
    node.sdo.download(0x60FF, 0, struct.pack("<i", 99), force_segment=True)
    assert node.sdo[0x60FF].raw == 99


@pytest.mark.parametrize(
    ("index", "data", "code"),
    [
        (0x3000, b"\0", 0x06020000),
        (0x6041, b"\0\0", 0x06010002),
        (0x607F, struct.pack("<I", 25001), 0x06090031),
        (0x6081, b"\0", 0x06070013),
    ],
)
def test_aborts_are_understood(node: BaseNode402, index: int, data: bytes, code: int) -> None:
    with pytest.raises(SdoAbortedError) as caught:
        node.sdo.download(index, 0, data)
    assert caught.value.code == code


def test_the_generic_402_client_enables_drives_and_disables(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    assert network.drives[0].state is DriveState.OPERATION_ENABLE
    node.sdo[0x60FF].raw = 1000
    node.controlword = 0x000F
    network.run(0.3)
    assert node.sdo[0x606C].raw in (833, 1667)
    before = node.sdo[0x6064].raw
    network.run(1.0)
    # 1000 rpm of 72 counts each, for 1 s and the two requests
    assert node.sdo[0x6064].raw - before == pytest.approx(1.001 * 1200, abs=3)
    node.state = "QUICK STOP ACTIVE"
    network.run(0.5)
    assert node.state == "QUICK STOP ACTIVE"
    node.state = "SWITCH ON DISABLED"
    assert node.sdo[0x6041].raw & 0x417F == 0x0140


def test_an_emergency_arrives_and_the_fault_can_be_reset(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    network.drives[0].emergency(0x8130, network.now)
    network.run(0.005)
    assert [error.code for error in node.emcy.active] == [0x8130]
    assert [error.register for error in node.emcy.log] == [0x10]
    assert node.state == "FAULT"
    node.state = "SWITCH ON DISABLED"
    assert node.state == "SWITCH ON DISABLED"
    assert node.emcy.active == []


def test_the_clients_pdo_configuration_is_accepted_and_carries_data(network: Wire, node: BaseNode402) -> None:
    node.tpdo.read()
    node.rpdo.read()
    assert [node.tpdo[number].enabled for number in (1, 2, 3, 4)] == [True, False, False, False]
    sent = node.tpdo[1]
    sent.clear()
    sent.add_variable(0x6041)
    sent.add_variable(0x6064)
    sent.trans_type = 1
    sent.save()
    received = node.rpdo[4]
    received.trans_type = 1
    received.save()
    node.sdo[0x6060].raw = 3
    network.nmt.state = "OPERATIONAL"
    assert network.drives[0].nmt is Nmt.OPERATIONAL
    for word, target in ((0x06, 0), (0x0F, 0), (0x0F, 600)):
        received[0x6040].raw, received[0x60FF].raw = word, target
        received.transmit()
        network.sync.transmit()
        network.run(0.02)
    network.run(0.5)
    network.sync.transmit()
    assert sent[0x6041].raw & 0x417F == 0x0137
    assert sent[0x6064].raw == pytest.approx(0.5 * 600 * 72 / 60, abs=20)


def test_heartbeats_tell_the_clients_node_state(network: Wire, node: BaseNode402) -> None:
    states: list[int] = []
    node.nmt.add_heartbeat_callback(states.append)
    node.sdo[0x1017].raw = 100
    network.run(0.15)
    node.nmt.state = "OPERATIONAL"
    network.run(0.1)
    node.nmt.state = "STOPPED"
    network.run(0.1)
    assert states[0] == 0x7F
    assert states[-2:] == [0x05, 0x04]


def test_the_clients_homing_works_with_method_35(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.sdo[0x6098].raw = 35
    node.sdo[0x2081].raw = 4711
    assert node.homing(timeout=1)
    assert node.sdo[0x6064].raw == 4711
