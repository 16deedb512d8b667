"""Motors of an input device: rumble, a force that centres, and one that shakes (Linux, Documentation/input/ff.rst).

And its lamps, which are switched by events (EV_LED). An effect is a `struct ff_effect` (linux/input.h), uploaded into
the device and played by an event.
"""

from __future__ import annotations

import fcntl
import os
import struct
from typing import Protocol

from artemis.devices.evdev.nodes import (
    AUTOCENTER,
    CONSTANT,
    PERIODIC,
    RUMBLE,
    SPRING,
    motors_of,
    opening,
)
from artemis.devices.hid.port import HidInfo

FORCE, LAMP = 0x15, 0x11
"""EV_FF, EV_LED."""
_UPLOAD, _EVENT = 0x40004580, "@llHHi"
"""EVIOCSFF, without the size of what follows; `struct input_event`."""
_HEAD, _LONGEST = "@HhHHHHH0P", "@HHhhH4HIP"
"""Kind, id, direction, trigger's button and interval, length and delay [ms], 0: for ever; the longest of what may
follow: waveform, period, magnitude, offset, phase, envelope, samples."""
_SINE = 0x5A
_LEFT, _RIGHT = 0x4000, 0xC000
_NEW = -1
"""The id of an effect that is not uploaded yet."""
HUM, HUM_STRENGTH = 300, 0x8000
"""Rumble takes so long [ms], at half of what the motors can do."""
BEAT, BEATS = 60, 4
"""A wheel is shaken by so many pushes to alternate sides, each so long [ms]."""


class MotorNode(Protocol):
    """An event node, open for effects. Whatever is asked of one that is gone raises OSError."""

    def upload(self, effect: bytes) -> int:
        """Put a `struct ff_effect` into the device, a new one where its id is -1; its id."""

    def write(self, kind: int, code: int, value: int) -> None:
        """Send it an event."""

    def close(self) -> None:
        """Give it back."""


class _OpenNode:
    """The `MotorNode` of the kernel: by calls that let other threads run while a device takes its time."""

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)

    def upload(self, effect: bytes) -> int:
        data = bytearray(effect)
        fcntl.ioctl(self._file, _UPLOAD | len(data) << 16, data)
        id: int = struct.unpack_from(_HEAD, data)[1]
        return id

    def write(self, kind: int, code: int, value: int) -> None:
        os.write(self._file, struct.pack(_EVENT, 0, 0, kind, code, value))

    def close(self) -> None:
        os.close(self._file)


class Motors:
    """Those of one device. Every method may wait for the device: not for the thread of the ticks."""

    def __init__(self, node: MotorNode, forces: frozenset[int], lamps: frozenset[int] = frozenset()) -> None:
        """`forces`: codes of what the device can do; `lamps`: of those that it has."""
        self._node, self._forces, self._lamps = node, forces, lamps
        self._ids: dict[str, int] = {}

    @property
    def rumbles(self) -> bool:
        """It has something to hum with."""
        return RUMBLE in self._forces

    @property
    def centres(self) -> bool:
        """It has a force that turns it to its middle."""
        return bool(self._forces & {SPRING, AUTOCENTER})

    @property
    def shakes(self) -> bool:
        """It has a force to shake it with."""
        return bool(self._forces & {PERIODIC, CONSTANT})

    def light(self, on: bool) -> None:
        """Switch all its lamps.

        Raises:
            OSError: the device does not take it.
        """
        for lamp in sorted(self._lamps):
            self._node.write(LAMP, lamp, int(on))

    def rumble(self) -> None:
        """Hum for a moment.

        Raises:
            OSError: the device does not take it.
        """
        self._play("rumble", RUMBLE, struct.pack("@HH", HUM_STRENGTH, HUM_STRENGTH), length=HUM)

    def shake(self, strength: float) -> None:
        """Push to and fro for a moment, with a share of its force in [0, 1].

        Raises:
            OSError: the device does not take it.
        """
        level = round(strength * 0x7FFF)
        if PERIODIC in self._forces:
            wave = struct.pack("@HHhhH4H", _SINE, 2 * BEAT, level, 0, 0, 0, 0, 0, 0)
            self._play("shake", PERIODIC, wave, direction=_LEFT, length=BEAT * BEATS)
            return
        for beat in range(BEATS):
            direction, push = _RIGHT if beat % 2 else _LEFT, struct.pack("@h4H", level, 0, 0, 0, 0)
            self._play(f"push {beat}", CONSTANT, push, direction=direction, length=BEAT, delay=BEAT * beat)

    def centre(self, force: float) -> None:
        """Turn it to its middle from now on, with a share of its force in [0, 1].

        A spring ends with the process, whatever ends it; FF_AUTOCENTER is only for devices without one.

        Raises:
            OSError: the device does not take it.
        """
        if SPRING in self._forces:
            most, slope = round(force * 0xFFFF), round(force * 0x7FFF)
            self._play("spring", SPRING, struct.pack("@HHhhHh", most, most, slope, slope, 0, 0), direction=_LEFT)
        else:
            self._node.write(FORCE, AUTOCENTER, round(force * 0xFFFF))

    def close(self) -> None:
        """Give it back; the kernel takes its effects out."""
        self._node.close()

    def _play(self, name: str, kind: int, body: bytes, *, direction: int = 0, length: int = 0, delay: int = 0) -> None:
        """Upload an effect anew, in the place of its last one, and begin it."""
        head = struct.pack(_HEAD, kind, self._ids.get(name, _NEW), direction, 0, 0, length, delay)
        self._ids[name] = self._node.upload(head + body.ljust(struct.calcsize(_LONGEST), b"\0"))
        self._node.write(FORCE, self._ids[name], 1)


def find_motors(info: HidInfo) -> Motors | None:
    """Motors and lamps of a device, by whichever interface it is read; None: it has none.

    Raises:
        DeviceLost: this user may not open its event node, or it is gone.
    """
    node = motors_of(info)
    if node is None:
        return None
    with opening(node.info):
        return Motors(_OpenNode(node.info.path), node.forces, node.lamps)
