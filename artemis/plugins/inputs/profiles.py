"""Profiles: which control of a device is what, and how far its axes go.

A profile is known by the device's bus, vendor and product and by a hash of its report descriptor, or of what evdev says
of its axes and buttons: one product is sold with several layouts, and some devices borrow the identity of others.
Profiles of one's own go before those that come with artemis.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path as FilePath
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, ValidationError, model_validator

from artemis.config import Config
from artemis.devices.hid.descriptor import Descriptor
from artemis.devices.hid.descriptor import Field as HidField
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import Source
from artemis.errors import ConfigError, shown, similar
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Kind
from artemis.plugins.inputs.joystick import Gate
from artemis.user_folders import user_folder
from artemis.yaml_file import read, survey

DIRECTIONS = ("up", "right", "down", "left")
"""Of a hat switch, clockwise."""
SHIPPED = FilePath(__file__).parent / "known"
NAME = r"^[a-z0-9-]{1,64}$"
Unsigned16 = Annotated[int, Field(ge=0, le=0xFFFF)]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{16}$")]


class AxisProfile(Config):
    """Where an axis stands in the reports, and how far it goes, in counts."""

    field: str
    """Name of the field in the report descriptor: x, rz, slider. With several devices that of the device first:
    pedals/rz."""
    minimum: int
    centre: int | None = None
    """Where it rests; a pedal has none, nor has a lever or a trigger that commands one direction of travel."""
    maximum: int
    inverted: bool = False
    """The minimum is right, forward, or pressed."""

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        middle = [] if self.centre is None else [self.centre]
        places = [self.minimum, *middle, self.maximum]
        if any(after <= before for before, after in pairwise(places)):
            raise ValueError(f"{', '.join(map(str, places))}: expected minimum < centre < maximum")
        return self


Reports: TypeAlias = Literal["always", "counted", "on_change"]


class DeviceKey(Config):
    """Which devices a profile is for."""

    bus: Literal["usb", "bluetooth", "i2c", "spi", "unknown"]
    vendor: Unsigned16
    product: Unsigned16
    descriptor: Digest | None = None
    """First 16 digits of the report descriptor's SHA-256, of a device that is read by hidraw."""
    capabilities: Digest | None = None
    """Of the capabilities' SHA-256, of one that is read by evdev."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.descriptor is None) == (self.capabilities is None):
            raise ValueError("descriptor (of a HID device) or capabilities (of one that evdev shows): expected one")
        return self

    @property
    def source(self) -> Source:
        """By which interface the device is read."""
        return "hidraw" if self.capabilities is None else "evdev"

    @property
    def digest(self) -> str:
        """That of descriptor or capabilities."""
        return self.descriptor or self.capabilities or ""

    def is_of(self, identity: Identity) -> bool:
        """Whether interface, bus, vendor and product are those of the device."""
        same_bus = identity.bus in (self.bus, "unknown")  # hidapi knows no bus of what a program plugs in (uhid)
        same_interface = same_bus and self.source == identity.source
        return same_interface and (self.vendor, self.product) == (identity.vendor, identity.product)


class ProfileDevice(DeviceKey):
    """One of a profile's devices."""

    reports: Reports
    """always: also at rest, so that silence means a frozen device. counted: and no two in a row are equal, so that a
    repeated one is no news. on_change: silence is normal."""
    serial: str | None = None
    """Where two of a profile's devices are alike."""

    def may_be(self, other: ProfileDevice) -> bool:
        """Whether one device may be both."""
        same = (self.source, self.vendor, self.product) == (other.source, other.vendor, other.product)
        return same and (None in (self.serial, other.serial) or self.serial == other.serial)


