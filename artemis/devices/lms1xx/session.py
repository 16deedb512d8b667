"""The session with an LMS1xx: connect, log in, configure, start, stream; and again after whatever went wrong."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from math import radians

from artemis.devices.lms1xx.configuration import Configuration, ScanSetting
from artemis.devices.lms1xx.device_clock import DeviceClock
from artemis.devices.lms1xx.dialogue import ColaDialogue
from artemis.devices.lms1xx.telegrams import ScanTelegram, TelegramError, scan_from
from artemis.devices.tcp import Dial
from artemis.errors import DeviceLost, DeviceTimeout
from artemis.scan import Condition, Scan

SILENCE = 0.5
"""No longer than this is between two scans [s]; then the device is configured anew."""
AHEAD = 900_000
"""Where the device looks ahead, in its own angles."""
CONDITIONS = {(0, 0): Condition.WELL, (0, 2): Condition.DIRTY}
"""By the words of the device status; every other one means that it cannot be trusted (0 1 error, 0 5 window dirty)."""


class Session:
    """Sessions with an LMS1xx, one after the other."""

    def __init__(self, name: str, setting: ScanSetting, dial: Dial) -> None:
        """With the scanner `name`, which measures as `setting` says and is reached by `dial`."""
        self._name, self._setting, self._dial = name, setting, dial
        self._place = f"{setting.host}:{setting.port}"
        self._dialogue = ColaDialogue(name, self._place)
        self._device = DeviceClock()
        self._garbled = self._strange = 0
        """Telegrams since the last scan that could not be read; those that could, and are not as they were set."""
        self._shape: tuple[int, ...] = ()
        """Of the session's scans."""
        self._counter: int | None = None

    async def hold(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        """One session, until something goes wrong; `clock` is the run time [s], `give` takes the scans.

        Raises:
            DeviceTimeout, DeviceLost, ProtocolError: the device does not answer, is gone, or answers with garbage.
            NotReady: it has not started yet.
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
        self._dialogue.close()

    async def _hold(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        self._dialogue, self._device = ColaDialogue(self._name, self._place), DeviceClock()
        self._garbled, self._strange, self._counter, self._shape = 0, 0, None, ()
        dialogue, loop = self._dialogue, asyncio.get_running_loop()
        await dialogue.connect(self._dial, self._setting.host, self._setting.port)
        await dialogue.begin()
        configuration = Configuration(dialogue, self._setting)
        await configuration.apply()
        await configuration.start()
        heard = loop.time()
        while True:
            telegram = await self._next(heard)
            if (scan := self._scan_in(telegram, clock())) is not None:
                heard = loop.time()
                give(scan)

    async def _next(self, heard: float) -> bytes:
        """The next telegram, where the last scan came at loop time `heard` [s].

        Raises:
            DeviceTimeout: no scan has come for `SILENCE`, whatever else did.
        """
        patience = heard + SILENCE - asyncio.get_running_loop().time()
        if patience > 0.0:
            try:
                return await self._dialogue.telegram(patience, "no scan")
            except DeviceTimeout:
                pass
        problem = f"no scan within {SILENCE:g} s"
        if self._strange:
            problem = f"{self._strange} telegrams without DIST1, or of another frequency, resolution or range"
            problem += ": does another program configure it?"
        elif unread := self._garbled + self._dialogue.reader.dropped:
            problem += f": {unread} damaged telegrams"
        raise DeviceTimeout(self._name, problem)

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
        if distances is None:
            self._strange += 1
            raise TelegramError("a scan without DIST1")
        if not distances.values or distances.step == 0 or told.frequency == 0:
            raise TelegramError("a scan without distances")
        shape = round(told.frequency, -2), distances.start, distances.step, len(distances.values)
        self._shape = self._shape or shape
        if shape != self._shape:
            self._strange += 1
            raise TelegramError("a scan of another shape")
        beam_time = distances.step / 3_600_000 / (told.frequency / 100)
        last = len(distances.values) // 2 * beam_time
        started = self._device.to_ours(told.started_us, now - last)
        reader = self._dialogue.reader
        garbled, self._garbled, self._strange = self._garbled + reader.dropped, 0, 0
        reader.dropped = 0
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
