"""Gamepads that only evdev shows: what they are, their reports, and driving by them."""

from __future__ import annotations

import builtins
import math
import re
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path

import pytest
from evdev_devices import DROPPED, HAT, REPORT, XPAD_KEYS, EventDevice, FakeEvdev, Happened, bitmap, xpad_axes
from lesson_person import LessonPerson
from pad import MISSIONS, ROBOT, TICK

from artemis import clock
from artemis.build import install
from artemis.commands.calibrate_input import teach
from artemis.devices.evdev.layout import ABS, KEY, Reports, capabilities, evdev_layout
from artemis.devices.evdev.nodes import event_nodes, hidden_controls, motors_of
from artemis.devices.evdev.port import Evdev
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo
from artemis.errors import ConfigError, DeviceLost, HidError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.choosing import ProfileChoice
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import DOUBT, GONE, SLOW
from artemis.plugins.inputs.profiles import (
    SHIPPED,
    Profile,
    all_profiles,
    find_profile,
    misfits,
    profile_from,
    profile_named,
    text_of,
)
from artemis.values import OperatorInput, Request

XPAD = {
    "xbox-360-usb": (255, ()),
    "xbox-360-wireless": (255, range(0x2C0, 0x2C4)),
    "xbox-one-usb": (1023, ()),
    "xbox-one-2015-usb": (1023, ()),
    "xbox-one-s-usb": (1023, ()),
    "xbox-elite-usb": (1023, range(0x2C4, 0x2C8)),
    "xbox-elite-2-usb": (1023, range(0x2C4, 0x2C8)),
    "xbox-series-usb": (1023, (167,)),
    "logitech-f310-xinput": (255, ()),
    "logitech-f710-xinput": (255, ()),
}
"""Counts of the triggers, and further keys, that the driver xpad declares for each."""
X, Y, ENABLE, STOP, MENU = 0, 1, 0x136, 0x131, 0x13B
TOP = ROBOT.limits.speed_m_s


def pad_of(name: str) -> EventDevice:
    triggers, more = XPAD[name]
    key = profile_named(name).parts[""]
    return EventDevice(xpad_axes(triggers), (*XPAD_KEYS, *more), vendor=key.vendor, product=key.product)


class Driver:
    """Somebody with a pad, and the plugin that reads it."""

    def __init__(self, folder: Path, device: EventDevice, **keys: object) -> None:
        self.computer, self.device, self.now, self.woken = FakeEvdev(folder), device, 0.0, 0
        self.path = self.computer.plug(device)
        context = PluginContext(name="pad", robot=ROBOT, folder=MISSIONS, wake=self._wake)
        self.plugin = GamepadInput(GamepadConfig.model_validate(keys), context, self.computer.port)

    def _wake(self) -> None:
        self.woken += 1

    def tick(self, seconds: float = TICK) -> OperatorInput:
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            sample = self.plugin.read(self.now)
        return sample

    def ready(self) -> OperatorInput:
        """Something is moved and let go, then after a rest enable is pressed."""
        self.tick()
        self.device.send({X: 9000})
        self.device.send({X: 200})
        self.tick(0.6)
        self.device.send({ENABLE: 1})
        return self.tick()


@pytest.fixture
def driver(tmp_path: Path) -> Driver:
    return Driver(tmp_path, pad_of("xbox-360-usb"), profile="xbox-360-usb")


# ---------------------------------------------------------------------------------------------- nodes


def test_nodes_are_described_without_being_opened(tmp_path: Path) -> None:
    computer = FakeEvdev(tmp_path)
    path = computer.plug(EventDevice(forces=(0x50,)))
    (node,) = event_nodes(tmp_path)
    assert node.info == HidInfo(
        path, "usb", 0x045E, 0x028E, "", "Microsoft X-Box 360 pad", -1, usage=0x10005, source="evdev"
    )
    assert (node.keys, node.axes, node.forces) == (frozenset(XPAD_KEYS), frozenset(xpad_axes(255)), frozenset({0x50}))
    assert node.drives


