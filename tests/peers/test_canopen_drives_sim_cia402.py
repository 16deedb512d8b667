"""The `canopen` package's client of the profile CiA 402 with a simulated drive of it. Time is virtual."""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402, OperationMode
from canopen.sdo.exceptions import SdoAbortedError
from test_canopen_drives_sim_epos import Wire, described, made_of

from artemis.drive_schema import Drive
from artemis.drive_states import DriveState
from artemis.vehicle import RobotFile

FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis_cia402.yaml"
DRIVES = RobotFile.model_validate(yaml.safe_load(FILE.read_text(encoding="utf-8"))).drives
HOST = 127


def node_of(network: Wire, drive: Drive) -> BaseNode402:
    """The client of a drive, which knows the profile's objects and those of the robot file."""
    od = described()
    for index, sub, kind in (
        (0x1016, 1, datatypes.UNSIGNED32),
        (0x1029, 1, datatypes.UNSIGNED8),
        (0x2401, 1, datatypes.INTEGER16),
        (0x60C2, 1, datatypes.UNSIGNED8),
    ):
        record = ODRecord(f"record {index:04X}", index)
        member = ODVariable(f"object {index:04X}:{sub}", index, sub)
        member.data_type = kind
        record.add_member(member)
        od.add_object(record)
    for index in (0x6007, 0x605A, 0x605E):
        made = ODVariable(f"object {index:04X}", index, 0)
        made.data_type = datatypes.INTEGER16
        od.add_object(made)
    node = BaseNode402(drive.node_id, od)
    network.add_node(node)
    return node


@pytest.fixture
def network() -> Wire:
    return made_of({name: DRIVES[name] for name in ("traction-left", "steer-left")})


def test_a_scan_finds_drives_and_each_says_who_it_is(network: Wire) -> None:
    network.scanner.reset()
    network.scanner.search()
    assert sorted(network.scanner.nodes) == [1, 3]
    for name in ("traction-left", "steer-left"):
        identity = node_of(network, DRIVES[name]).sdo[0x1018]
        assert [identity[sub].raw for sub in (1, 2, 3)] == [0x12345678, DRIVES[name].hardware_version, 0x00010004]


def test_the_client_drives_in_profile_velocity_mode_in_the_drive_s_units(network: Wire) -> None:
    node = node_of(network, DRIVES["traction-left"])
    node.setup_402_state_machine(read_pdos=False)
    node.sdo[0x605A].raw = 6
    node.op_mode = "PROFILED VELOCITY"
    assert node.is_faulted() is False
    node.state = "OPERATION ENABLED"
    node.sdo[0x60FF].raw = 10000
    node.controlword = 0x000F
    network.run(0.3)
    assert node.sdo[0x606C].raw == 10000, "1000 rpm in tenths"
    before = node.sdo[0x6064].raw
    network.run(1.0)
    assert node.sdo[0x6064].raw - before == pytest.approx(1.001 * 1200, abs=3)
    node.state = "QUICK STOP ACTIVE"
    network.run(0.5)
    assert node.state == "QUICK STOP ACTIVE"
    assert node.sdo[0x606C].raw == 0
    node.state = "OPERATION ENABLED"
    node.state = "SWITCH ON DISABLED"
    assert node.sdo[0x6041].raw & 0x6F == 0x40


def test_modes_that_the_drive_does_not_support_are_not_there(network: Wire) -> None:
    node = node_of(network, DRIVES["traction-left"])
    node.setup_402_state_machine(read_pdos=False)
    supported = {mode for mode in OperationMode.SUPPORTED if mode != "NO MODE" and node.is_op_mode_supported(mode)}
    assert supported == {"PROFILED VELOCITY", "CYCLIC SYNCHRONOUS POSITION", "CYCLIC SYNCHRONOUS VELOCITY"}


def test_a_quick_stop_may_end_in_switch_on_disabled(network: Wire) -> None:
    node = node_of(network, DRIVES["traction-left"])
    node.setup_402_state_machine(read_pdos=False)
    assert node.sdo[0x605A].raw == 2, "as from the factory"
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    node.controlword = 0x0002
    network.run(0.1)
    assert node.state == "SWITCH ON DISABLED"


def test_the_client_leads_it_in_cyclic_position_mode_over_its_pdos(network: Wire) -> None:
    node = node_of(network, DRIVES["steer-left"])
    node.tpdo.read()
    node.rpdo.read()
    sent, received = node.tpdo[1], node.rpdo[1]
    for pdo, objects in ((sent, (0x6041, 0x6064, 0x6061)), (received, (0x6040, 0x607A))):
        pdo.clear()
        for index in objects:
            pdo.add_variable(index)
        pdo.trans_type = 1
        pdo.save()
    for number in (2, 3, 4):
        node.rpdo[number].enabled = False
        node.rpdo[number].save()
    node.sdo[0x6060].raw = 8
    node.sdo[0x60C2][1].raw = 20
    network.nmt.state = "OPERATIONAL"
    targets = [0, 0, *(40 * step for step in range(30))]
    for number, target in enumerate(targets):
        received[0x6040].raw, received[0x607A].raw = 0x06 if not number else 0x0F, target
        received.transmit()
        network.sync.transmit()
        network.run(0.018)
    assert (sent[0x6041].raw & 0x6F, sent[0x6061].raw) == (0x27, 8)
    assert sent[0x6064].raw == pytest.approx(targets[-2], abs=60)
    assert network.drives[1].axis.velocity == pytest.approx(40 / 2000 / 0.02 * 60, rel=0.05), "evenly"


def test_a_lost_heartbeat_is_an_emergency_and_a_fault_that_is_reset(network: Wire) -> None:
    node = node_of(network, DRIVES["traction-left"])
    node.setup_402_state_machine(read_pdos=False)
    node.sdo[0x6007].raw = 1
    node.sdo[0x1029][1].raw = 1
    node.sdo[0x1016][1].raw = HOST << 16 | 100
    network.nmt.state = "OPERATIONAL"
    network.send_message(0x700 + HOST, b"\x05")
    network.run(0.2)
    assert [(error.code, error.register) for error in node.emcy.active] == [(0x8130, 0x10)]
    assert node.state == "FAULT"
    node.state = "SWITCH ON DISABLED"
    assert network.drives[0].state is DriveState.SWITCH_ON_DISABLED
    assert node.emcy.active == []


@pytest.mark.parametrize(
    ("index", "data", "code"),
    [
        (0x2003, b"\0\0", 0x06020000),
        (0x6041, b"\0\0", 0x06010002),
        (0x605A, b"\x09\0", 0x06090030),
        (0x6060, b"\x06", 0x06090030),
        (0x6083, b"\0", 0x06070013),
        (0x6083, b"\0\0\0\0", 0x06090032),
    ],
)
def test_aborts_are_understood(network: Wire, index: int, data: bytes, code: int) -> None:
    node = node_of(network, DRIVES["traction-left"])
    with pytest.raises(SdoAbortedError) as caught:
        node.sdo.download(index, 0, data)
    assert caught.value.code == code
