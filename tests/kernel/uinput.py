"""Input devices made of codes, through the kernel's /dev/uinput (linux/uinput.h), with motors that keep effects."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import threading
from collections.abc import Collection, Mapping

_CREATE, _DESTROY = 0x5501, 0x5502
_SETUP, _ABS_SETUP = 0x405C5503, 0x401C5504
_SET_TYPE, _SET_KEY, _SET_ABS, _SET_LAMP, _SET_FORCE = 0x40045564, 0x40045565, 0x40045567, 0x40045569, 0x4004556B
_SYN, _KEY, _ABS, _LAMP, _FF, _UINPUT = 0x00, 0x01, 0x03, 0x11, 0x15, 0x101
_UPLOAD, _ERASE = 1, 2
_EVENT = struct.Struct("@llHHi")
_EFFECT = 48
"""Bytes of a `struct ff_effect`, on machines of 64 bits."""
_REQUEST = struct.Struct("@Ii")
"""Begins what an upload, or an erasure, is about: its number, and what to answer."""
_BEGIN_UPLOAD, _END_UPLOAD = 0xC06855C8, 0x406855C9
_BEGIN_ERASE, _END_ERASE = 0xC00C55CA, 0x400C55CB


class UinputDevice:
    """A device that is plugged in from its making until `close`."""

    def __init__(
        self,
        name: str,
        vendor: int,
        product: int,
        axes: Mapping[int, tuple[int, int]],
        keys: Collection[int],
        forces: Collection[int] = (),
        lamps: Collection[int] = (),
    ) -> None:
        self.effects: list[bytes] = []
        """Every one that was uploaded, in order."""
        self.played: list[tuple[int, int]] = []
        """Code and value of each event for the motors."""
        self.lit: list[tuple[int, int]] = []
        """Of each for the lamps."""
        self._file = os.open("/dev/uinput", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        kinds = (_KEY, _SET_KEY, keys), (_ABS, _SET_ABS, axes), (_FF, _SET_FORCE, forces), (_LAMP, _SET_LAMP, lamps)
        for kind, request, codes in kinds:
            if codes:
                fcntl.ioctl(self._file, _SET_TYPE, kind)
            for code in codes:
                fcntl.ioctl(self._file, request, code)
        for code, (minimum, maximum) in axes.items():
            fcntl.ioctl(self._file, _ABS_SETUP, struct.pack("@H2x6i", code, 0, minimum, maximum, 0, 0, 0))
        setup = struct.pack("@4H80sI", 0x03, vendor, product, 1, name.encode(), 16 if forces else 0)
        fcntl.ioctl(self._file, _SETUP, setup)
        fcntl.ioctl(self._file, _CREATE)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()

    def send(self, changes: Mapping[int, int]) -> None:
        """Axes and keys change, at once; codes from 0x100 on are keys."""
        events = [_EVENT.pack(0, 0, _KEY if code >= 0x100 else _ABS, code, value) for code, value in changes.items()]
        os.write(self._file, b"".join([*events, _EVENT.pack(0, 0, _SYN, 0, 0)]))

    def close(self) -> None:
        """Unplug it."""
        self._closed.set()
        self._thread.join()
        fcntl.ioctl(self._file, _DESTROY)
        os.close(self._file)

    def _answer(self) -> None:
        """The kernel waits for a device's answer to each upload."""
        while not self._closed.is_set():
            if not select.select([self._file], [], [], 0.05)[0]:
                continue
            _, _, kind, code, value = _EVENT.unpack(os.read(self._file, _EVENT.size))
            if kind in (_FF, _LAMP):
                (self.played if kind == _FF else self.lit).append((code, value))
            elif (kind, code) == (_UINPUT, _UPLOAD):
                request = bytearray(_REQUEST.size + 2 * _EFFECT)
                _REQUEST.pack_into(request, 0, value, 0)
                fcntl.ioctl(self._file, _BEGIN_UPLOAD, request)
                self.effects.append(bytes(request[_REQUEST.size : _REQUEST.size + _EFFECT]))
                fcntl.ioctl(self._file, _END_UPLOAD, bytes(request))
            elif (kind, code) == (_UINPUT, _ERASE):
                erasure = bytearray(struct.pack("@IiI", value, 0, 0))
                fcntl.ioctl(self._file, _BEGIN_ERASE, erasure)
                fcntl.ioctl(self._file, _END_ERASE, bytes(erasure))