@pytest.mark.parametrize(
    ("axes", "keys", "drives"),
    [
        ({0: (0, 1), 1: (0, 1)}, (0x120,), True),  # a joystick
        ({8: (0, 1)}, (0x2C0,), True),  # a wheel with buttons of no name
        ({}, (0x130,), False),  # buttons alone
        (HAT, (0x130,), False),  # a pad without a stick
        ({0: (0, 1), 1: (0, 1)}, (0x130, 0x14A), False),  # a touchpad
        ({0: (0, 1), 1: (0, 1)}, (), False),  # an accelerometer
        ({}, (30, 0x110), False),  # keyboard, mouse
    ],
)
def test_what_somebody_may_drive_with_is_told_from_the_rest(
    tmp_path: Path, axes: dict[int, tuple[int, int]], keys: tuple[int, ...], drives: bool
) -> None:
    FakeEvdev(tmp_path).plug(EventDevice(axes, keys))
    assert [node.drives for node in event_nodes(tmp_path)] == [drives]


def test_what_hidraw_shows_is_left_to_it_but_for_its_motors(tmp_path: Path) -> None:
    computer = FakeEvdev(tmp_path)
    computer.plug(EventDevice(name="touchpad of it", hidraw="hidraw3"))
    motors = computer.plug(EventDevice(hidraw="hidraw3", forces=(0x50,)))
    assert hidden_controls(tmp_path) == []
    found = motors_of(HidInfo("/dev/hidraw3", "usb", 1, 2, "", "", 0), tmp_path)
    assert found is not None
    assert found.info.path == motors
    assert motors_of(HidInfo("/dev/hidraw4", "usb", 1, 2, "", "", 0), tmp_path) is None


def test_of_nodes_with_lamps_and_with_motors_that_with_motors_is_taken(tmp_path: Path) -> None:
    computer, info = FakeEvdev(tmp_path), HidInfo("/dev/hidraw3", "usb", 1, 2, "", "", 0)
    lamps = computer.plug(EventDevice(hidraw="hidraw3", lamps=(0, 1)))
    found = motors_of(info, tmp_path)
    assert found is not None
    assert found.info.path == lamps
    motors = [computer.plug(EventDevice(hidraw="hidraw3", forces=(0x50,))) for _ in range(2)]
    found = motors_of(info, tmp_path)
    assert found is not None
    assert found.info.path == motors[0]


def test_a_node_that_goes_while_it_is_looked_at_is_left_out(tmp_path: Path) -> None:
    path = FakeEvdev(tmp_path).plug(EventDevice())
    (tmp_path / "class" / "input" / Path(path).name / "device" / "uniq").unlink()
    assert event_nodes(tmp_path) == []
    assert event_nodes(tmp_path / "none") == []


def test_bitmaps_of_several_words_are_read(tmp_path: Path) -> None:
    assert bitmap((0x130, 3)) == "1000000000000 0 0 0 8"
    FakeEvdev(tmp_path).plug(EventDevice(keys=(0, 3, 63, 64, 0x2E7)))
    assert event_nodes(tmp_path)[0].keys == {0, 3, 63, 64, 0x2E7}


# ---------------------------------------------------------------------------------------------- reports


def reports_of(device: EventDevice) -> tuple[Reports, Callable[[bytes], dict[str, int]]]:
    raw = capabilities(device.axes, device.keys)

    def decode(report: bytes) -> dict[str, int]:
        values = evdev_layout(raw).decode(report)
        assert values is not None
        return values

    return Reports(raw, lambda: (device.values, device.down)), decode


def test_fields_have_the_names_of_the_kernel() -> None:
    layout = evdev_layout(capabilities({**xpad_axes(255), 0x28: (0, 9)}, (0x12C, 0x130, 0x133, 0x136, 167, 0x220)))
    buttons = "usage.0001.00a7 button.12c button.a button.x button.tl button.dpad_up"
    assert [field.name for field in layout.fields] == f"x y z rx ry rz usage.0003.0028 hat {buttons}".split()
    assert [(field.minimum, field.maximum) for field in layout.fields[:3]] == [
        (-32768, 32767),
        (-32768, 32767),
        (0, 255),
    ]


def test_a_hat_of_another_range_is_two_axes() -> None:
    layout = evdev_layout(capabilities({0x10: (-1, 1), 0x11: (0, 255)}, ()))
    assert [field.name for field in layout.fields] == ["usage.0003.0010", "usage.0003.0011"]


