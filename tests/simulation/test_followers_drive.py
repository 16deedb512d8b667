"""The followers of others drive the figure-eight against simulated drives, frame by frame."""

from __future__ import annotations

from pathlib import Path

import pytest
from rig import CALIBRATE, MISSIONS, run, write_mission

pytestmark = [pytest.mark.slow, pytest.mark.short_alignment]
PATH = (MISSIONS / "paths" / "figure_eight.csv").read_text()


@pytest.mark.slow
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("plugin", "nearness"),
    [("pure_pursuit", 0.08), ("stanley", 0.22)],  # cut corners; and the rear axle inside the front axle's distance
)
def test_a_follower_drives_the_figure_eight(tmp_path: Path, plugin: str, nearness: float) -> None:
    follow = {"path": "eight.csv", "follower": {"plugin": plugin, "speed_m_s": 0.4}}
    seen = run(write_mission(tmp_path, [CALIBRATE, {"follow": follow}], {"eight.csv": PATH}), longest=120.0)
    assert (seen.status, seen.fault_ids) == (0, [])
    assert seen.is_done
    assert nearness / 4 < seen.cross_track() < nearness
