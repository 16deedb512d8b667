from __future__ import annotations

import pytest

from artemis.devices.can_bus import Frame
from artemis.sim.wire import frame_bits


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        # 47 + 8 n bits plus stuff bits, counted by a bit-by-bit implementation with the published CRC
        (Frame(0x080), 47 + 4),
        (Frame(0x701, b"\x05"), 55 + 3),
        (Frame(0x000, b"\x01\x00"), 63 + 5),
        (Frame(0x601, bytes.fromhex("4041600000000000")), 111 + 12),
        (Frame(0x581, bytes.fromhex("4b41600040010000")), 111 + 10),
    ],
    ids=["sync", "heartbeat", "nmt", "sdo request", "sdo response"],
)
def test_usual_frames_have_their_known_lengths(frame: Frame, bits: int) -> None:
    assert frame_bits(frame) == bits


def test_remote_frame_carries_no_data() -> None:
    assert frame_bits(Frame(0x701, b"\x00", rtr=True)) < 47 + 8


def test_frame_near_the_worst_case_stays_within_135_bits() -> None:
    frame = Frame(2032, bytes([60] * 8))  # after the first five equal bits, every fourth is stuffed
    assert frame_bits(frame) == 131
