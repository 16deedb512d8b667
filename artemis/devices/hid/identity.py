"""Who a device is, so that a profile finds it again: the same after every plug and every start of the computer."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

from artemis.devices.hid.port import HidInfo, Source

_DIGITS = 16


@dataclass(frozen=True, slots=True)
class Identity:
    """A kind of device, and with a serial number a single one.

    The descriptor belongs to it because one vendor and product number is sold with different layouts, and because the
    modes of a device differ in it.
    """

    bus: str
    vendor: int
    product: int
    descriptor_hash: str
    """First 16 hexadecimal digits of the SHA-256 of the raw report descriptor, or of the capabilities."""
    serial: str = ""
    """Empty: the device has none, or any of its kind is meant."""
    source: Source = "hidraw"

    @classmethod
    def of(cls, info: HidInfo, descriptor: bytes) -> Identity:
        """That of a device which is there; `descriptor` is raw."""
        digits = sha256(descriptor).hexdigest()[:_DIGITS]
        return cls(info.bus, info.vendor, info.product, digits, info.serial, info.source)
