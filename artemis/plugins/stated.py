"""What plugins and their keys state beside their contract, as artemis reads it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from artemis.errors import ConfigError, PluginError
from artemis.plugins.contracts import (
    AllowsRequests,
    ChoosesDevice,
    HasOwnProcess,
    LimitsAge,
    LimitsFollower,
    LimitsInput,
    NamesEnable,
    NeedsRealTime,
    OpensNothing,
)


def is_live(plugin: object) -> bool:
    """Whether a plugin, or its class, needs real time."""
    return isinstance(plugin, NeedsRealTime) and plugin.live


def has_own_process(plugin: object) -> bool:
    """Whether an observer's class wants a process of its own."""
    return isinstance(plugin, HasOwnProcess) and plugin.own_process


STALE, OLDEST = 0.15, 1.0
"""A sample of an input counts until it is so old [s], where its class states no other limit: then the device is
frozen or gone, and the robot stops (INP-03). And the largest limit."""


def stale_limit(plugin: object) -> float:
    """How old samples of an input may be [s], by its class.

    Raises:
        ConfigError: the class states what cannot be.
    """
    limit = plugin.stale_s if isinstance(plugin, LimitsAge) else STALE
    if not isinstance(limit, int | float) or isinstance(limit, bool) or not 0.0 < limit <= OLDEST:
        raise ConfigError(f"{plugin!r}: stale_s is {limit!r}; expected more than 0, at most {OLDEST:g} s")
    return limit


def enable_of(plugin: object, config: object) -> str:
    """What is held to drive by an input with these keys."""
    for stated in (config, plugin):
        if isinstance(stated, NamesEnable):
            return stated.enable
    return "the enable button"


def allowed(config: object) -> tuple[str, ...]:
    """What others may ask for over an input with these keys."""
    return config.allow if isinstance(config, AllowsRequests) else ()


def is_pure(plugin: object) -> bool:
    """Whether a plugin's class may be tried before the run."""
    return isinstance(plugin, OpensNothing) and plugin.pure


def may_share_device(plugin: object, one: object, other: object, files: Mapping[str, bytes]) -> bool:
    """Whether two inputs of the class `plugin`, with these keys, may read one device; equal keys mean the same one."""
    if not is_live(plugin):
        return False
    return plugin.may_share(one, other, files) if isinstance(plugin, ChoosesDevice) else one == other


def input_speed(config: object) -> float | None:
    """The speed [m/s] that the keys of an input state; None: none. Raises PluginError: it is no number."""
    return _number(config, config.max_speed_m_s) if isinstance(config, LimitsInput) else None


def follower_speed(config: object) -> float | None:
    """The speed [m/s] that a follower's or behaviour's keys state; None: none. Raises PluginError: it is no number."""
    return _number(config, config.speed_m_s) if isinstance(config, LimitsFollower) else None


@runtime_checkable
class RoundsCorners(Protocol):
    """A follower whose class wants sharp corners rounded (`motion.rounding`) where a tick need not wait for it."""

    rounds_corners: bool


def rounds_corners(plugin: object) -> bool:
    """Whether the routes of a follower are rounded before it gets them, by its class."""
    return isinstance(plugin, RoundsCorners) and plugin.rounds_corners


@runtime_checkable
class NamesMap(Protocol):
    """Keys of a localizer that name the map on which it finds the robot: its YAML file, from the mission's folder."""

    map: str


@runtime_checkable
class StatesField(Protocol):
    """A scanner whose class states in which sector it measures: from, to in its frame [degrees], left positive."""

    field_deg: tuple[float, float]


def field_of(plugin: object) -> tuple[float, float]:
    """The sector in which a scanner measures, by its class [degrees]; where that states none, all around."""
    return plugin.field_deg if isinstance(plugin, StatesField) else (-180.0, 180.0)


@runtime_checkable
class StatesLeastRange(Protocol):
    """A scanner whose class states what it measures at least: nearer things it does not see [m]."""

    least_range_m: float


def least_range_of(plugin: object) -> float:
    """What a scanner measures at least, by its class [m]; where that states nothing, 0."""
    return plugin.least_range_m if isinstance(plugin, StatesLeastRange) else 0.0


@runtime_checkable
class NamesAddress(Protocol):
    """Keys of a scanner that name the address of its device, which no other scanner of the same plugin has."""

    address: str


def address_of(config: object) -> str | None:
    """The address of a scanner with these keys; None: they name none."""
    return config.address if isinstance(config, NamesAddress) else None


def _number(config: object, speed: object) -> float | None:
    if speed is None or (isinstance(speed, int | float) and not isinstance(speed, bool)):
        return speed
    raise PluginError(f"{type(config).__name__} states the speed {speed!r:.40}: artemis needs a number [m/s], or None")
