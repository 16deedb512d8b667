"""The jobs of drives over a serial line: the same as over CAN, on simulated lines and on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
import re
import tty
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from core_builders import ROBOT
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo
from serial_rig import STRAIGHT, SerialRig, on_line

from artemis import clock
from artemis.app import run_mission
from artemis.cli import check
from artemis.commands import devices
from artemis.commands.calibrate_gains import Wanted, calibrate_gains
from artemis.commands.calibrate_steering import calibrate_steering
from artemis.commands.configure import configure_drives
from artemis.commands.simulate_serial import simulate_serial
from artemis.devices.can_bus import FrameBus
from artemis.devices.inventory import ask_nodes
from artemis.devices.memory import configure, read_gains, store
from artemis.devices.serial_frames import SerialProtocol
from artemis.devices.serial_line import SerialLine
from artemis.devices.serial_port import TtyPort
from artemis.drive_states import DriveState, Nmt
from artemis.errors import ConfigError, DeviceLost, DeviceTimeout
from artemis.mission.loading import load_mission
from artemis.sim.bus import SimBus
from artemis.sim.serial_drive import serial_drive
from artemis.sim.serial_pty import PseudoTerminal
from artemis.sim.serial_wire import SerialSettings
from artemis.sim.world import World
from artemis.values import JobKind

MISSIONS = Path(__file__).parents[2] / "missions"
MISSION = f"""\
mission: line
robot: {MISSIONS / "robots" / "artemis.yaml"}
bus: {{serial: /dev/no-such-port, baud: 115200}}
steps:
  - calibrate: {{steering: from_potentiometers}}
