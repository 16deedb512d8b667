"""The `canopen` package as client of a simulated EPOS4, and of a bus with two generations. Time is virtual."""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from canopen.pdo import PdoMap
from canopen.profiles.p402 import BaseNode402
from canopen.sdo.exceptions import SdoAbortedError
from epos4_table import Known, described4, known
from test_canopen_drives_sim_epos import Wire, described, made_of, robot_drives

from artemis.drive_schema import Drive
from artemis.drive_states import DriveState, Nmt
from artemis.sim.epos4 import SimEpos4

READ_ONLY, NOT_MAPPABLE, TOO_LONG, TOO_SHORT = 0x06010002, 0x06040041, 0x06070010, 0x06070013
RANGE, NOT_NOW, NMT_STATE, VALID, ABSENT = 0x06090030, 0x08000022, 0x0F00FFC0, 0x06010000, 0x06020000
SIGNED = ("i8", "i16", "i32")


def epos4(name: str, **changes: object) -> Drive:
    """A drive of the robot file, as an EPOS4 50/5."""
    drive = robot_drives()[name]
    motor = drive.motor.model_copy(update={"torque_constant_mnm_per_a": 70.5})
    return drive.model_copy(update={"family": "epos4", "hardware_version": 0x6150, "motor": motor, **changes})


@pytest.fixture
def network() -> Wire:
    return made_of({"traction-left": epos4("traction-left")})


@pytest.fixture
def node(network: Wire) -> BaseNode402:
    made = BaseNode402(1, described4())
    network.add_node(made)
    return made


@pytest.fixture
def drive(network: Wire) -> SimEpos4:
    (drive,) = network.drives
    assert isinstance(drive, SimEpos4)
    return drive


def abort_of(node: BaseNode402, index: int, sub: int, data: bytes) -> int:
    """The abort code of a write; 0: it was taken."""
    try:
        node.sdo.download(index, sub, data)
    except SdoAbortedError as aborted:
        return int(aborted.code)
    return 0


# ---------------------------------------------------------------------------------------------- objects


def test_every_object_has_its_type_its_default_and_its_access(node: BaseNode402) -> None:
    wrong = []
    for entry in known(1):
        data = node.sdo.upload(entry.at, entry.sub)
        if entry.size and len(data) != entry.size:
            wrong.append((entry, data, "length"))
        elif entry.default is not None:
            present = int.from_bytes(data, "little", signed=entry.type in SIGNED)
            if present != entry.default:
                wrong.append((entry, data, "default"))
        if not entry.access.startswith("rw") and abort_of(node, entry.at, entry.sub, data) != READ_ONLY:
            wrong.append((entry, data, "access"))
    assert not wrong


def test_every_object_refuses_what_is_too_long_or_too_short(node: BaseNode402) -> None:
    for entry in known(1):
        if not entry.access.startswith("rw"):
            continue
        data = node.sdo.upload(entry.at, entry.sub)
        assert abort_of(node, entry.at, entry.sub, data + b"\0") == TOO_LONG, entry
        if entry.size > 1:
            assert abort_of(node, entry.at, entry.sub, data[:-1]) == TOO_SHORT, entry


def test_every_object_is_mappable_as_it_should_be(node: BaseNode402) -> None:
    node.sdo.download(0x1600, 0, b"\0")
    node.sdo.download(0x1A00, 0, b"\0")
    for entry in known(1):
        if not entry.size or (entry.sub == 0 and entry.at < 0x2000):
            continue
        received, sent = [abort_of(node, index, 1, struct.pack("<I", entry.mapping)) for index in (0x1600, 0x1A00)]
        assert received == (0 if entry.access == "rwwP" else NOT_MAPPABLE), entry
        assert sent == (0 if entry.access.endswith("P") else NOT_MAPPABLE), entry


