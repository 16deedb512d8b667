"""What a tick puts on the bus, frame by frame and in which order, and what becomes of frames that arrive."""

from __future__ import annotations

import pytest
from core_builders import LOST_HEARTBEAT, NAMES, ROBOT, FakeBus, snapshot
from msgspec.structs import replace

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.devices.drive import Drives
from artemis.devices.epos_objects import UNREADABLE
from artemis.drive_states import DriveState, Goal
from artemis.states.mode import OFF, ON, STOPPING
from artemis.values import Job, JobKind, JobResult, Mode, SetPoints, Tick, Wish

ENABLED, QUICK_STOP_ACTIVE, DISABLED = 0x0337, 0x0317, 0x0340
SYNC, HEARTBEAT = Frame(0x080), Frame(0x77F, b"\x05")


class Bench:
    """All drives behind a fake bus, each in the state that it was last heard in."""

    def __init__(self, statusword: int = ENABLED) -> None:
        self.bus = FakeBus()
        self.drives = Drives(ROBOT, self.bus)
        for node in range(1, 5):
            self.hear(node, statusword)

    def hear(self, node: int, statusword: int, counts: int = 0) -> None:
        data = statusword.to_bytes(2, "little") + counts.to_bytes(4, "little", signed=True)
        self.bus.arrived.append(Frame(0x180 + node, data))
        self.drives.wire.take_in()

    def write(
        self, wish: Wish, *, urgent: bool = False, points: SetPoints | None = None, mode: Mode = Mode.READY
    ) -> list[Frame]:
        tick = Tick(
            snapshot=snapshot(urgent=urgent),
            mode=mode,
            wish=wish,
            set_points=points or SetPoints(),
        )
        self.drives.write(tick)
        return self.bus.take()


def stop_frames(*nodes: int) -> list[Frame]:
    return [Frame(0x300 + node, b"\x0b\x00") for node in nodes]


# ---------------------------------------------------------------------------------------------- frames out


def test_scheduled_tick_sends_set_points_then_sync_then_the_heartbeat() -> None:
    frames = Bench().write(ON)
    assert [frame.id for frame in frames] == [0x201, 0x202, 0x203, 0x204, 0x080, 0x77F]
    assert frames[-2:] == [SYNC, HEARTBEAT]


def test_each_wheel_gets_its_own_set_point() -> None:
    points = SetPoints(speed_left=0.1, speed_right=0.2, steering_left=0.01, steering_right=0.02)
    frames = Bench().write(ON, points=points, mode=Mode.TELEOP)[:4]
    values = [int.from_bytes(frame.data[2:], "little", signed=True) for frame in frames]
    assert values == [392, -783, 3011, -6022]  # 3916.67 rpm per m/s, 301120 counts per rad; right sides mirrored


def test_silent_wish_sends_nothing() -> None:
    assert Bench().write(Wish(exchange=False, heartbeat=False, traction=Goal.ENABLED)) == []


def test_heartbeat_alone_is_only_the_heartbeat() -> None:
    assert Bench().write(Wish(exchange=False)) == [HEARTBEAT]


def test_withheld_heartbeat_leaves_everything_else() -> None:
    frames = Bench().write(replace(OFF, heartbeat=False))
    assert [frame.id for frame in frames] == [0x201, 0x202, 0x203, 0x204, 0x080]


def test_each_drive_gets_the_command_for_its_own_state_and_its_role_s_goal() -> None:
    bench = Bench()
    bench.hear(2, DISABLED)
    bench.hear(4, QUICK_STOP_ACTIVE)
    words = [frame.data[0] for frame in bench.write(replace(ON, steering=Goal.DISABLED))[:4]]
    assert words == [0x0F, 0x06, 0x00, 0x00]


def test_quick_stop_goes_to_traction_at_once_and_steering_holds() -> None:
    frames = Bench().write(STOPPING, urgent=True)
    assert frames == stop_frames(1, 2)


def test_scheduled_tick_stops_both_sides_first_and_repeats_it_with_the_set_points() -> None:
    frames = Bench().write(STOPPING)
    assert [frame.id for frame in frames] == [0x301, 0x302, 0x201, 0x202, 0x203, 0x204, 0x080, 0x77F]
    words = {frame.id: frame.data[0] for frame in frames[:6]}
    assert words == {0x301: 0x0B, 0x201: 0x0B, 0x302: 0x0B, 0x202: 0x0B, 0x203: 0x0F, 0x204: 0x0F}


