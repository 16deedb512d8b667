"""Profiles: which control of a device is what, and how far its axes go.

A profile is known by the device's bus, vendor and product and by a hash of its report descriptor: one product is sold
with several layouts, and some devices borrow the identity of others. Profiles of one's own go before those that come
with artemis.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from artemis.config import Config
from artemis.devices.hid.descriptor import Descriptor
from artemis.devices.hid.identity import Identity
from artemis.errors import ConfigError, shown, similar
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Kind
from artemis.plugins.inputs.joystick import Gate
from artemis.yaml_file import read, survey

DIRECTIONS = ("up", "right", "down", "left")
"""Of a hat switch, clockwise."""
SHIPPED = FilePath(__file__).parent / "known"
NAME = r"^[a-z0-9-]{1,64}$"
Unsigned16 = Annotated[int, Field(ge=0, le=0xFFFF)]


class AxisProfile(Config):
    """Where an axis stands in the reports, and how far it goes, in counts."""

    field: str
    """Name of the field in the report descriptor: x, rz, slider."""
    minimum: int
    centre: int | None = None
    """Where it rests; a pedal has none."""
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


class DeviceKey(Config):
    """Which devices a profile is for."""

    bus: Literal["usb", "bluetooth", "i2c", "spi", "unknown"]
    vendor: Unsigned16
    product: Unsigned16
    descriptor: Annotated[str, Field(pattern="^[0-9a-f]{16}$")]
    """First 16 digits of the report descriptor's SHA-256."""

    def is_of(self, identity: Identity) -> bool:
        """Whether bus, vendor and product are those of the device."""
        same_bus = identity.bus in (self.bus, "unknown")  # hidapi knows no bus of what a program plugs in (uhid)
        return same_bus and (self.vendor, self.product) == (identity.vendor, identity.product)


class Profile(Config):
    """One kind of device."""

    name: Annotated[str, Field(pattern=NAME)]
    device: DeviceKey
    kind: Kind
    reports: Literal["always", "counted", "on_change"]
    """always: also at rest, so that silence means a frozen device. counted: and no two in a row are equal, so that a
    repeated one is no news. on_change: silence is normal."""
    gate: Gate = "square"
    """What a stick's travel ends at."""
    deadzone: Annotated[float, Field(ge=0, le=0.5)] = 0.05
    """Share of the way that counts as released."""
    axes: dict[str, AxisProfile]
    """By role: x, y of a stick; steering, gas, brake of a wheel."""
    buttons: dict[str, str]
    """Field of each button by its role: button.1, or a direction of a hat switch: hat.up."""

    @model_validator(mode="after")
    def _fits_its_kind(self) -> Self:
        problems = list(self._problems())
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _problems(self) -> Iterator[str]:
        if set(self.axes) != set(AXES[self.kind]):
            yield f"axes: a {self.kind} has {', '.join(AXES[self.kind])}, found {', '.join(self.axes) or 'none'}"
        for role, axis in self.axes.items():
            if (axis.centre is None) != (role in PEDALS):
                yield f"axes.{role}: {'a pedal has no centre' if role in PEDALS else 'its centre is missing'}"
        fields = [axis.field for axis in self.axes.values()]
        if len(set(fields)) < len(fields):
            yield "axes: two have one field: a combined axis cannot show both pedals pressed"
        for role in self.buttons:
            if role not in BUTTONS[self.kind]:
                yield f"buttons.{role}: no such role; {similar(role, BUTTONS[self.kind])}"
        for role in ("enable", "quickstop"):
            if role not in self.buttons:
                yield f"buttons.{role}: missing"
        if len(set(self.buttons.values())) < len(self.buttons):
            yield "buttons: two roles have one button"


def misfits(profile: Profile, descriptor: Descriptor) -> list[str]:
    """Why reports of this descriptor cannot be read with a profile; empty if they can."""
    fields = {field.name: field for field in descriptor.fields}
    problems = []
    for role, axis in profile.axes.items():
        field = fields.get(axis.field)
        if field is None or field.relative:
            problems.append(f"axes.{role}: the device has no {axis.field}")
        elif not field.minimum <= axis.minimum < axis.maximum <= field.maximum:
            problems.append(f"axes.{role}: the device's {axis.field} goes from {field.minimum} to {field.maximum}")
    for role, name in profile.buttons.items():
        hat, direction = hat_direction(name)
        field = fields.get(hat if direction is not None else name)
        steps = None if field is None else field.maximum - field.minimum
        if steps != (1 if direction is None else 7):
            problems.append(f"buttons.{role}: the device has no {name}")
    return problems


def hat_direction(name: str) -> tuple[str, int | None]:
    """Field of a hat switch and its direction, clockwise in eighths from up, of `hat.up`; no direction: a button."""
    hat, _, direction = name.rpartition(".")
    is_hat = hat.partition(".")[0] == "hat" and direction in DIRECTIONS
    return (hat, 2 * DIRECTIONS.index(direction)) if is_hat else (name, None)


def find_profile(identity: Identity, descriptor: Descriptor, profiles: Iterable[Profile]) -> Profile | None:
    """The profile of a device: with its very descriptor, else of its vendor and product where all fields fit."""
    fitting = [profile for profile in profiles if profile.device.is_of(identity) and not misfits(profile, descriptor)]
    exact = (profile for profile in fitting if profile.device.descriptor == identity.descriptor_hash)
    alike = (profile for profile in fitting if _is_alike(profile, descriptor))
    return next(exact, None) or next(alike, None)


def _is_alike(profile: Profile, descriptor: Descriptor) -> bool:
    """The axes have the size that the profile knows: not 10 bits where it has 8."""
    sizes = {field.name: field.maximum - field.minimum for field in descriptor.fields}
    return all(2 * (axis.maximum - axis.minimum) > sizes[axis.field] for axis in profile.axes.values())


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
    """Where one's own profiles are kept (XDG Base Directory Specification)."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    return (FilePath(base) if os.path.isabs(base) else FilePath.home() / ".config") / "artemis" / "profiles"


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
    device = profile.device
    lines = [
        f"name: {profile.name}",
        f"device: {{bus: {device.bus}, vendor: 0x{device.vendor:04x}, product: 0x{device.product:04x}, "
        f'descriptor: "{device.descriptor}"}}',
        f"kind: {profile.kind}",
        f"reports: {profile.reports}",
    ]
    if profile.kind == "stick":
        lines.append(f"gate: {profile.gate}")
    lines += [f"deadzone: {profile.deadzone:g}", "axes:"]
    for role, axis in profile.axes.items():
        keys = axis.model_dump(exclude_none=True, exclude_defaults=True)
        words = ", ".join(f"{key}: {str(value).lower()}" for key, value in keys.items())
        lines.append(f"  {role}: {{{words}}}")
    lines += ["buttons:", *(f"  {role}: {name}" for role, name in profile.buttons.items())]
    return "\n".join(lines) + "\n"
