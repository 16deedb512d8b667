"""A conversation with an LMS1xx by CoLa A: a connection, requests and their answers, and the telegrams between them.

`sFA` and a code refuse a request; the codes are those of SopasBase.cpp in SICKAG/sick_scan_xd.
"""

from __future__ import annotations

import asyncio
from typing import Final

from artemis.devices.lms1xx.telegrams import TelegramError, TelegramReader, framed, unsigned, words_of
from artemis.devices.tcp import ByteStream, Dial
from artemis.errors import DeviceError, DeviceLost, DeviceTimeout, WrongDevice

CONNECT_TIME, ANSWER_TIME = 2.0, 1.0
"""It has so long to take a connection, and to answer [s]."""
_NOT_NOW: Final = ("4", "D")
"""Codes of `sFA` for what may be possible later."""
_UNKNOWN: Final = ("2", "3", "C")
"""For what the device does not have, or does not have yet."""
_STARTS: Final = (0, 1, 2)
_MEASURING: Final = (b"LMCstartmeas", b"LMCstopmeas")
"""Methods whose answer 1 means that they are not possible now."""
_UNREADY: Final = {0: "undefined", 1: "initialises", 2: "is configured", 4: "spins up", 5: "prepares", 6: "is ready"}
"""By state, as `STlms` tells it: what the device is about before it measures (7). In 3 it is idle, which may last."""
_ERRORS: Final = {
    "1": "access denied",
    "2": "it knows no such method",
    "3": "it knows no such variable",
    "4": "not now",
    "5": "invalid data",
    "A": "the variable cannot be written",
    "C": "it knows no such command",
    "D": "busy",
}
"""By code of `sFA`."""


class ScannerRefused(WrongDevice):
    """The device does not do what it is asked for."""


class NotReady(DeviceError):
    """The device does not do yet what it is asked for."""


class Unknown(ScannerRefused):
    """The device knows no such variable or method."""


class ColaDialogue:
    """One connection."""

    def __init__(self, name: str, place: str) -> None:
        """With the scanner `name` at `place`, host and port as messages say them."""
        self.name, self.place = name, place
        self.state: int | None = None
        """As the device told it when the conversation began; None: not asked yet."""
        self.patient_until = 0.0
        """Until then, on the loop's time [s], it may leave requests unanswered: they are repeated."""
        self.reader = TelegramReader()
        self._waiting: list[bytes] = []
        self._stream: ByteStream | None = None

    async def connect(self, dial: Dial, host: str, port: int) -> None:
        """Open the connection.

        Raises:
            DeviceTimeout: it is not taken within `CONNECT_TIME`.
            OSError: it is refused, or there is no way to the device.
        """
        try:
            async with asyncio.timeout(CONNECT_TIME):
                self._stream = await dial(host, port)
        except TimeoutError:
            raise DeviceTimeout(self.name, f"{self.place}: no connection within {CONNECT_TIME:g} s") from None

    def close(self) -> None:
        """End the connection; harmless when repeated."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    async def begin(self) -> None:
        """Ask for the device's state, which it tells to everybody who speaks CoLa A.

        Raises:
            DeviceTimeout: it takes connections, but does not answer.
            ScannerRefused: it speaks CoLa B.
        """
        try:
            answer = await self.ask("sRN STlms")
        except DeviceTimeout:
            raise DeviceTimeout(
                self.name,
                f"{self.place}: it takes connections but does not answer in CoLa A: wait until it has started, or set "
                "CoLa ASCII in SOPAS",
            ) from None
        self.state = state_in(answer)

    async def expect(self, request: str, answer: str) -> None:
        """Have a request answered so.

        Raises:
            NotReady, ScannerRefused: it is not, and as `ask`.
        """
        found = await self.ask(request)
        if found == answer.encode().split():
            return
        told = b" ".join(found).decode()[:60]
        problem = f"answers {told} to {request}{_access(request)}; {answer} was expected"
        raise self._refusal(problem, later=found[1] in _MEASURING and found[2:] == [b"1"])

    async def ask(self, request: str) -> list[bytes]:
        """Words of the answer to a request; what comes between is no answer.

        Raises:
            NotReady, Unknown, ScannerRefused: the device refuses.
            DeviceTimeout: it does not answer within `ANSWER_TIME`, or until `patient_until`.
            DeviceLost: it closed the connection.
        """
        while True:
            try:
                return await self._ask(request)
            except DeviceTimeout:
                if asyncio.get_running_loop().time() >= self.patient_until:
                    raise

    async def _ask(self, request: str) -> list[bytes]:
        assert self._stream is not None
        self._stream.write(framed(request))
        name = request.split()[1].encode()
        loop = asyncio.get_running_loop()
        end = loop.time() + ANSWER_TIME
        while True:
            words = words_of(await self.telegram(end - loop.time(), f"no answer to {request}"))
            if words[0] == b"sFA":
                code = words[1].decode() if len(words) > 1 else "?"
                problem = f"refuses {request}{_access(request)}: {_ERRORS.get(code, 'error')} (sFA {code})"
                if code in _UNKNOWN and self.state not in _STARTS:
                    raise Unknown(self.name, problem)
                raise self._refusal(problem, later=code in _NOT_NOW)
            if words[1:2] == [name] and words[0] in (b"sRA", b"sWA", b"sAN", b"sEA"):
                return words

    def _refusal(self, problem: str, *, later: bool) -> DeviceError:
        """What it does not do now, but may do `later`, or once it has started."""
        about = _UNREADY.get(self.state) if self.state is not None else None
        if later or about:
            state = f" (state {self.state}: {about})" if about else ""
            return NotReady(self.name, f"is not ready yet{state}: {problem}")
        return ScannerRefused(self.name, problem)

    async def telegram(self, patience: float, problem: str) -> bytes:
        """The next telegram.

        Raises:
            DeviceTimeout: none within `patience` [s].
            DeviceLost: the device has closed the connection.
            ScannerRefused: what it sends is CoLa B.
        """
        stream = self._stream
        assert stream is not None
        try:
            async with asyncio.timeout(patience):
                while not self._waiting:
                    data = await stream.read()
                    if not data:
                        raise DeviceLost(self.name, "has closed the connection")
                    self._waiting = self.reader.feed(data)
                    if self.reader.is_binary:
                        raise ScannerRefused(self.name, f"{self.place}: it answers in CoLa B: set CoLa ASCII in SOPAS")
        except TimeoutError:
            raise DeviceTimeout(self.name, f"{problem} within {patience:.2g} s") from None
        return self._waiting.pop(0)


def word(answer: list[bytes], number: int) -> bytes:
    """A word of an answer, counted from 0.

    Raises:
        TelegramError: it has fewer.
    """
    if number >= len(answer):
        raise TelegramError(f"too short an answer: {b' '.join(answer)[:60].decode()}")
    return answer[number]


def state_in(answer: list[bytes]) -> int:
    """The state of the device in an answer to `sRN STlms`.

    Raises:
        TelegramError: there is none.
    """
    return unsigned(word(answer, 2), 8)


def _access(request: str) -> str:
    """A hint where the password may be another one than the device was made with."""
    return " (was its password changed?)" if "SetAccessMode" in request else ""
