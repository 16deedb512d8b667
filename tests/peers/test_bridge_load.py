"""Three readers lose nothing: eight seconds of what `python -m tests.peers.bridge_load` does for ten minutes."""

from __future__ import annotations

import pytest

pytest.importorskip("rosbags", reason="needs the extra ros: pip install 'artemis-robot[ros]'")
pytest.importorskip("cyclonedds", reason="needs the extra ros2: pip install 'artemis-robot[ros2]'")
pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")

from bridge_load import OF, READERS, TOPICS, measure

pytestmark = [pytest.mark.realtime, pytest.mark.exhaustive]

SECONDS = 8.0


@pytest.mark.parametrize("of", OF)
def test_nothing_is_lost(of: str) -> None:
    found = measure(of, SECONDS)
    assert len(found) == READERS * len(TOPICS)
    assert [told.lost for told in found] == [0] * len(found)
