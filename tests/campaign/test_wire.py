"""The monitor's reading of the wire, where whole runs show little of it."""

from __future__ import annotations

import pytest

from artemis_lab.campaign.monitor.wire import Boot, Wire
from artemis_lab.campaign.witness import Heard


@pytest.mark.parametrize(
    ("told", "pause", "reset"),
    [
        (bytes((0x82, 3)), 0.25, True),
        (bytes((0x82, 0)), 0.25, True),
        (bytes((0x82, 4)), 0.25, False),
        (bytes((0x81, 3)), 0.25, False),
        (bytes((0x82, 3)), 3.0, False),
    ],
    ids=["this node", "all nodes", "another node", "the whole drive", "long before"],
)
def test_a_start_of_its_communication_is_no_start_of_its_supply(told: bytes, pause: float, reset: bool) -> None:
    wire = Wire([Heard(1.0, 0x000, told), Heard(1.0 + pause, 0x703, b"\0"), Heard(9.0, 0x703, b"\0")], [3, 4], 127)
    assert [boot.reset for boot in wire.nodes[3].all(Boot)] == [reset, False]
