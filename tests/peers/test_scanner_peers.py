"""Programs of others read our simulated LMS100 over TCP. `scripts/scanner_peers` builds and installs them."""

from __future__ import annotations

import asyncio
import shutil
import sys
from pathlib import Path

import pytest

from artemis import clock
from artemis.sim.lms100 import Lms100
from artemis.sim.lms100_server import serve_lms100

sys.path.append(str(Path(__file__).parents[1] / "unit"))
from scanner_rig import spiral

READER = Path(__file__).parents[2] / "build" / "scanner_peers" / "reader"
GRABBER = shutil.which("rawlog-grabber")
TRUE = [1000 + 3 * beam for beam in range(541)]
SCAN, LONGEST = "Scan Count :", 40.0
"""How the grabber's lines begin that are scans. It waits ten seconds before it asks for the first [s]."""
GRABBING = """
[global]
rawlog_prefix = {folder}/scans
time_between_launches = 300
use_sensoryframes = 0
GRABBER_PERIOD_MS = 100

[LMS100]
driver = CLMS100Eth
process_rate = 50
sensorLabel = FRONT
ip_address = 127.0.0.1
TCP_port = PORT
pose_x = 0
pose_y = 0
pose_z = 0
pose_yaw = 0
pose_pitch = 0
pose_roll = 0
"""

pytestmark = pytest.mark.realtime


async def read_by(program: str, *arguments: str, enough: int, spin_up: float = 10.0) -> list[str]:
    """The lines of a program that reads a simulated LMS100, whose port is {port}, until `enough` of them are scans."""
    device = Lms100(spiral)
    device.spin_up = spin_up
    server = await serve_lms100(device, "127.0.0.1", 0)
    port = str(server.sockets[0].getsockname()[1])
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        program,
        *[part.replace("{port}", port) for part in arguments],
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        limit=1 << 20,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    lines: list[str] = []
    try:
        async with asyncio.timeout(LONGEST):
            while line := await process.stdout.readline():
                lines.append(line.decode(errors="replace").rstrip())
                if SCAN in lines[-1] and (enough := enough - 1) == 0:
                    process.stdin.write(b"\n")
            await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()
        server.close()
    return lines


@pytest.mark.skipif(not READER.exists(), reason="libLMS1xx: built by scripts/scanner_peers")
def test_lib_lms1xx_reads_a_hundred_scans() -> None:
    lines = clock.run(read_by(str(READER), "127.0.0.1", "{port}", "100", enough=100), simulated=False)
    assert lines[0] == "configuration 5000 5000 -450000 2250000"
    scans = [[int(word) for word in line.split()] for line in lines[1:]]
    assert len(scans) == 100
    assert all(scan == [541, *TRUE] for scan in scans)


@pytest.mark.skipif(GRABBER is None, reason="rawlog-grabber of MRPT: installed by scripts/scanner_peers")
def test_rawlog_grabber_records_scans(tmp_path: Path) -> None:
    async def main() -> list[str]:
        return await read_by(
            "sh", "-c", f"sed -i s/PORT/{{port}}/ {file} && exec {GRABBER} {file}", enough=40, spin_up=0.5
        )

    file = tmp_path / "lms.ini"
    file.write_text(GRABBING.format(folder=tmp_path))
    lines = clock.run(main(), simulated=False)
    assert sum(f"{SCAN} 1081" in line for line in lines) >= 40
