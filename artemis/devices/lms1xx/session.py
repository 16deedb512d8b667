"""The session with an LMS1xx: connect, log in, configure, start, stream; and again after whatever went wrong."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from math import radians
from typing import Protocol

from artemis.devices.lms1xx.device_clock import DeviceClock
from artemis.devices.lms1xx.telegrams import (
    ScanTelegram,
    TelegramError,
    TelegramReader,
    framed,
    scan_from,
    signed,
    unsigned,
    words_of,
)
from artemis.devices.tcp import ByteStream, Dial
from artemis.errors import DeviceLost, DeviceTimeout, WrongDevice
from artemis.scan import Condition, Scan

CONNECT_TIME, ANSWER_TIME, START_TIME, SILENCE = 2.0, 1.0, 30.0, 0.5
"""It has so long to take a connection, to answer, to begin to measure, and between two scans [s]."""
ASK_AGAIN = 0.1
"""Between two questions whether it measures yet [s]."""
FIRST_ANGLE, LAST_ANGLE = -450_000, 2_250_000
"""Of the field of view [1/10000 degree], counted from the device's right side."""
AHEAD = 900_000
"""Where the device looks ahead, in its own angles."""
MEASURES = 7
"""Of `STlms`: ready for measurement."""
CONDITIONS = {(0, 0): Condition.WELL, (0, 2): Condition.DIRTY}
"""By the words of the device status; every other one means that it cannot be trusted (0 1 error, 0 5 window dirty)."""


class ScanSetting(Protocol):
    """How a scanner is to measure."""

    @property
    def host(self) -> str:
        """Name or address."""

    @property
    def port(self) -> int:
        """Where it takes connections."""

    @property
    def frequency_hz(self) -> int:
        """Turns per second."""

    @property
    def resolution_deg(self) -> float:
        """From beam to beam."""


class _Refused(WrongDevice):
    """The device does not do what it is asked for."""


