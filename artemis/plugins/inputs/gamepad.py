"""Joysticks, gamepads and steering wheels of the HID class, read by their profiles."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator

from artemis.config import Config
from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort, Hidraw
from artemis.devices.hid.reader import HidReader
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import Setup
from artemis.plugins.inputs.controls import Controls
from artemis.plugins.inputs.hands import Grip, Hands, top_speed
from artemis.plugins.inputs.held import HeldDevice
from artemis.plugins.inputs.profiles import (
    Profile,
    all_profiles,
    find_profile,
    misfits,
    profile_from,
    profile_named,
)
from artemis.plugins.inputs.wheel import HARD_BRAKE
from artemis.values import OperatorInput, Request

AUTO = "auto"
FIND = 3.0
"""A device that was never there is lost after this time [s]: it is looked for once a second."""


def _check_known(name: str) -> str:
    try:
        _ = all_profiles() if name == AUTO else profile_named(name)
    except ConfigError as error:
        raise ValueError(str(error)) from None
    return name


class GamepadConfig(Config):
    """Keys of an input with `plugin: gamepad`."""

    profile: Annotated[str, Field(pattern=r"^[a-z0-9-]{1,64}$"), AfterValidator(_check_known)] = AUTO
    """Which device: the name of a profile; auto: the one that is plugged in, if there is a profile for it."""
    profile_file: str | None = None
    """A profile beside the mission instead."""
    serial: str | None = None
    """Serial number, where several such devices are plugged in."""
    max_speed_m_s: Annotated[float, Field(gt=0)] | None = None
    """Speed at full deflection, or full gas; None: the robot's limit."""
    speed_range: Annotated[float, Field(ge=0.2, le=1)] = 1.0
    """Share of it to begin with; the buttons faster and slower change it by 0.1."""
    deadzone: Annotated[float, Field(ge=0, le=0.5)] | None = None
    """Share of the way that counts as released; None: the profile's."""
    expo: Annotated[float, Field(ge=0, le=1)] = 0.0
    """How much finer a stick's deflection, or a wheel's angle, is around the centre."""
    hysteresis_deg: Annotated[float, Field(ge=0, le=20)] = 1.0
    """The angle trails the wished one by at most this much; 5 in the thesis."""
    hard_brake: Annotated[float, Field(gt=0, le=1)] = HARD_BRAKE
    """A brake pedal pressed this far asks for a quick stop."""
    deadman: bool = True
    """The robot drives only while the enable button is held. False: whenever the controls are not released."""

    @model_validator(mode="after")
    def _one_profile(self) -> Self:
        if self.profile != AUTO and self.profile_file is not None:
            raise ValueError("profile and profile_file name one each; leave one out")
        return self


class GamepadInput:
    """One device in the hands of an operator."""

    Config: ClassVar[type[Config]] = GamepadConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True

    def __init__(self, config: GamepadConfig, setup: Setup, port: HidPort | None = None) -> None:
        """Begin to look for the device; on `port`, without a thread, if one is given.

        Raises:
            ConfigError: the profile is wrong, or too high a speed.
        """
        self._config, self._setup, self._name = config, setup, setup.name
        self._top_speed = top_speed(config.max_speed_m_s, setup)
        self._profiles = _profiles(config, setup)
        self._device: HeldDevice | None = None
        self._watched: HeldDevice | None = None
        self._stopping = False
        self._foreign = ""
        self._begun: float | None = None
        self._heard: float | None = None
        self._reader: HidReader | None = None  # its thread may call back before it is made
        self._reader = HidReader(port or Hidraw(), self._wants, self._watch_stop, threaded=port is None)

    def read(self, now: float) -> OperatorInput:
        """What the device said last, at run time `now` [s]; every press since the last call counts.

        Raises:
            DeviceLost: it is gone, or has not been found for a while.
        """
        reader = self._reader
        assert reader is not None
        self._begun = now if self._begun is None else self._begun
        reports = reader.take(now)
        if reader.generation and (self._device is None or self._device.generation != reader.generation):
            self._device, self._foreign = self._opened(reader), ""
        device = self._device
        requests = [] if device is None else device.take(reports, now)
        if reader.state != "open" and Request.QUICKSTOP not in requests:  # a stop goes first
            if device is not None or now - self._begun >= FIND:
                raise DeviceLost(self._name, "; ".join(text for text in (reader.error, self._foreign) if text))
        if device is None:
            return OperatorInput(source=self._name, neutral=False)
        self._heard = self._heard if device.heard is None else device.heard
        sample = device.sample(now)
        if sample is None:
            age = None if self._heard is None else now - self._heard
            sample = OperatorInput(source=self._name, neutral=False, age=age)
        if device.bad:
            sample = replace(sample, axes=(math.nan,))  # out of range: the border counts such samples (INP-06)
        return replace(sample, requests=tuple(requests))

    def close(self) -> None:
        """Give the device back; harmless when repeated."""
        if self._reader is not None:
            self._reader.close()

    def _wants(self, info: HidInfo, raw: bytes) -> bool:
        """Whether this is the device; asked in the reader's thread."""
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
            self._foreign = f"{info}: {why}; teach it: artemis calibrate input"
        return False

    def _profile_of(self, info: HidInfo, raw: bytes) -> Profile | None:
        return find_profile(Identity.of(info, raw), parse_descriptor(raw), self._profiles)

    def _opened(self, reader: HidReader) -> HeldDevice:
        """The device that is open now: another one, or the same anew."""
        info = reader.info
        profile = None if info is None else self._profile_of(info, reader.descriptor)
        assert profile is not None, "a device was opened that nobody wanted"
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
        hands = Hands(self._name, grip, config.speed_range)
        return HeldDevice(reader.generation, controls, hands, profile.reports, config.deadman)

    def _watch_stop(self, report: bytes) -> None:
        """In the reader's thread: a stop button that goes down does not wait for the next tick."""
        reader = self._reader
        if reader is None:
            return
        if self._watched is None or self._watched.generation != reader.generation:
            self._watched, self._stopping = self._opened(reader), False
        stopping = self._watched.stops(report)
        if stopping and not self._stopping:
            self._setup.wake()
        self._stopping = stopping


def _profiles(config: GamepadConfig, setup: Setup) -> tuple[Profile, ...]:
    """Those that the device may have.

    Raises:
        ConfigError: a file of them is wrong.
    """
    if config.profile_file is None:
        return all_profiles() if config.profile == AUTO else (profile_named(config.profile),)
    if config.profile_file not in setup.files:
        raise ConfigError(f"{setup.name}: profile_file: no '{config.profile_file}' among the mission's files")
    return (profile_from(setup.files[config.profile_file], config.profile_file),)
