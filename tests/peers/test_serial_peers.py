"""Programs of others speak with our simulated drives on a pseudo-terminal. `scripts/serial_peers` builds them."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from artemis import clock
from artemis.devices.serial_frames import SerialProtocol
from artemis.drive_states import DriveState, Nmt
from artemis.sim.serial_drive import serial_drive
from artemis.sim.serial_pty import PseudoTerminal
from artemis.sim.serial_wire import SerialSettings
from artemis.sim.world import World

sys.path.append(str(Path(__file__).parents[1] / "unit"))
from core_builders import ROBOT

BUILT = Path(__file__).parents[2] / "build" / "serial_peers"
HOW = "built by scripts/serial_peers"
LONGEST = 40.0
"""[s]"""

pytestmark = pytest.mark.realtime


def spoken(program: str, protocol: SerialProtocol) -> tuple[list[str], World]:
    """What a program says that is given a terminal with simulated drives."""

    async def main() -> tuple[list[str], World]:
        world = World(ROBOT, start=asyncio.get_running_loop().time())
        wire, drive = serial_drive(world, ROBOT.bitrate, protocol, SerialSettings())
        terminal = PseudoTerminal(wire)
        async with asyncio.timeout(LONGEST):
            while world.nodes[0].nmt is not Nmt.PRE_OPERATIONAL:
                await asyncio.sleep(0.01)
            process = await asyncio.create_subprocess_exec(
                str(BUILT / program), terminal.path, stdout=asyncio.subprocess.PIPE
            )
            said, _ = await process.communicate()
        assert process.returncode == 0
        drive.close()
        terminal.close()
        return said.decode().splitlines(), world

    return clock.run(main(), simulated=False)


@pytest.mark.skipif(not (BUILT / "serial_epos1").exists(), reason=f"library of the sailing robot Avalon: {HOW}")
def test_library_of_avalon_drives_four_drives_over_one_line() -> None:
    said, world = spoken("serial_epos1", SerialProtocol.EPOS1)
    expected = []
    for node in (1, 2, 3, 4):
        expected += [
            f"{node} read 1018:4 00000000 {node:08x}",
            f"{node} read 1000:0 00000000 00020192",
            f"{node} read 3333:0 06020000 00000000",
            f"{node} write 6065:0 00000000",
            f"{node} read 6065:0 00000000 {123456:08x}",
            f"{node} write 6041:0 06010002",
            f"{node} write 6040:0 00000000",
            f"{node} write 6040:0 00000000",
            f"{node} start 00000000",
        ]
    assert said == [*expected, "9 read 1018:4 05040000 00000000", "0 frame 00000000"]
    assert {(node.state, node.nmt) for node in world.nodes} == {(DriveState.OPERATION_ENABLE, Nmt.OPERATIONAL)}


@pytest.mark.skipif(not (BUILT / "serial_epos4").exists(), reason=f"driver of EPFL's rocket team: {HOW}")
def test_driver_of_a_rocket_reads_and_writes_by_frames_of_an_epos4() -> None:
    said, _ = spoken("serial_epos4", SerialProtocol.EPOS4)
    assert said == [
        "1 read 1018:4 00000000 00000001",
        "1 read 1000:0 00000000 00020192",
        "1 write 6065:0 00000000",
        f"1 read 6065:0 00000000 {123456:08x}",
        "1 write 6065:0 00000000",
        "1 read 6065:0 00000000 00000090",
        "1 write 6065:0 00000000",
        "1 read 6065:0 00000000 90900290",
    ]
