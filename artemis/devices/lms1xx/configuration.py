"""How an LMS1xx is made to measure as the robot file says: what differs is set, and nothing is stored in it.

From SICK's "Telegram Listing Ranging sensors LMS1xx, LMS5xx, ..." (8014631), whose words on the frequency are: after a
change there are no telegrams and no answers for up to 30 s. The values of the filters are also in SICKAG/sick_scan_xd
(sick_scan_common.cpp), which sets no echo filter in an LMS1xx: which of the filters one knows depends on its firmware.
"""

from __future__ import annotations

import asyncio
from typing import NamedTuple, Protocol

from artemis.devices.lms1xx.dialogue import ColaDialogue, ScannerRefused, Unknown, state_in, word
from artemis.devices.lms1xx.telegrams import signed, unsigned
from artemis.errors import DeviceTimeout

START_TIME = 60.0
"""It has so long to begin to measure [s]: twice what SICK says of a motor that changes its speed."""
ASK_AGAIN = 0.1
"""Between two questions whether it measures yet [s]."""
FIRST_ANGLE, LAST_ANGLE = -450_000, 2_250_000
"""Of the field of view [1/10000 degree], counted from the device's right side."""
IDLE, MEASURES = 3, 7
"""Of `STlms`: it was told to stop; ready for measurement."""


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


class ScanFilter(NamedTuple):
    """A filter in the device, which may hide what is near or show it late."""

    variable: str
    words: str
    harmless: tuple[int, ...]
    """Values of its first word with which it does neither."""
    off: str
    """What is written where it has another one."""


FILTERS = (
    ScanFilter("FREchoFilter", "takes the last echo of a beam, not the first", (0, 1), "0"),
    ScanFilter("LFPmeanfilter", "means its scans", (0,), "0 +2 0"),
    ScanFilter("LFPparticle", "leaves out small things", (0,), "0 +500"),
)
"""Echo filter: 0 first echo, 1 all echoes (`DIST1` is the first of them), 2 last echo. The other ones: 0 off, 1 on."""


class Configuration:
    """Of one device, over one connection."""

    def __init__(self, dialogue: ColaDialogue, setting: ScanSetting) -> None:
        """What the device at the other end of `dialogue` shall measure."""
        self._dialogue, self._setting = dialogue, setting
        self._wanted = round(setting.frequency_hz * 100), round(setting.resolution_deg * 10_000)
        """Frequency [1/100 Hz] and resolution [1/10000 degree]."""
        self._sector = f"+{self._wanted[1]} {FIRST_ANGLE:+} {LAST_ANGLE:+}"
        self._stopped = dialogue.state == IDLE

    async def apply(self) -> None:
        """Set what differs. Raises what the dialogue does; `ScannerRefused` also where something stays as it is."""
        scan, part = await self._scan() == self._wanted, await self._part()
        filters = [(each, value) for each in FILTERS if (value := await self._value(each)) is not None]
        wrong = [each for each, value in filters if value not in each.harmless]
        ask = self._dialogue
        await ask.expect("sMN SetAccessMode 03 F4724744", "sAN SetAccessMode 1")
        if not scan or not part or wrong:
            await ask.expect("sMN LMCstopmeas", "sAN LMCstopmeas 0")
            self._stopped = True
        if not scan:
            await self._set_scan()
        for each in wrong:
            await self._switch_off(each)
        await ask.expect("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 0 +1", "sWA LMDscandatacfg")
        if not part:
            await ask.expect(f"sWN LMPoutputRange 1 {self._sector}", "sWA LMPoutputRange")

    async def start(self) -> None:
        """Have it measure, and wait until it does.

        Raises:
            DeviceTimeout: it does not within `START_TIME`, and what the dialogue does.
        """
        ask, loop = self._dialogue, asyncio.get_running_loop()
        if self._stopped:
            await ask.expect("sMN LMCstartmeas", "sAN LMCstartmeas 0")
        await ask.expect("sMN Run", "sAN Run 1")
        end = loop.time() + START_TIME
        while (state := state_in(await ask.ask("sRN STlms"))) != MEASURES:
            if loop.time() >= end:
                raise DeviceTimeout(ask.name, f"does not begin to measure within {START_TIME:g} s (state {state})")
            await asyncio.sleep(ASK_AGAIN)
        ask.patient_until = 0.0
        await ask.expect("sEN LMDscandata 1", "sEA LMDscandata 1")

    async def _scan(self) -> tuple[int, int]:
        """Its frequency [1/100 Hz] and resolution [1/10000 degree]."""
        answer = await self._dialogue.ask("sRN LMPscancfg")
        return signed(word(answer, 2), 32), signed(word(answer, 4), 32)

    async def _part(self) -> bool:
        """Whether it sends all of its field of view, every beam."""
        try:
            answer = await self._dialogue.ask("sRN LMPoutputRange")
        except Unknown:
            return False
        found = tuple(signed(word(answer, place), 32) for place in (3, 4, 5))
        return found == (self._wanted[1], FIRST_ANGLE, LAST_ANGLE)

    async def _set_scan(self) -> None:
        ask, setting = self._dialogue, self._setting
        try:
            answer = await ask.ask(f"sMN mLMPsetscancfg +{self._wanted[0]} +1 {self._sector}")
        except DeviceTimeout:
            answer = []  # its motor changes its speed already: what it reads back counts
        if answer and (code := unsigned(word(answer, 2), 8)) != 0:
            wanted = f"{setting.frequency_hz:g} Hz and {setting.resolution_deg:g} degrees"
            raise ScannerRefused(ask.name, f"does not measure with {wanted}: {_NO_SETTING.get(code, f'error {code}')}")
        ask.patient_until = asyncio.get_running_loop().time() + START_TIME
        if (found := await self._scan()) != self._wanted:
            raise ScannerRefused(
                ask.name,
                f"says that it measures with {found[0] / 100:g} Hz and {found[1] / 10_000:g} degrees, not with "
                f"{setting.frequency_hz:g} Hz and {setting.resolution_deg:g} degrees",
            )

    async def _value(self, filter: ScanFilter) -> int | None:
        """The first word of a filter's value; None: the device has no such filter."""
        try:
            answer = await self._dialogue.ask(f"sRN {filter.variable}")
        except (Unknown, DeviceTimeout):
            return None
        return unsigned(word(answer, 2), 8)

    async def _switch_off(self, filter: ScanFilter) -> None:
        why = ""
        try:
            await self._dialogue.expect(f"sWN {filter.variable} {filter.off}", f"sWA {filter.variable}")
        except ScannerRefused as error:
            why = f": {error.problem}"
        value = await self._value(filter)
        if value not in filter.harmless:
            problem = f"{filter.words} ({filter.variable} {value}), which has to be switched off in SOPAS{why}"
            raise ScannerRefused(self._dialogue.name, problem)


_NO_SETTING = {1: "it has no such frequency", 2: "it has no such resolution", 3: "it has neither", 4: "no such sector"}
