"""Which device is the one that a mission means, by which profile, and how it is taken into the hand."""

from __future__ import annotations

import math

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo
from artemis.devices.hid.reader import HidReader
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.controls import Controls
from artemis.plugins.inputs.gamepad_config import AUTO, GamepadConfig
from artemis.plugins.inputs.hands import Grip, Hands
from artemis.plugins.inputs.held import HeldDevice
from artemis.plugins.inputs.profiles import Profile, all_profiles, find_profile, misfits, profile_from, profile_named


class ProfileChoice:
    """Knows the device when it is plugged in."""

    def __init__(self, config: GamepadConfig, context: PluginContext) -> None:
        """Read the profiles.

        Raises:
            ConfigError: a profile is wrong, or too high a speed.
        """
        self._config, self._setup = config, context
        self._top_speed = context.top_speed("max_speed_m_s", config.max_speed_m_s)
        self._profiles = _profiles(config, context)
        self.foreign = ""
        """Why the last device that was refused is not the one."""

    def wants(self, info: HidInfo, raw: bytes) -> bool:
        """Whether this is the device, with its raw report descriptor; asked in the reader's thread."""
        if self._config.serial not in (None, info.serial):
            return False
        if self._profile_of(info, raw) is not None:
            return True
        alike = [profile for profile in self._profiles if profile.device.is_of(Identity.of(info, raw))]
        reasons = [
            f"profile {profile.name}: {reason}"
            for profile in alike
            for reason in misfits(profile, parse_descriptor(raw))
        ]
        if self._config.profile == AUTO or alike:
            why = "; ".join(reasons) or "there is no profile for it"
            self.foreign = f"{info}: {why}; teach it: artemis calibrate input"
        return False

    def held(self, reader: HidReader) -> HeldDevice:
        """The device that is open now: another one, or the same anew."""
        info = reader.info
        profile = None if info is None else self._profile_of(info, reader.descriptor)
        assert profile is not None, "a device was opened that was not asked for"
        config, limits = self._config, self._setup.robot.limits
        grip = Grip(
            kind=profile.kind,
            top_speed=self._top_speed,
            steering_limit=math.radians(limits.steering_deg),
            acceleration=limits.acceleration_m_s2,
            deceleration=limits.deceleration_m_s2,
            gate=profile.gate,
            deadzone=profile.deadzone if config.deadzone is None else config.deadzone,
            expo=config.expo,
            band=math.radians(config.hysteresis_deg),
            hard_brake=config.hard_brake,
        )
        controls = Controls(profile, parse_descriptor(reader.descriptor))
        hands = Hands(self._setup.name, grip, config.speed_range)
        return HeldDevice(reader.generation, controls, hands, profile.reports, config.deadman)

    def _profile_of(self, info: HidInfo, raw: bytes) -> Profile | None:
        return find_profile(Identity.of(info, raw), parse_descriptor(raw), self._profiles)


def _profiles(config: GamepadConfig, context: PluginContext) -> tuple[Profile, ...]:
    """Those that the device may have.

    Raises:
        ConfigError: a file of them is wrong.
    """
    if config.profile_file is None:
        return all_profiles() if config.profile == AUTO else (profile_named(config.profile),)
    if config.profile_file not in context.files:
        raise ConfigError(f"{context.name}: profile_file: no '{config.profile_file}' among the mission's files")
    return (profile_from(context.files[config.profile_file], config.profile_file),)
