"""`artemis devices`: what it says of inputs, adapters and drives."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import can
import pytest
from evdev_devices import EventDevice, FakeEvdev
from hid_devices import DESCRIPTORS, STICK

from artemis import clock
from artemis.commands import devices
from artemis.devices.can_bus import Frame, detected_adapters
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo
from artemis.devices.inputs import InputPorts
from artemis.devices.inventory import NodeReport, ask_nodes
from artemis.drive_states import Nmt
from artemis.errors import ConfigError, DeviceLost
from artemis.sim.bus import SimBus
from artemis.sim.world import World
from artemis.testing.fake_hid import FakeHid
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)
UNKNOWN = HidInfo("/dev/hidraw0", "usb", 0x1234, 0x5678, "S1", "Unknown Stick", 0, 0x10004)


def shown(hid: FakeHid, capsys: pytest.CaptureFixture[str]) -> list[str]:
    devices.show_inputs(hid)
    return capsys.readouterr().out.splitlines()


def test_an_input_is_shown_with_its_identity_and_fields(capsys: pytest.CaptureFixture[str]) -> None:
    hid = FakeHid()
    hid.plug(UNKNOWN, DESCRIPTORS["dragonrise_0006"])
    assert shown(hid, capsys) == [
        "inputs",
        "  Unknown Stick (usb 1234:5678, serial S1, /dev/hidraw0)",
        f"    descriptor  {Identity.of(UNKNOWN, DESCRIPTORS['dragonrise_0006']).descriptor_hash}",
        "    fields      x, y, z, z.2, rz, hat, 12 buttons, 8 others",
        "    profile     none; make one: artemis calibrate input",
    ]
    assert not hid.is_open()


def test_one_that_may_not_be_opened_comes_with_the_rule(capsys: pytest.CaptureFixture[str]) -> None:
    hid = FakeHid()
    hid.plug(UNKNOWN, STICK, permitted=False)
    _, name, problem = shown(hid, capsys)
    assert name == "  Unknown Stick (usb 1234:5678, serial S1, /dev/hidraw0)"
    assert 'KERNELS=="*:1234:5678.*"' in problem


def test_one_with_a_broken_descriptor_says_where(capsys: pytest.CaptureFixture[str]) -> None:
    hid = FakeHid()
    hid.plug(UNKNOWN, b"\x05")
    assert shown(hid, capsys)[-1] == "    problem     report descriptor, byte 0: the item is cut off"
    assert not hid.is_open()


def test_keyboards_are_left_out_whether_the_system_tells_or_their_descriptor(
    capsys: pytest.CaptureFixture[str],
) -> None:
    hid, keyboard = FakeHid(), bytes.fromhex("05 01 09 06 a1 01 c0")
    hid.plug(HidInfo("/dev/hidraw1", "usb", 1, 2, "", "keyboard", 0, 0x10006), keyboard, permitted=False)
    hid.plug(HidInfo("/dev/hidraw2", "usb", 1, 2, "", "keyboard", 0), keyboard)
    assert shown(hid, capsys) == [
        "inputs",
        "  no joystick, gamepad or wheel",
    ]


def test_a_computer_without_hid_is_no_failure(capsys: pytest.CaptureFixture[str]) -> None:
    class NoHid(FakeHid):
        def enumerate(self) -> list[HidInfo]:
            raise DeviceLost("HID", "no back end")

    assert shown(NoHid(), capsys) == ["inputs", "  no back end"]


def test_a_wrong_profile_of_ones_own_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong() -> None:
        raise ConfigError(["mine.yaml:1:1: wrong"])

    monkeypatch.setattr(devices, "all_profiles", wrong)
    hid = FakeHid()
    hid.plug(UNKNOWN, STICK)
    assert shown(hid, capsys)[-1] == "    profile     mine.yaml:1:1: wrong"


def test_a_pad_that_only_evdev_shows_is_shown_with_its_profile(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    computer = FakeEvdev(tmp_path)
    computer.plug(EventDevice())
    computer.plug(EventDevice(name="shown by hidraw", hidraw="hidraw0"))
    devices.show_inputs(computer.port)
    assert capsys.readouterr().out.splitlines() == [
        "inputs",
        "  Microsoft X-Box 360 pad (usb 045e:028e, /dev/input/event0)",
        "    capabilities 3fc97b8c6bf7ca1f",
        "    fields      x, y, z, rx, ry, rz, hat, 11 buttons",
        "    profile     xbox-360-usb",
    ]


def test_the_interfaces_of_this_computer_are_looked_at_together(monkeypatch: pytest.MonkeyPatch) -> None:
    info = HidInfo("/dev/input/event0", "usb", 1, 2, "", "Pad", -1, source="evdev")

    def no_hid(port: object) -> list[HidInfo]:
        raise DeviceLost("HID", "no back end")

    monkeypatch.setattr("artemis.devices.hid.port.Hidraw.enumerate", no_hid)
    monkeypatch.setattr("artemis.devices.evdev.port.Evdev.enumerate", lambda port: [info])
    assert InputPorts().enumerate() == [info]
    with pytest.raises(DeviceLost, match=r"Pad .*is read by the extra evdev|Pad .*is not there"):
        InputPorts().open(info)
    monkeypatch.setattr("artemis.devices.evdev.port.Evdev.enumerate", lambda port: [])
    with pytest.raises(DeviceLost, match="no back end"):
        InputPorts().enumerate()
    assert InputPorts(["evdev"]).enumerate() == []


# ---------------------------------------------------------------------------------------------- adapters and drives


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A computer without a device."""
    monkeypatch.setattr(devices, "InputPorts", FakeHid)
    monkeypatch.setattr(devices, "detected_adapters", list)
    return monkeypatch


