"""Input devices made of a report descriptor, through the Linux kernel's /dev/uhid (Documentation/hid/uhid.rst)."""

from __future__ import annotations

import os
import struct
from typing import Self

_DESTROY, _CREATE, _INPUT = 1, 11, 12
_BUS_USB = 0x03
_CREATION = struct.Struct("<I128s64s64sHHIIII4096s")
"""Type, name, phys, uniq, size of the descriptor, bus, vendor, product, version, country, descriptor."""


class UhidDevice:
    """A device that is plugged in from its making until `close`."""

    def __init__(self, name: str, vendor: int, product: int, descriptor: bytes, serial: str = "") -> None:
        self._file = os.open("/dev/uhid", os.O_RDWR | os.O_CLOEXEC)
        words = name.encode(), b"", serial.encode()
        event = _CREATION.pack(_CREATE, *words, len(descriptor), _BUS_USB, vendor, product, 0, 0, descriptor)
        os.write(self._file, event)

    def send(self, report: bytes) -> None:
        """The device reports."""
        os.write(self._file, struct.pack("<IH", _INPUT, len(report)) + report)

    def close(self) -> None:
        """Unplug it."""
        os.write(self._file, struct.pack("<I", _DESTROY))
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
