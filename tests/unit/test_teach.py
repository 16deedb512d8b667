"""Teaching a profile: the lesson alone, fed with moments; and the dialogue, with a person and a device in memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hid_devices import DESCRIPTORS
from lesson_person import LessonPerson
from pad import ROBOT, Pad, device_of, encode

from artemis import clock
from artemis.cli import app
from artemis.commands import calibrate_input
from artemis.commands.calibrate_input import teach
from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.controls import named_fields
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.hands import BUTTONS
from artemis.plugins.inputs.profiles import AxisProfile, Profile, profile_from, profile_named
from artemis.plugins.inputs.teach import Learnt, lesson
from artemis.plugins.inputs.teachable import Moment
from artemis.testing.fake_hid import FakeHid
from artemis.values import Request

# ---------------------------------------------------------------------------------------------- the lesson


class Pupil:
    """A device whose controls are moved in front of a lesson."""

    def __init__(self, name: str) -> None:
        self.profile = profile_named(name)
        self.descriptor = parse_descriptor(DESCRIPTORS[device_of(self.profile)])
        self.pad = Pad(name)
        self.lesson = lesson(self.profile.kind, named_fields("", self.descriptor))
        self.text = next(self.lesson)
        self.now = 0.0
        self.learnt: Learnt | None = None

    def show(self, *, typed: str | None = None, seconds: float = 0.01, heard: bool = True) -> str:
        """Moments of the levels as they are; what the lesson tells then."""
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            try:
                moment = Moment(time=self.now, values=self.values(), heard="" if heard else None, typed=typed)
                self.text = self.lesson.send(moment)
            except StopIteration as end:
                self.learnt = self.learnt or end.value
                self.text = "the end"
                return self.text
        return self.text

    def values(self) -> dict[str, int]:
        """Every field, as after a report; nothing before the first one."""
        if not self.pad.levels:
            return {}
        number = next(f.report_id for f in self.descriptor.fields if f.name == "x")
        return self.descriptor.decode(encode(self.descriptor, number, self.pad.levels)) or {}

    def rest(self, heard: bool = True) -> None:
        self.show(typed="")
        self.show(seconds=0.6, heard=heard)

    def swing(self, *places: dict[str, float]) -> str:
        """Move axes to each of these places, then let go of them."""
        for place in places:
            self.pad.release()
            self.pad.move(**place)
            self.show()
        self.pad.release()
        return self.show()

    def press(self, role: str) -> str:
        self.pad.press(role)
        self.show()
        self.pad.press(role, down=False)
        return self.show()

    def move_all(self) -> None:
        if self.profile.kind == "stick":
            self.swing({"x": 1.0}, {"x": -1.0})
            self.swing({"y": 1.0}, {"y": -1.0})
            corner = 1.0 if self.profile.gate == "square" else math.sqrt(0.5)
            self.swing({"x": corner, "y": corner})
            self.hold(y=1.0)
        else:
            self.swing({"steering": 1.0}, {"steering": -1.0})
            self.swing({"gas": 1.0})
            self.swing({"brake": 1.0})
            self.hold(steering=1.0, gas=1.0)

    def hold(self, *, heard: bool = True, **shares: float) -> str:
        """Hold axes at their ends where that is asked for, then let go."""
        if self.text.startswith("hold:"):
            self.pad.move(**shares)
            assert self.show(seconds=1.1, heard=heard) == "let go of everything"
            self.pad.release()
            self.show()
        return self.text

    def press_all(self) -> None:
        for role in (
            "enable",
            "quickstop",
            *(r for r in BUTTONS[self.profile.kind] if r not in ("enable", "quickstop")),
        ):
            if role in self.profile.buttons:
                self.press(role)
            else:
                self.show(typed="")


@pytest.mark.parametrize(
    "name", ["logitech-extreme-3d-pro", "logitech-g27", "sony-dualsense-bluetooth", "xbox-elite-2-bluetooth"]
)
def test_lesson_finds_the_profile_that_is_known(name: str) -> None:
    pupil = Pupil(name)
    pupil.rest()
    pupil.move_all()
    pupil.press_all()
    assert pupil.learnt is not None
    known = pupil.profile
    assert pupil.learnt.axes == known.axes
    assert pupil.learnt.buttons == known.buttons
    assert pupil.learnt.gate == known.gate
    assert pupil.learnt.reports == {"": "always"}


def test_device_that_is_silent_at_rest_reports_changes() -> None:
    pupil = Pupil("logitech-g27")
    pupil.rest(heard=False)
    pupil.move_all()
    pupil.press_all()
    assert pupil.learnt is not None
    assert pupil.learnt.reports == {"": "on_change"}


def test_centre_is_the_median_of_its_noise() -> None:
    pupil = Pupil("logitech-extreme-3d-pro")
    pupil.show(typed="")
    for index in range(60):
        pupil.pad.levels["x"] = 515 if index % 3 else 520
        pupil.show()
    pupil.pad.levels["x"] = 515
    for x in (1020, 3, 515):
        pupil.pad.levels["x"] = x
        pupil.show()
    pupil.pad.release()
    pupil.swing({"y": 1.0}, {"y": -1.0})
    pupil.swing({"x": 1.0, "y": 1.0})
    pupil.hold(y=1.0)
    pupil.press_all()
    assert pupil.learnt is not None
    x_axis = pupil.learnt.axes["x"]
    assert (x_axis.minimum, x_axis.centre, x_axis.maximum, x_axis.inverted) == (3, 515, 1020, False)


def test_nothing_is_measured_while_something_moves() -> None:
    pupil = Pupil("logitech-extreme-3d-pro")
    pupil.show(typed="")
    for index in range(200):
        pupil.pad.levels["x"] = 400 + 5 * index % 200
        pupil.show()
    assert pupil.text == "something moves; do not touch anything"
    pupil.pad.release()
    assert pupil.show(seconds=0.8).startswith("x: push the stick to the right")


def test_silent_device_is_asked_to_say_something_first() -> None:
    pupil = Pupil("logitech-g27")
    levels, pupil.pad.levels = pupil.pad.levels, {}
    assert pupil.show(typed="").startswith("nothing was heard of the device yet; press each pedal")
    pupil.pad.levels = levels
    assert pupil.show(typed="", seconds=0.7).startswith("steering: turn the wheel")


def test_small_movements_are_not_the_asked_ones() -> None:
    pupil = Pupil("logitech-g27")
    pupil.rest()
    assert pupil.swing({"steering": 0.05}, {"steering": -0.05}).startswith("steering")
    assert pupil.swing({"steering": 0.4}).startswith("steering")
    assert pupil.swing({"steering": -0.4}).startswith("gas")
    assert pupil.swing({"gas": 0.2}).startswith("gas")
    pupil.pad.move(gas=1.0)
    assert pupil.show(seconds=2.0).startswith("gas")  # held: which end is released is not known yet
    pupil.pad.release()
    assert pupil.show().startswith("brake")


def test_combined_pedals_are_told() -> None:
    pupil = Pupil("logitech-g27")
    pupil.rest()
    pupil.swing({"steering": 1.0}, {"steering": -1.0})
    pupil.swing({"gas": 1.0})
    assert "(that was z, which is gas; both pedals on one axis cannot be told apart" in pupil.swing({"gas": 0.9})
    assert pupil.swing({"brake": 1.0}).startswith("hold: turn the wheel to the right")
    assert pupil.hold(steering=1.0, gas=1.0).startswith("press the button for enable")


def test_buttons_count_when_they_go_down_and_once() -> None:
    pupil = Pupil("logitech-extreme-3d-pro")
    pupil.rest()
    pupil.move_all()
    assert pupil.show(typed="").endswith("(it cannot be left out)")
    pupil.pad.press("quickstop")  # held while the next is asked for
    pupil.show()
    assert pupil.text.startswith("press the button for quick stop")
    pupil.show(seconds=0.5)
    assert pupil.text.startswith("press the button for quick stop")
    pupil.pad.press("quickstop", down=False)
    pupil.show()
    assert pupil.press("quickstop").endswith("(button.2 is enable already)")
    assert pupil.press("enable").startswith("press the button for faster")


def test_hat_directions_can_be_taught() -> None:
    pupil = Pupil("logitech-extreme-3d-pro")
    pupil.rest()
    pupil.move_all()
    pupil.press("enable")
    pupil.press("quickstop")
    for hat in (8, 1, 0, 8, 3, 4, 8):  # on the way between two directions
        pupil.pad.levels["hat"] = hat
        pupil.show()
    for _ in BUTTONS["stick"]:
        pupil.show(typed="")
    assert pupil.learnt is not None
    assert pupil.learnt.buttons == {
        "enable": "button.1",
        "quickstop": "button.2",
        "faster": "hat.up",
        "slower": "hat.down",
    }


# ---------------------------------------------------------------------------------------------- the dialogue

Act = Callable[[], str | None]


class Person:
    """Does what it is told with a device, and types."""

    def __init__(self, pad: Pad, answers: dict[str, str]) -> None:
        self.pad, self.answers, self.told = pad, answers, list[str]()
        self._acts: Iterator[None] = iter(())
        self._line: str | None = None

    def say(self, text: str) -> None:
        self.told.append(text)
        self._acts = self._act(text)

    def typed(self) -> str | None:
        next(self._acts, None)
        line, self._line = self._line, None
        return line

    def _act(self, text: str) -> Iterator[None]:
        pad = self.pad
        answer = next((answer for asked, answer in self.answers.items() if asked in text), None)
        if answer is not None:
            self._line = answer
        elif "press Enter" in text:
            pad.release()
            pad.send()
            yield
            yield
            self._line = ""
        elif text.partition(":")[0] in ("steering", "gas", "brake"):
            role = text.partition(":")[0]
            for share in (1.0, 0.0, -1.0, 0.0) if role == "steering" else (1.0, 0.0):
                pad.move(**{role: share})
                pad.send()
                yield
        elif text.startswith("press the button"):
            role = next(
                (role for role in pad.profile.buttons if f"for {role}" in text.replace("quick s", "quicks")), ""
            )
            if not role:
                self._line = ""
            for down in (True, False) if role else ():
                pad.press(role, down=down)
                pad.send()
                yield


G27 = "logitech-g27"


def dialogue(
    output: Path | None, answers: dict[str, str], pad: Pad | None = None, **keys: str | None
) -> tuple[int, Person]:
    pad = pad or Pad(G27)
    person = Person(pad, {"a stick": "w", **answers})
    options = {"name": "my-wheel", **keys}
    status = clock.run(teach(pad.hid, person, (), options["name"], output), simulated=True)
    return status, person


def test_dialogue_writes_what_it_has_learnt_when_that_is_confirmed(tmp_path: Path) -> None:
    path = tmp_path / "new" / "wheel.yaml"
    status, person = dialogue(path, {"write ": "yes"})
    assert status == 0
    taught, known = profile_from(path.read_bytes(), "wheel"), profile_named(G27)
    assert (taught.name, taught.device, taught.axes) == ("my-wheel", known.device, known.axes)
    assert taught.buttons == known.buttons
    assert taught.reports == "on_change"
    assert "my-wheel" in person.told[-1]
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("answer", ["no", "n"])
def test_without_confirmation_nothing_changes(tmp_path: Path, answer: str) -> None:
    path = tmp_path / "wheel.yaml"
    path.write_text("as it was")
    assert dialogue(path, {"replace ": answer})[0] == 1
    assert path.read_text() == "as it was"


def test_taught_profile_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert dialogue(None, {"write ": "yes"})[0] == 0
    found: Profile = profile_named("my-wheel")
    assert found.kind == "wheel"
    assert Pad(G27).ready().enabled  # its own profile is still there


def test_interruption_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(calibrate_input, "_chosen", interrupted)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    assert calibrate_input.calibrate_input((), None, tmp_path / "wheel.yaml") == 130
    assert list(tmp_path.iterdir()) == []


def test_unplugged_device_ends_the_dialogue(tmp_path: Path) -> None:
    pad = Pad(G27)

    class Clumsy(Person):
        def say(self, text: str) -> None:
            super().say(text)
            if text.startswith("gas"):
                self.pad.hid.unplug()

    with pytest.raises(DeviceLost, match="is gone"):
        clock.run(teach(pad.hid, Clumsy(pad, {"a stick": "w"}), (), None, tmp_path / "x.yaml"), simulated=True)
    assert list(tmp_path.iterdir()) == []


def test_device_is_chosen_among_several() -> None:
    hid = FakeHid()
    with pytest.raises(DeviceLost, match=r"no joystick, gamepad or wheel is plugged in$"):
        calibrate_input._chosen(hid, None)
    one = HidInfo("/dev/hidraw0", "usb", 0x046D, 0xC29B, "A1", "Wheel", 0)
    two = HidInfo("/dev/hidraw1", "usb", 0x046D, 0xC215, "", "Stick", 0)
    mouse = HidInfo("/dev/hidraw2", "usb", 0x046D, 0xC077, "", "Mouse", 0, 0x10002)
    for info in (one, two, mouse):
        hid.plug(info, DESCRIPTORS["logitech_g27"])
    assert calibrate_input._chosen(hid, "046D:c215") == two
    assert calibrate_input._chosen(hid, "a1") == one
    with pytest.raises(DeviceLost, match=r"several devices are plugged in; choose with --device") as caught:
        calibrate_input._chosen(hid, None)
    assert "Mouse" not in str(caught.value)
    with pytest.raises(DeviceLost, match="no 046d:ffff is plugged in"):
        calibrate_input._chosen(hid, "046d:ffff")


def test_wrong_name_is_refused_before_the_lesson() -> None:
    with pytest.raises(ConfigError, match="--name 'My Wheel': expected at most 64 small letters"):
        dialogue(None, {}, name="My Wheel")


def test_dialogue_without_a_person_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    with pytest.raises(ConfigError, match="a person at a terminal"):
        calibrate_input.calibrate_input((), None, None)


# ---------------------------------------------------------------------------------------------- the command itself

UNKNOWN = "dragonrise_0006"
"""Sold with several layouts under one number, so that nothing is known of it."""
GAMEPAD = HidInfo("/dev/hidraw4", "usb", 0x0079, 0x0006, "", "USB Gamepad", 0)
REST = {"x": 130, "y": 125, "z": 128, "z.2": 127, "rz": 128, "hat": 15}
PUSHES: dict[str, list[dict[str, int]]] = {
    "x": [{"x": 255}, {}, {"x": 0}, {}],
    "y": [{"y": 0}, {}, {"y": 255}, {}],
    "corner": [{"x": 240, "y": 15}, {}],
}
PRESSES = {"enable": "button.5", "quick stop": "button.3", "faster": "hat", "arm": "button.10"}


class AtHisGamepad(LessonPerson):
    """Somebody at the terminal, with a gamepad of which artemis knows nothing."""

    def __init__(self, hid: FakeHid) -> None:
        super().__init__()
        self._hid, self._descriptor = hid, parse_descriptor(DESCRIPTORS[UNKNOWN])

    def send(self, **levels: int) -> None:
        self._hid.send(encode(self._descriptor, 0, {**REST, **levels}))

    def act(self, text: str) -> Iterator[str | None]:
        asked = text.partition(":")[0]
        pressed = next((name for name in PRESSES if text.startswith(f"press the button for {name}")), None)
        if text.startswith("a stick"):
            yield "stick"
        elif text.endswith("press Enter"):
            self.send()
            yield None
            yield ""
        elif asked in PUSHES:
            for levels in PUSHES[asked]:
                self.send(**levels)
                yield None
        elif pressed is not None:
            down = {PRESSES[pressed]: 0 if PRESSES[pressed] == "hat" else 1}  # the hat: up
            for levels in (down, {}):
                self.send(**levels)
                yield None
        elif text.startswith("press the button"):
            yield ""
        elif text.startswith("write "):
            yield "yes"


def test_the_command_teaches_a_device_that_no_profile_knows_and_it_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hid = FakeHid()
    hid.plug(GAMEPAD, DESCRIPTORS[UNKNOWN])
    person = AtHisGamepad(hid)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    context = PluginContext(name="stick", robot=ROBOT, folder=tmp_path)
    stranger = GamepadInput(GamepadConfig(), context, hid)
    with pytest.raises(DeviceLost, match="there is no profile for it; teach it: artemis calibrate input"):
        [stranger.read(now) for now in (0.0, 5.0)]

    run = clock.run
    monkeypatch.setattr("artemis.commands.calibrate_input.clock.run", lambda main, simulated: run(main, simulated=True))
    monkeypatch.setattr("artemis.commands.calibrate_input.InputPorts", lambda: hid)
    monkeypatch.setattr("artemis.commands.calibrate_input.Terminal", lambda: person)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    with pytest.raises(SystemExit) as end:
        app(["calibrate", "input"])
    assert end.value.code == 0
    assert person.told[0] == str(GAMEPAD)
    assert person.told[-1] == "written; a mission uses it with {plugin: gamepad, profile: usb-gamepad}"

    taught = profile_named("usb-gamepad")
    assert taught.axes["x"] == AxisProfile(field="x", minimum=0, centre=130, maximum=255)
    assert taught.axes["y"] == AxisProfile(field="y", minimum=0, centre=125, maximum=255, inverted=True)
    assert (taught.gate, taught.reports) == ("square", "on_change")
    buttons = {"enable": "button.5", "quickstop": "button.3", "faster": "hat.up", "arm": "button.10"}
    assert taught.buttons == buttons

    device = GamepadInput(GamepadConfig(), context, hid)  # auto: the one that is plugged in
    device.read(0.0)
    person.send()
    for tick in range(1, 40):
        device.read(tick * 0.02)
    person.send(y=0, **{"button.5": 1})
    sample = device.read(0.8)
    assert sample.enabled
    assert sample.speed == pytest.approx(ROBOT.limits.speed_m_s)
    person.send(**{"button.3": 1})
    assert device.read(0.82).requests == (Request.QUICKSTOP,)
