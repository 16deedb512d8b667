"""CoLa A: telegrams out of a stream of bytes, words out of telegrams, and a scan out of words.

A telegram is ASCII text between 0x02 and 0x03, its words parted by spaces. Numbers are hexadecimal, or decimal where
they have a sign; negative hexadecimal ones are the two's complement of their field's width (SICK, "Telegram Listing
Ranging sensors LMS1xx", 8014631).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from math import isfinite

import numpy as np
from msgspec import Struct

from artemis.errors import ProtocolError

START, END = b"\x02", b"\x03"
BINARY = 4 * START
"""A telegram of CoLa B begins so."""
LONGEST = 1 << 16
"""No telegram of such a scanner has more bytes: four channels of 1081 values with four digits and a space are 22 kB."""
MOST_VALUES = 2161
"""Beams of a channel: 360 degrees in steps of a sixth."""
MOST_CHANNELS, MOST_ENCODERS = 4, 3
LAST_CODE = 15
"""Distances up to this are codes of errors, not millimetres."""
_LONGEST_WORD = 11
"""A sign and the ten digits of a number with 32 bits."""
_HEX = b"0123456789ABCDEFabcdef"


class TelegramError(ProtocolError):
    """Bytes that are no telegram, or a telegram that cannot be what it claims to be."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem, "scanner")


class TelegramReader:
    """Cuts a stream into telegrams, however it is split and joined; after garbage it goes on at the next start mark."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.dropped = 0
        """Runs of bytes so far that were no telegram."""
        self._begin = b""

    @property
    def is_binary(self) -> bool:
        """The stream began as one of CoLa B does, with four start marks and the length of the first telegram."""
        return self._begin == BINARY

    @property
    def waiting(self) -> int:
        """Bytes that are no whole telegram yet."""
        return len(self._waiting)

    def feed(self, data: bytes) -> list[bytes]:
        """The telegrams that are complete now, without their marks, oldest first."""
        waiting, found = self._waiting, []
        searched = max(0, len(waiting) - 1)
        if len(self._begin) < len(BINARY):
            self._begin += data[: len(BINARY) - len(self._begin)]
        waiting += data
        while (end := waiting.find(END, searched)) >= 0:
            start = waiting.rfind(START, 0, end)  # one that began before another one began has lost its end
            if start != 0:
                self.dropped += 1
            if start >= 0:
                found.append(bytes(waiting[start + 1 : end]))
            del waiting[: end + 1]
            searched = 0
        if len(waiting) > LONGEST:
            self.dropped += 1
            waiting.clear()
        return found


def framed(text: str) -> bytes:
    """A telegram of this text, with its marks."""
    return START + text.encode("ascii") + END


def words_of(telegram: bytes) -> list[bytes]:
    """The words of a telegram.

    Raises:
        TelegramError: it has none, or bytes that are no printable ASCII.
    """
    if not telegram.isascii() or telegram.translate(None, _PRINTABLE):
        raise TelegramError(f"not a text: {telegram[:32].hex(' ')}")
    words = telegram.split()
    if not words:
        raise TelegramError("an empty telegram")
    return words


_PRINTABLE = bytes(range(0x20, 0x7F))


def _shown(word: bytes) -> str:
    return ascii(word[:32].decode("ascii", "replace"))[1:-1]


def unsigned(word: bytes, bits: int) -> int:
    """A number without sign.

    Raises:
        TelegramError: it is none, or has more than `bits` bits.
    """
    number = _number(word)
    if not 0 <= number < 1 << bits:
        raise TelegramError(f"expected a number of {bits} bits, found {_shown(word)}")
    return number


def signed(word: bytes, bits: int) -> int:
    """A number with sign: a decimal one has it written, of a hexadecimal one it is the highest bit.

    Raises:
        TelegramError: it is none, or has more than `bits` bits.
    """
    number, half = _number(word), 1 << (bits - 1)
    if word[:1] in b"+-":
        fits = -half <= number < half
    else:
        fits = 0 <= number < 2 * half
        number -= 2 * half if number >= half else 0
    if not fits:
        raise TelegramError(f"expected a number of {bits} bits, found {_shown(word)}")
    return number


def _number(word: bytes) -> int:
    if word[:1] in b"+-" and word[1:].isdigit() and len(word) <= _LONGEST_WORD:
        return int(word)
    if not word or len(word) > _LONGEST_WORD or word.translate(None, _HEX):
        raise TelegramError(f"expected a number, found {_shown(word)}")
    return int(word, 16)


class Channel(Struct, frozen=True, kw_only=True):
    """One kind of measured data; a value means `value * scale + offset`."""

    content: str
    """DIST1, DIST2, RSSI1 or RSSI2."""
    scale: float
    offset: float
    start: int
    """Angle of the first beam [1/10000 degree], counted from the device's right side, counter-clockwise."""
    step: int
    """From beam to beam [1/10000 degree]."""
    values: bytes
    """Unsigned 16-bit integers, low byte first."""

    def meant(self, least: int = 0) -> bytes:
        """What the values mean, packed likewise; 0 where that does not fit, and of values below `least`."""
        values = np.frombuffer(self.values, "<u2")
        numbers = values * self.scale + self.offset
        numbers[(values < least) | (numbers < 0.0) | (numbers >= 65535.5)] = 0.0
        return np.rint(numbers).astype("<u2").tobytes()

    def millimetres(self) -> bytes:
        """The same of distances, with 0 for codes of errors."""
        return self.meant(LAST_CODE + 1)


