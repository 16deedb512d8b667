from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_epos_rig import STEERING, STEERING_4, Rig

from artemis.drive_schema import Drive
from artemis.sim.cia402_power import PATTERNS_402
from artemis.sim.epos_power import PATTERNS

NODE = STEERING.node_id
IDENTIFIERS = (0x000, 0x080, 0x180 + NODE, 0x200 + NODE, 0x300 + NODE, 0x400 + NODE, 0x500 + NODE, 0x700 + NODE, 0x77F)

frames = st.tuples(st.sampled_from(IDENTIFIERS), st.binary(max_size=8), st.booleans())
commands = st.tuples(
    st.just(0x000), st.sampled_from((1, 2, 0x80, 0x81, 0x82)).map(lambda n: bytes((n, 0))), st.just(False)
)
controlwords = st.tuples(
    st.just(0x200 + NODE),
    st.sampled_from((0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x3F, 0x5F, 0x0B, 0x80)).map(lambda n: bytes((n, 0))),
    st.just(False),
)
objects = st.sampled_from(
    (0x1016, 0x1017, 0x1400, 0x1600, 0x1800, 0x1A00, 0x2004, 0x2062, 0x3000, 0x6040, 0x6060, 0x607A, 0x60C2, 0x60FF)
)
requests = st.builds(
    lambda command, index, sub, data: (
        0x600 + NODE,
        bytes((command,)) + index.to_bytes(2, "little") + sub + data,
        False,
    ),
    st.sampled_from((0x00, 0x10, 0x21, 0x22, 0x23, 0x2B, 0x2F, 0x40, 0x60, 0x70, 0x80, 0xA0)),
    objects,
    st.sampled_from((b"\0", b"\1", b"\2")),
    st.binary(min_size=4, max_size=4),
)


@pytest.mark.parametrize("drive", [STEERING, STEERING_4], ids=["epos1", "epos4"])
@given(traffic=st.lists(st.tuples(frames | commands | controlwords | requests, st.integers(0, 30)), max_size=40))
def test_no_frames_whatever_bring_the_node_out_of_step(
    drive: Drive, traffic: list[tuple[tuple[int, bytes, bool], int]]
) -> None:
    patterns = PATTERNS if drive is STEERING else PATTERNS_402
    rig = Rig(drive)
    for (identifier, data, rtr), pause in traffic:
        rig.send(identifier, data, rtr=rtr)
        rig.run(pause * 0.001)
        rig.node.advance(rig.now)
        rig._drain()
        assert rig.node.next_due > rig.now, "the owner would never get past this time"
        status = rig.node.read(0x6041)
        assert isinstance(status, int)
        assert status & 0x417F in patterns.values()
        assert math.isfinite(rig.axis.position)
        assert math.isfinite(rig.axis.current)
    assert all(len(answer) == 8 for answer in rig.take(0x580 + NODE))
    assert all(len(frame.data) <= 8 for _, frame in rig.heard)
