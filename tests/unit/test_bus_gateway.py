"""The host's end of the wire: what leaves, what is held back, and what is counted."""

from __future__ import annotations

import pytest
from core_builders import ROBOT, FakeBus

from artemis.devices.bus_gateway import BusGateway
from artemis.devices.can_bus import Frame
from artemis.devices.tally import Tally
from artemis.errors import DeviceBusy, DeviceLost, ProtocolError
from artemis.values import BusHealth, Mode

SYNC, STOP_NMT, HEARTBEAT = Frame(0x080), Frame(0x000, b"\x02\x01"), Frame(0x77F, b"\x05")
READ_STATUS = Frame(0x601, b"\x40\x41\x60\0\0\0\0\0")


class Bench:
    """The end of a fake bus."""

    def __init__(self) -> None:
        self.bus = FakeBus()
        self.bus.error_frames = 40
        self.wire = BusGateway(ROBOT, self.bus)

    def arrive(self, *frames: Frame) -> bool:
        self.bus.arrived = list(frames)
        return self.wire.take_in()


def test_what_may_leave_leaves_and_is_written_down_in_its_order() -> None:
    bench = Bench()
    bench.wire.send(SYNC)
    bench.arrive(Frame(0x181, bytes(6), time=0.98))
    bench.wire.send(HEARTBEAT)
    assert [frame.id for frame in bench.bus.sent] == [0x080, 0x77F]
    assert bench.wire.take_traffic() == [
        (True, SYNC),
        (False, Frame(0x181, bytes(6), time=0.98)),
        (True, HEARTBEAT),
    ]
    assert bench.wire.take_traffic() == [], "each once"
    assert bench.wire.health() == BusHealth()


def test_what_must_not_leave_is_held_back_and_told_with_its_place_in_the_program() -> None:
    bench = Bench()
    bench.wire.send(STOP_NMT)
    assert bench.bus.sent == []
    assert bench.wire.take_traffic() == []
    (told,) = bench.wire.health().blocked
    reason, place = told.split("; ")
    assert reason == "0x000 [02 01] in init: NMT Stop also stops the drive's messages: never"
    assert place.startswith("test_what_must_not_leave_is_held_back_and_told_with_its_place_in_the_program:")
    assert bench.wire.health() == BusHealth(), "told once"


def test_mode_decides_what_may_leave() -> None:
    bench = Bench()
    bench.wire.begin(Mode.TELEOP)
    bench.wire.send(READ_STATUS)
    bench.wire.begin(Mode.QUICKSTOP)
    bench.wire.send(READ_STATUS)
    assert bench.bus.sent == [READ_STATUS]
    assert len(bench.wire.health().blocked) == 1


def test_frames_for_which_there_is_no_room_are_counted_in_a_row_and_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    send, full = bench.bus.send, [True, True, False, True, True, True, False]

    def sometimes_full(frame: Frame) -> None:
        if full.pop(0):
            raise DeviceBusy("CAN", "transmit buffer full")
        send(frame)

    monkeypatch.setattr(bench.bus, "send", sometimes_full)
    for number in range(5):
        bench.wire.send(Frame(0x201 + number % 4, bytes(6)))
    assert bench.wire.take_traffic() == [(True, Frame(0x203, bytes(6)))], "the others were never on the bus"
    assert bench.wire.health() == BusHealth(refused=2)
    bench.wire.send(SYNC)
    assert bench.wire.health() == BusHealth(refused=3), "the row goes on"
    bench.wire.send(HEARTBEAT)
    assert bench.wire.health() == BusHealth()


@pytest.mark.parametrize("identifier", [0x000, 0x080, 0x201, 0x204, 0x302, 0x603, 0x77F])
def test_frames_that_only_we_may_send_are_noticed(identifier: int) -> None:
    bench = Bench()
    bench.arrive(Frame(identifier), Frame(0x181), Frame(0x705), Frame(identifier))
    assert bench.wire.health() == BusHealth(foreign=(identifier, identifier))
    assert bench.wire.health() == BusHealth()


def test_error_frames_are_those_since_the_last_look() -> None:
    bench = Bench()
    assert bench.wire.health() == BusHealth(), "those before the run are no news"
    bench.bus.error_frames += 3
    assert bench.wire.health() == BusHealth(error_frames=3)
    assert bench.wire.health() == BusHealth()
    bench.bus.error_frames += 1
    assert bench.wire.health() == BusHealth(error_frames=1)


def test_lost_adapter_is_told_to_whoever_reads_or_writes() -> None:
    bench = Bench()
    bench.bus.lost = True
    with pytest.raises(DeviceLost):
        bench.wire.send(SYNC)
    with pytest.raises(DeviceLost):
        bench.wire.take_in()
    assert bench.wire.take_traffic() == []
    assert bench.wire.health() == BusHealth()


def test_held_back_frame_does_not_ask_the_adapter() -> None:
    bench = Bench()
    bench.bus.lost = True
    bench.wire.send(STOP_NMT)
    assert len(bench.wire.health().blocked) == 1


class HeardNode:
    """Keeps the frames that are handed to it."""

    def __init__(self) -> None:
        self.tally, self.heard = Tally(), list[Frame]()

    def hear(self, frame: Frame) -> None:
        self.heard.append(frame)
        if not frame.data:
            raise ProtocolError("empty")


def test_frames_that_arrive_go_to_their_handlers_and_only_an_emergency_wakes() -> None:
    bench, node, woken = Bench(), HeardNode(), list[bool]()
    bench.wire.handlers |= {0x181: (node, node.hear), 0x081: (node, node.hear)}
    bench.wire.listen(lambda: woken.append(True))
    status, emergency, gone = Frame(0x181, b"\x37"), Frame(0x081, b"\x10\x23" + bytes(6)), Frame(0x081, bytes(8))
    bench.bus.arrived = [status, Frame(0x181, b"\x37", rtr=True), Frame(0x182, b"\x37"), Frame(0x181), gone]
    bench.bus.wake()
    assert (node.heard, node.tally.malformed, woken) == ([status, Frame(0x181), gone], 1, [])
    bench.bus.arrived = [emergency]
    bench.bus.wake()
    assert woken == [True]


def test_lost_bus_is_reported_and_wakes() -> None:
    bench, woken, reported = Bench(), list[bool](), list[tuple[str, str, str]]()
    bench.wire.listen(lambda: woken.append(True), lambda *problem: reported.append(problem))
    bench.bus.lost = True
    bench.bus.wake()
    assert (woken, reported) == ([True], [("COM-22", "", "unplugged")])
