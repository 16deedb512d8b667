"""Inputs that nobody would write, made from good ones by seeded chance, and what may not happen with them."""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random
from types import FrameType

Mutate = Callable[[bytes, Random, Sequence[bytes]], bytes]

MAX_BYTES = 1 << 16
"""No input grows beyond."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Code under test."""

    name: str
    attempt: Callable[[bytes], None]
    """Feeds it one input. Lets nothing out but what must not happen."""
    seeds: Sequence[bytes]
    mutate: Mutate
    steps: int
    """Calls of functions that an input may cause, by the size of a page."""


class TooSlow(SystemExit):
    """An input takes more steps than it may. Not an `Exception`, and let through by asyncio: nothing may hold it up."""


def attempt(target: Target, data: bytes) -> int:
    """Feed one input, and count the calls of functions.

    Raises:
        TooSlow: there were more than an input of its size may cause.
        Exception: what came out.
    """
    limit = target.steps * (1 + len(data) // 1000)
    taken = 0

    def count(frame: FrameType, event: str, arg: object) -> None:
        nonlocal taken
        taken += event in ("call", "c_call")
        if taken > limit:
            raise TooSlow(f"more than {limit} calls for {len(data)} bytes")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        target.attempt(data)
    finally:
        sys.setprofile(before)
    return taken


def inputs(target: Target, random: Random) -> Iterator[bytes]:
    """The seeds, then mutants of them without end."""
    yield from target.seeds
    while True:
        data = random.choice(target.seeds)
        for _ in range(random.choice((1, 1, 1, 2, 3, 5, 10))):
            data = target.mutate(data, random, target.seeds)[:MAX_BYTES]
        yield data


# ---------------------------------------------------------------------------------------------- bytes

_INTERESTING = (0, 1, 2, 7, 8, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 1 << 16, (1 << 31) - 1, 1 << 31)
_LARGER = (*_INTERESTING, (1 << 32) - 1, 1 << 32, 1 << 40, (1 << 63) - 1, (1 << 64) - 1)
_WIDTHS = ((1, 0xFF), (2, 0xFFFF), (4, 0xFFFFFFFF), (8, 0xFFFFFFFFFFFFFFFF))


def mutate_bytes(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """One change of binary data: bits, numbers, parts that vanish, appear twice or come from elsewhere."""
    start = random.randrange(len(data) + 1)
    end = min(len(data), start + random.choice((1, 1, 2, 4, 8, random.randrange(1, 64))))
    match random.randrange(7):
        case 0:
            bits = bytes(byte ^ 1 << random.randrange(8) for byte in data[start:end][:1])
            return data[:start] + bits + data[start + 1 :]
        case 1:
            return data[:start] + data[end:]
        case 2:
            return data[:start] + random.randbytes(end - start) + data[end:]
        case 3:
            return data[:start] + data[start:end] * random.choice((2, 2, 3, 50)) + data[end:]
        case 4:
            width, largest = random.choice(_WIDTHS)
            number = struct.pack("<Q", min(largest, random.choice(_LARGER)))[:width]
            return data[:start] + number + data[start + width :]
        case 5:
            return data[:start]
        case _:
            return data[:start] + _part(random.choice(seeds), random) + data[end:]


def _part(data: bytes, random: Random) -> bytes:
    start = random.randrange(len(data) + 1)
    return data[start : start + random.randrange(1, 200)]


# ---------------------------------------------------------------------------------------------- text

_WORDS = re.compile(r"\n *|[ \t]+|[\w.]+|.", re.DOTALL)
_TOKENS = (
    *": - [ ] { } [] {} , & * &a *a &b *b <<: ? | > |- >+ ! !!int !!float !!python/object:os.system".split(),
    *"' \" # --- ...".split(),
    *"% @ ` ~ null true false True yes on 0 -0 00 1e400 -1e400 1e-400 .inf -.inf .nan 0x10 0o17 0b1 1_000 1:30".split(),
    *'2026-01-01 99999999999999999999999 0.1 -1 1e3 "" \'\' "\\x00" "\\ud800" "\\U00110000" . .. / é'.split(),
    *"steps follow calibrate teleop wait stop mission robot bus simulation path laps plugin follower inputs".split(),
    *"supervision tick_hz true_robot missions/figure_eight.yaml ../../etc/passwd /dev/zero".split(),
    *(": ", "- ", "? ", "<<: *a", "\t", "\r", "\0", "\x7f", "\x85", "\xa0", "\u2028"),
    *("\ufeff", "\ud7ff", "\uffff", "\U0010ffff", "\u0301"),
)
_NESTED = ("[", "{a: ", "- ", "[{", "? ", "{? ")


def mutate_text(data: bytes, random: Random, seeds: Sequence[bytes]) -> bytes:
    """One change of a YAML or CSV file: words, lines, indentation, nesting, aliases; now and then of bytes."""
    if random.randrange(8) == 0:
        return mutate_bytes(data, random, seeds)
    text = data.decode("utf-8", errors="replace")
    words = _WORDS.findall(text) or [""]
    place, other = random.randrange(len(words)), random.randrange(len(words))
    match random.randrange(8):
        case 0:
            del words[place]
        case 1:
            words[place], words[other] = words[other], words[place]
        case 2:
            words[place] = random.choice(_TOKENS)
        case 3:
            words.insert(place, random.choice(_TOKENS))
        case 4:
            words.insert(place, random.choice(_NESTED) * random.choice((3, 10, 21, 100, 3000)))
        case 5:
            words[place] *= random.choice((2, 10, 1000))
        case 6:
            return _mutate_lines(text, random, seeds).encode("utf-8", errors="surrogatepass")
        case _:
            found = _WORDS.findall(random.choice(seeds).decode("utf-8", errors="replace")) or [""]
            words[place] = random.choice(found)
    return "".join(words).encode("utf-8", errors="surrogatepass")


def _mutate_lines(text: str, random: Random, seeds: Sequence[bytes]) -> str:
    lines = text.split("\n")
    place, other = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(5):
        case 0:
            del lines[place]
        case 1:
            lines[place], lines[other] = lines[other], lines[place]
        case 2:
            lines[place : place + 1] = [lines[place]] * random.choice((2, 60))
        case 3:
            lines[place] = " " * random.randrange(1, 9) + lines[place]
        case _:
            found = random.choice(seeds).decode("utf-8", errors="replace").split("\n")
            lines.insert(place, random.choice(found))
    return "\n".join(lines)
