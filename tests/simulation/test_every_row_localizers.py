"""Each fault of a localizer is noticed in time, by the right name, and what must follow follows."""

from __future__ import annotations

from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, cases, play
from scenes_of_localizers import LOCALIZER_SCENES, SCENE

from artemis.values import Mode


@pytest.mark.slow
@pytest.mark.sampled(3)
@cases(LOCALIZER_SCENES)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    done = play(tmp_path, id, scene)
    assert_follows(done, scene, assert_noticed(done, id, scene))


def test_without_a_fault_nothing_is_noticed(tmp_path: Path) -> None:
    done = play(tmp_path, "LOC-02", SCENE, happens=False)
    assert (done.status, done.fault_ids) == (0, [])
    assert Mode.QUICKSTOP not in done.modes