def test_stop_frame_goes_once_for_each_stop() -> None:
    bench = Bench()
    assert bench.write(STOPPING, urgent=True) == stop_frames(1, 2)
    assert bench.write(STOPPING, urgent=True) == []
    assert not [frame for frame in bench.write(STOPPING) if frame.id & 0x780 == 0x300]
    for node in (1, 2):
        bench.hear(node, QUICK_STOP_ACTIVE)
    assert not [frame for frame in bench.write(STOPPING) if frame.id & 0x780 == 0x300]
    bench.write(ON)
    for node in (1, 2):
        bench.hear(node, ENABLED)
    bench.write(ON)
    assert bench.write(STOPPING, urgent=True) == stop_frames(1, 2)


@pytest.mark.parametrize("wish", [ON, OFF, replace(OFF, traction=Goal.FAULT_RESET), Wish(exchange=False)])
def test_urgent_tick_without_a_stop_sends_nothing_at_all(wish: Wish) -> None:
    assert Bench().write(wish, urgent=True) == []


def test_urgent_tick_changes_what_may_leave_at_once() -> None:
    bench, read = Bench(), Frame(0x601, bytes.fromhex("40 41 60 00 00 00 00 00"))
    bench.write(ON, mode=Mode.TELEOP)
    bench.drives.wire.send(read)
    assert bench.bus.take() == []
    assert bench.write(STOPPING, urgent=True, mode=Mode.FAULT) == stop_frames(1, 2)
    bench.drives.wire.send(read)
    assert bench.bus.take() == [read]


def test_fault_reset_raises_the_bit_again_and_again() -> None:
    bench = Bench(0x0308)
    resetting = replace(OFF, traction=Goal.FAULT_RESET, steering=Goal.FAULT_RESET)
    words = [{frame.data[0] for frame in bench.write(resetting)[:4]} for _ in range(4)]
    assert words == [{0x80}, {0x00}, {0x80}, {0x00}]


def test_urgent_tick_does_not_spend_the_edge_of_a_fault_reset() -> None:
    bench = Bench(0x0308)
    resetting = replace(OFF, traction=Goal.FAULT_RESET, steering=Goal.FAULT_RESET)
    bench.write(resetting, urgent=True)
    assert {frame.data[0] for frame in bench.write(resetting)[:4]} == {0x80}


def test_last_resort_stops_every_drive() -> None:
    bench = Bench()
    bench.drives.stop()
    assert bench.bus.take() == stop_frames(1, 2, 3, 4)


def test_last_resort_bears_a_lost_bus() -> None:
    bench = Bench()
    bench.bus.lost = True
    bench.drives.stop()


# ---------------------------------------------------------------------------------------------- frames in


def test_frames_reach_the_node_of_their_identifier() -> None:
    bench = Bench(DISABLED)
    bench.hear(3, ENABLED)
    states = {feedback.name: feedback.state for feedback in bench.drives.sense(0.0).drives}
    assert states.pop("steer-left") is DriveState.OPERATION_ENABLE
    assert set(states.values()) == {DriveState.SWITCH_ON_DISABLED}
    assert [feedback.name for feedback in bench.drives.sense(0.0).drives] == list(NAMES)


GARBAGE = [
    Frame(0x181, b"\x37"),
    Frame(0x283, bytes(6)),
    Frame(0x701, b"\x99"),
    Frame(0x702, b""),
]


@pytest.mark.parametrize("garbage", GARBAGE)
def test_garbage_is_counted_and_dropped_and_the_rest_goes_on(garbage: Frame) -> None:
    bench = Bench(DISABLED)
    before = bench.drives.sense(0.0).drives
    bench.bus.arrived = [garbage, Frame(0x182, bytes.fromhex("37 03 00 00 00 00"))]
    bench.drives.wire.take_in()
    after = bench.drives.sense(0.0).drives
    sick = (garbage.id & 0x7F) - 1
    assert [feedback.malformed for feedback in after] == [int(number == sick) for number in range(4)]
    assert after[1].state is DriveState.OPERATION_ENABLE
    unchanged = [replace(feedback, malformed=0, frames=1) for feedback in after]
    assert (unchanged[0], *unchanged[2:]) == (before[0], *before[2:])