"""
Work = Callable[[FrameBus], Awaitable[object]]


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "artemis.yaml").write_bytes((MISSIONS / "robots" / "artemis.yaml").read_bytes())
    path = tmp_path / "line.yaml"
    path.write_text(MISSION.replace(str(MISSIONS) + "/", ""))
    return path


def contents(world: World) -> list[dict[int, int]]:
    return [dict(node._dictionary.values) for node in world.nodes]


def over_can(work: Work) -> World:
    async def main() -> World:
        loop = asyncio.get_running_loop()
        world = World(ROBOT, STRAIGHT, start=loop.time())
        bus = SimBus(world, ROBOT.bitrate, loop)
        await asyncio.sleep(0.2)
        await work(bus)
        return world

    return clock.run(main(), simulated=True)


def over_serial(work: Work, protocol: SerialProtocol) -> World:
    worlds: list[World] = []

    async def test(rig: SerialRig) -> None:
        await work(rig.line)
        assert not rig.line.faults
        worlds.append(rig.world)

    on_line(test, protocol)
    return worlds[0]


# ---------------------------------------------------------------------------------------------- the same jobs


@pytest.mark.parametrize("protocol", SerialProtocol)
def test_drives_are_configured_as_over_can(protocol: SerialProtocol) -> None:
    async def work(bus: FrameBus) -> None:
        done: list[str] = []
        await configure(ROBOT, bus, done.append, keep=True)
        assert done == list(ROBOT.drives)

    can, serial = over_can(work), over_serial(work, protocol)
    assert contents(serial) == contents(can) != contents(over_can(lambda bus: asyncio.sleep(0)))
    for node in serial.nodes:
        assert node.state is DriveState.SWITCH_ON_DISABLED
        assert node.nmt is Nmt.PRE_OPERATIONAL
        assert node.read(0x1016, 1) == 0, "nobody keeps it alive"


def test_drives_are_left_pre_operational_though_the_line_is_closed_at_once() -> None:
    async def test(rig: SerialRig) -> None:
        await configure(ROBOT, rig.line, lambda name: None, keep=False)
        rig.line.close()
        await asyncio.sleep(0.1)
        assert {node.nmt for node in rig.world.nodes} == {Nmt.PRE_OPERATIONAL}

    on_line(test)


def test_calibration_is_stored_and_gains_are_read_as_over_can() -> None:
    told: list[dict[str, tuple[int, ...] | str]] = []

    async def work(bus: FrameBus) -> None:
        await store(ROBOT, bus, JobKind.WRITE_CALIBRATION, {"steer-left": (1, 2, 3, 4)}, lambda name: None)
        told.append(await read_gains(ROBOT, bus))

    assert contents(over_serial(work, SerialProtocol.EPOS1)) == contents(over_can(work))
    assert told[0] == told[1]
    assert all(isinstance(gains, tuple) for gains in told[0].values())


def test_drives_are_asked_who_they_are_as_over_can() -> None:
    reports = []

    async def work(bus: FrameBus) -> None:
        reports.append(await ask_nodes(ROBOT, bus))

    over_serial(work, SerialProtocol.EPOS1)
    over_can(work)
    for serial, can in zip(*reports, strict=True):
        assert (serial.vendor, serial.product, serial.serial, serial.history) == (
            can.vendor, can.product, can.serial, can.history,
        )  # fmt: skip
        assert serial.nmt is None
        assert "passes no serial line" in serial.unheard


def test_a_drive_that_is_missing_is_named_and_the_next_are_not_configured() -> None:
    async def test(rig: SerialRig) -> None:
        rig.world.nodes[1].power_off()
        done: list[str] = []
        with pytest.raises(DeviceTimeout, match="traction-right: node 2 does not answer"):
            await configure(ROBOT, rig.line, done.append, keep=False)
        assert done == ["traction-left"]

    on_line(test)


# ---------------------------------------------------------------------------------------------- commands


def test_nothing_is_driven_over_a_serial_line(mission: Path) -> None:
    why = f"{mission}:3:1: bus: nothing is driven over a serial line: an EPOS"
    with pytest.raises(ConfigError) as caught:
        run_mission(load_mission(mission), mission)
    assert caught.value.problems[0].startswith(why)
    assert not (mission.parent / "runs").exists()
    with pytest.raises(ConfigError) as caught:
        check([mission])
    assert caught.value.problems[0].startswith(why)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("{serial: /dev/ttyUSB0, baud: 1200}", "bus.baud"),
        ("{serial: /dev/ttyUSB0, bitrate: 9600}", "bus.bitrate"),
        ("{serial: /dev/ttyUSB0, protocol: epos3}", "bus.protocol"),
        (
            "{serial: /dev/ttyUSB0, protocol: epos4}",
            "bus.protocol: the line leads to traction-left (EPOS): write protocol: epos1",
        ),
        ("{serial: ''}", "bus.serial"),
        ("{port: /dev/ttyUSB0}", "bus"),
        ("{interface: socketcan}", "bus: socketcan needs a channel, such as channel: can0"),
        ("{serial: /dev/ttyUSB0, interface: socketcan}", "bus: expected simulation, python-can's options"),
    ],
)
def test_wrong_words_are_named(mission: Path, words: str, problem: str) -> None:
    mission.write_text(mission.read_text().replace("{serial: /dev/no-such-port, baud: 115200}", words))
    with pytest.raises(ConfigError) as caught:
        load_mission(mission)
    assert f": {problem}" in caught.value.problems[0]


def test_calibrations_that_move_a_wheel_are_refused_with_the_mission(mission: Path) -> None:
    where = re.escape(f"{mission}:3:1: bus: nothing is driven over a serial line")
    wanted = Wanted(drives=("steer-left",), gains={}, tried=True, yes=True)
    with pytest.raises(ConfigError, match=where):
        calibrate_gains(mission, wanted)
    given = {"left": 0.0, "right": 0.0}
    with pytest.raises(ConfigError, match=where):
        calibrate_steering(mission, None, given, new=False, yes=True, simulate=False, write_simulated=False)


def test_configure_tells_each_drive(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert configure_drives(mission, store=True, simulate=True) == 0
    first, *drives = capsys.readouterr().out.splitlines()
    assert first == "configures ARTEMIS (simulated): every drive is stopped, and off"
    assert drives == [f"  {name}: configured, each setting read back, stored" for name in ROBOT.drives]
    assert configure_drives(mission, store=False, simulate=False) == 1
    told = capsys.readouterr().out
    assert "serial /dev/no-such-port: cannot be opened: No such file or directory; is the adapter plugged in?" in told
    assert f"not configured: {', '.join(ROBOT.drives)}" in told


def test_devices_shows_the_drives_on_a_line(mission: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def ask() -> tuple[list[object], str]:
        nodes, trouble = await devices._ask(load_mission(mission), True)
        return list(nodes), trouble

    nodes, trouble = clock.run(ask(), simulated=True)
    assert (len(nodes), trouble) == (4, "")
    devices._show_drives(load_mission(mission))
    assert "cannot be opened" in capsys.readouterr().out


def test_wrong_options_of_the_simulation_are_refused() -> None:
    with pytest.raises(ConfigError) as caught:
        simulate_serial(MISSIONS / "robots" / "artemis.yaml", "epos9", 1200, 0.0, 1, None)
    assert [problem.split(":")[0] for problem in caught.value.problems] == ["--serial epos9", "--baud 1200"]


@pytest.mark.parametrize(
    ("robot", "protocol", "problem"),
    [
        ("artemis", "epos4", "(EPOS): write --serial epos1"),
        ("artemis_epos4", "epos1", "(EPOS4): write --serial epos4"),
        ("artemis_cia402", "epos1", "(CiA 402 drive): artemis knows no serial protocol of it"),
    ],
)
def test_a_simulated_line_leads_to_no_drive_that_does_not_speak_its_protocol(
    robot: str, protocol: str, problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        simulate_serial(MISSIONS / "robots" / f"{robot}.yaml", protocol, 9600, 0.0, 1, None)
    assert caught.value.problems == [f"--serial {protocol}: the line leads to traction-left {problem}"]


# ---------------------------------------------------------------------------------------------- a real terminal


def on_terminal(test: Callable[[PseudoTerminal, World], Awaitable[None]]) -> None:
    """In real time; nothing depends on how much of it passes."""

    async def main() -> None:
        world = World(ROBOT, STRAIGHT, start=asyncio.get_running_loop().time())
        wire, drive = serial_drive(world, ROBOT.bitrate, SerialProtocol.EPOS1, SerialSettings(time_limit_s=30.0))
        terminal = PseudoTerminal(wire)
        async with asyncio.timeout(20.0):
            while world.nodes[0].nmt is not Nmt.PRE_OPERATIONAL:
                await asyncio.sleep(0.01)
            await test(terminal, world)
        drive.close()

    clock.run(main(), simulated=False)


def test_any_program_can_speak_with_the_simulated_drive() -> None:
    """Bytes of the guide's example (6.2.4), by a program that knows nothing of ours."""

    async def test(terminal: PseudoTerminal, world: World) -> None:
        port = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(port)
        os.set_blocking(port, False)

        async def get(count: int) -> bytes:
            data = b""
            while len(data) < count:
                await asyncio.sleep(0.001)
                try:
                    data += os.read(port, count - len(data))
                except BlockingIOError:
                    continue
            return data

        async def ask(opcode: str, rest: str) -> str:
            os.write(port, bytes.fromhex(opcode))
            confirmed = await get(1)
            os.write(port, bytes.fromhex(rest))
            confirmed += await get(2)
            assert confirmed == b"OO\0"
            os.write(port, b"O")
            length = await get(1)
            data = await get(2 * (length[0] + 1) + 2)
            os.write(port, b"O")
            return (length + data).hex(" ")

        answer = await ask("10", "01 03 20 01 02 88 A8")
        assert answer.startswith("03 00 00 00 00 33 20 ")  # firmware 0x2033, behind the gateway
        os.write(port, b"\x77")
        assert await get(1) == b"F"
        os.write(port, b"\x10")
        assert await get(1) == b"O"
        os.write(port, bytes.fromhex("01 03 20 01 02 88 A9"))
        assert await get(1) == b"F"
        os.close(port)
        terminal.close()

    on_terminal(test)