def test_adapters_are_shown_as_a_mission_names_them(
    capsys: pytest.CaptureFixture[str], bare: pytest.MonkeyPatch
) -> None:
    bare.setattr(devices, "detected_adapters", lambda: [{"interface": "socketcan", "channel": "can0"}])
    devices.show_devices(None)
    assert capsys.readouterr().out.splitlines()[:2] == ["CAN adapters", "  bus: {interface: socketcan, channel: can0}"]


def test_a_back_end_that_fails_is_told(capsys: pytest.CaptureFixture[str], bare: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise DeviceLost("CAN", "adapters cannot be looked for: OSError: x")

    bare.setattr(devices, "detected_adapters", fail)
    devices.show_devices(None)
    assert "  adapters cannot be looked for: OSError: x" in capsys.readouterr().out.splitlines()


@pytest.mark.usefixtures("bare")
def test_the_simulated_drives_of_a_mission_answer(capsys: pytest.CaptureFixture[str]) -> None:
    devices.show_devices(MISSIONS / "figure_eight.yaml")
    lines = capsys.readouterr().out.splitlines()
    assert lines[-5] == "drives of ARTEMIS (simulated)"
    assert lines[-2] == (
        "  steer-left      node   3  vendor 0x000000FB, product 0x60100000, revision 0x20330000, serial 0x00000003, "
        "type 0x00020192; pre-operational; past errors: none"
    )


@pytest.mark.usefixtures("bare")
def test_a_bad_mission_is_refused_before_anything_is_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text("mission: x\n")
    with pytest.raises(ConfigError):
        devices.show_devices(tmp_path / "mission.yaml")
    assert capsys.readouterr().out == ""


def test_a_bus_that_cannot_be_opened_is_told(capsys: pytest.CaptureFixture[str], bare: pytest.MonkeyPatch) -> None:
    def no_bus(words: object) -> None:
        raise DeviceLost("CAN socketcan can0", "cannot be opened")

    bare.setattr(devices, "CanBus", no_bus)
    devices.show_devices(MISSIONS / "figure_eight_udp.yaml")
    assert capsys.readouterr().out.splitlines()[-2:] == ["drives of ARTEMIS", "  CAN socketcan can0: cannot be opened"]


class _Overheard(SimBus):
    """Keeps what we sent."""

    def __init__(self, world: World, bitrate: int, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__(world, bitrate, loop)
        self.sent: list[Frame] = []

    def send(self, frame: Frame) -> None:
        self.sent.append(frame)
        super().send(frame)


def test_back_ends_that_are_always_there_are_no_adapters(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [{"interface": name, "channel": "0"} for name in ("virtual", "pcan", "udp_multicast")]
    monkeypatch.setattr(can, "detect_available_configs", lambda: found)
    assert detected_adapters() == [{"interface": "pcan", "channel": "0"}]


def test_whatever_a_back_end_raises_says_that_adapters_cannot_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise AssertionError("driver")

    monkeypatch.setattr(can, "detect_available_configs", fail)
    with pytest.raises(DeviceLost, match="CAN: adapters cannot be looked for: AssertionError: driver"):
        detected_adapters()


async def _asked(silent: str) -> tuple[list[NodeReport], list[Frame]]:
    """The drives' answers while one is without power, and another reported an error; and all frames of ours."""
    loop = asyncio.get_running_loop()
    world = World(ROBOT, start=loop.time())
    bus = _Overheard(world, ROBOT.bitrate, loop)
    world.drive(silent).power_off()
    loop.call_later(0.2, world.drive("steer-left").emergency, 0x7320, 0.2)  # it has started by then
    return await ask_nodes(ROBOT, bus), bus.sent


@pytest.mark.parametrize(
    ("mission", "code", "told"),
    [
        ("figure_eight.yaml", 0, ""),
        ("figure_eight.yaml", 6, "; switched on again it speaks 20 kbit/s"),
        ("figure_eight_epos4.yaml", 6, "; switched on again it speaks 50 kbit/s"),
        ("figure_eight_epos4.yaml", 9, "; switched on again it speaks whatever bit rate it hears first"),
    ],
)
@pytest.mark.usefixtures("bare")
def test_a_drive_that_will_speak_another_bit_rate_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, mission: str, code: int, told: str
) -> None:
    class Stored(World):
        def __init__(self, *given: Any, **words: Any) -> None:  # noqa: ANN401 (as of a World)
            super().__init__(*given, **words)
            self.nodes[-1].poke(0x2001, 0, code)

    monkeypatch.setattr("artemis.sim.world.World", Stored)
    devices.show_devices(MISSIONS / mission)
    assert capsys.readouterr().out.splitlines()[-1].endswith(f"past errors: none{told}")


def test_silent_drives_errors_of_the_past_and_states_are_told_by_reading_alone() -> None:
    nodes, sent = clock.run(_asked("traction-left"), simulated=True)
    by_name = {node.name: node for node in nodes}
    assert list(by_name) == list(ROBOT.drives)
    assert by_name["traction-left"].problem.startswith("no answer to a read of 0x1000:0 after 3 tries")
    assert by_name["steer-left"].history == (0x7320,)
    assert by_name["steer-right"].nmt is Nmt.PRE_OPERATIONAL
    assert {frame.id - 0x600 for frame in sent} == {drive.node_id for drive in ROBOT.drives.values()}
    assert {frame.data[0] for frame in sent} <= {0x40, 0x60, 0x70, 0x80}  # reads, their segments, aborts


@pytest.mark.parametrize("there", ["artemis.yaml", "artemis_epos4.yaml"])
def test_drives_of_another_family_than_the_robot_file_says_still_tell_who_they_are(there: str) -> None:
    robots = {
        name: RobotFile.model_validate(load(MISSIONS / "robots" / name).data)
        for name in ("artemis.yaml", "artemis_epos4.yaml")
    }
    described = next(robot for name, robot in robots.items() if name != there)

    async def asked() -> list[NodeReport]:
        loop = asyncio.get_running_loop()
        world = World(robots[there], start=loop.time())
        return await ask_nodes(described, SimBus(world, described.bitrate, loop))

    nodes = clock.run(asked(), simulated=True)
    assert [node.problem for node in nodes] == [""] * 4
    versions = {drive.hardware_version for drive in robots[there].drives.values()}
    assert {node.product >> 16 for node in nodes} <= versions
