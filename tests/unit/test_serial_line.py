"""A serial line to simulated drives: objects, the gateway, and everything that may be wrong with the bytes."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from serial_rig import BEHIND, FIRST, SerialRig, on_line

from artemis.devices.can_bus import Frame
from artemis.devices.canopen import NmtCommand, SdoAbort, nmt_frame
from artemis.devices.serial_frames import OPCODES, SerialCommand, SerialProtocol, SerialService
from artemis.devices.serial_line import ADVICE, PATIENCE, SILENCE, TRIES
from artemis.drive_states import DriveState, Nmt
from artemis.errors import DeviceError, DeviceLost, DeviceTimeout, ProtocolError
from artemis.sim.serial_wire import SerialSettings
from artemis.supervision.catalogue import ROWS

both = pytest.mark.parametrize("protocol", SerialProtocol)
either = pytest.mark.parametrize("node_id", [FIRST, BEHIND])
STATUSWORD, GAIN, CONTROLWORD = (0x6041, 0), (0x60F9, 1), (0x6040, 0)
OFF = bytes((0x40, 0x01))
"""Statusword of Switch On Disabled, without Operational."""


# ---------------------------------------------------------------------------------------------- objects


@both
@either
def test_objects_are_read_and_written(protocol: SerialProtocol, node_id: int) -> None:
    async def test(rig: SerialRig) -> None:
        objects = rig.objects(node_id)
        assert await objects.read(*STATUSWORD, 2) == OFF
        await objects.write(*GAIN, (1234).to_bytes(2, "little"))
        assert await objects.read(*GAIN, 2) == (1234).to_bytes(2, "little")
        assert rig.world.nodes[node_id - 1].read(*GAIN) == 1234
        assert not rig.line.faults
        assert rig.line.commands == 3

    on_line(test, protocol)


@both
@either
def test_what_a_drive_refuses_is_an_abort_with_its_code(protocol: SerialProtocol, node_id: int) -> None:
    async def test(rig: SerialRig) -> None:
        with pytest.raises(SdoAbort, match="0x06020000 at 0x3000:0: object does not exist"):
            await rig.objects(node_id).read(0x3000, 0, 2)
        with pytest.raises(SdoAbort, match="read only"):
            await rig.objects(node_id).write(*STATUSWORD, b"\0\0")

    on_line(test, protocol)


@both
def test_a_node_that_the_gateway_does_not_hear_is_told_from_a_drive_that_does_not_answer(
    protocol: SerialProtocol,
) -> None:
    async def test(rig: SerialRig) -> None:
        rig.world.nodes[BEHIND - 1].power_off()
        with pytest.raises(DeviceTimeout, match="node 3 does not answer the drive on the serial line, its gateway"):
            await rig.objects(BEHIND).read(*STATUSWORD, 2)
        assert await rig.objects(FIRST).read(*STATUSWORD, 2) == OFF

    on_line(test, protocol)


def test_commands_to_several_nodes_at_once_take_their_turns() -> None:
    async def test(rig: SerialRig) -> None:
        answers = await asyncio.gather(*(rig.objects(number).read(0x1018, 4, 4) for number in (1, 2, 3, 4, 1, 2, 3, 4)))
        assert [answer[0] for answer in answers] == [1, 2, 3, 4] * 2

    on_line(test)


@both
def test_nmt_commands_reach_the_drive_on_the_line_and_those_behind_it(protocol: SerialProtocol) -> None:
    async def test(rig: SerialRig) -> None:
        for number in (FIRST, BEHIND):
            rig.line.send(nmt_frame(NmtCommand.START, number))
        await rig.objects(FIRST).read(*STATUSWORD, 2)  # in its turn
        assert [node.nmt for node in rig.world.nodes].count(Nmt.OPERATIONAL) == 2
        rig.line.send(nmt_frame(NmtCommand.START))
        await rig.objects(FIRST).read(*STATUSWORD, 2)
        assert {node.nmt for node in rig.world.nodes} == {Nmt.OPERATIONAL}

    on_line(test, protocol)


def test_no_other_frame_passes() -> None:
    async def test(rig: SerialRig) -> None:
        with pytest.raises(ProtocolError, match="carries objects and NMT commands, not frame 0x201"):
            rig.line.send(Frame(0x201, b"\x0f\x00"))
        assert rig.line.receive() == []

    on_line(test)


# ---------------------------------------------------------------------------------------------- time


@pytest.mark.parametrize(("baud", "milliseconds"), [(115200, 2.083), (38400, 6.25)])
@pytest.mark.parametrize("write", [False, True])
def test_a_command_takes_24_bytes_on_the_wire(baud: int, milliseconds: float, write: bool) -> None:
    async def test(rig: SerialRig) -> None:
        if write:
            await rig.objects(FIRST).write(*GAIN, b"\x01\x00")
        else:
            await rig.objects(FIRST).read(*GAIN, 2)
        assert 1000 * rig.wire.busy == pytest.approx(milliseconds, rel=1e-3)

    on_line(test, settings=SerialSettings(baud=baud))


def test_an_adapter_that_holds_bytes_back_makes_each_command_wait_three_times() -> None:
    async def test(rig: SerialRig) -> None:
        await rig.objects(FIRST).read(*STATUSWORD, 2)
        begin = rig.loop.time()
        await rig.objects(FIRST).read(*STATUSWORD, 2)
        assert rig.loop.time() - begin == pytest.approx(3 * 0.016, abs=1e-6)

    on_line(test, settings=SerialSettings(latency_s=0.016))


def test_only_drives_behind_the_gateway_can_watch_a_computer_on_the_line() -> None:
    """Heartbeats that the gateway sends for it: the gateway itself does not hear them, and stops for their lack."""

    async def test(rig: SerialRig) -> None:
        watched = 127 << 16 | 200
        for number in (1, 2, 3, 4):
            await rig.objects(number).write(0x1016, 1, watched.to_bytes(4, "little"))
        heartbeat = (0x77F).to_bytes(2, "little") + b"\x01\x00\x05" + bytes(7)
        command = SerialCommand(
            opcode=OPCODES[SerialProtocol.EPOS1][SerialService.SEND_CAN], data=heartbeat, answered=False
        )
        rig.world.nodes[0].receive(Frame(0x77F, b"\x05"), rig.loop.time())  # once from elsewhere: its watch begins
        for _ in range(10):
            await rig.line.perform(command)
            await asyncio.sleep(0.1)
        states = [node.state for node in rig.world.nodes]
        assert states == [DriveState.FAULT, *[DriveState.SWITCH_ON_DISABLED] * 3]

    on_line(test)


# ---------------------------------------------------------------------------------------------- what may be wrong


async def still_works(rig: SerialRig, row: str, times: int = 1) -> None:
    """One command that meets the damage, and succeeds; then others, at once."""
    assert await rig.objects(BEHIND).read(*STATUSWORD, 2) == OFF
    assert rig.line.faults == {row: times}
    for number in (FIRST, BEHIND):
        assert await rig.objects(number).read(0x1018, 4, 4) == number.to_bytes(4, "little")
    assert rig.line.faults == {row: times}


@both
def test_bytes_out_of_step_are_thrown_away_and_the_command_repeated(protocol: SerialProtocol) -> None:
    """SER-01."""

    async def test(rig: SerialRig) -> None:
        rig.port.to_host.insert = b"\x17"
        await still_works(rig, "SER-01")

    on_line(test, protocol)


@pytest.mark.parametrize("place", range(4, 14))
def test_a_damaged_answer_is_not_believed(place: int) -> None:
    """SER-02, whichever byte of the data or the checksum it is."""

    async def test(rig: SerialRig) -> None:
        rig.port.to_host.pass_first, rig.port.to_host.flip = place, 1
        await still_works(rig, "SER-02")

    on_line(test)


@pytest.mark.parametrize(("place", "row"), [(0, "SER-01"), (1, "SER-01"), (2, "SER-01"), (3, "SER-02")])
def test_a_damaged_confirmation_or_length_is_not_believed(place: int, row: str) -> None:
    async def test(rig: SerialRig) -> None:
        rig.port.to_host.pass_first, rig.port.to_host.flip = place, 1
        assert await rig.objects(BEHIND).read(*STATUSWORD, 2) == OFF
        assert row in rig.line.faults
        assert await rig.objects(FIRST).read(0x1018, 4, 4) == b"\x01\0\0\0"

    on_line(test)


@pytest.mark.parametrize("place", range(1, 12))
def test_a_damaged_command_is_not_executed(place: int) -> None:
    """SER-02, as the drive says it; of a damaged length, it waits for more and says nothing: SER-03."""

    async def test(rig: SerialRig) -> None:
        requests: list[bytes] = []
        receive = rig.world.nodes[0].receive

        def spy(frame: Frame, now: float) -> None:
            requests.append(frame.data)
            receive(frame, now)

        rig.world.nodes[0].receive = spy  # type: ignore[method-assign]
        rig.port.to_drive.pass_first, rig.port.to_drive.flip = place, 1
        await rig.objects(FIRST).write(*GAIN, b"\x11\x22")
        assert [request[:6] for request in requests] == [b"\x22\xf9\x60\x01\x11\x22"]
        assert rig.line.faults in ({"SER-02": 1}, {"SER-03": 1})

    on_line(test)


@both
def test_a_drive_that_does_not_answer_is_asked_three_times(protocol: SerialProtocol) -> None:
    """SER-03."""

    async def test(rig: SerialRig) -> None:
        rig.world.nodes[0].power_off()
        begin = rig.loop.time()
        with pytest.raises(DeviceTimeout, match=r"3 tries \(SER-03\); is the drive powered"):
            await rig.objects(FIRST).read(*STATUSWORD, 2)
        assert rig.loop.time() - begin == pytest.approx(TRIES * PATIENCE, abs=0.01)
        assert rig.line.faults == {"SER-03": 3}
        rig.world.nodes[0].power_on(rig.loop.time())
        await asyncio.sleep(0.1)
        assert await rig.objects(FIRST).read(*STATUSWORD, 2) == OFF

    on_line(test, protocol)


@pytest.mark.parametrize("place", range(14))
def test_an_answer_that_breaks_off_is_asked_for_again(place: int) -> None:
    """SER-04, wherever its last bytes are lost; of what comes before it, one byte."""

    async def test(rig: SerialRig) -> None:
        rig.port.to_host.pass_first = place
        rig.port.to_host.drop = 14 - place if place > 2 else 1
        assert await rig.objects(BEHIND).read(*STATUSWORD, 2) == OFF
        assert rig.line.faults == {{0: "SER-03", 1: "SER-01", 2: "SER-03"}.get(place, "SER-04"): 1}
        assert await rig.objects(FIRST).read(0x1018, 4, 4) == b"\x01\0\0\0"

    on_line(test)


def test_half_an_answer_of_an_epos4_is_asked_for_again() -> None:
    """SER-04."""

    async def test(rig: SerialRig) -> None:
        rig.port.to_host.pass_first, rig.port.to_host.drop = 6, 8
        await still_works(rig, "SER-04")

    on_line(test, SerialProtocol.EPOS4)


@both
def test_the_late_answer_of_another_node_is_not_taken(protocol: SerialProtocol) -> None:
    """An answer of an EPOS4 does not tell whose it is: another one that follows it shows that it was late."""

    async def test(rig: SerialRig) -> None:
        late: list[bytes] = []
        to_host = rig.wire.to_host

        def keep(data: bytes) -> None:
            late.append(data)

        rig.wire.to_host = keep  # type: ignore[method-assign]
        with pytest.raises(DeviceTimeout):
            await rig.objects(BEHIND).read(0x1018, 4, 4)
        rig.wire.to_host = to_host  # type: ignore[method-assign]
        asked = asyncio.ensure_future(rig.objects(FIRST).read(0x1018, 4, 4))
        await asyncio.sleep(1e-6)
        for answer in late[-2:]:
            to_host(answer)
        assert await asked == b"\x01\0\0\0"
        assert rig.line.faults == {"SER-03": TRIES, "SER-01": 1}
        for number in (BEHIND, FIRST):
            begin = rig.loop.time()
            assert await rig.objects(number).read(0x1018, 4, 4) == number.to_bytes(4, "little")
            assert rig.loop.time() - begin < 0.1, "it is trusted again"

    on_line(test, protocol)


@both
def test_a_port_that_is_unplugged_ends_all_commands_at_once(protocol: SerialProtocol) -> None:
    """SER-05."""

    async def test(rig: SerialRig) -> None:
        waiting = [asyncio.ensure_future(rig.objects(number).read(*STATUSWORD, 2)) for number in (1, 2, 3)]
        rig.loop.call_later(0.0005, rig.bare.lose, "was unplugged")
        results = await asyncio.gather(*waiting, return_exceptions=True)
        assert all(isinstance(result, DeviceLost) for result in results)
        assert "was unplugged (SER-05); is its adapter plugged in?" in str(results[0])
        assert rig.line.faults == {"SER-05": 1}
        for act in (lambda: rig.line.receive(), lambda: rig.line.send(nmt_frame(NmtCommand.STOP))):
            with pytest.raises(DeviceLost):
                act()
        with pytest.raises(DeviceLost):
            await rig.objects(1).read(*STATUSWORD, 2)

    on_line(test, protocol)


@both
@settings(max_examples=8)
@given(seed=st.integers(0, 1000), chance=st.sampled_from([0.01, 0.03, 0.1]))
def test_whatever_happens_to_the_bytes_no_wrong_value_is_taken(
    protocol: SerialProtocol, seed: int, chance: float
) -> None:
    async def test(rig: SerialRig) -> None:
        rig.port._dice.seed(seed)
        rig.port.to_drive.chance = rig.port.to_host.chance = chance
        for value in range(1000, 1012):
            node_id = value % 4 + 1
            data = value.to_bytes(2, "little")
            try:
                await rig.objects(node_id).write(*GAIN, data)
                assert rig.world.nodes[node_id - 1].read(*GAIN) == value
                assert await rig.objects(node_id).read(*GAIN, 2) == data
            except DeviceError as error:
                assert "(SER-0" in error.problem  # noqa: PT017 (other errors would be of the drive)
        rig.port.to_drive.chance = rig.port.to_host.chance = 0.0
        await asyncio.sleep(SILENCE)
        assert await rig.objects(FIRST).read(0x1018, 4, 4) == b"\x01\0\0\0"

    on_line(test, protocol)


@both
def test_a_line_that_never_falls_silent_is_given_up(protocol: SerialProtocol) -> None:
    async def test(rig: SerialRig) -> None:
        async def chatter() -> None:
            while True:
                rig.wire.to_host(b"\x55")
                await asyncio.sleep(0.05)

        talking = asyncio.create_task(chatter())
        try:
            async with asyncio.timeout(60.0):
                with pytest.raises(ProtocolError, match=r"does not fall silent \(SER-01\); is the baud rate right"):
                    await rig.objects(FIRST).read(*STATUSWORD, 2)
        finally:
            talking.cancel()
        await asyncio.sleep(2 * SILENCE)
        assert await rig.objects(FIRST).read(*STATUSWORD, 2) == OFF

    on_line(test, protocol)


def test_who_asked_and_went_does_not_hold_up_the_line() -> None:
    async def test(rig: SerialRig) -> None:
        gone = asyncio.ensure_future(rig.objects(FIRST).read(*STATUSWORD, 2))
        await asyncio.sleep(0.0005)
        gone.cancel()
        assert await rig.objects(BEHIND).read(*STATUSWORD, 2) == OFF
        assert not rig.line.faults

    on_line(test)


def test_the_fault_table_gives_the_same_advice() -> None:
    assert {row: ROWS[row].advice for row in ADVICE} == ADVICE
