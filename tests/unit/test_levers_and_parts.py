"""Profiles beyond one stick or wheel: steering and speed on axes of their own, and several devices held together."""

from __future__ import annotations

from pathlib import Path

import pytest
from hid_devices import STICK
from pad import ROBOT
from test_teachable import PEDALS, PEDALS_RAW, WHEEL, two

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.gamepad import FIND, GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import DOUBT, GONE, SLOW
from artemis.plugins.inputs.profiles import find_profile, profile_from, text_of
from artemis.plugins.stated import STALE
from artemis.testing.fake_hid import FakeHid
from artemis.values import OperatorInput, Request

TICK = 0.02
TOP = ROBOT.limits.speed_m_s
RIG = """\
name: rig
devices:
  base: {bus: usb, vendor: 0x1111, product: 0x2222, descriptor: "0000000000000000", reports: REPORTS}
  pedals: {bus: usb, vendor: 0x3333, product: 0x4444, descriptor: "0000000000000000", reports: on_change}
kind: wheel
deadzone: 0.05
axes:
  steering: {field: base/x, minimum: 0, centre: 128, maximum: 255}
  gas: {field: pedals/x, minimum: 0, maximum: 1023, inverted: true}
  brake: {field: pedals/y, minimum: 0, maximum: 1023, inverted: true}
buttons:
  enable: base/button.1
  quickstop: base/button.2
"""
LEVERS = """\
name: levers
device: {bus: usb, vendor: 0x1111, product: 0x2222, descriptor: "0000000000000000"}
kind: levers
reports: on_change
deadzone: 0.05
axes:
  steering: {field: x, minimum: 0, centre: 128, maximum: 255}
  speed: {field: y, SPEED, maximum: 255}
buttons:
  enable: button.1
  quickstop: button.2
"""
SHIFTER = '  shifter: {bus: usb, vendor: 7, product: 7, descriptor: "0000000000000000", reports: always}\n'
CENTRED = LEVERS.replace("SPEED", "minimum: 0, centre: 128")
ONE_SIDED = LEVERS.replace("SPEED", "minimum: 0") + "  reverse: button.3\n"


class Rig:
    """An input with a profile of its own, on devices in memory."""

    def __init__(self, profile: str, hid: FakeHid, **keys: object) -> None:
        self.hid, self.now, self.woken = hid, 0.0, 0
        files = {"own.yaml": profile.encode()}
        context = PluginContext(name="hand", robot=ROBOT, folder=Path(), files=files, wake=self._wake)
        config = GamepadConfig.model_validate({"profile_file": "own.yaml", **keys})
        self.input = GamepadInput(config, context, hid)

    def _wake(self) -> None:
        self.woken += 1

    def tick(self, seconds: float = TICK, *, base: bytes | None = None) -> OperatorInput:
        """Let time pass, with a report of the base in each tick if one is given; the last sample."""
        for _ in range(round(seconds / TICK)):
            if base is not None:
                self.hid.send(base, WHEEL)
            self.now += TICK
            sample = self.input.read(self.now)
        return sample


def base(x: int = 128, buttons: int = 0, y: int = 128) -> bytes:
    return bytes([x, y, buttons])


def pedals(gas: int = 1023, brake: int = 1023) -> bytes:
    return gas.to_bytes(2, "little") + brake.to_bytes(2, "little")


# ---------------------------------------------------------------------------------------------- levers


def levers(profile: str, y: int) -> Rig:
    hid = FakeHid()
    hid.plug(WHEEL, STICK)
    rig = Rig(profile, hid, hysteresis_deg=0.0)
    rig.tick()
    hid.send(base(y=y), WHEEL)
    rig.tick(0.6)
    return rig


@pytest.mark.parametrize(("y", "share"), [(255, 1.0), (0, -1.0), (134, 0.0), (198, (70 / 127 - 0.05) / 0.95)])
def test_centred_lever_sets_speed_in_both_directions_and_steering_is_independent(y: int, share: float) -> None:
    rig = levers(CENTRED, 128)
    rig.hid.send(base(x=255, y=y, buttons=1), WHEEL)
    sample = rig.tick()
    assert sample.enabled
    assert sample.speed == pytest.approx(share * TOP)
    assert sample.steering == pytest.approx(-ROBOT.limits.steering_deg * 3.141592653589793 / 180)
    rig.hid.send(base(x=64, y=y, buttons=1), WHEEL)
    assert rig.tick().speed == pytest.approx(share * TOP)
    assert rig.tick().steering == pytest.approx(0.5 * 60 * 0.01745329, rel=0.06)


