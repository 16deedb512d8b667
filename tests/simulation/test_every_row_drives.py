"""Each error of a drive is noticed in time and stops the robot, also where its message is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, cases, name_of, play, scenes
from scenes_of_drives import DRIVE_SCENES, LEFT, SILENT, UNHEARD, of_code


@pytest.mark.sampled(4)
@cases(DRIVE_SCENES)
def test_error_of_a_drive_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


@pytest.mark.sampled(12)
@pytest.mark.parametrize(("id", "scene"), scenes(UNHEARD), ids=name_of)
def test_error_whose_message_is_lost_is_seen_in_the_statusword(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


def test_collision_whose_message_is_lost_is_not_seen_but_in_the_history(tmp_path: Path) -> None:
    run = play(tmp_path, SILENT, of_code(SILENT, 0x8150, LEFT, heard=False))
    assert (run.status, run.fault_ids) == (0, [])
    assert run.world.drive(LEFT).read(0x1003, 1) == 0x8150
