"""What drives of other families report, and what happens to them, is noticed in time and stops the robot."""

from __future__ import annotations

from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, name_of, play
from scenes_of_families import MACHINES

ERRORS = [(id, scene) for machine in MACHINES.values() for id, scene in machine.of_errors()]
OTHERS = [(id, scene) for machine in MACHINES.values() for id, scene in machine.of_others()]


@pytest.mark.sampled(36)
@pytest.mark.parametrize(("id", "scene"), ERRORS, ids=name_of)
def test_error_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


@pytest.mark.sampled(60)
@pytest.mark.parametrize(("id", "scene"), OTHERS, ids=name_of)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))
