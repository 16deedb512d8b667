"""What the benchmark of a map that is made while driving maps, and what it prints."""

from __future__ import annotations

import numpy as np
import pytest

from artemis.mapping.mapper import Mapper
from artemis_lab.bench.laser_worlds import SETTINGS
from artemis_lab.commands import bench_live_map as bench


def test_the_robot_sees_the_building_fifty_times_a_second() -> None:
    given = bench.readings(2.0)
    assert len(given) == 100
    assert given[-1].time == pytest.approx(1.98)
    last = given[-1].odometry
    assert last is not None
    assert last[:2] == pytest.approx([1.03 * 1.5 * 1.98, 0.04], abs=0.02)
    mapper = Mapper(SETTINGS)
    for reading in given:
        assert reading.points is not None
        mapper.add(reading)
    assert mapper.counts.unmatched == 0
    assert np.hypot(*mapper.pose[:2]) == pytest.approx(1.5 * 1.98, abs=0.05), "scans measure what the wheels do not"


@pytest.mark.parametrize(("name", "other"), [("LONGEST", "LONGEST_ON_MAP"), ("LONGEST_ON_MAP", "LONGEST")])
@pytest.mark.parametrize(("bar", "status"), [(1e9, 0), (0.0, 1)])
def test_a_missed_bar_is_the_exit_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, other: str, bar: float, status: int
) -> None:
    monkeypatch.setattr(bench, "warm_up", lambda: None)
    monkeypatch.setattr(bench, name, bar)
    monkeypatch.setattr(bench, other, 1e9)
    assert bench.measure(0.2, lambda seconds: None) == status
    assert capsys.readouterr().out.startswith("10 scans of 541 beams, 50 a second, with")
