"""Each fault of motion is noticed in time, by the right name, and what must follow follows."""

from __future__ import annotations

from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, cases, play
from scenes_of_motion import MOTION_SCENES


@pytest.mark.sampled(4)
@cases(MOTION_SCENES)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))
