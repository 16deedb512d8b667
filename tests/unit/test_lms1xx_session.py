"""The session with an LMS1xx: what is asked, what of the answers is believed, and how it ends."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from math import radians

import pytest
from scanner_rig import Held, held

from artemis.devices.lms1xx.dialogue import NotReady
from artemis.devices.lms1xx.telegrams import framed
from artemis.errors import DeviceError, DeviceLost, DeviceTimeout, ProtocolError, WrongDevice
from artemis.plugins.scanners.lms1xx import Lms1xxConfig
from artemis.scan import Condition
from artemis.sim.lms100 import ClientLine, Lms100


def test_scans_come_each_once_at_their_time() -> None:
    async def test(at: Held) -> None:
        assert await at.hold(3.0) is None
        assert len(at.scans) > 120
        scan = at.scans[-1]
        assert scan.source == "front"
        assert scan.millimetres.tolist() == [1000 + 3 * beam for beam in range(541)]
        assert scan.start_angle == pytest.approx(radians(-135))
        assert scan.increment == pytest.approx(radians(0.5))
        assert scan.beam_time == pytest.approx(0.02 / 720)
        assert (scan.status, scan.condition, scan.garbled) == (0, Condition.WELL, 0)
        for one, other in pairwise(at.scans):
            assert other.counter == one.counter + 1
            assert other.time - one.time == pytest.approx(0.02, abs=1e-5)
        assert all(
            -1e-6 <= given - (scan.time + 541 * scan.beam_time) < 0.001
            for scan, given in zip(at.scans, at.given, strict=True)
        )

    held(test)


def test_other_frequency_and_resolution_take_their_time_and_are_read_back() -> None:
    async def test(at: Held) -> None:
        assert await at.hold(12.0) is None
        assert 10.0 < at.given[0] < 11.0
        assert (at.device.frequency, at.device.resolution) == (2500, 2500)
        assert len(at.scans[0].millimetres) == 1081
        assert at.scans[0].increment == pytest.approx(radians(0.25))
        assert at.scans[0].beam_time == pytest.approx(0.04 / 1440)

    held(test, Lms1xxConfig(host="scanner", frequency_hz=25, resolution_deg=0.25))


def test_counter_is_given_without_its_turns() -> None:
    async def test(at: Held) -> None:
        at.device.first_turn = (1 << 16) - 100
        assert await at.hold(4.0) is None
        assert at.scans[-1].counter > 1 << 16
        assert all(other.counter == one.counter + 1 for one, other in pairwise(at.scans))

    held(test)


def test_nobody_there() -> None:
    async def test(at: Held) -> None:
        at.device.unplug()
        error = await at.hold(5.0)
        assert isinstance(error, DeviceLost)
        assert error.problem == "scanner:2111: Connection refused"

    held(test)


def test_a_connection_that_never_comes() -> None:
    async def test(at: Held) -> None:
        async def never(host: str, port: int) -> None:
            await asyncio.sleep(1e6)

        at.session._dial = never  # type: ignore[assignment]
        error = await at.hold(5.0)
        assert isinstance(error, DeviceTimeout)
        assert error.problem == "scanner:2111: no connection within 2 s"

    held(test)


def test_a_cut_connection_ends_the_session_and_the_next_one_measures_again() -> None:
    async def test(at: Held) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(2.0, at.device.unplug)
        error = await at.hold(5.0)
        assert isinstance(error, DeviceLost)
        assert error.problem == "has closed the connection"
        assert loop.time() == pytest.approx(2.0)
        at.device.plugged_in = True
        number = len(at.scans)
        assert await at.hold(2.0) is None
        assert len(at.scans) > number + 50

    held(test)


def test_a_device_that_falls_silent() -> None:
    async def test(at: Held) -> None:
        loop = asyncio.get_running_loop()

        def fall_silent() -> None:
            at.device.silent = True

        loop.call_later(2.0, fall_silent)
        error = await at.hold(5.0)
        assert isinstance(error, DeviceTimeout)
        assert error.problem == "no scan within 0.5 s"
        assert loop.time() == pytest.approx(2.5, abs=0.03)

    held(test)


LOGIN = "sMN SetAccessMode 03 F4724744"
SLOWER = Lms1xxConfig(host="scanner", frequency_hz=25)
"""Another setting than the device was made with."""
ANSWERS = {
    "SetAccessMode": ("sAN SetAccessMode 0", "was its password changed?"),
    "LMCstopmeas": ("sFA 1", "refuses sMN LMCstopmeas: access denied (sFA 1)"),
    "mLMPsetscancfg": ("sAN mLMPsetscancfg 2 1388 1 1388 FFF92230 225510", "it has no such resolution"),
    "LMPscancfg": ("sRA LMPscancfg 1388 1 1388 FFF92230 225510", "says that it measures with 50 Hz and 0.5 degrees"),
    "LMCstartmeas": ("sFA 1", "access denied (sFA 1)"),
    "LMDscandata": ("sEA LMDscandata 0", "sEA LMDscandata 1 was expected"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_device_that_does_not_do_as_it_is_asked(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answer, words = ANSWERS[name]
    _answering(monkeypatch, {name: answer})

    async def test(at: Held) -> None:
        error = await at.hold(15.0)
        assert isinstance(error, WrongDevice)
        assert words in error.problem

    held(test, SLOWER)


@pytest.mark.parametrize(
    ("name", "answer", "words"),
    [
        ("mLMPsetscancfg", "sAN mLMPsetscancfg", "too short an answer: sAN mLMPsetscancfg"),
        ("STlms", "sRA STlms seven", "expected a number, found seven"),
        ("LMPscancfg", "sRA LMPscancfg 1388 1 1FFFFFFFF", "expected a number of 32 bits"),
        ("LMPscancfg", "  ", "an empty telegram"),
    ],
)
def test_garbage_for_an_answer(name: str, answer: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _answering(monkeypatch, {name: answer})

    async def test(at: Held) -> None:
        error = await at.hold(5.0)
        assert isinstance(error, ProtocolError)
        assert words in error.problem

    held(test, SLOWER)


@pytest.mark.parametrize(
    ("name", "answer", "words"),
    [
        ("LMCstopmeas", "sAN another 0", "no answer to sMN LMCstopmeas within 1 s"),
        ("STlms", "sRA STlms 4 0", "does not begin to measure within 60 s (state 4)"),
    ],
)
def test_a_device_that_never_answers_or_never_measures(
    name: str, answer: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _answering(monkeypatch, {name: answer})

    async def test(at: Held) -> None:
        error = await at.hold(100.0)
        assert isinstance(error, DeviceTimeout)
        assert words in error.problem

    held(test, SLOWER)


def test_what_the_device_says_of_itself() -> None:
    async def test(at: Held) -> None:
        found = []
        for status in ((0, 0), (0, 2), (0, 1), (0, 5), (3, 0)):
            at.device.status = status
            assert await at.hold(1.0) is None
            found.append((at.scans[-1].status, at.scans[-1].condition))
        assert found == [
            (0x0000, Condition.WELL),
            (0x0002, Condition.DIRTY),
            (0x0001, Condition.FAULTY),
            (0x0005, Condition.FAULTY),
            (0x0300, Condition.FAULTY),
        ]

    held(test)


@pytest.mark.parametrize("wrong", [b"sSN LMDscandata 1 1 zz", b"\x02\x02", b"s", b" "])
def test_garbage_between_scans_is_counted_in_the_next(wrong: bytes) -> None:
    async def test(at: Held) -> None:
        numbers = iter(range(10_000))
        at.device.garble = lambda telegram: telegram if next(numbers) % 3 else wrong
        assert await at.hold(3.0) is None
        assert len(at.scans) > 70
        assert {scan.garbled for scan in at.scans[2:]} <= {0, 1, 2, 3}
        assert all(max(one.garbled, other.garbled) >= 1 for one, other in pairwise(at.scans[2:]))

    held(test)


def test_a_late_answer_is_no_garbage() -> None:
    async def test(at: Held) -> None:
        numbers = iter(range(10_000))
        at.device.garble = lambda telegram: telegram if next(numbers) % 5 else b"sRA STlms 7 0"
        assert await at.hold(2.0) is None
        assert not any(scan.garbled for scan in at.scans)

    held(test)


@pytest.mark.parametrize(
    "request_", ["LMDscandatacfg 02 00 0 1 0 00 00 0 0 0 0 +1", "LMPoutputRange 1 +5000 +450000 +1350000"]
)
def test_a_device_that_another_program_configures_is_configured_again(request_: str) -> None:
    async def test(at: Held) -> None:
        loop = asyncio.get_running_loop()

        async def configure() -> None:
            await asyncio.sleep(1.0)
            other = await at.device.dial("scanner", 2111)
            for request in (LOGIN, f"sWN {request_}"):
                other.write(framed(request))
                await other.read()

        another = asyncio.ensure_future(configure())
        error = await at.hold(5.0)
        assert isinstance(error, DeviceTimeout)
        assert "telegrams without DIST1, or of another frequency, resolution or range: does ano" in error.problem
        assert loop.time() == pytest.approx(1.5, abs=0.03)
        number = len(at.scans)
        assert await at.hold(2.0) is None
        assert len(at.scans) > number + 80
        await another

    held(test)


def test_telegrams_that_cannot_be_read_end_the_session() -> None:
    async def test(at: Held) -> None:
        at.device.garble = lambda telegram: telegram[:100]
        error = await at.hold(5.0)
        assert isinstance(error, DeviceTimeout)
        assert "no scan within 0.5 s: 24 damaged telegrams" in error.problem

    held(test)


def test_a_device_that_starts_is_waited_for() -> None:
    async def test(at: Held) -> None:
        at.device.filters["LFPparticle"] = (0, 500)
        at.device.restart(3.0)
        error = await at.hold(5.0)
        assert isinstance(error, NotReady)
        assert "is not ready yet (state 1: initialises): answers sAN LMCstopmeas 1 to sMN LMCstopmeas" in error.problem
        await asyncio.sleep(3.0)
        assert await at.hold(12.0) is None
        assert at.scans

    held(test, SLOWER)


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ({"LMCstopmeas": "sAN LMCstopmeas 1"}, "is not ready yet: answers sAN LMCstopmeas 1"),
        ({"STlms": "sRA STlms 1 0", "LMPscancfg": "sFA 3"}, "is not ready yet (state 1: initialises)"),
        ({"LMDscandatacfg": "sFA 4"}, "is not ready yet: refuses sWN LMDscandatacfg 01 00 0 1"),
        ({"mLMPsetscancfg": "sFA D"}, "busy (sFA D)"),
        ({"FREchoFilter": "sFA 4"}, "is not ready yet: refuses sRN FREchoFilter: not now (sFA 4)"),
        ({"STlms": "sRA STlms 5 0", "SetAccessMode": "sAN SetAccessMode 0"}, "is not ready yet (state 5: prepares)"),
    ],
)
def test_what_it_does_not_do_yet_is_no_refused_configuration(
    answers: dict[str, str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _answering(monkeypatch, answers)

    async def test(at: Held) -> None:
        error = await at.hold(5.0)
        assert isinstance(error, NotReady)
        assert words in error.problem

    held(test, SLOWER)


def test_only_what_differs_is_set(asked: list[str]) -> None:
    async def test(at: Held) -> None:
        assert await at.hold(0.5) is None
        assert at.given[0] < 0.1, "it is not stopped"
        assert not {"LMCstopmeas", "mLMPsetscancfg", "LMCstartmeas"} & set(asked)
        other = await at.device.dial("scanner", 2111)
        for request in (LOGIN, "sWN LMPoutputRange 1 +5000 +0 +10000", "sMN LMCstopmeas"):
            other.write(framed(request))
            await other.read()
        assert await at.hold(1.0) is None
        assert len(at.scans[-1].millimetres) == 541
        assert "mLMPsetscancfg" not in asked

    held(test)


@pytest.mark.parametrize("answer", [None, "sAN nothing"])
def test_a_device_that_is_unresponsive_while_its_motor_changes_its_speed(
    answer: str | None, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if answer is not None:
        _answering(monkeypatch, {"mLMPsetscancfg": answer})

    async def test(at: Held) -> None:
        at.device.spin_up, at.device.answers_always = 30.0, False
        assert await at.hold(40.0) is None
        assert 30.0 < at.given[0] < 33.0
        assert asked.count("mLMPsetscancfg") == 1

    held(test, SLOWER)


class Told:
    """A connection over which something else comes than answers, in pieces of a byte."""

    def __init__(self, data: bytes) -> None:
        self._data = list(data)

    async def read(self) -> bytes:
        if not self._data:
            await asyncio.sleep(1e6)
        return bytes([self._data.pop(0)])

    def write(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("data", "kind", "words"),
    [
        (b"", DeviceTimeout, "it takes connections but does not answer in CoLa A: wait until it has started, or set "),
        (b"\x02\x02\x02\x02\0\0\0\x05sFA\0\x0c#", WrongDevice, "it answers in CoLa B: set CoLa ASCII in SOPAS"),
    ],
)
def test_a_device_that_does_not_speak_cola_a(data: bytes, kind: type[DeviceError], words: str) -> None:
    async def test(at: Held) -> None:
        async def dial(host: str, port: int) -> Told:
            return Told(data)

        at.session._dial = dial
        error = await at.hold(5.0)
        assert isinstance(error, kind)
        assert words in error.problem

    held(test)


def test_filters_that_hide_what_is_near_are_switched_off() -> None:
    async def test(at: Held) -> None:
        at.device.filters |= {"FREchoFilter": (2,), "LFPmeanfilter": (1, 10, 0), "LFPparticle": (1, 500)}
        assert await at.hold(1.0) is None
        assert at.device.filters == {"FREchoFilter": (0,), "LFPmeanfilter": (0, 2, 0), "LFPparticle": (0, 500)}
        assert at.scans

    held(test)


def test_a_device_that_does_not_say_what_it_sends_is_told(asked: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    right = Lms100._read
    monkeypatch.setattr(Lms100, "_read", lambda self, name: "sFA 3" if name == "LMPoutputRange" else right(self, name))

    async def test(at: Held) -> None:
        assert await at.hold(1.0) is None
        assert asked.count("LMPoutputRange") == 2

    held(test)


def test_a_device_that_sends_all_echoes_stays_so(asked: list[str]) -> None:
    async def test(at: Held) -> None:
        at.device.filters["FREchoFilter"] = (1,)
        assert await at.hold(1.0) is None
        assert at.device.filters["FREchoFilter"] == (1,)
        assert "LMCstopmeas" not in asked

    held(test)


@pytest.mark.parametrize(("code", "reason"), [("sFA A", "the variable cannot be written"), ("sWA LFPmeanfilter", "")])
def test_a_filter_that_stays_on_is_refused(code: str, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    right = Lms100._write
    monkeypatch.setattr(
        Lms100, "_write", lambda self, name, rest: code if name == "LFPmeanfilter" else right(self, name, rest)
    )

    async def test(at: Held) -> None:
        at.device.filters["LFPmeanfilter"] = (1, 10, 0)
        error = await at.hold(5.0)
        assert isinstance(error, WrongDevice)
        assert "means its scans (LFPmeanfilter 1), which has to be switched off in SOPAS" in error.problem
        assert reason in error.problem

    held(test)


@pytest.mark.parametrize("code", ["sFA 2", "sFA 3", "sFA C", "sRA another"])
def test_a_device_without_filters_measures(code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _answering(monkeypatch, {"FREchoFilter": code, "LFPmeanfilter": code, "LFPparticle": code})

    async def test(at: Held) -> None:
        assert await at.hold(5.0) is None
        assert at.scans

    held(test)


def test_close_is_harmless() -> None:
    async def test(at: Held) -> None:
        at.session.close()
        await at.hold(1.0)
        at.session.close()
        at.session.close()

    held(test)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of all that the device is asked for."""
    names: list[str] = []
    right = Lms100.answer

    def answer(self: Lms100, telegram: bytes, line: ClientLine) -> str:
        names.append(telegram.split()[1].decode())
        return right(self, telegram, line)

    monkeypatch.setattr(Lms100, "answer", answer)
    return names


def _answering(monkeypatch: pytest.MonkeyPatch, answers: dict[str, str]) -> None:
    """The device answers so to requests of these names."""
    right = Lms100.answer

    def answer(self: Lms100, telegram: bytes, line: ClientLine) -> str:
        return answers.get(telegram.split()[1].decode(), right(self, telegram, line))

    monkeypatch.setattr(Lms100, "answer", answer)
