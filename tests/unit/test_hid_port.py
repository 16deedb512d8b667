"""hidapi's side of the port, played by a module of the same name; and who a device is."""

from __future__ import annotations

import os
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from hid_devices import STICK

from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, Hidraw, udev_rule
from artemis.errors import DeviceLost

INFO = HidInfo("/dev/hidraw3", "bluetooth", 0x054C, 0x0CE6, "a0:b1", "Wireless Controller", -1, 0x10005)


class FakeDevice:
    """What hidapi makes of an opened device: ints in lists, and OSError for everything that fails."""

    def __init__(self, module: FakeHidapi) -> None:
        self._module = module
        self.closed = False

    def open_path(self, path: bytes) -> None:
        if self._module.refuses:
            raise OSError("open failed")
        self._module.calls.append(path)

    def get_report_descriptor(self) -> list[int]:
        if self._module.gone:
            raise OSError("read error")
        return list(STICK)

    def read(self, length: int, milliseconds: int) -> list[int]:
        assert length > 64
        self._module.calls.append(milliseconds)
        if self.closed:
            raise ValueError("not open")
        if self._module.gone:
            raise OSError("read error")
        return self._module.reports.pop(0) if self._module.reports else []

    def close(self) -> None:
        self.closed = True


class FakeHidapi:
    """The module `hidraw`."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []
        self.calls: list[object] = []
        self.reports: list[list[int]] = []
        self.gone = self.refuses = False

    def enumerate(self) -> list[dict[str, Any]]:
        return self.entries

    def device(self) -> FakeDevice:
        return FakeDevice(self)


@pytest.fixture
def hidapi(monkeypatch: pytest.MonkeyPatch) -> FakeHidapi:
    module = FakeHidapi()
    monkeypatch.setitem(sys.modules, "hidraw", module)
    return module


@pytest.fixture
def info(tmp_path: Path) -> HidInfo:
    node = tmp_path / "hidraw0"
    node.touch()
    return HidInfo(str(node), "usb", 0x046D, 0xC29B, "", "G27", 0)


def entry(path: bytes, **more: object) -> dict[str, object]:
    return {
        "path": path,
        "vendor_id": 0x054C,
        "product_id": 0x0CE6,
        "serial_number": "a0:b1",
        "product_string": "Wireless Controller",
        "usage_page": 1,
        "usage": 5,
        "interface_number": -1,
        "bus_type": 2,
        **more,
    }


def test_each_device_is_listed_once_with_its_first_collection(hidapi: FakeHidapi) -> None:
    hidapi.entries = [
        entry(b"/dev/hidraw3"),
        entry(b"/dev/hidraw3", usage=6),
        entry(b"/dev/hidraw4", bus_type=1, interface_number=2, product_string="bad\x1b[2K\nname ", serial_number=""),
        entry(b"/dev/hidraw5", bus_type=9),
        entry(b"/dev/hidraw6", bus_type=3),
        entry(b"/dev/hidraw7", bus_type=4),
        entry(b""),
        {**entry(b""), "path": None},
    ]
    found = Hidraw().enumerate()
    assert found[0] == INFO
    assert [(each.path, each.bus, each.interface) for each in found[1:]] == [
        ("/dev/hidraw4", "usb", 2),
        ("/dev/hidraw5", "unknown", -1),
        ("/dev/hidraw6", "i2c", -1),
        ("/dev/hidraw7", "spi", -1),
    ]
    assert (found[1].name, found[1].serial) == ("bad[2Kname", "")


def test_a_handle_reads_one_report_at_a_time_and_never_waits_for_ever(hidapi: FakeHidapi, info: HidInfo) -> None:
    handle = Hidraw().open(info)
    assert handle.descriptor() == STICK
    hidapi.reports = [[1, 2, 3], [4]]
    assert [handle.read(0.05), handle.read(0.0), handle.read(0.0)] == [b"\x01\x02\x03", b"\x04", None]
    assert hidapi.calls == [os.fsencode(info.path), 50, 1, 1]


def test_a_device_that_is_gone_is_lost(hidapi: FakeHidapi, info: HidInfo) -> None:
    handle = Hidraw().open(info)
    hidapi.gone = True
    with pytest.raises(DeviceLost, match=r"G27 .*: is gone \(read error\)"):
        handle.read(0.05)
    with pytest.raises(DeviceLost, match="does not return its report descriptor"):
        handle.descriptor()
    handle.close()
    with pytest.raises(DeviceLost, match="not open"):
        handle.read(0.05)


def test_opening_tells_missing_from_forbidden(
    hidapi: FakeHidapi, info: HidInfo, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DeviceLost, match=r"is not there \(No such file or directory\)"):
        Hidraw().open(INFO)
    hidapi.refuses = True
    with pytest.raises(DeviceLost, match=r"cannot be opened \(open failed\)"):
        Hidraw().open(info)

    def forbidden(path: str, flags: int) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", forbidden)
    with pytest.raises(DeviceLost) as caught:
        Hidraw().open(info)
    assert "no permission to open it; write" in caught.value.problem
    assert udev_rule(info) in caught.value.problem
    assert "into /etc/udev/rules.d/70-artemis-input.rules, run `udevadm control --reload`" in caught.value.problem


def test_no_descriptor_of_ours_stays_open(hidapi: FakeHidapi, info: HidInfo) -> None:
    before = len(os.listdir("/proc/self/fd"))
    Hidraw().open(info)
    hidapi.refuses = True
    with pytest.raises(DeviceLost):
        Hidraw().open(info)
    assert len(os.listdir("/proc/self/fd")) == before


def test_without_hidapis_back_end_for_linux_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hidraw", None)
    with pytest.raises(DeviceLost, match="HID: hidapi has no back end for the Linux kernel here"):
        Hidraw().enumerate()


def test_the_real_hidapi_can_be_asked() -> None:
    pytest.importorskip("hidraw")
    assert all(found.path for found in Hidraw().enumerate())


def test_the_rule_names_the_device_on_every_bus() -> None:
    expected = 'KERNEL=="hidraw*", KERNELS=="*:054C:0CE6.*", MODE="0660", GROUP="input", TAG+="uaccess"'
    assert udev_rule(INFO) == expected


def test_words_for_people_say_which_device() -> None:
    assert str(INFO) == "Wireless Controller (bluetooth 054c:0ce6, serial a0:b1, /dev/hidraw3)"
    assert HidInfo("/dev/hidraw0", "usb", 1, 2, "", "", 0).usage == 0
    assert str(HidInfo("/dev/hidraw0", "usb", 1, 2, "", "", 0)) == "nameless device (usb 0001:0002, /dev/hidraw0)"


# ---------------------------------------------------------------------------------------------- identity


def test_an_identity_is_the_same_after_another_plug() -> None:
    moved = HidInfo("/dev/hidraw9", "bluetooth", 0x054C, 0x0CE6, "a0:b1", "another name", 1)
    identity = Identity.of(INFO, STICK)
    assert identity == Identity.of(moved, STICK)
    assert identity.descriptor_hash == sha256(STICK).hexdigest()[:16]
    assert len(identity.descriptor_hash) == 16
