from __future__ import annotations

import pytest
from sim_epos_rig import Aborted, Rig

from artemis.sim.epos_sdo import SdoServer
from artemis.sim.epos_settings import SimSettings


def test_the_statusword_is_read_as_in_the_communication_guide() -> None:
    rig = Rig()
    assert rig.request(bytes.fromhex("40 41 60 00")) == bytes.fromhex("4B 41 60 00 40 01 00 00")


def test_a_controlword_is_written_as_in_the_communication_guide() -> None:
    rig = Rig()
    assert rig.request(bytes.fromhex("2B 40 60 00 06 00 00 00")) == bytes.fromhex("60 40 60 00 00 00 00 00")


def test_an_unknown_object_is_refused_with_its_place() -> None:
    rig = Rig()
    rig.send(0x602, bytes.fromhex("40 00 30 07 00 00 00 00"))
    assert rig.take(0x582) == [bytes.fromhex("80 00 30 07 00 00 02 06")]


@pytest.mark.parametrize(("index", "sub", "size"), [(0x1001, 0, 1), (0x6041, 0, 2), (0x1000, 0, 4), (0x1008, 0, 4)])
def test_an_expedited_answer_tells_its_length(index: int, sub: int, size: int) -> None:
    answer = Rig().request(bytes((0x40, index & 0xFF, index >> 8, sub)))
    assert answer[0] == {1: 0x4F, 2: 0x4B, 4: 0x43}[size]
    assert answer[4 + size :] == bytes(4 - size)


def test_the_device_name_fits_one_frame() -> None:
    assert Rig().request(bytes.fromhex("40 08 10 00"))[4:] == b"EPOS"


def test_the_serial_number_comes_in_segments() -> None:
    rig = Rig()
    assert rig.request(bytes.fromhex("40 04 20 00")) == bytes.fromhex("41 04 20 00 08 00 00 00")
    first, second = rig.request(b"\x60"), rig.request(b"\x70")
    assert first[0] == 0x00
    assert second[0] == 0x10 | 6 << 1 | 1
    assert int.from_bytes(first[1:] + second[1:2], "little") == 12345678


def test_a_segment_with_the_wrong_toggle_is_refused_and_ends_the_transfer() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("40 04 20 00"))
    rig.send(0x602, b"\x70" + bytes(7))
    assert rig.take(0x582) == [bytes.fromhex("80 04 20 00 00 00 03 05")]
    with pytest.raises(Aborted, match="0x05040001"):
        rig.request(b"\x60")


def test_a_number_can_be_written_in_segments() -> None:
    rig = Rig()
    assert rig.request(bytes.fromhex("21 FF 60 00 04 00 00 00"))[0] == 0x60
    assert rig.request(bytes.fromhex("07") + (-1234).to_bytes(4, "little", signed=True) + b"\0\0\0")[0] == 0x20
    assert rig.node.read(0x60FF) == -1234


def test_segments_must_add_up_to_what_was_announced() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("21 FF 60 00 08 00 00 00"))
    with pytest.raises(Aborted, match="0x06070010"):
        rig.request(bytes.fromhex("07 01 02 03 04 00 00 00"))


def test_an_endless_segmented_write_is_cut_off() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("20 FF 60 00"))
    for count in range(9):
        rig.request(bytes((0x10 * (count % 2),)) + bytes(7))
    with pytest.raises(Aborted, match="0x06070012"):
        rig.request(b"\x10")


def test_a_segmented_write_to_a_constant_is_refused_at_its_start() -> None:
    with pytest.raises(Aborted, match="0x06010002"):
        Rig().request(bytes.fromhex("21 04 20 00 08 00 00 00"))


def test_a_new_request_replaces_a_transfer_under_way() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("40 04 20 00"))
    assert rig.read(0x6060, 0, "b") == 1
    with pytest.raises(Aborted, match="0x05040001"):
        rig.request(b"\x60")


def test_a_clients_abort_is_not_answered_and_ends_the_transfer() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("40 04 20 00"))
    rig.send(0x602, bytes.fromhex("80 04 20 00 00 00 04 05"))
    assert rig.take(0x582) == []
    with pytest.raises(Aborted, match="0x05040001"):
        rig.request(b"\x60")


@pytest.mark.parametrize("command", [0xA0, 0xC0, 0xE0])
def test_block_transfers_are_unknown(command: int) -> None:
    with pytest.raises(Aborted, match="0x05040001"):
        Rig().request(bytes((command, 0x41, 0x60, 0)))


def test_a_write_of_untold_length_is_taken() -> None:
    rig = Rig()
    rig.request(bytes.fromhex("22 60 60 00 FD FF FF FF"))
    assert rig.node.read(0x6060) == -3


def test_a_request_shorter_than_a_frame_is_ignored() -> None:
    rig = Rig()
    rig.send(0x602, bytes.fromhex("40 41 60 00"))
    assert rig.take(0x582) == []


def test_the_answer_is_ready_after_the_answer_time() -> None:
    rig = Rig(settings=SimSettings(answer_time_s=0.002))
    rig.send(0x602, bytes.fromhex("40 41 60 00 00 00 00 00"))
    ((ready, _),) = rig.heard
    assert ready == pytest.approx(rig.now + 0.002)


def test_requests_to_other_nodes_are_ignored() -> None:
    rig = Rig()
    rig.send(0x603, bytes.fromhex("40 41 60 00 00 00 00 00"))
    assert rig.heard == []


def test_the_server_forgets_a_transfer_when_told() -> None:
    server = SdoServer(Rig().node._dictionary)
    server.answer(bytes.fromhex("40 04 20 00 00 00 00 00"))
    server.reset()
    answer = server.answer(bytes.fromhex("60 00 00 00 00 00 00 00"))
    assert answer == bytes.fromhex("80 00 00 00 01 00 04 05")


def test_the_position_marker_is_there_and_has_captured_nothing() -> None:
    rig = Rig()
    assert [rig.node.read(0x2074, sub) for sub in range(7)] == [6, 0, 0, 0, 0, 0, 0]
    rig.write(0x2074, 2, "B", 2)
    assert rig.read(0x2074, 2, "B") == 2
    assert rig.refusal(0x2074, 2, "B", 3) == 0x06090031
    assert rig.refusal(0x2074, 1, "i", 1) == 0x06010002
