"""An Xbox 360 controller on the kernel's dummy USB controller (FunctionFS), for its own driver xpad."""

from __future__ import annotations

import os
import queue
import struct
import subprocess
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

MODULES = ("dummy_hcd", "libcomposite", "usb_f_fs", "xpad")
GADGETS = Path("/sys/kernel/config/usb_gadget")
_INTERFACE = bytes.fromhex("09 04 00 00 02 ff 5d 01 00")
"""Of a vendor's own class, with the subclass and protocol by which the driver knows such pads."""
_IN, _OUT = bytes.fromhex("07 05 81 03 20 00 04"), bytes.fromhex("07 05 02 03 20 00 08")
_BITS = {
    0x13B: (2, 4),
    0x13A: (2, 5),
    0x13D: (2, 6),
    0x13E: (2, 7),
    0x136: (3, 0),
    0x137: (3, 1),
    0x13C: (3, 2),
    0x130: (3, 4),
    0x131: (3, 5),
    0x133: (3, 6),
    0x134: (3, 7),
}
"""Byte and bit of each button in a packet, by the code that the driver makes of it."""


class XboxPad:
    """Plugged in from its making until `close`."""

    def __init__(self) -> None:
        self.effects: list[bytes] = []
        self.played: list[tuple[int, int]] = []
        """Strengths of both motors that it was told, but for 0."""
        self.lit: list[tuple[int, int]] = []
        """Its driver has no lamps that are switched by events."""
        subprocess.run(["modprobe", "-a", *MODULES], check=True)
        if not GADGETS.is_dir():
            subprocess.run(["mount", "-t", "configfs", "configfs", "/sys/kernel/config"], check=True)
        self._state, self._place = bytearray(20), GADGETS / "pad"
        self._state[1] = 20
        for name, text in {
            "idVendor": "0x045e",
            "idProduct": "0x028e",
            "bcdUSB": "0x0200",
            "strings/0x409/product": "Controller",
            "configs/c.1/MaxPower": "100",
        }.items():
            (self._place / name).parent.mkdir(parents=True, exist_ok=True)
            (self._place / name).write_text(text)
        (self._place / "functions/ffs.pad").mkdir(parents=True)
        (self._place / "configs/c.1/ffs.pad").symlink_to(self._place / "functions/ffs.pad")
        self._folder = Path("/dev/ffs-pad")
        self._folder.mkdir(exist_ok=True)
        subprocess.run(["mount", "-t", "functionfs", "pad", str(self._folder)], check=True)
        self._control = os.open(self._folder / "ep0", os.O_RDWR)
        descriptors = _INTERFACE + _IN + _OUT
        body = struct.pack("<II", 3, 3) + 2 * descriptors
        os.write(self._control, struct.pack("<III", 3, 12 + len(body), 3) + body)
        os.write(self._control, struct.pack("<IIII", 2, 16, 0, 0))
        self._files = [os.open(self._folder / name, os.O_RDWR) for name in ("ep1", "ep2")]
        (controller,) = [name for name in os.listdir("/sys/class/udc") if name.startswith("dummy_udc")]
        (self._place / "UDC").write_text(controller)
        self._packets: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._send, self._listen)]
        for thread in self._threads:
            thread.start()

    def send(self, changes: Mapping[int, int]) -> None:
        """Axes X and Y, and buttons, change, by the codes that the driver makes of them; it turns Y round."""
        for code, value in changes.items():
            if code in _BITS:
                byte, bit = _BITS[code]
                self._state[byte] = self._state[byte] & ~(1 << bit) | value << bit
            else:
                struct.pack_into("<h", self._state, {0: 6, 1: 8}[code], ~value if code == 1 else value)
        self._packets.put(bytes(self._state))

    def close(self) -> None:
        """Unplug it."""
        (self._place / "UDC").write_text("\n")
        self._packets.put(None)
        for thread in self._threads:
            thread.join(10.0)
        for file in (*self._files, self._control):
            os.close(file)
        subprocess.run(["umount", str(self._folder)], check=True)
        (self._place / "configs/c.1/ffs.pad").unlink()
        for name in ("functions/ffs.pad", "configs/c.1", "strings/0x409", "."):
            (self._place / name).rmdir()

    def _send(self) -> None:
        """The host fetches packets only while somebody has the device open."""
        with suppress(OSError):
            while (packet := self._packets.get()) is not None:
                os.write(self._files[0], packet)

    def _listen(self) -> None:
        with suppress(OSError):
            while packet := os.read(self._files[1], 32):
                if packet[:2] == b"\0\x08" and any(packet[3:5]):
                    self.played.append((packet[3], packet[4]))
