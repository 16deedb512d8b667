"""A simulated LMS100: what it answers by CoLa A, its states, its clock, and the scans that it sends.

It is bytes in and bytes out on the running loop's time: the same device is reached in process (`dial`), or over TCP
(`artemis.sim.lms100_server`).
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from math import radians
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from artemis.devices.lms1xx.telegrams import (
    END,
    START,
    TelegramError,
    TelegramReader,
    framed,
    signed,
    unsigned,
    words_of,
)

Floats = NDArray[np.float64]
PAIRS = {(2500, 2500), (2500, 5000), (5000, 5000)}
"""Frequency [1/100 Hz] and resolution [1/10000 degree] that go together."""
FREQUENCIES, RESOLUTIONS = {2500, 5000}, {2500, 5000}
FIRST, LAST, AHEAD, ROUND = -450_000, 2_250_000, 900_000, 3_600_000
"""Angles [1/10000 degree]: of its field of view, where it looks ahead, once around."""
SPIN_UP, GET_READY = 10.0, 0.3
"""Until it measures after another frequency was set, and after it was started [s]."""
TRANSFER = 1e-3
"""From the last beam of a scan to its telegram, and from a request to its answer [s]; an assumption."""
INITIALISES, IDLE, ROTATES, PREPARES, MEASURES = 1, 3, 4, 5, 7
SERIAL = 0x89A27F
_CODES = {
    "later": "sFA 4",
    "access": "sFA 1",
    "method": "sFA 2",
    "variable": "sFA 3",
    "data": "sFA 5",
    "write": "sFA A",
}


class Optics(Protocol):
    """Measures: distances [mm], 0: no return, of beams at loop times [s] into angles [rad] from the x axis."""

    def __call__(self, times: Floats, angles: Floats) -> NDArray[np.uint16]:
        """In the order of the beams."""


class ClientLine:
    """The device's end of one connection."""

    def __init__(self, device: Lms100, send: Callable[[bytes], None], hang_up: Callable[[], None]) -> None:
        self._device, self.send, self.hang_up = device, send, hang_up
        self._reader = TelegramReader()
        self.authorised = self.streams = False

    def receive(self, data: bytes) -> None:
        """Take bytes of the client; answers go to `send`."""
        for telegram in self._reader.feed(data):
            if not self._device.is_unresponsive:
                self.send(framed(self._device.answer(telegram, self)))