def test_each_report_is_the_whole_state() -> None:
    device = EventDevice(values={X: -5}, down={ENABLE})
    reports, decode = reports_of(device)
    first, second = reports.take([*device.change({Y: -32768, 0x10: 1, 0x11: -1}), *device.change({ENABLE: 0})])
    assert [decode(first)[name] for name in ("x", "y", "rx", "hat", "button.tl")] == [-5, -32768, 0, 1, 1]
    assert [decode(second)[name] for name in ("x", "y", "rx", "hat", "button.tl")] == [-5, -32768, 0, 1, 0]
    (third,) = reports.take(device.change({0x10: 0, 0x11: 0}))
    assert decode(third)["hat"] == 8


@pytest.mark.parametrize(
    ("x", "y", "eighth"), [(0, -1, 0), (1, -1, 1), (1, 0, 2), (1, 1, 3), (0, 1, 4), (-1, 1, 5), (-1, 0, 6), (-1, -1, 7)]
)
def test_a_hat_points_clockwise_from_up(x: int, y: int, eighth: int) -> None:
    device = EventDevice()
    reports, decode = reports_of(device)
    (report,) = reports.take(device.change({0x10: x, 0x11: y}))
    assert decode(report)["hat"] == eighth


def test_events_without_their_end_wait_for_it() -> None:
    device = EventDevice()
    reports, decode = reports_of(device)
    assert reports.take([Happened(ABS, X, 7)]) == []
    (report,) = reports.take([REPORT])
    assert decode(report)["x"] == 7


def test_after_dropped_events_the_state_is_the_kernels() -> None:
    device = EventDevice()
    reports, decode = reports_of(device)
    reports.take(device.change({ENABLE: 1, X: 100}))
    lost = device.change({ENABLE: 0, X: 30000})
    found = reports.take([DROPPED, lost[1], REPORT])
    assert [(decode(report)["x"], decode(report)["button.tl"]) for report in found] == [(30000, 0)]


def test_what_was_read_with_dropped_events_does_not_outlast_the_state() -> None:
    """A press that was read, whose release was not, and is in the state already, leaves nothing pressed."""
    device = EventDevice()
    reports, decode = reports_of(device)
    device.change({STOP: 1})
    device.change({STOP: 0})
    found = reports.take([DROPPED, REPORT, Happened(KEY, STOP, 1), REPORT])
    assert [decode(report)["button.b"] for report in found] == [1, 0]  # a stop is not lost


def test_half_a_state_after_dropped_events_is_not_reported() -> None:
    device = EventDevice()
    reports, _ = reports_of(device)
    assert reports.take([DROPPED, Happened(ABS, X, 5)]) == []
    assert len(reports.take([Happened(ABS, Y, 5), REPORT])) == 1


@pytest.mark.parametrize("raw", [b"abs 1\n", b"key x y\n", b"\xff\n", b"rel 1\n"])
def test_what_is_no_capabilities_is_refused(raw: bytes) -> None:
    with pytest.raises(HidError, match="capabilities of an event node"):
        evdev_layout(raw)


# ---------------------------------------------------------------------------------------------- the port


def test_a_node_that_may_not_be_opened_comes_with_the_rule(tmp_path: Path) -> None:
    computer = FakeEvdev(tmp_path)
    computer.plug(EventDevice(permitted=False))
    (info,) = computer.port.enumerate()
    with pytest.raises(DeviceLost, match=r'KERNEL=="event\*", ATTRS\{id/vendor\}=="045e", ATTRS\{id/product\}=="028e"'):
        computer.port.open(info)


def test_a_node_that_is_gone_is_lost_and_so_is_one_that_goes(tmp_path: Path) -> None:
    computer, device = FakeEvdev(tmp_path), EventDevice()
    path = computer.plug(device)
    (info,) = computer.port.enumerate()
    handle = computer.port.open(info)
    assert handle.read(0.0) is None
    computer.unplug(path)
    with pytest.raises(DeviceLost, match="is gone"):
        handle.read(0.0)
    handle.close()
    handle.close()
    with pytest.raises(DeviceLost, match="is not there"):
        computer.port.open(info)


def test_without_the_extra_the_device_is_named_with_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeEvdev(tmp_path).plug(EventDevice())
    imported = builtins.__import__

    def without_evdev(name: str, *rest: object) -> object:
        if name == "evdev":
            raise ImportError("No module named 'evdev'")
        return imported(name, *rest)  # type: ignore[arg-type]  # as it was called

    monkeypatch.setattr(builtins, "__import__", without_evdev)
    port = Evdev(tmp_path)
    (info,) = port.enumerate()
    with pytest.raises(DeviceLost, match=rf"X-Box 360 pad .*missing.*{re.escape(install('evdev'))}"):
        port.open(info)


