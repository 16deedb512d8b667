"""How long a classic CAN frame with an 11-bit identifier is on the wire: CRC-15 and bit stuffing included.

Bit stream of a data or remote frame (ISO 11898-1:2015, 10.4): start of frame, identifier (11), RTR, IDE, r0, DLC (4),
data, CRC (15); these are stuffed. Then CRC delimiter, acknowledge slot and delimiter, end of frame (7): 10 bits that
are not. Three bits of interframe space follow before the next frame may start.
"""

from __future__ import annotations

from functools import cache, lru_cache

from artemis.devices.can_bus import Frame

CRC_POLYNOMIAL = 0x4599  # x15 + x14 + x10 + x8 + x7 + x4 + x3 + 1; ISO 11898-1:2015, 10.4.2.6
UNSTUFFED_BITS = 10 + 3
STUFFED_RUN = 5  # equal bits after which a stuff bit of the other value follows
FRAME_BITS = 1 + 11 + 1 + 2 + 4 + 15 + UNSTUFFED_BITS  # without data and stuff bits: 47

_Row = list[tuple[int, "_Row"]]
"""Stuffing of the next 8 bits in one state: byte -> (stuff bits inserted, row of the state after it)."""


def _crc_of_bits(value: int, length: int) -> int:
    """CRC-15 of the `length` lowest bits of `value`, most significant first."""
    crc = 0
    for position in reversed(range(length)):
        feedback = crc >> 14 ^ value >> position & 1
        crc = crc << 1 & 0x7FFF ^ (CRC_POLYNOMIAL if feedback else 0)
    return crc


def _crc_tables() -> list[list[int]]:
    """`tables[k][byte]`: what a byte with k bytes behind it contributes to the CRC, which is linear in its bits."""
    table = [_crc_of_bits(byte, 8) for byte in range(256)]
    tables = [table]
    for _ in range(7):
        tables.append([crc << 8 & 0x7FFF ^ table[crc >> 7] for crc in tables[-1]])
    return tables


def _stuff(bit: int, run: int, byte: int) -> tuple[int, int, int]:
    """Send 8 bits after a run of `run` equal `bit`s: (stuff bits, last bit on the wire, length of its run)."""
    inserted = 0
    for position in reversed(range(8)):
        following = byte >> position & 1
        bit, run = (bit, run + 1) if following == bit else (following, 1)
        if run == STUFFED_RUN:
            inserted, bit, run = inserted + 1, 1 - bit, 1
    return inserted, bit, run


def _stuff_rows() -> dict[tuple[int, int], _Row]:
    """One row for each state of the stuffing: last bit, and how many times it stood there (1 to 4)."""
    rows: dict[tuple[int, int], _Row] = {(bit, run): [] for bit in (0, 1) for run in range(1, STUFFED_RUN)}
    for (bit, run), row in rows.items():
        for byte in range(256):
            inserted, *state = _stuff(bit, run, byte)
            row.append((inserted, rows[state[0], state[1]]))
    return rows


_CRC_TABLES = _crc_tables()
_BEHIND = [_CRC_TABLES[:length][::-1] for length in range(9)]  # per data length, the table of each data byte in turn
_AFTER_ONE = _stuff_rows()[1, 1]


@cache
def _start_of_frame(identifier: int, rtr: bool, length: int) -> tuple[int, _Row, int]:
    """Start of frame to DLC: (bits of the frame without data and their stuffing, row, contribution to the CRC)."""
    head = identifier << 7 | rtr << 6 | length
    # 19 bits do not fill three bytes. In front, 10101 leaves the stuffing as an idle bus does: one recessive bit.
    inserted, row = 0, _AFTER_ONE
    for byte in (0b10101 << 19 | head).to_bytes(3, "big"):
        stuffed, row = row[byte]
        inserted += stuffed
    behind = 0 if rtr else 8 * length
    return FRAME_BITS + inserted, row, _crc_of_bits(head << behind, 19 + behind)


@lru_cache(1024)  # drives that stand still say the same again and again
def frame_bits(frame: Frame) -> int:
    """Exact length of `frame` on the wire in bit times, from start of frame to the end of the interframe space.

    A remote frame carries no data; its DLC is the length of `frame.data`.
    """
    data = frame.data
    length = len(data)
    bits, row, crc = _start_of_frame(frame.id, frame.rtr, length)
    if not frame.rtr:
        bits += 8 * length
        for table, byte in zip(_BEHIND[length], data):  # noqa: B905 (equally long; `strict` would cost a sixth)
            crc ^= table[byte]
            stuffed, row = row[byte]
            bits += stuffed
    stuffed, row = row[crc >> 7]
    # The last 7 bits of the CRC, filled up with a bit that differs from the last and so cannot add a stuff bit.
    return bits + stuffed + row[crc << 1 & 0xFF | ~crc & 1][0]
