"""Profiles: every shipped one against what its device really sends, and what is refused."""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path

import pytest
from hid_devices import DESCRIPTORS, DEVICES
from pad import NAMES, device_of, encode

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.identity import Identity
from artemis.errors import ConfigError
from artemis.plugins.inputs.chain import centre_pedal
from artemis.plugins.inputs.controls import Controls, named_fields, values_of
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.joystick import deflection_from_stick
from artemis.plugins.inputs.profiles import (
    SHIPPED,
    AxisProfile,
    DeviceKey,
    Profile,
    all_profiles,
    find_profile,
    misfits,
    profile_from,
    profile_named,
    text_of,
)

PROFILES = {name: profile_named(name) for name in NAMES}
SAMPLES = [
    (name, sample["report"], sample)
    for name, profile in PROFILES.items()
    for sample in DEVICES[device_of(profile)]["sample_reports"]
    if sample["decoded"]
]
G27 = (SHIPPED / "logitech-g27.yaml").read_text()


def controls_of(profile: Profile) -> Controls:
    return Controls(profile, named_fields("", parse_descriptor(DESCRIPTORS[device_of(profile)])))


def identity_of(name: str, device: str, **changes: object) -> Identity:
    key = PROFILES[name].parts[""]
    digits = sha256(DESCRIPTORS[device]).hexdigest()[:16]
    values = {"bus": key.bus, "vendor": key.vendor, "product": key.product, "descriptor_hash": digits, **changes}
    return Identity(**values)  # type: ignore[arg-type]  # one text and three numbers


# ---------------------------------------------------------------------------------------------- the shipped ones


def test_enough_devices_are_known() -> None:
    assert len(NAMES) >= 12
    assert {profile.kind for profile in PROFILES.values()} == {"stick", "wheel"}


@pytest.mark.parametrize("name", NAMES)
def test_profile_is_of_its_device(name: str) -> None:
    profile = PROFILES[name]
    device = DEVICES[device_of(profile)]  # found by the hash of its report descriptor
    found = profile.parts[""].bus, profile.parts[""].vendor, profile.parts[""].product
    assert found == (device["bus"], int(device["vid"], 16), int(device["pid"], 16))
    assert misfits(profile, parse_descriptor(DESCRIPTORS[device_of(profile)])) == []
    assert (profile.kind == "wheel") == (device["kind"] == "wheel")
    assert profile_from(text_of(profile).encode(), "again") == profile
    assert (SHIPPED / f"{name}.yaml").read_text().startswith("# ")


@pytest.mark.parametrize("name", NAMES)
def test_axes_go_over_the_whole_logical_range(name: str) -> None:
    profile = PROFILES[name]
    fields = {field.name: field for field in parse_descriptor(DESCRIPTORS[device_of(profile)]).fields}
    for axis in profile.axes.values():
        assert (axis.minimum, axis.maximum) == (fields[axis.field].minimum, fields[axis.field].maximum)


@pytest.mark.parametrize("name", NAMES)
def test_ends_of_every_axis_have_their_signs(name: str) -> None:
    """x and steering grow to the right; y of every HID device to the operator; pedals rest at the maximum."""
    profile = PROFILES[name]
    descriptor = parse_descriptor(DESCRIPTORS[device_of(profile)])
    number = next(f.report_id for f in descriptor.fields if f.name == "x")
    fields = {field.name: field for field in descriptor.fields}

    def axes(**ends: str) -> dict[str, float]:
        controls = controls_of(profile)
        levels = {
            profile.axes[role].field: getattr(fields[profile.axes[role].field], end) for role, end in ends.items()
        }
        controls.take(values_of("", descriptor, encode(descriptor, number, levels)) or {})
        return dict(zip(profile.axes, controls.axes, strict=True))

    if profile.kind == "stick":
        assert axes(x="maximum", y="minimum") == {"x": 1.0, "y": 1.0}
        assert axes(x="minimum", y="maximum") == {"x": -1.0, "y": -1.0}
    else:
        assert axes(steering="maximum", gas="maximum", brake="maximum") == {"steering": 1.0, "gas": 0.0, "brake": 0.0}
        assert axes(steering="minimum", gas="minimum", brake="minimum") == {"steering": -1.0, "gas": 1.0, "brake": 1.0}


def test_samples_of_many_devices_are_there() -> None:
    assert len({name for name, *_ in SAMPLES}) >= 5


