"""What a hand may drive with on this computer, by whichever interface of the kernel it is read."""

from __future__ import annotations

from collections.abc import Collection

from artemis.devices.evdev.layout import evdev_layout
from artemis.devices.evdev.port import Evdev
from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.devices.hid.port import HidHandle, HidInfo, HidPort, Hidraw, Source
from artemis.errors import DeviceLost


class InputPorts:
    """The `HidPort` of several interfaces."""

    def __init__(self, sources: Collection[Source] = ("hidraw", "evdev")) -> None:
        """Of these alone."""
        every: dict[Source, HidPort] = {"hidraw": Hidraw(), "evdev": Evdev()}
        self._ports = {source: every[source] for source in every if source in sources}

    def enumerate(self) -> list[HidInfo]:
        """All that are there now.

        Raises:
            DeviceLost: one of the interfaces cannot tell, and the others have nothing.
        """
        found: list[HidInfo] = []
        problem: DeviceLost | None = None
        for port in self._ports.values():
            try:
                found += port.enumerate()
            except DeviceLost as error:
                problem = error
        if problem is not None and not found:
            raise problem
        return found

    def open(self, info: HidInfo) -> HidHandle:
        """A handle on a device, by the interface that shows it."""
        return self._ports[info.source].open(info)


def layout_of(info: HidInfo, raw: bytes) -> Descriptor:
    """What a device's reports contain, by its raw report descriptor or capabilities.

    Raises:
        HidError: they break the rules.
    """
    return evdev_layout(raw) if info.source == "evdev" else parse_descriptor(raw)
