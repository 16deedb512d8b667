"""`artemis bench hall`: what it runs, and what counts."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.report.summary import Summary
from artemis.values import Pose
from artemis_lab.bench import hall
from artemis_lab.bench.hall import GlobalStart, begun, copied, followed, places
from artemis_lab.commands.bench_hall import grid, is_good

MISSIONS = Path(__file__).parents[2] / "missions"
FIGURES = {"true_cross_track_rms": 0.011, "odometry_error_max": 14.0, "faults": (), "duration": 3600.0, "distance": 1e3}
DRIVE = Summary(**{field.name: None for field in fields(Summary)} | FIGURES)  # type: ignore[arg-type]


@pytest.fixture
def patrol(tmp_path: Path) -> Path:
    return copied(MISSIONS / "patrol_hall.yaml", tmp_path / "mission")


def test_only_missions_that_follow_a_path_on_a_map_are_driven(tmp_path: Path) -> None:
    for name in ("figure_eight", "map_hall"):
        with pytest.raises(ConfigError, match=f"{name}.yaml: expected a mission with the localizer scan_map"):
            copied(MISSIONS / f"{name}.yaml", tmp_path / name)


def test_places_are_free_on_the_map_and_those_of_the_seed(patrol: Path) -> None:
    found = places(patrol, 4, 7)
    assert found == places(patrol, 4, 7)
    assert found != places(patrol, 4, 8)
    assert all(-4 < place.x < 15 and -3 < place.y < 8 for place in found)
    assert not any(2 < place.x < 8 and 1.9 < place.y < 2.9 for place in found), "a shelf stands there"


@pytest.mark.slow
def test_a_robot_is_found_where_it_is_switched_on(patrol: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hall, "STANDS", 6.0)
    start = begun(patrol, Pose(x=9.0, y=5.2, heading=2.6))
    assert 3.0 < start.after < 6.0
    assert start.off < 0.04


@pytest.mark.slow
def test_a_path_is_followed_for_the_time_given(patrol: Path) -> None:
    drive = followed(patrol, 0.3)
    assert drive.duration == pytest.approx(18.0, abs=1.0)
    assert drive.true_cross_track_rms is not None
    assert drive.odometry_error_max is not None
    assert drive.odometry_error_max > 0.1
    assert load_mission(patrol).mission.steps == load_mission(MISSIONS / patrol.name).mission.steps


def test_each_bar_can_fail() -> None:
    here = Pose()
    found = GlobalStart(place=here, after=4.5, off=0.01)
    assert is_good(DRIVE, [found])
    for wrong in (replace(found, after=math.inf), replace(found, after=21.0), replace(found, off=0.4)):
        assert not is_good(DRIVE, [found, wrong])
        assert ("started without a hint, found", "1 of 2", "all") in grid(DRIVE, [found, wrong]).rows
    assert not is_good(replace(DRIVE, true_cross_track_rms=0.021), [found])
    assert not is_good(replace(DRIVE, true_cross_track_rms=None), [found])
    assert not is_good(replace(DRIVE, odometry_error_max=0.9), [found])
    assert not is_good(replace(DRIVE, faults=("LOC-03",)), [found])