@pytest.mark.parametrize(("name", "report", "sample"), SAMPLES, ids=[f"{n}-{r[:14]}" for n, r, _ in SAMPLES])
def test_captured_reports_say_what_was_done(name: str, report: str, sample: dict[str, object]) -> None:
    profile, controls = PROFILES[name], controls_of(PROFILES[name])
    values = values_of("", parse_descriptor(DESCRIPTORS[device_of(profile)]), bytes.fromhex(report))
    assert values is not None
    controls.take(values)
    axes = dict(zip(profile.axes, controls.axes, strict=True))
    pressed = {f"button.{number}" for number in sample.get("buttons", [])}  # type: ignore[attr-defined]
    assert {profile.buttons[role] for role in controls.down} == pressed & set(profile.buttons.values())
    meaning = str(sample["meaning"])
    if profile.kind == "wheel":
        assert centre_pedal(axes["gas"], profile.deadzone) == centre_pedal(axes["brake"], profile.deadzone) == 0.0
        side = {"leftmost": (-1.0, 0.0), "rightmost": (0.0, 1.0)}.get(meaning.partition(" ")[0], (-0.1, 0.1))
        assert side[0] < axes["steering"] < side[1]
        return
    deflection = deflection_from_stick(axes["x"], axes["y"], profile.gate, profile.deadzone)
    wanted = {"up": ("y", 1.0), "down": ("y", -1.0), "left": ("x", -1.0), "right": ("x", 1.0)}
    direction = wanted.get(meaning.partition(":")[0])
    if direction is None:
        assert deflection == 0.0
    else:
        assert axes[direction[0]] == pytest.approx(direction[1])


def test_page_about_inputs_names_every_profile_and_every_key() -> None:
    page = (Path(__file__).parents[2] / "docs" / "inputs.md").read_text()
    prose = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)
    named = set(re.findall(r"[\w-]+", " ".join(re.findall(r"`([^`]+)`", prose))))
    keys = {key for model in (GamepadConfig, Profile, DeviceKey, AxisProfile) for key in model.model_fields}
    assert {*NAMES, *keys} - named == set()


# ---------------------------------------------------------------------------------------------- hats as buttons


def test_hat_directions_are_buttons_and_a_released_hat_is_none() -> None:
    raw = DESCRIPTORS["xbox_series_ble"]  # 1 to 8, released 0
    descriptor = parse_descriptor(raw)
    buttons = {**PROFILES["xbox-series-bluetooth"].buttons, "faster": "hat.up", "slower": "hat.down", "end": "hat.left"}
    profile = PROFILES["xbox-series-bluetooth"].model_copy(update={"buttons": buttons})
    controls = Controls(profile, named_fields("", descriptor))
    found = []
    for hat in (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15):
        controls.take(descriptor.decode(encode(descriptor, 1, {"x": 32768, "y": 32768, "hat": hat})) or {})
        found.append(sorted(controls.down))
    up, down, left = ["faster"], ["slower"], ["end"]
    assert found == [[], up, up, [], down, down, ["end", "slower"], left, ["end", "faster"], [], []]


# ---------------------------------------------------------------------------------------------- finding


def test_exact_descriptor_goes_first() -> None:
    descriptor = parse_descriptor(DESCRIPTORS["logitech_g27"])
    other = profile_from(
        G27.replace("name: logitech-g27", "name: other").replace("b0332edfa0d0942f", "0" * 16).encode(), ""
    )
    found = find_profile(identity_of("logitech-g27", "logitech_g27"), descriptor, [other, PROFILES["logitech-g27"]])
    assert found == PROFILES["logitech-g27"]
    assert find_profile(identity_of("logitech-g27", "logitech_g27"), descriptor, [other]) == other


def test_other_descriptor_of_the_product_is_taken_if_everything_fits() -> None:
    profile = PROFILES["xbox-one-s-bluetooth"]
    descriptor = parse_descriptor(DESCRIPTORS["xbox_series_ble"])  # other firmware, same fields
    identity = identity_of("xbox-one-s-bluetooth", "xbox_series_ble")
    assert find_profile(identity, descriptor, [profile]) == profile
    assert find_profile(identity, parse_descriptor(DESCRIPTORS["8bitdo_sn30_windows"]), [profile]) is None


def test_numbers_of_another_size_do_not_fit() -> None:
    narrow = {"minimum": 0, "centre": 128, "maximum": 255}
    x = PROFILES["logitech-extreme-3d-pro"].axes["x"].model_copy(update=narrow)
    profile = PROFILES["logitech-extreme-3d-pro"].model_copy(
        update={"axes": {**PROFILES["logitech-extreme-3d-pro"].axes, "x": x}}
    )
    identity = identity_of("logitech-extreme-3d-pro", "logitech_extreme_3d_pro", descriptor_hash="f" * 16)
    assert find_profile(identity, parse_descriptor(DESCRIPTORS["logitech_extreme_3d_pro"]), [profile]) is None