def test_what_only_the_first_generation_has_is_not_there(node: BaseNode402) -> None:
    for index in (
        0x1020,
        0x100C,
        0x100D,
        0x2003,
        0x2008,
        0x200C,
        0x2028,
        0x2062,
        0x207C,
        0x2210,
        0x6078,
        0x6410,
        0x60F6,
    ):
        with pytest.raises(SdoAbortedError) as caught:
            node.sdo.upload(index, 0)
        assert caught.value.code == ABSENT


def test_it_says_who_it_is(node: BaseNode402) -> None:
    assert node.sdo[0x1008].raw == "EPOS4"
    assert node.sdo[0x1018][1].raw == 0xFB
    assert node.sdo[0x1018][2].raw == 0x61500000
    assert node.sdo[0x1018][3].raw == 0x01700000


@pytest.mark.parametrize(
    ("index", "sub", "data"),
    [
        (0x605A, 0, b"\x05\0"),
        (0x6007, 0, b"\0\0"),
        (0x605E, 0, b"\x03\0"),
        (0x6066, 0, b"\x01\0"),
        (0x607B, 1, b"\x01\0\0\0"),
        (0x60A8, 0, bytes(4)),
        (0x60AA, 0, bytes(4)),
        (0x60C2, 1, b"\x65"),
        (0x6060, 0, b"\x07"),
        (0x6060, 0, b"\xff"),
        (0x6086, 0, b"\x01\0"),
        (0x6098, 0, b"\x23"),
        (0x2001, 0, b"\x05"),
        (0x1029, 1, b"\x02"),
    ],
)
def test_values_that_it_does_not_take_are_out_of_range(node: BaseNode402, index: int, sub: int, data: bytes) -> None:
    assert abort_of(node, index, sub, data) == RANGE


# ---------------------------------------------------------------------------------------------- device states


