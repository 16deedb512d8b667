"""Whole runs of a robot whose battery is described: it runs low, sags, and does not reach to the end."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rig import Run, follow, run, straight, write_mission

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.values import Mode

CALIBRATE: dict[str, Any] = {"calibrate": {"steering": "from_potentiometers"}}


def drive(folder: Path, *steps: dict[str, Any], battery_v: float = 24.4, metres: float = 3.0, **keys: Any) -> Run:  # noqa: ANN401
    simulation = {"pace": "fast", "true_robot": {"supply": {"battery_v": battery_v}}, **keys}
    files, robot = {"line.csv": straight(metres)}, "artemis_battery.yaml"
    return run(write_mission(folder, [CALIBRATE, *steps], files, robot, simulation=simulation))


def test_a_path_that_the_battery_does_not_reach_is_not_begun(tmp_path: Path) -> None:
    done = drive(tmp_path / "alone", follow(0.5), battery_v=22.3)
    assert done.status == 1
    assert Mode.FOLLOW not in [seen.mode for seen in done.seen if seen.tick.set_points.speed]
    assert "3 m to drive, the battery reaches 0 m" in [seen.phase for seen in done.seen]
    caught = {"try": {"steps": [follow(0.5)], "catch": {"battery-short": [{"say": "not far enough"}]}}}
    assert drive(tmp_path / "caught", caught, battery_v=22.3).status == 0


def test_all_that_a_list_of_steps_follows_counts_before_it_is_begun(tmp_path: Path) -> None:
    """10.5 % are left, half a percent of it to use: about 170 m."""
    near, far = follow(0.5), follow(0.5, "far.csv")
    robot = {"line.csv": straight(3.0), "far.csv": straight(400.0)}
    simulation = {"pace": "fast", "true_robot": {"supply": {"battery_v": 22.5}}}
    mission = write_mission(tmp_path, [CALIBRATE, near, far], robot, "artemis_battery.yaml", simulation=simulation)
    done = run(mission)
    assert done.status == 1
    assert [seen.phase for seen in done.seen if "403 m to drive" in seen.phase]


def test_a_robot_whose_voltage_sags_accelerates_half_as_much(tmp_path: Path) -> None:
    def rises(folder: Path, **keys: Any) -> float:  # noqa: ANN401
        done = drive(folder, follow(0.5), **keys)
        speeds = [seen.tick.set_points.speed for seen in done.seen]
        assert done.status == 0
        assert max(speeds) == pytest.approx(0.5)
        return max(after - before for before, after in pairwise(speeds)) * 50

    sag = {"at_s": 6.0, "inject": "PWR-03", "voltage": 19.0, "duration_s": 0.6}
    assert rises(tmp_path / "well") == pytest.approx(0.5, abs=0.02)
    assert rises(tmp_path / "sagging", faults=[sag]) == pytest.approx(0.25, abs=0.02)


def test_a_mission_may_ask_what_is_left(tmp_path: Path) -> None:
    wait = {"wait": {"for": "charge_percent < 60 and range_m > 1000 and time_left_s > 3600", "at_most_s": 60}}
    done = drive(tmp_path, wait)
    assert (done.status, done.seen[-1].time < 20.0) == (0, True)


def test_a_battery_that_is_nearly_empty_stops_the_robot(tmp_path: Path) -> None:
    sinking = {"at_s": 8.0, "inject": "PWR-02", "voltage": 21.0, "within_s": 0.2}
    done = drive(tmp_path, follow(0.5), faults=[sinking])
    assert (done.status, done.fault_ids) == (1, ["PWR-02"])


def test_signals_of_a_battery_need_one_that_is_described_and_measured(tmp_path: Path) -> None:
    wait = {"wait": {"for": "charge_percent < 30 or range_m < 50 or time_left_s < 60"}}
    with pytest.raises(ConfigError) as refused:
        load_mission(write_mission(tmp_path / "none", [wait]))
    told = [problem.partition("steps[0].wait.for: ")[2] for problem in refused.value.problems]
    names = "charge_percent", "range_m", "time_left_s"
    assert told == [f"{name}: the robot file describes no `battery`" for name in names]
    bus = {"interface": "socketcan", "channel": "can0"}
    with pytest.raises(ConfigError, match="range_m: no drive of this robot measures the supply voltage"):
        load_mission(write_mission(tmp_path / "bus", [wait], robot="artemis_battery.yaml", bus=bus))