def test_one_sided_lever_goes_back_by_the_button_at_standstill_with_the_lever_released() -> None:
    rig = levers(ONE_SIDED, 0)
    rig.hid.send(base(y=255, buttons=1), WHEEL)
    assert rig.tick().speed == pytest.approx(TOP)
    for buttons in (5, 1):  # reverse in motion has no effect
        rig.hid.send(base(y=255, buttons=buttons), WHEEL)
        assert rig.tick().speed == pytest.approx(TOP)
    rig.hid.send(base(y=0, buttons=1), WHEEL)
    rig.tick(1.5)
    rig.hid.send(base(y=0, buttons=5), WHEEL)
    rig.tick()
    rig.hid.send(base(y=255, buttons=1), WHEEL)
    assert rig.tick().speed == pytest.approx(-TOP)


def test_lever_that_is_left_forward_is_not_at_rest() -> None:
    rig = levers(ONE_SIDED, 200)
    assert not rig.tick().neutral
    rig.hid.send(base(y=200, buttons=1), WHEEL)
    assert not rig.tick().enabled
    turned = levers(CENTRED, 128)
    turned.hid.send(base(x=150), WHEEL)
    assert not turned.tick().neutral
    turned.hid.send(base(x=136), WHEEL)
    assert turned.tick().neutral


def test_held_stop_button_is_not_at_rest() -> None:
    rig = levers(CENTRED, 128)
    rig.hid.send(base(buttons=2), WHEEL)
    sample = rig.tick()
    assert (sample.neutral, sample.requests) == (False, (Request.QUICKSTOP,))
    rig.hid.send(base(), WHEEL)
    assert rig.tick().neutral


def test_reverse_of_a_lever_that_has_a_centre_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"buttons\.reverse: the axis speed has a centre and commands both directions"
    ):
        profile_from((CENTRED + "  reverse: button.3\n").encode(), "p.yaml")
    with pytest.raises(ConfigError, match="a levers has steering, speed, found steering, x"):
        profile_from(CENTRED.replace("  speed:", "  x:").encode(), "p.yaml")


# ---------------------------------------------------------------------------------------------- several devices


def rig(reports: str = "on_change") -> Rig:
    made = Rig(RIG.replace("REPORTS", reports), two())
    made.tick()
    return made


def ready(reports: str = "on_change") -> Rig:
    made = rig(reports)
    made.hid.send(pedals(), PEDALS)
    made.hid.send(base(), WHEEL)
    made.tick(0.6, base=base())
    made.hid.send(base(buttons=1), WHEEL)
    assert made.tick().enabled
    return made


def test_wheel_of_one_device_and_pedals_of_another_drive_together() -> None:
    made = ready()
    made.hid.send(pedals(gas=0), PEDALS)
    made.hid.send(base(x=0, buttons=1), WHEEL)
    sample = made.tick()
    assert sample.speed == pytest.approx(TOP)
    assert sample.steering > 1.0
    assert sample.raw == (0.0, 0.0, 1023.0)
    made.hid.send(pedals(gas=0, brake=0), PEDALS)
    assert made.tick().requests == (Request.QUICKSTOP,)


def test_nothing_drives_before_both_were_heard_but_the_stop_button_stops() -> None:
    made = rig()
    made.hid.send(base(), WHEEL)
    sample = made.tick()
    assert (sample.age, sample.neutral, sample.enabled) == (None, False, False)
    made.hid.send(base(buttons=2), WHEEL)
    assert made.tick().requests == (Request.QUICKSTOP,)
    made.hid.send(base(buttons=2), WHEEL)
    assert made.tick().requests == ()


@pytest.mark.parametrize("lost", [WHEEL, PEDALS])
def test_loss_of_any_device_is_the_loss_of_the_input_and_the_return_wants_everything_released(lost: HidInfo) -> None:
    made = ready()
    made.hid.unplug(lost)
    with pytest.raises(DeviceLost, match=r"^hand: (base|pedals): .* is gone"):
        made.tick()
    made.hid.plug(lost, STICK if lost == WHEEL else PEDALS_RAW)
    made.now += 1.5
    made.hid.send(base(buttons=1), WHEEL)
    assert made.tick().age > STALE  # type: ignore[operator]  # the other one has to be heard anew, too
    made.hid.send(base(buttons=1), WHEEL)
    made.hid.send(pedals(), PEDALS)
    assert not made.tick(1.0).enabled
    made.hid.send(base(), WHEEL)
    made.tick(0.6)
    made.hid.send(base(buttons=1), WHEEL)
    assert made.tick().enabled


