"""CoLa A: telegrams of real devices however they are cut, and anything else refused."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.devices.lms1xx.telegrams import (
    LONGEST,
    TelegramError,
    TelegramReader,
    framed,
    scan_from,
    signed,
    unsigned,
    words_of,
)
from artemis.errors import ProtocolError

DATA = Path(__file__).parents[1] / "data" / "lms1xx"
TELEGRAMS = {file.stem: file.read_bytes().strip() for file in sorted(DATA.glob("*.txt"))}
SENT = b"".join(b"\x02" + telegram + b"\x03" for telegram in TELEGRAMS.values())


def test_scan_of_an_lms100() -> None:
    scan = scan_from(TELEGRAMS["lms100"])
    assert (scan.device, scan.serial, scan.status) == (1, 0xA037B9, (0, 0))
    assert scan.scan_counter == 0xC1C6
    assert (scan.started_us, scan.frequency) == (0x8B621C37, 5000)
    (channel,) = scan.channels
    assert (channel.content, channel.scale, channel.offset) == ("DIST1", 1.0, 0.0)
    assert (channel.start, channel.step, len(channel.values)) == (-450_000, 5000, 2 * 541)
    assert channel.values[:4] == bytes([0x93, 0x02, 0x72, 0x02])
    raw, meant = memoryview(channel.values).cast("H"), memoryview(channel.millimetres()).cast("H")
    assert [new for old, new in zip(raw, meant, strict=True) if old == 3] == [0] * list(raw).count(3) != []
    assert all(new == old for old, new in zip(raw, meant, strict=True) if old > 15)


def test_scan_with_name_and_date_behind_it() -> None:
    scan = scan_from(TELEGRAMS["lms111"])
    assert (scan.serial, scan.scan_counter) == (0x8D4C04, 0x37)
    assert len(scan.channels) == 1


def test_intensities_of_eight_bits_and_a_name_with_a_space() -> None:
    scan = scan_from(TELEGRAMS["tim"])
    distances, strengths = scan.channel("DIST1"), scan.channel("RSSI1")
    assert distances is not None
    assert strengths is not None
    assert scan.channel("DIST2") is None
    assert (distances.start, distances.step, len(distances.values)) == (-450_000, 10_000, 2 * 271)
    assert strengths.meant()[:6] == bytes([0x9A, 0, 0x9D, 0, 0x9D, 0])


def test_scale_and_offset_are_used() -> None:
    doubled = re.sub(rb"3F800000 00000000", b"40000000 C0A00000", TELEGRAMS["lms100"])
    channel = scan_from(doubled).channels[0]
    assert (channel.scale, channel.offset) == (2.0, -5.0)
    assert memoryview(channel.millimetres()).cast("H")[0] == 2 * 0x293 - 5
    far = TELEGRAMS["lms100"].replace(b" 293 ", b" 8010 ").replace(b"3F800000", b"40000000")
    assert memoryview(scan_from(far).channels[0].millimetres()).cast("H")[0] == 0, "farther than 16 bits can say"


def test_encoders_are_skipped() -> None:
    with_encoder = TELEGRAMS["lms100"].replace(b"1388 168 0 1 DIST1", b"1388 168 1 3E8 2 1 DIST1")
    assert scan_from(with_encoder) == scan_from(TELEGRAMS["lms100"])


def test_telegrams_split_at_every_byte_are_the_same() -> None:
    whole = TelegramReader().feed(SENT)
    assert whole == list(TELEGRAMS.values())
    for cut in range(len(SENT) + 1):
        reader = TelegramReader()
        assert reader.feed(SENT[:cut]) + reader.feed(SENT[cut:]) == whole
        assert reader.dropped == 0
    bytewise = TelegramReader()
    assert [found for byte in SENT for found in bytewise.feed(bytes([byte]))] == whole
    assert bytewise.dropped == 0


@pytest.mark.parametrize(
    ("data", "found", "dropped"),
    [
        (b"rubbish\x02one\x03", [b"one"], 1),
        (b"\x02lost its en\x02one\x03\x02two\x03", [b"one", b"two"], 1),
        (b"end of something\x03\x02one\x03", [b"one"], 1),
        (b"\x03\x03\x02one\x03", [b"one"], 2),
        (b"\x02\x03\x02one\x03", [b"", b"one"], 0),
        (b"\x02one\x03between\x02two\x03", [b"one", b"two"], 1),
    ],
)
def test_after_garbage_it_goes_on_at_the_next_mark(data: bytes, found: list[bytes], dropped: int) -> None:
    for size in range(1, len(data) + 1):
        reader = TelegramReader()
        got = [one for at in range(0, len(data), size) for one in reader.feed(data[at : at + size])]
        assert (got, reader.dropped) == (found, dropped)


def test_a_stream_without_end_marks_fills_no_memory() -> None:
    reader = TelegramReader()
    for _ in range(100):
        assert reader.feed(b"\x02" + bytes(LONGEST // 2)) == []
        assert reader.waiting <= LONGEST
    assert reader.dropped > 10
    assert reader.feed(b"\x02one\x03") == [b"one"]


@pytest.mark.parametrize(
    ("change", "with_what", "problem"),
    [
        (b"LMDscandata", b"LMDscandate", "no scan but sSN LMDscandate"),
        (b"sSN", b"sAN", "no scan but sAN"),
        (b" 21D ", b" 226 ", "547 values of 550"),
        (b" 21D ", b" 800 ", "547 values of 2048"),
        (b" 21D ", b" FFFF ", "65535 values, at most 2161 can be"),
        (b"168 0 1 DIST1", b"168 9 1 DIST1", "9 encoders, at most 3 can be"),
        (b"168 0 1 DIST1", b"168 0 9 DIST1", "9 channels of 16 bits, at most 4 can be"),
        (b"DIST1", b"DIST9", "a channel named DIST9"),
        (b"3F800000", b"7F800000", "a scale or offset of inf"),
        (b"3F800000", b"7FC00000", "a scale or offset of nan"),
        (b"A037B9", b"1A037B900", "expected a number of 32 bits, found 1A037B900"),
        (b"A037B9", b"A037G9", "expected a number, found A037G9"),
        (b" 272 ", b" 2-2 ", "values that are no hexadecimal numbers of 16 bits"),
        (b" 272 ", b" 10272 ", "values that are no hexadecimal numbers of 16 bits"),
        (b" 272 ", b" 2\xe92 ", "not a text"),
    ],
)
def test_what_cannot_be_a_scan_is_refused(change: bytes, with_what: bytes, problem: str) -> None:
    changed = TELEGRAMS["lms100"].replace(change, with_what, 1)
    with pytest.raises(TelegramError) as refused:
        scan_from(changed)
    assert problem in refused.value.problem


def test_a_telegram_cut_anywhere_before_its_values_end_is_refused() -> None:
    telegram = TELEGRAMS["lms100"]
    end = telegram.rindex(b" 0 0 0 0 0 0")
    for cut in range(end):
        with pytest.raises(TelegramError):
            scan_from(telegram[:cut])


@pytest.mark.parametrize(
    ("word", "number"),
    [(b"FFF92230", -450_000), (b"225510", 2_250_000), (b"+5000", 5000), (b"-450000", -450_000), (b"0", 0)],
)
def test_numbers_with_sign(word: bytes, number: int) -> None:
    assert signed(word, 32) == number


@pytest.mark.parametrize("word", [b"", b"+", b"0x10", b"1_0", b"100000000", b"+99999999999", b"\xb2"])
def test_what_is_no_number_is_refused(word: bytes) -> None:
    for reader in (signed, unsigned):
        with pytest.raises(TelegramError):
            reader(word, 32)


def test_a_number_too_large_for_its_sign_is_refused() -> None:
    with pytest.raises(TelegramError, match=r"expected a number of 32 bits, found \+2147483648"):
        signed(b"+2147483648", 32)


def test_a_negative_number_is_not_unsigned() -> None:
    with pytest.raises(TelegramError, match="expected a number of 16 bits, found -1"):
        unsigned(b"-1", 16)


def test_the_errors_are_those_of_a_protocol() -> None:
    with pytest.raises(ProtocolError, match="scanner: an empty telegram"):
        words_of(b"  ")
    assert framed("sRN STlms") == b"\x02sRN STlms\x03"


PIECES = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.sampled_from([b"\x02", b"\x03", b"\x02\x03", b"sSN LMDscandata 1 1 ", b" FFFF", b" 0", *TELEGRAMS.values()]),
    ),
    max_size=30,
).map(b"".join)


@given(PIECES, st.integers(1, 400))
def test_any_bytes_are_scans_or_refused(data: bytes, size: int) -> None:
    reader = TelegramReader()
    found = [one for at in range(0, len(data), size) for one in reader.feed(data[at : at + size])]
    assert found == TelegramReader().feed(data), "however they are cut"
    for telegram in found:
        assert b"\x03" not in telegram
        try:
            scan = scan_from(telegram)
        except TelegramError:
            continue
        assert all(len(channel.millimetres()) == len(channel.values) for channel in scan.channels)


@given(st.sampled_from(sorted(TELEGRAMS)), st.data())
def test_one_wrong_byte_raises_nothing_else(name: str, data: st.DataObject) -> None:
    telegram = bytearray(TELEGRAMS[name])
    telegram[data.draw(st.integers(0, len(telegram) - 1))] = data.draw(st.integers(0, 255))
    with suppress(TelegramError):
        scan_from(bytes(telegram))