class Session:
    """Sessions with an LMS1xx, one after the other."""

    def __init__(self, name: str, setting: ScanSetting, dial: Dial) -> None:
        """With the scanner `name`, which measures as `setting` says and is reached by `dial`."""
        self._name, self._setting, self._dial = name, setting, dial
        self._stream: ByteStream | None = None
        self._reader = TelegramReader()
        self._waiting: list[bytes] = []
        self._device = DeviceClock()
        self._garbled = 0
        self._counter: int | None = None

    async def hold(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        """One session, until something goes wrong; `clock` is the run time [s], `give` takes the scans.

        Raises:
            DeviceTimeout, DeviceLost, ProtocolError: the device does not answer, is gone, or answers with garbage.
            WrongDevice: it refuses what it is asked for.
        """
        try:
            await self._hold(clock, give)
        except OSError as error:
            if isinstance(error, DeviceTimeout | DeviceLost):
                raise
            number = error.errno or 0
            why = os.strerror(number) if number > 0 else error.strerror or str(error)
            raise DeviceLost(self._name, f"{self._place}: {why}") from error
        finally:
            self.close()

    def close(self) -> None:
        """End the connection; harmless when repeated."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    @property
    def _place(self) -> str:
        return f"{self._setting.host}:{self._setting.port}"

    async def _hold(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        self._reader, self._waiting, self._device = TelegramReader(), [], DeviceClock()
        self._garbled, self._counter = 0, None
        try:
            async with asyncio.timeout(CONNECT_TIME):
                self._stream = await self._dial(self._setting.host, self._setting.port)
        except TimeoutError:
            raise DeviceTimeout(self._name, f"{self._place}: no connection within {CONNECT_TIME:g} s") from None
        await self._configure()
        await self._start()
        while True:
            telegram = await self._telegram(SILENCE, "no scan")
            if (scan := self._scan_in(telegram, clock())) is not None:
                give(scan)

    # ---------------------------------------------------------------------------------------------- configuration

    async def _configure(self) -> None:
        """Have the device measure as the setting says; nothing of that is kept when its power goes."""
        frequency, resolution = round(self._setting.frequency_hz * 100), round(self._setting.resolution_deg * 10_000)
        await self._expect("sMN SetAccessMode 03 F4724744", "sAN SetAccessMode 1")
        await self._expect("sMN LMCstopmeas", "sAN LMCstopmeas 0")
        sector = f"+{resolution} {FIRST_ANGLE:+} {LAST_ANGLE:+}"
        answer = await self._ask(f"sMN mLMPsetscancfg +{frequency} +1 {sector}")
        if (code := unsigned(_word(answer, 2), 8)) != 0:
            wanted = f"{self._setting.frequency_hz:g} Hz and {self._setting.resolution_deg:g} degrees"
            raise _Refused(self._name, f"does not measure with {wanted}: {_NO_SETTING.get(code, f'error {code}')}")
        await self._expect("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 0 +1", "sWA LMDscandatacfg")
        await self._expect(f"sWN LMPoutputRange 1 {sector}", "sWA LMPoutputRange")
        answer = await self._ask("sRN LMPscancfg")
        found = signed(_word(answer, 2), 32), signed(_word(answer, 4), 32)
        if found != (frequency, resolution):
            raise _Refused(
                self._name,
                f"says that it measures with {found[0] / 100:g} Hz and {found[1] / 10_000:g} degrees, not with "
                f"{self._setting.frequency_hz:g} Hz and {self._setting.resolution_deg:g} degrees",
            )

    async def _start(self) -> None:
        await self._expect("sMN LMCstartmeas", "sAN LMCstartmeas 0")
        await self._expect("sMN Run", "sAN Run 1")
        loop = asyncio.get_running_loop()
        end = loop.time() + START_TIME
        while (state := unsigned(_word(await self._ask("sRN STlms"), 2), 8)) != MEASURES:
            if loop.time() >= end:
                raise DeviceTimeout(self._name, f"does not begin to measure within {START_TIME:g} s (state {state})")
            await asyncio.sleep(ASK_AGAIN)
        await self._expect("sEN LMDscandata 1", "sEA LMDscandata 1")

    async def _expect(self, request: str, answer: str) -> None:
        found = await self._ask(request)
        if found != answer.encode().split():
            told = b" ".join(found).decode()[:60]
            raise _Refused(self._name, f"answers {told} to {request}{_access(request)}; {answer} was expected")

    async def _ask(self, request: str) -> list[bytes]:
        """Words of the answer to a request; what comes between is no answer."""
        assert self._stream is not None
        self._stream.write(framed(request))
        name = request.split()[1].encode()
        loop = asyncio.get_running_loop()
        end = loop.time() + ANSWER_TIME
        while True:
            words = words_of(await self._telegram(end - loop.time(), f"no answer to {request}"))
            if words[0] == b"sFA":
                code = words[1].decode() if len(words) > 1 else "?"
                why = _ERRORS.get(code, "error")
                raise _Refused(self._name, f"refuses {request}{_access(request)}: {why} (sFA {code})")
            if words[1:2] == [name] and words[0] in (b"sRA", b"sWA", b"sAN", b"sEA"):
                return words

    # ---------------------------------------------------------------------------------------------- what comes

    async def _telegram(self, patience: float, problem: str) -> bytes:
        """The next telegram.

        Raises:
            DeviceTimeout: none within `patience` [s].
            DeviceLost: the device has closed the connection.
        """
        stream = self._stream
        assert stream is not None
        try:
            async with asyncio.timeout(patience):
                while not self._waiting:
                    data = await stream.read()
                    if not data:
                        raise DeviceLost(self._name, "has closed the connection")
                    self._waiting = self._reader.feed(data)
        except TimeoutError:
            raise DeviceTimeout(self._name, f"{problem} within {patience:.2g} s") from None
        return self._waiting.pop(0)

    def _scan_in(self, telegram: bytes, now: float) -> Scan | None:
        """The scan in a telegram that came at run time `now` [s]; garbage is counted, and late answers mean nothing."""
        if telegram.startswith((b"sRA ", b"sWA ", b"sAN ", b"sEA ", b"sFA ")):
            return None
        try:
            return self._scan(scan_from(telegram), now)
        except TelegramError:
            self._garbled += 1
            return None

    def _scan(self, told: ScanTelegram, now: float) -> Scan:
        distances, strengths = told.channel("DIST1"), told.channel("RSSI1")
        if distances is None or not distances.values or distances.step == 0 or told.frequency == 0:
            raise TelegramError("a scan without distances")
        beam_time = distances.step / 3_600_000 / (told.frequency / 100)
        last = len(distances.values) // 2 * beam_time
        started = self._device.to_ours(told.started_us, now - last)
        garbled, self._garbled = self._garbled + self._reader.dropped, 0
        self._reader.dropped = 0
        return Scan(
            source=self._name,
            time=started,
            beam_time=beam_time,
            start_angle=radians((distances.start - AHEAD) / 10_000),
            increment=radians(distances.step / 10_000),
            ranges=distances.millimetres(),
            intensities=strengths.meant() if strengths is not None else b"",
            counter=self._counted(told.scan_counter),
            status=told.status[0] << 8 | told.status[1],
            condition=CONDITIONS.get(told.status, Condition.FAULTY),
            garbled=garbled,
        )

    def _counted(self, counter: int) -> int:
        """The device's counter, which has 16 bits, without its turns."""
        self._counter = counter if self._counter is None else self._counter + (counter - self._counter) % (1 << 16)
        return self._counter


_NO_SETTING = {1: "it has no such frequency", 2: "it has no such resolution", 3: "it has neither", 4: "no such sector"}
_ERRORS = {
    "1": "access denied",
    "2": "it knows no such method",
    "3": "it knows no such variable",
    "4": "not now",
    "5": "invalid data",
    "A": "the variable cannot be written",
    "D": "busy",
}
"""By code of `sFA` (sick_scan_xd, SopasBase.cpp)."""


def _word(answer: list[bytes], number: int) -> bytes:
    if number >= len(answer):
        raise TelegramError(f"too short an answer: {b' '.join(answer)[:60].decode()}")
    return answer[number]


def _access(request: str) -> str:
    """A hint where the password may be another one than the device was made with."""
    return " (was its password changed?)" if "SetAccessMode" in request else ""