class Profile(Config):
    """One kind of device, or several that are held together: a wheel, and pedals of their own."""

    name: Annotated[str, Field(pattern=NAME)]
    device: DeviceKey | None = None
    devices: dict[Annotated[str, Field(pattern=NAME)], ProfileDevice] = Field(default_factory=dict)
    """Instead of `device` and `reports`, by names of the profile's own."""
    kind: Kind
    reports: Reports | None = None
    """Of the only device; see `ProfileDevice`."""
    gate: Gate = "square"
    """What a stick's travel ends at."""
    deadzone: Annotated[float, Field(ge=0, le=0.5)] = 0.05
    """Share of the way that counts as released."""
    axes: dict[str, AxisProfile]
    """By role: x, y of a stick; steering, gas, brake of a wheel; steering, speed of levers."""
    buttons: dict[str, str]
    """Field of each button by its role: button.1, or a direction of a hat switch: hat.up."""

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        problems = list(self._problems())
        if problems:
            raise ValueError("; ".join(problems))
        return self

    @property
    def parts(self) -> dict[str, ProfileDevice]:
        """Its devices by their names; the only one has none."""
        if self.device is None or self.reports is None:
            return self.devices
        return {"": ProfileDevice(**self.device.model_dump(), reports=self.reports)}

    @property
    def fields(self) -> list[str]:
        """What its controls refer to: a field, or a direction of a hat switch; a device's name goes before."""
        return [*(axis.field for axis in self.axes.values()), *self.buttons.values()]

    def _problems(self) -> Iterator[str]:
        yield from self._problems_of_devices()
        if set(self.axes) != set(AXES[self.kind]):
            yield f"axes: a {self.kind} has {', '.join(AXES[self.kind])}, found {', '.join(self.axes) or 'none'}"
        for role, axis in self.axes.items():
            if role != "speed" and (axis.centre is None) != (role in PEDALS):
                yield f"axes.{role}: {'a pedal has no centre' if role in PEDALS else 'its centre is missing'}"
        fields = [axis.field for axis in self.axes.values()]
        if len(set(fields)) < len(fields):
            yield "axes: two have one field: a combined axis cannot show both pedals pressed"
        for role in self.buttons:
            if role not in BUTTONS[self.kind]:
                yield f"buttons.{role}: no such role; {similar(role, BUTTONS[self.kind])}"
        if any(part.source == "evdev" and part.reports != "on_change" for part in self.parts.values()):
            yield "reports: evdev passes changes only: expected on_change"
        if "reverse" in self.buttons and "speed" in self.axes and self.axes["speed"].centre is not None:
            yield "buttons.reverse: the axis speed has a centre and commands both directions; leave it out"
        for role in ("enable", "quickstop"):
            if role not in self.buttons:
                yield f"buttons.{role}: missing"
        if len(set(self.buttons.values())) < len(self.buttons):
            yield "buttons: two roles have one button"

    def _problems_of_devices(self) -> Iterator[str]:
        for key, value in (("device", self.device), ("reports", self.reports)):
            if value is None and not self.devices:
                yield f"{key}: missing"
            elif value is not None and self.devices:
                yield f"{key}: not beside devices; each of them has its own"
        if len(self.devices) == 1:
            yield "devices: only one; write device and reports"
        used = {part_of(name)[0] for name in self.fields}
        for part in sorted(used - set(self.parts)):
            yield (
                f"no device {part}; {similar(part, self.parts)}"
                if part
                else "a field names no device: expected DEVICE/FIELD"
            )
        for part in self.parts.keys() - used:
            yield f"devices.{part}: no axis and no button is on it"
        for one, other in combinations(self.parts, 2):
            if self.parts[one].may_be(self.parts[other]):
                yield f"devices: {one} and {other} cannot be told apart; give each its serial"


def part_of(name: str) -> tuple[str, str]:
    """The device that the name of a field begins with (empty: the profile has only one), and the rest of the name."""
    part, _, rest = name.rpartition("/")
    return part, rest


def misfits(profile: Profile, descriptor: Descriptor, part: str = "") -> list[str]:
    """Why reports of this descriptor cannot be those of the device `part` of a profile; empty if they can."""
    fields = {f"{part}/{field.name}" if part else field.name: field for field in descriptor.fields}
    problems = []
    for role, axis in profile.axes.items():
        if part_of(axis.field)[0] != part:
            continue
        field = fields.get(axis.field)
        if field is None or field.relative:
            problems.append(f"axes.{role}: the device has no {axis.field}")
        elif not field.minimum <= axis.minimum < axis.maximum <= field.maximum:
            problems.append(f"axes.{role}: the device's {axis.field} goes from {field.minimum} to {field.maximum}")
    for role, name in profile.buttons.items():
        if part_of(name)[0] != part:
            continue
        hat, direction = hat_direction(name)
        field = fields.get(hat)
        if field is None or (not is_button(field) if direction is None else field.step is None):
            problems.append(f"buttons.{role}: the device has no {name}")
    return problems


def is_button(field: HidField) -> bool:
    """Whether a field has two values, of which the higher one is: pressed."""
    return field.maximum - field.minimum == 1 and not field.relative


def hat_direction(name: str) -> tuple[str, float | None]:
    """Field of a hat switch and its direction of `hat.up`, in degrees clockwise from up; no direction: a button."""
    hat, _, direction = name.rpartition(".")
    is_hat = part_of(hat)[1].partition(".")[0] == "hat" and direction in DIRECTIONS
    return (hat, 90.0 * DIRECTIONS.index(direction)) if is_hat else (name, None)


def off_direction(value: int, hat: HidField, direction: float) -> float:
    """How far a hat switch points away from a direction [degrees], 0 to 180; infinite where it points nowhere."""
    if hat.step is None or not hat.minimum <= value <= hat.maximum:
        return math.inf
    return abs(((value - hat.minimum) * hat.step - direction + 180.0) % 360.0 - 180.0)