def test_device_of_an_unknown_bus_is_known_by_the_rest() -> None:
    identity = identity_of("logitech-g27", "logitech_g27", bus="unknown")
    descriptor = parse_descriptor(DESCRIPTORS["logitech_g27"])
    assert find_profile(identity, descriptor, PROFILES.values()) == PROFILES["logitech-g27"]


@pytest.mark.parametrize("change", [{"bus": "bluetooth"}, {"vendor": 1}, {"product": 1}])
def test_another_device_has_another_profile(change: dict[str, object]) -> None:
    identity = identity_of("logitech-g27", "logitech_g27", **change)
    assert find_profile(identity, parse_descriptor(DESCRIPTORS["logitech_g27"]), PROFILES.values()) is None


# ---------------------------------------------------------------------------------------------- one's own


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "artemis" / "profiles"
    folder.mkdir(parents=True)
    return folder


def test_ones_own_profile_goes_before_the_shipped_one(own: Path) -> None:
    (own / "logitech-g27.yaml").write_text(G27.replace("deadzone: 0.05", "deadzone: 0.1"))
    assert profile_named("logitech-g27").deadzone == 0.1
    assert all_profiles()[0].deadzone == 0.1
    assert len(all_profiles()) == len(list(SHIPPED.glob("*.yaml"))) + 1


def test_a_file_under_another_name_is_refused(own: Path) -> None:
    (own / "mine.yaml").write_text(G27)
    with pytest.raises(ConfigError, match=r"mine.yaml: name: expected mine, as the file is called, found logitech-g27"):
        all_profiles()


def test_unknown_profile_is_answered_with_the_nearest_and_all() -> None:
    with pytest.raises(ConfigError) as caught:
        profile_named("logitech-extrem-3d")
    assert "nearest is 'logitech-extreme-3d-pro', there are 8bitdo-sn30" in str(caught.value)
    assert all(name in str(caught.value) for name in NAMES)


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("kind: wheel", "kind: weel", "p.yaml:5:1: kind: Input should be 'stick', 'wheel' or 'levers', found 'weel'"),
        ("maximum: 16383", "maximum: 100", "p.yaml:9:3: axes.steering: 0, 8192, 100: expected minimum < centre < max"),
        ("centre: 8192, ", "", "axes.steering: its centre is missing"),
        ("field: rz, minimum: 0,", "field: rz, minimum: 0, centre: 9,", "axes.brake: a pedal has no centre"),
        ("field: rz", "field: z", "a combined axis cannot show both pedals pressed"),
        ("  brake: {field: rz, minimum: 0, maximum: 255, inverted: true}\n", "", "a wheel has steering, gas, brake"),
        ("  reverse:", "  revers:", "buttons.revers: no such role; nearest is 'reverse'"),
        ("  enable: button.6\n", "", "buttons.enable: missing"),
        ("reverse: button.4", "reverse: button.6", "two roles have one button"),
        ("reports: on_change", "report: on_change", "report: Extra inputs are not permitted"),
        ("reports: on_change\n", "", "reports: missing"),
        ("bus: usb", "bus: ubs", "device.bus: Input should be 'usb', 'bluetooth'"),
        ("product: 0xc29b", "product: 0x1c29b", "less than or equal to 65535"),
        ('"b0332edfa0d0942f"', '"b033"', "String should match pattern"),
    ],
)
def test_what_is_no_profile_is_refused_with_its_place(old: str, new: str, expected: str) -> None:
    assert old in G27
    with pytest.raises(ConfigError) as caught:
        profile_from(G27.replace(old, new).encode(), "p.yaml")
    assert expected in str(caught.value)


def test_what_a_device_lacks_is_named() -> None:
    descriptor = parse_descriptor(DESCRIPTORS["logitech_f310_directinput"])
    assert misfits(PROFILES["logitech-g25"], descriptor) == [
        "axes.steering: the device's x goes from 0 to 255",
    ]
    buttons = {**PROFILES["logitech-f310"].buttons, "end": "button.40", "done": "hat.2.up"}
    profile = PROFILES["logitech-f310"].model_copy(update={"buttons": buttons})
    assert misfits(profile, descriptor) == [
        "buttons.done: the device has no hat.2.up",
        "buttons.end: the device has no button.40",
    ]