def test_device_that_is_missing_from_the_start_is_named() -> None:
    hid = FakeHid()
    hid.plug(WHEEL, STICK)
    made = Rig(RIG.replace("REPORTS", "on_change"), hid)
    made.tick()
    made.now = FIND
    with pytest.raises(DeviceLost, match="pedals: no such device is plugged in"):
        made.tick()


def test_each_device_grows_old_by_its_own_reports() -> None:
    made = ready("always")
    assert made.tick(1.0, base=base(buttons=1)).age == 0.0  # pedals that report changes are silent
    assert made.tick(2 * STALE).age == pytest.approx(2 * STALE)
    made.hid.send(pedals(), PEDALS)
    assert made.tick().age > STALE  # type: ignore[operator]  # the base is what is frozen


def test_silence_of_each_device_that_reports_changes_alone_is_doubted() -> None:
    made = ready()
    made.hid.send(pedals(gas=0), PEDALS)
    assert made.tick(DOUBT - 0.1, base=base(buttons=1)).speed == pytest.approx(TOP)
    assert made.tick(0.2, base=base(buttons=1)).speed == pytest.approx(SLOW)
    assert not made.tick(GONE - DOUBT, base=base(buttons=1)).enabled


def test_stop_button_wakes_the_robot_and_so_does_the_brake_of_another_device() -> None:
    made = ready()
    for report, info in ((base(buttons=3), WHEEL), (base(buttons=1), WHEEL), (pedals(brake=0), PEDALS)):
        made.hid.send(report, info)
        made.tick()
    assert made.woken == 2


def test_profile_of_several_devices_goes_to_text_and_back() -> None:
    profile = profile_from(RIG.replace("REPORTS", "counted").encode(), "p")
    assert profile_from(text_of(profile).encode(), "again") == profile
    serial = RIG.replace("reports: REPORTS", 'reports: always, serial: "A \'1"')
    profile = profile_from(serial.encode(), "p")
    assert profile.devices["base"].serial == "A '1"
    assert profile_from(text_of(profile).encode(), "again") == profile


def test_profile_of_several_devices_is_not_that_of_one() -> None:
    profile = profile_from(RIG.replace("REPORTS", "always").encode(), "p")
    assert find_profile(Identity.of(WHEEL, STICK), parse_descriptor(STICK), [profile]) is None
    with pytest.raises(ConfigError, match="hand: serial: the profile rig is of several devices; write it there"):
        Rig(RIG.replace("REPORTS", "always"), two(), serial="A1")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("kind: wheel", "kind: wheel\nreports: always", "reports: not beside devices; each of them has its own"),
        ("pedals/x", "pedal/x", "no device pedal; nearest is 'pedals'"),
        ("pedals/x", "x", "a field names no device: expected DEVICE/FIELD"),
        ("  base: {", SHIFTER + "  base: {", "devices.shifter: no axis and no button is on it"),
        ("vendor: 0x3333, product: 0x4444", "vendor: 0x1111, product: 0x2222",
         "base and pedals cannot be told apart; give each its serial"),
        ("reports: REPORTS", "", "devices.base.reports: Field required"),
    ],
)  # fmt: skip
def test_what_is_no_profile_of_several_devices_is_refused(old: str, new: str, expected: str) -> None:
    assert old in RIG
    with pytest.raises(ConfigError) as caught:
        profile_from(RIG.replace(old, new).replace("REPORTS", "always").encode(), "p.yaml")
    assert expected in str(caught.value)


def test_profile_of_one_device_under_devices_is_refused() -> None:
    only = (
        RIG.replace("REPORTS", "always")
        .replace("pedals/", "base/")
        .replace("base/x, minimum: 0, max", "base/z, minimum: 0, max")
    )
    with pytest.raises(ConfigError, match="devices: only one; write device and reports"):
        profile_from("\n".join(line for line in only.splitlines() if "0x3333" not in line).encode(), "p.yaml")