class Lms100:
    """The device, powered on and measuring as it was made: 50 turns a second, every half degree."""

    def __init__(self, look: Optics, *, drift: float = 0.0, first_us: int = 0) -> None:
        """`drift`: of its clock against ours, as a share; `first_us`: what that shows now."""
        self._look, self._loop = look, asyncio.get_running_loop()
        self._begun = self._loop.time()
        self._drift, self.first_us = drift, first_us
        self.frequency, self.resolution = 5000, 5000
        self._sector = FIRST, LAST
        self._interval, self._remission, self._content = 1, 0, "DIST1"
        self.filters: dict[str, tuple[int, ...]] = {"FREchoFilter": (0,), "LFPmeanfilter": (0, 2, 0)}
        """Values of the filters that it has; which ones an LMS100 has depends on its firmware."""
        self._measuring_from, self._spinning_from = self._begun, self._begun
        self._started = True
        self._lines: list[ClientLine] = []
        self._timer: asyncio.TimerHandle | None = None
        self._telegrams = 0
        self.first_turn = 0
        """What it counted at first."""
        self._last = ""
        self.status = (0, 0)
        """Of the device, as it tells it: 0 1 error, 0 2 window nearly too dirty, 0 5 window too dirty."""
        self.spin_up = SPIN_UP
        self.answers_always = True
        """Also while its motor changes its speed; SICK says that there may be no answer then."""
        self._started_from = self._begun
        self.plugged_in = True
        self.silent = self.frozen = False
        """It sends no scans; or the same one again and again."""
        self.delay = 0.0
        """Its telegrams arrive so much later [s]."""
        self.piece = 0
        """In process a client reads at most so many bytes at once; 0: all."""
        self.garble: Callable[[bytes], bytes] = lambda telegram: telegram
        """What becomes of a scan's telegram on its way; empty: it is lost."""

    # ---------------------------------------------------------------------------------------------- connections

    def connect(self, send: Callable[[bytes], None], hang_up: Callable[[], None]) -> ClientLine:
        """A client connects: `send` takes bytes for it, `hang_up` ends the connection.

        Raises:
            ConnectionRefusedError: the device is unplugged.
        """
        if not self.plugged_in:
            raise ConnectionRefusedError(111, "Connection refused")
        self._lines.append(line := ClientLine(self, send, hang_up))
        return line

    def leave(self, line: ClientLine) -> None:
        """The client is gone; harmless when repeated."""
        if line in self._lines:
            self._lines.remove(line)

    async def dial(self, host: str, port: int) -> SimStream:
        """Connect in process, whatever the address."""
        await asyncio.sleep(TRANSFER)
        return SimStream(self)

    def unplug(self) -> None:
        """Cut every connection, and take no other."""
        self.plugged_in = False
        for line in list(self._lines):
            line.hang_up()
        self._lines.clear()

    def restart(self, seconds: float) -> None:
        """Power it off and on: it is as it was made, takes connections at once, but starts for so long [s]."""
        self.unplug()
        self.plugged_in = True
        now = self._loop.time()
        self.frequency, self.resolution, self._sector = 5000, 5000, (FIRST, LAST)
        self._interval, self._remission, self._content = 1, 0, "DIST1"
        self._started = True
        self._started_from = self._spinning_from = now + seconds
        self._measuring_from = self._started_from + GET_READY

    # ---------------------------------------------------------------------------------------------- answers

    @property
    def is_unresponsive(self) -> bool:
        """It answers nothing."""
        return not self.answers_always and self._loop.time() < self._spinning_from

    @property
    def state(self) -> int:
        """As `STlms` tells it."""
        now = self._loop.time()
        if now < self._started_from:
            return INITIALISES
        if now < self._spinning_from:
            return ROTATES
        if not self._started:
            return IDLE
        return MEASURES if now >= self._measuring_from else PREPARES

    def answer(self, telegram: bytes, line: ClientLine) -> str:
        """To a request on a line."""
        try:
            words = words_of(telegram)
            kind, name = words[0].decode(), words[1].decode() if len(words) > 1 else ""
            return self._answer(kind, name, words[2:], line)
        except (TelegramError, IndexError):
            return _CODES["data"]

    def _answer(self, kind: str, name: str, rest: list[bytes], line: ClientLine) -> str:
        match kind, name:
            case "sMN", "SetAccessMode":
                line.authorised = rest == [b"03", b"F4724744"]
                return f"sAN SetAccessMode {int(line.authorised)}"
            case "sRN", _:
                return self._read(name)
            case "sEN", "LMDscandata":
                line.streams = unsigned(rest[0], 8) != 0
                self._arm()
                return f"sEA LMDscandata {int(line.streams)}"
            case "sMN", "Run":
                line.authorised = False
                self._start()
                return "sAN Run 1"
            case "sMN", "LMCstopmeas" if self.state == INITIALISES:
                return "sAN LMCstopmeas 1"
            case "sMN", _ if name in _METHODS:
                return self._method(name, rest) if line.authorised else _CODES["access"]
            case "sWN", _ if name in ("LMDscandatacfg", "LMPoutputRange", *self.filters):
                return self._write(name, rest) if line.authorised else _CODES["write"]
            case "sMN", _:
                return _CODES["method"]
        return _CODES["variable"]

    def _read(self, name: str) -> str:
        match name:
            case "STlms":
                return f"sRA STlms {self.state} 0 8 00:00:00 8 01.01.00 0 0 0"
            case "LMPscancfg":
                return f"sRA LMPscancfg {self._configuration()}"
            case "LMPoutputRange":
                first, last = self._sector
                return f"sRA LMPoutputRange 1 {self.resolution:X} {first & 0xFFFFFFFF:X} {last & 0xFFFFFFFF:X}"
            case "LMDscandata":
                return self._scan("sRA", self._turn(self._loop.time()))
            case _ if name in self.filters:
                return f"sRA {name} {' '.join([f'{value:X}' for value in self.filters[name]])}"
        return _CODES["variable"]

    def _configuration(self) -> str:
        return f"{self.frequency:X} 1 {self.resolution:X} {FIRST & 0xFFFFFFFF:X} {LAST:X}"

    def _method(self, name: str, rest: list[bytes]) -> str:
        if self.state == INITIALISES:
            return _CODES["later"]
        if name == "mLMPsetscancfg":
            return f"sAN mLMPsetscancfg {self._configure(rest)} {self._configuration()}"
        if name == "mEEwriteall":
            return "sAN mEEwriteall 1"
        if name == "LMCstartmeas":
            self._start()
        else:
            self._started = False
        return f"sAN {name} 0"

    def _start(self) -> None:
        if not self._started:
            self._started = True
            self._measuring_from = max(self._loop.time(), self._spinning_from) + GET_READY
            self._arm()

    def _configure(self, rest: list[bytes]) -> int:
        """The code that tells whether frequency, resolution and sector are possible, and were taken over."""
        frequency, resolution = signed(rest[0], 32), signed(rest[2], 32)
        start, stop = signed(rest[3], 32), signed(rest[4], 32)
        if (frequency, resolution) not in PAIRS:
            return (frequency not in FREQUENCIES) + 2 * (resolution not in RESOLUTIONS or frequency in FREQUENCIES)
        if not FIRST <= start < stop <= LAST:
            return 4
        if frequency != self.frequency:
            self._spinning_from = self._loop.time() + self.spin_up
            self._measuring_from = self._spinning_from + GET_READY
        self.frequency, self.resolution = frequency, resolution
        return 0

    def _write(self, name: str, rest: list[bytes]) -> str:
        if self.state == INITIALISES:
            return _CODES["later"]
        if name in self.filters:
            if len(rest) != len(self.filters[name]):
                return _CODES["data"]
            self.filters[name] = tuple(unsigned(word, 16) for word in rest)
        elif name == "LMPoutputRange":
            start, stop = signed(rest[2], 32), signed(rest[3], 32)
            if not FIRST <= start < stop <= LAST:
                return _CODES["data"]
            self._sector = start, stop
        else:
            self._content = "DIST2" if unsigned(rest[0], 8) == 2 else "DIST1"
            self._remission = unsigned(rest[2], 8) and (16 if unsigned(rest[3], 8) else 8)
            self._interval = max(1, signed(rest[-1], 32))
        return f"sWA {name}"

    # ---------------------------------------------------------------------------------------------- scans

    def clock_us(self, time: float) -> int:
        """What its clock shows at a loop time [s]."""
        return (self.first_us + round((time - self._begun) * (1.0 + self._drift) * 1e6)) & 0xFFFFFFFF

    def _turn(self, now: float) -> int:
        """Number of the last turn whose scan is complete at loop time `now` [s]."""
        return int((now - self._begun) * self.frequency / 100 - 0.75)

    def _arm(self) -> None:
        """Send the next scan when it is complete, if anybody wants it."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._started and any(line.streams for line in self._lines):
            now = self._loop.time()
            turn = max(self._turn(now), self._turn(self._measuring_from)) + 1
            end = self._begun + (turn + 0.75) * 100 / self.frequency
            self._timer = self._loop.call_at(end + TRANSFER, self._send, turn)

    def _send(self, turn: int) -> None:
        self._timer = None
        if turn % self._interval == 0 and not self.silent:
            text = self._last if self.frozen and self._last else self._scan("sSN", turn)
            telegram = self.garble(text.encode())
            data = START + telegram + END if telegram else b""
            for line in list(self._lines):
                if line.streams and self.delay:
                    self._loop.call_later(self.delay, line.send, data)
                elif line.streams:
                    line.send(data)
        self._arm()

    def _scan(self, kind: str, turn: int) -> str:
        """The telegram with the scan of a turn."""
        step, (first, last) = self.resolution, self._sector
        begun = self._begun + turn * 100 / self.frequency
        beams = (LAST - FIRST) // step + 1
        k = np.arange(beams, dtype=np.float64)
        times = begun + k * (step / ROUND * 100 / self.frequency)
        angles = k * radians(step / 10_000) + radians((FIRST - AHEAD) / 10_000)
        distances = self._look(times, angles)[(first - FIRST) // step : (last - FIRST) // step + 1].tolist()
        self._telegrams = (self._telegrams + 1) & 0xFFFF
        sent = self.clock_us(begun + 75 / self.frequency)
        counter = (self.first_turn + turn) & 0xFFFF
        head = (
            f"LMDscandata 1 1 {SERIAL:X} {self.status[0]:X} {self.status[1]:X} {self._telegrams:X} {counter:X} "
            f"{self.clock_us(begun):X} {sent:X} 0 0 7 0 0 {self.frequency:X} 168 0"
        )
        where = f"{first & 0xFFFFFFFF:X} {step:X} {len(distances):X}"
        words = " ".join([_WORDS[distance] for distance in distances])
        channels = f"1 {self._content} 3F800000 00000000 {where} {words}"
        strengths = f"RSSI1 3F800000 00000000 {where} {' '.join(['64' if value else '0' for value in distances])}"
        if self._remission == 16:
            channels = f"2{channels[1:]} {strengths}"
        eight = f"1 {strengths}" if self._remission == 8 else "0"
        text = f"{head} {channels} {eight} 0 0 0 0 0"
        self._last = f"sSN {text}"
        return f"{kind} {text}"


_METHODS = {"mLMPsetscancfg", "mEEwriteall", "LMCstartmeas", "LMCstopmeas", "LMCstandby"}
_WORDS = [f"{number:X}" for number in range(1 << 15)]
"""Distances as they are written [mm]."""


class SimStream:
    """A client's end of a connection in process."""

    def __init__(self, device: Lms100) -> None:
        """Raises ConnectionRefusedError: the device is unplugged."""
        self._device, self._loop = device, asyncio.get_running_loop()
        self._line = device.connect(self._receive, self._hang_up)
        self._waiting, self._closed = bytearray(), False
        self._sent: deque[bytes] = deque()
        self._news: asyncio.Future[None] | None = None

    async def read(self) -> bytes:
        """What has come, as soon as there is something; nothing: the device has hung up."""
        while not self._waiting and not self._closed:
            self._news = self._loop.create_future()
            await self._news
        size = self._device.piece or len(self._waiting)
        data = bytes(self._waiting[:size])
        del self._waiting[:size]
        return data

    def write(self, data: bytes) -> None:
        """Have it sent."""
        self._sent.append(data)
        self._loop.call_later(TRANSFER, self._pass_on)

    def close(self) -> None:
        """Harmless when repeated."""
        self._device.leave(self._line)
        self._hang_up()

    def _pass_on(self) -> None:
        self._line.receive(self._sent.popleft())  # timers of one time may run in any order

    def _receive(self, data: bytes) -> None:
        self._waiting += data
        self._wake()

    def _hang_up(self) -> None:
        self._closed = True
        self._wake()

    def _wake(self) -> None:
        if self._news is not None and not self._news.done():
            self._news.set_result(None)