def test_the_generic_402_client_drives_it_in_profile_velocity_mode(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    assert node.state == "OPERATION ENABLED"
    node.sdo[0x60FF].raw = 1000
    node.controlword = 0x000F
    network.run(0.3)
    assert node.sdo[0x606C].raw == 1000
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


def test_the_generic_402_client_moves_it_in_profile_position_mode(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.sdo[0x607A].raw = 720
    node.controlword = 0x003F
    assert node.sdo[0x6041].raw & 0x1000, "acknowledged"
    network.run(1.5)
    assert node.sdo[0x6064].raw == 720
    assert node.sdo[0x6041].raw & 0x0400


def test_the_clients_homing_works_with_method_37(network: Wire, node: BaseNode402) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.sdo[0x6098].raw = 37
    node.sdo[0x30B0].raw = 4711
    assert node.homing(timeout=1)
    assert node.sdo[0x6064].raw == 4711
    assert node.sdo[0x6041].raw & 0x8000


def test_an_emergency_arrives_and_the_fault_can_be_reset(network: Wire, node: BaseNode402, drive: SimEpos4) -> None:
    node.setup_402_state_machine(read_pdos=False)
    drive.emergency(0x2310, network.now)
    network.run(0.005)
    assert [error.code for error in node.emcy.active] == [0x2310]
    assert node.sdo[0x603F].raw == 0x2310
    assert node.state == "FAULT"
    node.state = "SWITCH ON DISABLED"
    assert node.state == "SWITCH ON DISABLED"
    assert node.emcy.active == []


def test_a_lost_heartbeat_needs_a_communication_reset_before_the_fault_reset(
    network: Wire, node: BaseNode402, drive: SimEpos4
) -> None:
    node.setup_402_state_machine(read_pdos=False)
    node.sdo[0x1016][1].raw = 127 << 16 | 100
    network.nmt.state = "OPERATIONAL"
    network.send_message(0x77F, b"\x05")
    node.op_mode = "PROFILED VELOCITY"
    node.state = "OPERATION ENABLED"
    network.run(0.2)
    assert [error.code for error in node.emcy.active] == [0x8130]
    assert drive.nmt is Nmt.PRE_OPERATIONAL, "0x1029:1 is 0"
    network.run(0.1)
    for _ in range(2):
        assert node.sdo[0x6041].raw & 0x6F == 0x08
        node.sdo[0x6040].raw = 0x80
    network.nmt.send_command(0x82)
    network.run(0.25)
    assert node.sdo[0x1016][1].raw == 0, "what was not stored is lost"
    node.sdo[0x6040].raw = 0
    node.sdo[0x6040].raw = 0x80
    assert drive.state is DriveState.SWITCH_ON_DISABLED


# ---------------------------------------------------------------------------------------------- process data


def cyclic(network: Wire, node: BaseNode402, mode: int, target: int, period_ms: int) -> PdoMap:
    """One RxPDO with controlword and target on SYNC, one TxPDO with status and position; enabled at target 0."""
    node.tpdo.read()
    node.rpdo.read()
    assert [node.rpdo[number].enabled for number in (1, 2, 3, 4)] == [True] * 4, "as from the factory"
    sent: PdoMap = node.tpdo[1]
    received: PdoMap = node.rpdo[1]
    for pdo, objects in ((sent, (0x6041, 0x6064)), (received, (0x6040, target))):
        pdo.clear()
        for index in objects:
            pdo.add_variable(index)
        pdo.trans_type = 1
        pdo.save()
    for number in (2, 3, 4):
        node.rpdo[number].enabled = False
        node.rpdo[number].save()
    node.sdo[0x6060].raw = mode
    node.sdo[0x60C2][1].raw = period_ms
    network.nmt.state = "OPERATIONAL"
    for word in (0x06, 0x0F):
        received[0x6040].raw, received[target].raw = word, 0
        beat(network, received, 0.02)
    return received


def beat(network: Wire, received: PdoMap, period: float) -> None:
    """One cycle of a host: set-point, SYNC, and the wait for the next."""
    received.transmit()
    network.sync.transmit()
    network.run(period - 0.002)


def test_cyclic_position_follows_set_points_evenly(network: Wire, node: BaseNode402, drive: SimEpos4) -> None:
    node.sdo[0x6065].raw = 100000
    received = cyclic(network, node, 8, 0x607A, 20)
    assert node.sdo[0x6061].raw == 8
    speeds = []
    for step in range(40):
        received[0x607A].raw = 12 * step
        beat(network, received, 0.02)
        speeds.append(drive.axis.velocity)
    assert speeds[20:] == pytest.approx([500.0] * 20, rel=0.02), "12 counts of 72 in 20 ms"
    assert node.sdo[0x6041].raw & 0x1000, "the drive follows"
    assert node.emcy.active == []


def test_a_set_point_without_interpolation_is_a_step(network: Wire, node: BaseNode402, drive: SimEpos4) -> None:
    received = cyclic(network, node, 8, 0x607A, 0)
    speeds = []
    for step in range(10):
        received[0x607A].raw = 60 * step
        received.transmit()
        network.sync.transmit()
        for _ in range(38):
            network.run(0.001)
            speeds.append(drive.axis.velocity)
    assert max(speeds) > 1.5 * (60 * 60 / 72 / 0.04), "much faster than on average"
    network.run(1.0)
    assert node.emcy.active == [], "nothing is overdue"


def test_cyclic_velocity_ramps_within_one_period(network: Wire, node: BaseNode402, drive: SimEpos4) -> None:
    received = cyclic(network, node, 9, 0x60FF, 20)
    demands = []
    for target in (100, 200, 300):
        received[0x60FF].raw = target
        received.transmit()
        network.sync.transmit()
        for _ in range(18):
            network.run(0.001)
            demands.append(drive.axis.demand_velocity)
    steps = [after - before for before, after in pairwise(demands)]
    assert max(steps) == pytest.approx(5.0 * 2, abs=5.1), "100 rpm in 20 ms are 5 rpm a millisecond; two at a SYNC"
    assert min(steps) > 0.0


def test_a_missed_set_point_is_an_error_of_the_class_of_lost_connections(
    network: Wire, node: BaseNode402, drive: SimEpos4
) -> None:
    received = cyclic(network, node, 9, 0x60FF, 20)
    received[0x60FF].raw = 1000
    for _ in range(20):
        beat(network, received, 0.02)
    assert node.emcy.active == []
    network.run(0.045)
    assert [error.code for error in node.emcy.active] == [0x8250]
    assert drive.axis.velocity > 100.0, "0x6007 is 3: the quick-stop ramp"
    network.run(0.5)
    assert node.sdo[0x6041].raw & 0x6F == 0x08
    node.sdo[0x6040].raw = 0x80
    assert drive.state is DriveState.SWITCH_ON_DISABLED, "no reset of the communication is needed"


def test_torque_needs_the_torque_constant(network: Wire, node: BaseNode402, drive: SimEpos4) -> None:
    assert node.sdo[0x6076].raw == 0
    node.sdo[0x6071].raw = 200
    node.sdo[0x6060].raw = 10
    node.sdo[0x6040].raw = 0x06
    node.sdo[0x6040].raw = 0x0F
    network.run(0.1)
    assert (drive.axis.current, node.sdo[0x6077].raw) == (0.0, 0)
    node.sdo[0x3001][5].raw = 70500
    assert node.sdo[0x6076].raw == 352500, "5 A at 70.5 mN·m/A, in µN·m"
    node.sdo[0x6071].raw = 200
    network.run(0.1)
    assert node.sdo[0x30D1][2].raw == 1000
    assert node.sdo[0x6077].raw == 200


def test_an_identifier_changes_only_while_its_pdo_is_not_valid(node: BaseNode402) -> None:
    old, new = 0x201, 0x222
    assert abort_of(node, 0x1400, 1, struct.pack("<I", new)) == VALID
    assert abort_of(node, 0x1400, 1, struct.pack("<I", 0x80000000 | new)) == VALID
    for cob_id in (0x80000000 | old, 0x80000000 | new, new):
        assert abort_of(node, 0x1400, 1, struct.pack("<I", cob_id)) == 0
    assert node.sdo[0x1400][1].raw == new


def test_twelve_objects_fit_a_mapping_and_only_in_pre_operational(network: Wire, node: BaseNode402) -> None:
    node.sdo.download(0x1A03, 0, b"\0")
    for place in range(12):
        assert abort_of(node, 0x1A03, place + 1, struct.pack("<I", 0x60610008)) == 0
    assert abort_of(node, 0x1A03, 0, b"\x0c") == 0x06040042, "96 bits"
    assert abort_of(node, 0x1A03, 0, b"\x08") == 0
    assert abort_of(node, 0x1A03, 0, b"\x0d") == RANGE
    network.nmt.state = "OPERATIONAL"
    assert abort_of(node, 0x1A03, 0, b"\0") == NMT_STATE


# ---------------------------------------------------------------------------------------------- two generations


def test_two_generations_share_a_bus(network: Wire) -> None:
    drives = {"traction-left": epos4("traction-left"), "steer-left": robot_drives()["steer-left"]}
    network = made_of(drives)
    network.scanner.reset()
    network.scanner.search()
    assert sorted(network.scanner.nodes) == [1, 3]
    fourth, first = BaseNode402(1, described4()), BaseNode402(3, described())
    for node in (fourth, first):
        network.add_node(node)
        node.setup_402_state_machine(read_pdos=False)
    assert (fourth.sdo[0x1008].raw, first.sdo[0x1008].raw) == ("EPOS4", "EPOS")
    fourth.op_mode = "PROFILED VELOCITY"
    first.op_mode = "PROFILED POSITION"
    for node in (fourth, first):
        node.state = "OPERATION ENABLED"
    assert fourth.sdo[0x6041].raw & 0x4100 == 0
    assert first.sdo[0x6041].raw & 0x4100 == 0x0100


def test_rows_are_read(node: BaseNode402) -> None:
    """The table itself: types of CiA 301, no object twice."""
    entries = list(known(1))
    assert len(entries) > 350
    assert len({(entry.at, entry.sub) for entry in entries}) == len(entries)
    assert Known(0x3001, 2, "u32", "rwwP", 15000) in entries
