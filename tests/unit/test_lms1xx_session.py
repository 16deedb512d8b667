"""The session with an LMS1xx: what is asked, what of the answers is believed, and how it ends."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from math import radians

import pytest
from scanner_rig import Held, held

from artemis.errors import DeviceLost, DeviceTimeout, ProtocolError, WrongDevice
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


ANSWERS = {
    "SetAccessMode": ("sAN SetAccessMode 0", "was its password changed?"),
    "LMCstopmeas": ("sFA D", "refuses sMN LMCstopmeas: busy (sFA D)"),
    "mLMPsetscancfg": ("sAN mLMPsetscancfg 2 1388 1 1388 FFF92230 225510", "it has no such resolution"),
    "LMPscancfg": ("sRA LMPscancfg 9C4 1 1388 FFF92230 225510", "says that it measures with 25 Hz and 0.5 degrees"),
    "LMCstartmeas": ("sFA 1", "access denied (sFA 1)"),
    "LMDscandata": ("sEA LMDscandata 0", "sEA LMDscandata 1 was expected"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_device_that_does_not_do_as_it_is_asked(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answer, words = ANSWERS[name]
    _answering(monkeypatch, {name: answer})

    async def test(at: Held) -> None:
        error = await at.hold(5.0)
        assert isinstance(error, WrongDevice)
        assert words in error.problem

    held(test)


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

    held(test)


@pytest.mark.parametrize(
    ("name", "answer", "words"),
    [
        ("LMCstopmeas", "sAN another 0", "no answer to sMN LMCstopmeas within 1 s"),
        ("STlms", "sRA STlms 4 0", "does not begin to measure within 30 s (state 4)"),
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

    held(test)


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


def test_scans_without_distances_are_garbage() -> None:
    async def test(at: Held) -> None:
        at.device.garble = lambda telegram: telegram.replace(b"DIST1", b"DIST2")
        assert await at.hold(2.0) is None
        assert at.scans == []

    held(test)


def test_close_is_harmless() -> None:
    async def test(at: Held) -> None:
        at.session.close()
        await at.hold(1.0)
        at.session.close()
        at.session.close()

    held(test)


def _answering(monkeypatch: pytest.MonkeyPatch, answers: dict[str, str]) -> None:
    """The device answers so to requests of these names."""
    right = Lms100.answer

    def answer(self: Lms100, telegram: bytes, line: ClientLine) -> str:
        return answers.get(telegram.split()[1].decode(), right(self, telegram, line))

    monkeypatch.setattr(Lms100, "answer", answer)