def find_profile(identity: Identity, descriptor: Descriptor, profiles: Iterable[Profile]) -> Profile | None:
    """The profile of a device: with its very descriptor, else of its vendor and product where all fields fit."""
    fitting = [profile for profile in profiles if is_part(profile, "", identity, descriptor)]
    exact = (it for it in fitting if it.parts[""].digest == identity.descriptor_hash)
    return next(exact, None) or next(iter(fitting), None)


def is_part(profile: Profile, part: str, identity: Identity, descriptor: Descriptor) -> bool:
    """Whether a device may be the one of that name in a profile: with its very descriptor, or one where all fits."""
    key = profile.parts.get(part)
    if key is None or not key.is_of(identity) or key.serial not in (None, identity.serial):
        return False
    is_exact = key.digest == identity.descriptor_hash
    return not misfits(profile, descriptor, part) and (is_exact or _is_alike(profile, descriptor, part))


def _is_alike(profile: Profile, descriptor: Descriptor, part: str) -> bool:
    """The axes have the size that the profile knows: not 10 bits where it has 8."""
    sizes = {field.name: field.maximum - field.minimum for field in descriptor.fields}
    named = [(part_of(axis.field), axis) for axis in profile.axes.values()]
    return all(2 * (axis.maximum - axis.minimum) > sizes[field] for (on, field), axis in named if on == part)


def profile_named(name: str) -> Profile:
    """The profile of that name, one's own before those that come with artemis.

    Raises:
        ConfigError: there is none, or its file is wrong.
    """
    for folder in (own_folder(), SHIPPED):
        if (folder / f"{name}.yaml").is_file():
            return _load(folder / f"{name}.yaml")
    names = sorted({path.stem for folder in (own_folder(), SHIPPED) for path in folder.glob("*.yaml")})
    raise ConfigError(f"no such profile; {similar(name, names)}; artemis calibrate input teaches one")


def all_profiles() -> tuple[Profile, ...]:
    """Every profile, one's own first.

    Raises:
        ConfigError: one's own file is wrong.
    """
    return (*(_load(path) for path in sorted(own_folder().glob("*.yaml"))), *_shipped())


@cache
def _shipped() -> tuple[Profile, ...]:
    return tuple(_load(path) for path in sorted(SHIPPED.glob("*.yaml")))


def own_folder() -> FilePath:
    """Where one's own profiles are kept."""
    return user_folder("XDG_CONFIG_HOME", ".config") / "profiles"


def _load(path: FilePath) -> Profile:
    profile = profile_from(read(path), str(path))
    if profile.name != path.stem:
        raise ConfigError(f"{path}: name: expected {path.stem}, as the file is called, found {profile.name}")
    return profile


def profile_from(raw: bytes, source: str) -> Profile:
    """The profile in a file of that content.

    Raises:
        ConfigError: everything that is wrong in it, with file:line:column.
    """
    document, problems = survey(raw, source)
    try:
        profile = Profile.model_validate(document.data)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            words = str(detail.get("ctx", {}).get("error", detail["msg"]))
            found = "" if detail["type"] in ("missing", "value_error") else f", found {shown(detail['input'])}"
            problems = [*problems, document.problem(detail["loc"], words + found)]
    if problems:
        raise ConfigError(problems)
    return profile


def text_of(profile: Profile) -> str:
    """A profile as the content of its file."""
    lines = [f"name: {profile.name}"]
    if profile.device is not None:
        lines.append(f"device: {{{_words(profile.device)}}}")
    else:
        lines += ["devices:", *(f"  {name}: {{{_words(part)}}}" for name, part in profile.devices.items())]
    lines.append(f"kind: {profile.kind}")
    if profile.reports is not None:
        lines.append(f"reports: {profile.reports}")
    if profile.kind == "stick":
        lines.append(f"gate: {profile.gate}")
    lines += [f"deadzone: {profile.deadzone:g}", "axes:"]
    for role, axis in profile.axes.items():
        keys = axis.model_dump(exclude_none=True, exclude_defaults=True)
        words = ", ".join(f"{key}: {str(value).lower()}" for key, value in keys.items())
        lines.append(f"  {role}: {{{words}}}")
    lines += ["buttons:", *(f"  {role}: {name}" for role, name in profile.buttons.items())]
    return "\n".join(lines) + "\n"


def _words(key: DeviceKey) -> str:
    words = f"bus: {key.bus}, vendor: 0x{key.vendor:04x}, product: 0x{key.product:04x}, "
    words += f'{"descriptor" if key.source == "hidraw" else "capabilities"}: "{key.digest}"'
    if isinstance(key, ProfileDevice):
        words += f", reports: {key.reports}" + (f", serial: {json.dumps(key.serial)}" if key.serial else "")
    return words
