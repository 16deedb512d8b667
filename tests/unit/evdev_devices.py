"""Event nodes in memory: described in a folder as by sysfs, opened and read as those of the kernel."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from artemis.devices.evdev.layout import ABS, KEY, SYN, SYN_DROPPED, SYN_REPORT
from artemis.devices.evdev.port import Evdev

STICKS = {code: (-32768, 32767) for code in (0, 1, 3, 4)}
HAT = {0x10: (-1, 1), 0x11: (-1, 1)}
XPAD_KEYS = (0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x13A, 0x13B, 0x13C, 0x13D, 0x13E)
"""A, B, X, Y, TL, TR, SELECT, START, MODE, THUMBL, THUMBR."""


def xpad_axes(triggers: int) -> dict[int, tuple[int, int]]:
    """Of a pad of the driver xpad: two sticks, two triggers up to this count, a hat switch."""
    return {**STICKS, 2: (0, triggers), 5: (0, triggers), **HAT}


class Happened(NamedTuple):
    type: int
    code: int
    value: int


REPORT, DROPPED = Happened(SYN, SYN_REPORT, 0), Happened(SYN, SYN_DROPPED, 0)


@dataclass
class EventDevice:
    """A device, and what of it changes. `change` and `send` make events, `lose` drops them but keeps the state."""

    axes: Mapping[int, tuple[int, int]] = field(default_factory=lambda: xpad_axes(255))
    keys: Collection[int] = XPAD_KEYS
    forces: Collection[int] = ()
    lamps: Collection[int] = ()
    vendor: int = 0x045E
    product: int = 0x028E
    name: str = "Microsoft X-Box 360 pad"
    bus: int = 3
    hidraw: str = ""
    permitted: bool = True
    values: dict[int, int] = field(default_factory=dict)
    down: set[int] = field(default_factory=set)
    nodes: list[OpenEventNode] = field(default_factory=list)

    def change(self, changes: Mapping[int, int]) -> list[Happened]:
        """Codes below 0x100 are axes, others keys; the events of what differs from before."""
        events = []
        for code, value in changes.items():
            if code < 0x100 and self.values.get(code, 0) != value:
                self.values[code] = value
                events.append(Happened(ABS, code, value))
            if code >= 0x100 and (code in self.down) != bool(value):
                (self.down.add if value else self.down.discard)(code)
                events.append(Happened(KEY, code, value))
        return [*events, REPORT] if events else []

    def send(self, changes: Mapping[int, int]) -> None:
        """It changes, and says so."""
        self.happen(self.change(changes))

    def happen(self, events: Iterable[Happened]) -> None:
        for node in self.nodes:
            node.arrive(events)


class OpenEventNode:
    """An `OpenNode` of such a device."""

    def __init__(self, device: EventDevice) -> None:
        self._device, self._events = device, list[Happened]()
        self._end, self._other = os.pipe()
        self.gone = self.closed = False

    def capabilities(self) -> tuple[Mapping[int, tuple[int, int]], Collection[int]]:
        return self._device.axes, self._device.keys

    def state(self) -> tuple[Mapping[int, int], Collection[int]]:
        self._check()
        return {code: self._device.values.get(code, 0) for code in self._device.axes}, set(self._device.down)

    def fileno(self) -> int:
        return self._end

    def read(self) -> Iterable[Happened]:
        self._check()
        os.read(self._end, 4096)
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            os.close(self._end)
            os.close(self._other)
            self._device.nodes.remove(self)

    def arrive(self, events: Iterable[Happened]) -> None:
        self._events += events
        os.write(self._other, b"x")

    def lose(self) -> None:
        self.gone = True
        os.write(self._other, b"x")

    def _check(self) -> None:
        if self.gone:
            raise OSError(19, "No such device")


class FakeEvdev:
    """A computer with event nodes; `port` reads them."""

    def __init__(self, folder: Path) -> None:
        self.sysfs = folder
        self._devices: dict[str, EventDevice] = {}
        self._number = 0
        self.port = Evdev(folder, self.open)

    def plug(self, device: EventDevice) -> str:
        """It is there from now on; its path."""
        place = self.sysfs / "class" / "input" / f"event{self._number}"
        path = f"/dev/input/event{self._number}"
        self._number += 1
        about = place / "device"
        (about / "id").mkdir(parents=True)
        (about / "capabilities").mkdir()
        if device.hidraw:
            (about / "device" / "hidraw" / device.hidraw).mkdir(parents=True)
        words = {
            "name": device.name,
            "uniq": "",
            "id/bustype": f"{device.bus:04x}",
            "id/vendor": f"{device.vendor:04x}",
            "id/product": f"{device.product:04x}",
            "capabilities/key": bitmap(device.keys),
            "capabilities/abs": bitmap(device.axes),
            "capabilities/ff": bitmap(device.forces),
            "capabilities/led": bitmap(device.lamps),
        }
        for name, text in words.items():
            (about / name).write_text(text + "\n")
        self._devices[path] = device
        return path

    def unplug(self, path: str) -> None:
        place = self.sysfs / "class" / "input" / Path(path).name
        place.rename(place.with_name(f"was-{place.name}"))
        for node in self._devices.pop(path).nodes:
            node.lose()

    def open(self, path: str) -> OpenEventNode:
        device = self._devices.get(path)
        if device is None:
            raise FileNotFoundError(2, "No such file or directory")
        if not device.permitted:
            raise PermissionError(13, "Permission denied")
        node = OpenEventNode(device)
        device.nodes.append(node)
        return node


def bitmap(codes: Iterable[int]) -> str:
    """As sysfs writes it: words of 64 bits in hexadecimal, the highest first."""
    value, words = sum(1 << code for code in codes), list[str]()
    while value or not words:
        words.insert(0, f"{value & 0xFFFFFFFFFFFFFFFF:x}")
        value >>= 64
    return " ".join(words)
