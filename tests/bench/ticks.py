"""What a tick costs, and what the exchange of its process data costs beside the `canopen` package."""

# mypy: disable-error-code="no-untyped-call"
# (half of the package has no annotations)

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

from artemis.build import kind_of_build
from artemis.devices.can_bus import Frame
from artemis.devices.canopen import SYNC_FRAME, PdoLayout, heartbeat_frame
from artemis.devices.drive import Drives
from artemis.drive_states import Nmt
from artemis.mission.loading import load_mission
from artemis.vehicle import RobotFile

from .composition import FIGURE_EIGHT, TimedRobot, missions, timed_run
from .measure import Row, interleaved, microseconds, middle_and_tail, percentile

RUNS = 3
VARIABLES = {
    0x2028: datatypes.INTEGER32,
    0x2062: datatypes.INTEGER32,
    0x6040: datatypes.UNSIGNED16,
    0x6041: datatypes.UNSIGNED16,
    0x6061: datatypes.INTEGER8,
    0x6064: datatypes.INTEGER32,
    0x6078: datatypes.INTEGER16,
    0x60FF: datatypes.INTEGER32,
}


def rows() -> list[Row]:
    """The rows of the table."""
    runs = [_run() for _ in range(RUNS)]
    own, simulation = _least([robot.own for robot in runs]), _least([robot.simulation for robot in runs])
    beside = median(_least([robot.peer for robot in runs]))
    middle, tail, simulated = median(own), percentile(own, 0.99), median(simulation)
    ours, theirs = exchange()
    share = 1.1 if kind_of_build() == "compiled" else 2.2
    return [
        Row(
            name="one tick, four drives, judged and recorded; no follower, no simulation",
            measured=middle_and_tail(own),
            budget="<= 1.6 x canopen's exchange, p99 <= 8 x",
            held=middle <= 1.6 * theirs and tail <= 8.0 * theirs,
            peer=f"{middle / theirs:.1f} x, p99 {tail / theirs:.1f} x; "
            f"of one after each tick, {microseconds(beside)}: {middle / beside:.1f} x, p99 {tail / beside:.1f} x",
        ),
        Row(
            name="simulated bus, drives and vehicle, per tick",
            measured=middle_and_tail(simulation),
            budget=f"<= {share} x canopen's exchange",
            held=simulated <= share * theirs,
            peer=f"{simulated / theirs:.1f} x",
        ),
        Row(
            name="exchange alone: 6 frames out, 8 in",
            measured=microseconds(ours),
            budget="<= 1/3 of the peer",
            held=ours <= theirs / 3,
            peer=f"canopen {microseconds(theirs)}: 1/{theirs / ours:.1f}",
        ),
    ]


def _least(runs: list[list[float]]) -> list[float]:
    """Least time of each tick: on virtual time every run has the same ticks, and what delays one is the machine."""
    return [min(times) for times in zip(*runs, strict=True)]


def _run() -> TimedRobot:
    with missions() as mission:
        return timed_run(mission, lambda robot: _their_cycle(robot, _answers(robot)))


def exchange() -> tuple[float, float]:
    """Seconds for one cycle of process data: by artemis, and by the canopen package, on a bus that costs nothing."""
    robot = load_mission(FIGURE_EIGHT).robot
    answers = _answers(robot)
    ours, theirs = interleaved([_our_cycle(robot, answers), _their_cycle(robot, answers)], rounds=25, calls=40)
    return ours, theirs


def _answers(robot: RobotFile) -> list[Frame]:
    """Both PDOs of each drive."""
    values = {"traction": ((0x0337, 4711), (150, -820, 3)), "steering": ((0x0337, -4711), (2510, 2480, 95, -1))}
    frames = []
    for drive in robot.drives.values():
        for number, (mapped, content) in enumerate(zip(drive.tables.sent[drive.role], values[drive.role], strict=True)):
            data = PdoLayout([entry.type for entry in mapped]).pack(*content)
            frames.append(Frame(0x180 + 0x100 * number + drive.node_id, data))
    return frames


class _NoBus:
    """Costs nothing."""

    def __init__(self, answers: list[Frame]) -> None:
        self._answers = answers
        self.sent = self.error_frames = 0

    def send(self, frame: Frame) -> None:
        self.sent += 1

    def receive(self) -> list[Frame]:
        return self._answers

    def listen(self, wake: Callable[[], None]) -> None:
        """Nobody wakes."""

    def close(self) -> None:
        """Nothing to close."""


def _our_cycle(robot: RobotFile, answers: list[Frame]) -> Callable[[], object]:
    bus = _NoBus(answers)
    drives = Drives(robot, bus)
    heartbeat = heartbeat_frame(robot.host_node_id, Nmt.OPERATIONAL)

    def cycle() -> object:
        drives.wire.take_in()
        feedback = drives.sense(0.0).drives
        for node in drives.nodes:
            bus.send(node.set_point_frame(0x0F, 0.2))
        bus.send(SYNC_FRAME)
        bus.send(heartbeat)
        drives.wire.take_traffic()
        return feedback

    return cycle


class _TheirWire(canopen.Network):
    """Costs nothing."""

    sent = 0

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self.sent += 1


def _their_cycle(robot: RobotFile, answers: list[Frame]) -> Callable[[], object]:
    """The same frames by the package's PDO maps: every mapped object is set, or read, as a number in drive units."""
    wire = _TheirWire()
    received: list[Any] = []
    sent: list[Any] = []
    for drive in robot.drives.values():
        node: Any = wire.add_node(canopen.RemoteNode(drive.node_id, _described()))
        for maps, mapped, base, kept in (
            (node.rpdo, drive.tables.received[drive.role][:1], 0x200, received),
            (node.tpdo, drive.tables.sent[drive.role], 0x180, sent),
        ):
            for number, entries in enumerate(mapped, 1):
                pdo = maps[number]
                pdo.cob_id, pdo.enabled = base + 0x100 * (number - 1) + drive.node_id, True
                for entry in entries:
                    pdo.add_variable(entry.index, entry.subindex)
                kept.append(pdo)
                pdo.subscribe()

    def cycle() -> object:
        for frame in answers:
            wire.notify(frame.id, bytearray(frame.data), 0.0)
        values = [variable.raw for pdo in sent for variable in pdo]
        for pdo in received:
            pdo[0].raw = 0x0F
            pdo[1].raw = 782
            pdo.transmit()
        wire.sync.transmit()
        wire.send_message(0x77F, b"\x05")
        return values

    return cycle


def _described() -> canopen.ObjectDictionary:
    objects = canopen.ObjectDictionary()

    def variable(index: int, sub: int, kind: int) -> ODVariable:
        made = ODVariable(f"object {index:04X}:{sub}", index, sub)
        made.data_type = kind
        return made

    for index, kind in VARIABLES.items():
        objects.add_object(variable(index, 0, kind))
    records = {0x207C: datatypes.INTEGER16}
    records |= {base + number: datatypes.UNSIGNED32 for base in (0x1400, 0x1600, 0x1800, 0x1A00) for number in (0, 1)}
    for index, kind in records.items():
        record = ODRecord(f"record {index:04X}", index)
        for sub in range(3):
            record.add_member(variable(index, sub, kind))
        objects.add_object(record)
    return objects