class ScanTelegram(Struct, frozen=True, kw_only=True):
    """One scan as the device tells it (`LMDscandata`)."""

    device: int
    serial: int
    status: tuple[int, int]
    """0 0 well, 0 1 error, 0 2 window nearly too dirty, 0 5 window too dirty."""
    scan_counter: int
    started_us: int
    """When the scan began, on the device's clock, which begins anew after 71.6 min [us]."""
    frequency: int
    """Turns per time [1/100 Hz]."""
    channels: tuple[Channel, ...]
    """Those with 16 bits, then those with 8."""

    def channel(self, content: str) -> Channel | None:
        """The channel of this content."""
        return next((channel for channel in self.channels if channel.content == content), None)


class _Words:
    """The words of a telegram, one after the other."""

    def __init__(self, words: list[bytes]) -> None:
        self._words, self._next = words, 0

    def take(self) -> bytes:
        if self._next >= len(self._words):
            raise TelegramError(f"ends after {len(self._words)} words")
        self._next += 1
        return self._words[self._next - 1]

    def unsigned(self, bits: int) -> int:
        return unsigned(self.take(), bits)

    def number_up_to(self, most: int, what: str) -> int:
        """A 16-bit number of things, which cannot be more than `most`."""
        number = self.unsigned(16)
        if number > most:
            raise TelegramError(f"{number} {what}, at most {most} can be")
        return number

    def values(self, number: int, bits: int) -> bytes:
        found = self._words[self._next : self._next + number]
        if len(found) < number:
            raise TelegramError(f"{len(found)} values of {number}")
        self._next += number
        digits, together = bits // 4, b"".join(found)
        if together.translate(None, _HEX) or max(map(len, found), default=0) > digits:
            raise TelegramError(f"values that are no hexadecimal numbers of {bits} bits")
        return np.array([int(word, 16) for word in found], "<u2").tobytes()


def scan_from(telegram: bytes) -> ScanTelegram:
    """The scan in a telegram `sSN LMDscandata ...` or `sRA LMDscandata ...`.

    Raises:
        TelegramError: it is something else, or cannot be one.
    """
    words = _Words(words_of(telegram))
    kind, name = words.take(), words.take()
    if kind not in (b"sSN", b"sRA") or name != b"LMDscandata":
        raise TelegramError(f"no scan but {_shown(kind)} {_shown(name)}")
    words.unsigned(16)  # version
    device, serial = words.unsigned(16), words.unsigned(32)
    status = words.unsigned(8), words.unsigned(8)
    words.unsigned(16)  # number of the telegram
    scan_counter = words.unsigned(16)
    started = words.unsigned(32)
    words.unsigned(32)  # when it was sent
    for bits in (8, 8, 8, 8, 16):  # digital inputs, digital outputs, angle of the layer
        words.unsigned(bits)
    frequency = words.unsigned(32)
    words.unsigned(32)  # measurements per time
    for _ in range(words.number_up_to(MOST_ENCODERS, "encoders")):
        words.unsigned(32)
        words.unsigned(16)
    channels = [*_channels(words, 16), *_channels(words, 8)]
    return ScanTelegram(
        device=device,
        serial=serial,
        status=status,
        scan_counter=scan_counter,
        started_us=started,
        frequency=frequency,
        channels=tuple(channels),
    )


def _channels(words: _Words, bits: int) -> Iterator[Channel]:
    for _ in range(words.number_up_to(MOST_CHANNELS, f"channels of {bits} bits")):
        content = words.take()
        if content not in (b"DIST1", b"DIST2", b"RSSI1", b"RSSI2"):
            raise TelegramError(f"a channel named {_shown(content)}")
        scale, offset = _float(words.unsigned(32)), _float(words.unsigned(32))
        start, step = signed(words.take(), 32), words.unsigned(16)
        number = words.number_up_to(MOST_VALUES, "values")
        values = words.values(number, bits)
        yield Channel(content=content.decode(), scale=scale, offset=offset, start=start, step=step, values=values)


def _float(bits: int) -> float:
    """The IEEE 754 number of single precision that these bits are."""
    number: float = struct.unpack(">f", bits.to_bytes(4, "big"))[0]
    if not isfinite(number) or abs(number) > 1e6:
        raise TelegramError(f"a scale or offset of {number:g}")
    return number
