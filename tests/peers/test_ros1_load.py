"""Three subscribers lose nothing: 20 s of what `python -m tests.peers.ros1_load` does for ten minutes."""

from __future__ import annotations

import pytest

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")

from ros1_load import SUBSCRIBERS, TOPICS, measure

pytestmark = [pytest.mark.realtime, pytest.mark.exhaustive]

SECONDS = 20.0


def test_nothing_is_lost_in_twenty_seconds() -> None:
    found = measure(SECONDS)
    assert len(found) == SUBSCRIBERS * len(TOPICS)
    assert [heard.lost for heard in found] == [0] * len(found)
