"""`artemis calibrate gains` against drives in another process: what is kept outlasts the power, the rest is undone."""

from __future__ import annotations

import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest
from command_line import (
    ARTEMIS,
    PATIENCE,
    ROBOT,
    artemis,
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
NODE, POSITION_GAINS = 3, 0x60FB
TRIED = ["--drive", "steer-left", "--position", "200,10,250", "--yes"]


@pytest.fixture(scope="module", autouse=True)
def _multicast() -> None:
    if problem := multicast_problem():
        pytest.skip(problem)


@contextmanager
def simulated_robot(port: int) -> Iterator[subprocess.Popen[str]]:
    words = ["--interface", "udp_multicast", "--channel", GROUP, "--option", "hop_limit=0", "--option", f"port={port}"]
    with started("sim", ROBOT, *words) as process:
        read_until(process, "Ctrl-C ends")
        yield process


def mission(folder: Path, port: int) -> Path:
    bus = f"{{interface: udp_multicast, channel: {GROUP}, hop_limit: 0, port: {port}}}"
    return write_mission(folder, bus=bus, more="tick_hz: 50\n")


def position_gains(port: int, *, restart: bool = False) -> tuple[int, ...]:
    """What the drive has now, read by python-can alone; or after a node reset, when only what was stored is left."""
    with can.Bus(GROUP, interface="udp_multicast", port=port, hop_limit=0) as bus:

        def ask(identifier: int, data: bytes, answered_by: int, begins: bytes) -> bytes:
            """Multicast may lose a frame: it is sent once more."""
            for _ in range(5):
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
                for _ in range(100):  # of others' heartbeats between
                    if (frame := bus.recv(1.0)) is None:
                        break
                    if frame.arbitration_id == answered_by and bytes(frame.data).startswith(begins):
                        return bytes(frame.data)
            raise AssertionError(f"0x{identifier:03X} is not answered")

        if restart:
            ask(0x000, bytes((0x81, NODE)), 0x700 + NODE, b"\0")
        found = []
        for sub in (1, 2, 3):
            place = bytes((POSITION_GAINS & 0xFF, POSITION_GAINS >> 8, sub))
            data = ask(0x600 + NODE, bytes((0x40, *place, 0, 0, 0, 0)), 0x580 + NODE, b"\x4b" + place)
            found.append(int.from_bytes(data[4:6], "little"))
        return tuple(found)


def gains_written(run: Path) -> list[int]:
    """Every first position gain that was written into the drive, by the frames of the run."""
    frames = [frame for _, batch in Recording(run).frames() for sent, frame in batch if sent]
    written = [frame.data for frame in frames if frame.id == 0x600 + NODE and frame.data[1:4] == b"\xfb\x60\x01"]
    return [int.from_bytes(data[4:6], "little") for data in written if data[0] != 0x40]


@pytest.mark.exhaustive
def test_gains_that_are_kept_are_in_the_drive_s_memory_and_in_the_robot_file(tmp_path: Path) -> None:
    port, robot = free_port(socket.SOCK_DGRAM), tmp_path / "robots" / "artemis.yaml"
    with simulated_robot(port):
        done = artemis("calibrate", "gains", mission(tmp_path, port), *TRIED)
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"kept        steer-left: stored, and in {robot}" in done.stdout
        assert position_gains(port, restart=True) == (200, 10, 250)
    gains = {name: drive.gains for name, drive in load_model(robot, RobotFile).drives.items()}
    known = load_model(ROBOT, RobotFile).drives
    assert gains.pop("steer-left") == known["steer-left"].gains.model_copy(update={"position": (200, 10, 250)})  # type: ignore[union-attr]  # it has some
    assert gains == {name: known[name].gains for name in gains}


@pytest.mark.exhaustive
def test_ctrl_c_in_a_trial_gives_the_drive_its_gains_back(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_DGRAM)
    path = mission(tmp_path, port)
    with simulated_robot(port), started("calibrate", "gains", path, *TRIED, program=ARTEMIS) as trial:
        read_until(trial, "gains of steer-left")
        read_until(trial, "turning")
        trial.send_signal(signal.SIGINT)  # at once: the trial ends by itself four seconds later
        shown = stream(trial.stdout).read()
        assert trial.wait(PATIENCE) == 128 + signal.SIGINT
        assert "restored    steer-left: the gains of the robot file" in shown
        assert "kept        " not in shown
        assert position_gains(port) == (150, 10, 200)
    assert gains_written(only_run(tmp_path))[-2:] == [200, 150]
    assert (tmp_path / "robots" / "artemis.yaml").read_text() == ROBOT.read_text()
