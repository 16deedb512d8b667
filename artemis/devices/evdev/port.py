"""Handles on event nodes. The only file that imports evdev, and only where a node is read: it is an extra."""

from __future__ import annotations

import fcntl
import select
import struct
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from artemis.build import install
from artemis.devices.evdev.layout import ABS, KEY, InputEvent, Reports, capabilities
from artemis.devices.evdev.nodes import SYSFS, hidden_controls, opening
from artemis.devices.hid.port import HidInfo
from artemis.errors import DeviceLost

_KEY_BYTES = 0x300 // 8
_GET_KEYS, _GET_ABS, _ABS_INFO = 0x80004518 | _KEY_BYTES << 16, 0x80184540, "@6i"
"""EVIOCGKEY, EVIOCGABS of axis 0 (linux/input.h); value, minimum, maximum, fuzz, flat, resolution."""


class OpenNode(Protocol):
    """An open event node. Whatever is asked of one that is gone raises OSError."""

    def capabilities(self) -> tuple[Mapping[int, tuple[int, int]], Collection[int]]:
        """Minimum and maximum of each axis, and the keys, by their codes."""

    def state(self) -> tuple[Mapping[int, int], Collection[int]]:
        """Value of each axis, and the keys that are down."""

    def fileno(self) -> int:
        """What becomes readable when there are events."""

    def read(self) -> Iterable[InputEvent]:
        """Events that wait; raises BlockingIOError where there are none."""

    def close(self) -> None:
        """Give it back; harmless when repeated."""


class Evdev:
    """The `HidPort` of what hidraw does not show."""

    def __init__(self, sysfs: Path = SYSFS, open_node: Callable[[str], OpenNode] | None = None) -> None:
        """`open_node` opens one by its path, by another means than the package evdev."""
        self._sysfs, self._open_node = sysfs, open_node

    def enumerate(self) -> list[HidInfo]:
        """All that are there now."""
        return hidden_controls(self._sysfs)

    def open(self, info: HidInfo) -> _EvdevHandle:
        """A handle on a device.

        Raises:
            DeviceLost: the extra is missing, this user may not open it, or it is gone.
        """
        name = str(info)
        try:
            with opening(info):
                return _EvdevHandle(name, (self._open_node or _InputDevice)(info.path))
        except ImportError as error:
            raise DeviceLost(
                name, f"is read by the extra evdev, which is missing ({error}): {install('evdev')}"
            ) from error


def is_installed() -> bool:
    """Whether the extra is."""
    return find_spec("evdev") is not None


class _InputDevice:
    """The `OpenNode` of the package evdev."""

    def __init__(self, path: str) -> None:
        import evdev

        self._device: Any = evdev.InputDevice(path)
        found: dict[int, Any] = self._device.capabilities()
        self._ranges = {code: (info.min, info.max) for code, info in found.get(ABS, [])}
        self._keys: list[int] = found.get(KEY, [])

    def capabilities(self) -> tuple[Mapping[int, tuple[int, int]], Collection[int]]:
        return self._ranges, self._keys

    def state(self) -> tuple[Mapping[int, int], Collection[int]]:
        """Not by the package: it holds the interpreter while the kernel waits for an effect that is uploaded."""
        down = int.from_bytes(fcntl.ioctl(self._device.fd, _GET_KEYS, bytes(_KEY_BYTES)), "little")
        empty = bytes(struct.calcsize(_ABS_INFO))
        values = {code: fcntl.ioctl(self._device.fd, _GET_ABS + code, empty) for code in self._ranges}
        return (
            {code: struct.unpack(_ABS_INFO, data)[0] for code, data in values.items()},
            [code for code in self._keys if down >> code & 1],
        )

    def fileno(self) -> int:
        return int(self._device.fd)

    def read(self) -> Iterable[InputEvent]:
        events: Iterable[InputEvent] = self._device.read()
        return events

    def close(self) -> None:
        self._device.close()


class _EvdevHandle:
    """The `HidHandle` of an event node."""

    def __init__(self, name: str, node: OpenNode) -> None:
        self._name, self._node = name, node
        self._waiting: deque[bytes] = deque()
        try:
            self._raw = capabilities(*node.capabilities())
            self._reports = Reports(self._raw, node.state)
        except OSError:
            node.close()
            raise

    def descriptor(self) -> bytes:
        """Its capabilities."""
        return self._raw

    def read(self, timeout_s: float) -> bytes | None:
        try:
            if not self._waiting and select.select([self._node.fileno()], [], [], timeout_s)[0]:
                self._waiting.extend(self._reports.take(self._node.read()))
        except BlockingIOError:
            pass
        except (OSError, ValueError) as error:  # ValueError: it is closed
            raise DeviceLost(self._name, f"is gone ({error}); is it plugged in, has its battery run down?") from error
        return self._waiting.popleft() if self._waiting else None

    def close(self) -> None:
        self._node.close()