# ---------------------------------------------------------------------------------------------- profiles


def test_every_profile_of_evdev_is_tested() -> None:
    shipped = {path.stem for path in SHIPPED.glob("*.yaml")}
    assert {name for name in shipped if profile_named(name).parts[""].source == "evdev"} == set(XPAD)


@pytest.mark.parametrize("name", XPAD)
def test_a_known_pad_is_found_by_its_capabilities(name: str) -> None:
    device, profile = pad_of(name), profile_named(name)
    raw = capabilities(device.axes, device.keys)
    assert profile.parts[""].capabilities == sha256(raw).hexdigest()[:16]
    info = HidInfo("/dev/input/event0", "usb", device.vendor, device.product, "", "", -1, source="evdev")
    assert misfits(profile, evdev_layout(raw)) == []
    found = find_profile(Identity.of(info, raw), evdev_layout(raw), all_profiles())
    assert found is not None
    assert found.name == name
    assert profile_from(text_of(profile).encode(), "again") == profile


def test_a_pad_with_more_buttons_than_the_kernel_once_knew_is_still_known() -> None:
    raw = capabilities(xpad_axes(1023), (*XPAD_KEYS, 167, 168))
    identity = Identity("usb", 0x045E, 0x0B12, "0" * 16, source="evdev")
    found = find_profile(identity, evdev_layout(raw), all_profiles())
    assert found is not None
    assert found.name == "xbox-series-usb"


def test_a_profile_of_one_interface_is_none_of_the_other() -> None:
    key = profile_named("xbox-360-usb").parts[""]
    assert key.is_of(Identity("usb", 0x045E, 0x028E, "", source="evdev"))
    assert not key.is_of(Identity("usb", 0x045E, 0x028E, ""))


