"""Joysticks, gamepads and steering wheels of the HID class: from a device's reports to an operator's wish."""

from __future__ import annotations

import math
from typing import ClassVar

from msgspec.structs import replace

from artemis.config import Config
from artemis.devices.hid.port import HidPort, Hidraw
from artemis.devices.hid.reader import HidReader
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.choosing import ProfileChoice
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.held import HeldDevice
from artemis.values import OperatorInput, Request

FIND = 3.0
"""A device that was never there is lost after this time [s]: it is looked for once a second."""


class GamepadInput:
    """One device in the hands of an operator."""

    Config: ClassVar[type[Config]] = GamepadConfig
    contract: ClassVar[int] = 1
    live: ClassVar[bool] = True

    def __init__(self, config: GamepadConfig, context: PluginContext, port: HidPort | None = None) -> None:
        """Begin to look for the device; on `port`, without a thread, if one is given.

        Raises:
            ConfigError: the profile is wrong, or too high a speed.
        """
        self._name, self._wake, self._choice = context.name, context.wake, ProfileChoice(config, context)
        self._device: HeldDevice | None = None
        self._watched: HeldDevice | None = None
        self._stopping = False
        self._begun: float | None = None
        self._heard: float | None = None
        self._reader: HidReader | None = None  # its thread may call back before it is made
        self._reader = HidReader(port or Hidraw(), self._choice.wants, self._watch_stop, threaded=port is None)

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
            self._device, self._choice.foreign = self._choice.held(reader), ""
        device = self._device
        requests = [] if device is None else device.take(reports, now)
        if reader.state != "open" and Request.QUICKSTOP not in requests:  # a stop goes first
            if device is not None or now - self._begun >= FIND:
                raise DeviceLost(self._name, "; ".join(text for text in (reader.error, self._choice.foreign) if text))
        if device is None:
            return OperatorInput(source=self._name, neutral=False)
        self._heard = self._heard if device.heard is None else device.heard
        sample = device.sample(now)
        if sample is None:
            age = None if self._heard is None else now - self._heard
            sample = OperatorInput(source=self._name, neutral=False, age=age)
        if device.bad:
            sample = replace(sample, axes=(math.nan,))  # out of range: the guard counts such samples (INP-06)
        return replace(sample, requests=tuple(requests))

    def close(self) -> None:
        """Give the device back; harmless when repeated."""
        if self._reader is not None:
            self._reader.close()

    def _watch_stop(self, report: bytes) -> None:
        """In the reader's thread: a stop button that goes down does not wait for the next tick."""
        reader = self._reader
        if reader is None:
            return
        if self._watched is None or self._watched.generation != reader.generation:
            self._watched, self._stopping = self._choice.held(reader), False
        stopping = self._watched.stops(report)
        if stopping and not self._stopping:
            self._wake()
        self._stopping = stopping
