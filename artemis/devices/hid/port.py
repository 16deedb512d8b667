"""Devices on this computer, and handles on them. The only file that imports hidapi, and only where a device is sought.

Of hidapi's two back ends it is `hidraw`: that of libusb takes the device away from the kernel's own driver, which
switches modes and drives the motors of steering wheels.
"""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias

from artemis.devices.hid.descriptor import MAX_REPORT
from artemis.errors import DeviceLost

_BUSES = {1: "usb", 2: "bluetooth", 3: "i2c", 4: "spi"}
"""By hidapi's numbers (hidapi.h, hid_bus_type)."""

RULES = "/etc/udev/rules.d/70-artemis-input.rules"
"""Before 73, where systemd hands devices to whoever sits at the computer."""

Source: TypeAlias = Literal["hidraw", "evdev"]
"""The interface of the kernel by which a device is read."""

_one_at_a_time = threading.Lock()
"""hidapi keeps the text of the last error in one place for all threads, and frees it when it enumerates, opens or
closes."""


@dataclass(frozen=True, slots=True)
class HidInfo:
    """A device that is plugged in, or paired and near. Words are the device's own, without what cannot be printed."""

    path: str
    """Changes from plug to plug."""
    bus: str
    """`usb`, `bluetooth`, `i2c`, `spi` or `unknown`."""
    vendor: int
    product: int
    serial: str
    """Empty: it has none."""
    name: str
    interface: int
    """Of a USB device with several; else -1."""
    usage: int = 0
    """Of its first top-level collection (page << 16 | id); 0: not known before it is opened."""
    source: Source = "hidraw"

    def __str__(self) -> str:
        serial = f", serial {self.serial}" if self.serial else ""
        return (
            f"{self.name or 'nameless device'} ({self.bus} {self.vendor:04x}:{self.product:04x}{serial}, {self.path})"
        )


class HidHandle(Protocol):
    """An open device. Used by one thread."""

    def descriptor(self) -> bytes:
        """Its raw report descriptor.

        Raises:
            DeviceLost: it cannot be read.
        """

    def read(self, timeout_s: float) -> bytes | None:
        """One report as it came, first its ID if the device uses any; None: nothing within the time [s].

        Raises:
            DeviceLost: the device is gone.
        """

    def close(self) -> None:
        """Give it back; harmless when repeated. Not while another thread reads."""


class HidPort(Protocol):
    """Where devices are found."""

    def enumerate(self) -> list[HidInfo]:
        """All that are there now; none is opened.

        Raises:
            DeviceLost: this computer cannot tell.
        """

    def open(self, info: HidInfo) -> HidHandle:
        """A handle on a device.

        Raises:
            DeviceLost: it is gone, or this user may not open it: then the text has the udev rule that is missing.
        """


class Hidraw:
    """The `HidPort` of the Linux kernel."""

    def enumerate(self) -> list[HidInfo]:
        """All that are there now. Takes milliseconds."""
        with _one_at_a_time:
            found = _hidraw().enumerate()
        infos: dict[str, HidInfo] = {}
        for entry in found:  # one for each top-level collection of a device
            path = os.fsdecode(entry["path"] or b"")
            infos.setdefault(
                path,
                HidInfo(
                    path=path,
                    bus=_BUSES.get(entry["bus_type"], "unknown"),
                    vendor=entry["vendor_id"],
                    product=entry["product_id"],
                    serial=_printable(entry["serial_number"]),
                    name=_printable(entry["product_string"]),
                    interface=entry["interface_number"],
                    usage=entry["usage_page"] << 16 | entry["usage"],
                ),
            )
        infos.pop("", None)  # a device without a node yet
        return list(infos.values())

    def open(self, info: HidInfo) -> _HidrawHandle:
        """A handle on a device; opening a USB device takes 50 ms, in which other threads run."""
        name = str(info)
        try:
            # hidapi says only "open failed", and holds the interpreter while the kernel waits for the first opener
            node = os.open(info.path, os.O_RDWR | os.O_CLOEXEC)
        except PermissionError:
            raise DeviceLost(name, f"no permission to open it; {_advice(info)}") from None
        except OSError as error:
            raise DeviceLost(name, f"is not there ({error.strerror})") from None
        try:
            device = _hidraw().device()
            with _one_at_a_time:
                device.open_path(os.fsencode(info.path))
        except OSError as error:
            raise DeviceLost(name, f"cannot be opened ({error})") from error
        finally:
            os.close(node)
        return _HidrawHandle(name, device)


class _HidrawHandle:
    def __init__(self, name: str, device: Any) -> None:  # noqa: ANN401  hidapi has no types
        self._name, self._device = name, device

    def descriptor(self) -> bytes:
        try:
            return bytes(self._device.get_report_descriptor())
        except (OSError, ValueError) as error:
            raise DeviceLost(self._name, f"does not return its report descriptor ({error})") from error

    def read(self, timeout_s: float) -> bytes | None:
        milliseconds = max(1, round(timeout_s * 1000))  # 0 would wait for ever
        try:
            return bytes(self._device.read(MAX_REPORT + 1, milliseconds)) or None
        except (OSError, ValueError) as error:  # ValueError: it is closed
            raise DeviceLost(self._name, f"is gone ({error}); is it plugged in, has its battery run down?") from error

    def close(self) -> None:
        with _one_at_a_time:
            self._device.close()


def udev_rule(info: HidInfo) -> str:
    """The rule of udev that lets the user at the computer, and the group `input`, open such devices."""
    device = f"*:{info.vendor:04X}:{info.product:04X}.*"
    return f'KERNEL=="hidraw*", KERNELS=="{device}", MODE="0660", GROUP="input", TAG+="uaccess"'


def _advice(info: HidInfo) -> str:
    return f"write {udev_rule(info)} into {RULES}, run `udevadm control --reload`, and plug it in again"


def _hidraw() -> Any:  # noqa: ANN401  hidapi has no types
    try:
        import hidraw
    except ImportError as error:
        raise DeviceLost("HID", f"hidapi has no back end for the Linux kernel here ({error})") from error
    return hidraw


def _printable(text: str) -> str:
    return "".join(character for character in text if character.isprintable()).strip()
