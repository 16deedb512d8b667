"""HID devices in memory: a port on which tests plug devices in and out and have them send, with or without a thread."""

from __future__ import annotations

import threading
from collections import deque

from artemis.devices.hid.port import HidInfo, udev_rule
from artemis.errors import DeviceLost


class FakeHid:
    """A `HidPort` whose devices do what the test says. Methods of any thread; nothing takes time but waiting reads."""

    def __init__(self) -> None:
        self._devices: dict[str, _Device] = {}

    def plug(self, info: HidInfo, descriptor: bytes, *, permitted: bool = True) -> None:
        """A device is there from now on, at its path; a frozen one is thawed. `permitted`: this user may open it."""
        self._devices[info.path] = _Device(info, descriptor, permitted)

    def unplug(self, info: HidInfo | None = None) -> None:
        """It is gone, and so is what it has sent and nobody has read. None: the only device."""
        device = self._device(info)
        del self._devices[device.info.path]
        for handle in list(device.handles):  # whoever reads may close it meanwhile
            handle.lose()

    def send(self, report: bytes, info: HidInfo | None = None) -> None:
        """The device sends to whoever has it open; a frozen one keeps silent. None: the only device."""
        device = self._device(info)
        if not device.frozen:
            for handle in list(device.handles):
                handle.arrive(report)

    def freeze(self, info: HidInfo | None = None) -> None:
        """From now on it is there and sends nothing, until it is plugged again. None: the only device."""
        self._device(info).frozen = True

    def is_open(self, info: HidInfo | None = None) -> bool:
        """Whether somebody has it open. None: the only device."""
        return bool(self._device(info).handles)

    def enumerate(self) -> list[HidInfo]:
        """All that are plugged in, in the order in which they were."""
        return [device.info for device in list(self._devices.values())]

    def open(self, info: HidInfo) -> FakeHandle:
        """A handle on a device.

        Raises:
            DeviceLost: it is gone, or not permitted.
        """
        device = self._devices.get(info.path)
        if device is None:
            raise DeviceLost(str(info), "is not there")
        if not device.permitted:
            raise DeviceLost(str(info), f"no permission to open it; write {udev_rule(info)}")
        handle = FakeHandle(device)
        device.handles.append(handle)
        return handle

    def _device(self, info: HidInfo | None) -> _Device:
        if info is not None:
            return self._devices[info.path]
        (device,) = self._devices.values()
        return device


class _Device:
    """A device that is plugged in."""

    def __init__(self, info: HidInfo, descriptor: bytes, permitted: bool) -> None:
        self.info, self.descriptor, self.permitted = info, descriptor, permitted
        self.frozen = False
        self.handles: list[FakeHandle] = []


class FakeHandle:
    """A `HidHandle` on such a device."""

    def __init__(self, device: _Device) -> None:
        self._device = device
        self._reports: deque[bytes] = deque()
        self._lost = False
        self._reading = False
        self._changed = threading.Condition()

    def descriptor(self) -> bytes:
        """Its raw report descriptor."""
        return self._device.descriptor

    def read(self, timeout_s: float) -> bytes | None:
        """One report; None: nothing within the time [s]; at 0 nobody waits.

        Raises:
            DeviceLost: unplugged, or closed.
        """
        with self._changed:
            self._reading = True
            self._changed.wait_for(lambda: self._lost or self._reports, timeout_s)
            self._reading = False
            if self._lost:
                raise DeviceLost(str(self._device.info), "is gone")
            return self._reports.popleft() if self._reports else None

    def close(self) -> None:
        """Give it back; harmless when repeated.

        Raises:
            AssertionError: another thread reads: a real handle could not bear it.
        """
        with self._changed:
            assert not self._reading, f"{self._device.info} is closed while it is read"
            self._lost = True
        if self in self._device.handles:
            self._device.handles.remove(self)

    def arrive(self, report: bytes) -> None:
        """The device has sent."""
        with self._changed:
            self._reports.append(report)
            self._changed.notify_all()

    def lose(self) -> None:
        """The device is gone."""
        with self._changed:
            self._lost = True
            self._changed.notify_all()
