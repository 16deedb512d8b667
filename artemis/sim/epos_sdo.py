"""The SDO server of a simulated EPOS: expedited and segmented transfers, one at a time (CiA 301 7.2.4)."""

from __future__ import annotations

from dataclasses import dataclass

from artemis.sim.dictionary import AbortCode, AccessRefused, Dictionary

FRAME_LENGTH = 8
SEGMENT_LENGTH = 7
EXPEDITED_LENGTH = 4
LONGEST_WRITE = 64
"""No writable object of the drive is longer; a segmented write beyond it is cut off."""

# Client command specifiers, bits 7 to 5.
DOWNLOAD_SEGMENT, DOWNLOAD, UPLOAD, UPLOAD_SEGMENT, ABORT = 0, 1, 2, 3, 4
TOGGLE = 0x10
LAST = 0x01


@dataclass(slots=True, kw_only=True)
class _Transfer:
    index: int
    sub: int
    upload: bool
    data: bytes
    """Still to be sent (upload) or received so far (download)."""
    toggle: int = 0
    length: int | None = None
    """Announced total of a download."""


class SdoServer:
    """Answers request frames from a dictionary."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._dictionary = dictionary
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Forget a transfer that is under way."""
        self._transfer = None

    def answer(self, request: bytes) -> bytes | None:
        """The 8 data bytes of the answer to a request; None where nothing is answered (aborts, damaged requests)."""
        if len(request) != FRAME_LENGTH:
            return None
        specifier = request[0] >> 5
        if specifier == ABORT:
            self._transfer = None
            return None
        try:
            if specifier == UPLOAD:
                return self._begin_upload(request)
            if specifier == DOWNLOAD:
                return self._begin_download(request)
            if specifier == UPLOAD_SEGMENT:
                return self._next_upload(request)
            if specifier == DOWNLOAD_SEGMENT:
                return self._next_download(request)
            raise AccessRefused(AbortCode.COMMAND_SPECIFIER)
        except AccessRefused as abort:
            return self._refuse(request, abort.code)

    def _refuse(self, request: bytes, code: int) -> bytes:
        transfer, self._transfer = self._transfer, None
        if request[0] >> 5 in (DOWNLOAD_SEGMENT, UPLOAD_SEGMENT):  # segments do not name their object
            place = b"\0\0\0" if transfer is None else transfer.index.to_bytes(2, "little") + bytes((transfer.sub,))
        else:
            place = request[1:4]
        return b"\x80" + place + code.to_bytes(4, "little")

    def _begin_upload(self, request: bytes) -> bytes:
        self._transfer = None
        index, sub = request[1] | request[2] << 8, request[3]
        data = self._dictionary.upload(index, sub)
        if len(data) <= EXPEDITED_LENGTH:
            unused = EXPEDITED_LENGTH - len(data)
            return bytes((0x43 | unused << 2,)) + request[1:4] + data + bytes(unused)
        self._transfer = _Transfer(index=index, sub=sub, upload=True, data=data)
        return b"\x41" + request[1:4] + len(data).to_bytes(4, "little")

    def _begin_download(self, request: bytes) -> bytes:
        self._transfer = None
        index, sub, command = request[1] | request[2] << 8, request[3], request[0]
        length_told = bool(command & 0x01)
        if command & 0x02:
            length = EXPEDITED_LENGTH - (command >> 2 & 3) if length_told else EXPEDITED_LENGTH
            self._dictionary.download(index, sub, request[4 : 4 + length], length_told=length_told)
        else:
            if self._dictionary.find(index, sub).access in ("ro", "const"):
                raise AccessRefused(AbortCode.READ_ONLY)
            length_total = int.from_bytes(request[4:8], "little") if length_told else None
            self._transfer = _Transfer(index=index, sub=sub, upload=False, data=b"", length=length_total)
        return b"\x60" + request[1:4] + bytes(4)

    def _running(self, request: bytes, *, upload: bool) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.upload is not upload:
            raise AccessRefused(AbortCode.COMMAND_SPECIFIER)
        if request[0] & TOGGLE != transfer.toggle:
            raise AccessRefused(AbortCode.TOGGLE_BIT)
        return transfer

    def _next_upload(self, request: bytes) -> bytes:
        transfer = self._running(request, upload=True)
        segment, transfer.data = transfer.data[:SEGMENT_LENGTH], transfer.data[SEGMENT_LENGTH:]
        unused = SEGMENT_LENGTH - len(segment)
        last = not transfer.data
        command = transfer.toggle | unused << 1 | (LAST if last else 0)
        transfer.toggle ^= TOGGLE
        if last:
            self._transfer = None
        return bytes((command,)) + segment + bytes(unused)

    def _next_download(self, request: bytes) -> bytes:
        transfer = self._running(request, upload=False)
        command = request[0]
        transfer.data += request[1 : FRAME_LENGTH - (command >> 1 & 7)]
        answer = bytes((0x20 | transfer.toggle,)) + bytes(7)
        transfer.toggle ^= TOGGLE
        if len(transfer.data) > LONGEST_WRITE:
            raise AccessRefused(AbortCode.TOO_LONG)
        if command & LAST:
            if transfer.length is not None and transfer.length != len(transfer.data):
                raise AccessRefused(AbortCode.WRONG_LENGTH)
            self._dictionary.download(transfer.index, transfer.sub, transfer.data)
            self._transfer = None
        return answer
