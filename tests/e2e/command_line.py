"""The `artemis` command as a process of its own, small missions for it, and what its recording says of the drives."""

from __future__ import annotations

import math
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from typing import IO
from unittest.mock import patch

import pytest
from lateness import skip_if_late

from artemis import cli
from artemis.recording.mcap_reader import Recording
from artemis_lab.bench.ports import free_port

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = MISSIONS / "robots" / "artemis.yaml"
ARTEMIS = [sys.executable, "-m", "artemis"]
PATIENCE = 120.0
"""Longest time for anything on a busy machine [s]; no test waits this long when all is well."""
SWITCH_ON_DISABLED = 0x0140
STATE_BITS = 0x417F
WRITE_CONSUMER_HEARTBEAT = bytes.fromhex("23161001")
"""First half of an SDO request that writes object 0x1016:1."""
STATUSWORD_READ = bytes.fromhex("4b416000")
"""First half of an SDO answer with object 0x6041 (CiA 301 7.2.4.3.6: two bytes)."""


def write_mission(folder: Path, *, name: str = "mission.yaml", bus: str = "simulation", more: str = "") -> Path:
    """A straight distance of 1.5 m at 0.3 m/s; `more` is YAML for its end."""
    (folder / "robots").mkdir(exist_ok=True)
    (folder / "paths").mkdir(exist_ok=True)
    shutil.copy(ROBOT, folder / "robots")
    (folder / "paths/line.csv").write_text("x_m,y_m\n" + "".join(f"{0.1 * i:.1f},0\n" for i in range(16)))
    mission = folder / name
    mission.write_text(
        f"mission: line\nrobot: robots/artemis.yaml\nbus: {bus}\nsteps:\n"
        "  - calibrate: {steering: from_potentiometers}\n"
        "  - follow: {path: paths/line.csv, follower: {plugin: indiveri, speed_m_s: 0.3}}\n" + more
    )
    return mission


def endless_mission(folder: Path, *, more: str = "") -> Path:
    """Round and round a circle for two days: only somebody ends it, however fast virtual time goes."""
    mission = write_mission(folder, more=more)
    circle = (f"{math.sin(turn):.4f},{1 - math.cos(turn):.4f}\n" for turn in (math.tau * i / 60 for i in range(61)))
    (folder / "paths/line.csv").write_text("x_m,y_m\n" + "".join(circle))
    mission.write_text(mission.read_text().replace("0.3}}", "0.3}, laps: 10000}"))
    return mission


def artemis(
    *arguments: str | Path, program: list[str] = ARTEMIS, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    command = [*program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, stdin=subprocess.DEVNULL, cwd=cwd)


def artemis_here(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command in this process: a second less for what needs no process of its own."""
    line, out, errors = ["artemis", *map(str, arguments)], StringIO(), StringIO()
    with patch.object(sys, "argv", line), redirect_stdout(out), redirect_stderr(errors):
        with pytest.raises(SystemExit) as ended:
            cli.main()
    assert isinstance(ended.value.code, int)
    return subprocess.CompletedProcess(line, ended.value.code, out.getvalue(), errors.getvalue())


@contextmanager
def started(
    *arguments: str | Path, stdin: int = subprocess.DEVNULL, program: Sequence[str] = ARTEMIS
) -> Iterator[subprocess.Popen[str]]:
    """The running command; killed at the end if it still runs. Even under `nohup` it has a terminal to lose."""
    command = [*program, *map(str, arguments)]
    pipe, hangs_up = subprocess.PIPE, partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    with subprocess.Popen(
        command, stdin=stdin, stdout=pipe, stderr=pipe, text=True, bufsize=1, preexec_fn=hangs_up
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def read_until(process: subprocess.Popen[str], words: str) -> str:
    """Everything that the command prints up to the line with `words`."""
    lines: list[str] = []
    for line in stream(process.stdout):
        lines.append(line)
        skip_if_late(line)
        if words in line:
            return "".join(lines)
    raise AssertionError(f"ended without {words!r}: {''.join(lines)}{stream(process.stderr).read()}")


def stream(pipe: IO[str] | None) -> IO[str]:
    """A pipe that was asked for."""
    assert pipe is not None
    return pipe


def only_run(folder: Path) -> Path:
    """The folder of the one run that the mission in `folder` has left behind."""
    (run,) = (folder / "runs").iterdir()
    return run


def multicast_problem() -> str | None:
    """Why two processes cannot meet over UDP multicast here; None if they can."""
    import can

    port = free_port(socket.SOCK_DGRAM)
    try:
        with (
            can.Bus("239.74.163.2", interface="udp_multicast", port=port, hop_limit=0) as one,
            can.Bus("239.74.163.2", interface="udp_multicast", port=port, hop_limit=0) as other,
        ):
            one.send(can.Message(arbitration_id=0x123, is_extended_id=False))
            return None if other.recv(2.0) else "no UDP multicast between processes here"
    except (can.CanError, OSError) as error:
        return f"no UDP multicast here: {error}"


def assert_left_at_rest(run: Path) -> None:
    """By the frames of the recording every drive rests, switched off, and was told to stop watching us before we went.

    "Rests" is less than 0.5 mm of a wheel, or 0.01 degrees of its angle, over the last three looks.
    """
    recording = Recording(run)
    frames = [(sent, frame) for _, batch in recording.frames() for sent, frame in batch]
    ends = [frame for sent, frame in frames if sent][-60:]
    beats = [frame.time for sent, frame in frames if sent and frame.id == 0x700 + recording.robot.host_node_id]
    for drive in recording.robot.drives.values():
        node = drive.node_id
        status = [frame for sent, frame in frames if not sent and frame.id == 0x180 + node]
        answers = [frame.data for sent, frame in frames if not sent and frame.id == 0x580 + node]
        read = [data[4:6] for data in answers if data[:4] == STATUSWORD_READ]  # when it was released
        assert int.from_bytes(read[-1], "little") & STATE_BITS == SWITCH_ON_DISABLED
        positions = [int.from_bytes(frame.data[2:6], "little", signed=True) for frame in status[-3:]]
        assert max(positions, default=0) - min(positions, default=0) <= (2 if drive.role == "traction" else 50)
        written = [
            (frame.time, frame.data[4:])
            for sent, frame in frames
            if sent and frame.id == 0x600 + node and frame.data[:4] == WRITE_CONSUMER_HEARTBEAT
        ]
        watching = max(number for number, (_, value) in enumerate(written) if any(value))
        told, value = written[watching + 1]
        assert value == bytes(4)
        if status and told - status[-1].time < 0.05:  # it was in the exchange of process data to the end
            assert any(told - 0.05 < beat <= told for beat in beats)
        assert (0x000, bytes((0x80, node))) in [(frame.id, frame.data) for frame in ends]


def modes_of(run: Path) -> list[str]:
    """Every mode of the run in order, without repetition."""
    modes: list[str] = []
    for tick in Recording(run).ticks():
        if modes[-1:] != [tick.mode.value]:
            modes.append(tick.mode.value)
    return modes
