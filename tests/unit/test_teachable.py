"""What a lesson refuses, and when: devices that do not fit, reports that fit no descriptor, waiting without an end."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from hid_devices import DESCRIPTORS, JOYSTICK, STICK, joystick
from lesson_person import LessonPerson
from pad import encode

from artemis import clock
from artemis.commands import calibrate_input
from artemis.commands.calibrate_input import teach
from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.inputs.controls import named_fields
from artemis.plugins.inputs.hands import BUTTONS, Kind
from artemis.plugins.inputs.profiles import AxisProfile, Profile, misfits
from artemis.plugins.inputs.teach import Learnt, lesson
from artemis.plugins.inputs.teachable import GIVE_UP, LONGEST, REMIND, Moment, Unteachable, kinds_for
from artemis.testing.fake_hid import FakeHid

INFO = HidInfo("/dev/hidraw0", "usb", 0x1234, 0x5678, "", "Odd Pad", 0)
RELATIVE = "09 30 09 31 15 81 25 7f 75 08 95 02 81 06"
AXES = "09 30 09 31 15 00 25 ff 75 08 95 02 81 02"
BUTTONS_8 = "05 09 19 01 29 08 15 00 25 01 75 01 95 08 81 02"
HAT = "05 01 09 39 15 00 26 ef 00 {} 75 08 95 01 81 42"
"""0 to 239, with null state."""
IN_DEGREES, IN_NOTHING = "35 00 46 66 01 65 14", ""
"""0 to 358 degrees; no unit."""


class Silent:
    """A person who answers questions about the kind of device and presses Enter, and does nothing else."""

    def __init__(self, act: Callable[[], None] = lambda: None, kind: str = "stick") -> None:
        self.told: list[str] = []
        self._act, self._kind, self._line = act, kind, ""

    def say(self, text: str) -> None:
        self.told.append(text)

    def typed(self) -> str | None:
        self._act()
        last, told = self.told[-1], len(self.told)
        if told == getattr(self, "_answered", 0):
            return None
        self._answered = told
        return self._kind if last.startswith("a stick") else "" if last.endswith("press Enter") else None


def refused(raw: bytes, act: Callable[[FakeHid], None] = lambda _: None, kind: str = "stick") -> tuple[str, Silent]:
    """Why a device is refused."""
    hid = FakeHid()
    hid.plug(INFO, raw)
    person = Silent(lambda: act(hid), kind)
    with pytest.raises(Unteachable) as caught:
        clock.run(teach(hid, person, (), None, None), simulated=True)
    assert not hid.is_open()
    return str(caught.value), person


def raw_of(items: str) -> bytes:
    return bytes.fromhex(f"{JOYSTICK} {items} c0")


# ---------------------------------------------------------------------------------------------- by the descriptor


def test_relative_axes_are_refused_at_once() -> None:
    text, person = refused(raw_of(f"{RELATIVE} {BUTTONS_8}"))
    assert text == (
        "Odd Pad (usb 1234:5678, /dev/hidraw0): it has 0 axes that report a position; two are needed; "
        "x, y report movements only, as those of a mouse or a trackball do; nothing was written"
    )
    assert person.told == [str(INFO)]


def test_device_without_buttons_is_refused_at_once() -> None:
    text, _ = refused(raw_of(AXES))
    assert "it has 0 buttons; enable and quick stop need two; nothing was written" in text
    one = "05 09 19 01 29 01 15 00 25 01 75 01 95 01 81 02 75 07 81 01"
    assert "it has 1 button (button.1); enable and quick stop need two" in refused(raw_of(f"{AXES} {one}"))[0]


def test_one_axis_is_too_few_and_said_with_its_name() -> None:
    text, _ = refused(raw_of(f"09 36 15 00 25 ff 75 08 95 01 81 02 {BUTTONS_8}"))
    assert "it has 1 axis (slider) that report a position; two are needed;" in text


def test_only_kinds_with_enough_axes_are_offered() -> None:
    assert kinds_for(named_fields("", parse_descriptor(STICK))) == ["stick", "levers"]
    assert kinds_for(named_fields("", parse_descriptor(DESCRIPTORS["logitech_g27"]))) == ["stick", "wheel", "levers"]
    for name, raw in DESCRIPTORS.items():
        assert kinds_for(named_fields("", parse_descriptor(raw))), name


def test_hat_counts_as_buttons_where_its_directions_are_known() -> None:
    hat = "05 01 09 39 15 00 25 07 75 08 95 01 81 42"
    assert kinds_for(named_fields("", joystick(f"{AXES} {hat}")))
    with pytest.raises(Unteachable, match="it has 0 buttons"):
        kinds_for(named_fields("", joystick(f"{AXES} {HAT.format(IN_NOTHING)}")))


def test_mouse_that_is_named_is_told_to_be_one() -> None:
    hid = FakeHid()
    mouse = HidInfo("/dev/hidraw2", "usb", 0x046D, 0xC077, "", "Mouse", 0, 0x10002)
    other = HidInfo("/dev/hidraw3", "usb", 0x046D, 0xC078, "K9", "Lamp", 0, 0xFF000001)
    hid.plug(mouse, b"")
    hid.plug(other, b"")
    with pytest.raises(DeviceLost, match=r"Mouse .* says that it is a mouse: no joystick, gamepad or wheel"):
        calibrate_input._chosen(hid, "046d:C077")
    with pytest.raises(DeviceLost, match=r"Lamp .* says that it is something of usage ff00:0001"):
        calibrate_input._chosen(hid, "k9")


# ---------------------------------------------------------------------------------------------- by the reports


def test_device_that_says_nothing_is_given_up_with_a_line_before() -> None:
    text, person = refused(STICK)
    assert "no report came from it; it was waited 30 s for: nothing was heard of the device yet" in text
    (hint,) = (told for told in person.told if "still waiting" in told)
    assert hint.endswith(" (still waiting: no report came from it; the lesson ends in 20 s)")


def test_reports_of_an_id_that_the_descriptor_does_not_have_are_refused_soon() -> None:
    raw = raw_of(f"85 30 {AXES} {BUTTONS_8}")
    text, person = refused(raw, lambda hid: hid.send(b"\x81\x01\x00\x03"))  # a pad that waits for its handshake
    assert "it sends reports that its report descriptor does not describe: ID 0x81 (" in text
    assert "another mode of the device may help" in text
    assert not [told for told in person.told if "skipped" in told]


def test_reports_that_are_too_short_are_refused_soon() -> None:
    text, _ = refused(STICK, lambda hid: hid.send(b"\x80"))
    assert "does not describe: report 0 ends at byte 1 of 3 (" in text


def test_few_reports_of_other_kinds_are_those_of_a_battery() -> None:
    raw, tick = raw_of(f"85 30 {AXES} {BUTTONS_8}"), iter(range(10_000_000))
    text, _ = refused(raw, lambda hid: None if next(tick) % 600 else hid.send(b"\x04\x8b"))  # every 3 s
    assert "does not describe: ID 0x04 (" in text
    assert "it was waited 30 s for" in text


def test_device_whose_axes_never_rest_is_refused_and_they_are_named() -> None:
    turns = iter(range(10_000_000))
    text, _ = refused(STICK, lambda hid: hid.send(bytes([next(turns) * 20 % 256, 128, 0])))
    assert "x did not come to rest in 10 s" in text


class Pad:
    """Controls in front of a lesson; every second a hundred reports, or none."""

    def __init__(self, kind: Kind, descriptor: Descriptor, **rest: int) -> None:
        self.descriptor, self.levels = descriptor, dict(rest)
        self.lesson, self.now, self.learnt = lesson(kind, named_fields("", descriptor)), 0.0, None
        self.text = next(self.lesson)
        self.rest = dict(rest)

    def show(self, seconds: float = 0.01, *, heard: bool = True, typed: str | None = None, **levels: int) -> str:
        self.levels.update(levels)
        number = self.descriptor.fields[0].report_id
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            values = self.descriptor.decode(encode(self.descriptor, number, self.levels)) or {}
            try:
                moment = Moment(time=self.now, values=values, heard="" if heard else None, typed=typed)
                self.text = self.lesson.send(moment)
            except StopIteration as end:
                self.learnt = end.value
                self.text = "the end"
                break
        return self.text

    def swing(self, *places: dict[str, int]) -> str:
        for place in (*places, {}):
            self.levels = {**self.rest, **place}
            self.show()
        return self.text

    def begin(self) -> str:
        self.show(typed="")
        return self.show(0.7)

    def skip(self) -> Learnt:
        while self.learnt is None:
            self.show(typed="")
        return self.learnt


def stick_pad(**rest: int) -> Pad:
    return Pad("stick", parse_descriptor(STICK), x=128, y=128, **rest)


def test_nothing_moved_for_a_while_is_told_and_then_ends_the_lesson() -> None:
    pad = stick_pad()
    asked = pad.begin()
    assert asked.startswith("x: push the stick to the right")
    assert pad.show(REMIND - 0.5) == asked
    what = " (still waiting: its reports change no axis and no button; the lesson ends in 20 s)"
    assert pad.show(0.5) == asked + what
    assert pad.show(x=255) == asked  # somebody is there
    assert pad.show(GIVE_UP - 0.2).startswith(asked + " (still waiting")
    with pytest.raises(Unteachable, match="its reports change no axis and no button; it was waited 30 s for: x: push"):
        pad.show(1.0)


def test_single_action_is_not_waited_for_for_ever_whatever_moves() -> None:
    pad = stick_pad()
    pad.begin()

    def fiddle() -> None:
        for second in range(round(LONGEST) + 2):
            pad.show(1.0, x=128 + 20 * (second % 2))

    with pytest.raises(Unteachable, match="it was waited 180 s for: x: push the stick"):
        fiddle()


def test_values_outside_of_their_range_are_taken_for_nothing() -> None:
    wide = joystick(f"09 30 09 31 15 00 26 ff 03 75 10 95 02 81 02 {BUTTONS_8}")
    pad = Pad("stick", wide, x=512, y=512)
    pad.begin()
    pad.swing({"x": 1023}, {"x": 40_000}, {"x": 0})
    pad.swing({"y": 0}, {"y": 1023})
    pad.swing({"x": 1023, "y": 0})
    pad.show(1.2, y=0)
    pad.swing({})
    pad.swing({"button.1": 1}), pad.swing({"button.2": 1})
    assert pad.skip().axes["x"] == AxisProfile(field="x", minimum=0, centre=512, maximum=1023)


# ---------------------------------------------------------------------------------------------- always, or on change


def taught(pad: Pad, *, held_heard: bool) -> Learnt:
    pad.begin()
    pad.swing({"x": 255}, {"x": 0})
    pad.swing({"y": 0}, {"y": 255})
    assert (
        pad.swing({"x": 255, "y": 0})
        == "hold: push the stick forward as far as it goes, and hold it there, until the next line"
    )
    pad.show(0.5, y=60)  # not far enough
    pad.show(0.5, y=0)
    assert pad.show(y=100).startswith("hold:")  # let go too soon
    assert pad.show(0.9, y=0, heard=held_heard).startswith("hold:")
    assert pad.show(0.2, heard=held_heard) == "let go of everything"
    assert pad.show(0.3) == "let go of everything"
    assert pad.swing({}).startswith("press the button for enable")
    pad.swing({"button.1": 1})
    pad.swing({"button.2": 1})
    return pad.skip()


@pytest.mark.parametrize(("heard", "reports"), [(True, "always"), (False, "on_change")])
def test_stick_that_falls_silent_at_its_stop_reports_changes_alone(heard: bool, reports: str) -> None:
    assert taught(stick_pad(), held_heard=heard).reports == {"": reports}


# ---------------------------------------------------------------------------------------------- hats


def hat_pad(unit: str) -> Pad:
    return Pad("stick", joystick(f"{AXES} {BUTTONS_8} {HAT.format(unit)}"), x=128, y=128, hat=255)


def to_buttons(pad: Pad) -> Pad:
    pad.show(typed="")
    pad.show(0.7, heard=False)
    pad.swing({"x": 255}, {"x": 0})
    pad.swing({"y": 0}, {"y": 255})
    pad.swing({"x": 255, "y": 0})
    pad.swing({"button.1": 1})
    pad.swing({"button.2": 1})
    return pad


def profile_of(learnt: Learnt) -> Profile:
    device = {"bus": "usb", "vendor": 1, "product": 2, "descriptor": "0" * 16}
    return Profile.model_validate(
        {
            "name": "pad", "device": device, "kind": "stick", "reports": learnt.reports[""],
            "axes": {role: axis.model_dump() for role, axis in learnt.axes.items()}, "buttons": learnt.buttons,
        }
    )  # fmt: skip


def test_hat_in_degrees_is_taught_and_loaded() -> None:
    pad = to_buttons(hat_pad(IN_DEGREES))
    pad.swing({"hat": 30})  # 45 degrees: between two directions
    pad.swing({"hat": 235})
    pad.swing({"hat": 121})
    learnt = pad.skip()
    assert learnt.buttons == {"enable": "button.1", "quickstop": "button.2", "faster": "hat.up", "slower": "hat.down"}
    assert misfits(profile_of(learnt), pad.descriptor) == []


def test_hat_of_unknown_directions_is_refused_in_the_lesson_with_the_reason() -> None:
    pad = to_buttons(hat_pad(IN_NOTHING))
    text = pad.swing({"hat": 0})
    assert text.endswith(" (hat goes from 0 to 239, and not in degrees: it cannot be used)")
    learnt = pad.skip()
    assert set(learnt.buttons) == {"enable", "quickstop"}
    forced = profile_of(learnt).model_copy(update={"buttons": {**learnt.buttons, "end": "hat.up"}})
    assert misfits(forced, pad.descriptor) == ["buttons.end: the device has no hat.up"]


def test_button_of_more_than_two_values_is_none() -> None:
    wide = joystick(f"{AXES} {BUTTONS_8} 05 09 09 20 15 00 25 ff 75 08 95 01 81 02")
    pad = to_buttons(Pad("stick", wide, x=128, y=128))
    pad.swing({"button.32": 255})
    assert set(pad.skip().buttons) == {"enable", "quickstop"}


# ---------------------------------------------------------------------------------------------- levers


def lever_pad(rest: int) -> Pad:
    """A stick and a throttle lever."""
    items = f"09 30 09 36 15 00 25 ff 75 08 95 02 81 02 {BUTTONS_8}"
    return Pad("levers", joystick(items), x=128, slider=rest)


@pytest.mark.parametrize(
    ("rest", "places", "axis", "asks_reverse"),
    [
        (0, (255,), {"minimum": 0, "maximum": 255}, True),
        (255, (10,), {"minimum": 10, "maximum": 255, "inverted": True}, True),
        (128, (0, 250), {"minimum": 0, "centre": 128, "maximum": 250, "inverted": True}, False),
    ],
)
def test_lever_for_the_speed_is_one_sided_where_it_rests_at_an_end(
    rest: int, places: tuple[int, ...], axis: dict[str, int], asks_reverse: bool
) -> None:
    pad = lever_pad(rest)
    assert pad.begin().startswith("steering: move what steers to the right as far as it goes")
    assert pad.swing({"x": 255}, {"x": 0}).startswith("speed: move what sets the speed fully forward")
    text = pad.swing(*({"slider": place} for place in places))
    assert text.startswith("hold: steer to the right and set full speed forward")
    pad.show(1.2, x=255, slider=places[0])
    pad.swing({})
    pad.swing({"button.1": 1})
    pad.swing({"button.2": 1})
    asked = []
    while pad.learnt is None:
        asked.append(pad.show(typed=""))
    assert any("reverse" in text for text in asked) == asks_reverse
    assert len(asked) == len(BUTTONS["levers"]) - 2 - (not asks_reverse)
    assert pad.learnt.axes["speed"] == AxisProfile.model_validate({"field": "slider", **axis})
    assert pad.learnt.axes["steering"] == AxisProfile(field="x", minimum=0, centre=128, maximum=255)


def test_centred_lever_has_to_be_moved_both_ways() -> None:
    pad = lever_pad(128)
    pad.begin()
    pad.swing({"x": 255}, {"x": 0})
    assert pad.swing({"slider": 255}).startswith("speed:")
    assert pad.swing({"slider": 0}).startswith("hold:")


# ---------------------------------------------------------------------------------------------- two devices

WHEEL = HidInfo("/dev/hidraw0", "usb", 0x1111, 0x2222, "", "Wheel Base", 0)
PEDALS = HidInfo("/dev/hidraw1", "usb", 0x3333, 0x4444, "", "Pedal Set", 0)
PEDALS_RAW = bytes.fromhex("05 01 09 04 a1 01 09 30 09 31 15 00 26 ff 03 75 10 95 02 81 02 c0")
"""Two axes, no buttons."""


class Driver(LessonPerson):
    """Does what it is told with a wheel base and pedals, each a device of its own."""

    def __init__(self, hid: FakeHid) -> None:
        super().__init__()
        self.hid = hid

    def base(self, x: int = 128, buttons: int = 0) -> None:
        self.hid.send(bytes([x, 128, buttons]), WHEEL)

    def pedals(self, gas: int = 1023, brake: int = 1023) -> None:
        self.hid.send(gas.to_bytes(2, "little") + brake.to_bytes(2, "little"), PEDALS)

    def act(self, text: str) -> Iterator[str | None]:
        asked = text.partition(":")[0]
        if text.startswith("a stick"):
            yield "wheel"
        elif "press Enter" in text:
            self.base()
            if "pedal-set" in text:
                self.pedals()
            yield None
            yield ""
        elif asked == "steering":
            for x in (255, 0, 128):
                self.base(x)
                yield None
        elif asked in ("gas", "brake"):
            self.pedals(**{asked: 0})
            yield None
            self.pedals()
        elif text.startswith("press the button for enable"):
            self.base(buttons=1)
            yield None
            self.base()
        elif text.startswith("press the button for quick"):
            self.base(buttons=2)
            yield None
            self.base()
        elif text.startswith("press the button"):
            yield ""
        elif text.startswith("write"):
            yield "yes"


def two() -> FakeHid:
    hid = FakeHid()
    hid.plug(WHEEL, STICK)
    hid.plug(PEDALS, PEDALS_RAW)
    return hid


def test_two_devices_are_taught_as_one_profile(tmp_path: object) -> None:
    from pathlib import Path

    from artemis.plugins.inputs.profiles import profile_from

    path = Path(str(tmp_path)) / "rig.yaml"
    person = Driver(two())
    names = ("1111:2222", "3333:4444")
    assert clock.run(teach(person.hid, person, names, "rig", path), simulated=True) == 0
    assert any(told.startswith("nothing was heard of pedal-set yet") for told in person.told)
    profile = profile_from(path.read_bytes(), "rig")
    assert {name: (part.vendor, part.reports) for name, part in profile.devices.items()} == {
        "wheel-base": (0x1111, "on_change"),
        "pedal-set": (0x3333, "on_change"),
    }
    assert {role: axis.field for role, axis in profile.axes.items()} == {
        "steering": "wheel-base/x", "gas": "pedal-set/x", "brake": "pedal-set/y",
    }  # fmt: skip
    assert profile.buttons == {"enable": "wheel-base/button.1", "quickstop": "wheel-base/button.2"}


def test_devices_that_cannot_be_told_apart_are_refused_before_the_lesson() -> None:
    hid = FakeHid()
    for number in range(2):
        hid.plug(HidInfo(f"/dev/hidraw{number}", "usb", 1, 2, f"S{number}", "Twin", 0), STICK)
    hid.plug(HidInfo("/dev/hidraw2", "usb", 1, 2, "", "Twin", 0), STICK)
    infos = hid.enumerate()
    assert set(calibrate_input._parts(infos[:2])) == {"twin", "twin-2"}
    with pytest.raises(ConfigError, match="cannot be told apart"):
        calibrate_input._parts([infos[0], infos[2]])
    with pytest.raises(ConfigError, match="two of them are the same device"):
        calibrate_input._parts([infos[0], infos[0]])