def test_emergency_that_cannot_be_read_is_marked_and_urgent() -> None:
    bench = Bench(DISABLED)
    bench.bus.arrived = [Frame(0x084, b"\x30\x81")]
    assert bench.drives.wire.take_in()
    assert [feedback.emergencies for feedback in bench.drives.sense(0.0).drives] == [(), (), (), (UNREADABLE,)]


@pytest.mark.parametrize("identifier", [0x000, 0x080, 0x085, 0x185, 0x201, 0x381, 0x601, 0x705, 0x77F, 0x7FF])
def test_frames_of_strangers_are_ignored(identifier: int) -> None:
    bench = Bench()
    before = bench.drives.sense(0.0).drives
    bench.bus.arrived = [Frame(identifier, b"\xff" * 8)]
    bench.drives.wire.take_in()
    assert bench.drives.sense(0.0).drives == tuple(replace(feedback, frames=0) for feedback in before)


def test_remote_frames_are_ignored() -> None:
    bench = Bench(DISABLED)
    bench.bus.arrived = [Frame(0x181, b"", rtr=True), Frame(0x701, b"", rtr=True)]
    bench.drives.wire.take_in()
    feedback = bench.drives.sense(0.0).drives[0]
    assert feedback.malformed == 0
    assert feedback.nmt is None


def test_answer_nobody_waits_for_is_ignored() -> None:
    bench = Bench()
    bench.bus.arrived = [Frame(0x581, bytes(8))]
    assert not bench.drives.wire.take_in()
    assert bench.drives.nodes[0].sdo.late_answers == 1


@pytest.mark.parametrize(
    ("frame", "urgent"),
    [
        (Frame(0x083, LOST_HEARTBEAT.to_bytes(2, "little") + bytes(6)), True),
        (Frame(0x083, bytes(8)), False),  # all errors gone
        (Frame(0x703, b"\x05"), False),
        (Frame(0x183, bytes(6)), False),
        (Frame(0x085, LOST_HEARTBEAT.to_bytes(2, "little") + bytes(6)), False),  # nobody's
    ],
)
def test_only_an_emergency_of_our_drives_that_tells_an_error_is_urgent(frame: Frame, urgent: bool) -> None:
    bench = Bench()
    bench.bus.arrived = [frame]
    assert bench.drives.wire.take_in() is urgent


def test_traffic_is_everything_on_the_bus_in_order_once() -> None:
    bench = Bench()
    bench.drives.wire.take_traffic()
    bench.bus.arrived = [Frame(0x7FF, b"\x01")]
    bench.drives.wire.take_in()
    bench.write(Wish(exchange=False))
    assert bench.drives.wire.take_traffic() == [(False, Frame(0x7FF, b"\x01")), (True, HEARTBEAT)]
    assert bench.drives.wire.take_traffic() == []


# ---------------------------------------------------------------------------------------------- a bus that is gone


def test_lost_bus_is_reported_to_the_run_at_every_look_and_write() -> None:
    bench, reported = Bench(), list[tuple[str, str, str]]()
    assert list(bench.drives.begin(0.0, lambda: None, lambda *problem: reported.append(problem))) == []
    bench.bus.lost = True
    assert bench.drives.wire.look(), "urgent"
    assert [drive.name for drive in bench.drives.sense(0.0).drives] == list(NAMES), "as they were last heard"
    bench.write(ON)
    assert reported == [("COM-22", "", "unplugged")] * 3


def test_job_on_a_lost_bus_is_a_result_and_no_exception() -> None:
    bench = Bench()
    bench.bus.lost = True
    job = Job(id=7, kind=JobKind.READ_HISTORY, drive="steer-left")

    async def main() -> JobResult:
        return await bench.drives.perform(job)

    result = run(main(), simulated=True)
    assert (result.id, result.kind, result.drive, result.ok) == (7, JobKind.READ_HISTORY, "steer-left", False)
    assert "unplugged" in result.detail


def test_job_of_a_drive_that_is_silent_says_which_object_was_asked_for() -> None:
    bench = Bench()

    async def main() -> JobResult:
        return await bench.drives.perform(Job(id=1, kind=JobKind.READ_HISTORY, drive="steer-left"))

    result = run(main(), simulated=True)
    assert not result.ok
    assert "0x1003" in result.detail