def test_a_port_of_this_computer_is_opened_alone_and_lost_with_its_adapter() -> None:
    """SER-05 on a real descriptor."""

    async def test(terminal: PseudoTerminal, world: World) -> None:
        port = TtyPort(terminal.path, 115200)
        with pytest.raises(DeviceLost, match=r"cannot be opened: .*another program"):
            TtyPort(terminal.path, 115200)
        line = SerialLine(port, SerialProtocol.EPOS1)
        assert await line.objects("drive", 3).read(0x1018, 4, 4) == b"\x03\0\0\0"
        terminal.close()
        with pytest.raises(DeviceLost, match=r"\(SER-05\); is its adapter plugged in"):
            await line.objects("drive", 3).read(0x1018, 4, 4)
        line.close()
        line.close()

    on_terminal(test)


def test_ports_with_hardware_behind_them_are_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [ListPortInfo(path, skip_link_detection=True) for path in ("/dev/ttyUSB0", "/dev/ttyS0")]
    found[0].hwid, found[0].description = "USB VID:PID=0403:6001", "FT232R USB UART"
    monkeypatch.setattr(list_ports, "comports", lambda: found)
    monkeypatch.setattr(devices, "detected_adapters", lambda: [])
    devices._show_adapters()
    assert capsys.readouterr().out.splitlines()[2:] == [
        "serial ports",
        "  bus: {serial: /dev/ttyUSB0}  FT232R USB UART",
    ]
