"""`artemis sim` and `artemis run` as two processes that share only a bus: UDP multicast that stays on this host."""

from __future__ import annotations

import signal
import socket
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import can
import pytest
from command_line import (
    PATIENCE,
    ROBOT,
    artemis,
    assert_left_at_rest,
    multicast_problem,
    only_run,
    read_until,
    started,
    stream,
    write_mission,
)

from artemis.mission.loading import load_model
from artemis.recording.mcap_reader import Recording
from artemis.vehicle import RobotFile
from artemis_lab.bench.ports import free_port

pytestmark = pytest.mark.realtime

GROUP = "239.74.163.2"
FAULT_STATE, STATE_BITS = 0x0108, 0x417F
HEARTBEAT_LOST = 0x8130
BEAT, ROUNDING = 0.1, 0.02
"""The drives' heartbeats are so far apart [s], to so much."""


@pytest.fixture(scope="module", autouse=True)
def _multicast() -> None:
    if problem := multicast_problem():
        pytest.skip(problem)


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return load_model(ROBOT, RobotFile)


@contextmanager
def simulated_robot(port: int) -> Iterator[subprocess.Popen[str]]:
    words = ["--interface", "udp_multicast", "--channel", GROUP, "--option", "hop_limit=0", "--option", f"port={port}"]
    with started("sim", ROBOT, *words) as process:
        read_until(process, "Ctrl-C ends")
        yield process


def udp_mission(folder: Path, port: int, more: str = "") -> Path:
    bus = f"{{interface: udp_multicast, channel: {GROUP}, hop_limit: 0, port: {port}}}"
    return write_mission(folder, bus=bus, more=more)


@dataclass
class Listener:
    """A third party on the bus, with the kernel's time of arrival of each frame."""

    bus: can.BusABC
    frames: list[can.Message] = field(default_factory=list)

    def hear(self, seconds: float) -> None:
        """Listen for some time."""
        before = len(self.frames)
        while (frame := self.bus.recv(seconds)) is not None:
            self.frames.append(frame)
            if frame.timestamp - self.frames[before].timestamp > seconds:
                return

    def hear_until(self, wanted: Callable[[can.Message], bool]) -> can.Message:
        """Listen until a certain frame comes."""
        while (frame := self.bus.recv(PATIENCE)) is not None:
            self.frames.append(frame)
            if wanted(frame):
                return frame
        raise AssertionError("the bus is silent")

    def held_up(self, nodes: Iterable[int], first: int) -> float:
        """How long this machine kept the drives from running since that frame, at most [s]: a heartbeat was so late."""
        beats = [[f.timestamp for f in self.frames[first:] if f.arbitration_id == 0x700 + node] for node in nodes]
        return max(after - before for times in beats for before, after in pairwise(times)) - BEAT + ROUNDING

    def read(self, node: int, index: int) -> int:
        """Value of an object of a drive, by expedited SDO upload."""
        request = bytes((0x40, index & 0xFF, index >> 8, 0, 0, 0, 0, 0))
        self.bus.send(can.Message(arbitration_id=0x600 + node, data=request, is_extended_id=False))
        answer = self.hear_until(lambda frame: frame.arbitration_id == 0x580 + node)
        size = 4 - (answer.data[0] >> 2 & 3)
        return int.from_bytes(answer.data[4 : 4 + size], "little", signed=index == 0x6064)


@contextmanager
def listener(port: int) -> Iterator[Listener]:
    with can.Bus(GROUP, interface="udp_multicast", port=port, hop_limit=0) as bus:
        yield Listener(bus)


def lost_contacts(run: Path) -> int:
    """How often a drive missed the host's heartbeat."""
    frames = (frame for _, batch in Recording(run).frames() for sent, frame in batch if not sent)
    return sum(frame.id & 0x780 == 0x080 and frame.data[:2] == b"\x30\x81" for frame in frames)


