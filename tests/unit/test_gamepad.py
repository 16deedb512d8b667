"""The plugin `gamepad` on devices in memory: enabling, presses between ticks, silence, loss and return."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from pathlib import Path

import pytest
from hid_devices import DESCRIPTORS
from pad import MISSIONS, NAMES, ROBOT, TICK, Pad, encode
from pydantic import ValidationError

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.errors import ConfigError, DeviceLost, HidError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.guard import PluginGuard
from artemis.plugins.inputs.controls import Controls, named_fields
from artemis.plugins.inputs.gamepad import FIND, GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import DOUBT, GONE, SLOW, STUCK
from artemis.plugins.inputs.profiles import SHIPPED, Profile
from artemis.plugins.stated import STALE
from artemis.testing import contracts
from artemis.testing.contracts import InputContract
from artemis.testing.fake_hid import FakeHandle, FakeHid
from artemis.values import Request

ALWAYS, COUNTED = "sony-dualshock-4-usb", "sony-dualsense-usb"
TOP = ROBOT.limits.speed_m_s

# ---------------------------------------------------------------------------------------------- driving


@pytest.mark.parametrize("name", NAMES)
def test_every_known_device_drives_and_stops(name: str) -> None:
    pad = Pad(name)
    assert pad.ready().enabled
    pad.move(**({"y": 1.0} if pad.profile.kind == "stick" else {"gas": 1.0}))
    pad.send()
    sample = pad.tick()
    assert (sample.enabled, sample.neutral) == (True, False)
    assert sample.speed == pytest.approx(TOP)
    assert sample.steering == pytest.approx(0.0, abs=0.001)
    pad.press("quickstop")
    pad.send()
    assert pad.requests() == [Request.QUICKSTOP]


@pytest.mark.parametrize(("x", "y", "degrees", "speed"), [(-1, 1, 45, TOP), (1, 1, -45, TOP), (1, -1, -45, -TOP)])
def test_stick_to_the_left_steers_left_and_pulled_drives_back(x: float, y: float, degrees: float, speed: float) -> None:
    pad = Pad(hysteresis_deg=0.0)
    pad.ready()
    pad.move(x=x, y=y)
    pad.send()
    sample = pad.tick()
    assert math.degrees(sample.steering) == pytest.approx(degrees, abs=0.1)
    assert sample.speed == pytest.approx(speed)


def test_sample_shows_every_stage() -> None:
    pad = Pad(deadzone=0.2, expo=0.5)
    pad.ready()
    pad.move(y=0.6)
    pad.send()
    sample = pad.tick()
    assert sample.raw == (508.0, pad.levels["y"])
    assert sample.axes == pytest.approx((0.0, 0.6), abs=0.002)
    assert sample.centred == pytest.approx((0.0, 0.5), abs=0.002)
    assert sample.shaped == pytest.approx((0.0, 0.5 * 0.125 + 0.5 * 0.5), abs=0.002)
    assert sample.speed == pytest.approx(sample.shaped[1] * TOP)
    assert sample.buttons == tuple(role == "enable" for role in pad.profile.buttons)


def test_newest_of_many_reports_counts() -> None:
    pad = Pad()
    pad.ready()
    for y in (0.2, 1.0, 0.5):
        pad.move(y=y)
        pad.send()
    assert pad.tick().axes[1] == pytest.approx(0.5, abs=0.002)


def test_press_and_release_between_two_ticks_counts_once() -> None:
    pad = Pad()
    pad.ready()
    for _ in range(2):
        pad.press("slower", "arm")
        pad.send()
        pad.send()
        pad.press("slower", "arm", down=False)
        pad.send()
    assert pad.requests() == [Request.ARM, Request.ARM]
    assert pad.requests() == []
    pad.move(y=1.0)
    pad.send()
    assert pad.tick().speed == pytest.approx(0.8 * TOP)


# ---------------------------------------------------------------------------------------------- enabling


def test_enable_held_from_the_start_is_no_enable() -> None:
    pad = Pad()
    pad.press("enable")
    pad.send()
    assert not pad.tick(2.0, reports=True).enabled
    pad.press("enable", down=False)
    pad.send()
    pad.tick(0.6)
    pad.press("enable")
    pad.send()
    assert pad.tick().enabled


def test_everything_has_to_rest_for_a_while_first() -> None:
    pad = Pad()
    pad.move(y=0.5)
    pad.send()
    assert not pad.tick(2.0).neutral
    pad.release()
    pad.send()
    assert pad.tick(0.3).neutral
    pad.press("enable")
    pad.send()
    assert not pad.tick(1.0).enabled


def test_releasing_enable_stops_at_once() -> None:
    pad = Pad()
    pad.ready()
    pad.press("enable", down=False)
    pad.send()
    assert not pad.tick().enabled


def test_without_deadman_nothing_is_held_but_rest_comes_first() -> None:
    pad = Pad(deadman=False)
    pad.move(y=1.0)
    pad.send()
    assert not pad.tick(2.0).enabled
    pad.release()
    pad.send()
    sample = pad.tick(0.6)
    assert (sample.enabled, sample.neutral) == (False, True)
    pad.move(y=1.0)
    pad.send()
    sample = pad.tick()
    assert sample.enabled
    assert sample.speed == pytest.approx(TOP)


# ---------------------------------------------------------------------------------------------- silence


def test_held_stick_that_says_nothing_is_doubted_then_stopped() -> None:
    pad = Pad()
    pad.ready()
    pad.move(y=1.0)
    pad.send()
    pad.tick()
    held = pad.now
    while pad.now + TICK < held + DOUBT:
        sample = pad.tick()
        assert (sample.enabled, sample.age) == (True, 0.0)
        assert sample.speed == pytest.approx(TOP)
    pad.tick(2 * TICK)
    while pad.now + TICK < held + GONE:
        sample = pad.tick()
        assert (sample.enabled, sample.speed) == (True, SLOW)
    assert not pad.tick(3 * TICK).enabled
    pad.send()  # it comes back as it was: still held
    assert not pad.tick(1.0).enabled
    pad.release()
    pad.send()
    assert pad.ready().enabled


def test_silence_of_hands_that_want_nothing_is_no_matter() -> None:
    pad = Pad()
    pad.ready()
    assert pad.tick(60.0).enabled


def test_frozen_device_that_always_reports_grows_old() -> None:
    pad = Pad(ALWAYS)
    pad.tick(0.6, reports=True)
    pad.press("enable")
    pad.move(y=1.0)
    assert pad.tick(0.2, reports=True).age == 0.0
    pad.hid.freeze()
    ages = {sample.age: sample.enabled for sample in (pad.tick() for _ in range(12))}
    assert ages == {age: age <= STALE for age in ages if age is not None}
    assert set(ages.values()) == {True, False}
    pad.hid.plug(pad.info, pad.raw)  # thawed, but its handle is another one's: nothing arrives
    assert not pad.tick(1.0).enabled


def test_repeated_report_is_no_news_of_a_device_that_counts() -> None:
    pad = Pad(COUNTED)
    assert pad.tick(1.0, reports=True).age == 0.0
    for _ in range(10):
        pad.count -= 1  # as the one before
        sample = pad.tick(reports=True)
    assert sample.age == pytest.approx(0.2, abs=0.001)


def test_pedal_that_never_moves_stops_the_robot() -> None:
    pad = Pad("logitech-g27")
    pad.ready()
    pad.move(gas=1.0)
    assert pad.tick(STUCK - 1, reports=True).enabled
    assert not pad.tick(2.0, reports=True).enabled


def test_before_the_first_report_nothing_is_known() -> None:
    sample = Pad().tick()
    assert (sample.age, sample.neutral, sample.enabled) == (None, False, False)


# ---------------------------------------------------------------------------------------------- loss and return


def test_device_that_is_not_there_is_waited_for_then_lost() -> None:
    pad = Pad(plugged=False)
    sample = pad.tick(FIND - 2 * TICK)
    assert (sample.age, sample.neutral) == (None, False)
    with pytest.raises(DeviceLost, match="stick: no such device is plugged in"):
        pad.tick(4 * TICK)
    pad.hid.plug(pad.info, pad.raw)
    pad.now += 1.0
    assert not pad.is_lost()
    assert pad.ready().enabled


def test_unplugged_device_is_lost_in_the_next_tick_and_returns_disabled() -> None:
    pad = Pad()
    pad.ready()
    pad.hid.unplug()
    assert pad.is_lost()
    assert pad.is_lost()
    pad.hid.plug(pad.info, pad.raw)
    pad.now += 1.0
    sample = pad.tick()
    assert (sample.enabled, sample.neutral) == (False, False)
    assert sample.age == pytest.approx(1.08, abs=0.03)
    pad.send()  # enable still held
    assert not pad.tick(2.0).enabled
    pad.press("enable", down=False)
    pad.send()
    pad.tick(0.6)
    pad.press("enable")
    pad.send()
    assert pad.tick().enabled


def test_stop_goes_before_the_loss() -> None:
    pad = Pad()
    pad.ready()
    pad.press("quickstop")
    pad.send()
    (reader,) = pad.plugin._readers.values()
    reader._poll(pad.now)
    pad.hid.unplug()
    assert pad.requests() == [Request.QUICKSTOP]
    assert pad.is_lost()


def test_what_is_down_when_a_device_comes_was_not_pressed_but_a_stop_is() -> None:
    pad = Pad()
    pad.tick()
    pad.press("arm", "done", "quickstop")
    pad.send()
    assert pad.requests() == [Request.QUICKSTOP]


def test_garbage_is_out_of_range_for_the_border_and_changes_nothing() -> None:
    pad = Pad("logitech-g27")
    pad.ready()
    pad.move(gas=0.5)
    pad.send()
    good = pad.tick()
    guard = PluginGuard({"stick": pad.plugin}, lambda: 0.0)
    for _ in range(5):
        pad.hid.send(b"\x08\x00")
        pad.now += TICK
        guard.read(pad.now)
    assert [id for id, *_ in guard.take_problems()] == ["INP-06"]
    assert pad.tick() == good


def test_values_beyond_the_logical_range_are_garbage() -> None:
    raw = bytes.fromhex(
        "05 01 09 04 a1 01 09 30 09 31 15 00 26 ff 03 75 10 95 02 81 02 05 09 19 01 29 02 25 01 75 01 95 08 81 02 c0"
    )
    descriptor = parse_descriptor(raw)
    controls = Controls(profile_of_a_stick("x", "y"), named_fields("", descriptor))
    controls.take(descriptor.decode(bytes.fromhex("ff03 0002 01")) or {})
    assert controls.axes == (1.0, 0.0)
    assert controls.down == {"enable"}
    with pytest.raises(HidError, match="x is 1024, outside of 0 to 1023"):
        controls.take(descriptor.decode(bytes.fromhex("0004 0002 00")) or {})
    assert controls.axes == (1.0, 0.0)
    assert controls.down == {"enable"}


def profile_of_a_stick(x: str, y: str) -> Profile:
    axis = {"minimum": 0, "centre": 512, "maximum": 1023}
    return Profile.model_validate(
        {
            "name": "stick",
            "device": {"bus": "usb", "vendor": 1, "product": 2, "descriptor": "0" * 16},
            "kind": "stick",
            "reports": "on_change",
            "axes": {"x": {"field": x, **axis}, "y": {"field": y, **axis}},
            "buttons": {"enable": "button.1", "quickstop": "button.2"},
        }
    )


def test_other_reports_are_passed_over() -> None:
    pad = Pad("xbox-elite-2-bluetooth")
    pad.ready()
    pad.hid.send(bytes.fromhex("048b"))
    assert pad.tick().enabled


# ---------------------------------------------------------------------------------------------- stopping


def test_stop_button_wakes_once_and_is_asked_for_once() -> None:
    pad = Pad()
    pad.ready()
    assert pad.woken == 0
    pad.press("quickstop")
    pad.send()
    pad.send()
    assert pad.requests() == [Request.QUICKSTOP]
    assert pad.woken == 1
    pad.press("quickstop", down=False)
    pad.send()
    pad.press("quickstop")
    pad.send()
    assert pad.requests() == [Request.QUICKSTOP]
    assert pad.woken == 2


def test_readers_thread_wakes_the_run_before_anybody_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    pad = Pad()
    woken, opened = threading.Event(), threading.Event()

    class Announcing(FakeHid):
        def open(self, info: HidInfo) -> FakeHandle:
            handle = super().open(info)
            opened.set()
            return handle

    hid = Announcing()
    monkeypatch.setattr("artemis.plugins.inputs.choosing.InputPorts", lambda sources: hid)
    hid.plug(pad.info, pad.raw)
    context = PluginContext(name="stick", robot=ROBOT, folder=MISSIONS, wake=woken.set)
    plugin = GamepadInput(GamepadConfig(profile="logitech-extreme-3d-pro"), context)
    assert opened.wait(20.0)
    pad.press("quickstop")
    hid.send(encode(pad.descriptor, 0, pad.levels))
    assert woken.wait(20.0)
    assert plugin.read(0.0).requests == (Request.QUICKSTOP,)
    plugin.close()
    assert not hid.is_open()


def test_hard_brake_stops_and_wakes() -> None:
    pad = Pad("logitech-g29")
    pad.ready()
    pad.move(gas=1.0, brake=0.5)
    pad.send()
    assert pad.requests() == []
    pad.move(brake=1.0)
    pad.send()
    assert pad.requests() == [Request.QUICKSTOP]
    assert pad.woken == 1
    assert pad.requests() == []


# ---------------------------------------------------------------------------------------------- which device


def make(hid: FakeHid, **keys: object) -> GamepadInput:
    context = PluginContext(name="stick", robot=ROBOT, folder=MISSIONS, files={"mine.yaml": profile_text()})
    return GamepadInput(GamepadConfig.model_validate(keys), context, hid)


def profile_text() -> bytes:
    return (SHIPPED / "logitech-g27.yaml").read_bytes()


def lost(device: GamepadInput) -> str:
    device.read(0.0)
    with pytest.raises(DeviceLost) as caught:
        device.read(FIND + 1)
    return str(caught.value)


def info(product: int, path: str = "/dev/hidraw0", serial: str = "") -> HidInfo:
    return HidInfo(path, "usb", 0x046D, product, serial, "Wheel", 0)


def test_auto_takes_what_is_plugged_in() -> None:
    hid = FakeHid()
    hid.plug(info(0xC29B), DESCRIPTORS["logitech_g27"])
    device = make(hid)
    device.read(0.0)
    hid.send(bytes.fromhex("080000e87fffffff73789c"))
    assert device.read(0.02).axes == pytest.approx((0.0, 0.0, 0.0), abs=0.001)


def test_profile_beside_the_mission_is_read() -> None:
    hid = FakeHid()
    hid.plug(info(0xC29B), DESCRIPTORS["logitech_g27"])
    assert make(hid, profile_file="mine.yaml").read(0.0).age is None
    with pytest.raises(ConfigError, match=r"stick: profile_file: no 'other.yaml'"):
        make(hid, profile_file="other.yaml")


def test_unknown_device_is_named_with_what_to_do() -> None:
    hid = FakeHid()
    hid.plug(info(0x1234), DESCRIPTORS["logitech_g27"])
    assert "there is no profile for it; teach it: artemis calibrate input" in lost(make(hid))


def test_other_layout_under_a_known_name_is_refused_with_the_reason() -> None:
    hid = FakeHid()
    hid.plug(info(0xC29B), DESCRIPTORS["logitech_f310_directinput"])
    problem = lost(make(hid, profile="logitech-g27"))
    assert "profile logitech-g27: axes.steering: the device's x goes from 0 to 255" in problem


def test_serial_number_picks_one_of_two() -> None:
    hid = FakeHid()
    hid.plug(info(0xC29B, "/dev/hidraw0", "A"), DESCRIPTORS["logitech_g27"])
    hid.plug(info(0xC29B, "/dev/hidraw1", "B"), DESCRIPTORS["logitech_g27"])
    assert "several devices match" in lost(make(hid))
    make(hid, serial="B").read(0.0)
    assert [hid.is_open(device) for device in hid.enumerate()] == [False, True]


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"profile": "logitech-27"}, "no such profile; nearest is 'logitech-g27', there are 8bitdo-sn30"),
        ({"profile": "logitech-g27", "profile_file": "mine.yaml"}, "leave one out"),
        ({"profile": "../x"}, "pattern"),
        ({"deadzone": 0.6}, "less than or equal to 0.5"),
    ],
)
def test_wrong_keys_are_refused(keys: dict[str, object], expected: str) -> None:
    with pytest.raises(ValidationError, match=expected):
        GamepadConfig.model_validate(keys)


def test_broken_profile_of_ones_own_is_told_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "artemis" / "profiles"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("name: mine\n")
    with pytest.raises(ValidationError, match=r"mine.yaml:1:1: kind: Field required"):
        GamepadConfig.model_validate({"profile": "auto"})
    assert GamepadConfig.model_validate({"profile": "logitech-g27"}).profile == "logitech-g27"


def test_a_speed_beyond_the_robots_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"max_speed_m_s: 0.8; the robot's limit is 0.7"):
        make(FakeHid(), max_speed_m_s=0.8)


class TestContract(InputContract):
    plugin = GamepadInput
    options: Mapping[str, object] = {"profile": "logitech-extreme-3d-pro"}

    def make(self) -> GamepadInput:
        self.pad = Pad("logitech-extreme-3d-pro")
        context = PluginContext(name=contracts.NAME, robot=self.robot, folder=MISSIONS)
        return GamepadInput(GamepadConfig.model_validate(self.options), context, self.pad.hid)

    def move(self, device: object) -> None:
        self.pad.press("enable")
        self.pad.move(x=-0.5, y=0.7)
        self.pad.send()
