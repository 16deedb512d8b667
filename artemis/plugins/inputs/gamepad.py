"""Joysticks, gamepads and steering wheels, by hidraw or evdev: from a device's reports to an operator's wish."""

from __future__ import annotations

import math
import threading
from functools import partial
from typing import ClassVar

from msgspec.structs import replace

from artemis.config import Config
from artemis.devices.hid.port import HidPort
from artemis.devices.hid.reader import HidReader
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.choosing import ProfileChoice, may_share
from artemis.plugins.inputs.feedback import Feedback, FeltDevices
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import HeldDevice
from artemis.values import OperatorInput, Request

FIND = 3.0
"""A device that was never there is lost after this time [s]: it is looked for once a second."""


class GamepadInput(FeltDevices):
    """The devices of one profile, mostly one, in the hands of an operator."""

    Config: ClassVar[type[Config]] = GamepadConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True
    may_share = staticmethod(may_share)

    def __init__(self, config: GamepadConfig, context: PluginContext, port: HidPort | None = None) -> None:
        """Begin to look for the devices; on `port`, without a thread, if one is given.

        Raises:
            ConfigError: the profile is wrong, or too high a speed.
        """
        self._name, self._wake, self._choice = context.name, context.wake, ProfileChoice(config, context)
        self._device: HeldDevice | None = None
        self._watched: HeldDevice | None = None
        self._begun: float | None = None
        self._heard: float | None = None
        self._stopping, self._lock = False, threading.Lock()
        self._feedback = Feedback(config.rumble, config.wheel_force, self._choice.top_speed, threaded=port is None)
        self._readers: dict[str, HidReader] = {}  # their threads may call back before all are made
        for part in self._choice.parts:
            wants, watch = partial(self._choice.wants, part), partial(self._watch_stop, part)
            self._readers[part] = HidReader(port or self._choice.port, wants, watch, threaded=port is None)

    def read(self, now: float) -> OperatorInput:
        """What was said last, at run time `now` [s]; every press since the last call counts.

        Raises:
            DeviceLost: a device is gone, or has not been found for a while.
        """
        self._begun = now if self._begun is None else self._begun
        reports = [(part, report) for part, reader in self._readers.items() for report in reader.take(now)]
        device = self._device = self._choice.taken_up(self._readers, self._device)
        requests = [] if device is None else device.take(reports, now)
        missing = {part: reader.error for part, reader in self._readers.items() if reader.state != "open"}
        if missing and Request.QUICKSTOP not in requests:  # a stop goes first
            if device is not None or now - self._begun >= FIND:
                reasons = [f"{part}: {error}" if part else error for part, error in missing.items() if error]
                raise DeviceLost(self._name, "; ".join(filter(None, [*reasons, self._choice.foreign])))
        if device is None:
            return OperatorInput(source=self._name, neutral=False)
        self._heard = self._heard if device.news is None else device.news
        age = None if self._heard is None else now - self._heard
        sample = device.sample(now) or OperatorInput(source=self._name, neutral=False, age=age)
        if device.bad:
            sample = replace(sample, axes=(math.nan,))  # out of range: the guard counts such samples (INP-06)
        return replace(sample, requests=tuple(requests))

    def _watch_stop(self, part: str, report: bytes) -> None:
        """In a reader's thread: a stop button that goes down does not wait for the next tick."""
        with self._lock:
            before, self._watched = self._watched, self._choice.taken_up(self._readers, self._watched)
            if self._watched is None:
                return
            was_stopping = self._stopping and before is self._watched
            self._stopping = self._watched.stops(part, report)
            if self._stopping and not was_stopping:
                self._wake()