@pytest.mark.slow
def test_a_mission_is_done_against_simulated_drives_in_another_process(
    tmp_path: Path, port: int, robot: RobotFile
) -> None:
    with simulated_robot(port) as drives:
        done = artemis("run", udp_mission(tmp_path, port))
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"ARTEMIS on udp_multicast {GROUP}" in done.stdout
        assert drives.poll() is None
        drives.send_signal(signal.SIGINT)
        assert stream(drives.stdout).read() == "ended\n"
        assert drives.wait(timeout=PATIENCE) == 0
    run = only_run(tmp_path)
    assert artemis("replay", run).returncode == 0
    if lost_contacts(run) > len(robot.drives):  # once each while the watchdog is proven
        pytest.skip("this machine is too busy for real time: the simulated drives did not run for 200 ms")
    assert_left_at_rest(run)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_second_run_on_a_group_names_a_free_one(tmp_path: Path, port: int) -> None:
    mission = udp_mission(tmp_path, port)
    with simulated_robot(port), started("run", mission) as first:
        read_until(first, "calibrate")
        second = artemis("run", mission)

        assert second.returncode == 1
        assert "FAILED: COM-18" in second.stdout
        assert "take a free group: bus: {interface: udp_multicast, channel: 239.74.163." in second.stdout
        assert f"channel: {GROUP}}}" not in second.stdout


@pytest.mark.exhaustive
def test_a_mission_that_is_refused_sends_no_frame(tmp_path: Path, port: int, robot: RobotFile) -> None:
    ids = {drive.node_id for drive in robot.drives.values()}
    with listener(port) as third, simulated_robot(port):
        refused = artemis("run", udp_mission(tmp_path, port, more="tick_hz: 5\n"))
        assert refused.returncode == 2
        third.hear(0.5)
        boot_ups = {frame.arbitration_id - 0x700 for frame in third.frames if frame.data == b"\0"}
        assert boot_ups == ids  # the third party does hear
        assert {frame.arbitration_id & 0x7F for frame in third.frames} <= ids
        assert {frame.arbitration_id & 0x780 for frame in third.frames} <= {0x700, 0x080}
        assert all(third.read(id, 0x6064) == 0 for id in ids)


@pytest.mark.exhaustive  # ../host_death kills one, too
def test_a_host_that_is_killed_while_driving_is_noticed_and_every_drive_stops(
    tmp_path: Path, port: int, robot: RobotFile
) -> None:
    wheel = robot.drive_at("traction", "left")[1].node_id
    ids = [drive.node_id for drive in robot.drives.values()]
    a_tenth = 0.1 / robot.metres_per_count("left")

    def position(frame: can.Message) -> int:
        return int.from_bytes(frame.data[2:6], "little", signed=True)

    def has_driven(frame: can.Message) -> bool:
        assert host.poll() is None, stream(host.stdout).read()
        return frame.arbitration_id == 0x180 + wheel and position(frame) > a_tenth

    with listener(port) as third, simulated_robot(port), started("run", udp_mission(tmp_path, port)) as host:
        last_known = position(third.hear_until(has_driven))
        driving = len(third.frames)
        host.kill()
        third.hear(2.0)
        beats = [f.timestamp for f in third.frames if f.arbitration_id == 0x700 + robot.host_node_id]
        late = third.held_up(ids, driving)
        for node in ids:
            codes = {
                int.from_bytes(f.data[:2], "little"): f.timestamp
                for f in third.frames
                if f.arbitration_id == 0x080 + node and f.timestamp > beats[-1]
            }
            assert list(codes) == [HEARTBEAT_LOST]
            assert 0.1 < codes[HEARTBEAT_LOST] - beats[-1] < 0.2 + late
            assert third.read(node, 0x6041) & STATE_BITS == FAULT_STATE
        rest = [third.read(node, 0x6064) for node in ids]
        third.hear(0.3)
        assert [third.read(node, 0x6064) for node in ids] == rest
        driven_on = (rest[ids.index(wheel)] - last_known) * robot.metres_per_count("left")
        assert 0 < driven_on < 0.3 * (0.2 + late) + 0.3**2 / (2 * robot.limits.quick_stop_deceleration_m_s2)

    again = artemis("replay", only_run(tmp_path))
    assert again.returncode == 0
    assert again.stdout.startswith("the recording is not whole: ")
