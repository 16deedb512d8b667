"""What a mission may say of an input with `plugin: gamepad`."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.inputs.profiles import all_profiles, profile_named
from artemis.plugins.inputs.wheel import HARD_BRAKE
from artemis.vehicle import WishedSpeed

AUTO = "auto"


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
    max_speed_m_s: WishedSpeed | None = None
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

    rumble: bool = True
    """A device that can do so rumbles for a moment when the robot stops by itself, or is stopped."""
    wheel_force: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Share of a wheel's force by which it centres itself at `max_speed_m_s`, less at lower speeds, and by which it is
    shaken for a moment when the robot stops; 0: neither."""

    @model_validator(mode="after")
    def _one_profile(self) -> Self:
        if self.profile != AUTO and self.profile_file is not None:
            raise ValueError("profile and profile_file name one each; leave one out")
        return self
