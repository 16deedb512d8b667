"""Scans are numbers packed as bytes."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from artemis.scan import Scan

SCAN = Scan(source="front", time=0.1, start_angle=-1.0, increment=0.5, ranges=b"\x00\x00\xe8\x03\xff\xff")


def test_ranges_are_a_view_of_low_byte_first_millimetres() -> None:
    assert SCAN.millimetres.tolist() == [0, 1000, 65535]
    assert not SCAN.millimetres.flags.owndata, "not copied"
    assert SCAN.strengths.tolist() == []
    with pytest.raises(ValueError, match="read-only"):
        SCAN.millimetres[0] = 1


def test_intensities_are_likewise() -> None:
    assert replace(SCAN, intensities=b"\x01\x02").strengths.tolist() == [513]