def changed(old: str, new: str) -> Profile:
    text = (SHIPPED / "xbox-360-usb.yaml").read_text()
    assert old in text
    return profile_from(text.replace(old, new).encode(), "mine.yaml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("capabilities:", 'descriptor: "0123456789abcdef", capabilities:', "expected one"),
        ("capabilities", "descriptors", "unknown key|Extra inputs|descriptors"),
        ("on_change", "always", "evdev passes changes only"),
    ],
)
def test_a_wrong_profile_of_evdev_is_refused(old: str, new: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        changed(old, new)


# ---------------------------------------------------------------------------------------------- driving


@pytest.mark.parametrize("name", XPAD)
def test_every_known_pad_drives_and_stops(tmp_path: Path, name: str) -> None:
    driver = Driver(tmp_path, pad_of(name), profile=name)
    assert driver.ready().enabled
    driver.device.send({X: 0, Y: -32768})
    sample = driver.tick()
    assert (sample.enabled, sample.neutral) == (True, False)
    assert (sample.speed, sample.steering) == pytest.approx((TOP, 0.0), abs=0.001)
    driver.device.send({X: -32768, Y: 0})
    assert driver.tick().steering == pytest.approx(math.radians(60), abs=0.05)  # left is positive
    driver.device.send({STOP: 1})
    assert driver.tick().requests == (Request.QUICKSTOP,)


def test_auto_finds_a_pad(tmp_path: Path) -> None:
    assert Driver(tmp_path, pad_of("xbox-series-usb")).ready().enabled


def test_nothing_is_known_of_a_pad_before_its_first_event(driver: Driver) -> None:
    driver.device.change({X: 0, ENABLE: 1})  # before it was opened
    assert driver.tick(1.0).age is None
    driver.device.send({X: 100})
    sample = driver.tick(1.0)
    assert sample.age == 0.0
    assert not sample.enabled  # held when it was plugged in
    driver.device.send({ENABLE: 0})
    driver.tick(0.6)
    driver.device.send({ENABLE: 1})
    assert driver.tick().enabled


def test_a_button_that_is_held_when_it_is_plugged_in_was_not_pressed_but_for_a_stop(driver: Driver) -> None:
    driver.device.change({MENU: 1, STOP: 1})
    driver.tick()
    driver.device.send({X: 100})
    assert driver.tick().requests == (Request.QUICKSTOP,)


def test_unplugged_it_is_lost_at_the_next_tick_and_returns_disabled(driver: Driver) -> None:
    driver.ready()
    driver.device.send({Y: -32768})
    assert driver.tick().enabled
    driver.computer.unplug(driver.path)
    with pytest.raises(DeviceLost, match=r"pad: .*X-Box 360 pad.* is gone"):
        driver.tick()
    driver.computer.plug(driver.device)
    driver.now += 2.0
    driver.tick()
    driver.device.send({X: 1000})
    sample = driver.tick(5.0)
    assert (sample.enabled, sample.neutral) == (False, False)
    driver.device.send({X: 0, Y: 0, ENABLE: 0})
    driver.tick(0.6)
    driver.device.send({ENABLE: 1})
    assert driver.tick().enabled


def test_silence_of_a_pad_slows_down_and_stops(driver: Driver) -> None:
    driver.ready()
    driver.device.send({X: 0, Y: -32768})
    driver.tick()
    assert driver.tick(DOUBT + 0.1).speed == SLOW
    assert not driver.tick(GONE - DOUBT).enabled


def test_a_release_that_was_dropped_stops_the_robot(driver: Driver) -> None:
    driver.ready()
    driver.device.send({Y: -32768})
    assert driver.tick().enabled
    driver.device.change({ENABLE: 0, Y: 0})
    driver.device.happen([DROPPED, REPORT])
    sample = driver.tick()
    assert (sample.enabled, sample.speed) == (False, 0.0)


def test_a_stop_wakes_the_run(driver: Driver) -> None:
    driver.ready()
    driver.device.send({STOP: 1})
    driver.tick()
    assert driver.woken == 1


@pytest.mark.parametrize(
    ("profile", "sources"), [("xbox-360-usb", {"evdev"}), ("logitech-f310", {"hidraw"}), ("auto", {"evdev", "hidraw"})]
)
def test_only_the_interfaces_of_the_profiles_are_looked_at(profile: str, sources: set[str]) -> None:
    context = PluginContext(name="pad", robot=ROBOT, folder=MISSIONS)
    assert ProfileChoice(GamepadConfig(profile=profile), context).sources == sources


# ---------------------------------------------------------------------------------------------- teaching


class AtHisPad(LessonPerson):
    """Somebody at the terminal who teaches a pad of which artemis knows nothing."""

    def __init__(self, device: EventDevice) -> None:
        super().__init__()
        self._device = device

    def act(self, text: str) -> Iterator[str | None]:
        axes = {"x": (X, 1), "y": (Y, -1)}
        presses = {"enable": {ENABLE: 1}, "quick stop": {STOP: 1}, "faster": {0x11: -1}}
        changes: list[dict[int, int]] = []
        asked = text.partition(":")[0]
        if asked in axes:
            code, sign = axes[asked]
            changes = [{code: sign * 32767}, {code: 0}, {code: -sign * 32767}, {code: 0}]
        elif asked == "corner":
            changes = [{X: 23000, Y: -23000}, {X: 0, Y: 0}]
        for name, press in presses.items():
            if text.startswith(f"press the button for {name}"):
                changes = [press, dict.fromkeys(press, 0)]
        for change in changes:
            self._device.send(change)
            yield None
        if text.startswith("a stick"):
            yield "stick"
        elif text.endswith("press Enter"):
            self._device.send({X: 3000})
            self._device.send({X: 0})
            yield None
            yield ""
        elif text.startswith("write "):
            yield "yes"
        elif not changes:
            yield ""


def test_a_pad_of_evdev_is_taught_and_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "own"))
    device = EventDevice(product=0x7777, name="Other Pad")
    computer = FakeEvdev(tmp_path)
    computer.plug(device)
    person = AtHisPad(device)
    assert clock.run(teach(computer.port, person, (), None, None), simulated=True) == 0
    taught = profile_named("other-pad")
    assert (taught.parts[""].source, taught.reports, taught.gate) == ("evdev", "on_change", "round")
    assert taught.buttons == {"enable": "button.tl", "quickstop": "button.b", "faster": "hat.up"}
    assert taught.axes["y"].inverted
    other = EventDevice(product=0x7777)
    assert Driver(tmp_path / "again", other).ready().enabled
