"""Programs of others read our simulated LMS100 over TCP. `scripts/scanner_peers` builds and installs them."""

from __future__ import annotations

import asyncio
import re
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
GRABBER, EDITOR = shutil.which("rawlog-grabber"), shutil.which("rawlog-edit")
TRUE = [1000 + 3 * beam for beam in range(541)]
GRABBING = 14.0
"""It waits ten seconds before it asks whether the device measures [s]."""
HOW = "built by scripts/scanner_peers"

pytestmark = pytest.mark.realtime


async def output_of(*command: str) -> str:
    """Of a program that reads a simulated LMS100, whose port is {port}; it is interrupted in the end."""
    server = await serve_lms100(Lms100(spiral), "127.0.0.1", 0)
    port = str(server.sockets[0].getsockname()[1])
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        *[part.format(port=port) for part in command], stdin=pipe, stdout=pipe, stderr=asyncio.subprocess.STDOUT
    )
    try:
        async with asyncio.timeout(GRABBING):
            out, _ = await process.communicate() if "{port}" in command else (await process.stdout.read(), b"")  # type: ignore[union-attr]
    except TimeoutError:
        process.send_signal(2)
        out, _ = await process.communicate()
    server.close()
    return out.decode(errors="replace")


@pytest.mark.skipif(not READER.exists(), reason=f"libLMS1xx: {HOW}")
def test_lib_lms1xx_reads_a_hundred_scans() -> None:
    lines = clock.run(output_of(str(READER), "127.0.0.1", "{port}", "100"), simulated=False).splitlines()
    assert lines[0] == "configuration 5000 5000 -450000 2250000"
    scans = [[int(word) for word in line.split()] for line in lines[1:]]
    assert len(scans) == 100
    assert all(scan == [541, *TRUE] for scan in scans)
