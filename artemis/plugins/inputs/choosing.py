"""Which devices are those that a mission means, by which profile, and how they are taken into the hands."""

from __future__ import annotations

import math
from collections.abc import Mapping

from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort, Source
from artemis.devices.hid.reader import HidReader
from artemis.devices.inputs import InputPorts, layout_of
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.controls import Controls, named_fields
from artemis.plugins.inputs.gamepad_config import AUTO, GamepadConfig
from artemis.plugins.inputs.hands import Grip, Hands
from artemis.plugins.inputs.held import HeldDevice
from artemis.plugins.inputs.profiles import (
    Profile,
    ProfileDevice,
    all_profiles,
    find_profile,
    is_part,
    misfits,
    profile_from,
    profile_named,
)


class ProfileChoice:
    """Knows the device when it is plugged in."""

    def __init__(self, config: GamepadConfig, context: PluginContext) -> None:
        """Read the profiles.

        Raises:
            ConfigError: a profile is wrong, or too high a speed.
        """
        self._config, self._setup = config, context
        self.top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        """At full deflection, or full gas [m/s]."""
        self._profiles = _profiles(config, context.name, context.files)
        only = self._profiles[0] if len(self._profiles) == 1 else None
        self.parts: tuple[str, ...] = ("",) if only is None else tuple(only.parts)
        """Names of the devices in the profile; the only one has none."""
        if only is not None and only.devices and config.serial is not None:
            raise ConfigError(f"{context.name}: serial: the profile {only.name} is of several devices; write it there")
        self.foreign = ""
        """Why the last device that was refused is not the one."""

    @property
    def sources(self) -> frozenset[Source]:
        """The interfaces by which the devices may be read."""
        return frozenset(part.source for profile in self._profiles for part in profile.parts.values())

    @property
    def port(self) -> HidPort:
        """Where they are found."""
        return InputPorts(self.sources)

    def wants(self, part: str, info: HidInfo, raw: bytes) -> bool:
        """Whether this is the device, with its raw report descriptor; asked in the reader's thread."""
        if self._config.serial not in (None, info.serial):
            return False
        if self._profile_of(part, info, raw) is not None:
            return True
        identity = Identity.of(info, raw)
        alike = [it for it in self._profiles if part in it.parts and it.parts[part].is_of(identity)]
        reasons = [
            f"profile {profile.name}: {reason}"
            for profile in alike
            for reason in misfits(profile, layout_of(info, raw), part)
        ]
        if self._config.profile == AUTO or alike:
            why = "; ".join(reasons) or "there is no profile for it"
            self.foreign = f"{info}: {why}; teach it: artemis calibrate input"
        return False

    def taken_up(self, readers: Mapping[str, HidReader], device: HeldDevice | None) -> HeldDevice | None:
        """What is held now: `device` as before, or all anew where one was plugged in; None before all have been."""
        generations = tuple(reader.generation for reader in readers.values())
        if len(generations) < len(self.parts) or not all(generations):
            return device
        if device is not None and device.generations == generations:
            return device
        self.foreign = ""
        return self._held(readers)

    def _held(self, readers: Mapping[str, HidReader]) -> HeldDevice:
        """The devices that are open now: others, or the same anew."""
        for part, reader in readers.items():
            profile = None if reader.info is None else self._profile_of(part, reader.info, reader.descriptor)
        assert profile is not None, "a device was opened that was not asked for"
        config, limits = self._config, self._setup.robot.limits
        grip = Grip(
            kind=profile.kind,
            top_speed=self.top_speed,
            steering_limit=math.radians(limits.steering_deg),
            acceleration=limits.acceleration_m_s2,
            deceleration=limits.deceleration_m_s2,
            gate=profile.gate,
            deadzone=profile.deadzone if config.deadzone is None else config.deadzone,
            expo=config.expo,
            band=math.radians(config.hysteresis_deg),
            hard_brake=config.hard_brake,
        )
        infos = {part: (reader.info, reader.descriptor) for part, reader in readers.items()}
        descriptors = {part: layout_of(info, raw) for part, (info, raw) in infos.items() if info is not None}
        fields = [named_fields(part, descriptor) for part, descriptor in descriptors.items()]
        return HeldDevice(
            generations=tuple(reader.generation for reader in readers.values()),
            controls=Controls(profile, {name: field for each in fields for name, field in each.items()}),
            hands=Hands(self._setup.name, grip, config.speed_range),
            parts={part: (profile.parts[part].reports, descriptor) for part, descriptor in descriptors.items()},
            deadman=config.deadman,
        )

    def _profile_of(self, part: str, info: HidInfo, raw: bytes) -> Profile | None:
        identity, descriptor = Identity.of(info, raw), layout_of(info, raw)
        if not part:
            return find_profile(identity, descriptor, self._profiles)
        return next((it for it in self._profiles if is_part(it, part, identity, descriptor)), None)


def may_share(one: GamepadConfig, other: GamepadConfig, files: Mapping[str, bytes]) -> bool:
    """Whether inputs with these keys may read one device: of one product, where no serial numbers tell them apart."""
    try:
        ours, theirs = (
            [part.model_copy(update={"serial": config.serial or part.serial}) for part in _parts(config, files)]
            for config in (one, other)
        )
    except ConfigError:  # told where the input is made
        return False
    return any(part.may_be(another) for part in ours for another in theirs)


def _parts(config: GamepadConfig, files: Mapping[str, bytes]) -> list[ProfileDevice]:
    return [part for profile in _profiles(config, "", files) for part in profile.parts.values()]


def _profiles(config: GamepadConfig, name: str, files: Mapping[str, bytes]) -> tuple[Profile, ...]:
    """Those that the device may have; `name` is the input's.

    Raises:
        ConfigError: a file of them is wrong.
    """
    if config.profile_file is None:  # several devices are meant only where their profile is named
        return (
            tuple(it for it in all_profiles() if not it.devices)
            if config.profile == AUTO
            else (profile_named(config.profile),)
        )
    if config.profile_file not in files:
        raise ConfigError(f"{name}: profile_file: no '{config.profile_file}' among the mission's files")
    return (profile_from(files[config.profile_file], config.profile_file),)
