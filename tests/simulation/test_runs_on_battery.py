"""Whole runs of a robot whose battery is described: it runs low, sags, and does not reach to the end."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import MISSIONS, NODE, SDO_REQUEST, Rig, Run, follow, run, straight, write_mission

from artemis.devices.can_bus import Frame
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.values import Mode

CALIBRATE: dict[str, Any] = {"calibrate": {"steering": "from_potentiometers"}}


def drive(folder: Path, *steps: dict[str, Any], battery_v: float = 24.4, metres: float = 3.0, **keys: Any) -> Run:  # noqa: ANN401
    simulation = {"pace": "fast", "true_robot": {"supply": {"battery_v": battery_v}}, **keys}
    files, robot = {"line.csv": straight(metres)}, "artemis_battery.yaml"
    return run(write_mission(folder, [CALIBRATE, *steps], files, robot, simulation=simulation))


@pytest.mark.slow
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


def test_a_battery_that_runs_short_on_the_way_ends_the_step_and_what_is_next_still_runs(tmp_path: Path) -> None:
    """The robot takes five times as much as its file says: what seemed to reach does not, long before it is empty."""
    supply = {"battery_v": 23.5, "idle_w": 100.0}
    simulation = {"pace": "fast", "true_robot": {"supply": supply}}
    caught = {"try": {"steps": [follow(0.5)], "catch": {"battery-short": [{"wait": {"seconds": 1.0}}]}}}
    files = {"line.csv": straight(40.0)}
    mission = write_mission(tmp_path, [CALIBRATE, caught], files, "artemis_battery.yaml", simulation=simulation)
    robot = mission.with_name("artemis.yaml")
    text = robot.read_text().replace("capacity_ah: 17 ", "capacity_ah: 0.4 ")
    robot.write_text(text.replace("joules_per_metre: 85 ", "joules_per_metre: 40 "))
    done = run(mission)
    assert done.status == 0
    assert "PWR-02" not in done.fault_ids
    short = [seen for seen in done.seen if "m to drive, the battery reaches" in seen.phase]
    assert 3.0 < short[0].pose.x < 30.0
    battery = short[0].tick.snapshot.battery
    assert battery is not None
    assert battery.range_m + battery.range_std_m < 40.0 - short[0].pose.x
    assert short[-1].standing
    assert done.seen[-1].tick.snapshot.battery is not None
    assert done.seen[-1].tick.snapshot.battery.charge > 0.08, "it stopped while there was something left"


@pytest.mark.slow
def test_a_condition_that_is_met_in_the_tick_of_battery_short_has_its_steps_done(tmp_path: Path) -> None:
    """The second run is as the first until that tick: at the beginning of a path that the battery does not reach."""

    def watched(folder: Path, seconds: float) -> Run:
        when = {"if": f"run_s > {seconds:.6f}", "steps": [{"wait": {"seconds": 1.0}}], "then": "charged"}
        steps = {
            "steps": [{"during": {"steps": [follow(0.5)], "when": [when]}}],
            "catch": {"charged": [{"say": "full"}]},
        }
        return drive(folder, {"try": steps}, battery_v=22.3)

    def short(done: Run) -> list[float]:
        return [seen.time for seen in done.seen if "m to drive, the battery reaches" in seen.phase]

    late = watched(tmp_path / "late", 1000.0)
    assert late.status == 1
    done = watched(tmp_path / "then", short(late)[0] - 0.001)
    assert short(done)[0] == short(late)[0]
    assert done.status == 0


@pytest.mark.slow
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
    mission = write_mission(tmp_path / "unmeasured", [wait], robot="artemis_battery.yaml")
    unmeasured = mission.with_name("artemis.yaml")
    unmeasured.write_text(re.sub("  measured: .*", "", unmeasured.read_text()))
    with pytest.raises(ConfigError, match="range_m: no drive of this robot measures the supply voltage"):
        load_mission(mission)


@pytest.mark.parametrize(
    ("supply", "problem"),
    [
        (
            {"discharge_v_per_h": 500},
            "discharge_v_per_h: unknown key; the battery is discharged by what the robot takes",
        ),
        (
            {"charger": {"x_m": 0, "y_m": 0, "charge_v_per_h": 2}},
            "charge_v_per_h: unknown key; a charger gives a current",
        ),
    ],
)
def test_keys_of_an_earlier_battery_are_refused_with_what_to_write(
    tmp_path: Path, supply: dict[str, Any], problem: str
) -> None:
    simulation = {"true_robot": {"supply": supply}}
    mission = write_mission(tmp_path, [CALIBRATE], robot="artemis_battery.yaml", simulation=simulation)
    with pytest.raises(ConfigError, match=problem):
        load_mission(mission)


def test_what_is_true_of_a_battery_needs_one_that_is_described(tmp_path: Path) -> None:
    supply = {"battery_v": 25.0, "capacity_scale": 0.9, "idle_w": 9.0, "charger": {"x_m": 0, "y_m": 0}}
    mission = write_mission(tmp_path, [CALIBRATE], simulation={"true_robot": {"supply": supply}})
    with pytest.raises(ConfigError) as refused:
        load_mission(mission)
    told = [problem.partition("supply.")[2] for problem in refused.value.problems]
    assert told == [f"{key}: the robot file describes no `battery`" for key in ("capacity_scale", "idle_w", "charger")]


def on_epos4(mission: Path) -> Path:
    """The mission with four EPOS4, which measure their supply, and the battery of the other robot."""
    robot, battery = mission.with_name("artemis.yaml"), MISSIONS / "robots/artemis_battery.yaml"
    described = yaml.safe_load((MISSIONS / "robots/artemis_epos4.yaml").read_text())
    described["battery"] = yaml.safe_load(battery.read_text())["battery"]
    del described["battery"]["measured"]
    robot.write_text(yaml.safe_dump(described, sort_keys=False))
    return mission


@pytest.mark.slow
def test_an_epos4_tells_the_voltage_of_its_battery(tmp_path: Path) -> None:
    sinking = {"at_s": 22.0, "inject": "PWR-02", "voltage": 21.0, "within_s": 0.2}
    simulation = {"pace": "fast", "true_robot": {"supply": {"battery_v": 24.4}}, "faults": [sinking]}
    files = {"line.csv": straight(6.0)}
    done = run(on_epos4(write_mission(tmp_path, [CALIBRATE, follow(0.5)], files, simulation=simulation)))
    assert (done.status, done.fault_ids) == (1, ["PWR-02"])
    told = [seen.tick.snapshot.sensed.battery_v for seen in done.in_mode(Mode.CALIBRATE)]
    assert told[-1] == pytest.approx(24.3, abs=0.15)
    assert done.recompute().difference is None


def test_a_drive_that_no_longer_tells_its_voltage_stops_the_robot(tmp_path: Path) -> None:
    """Nothing else of it is wrong: its process data and its heartbeat come."""
    mute = False

    def disturb(frame: Frame, _now: float) -> tuple[Frame | None, float]:
        return (None if mute and frame.id == SDO_REQUEST + NODE["traction-left"] else frame), 0.0

    def fall_silent() -> None:
        nonlocal mute
        mute = True

    mission = write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot="artemis_battery.yaml")
    done = Rig(mission, disturb=disturb).while_following(fall_silent, name="mute").run()
    assert (done.status, done.faults[0].id, done.faults[0].device) == (1, "COM-08", "traction-left")
    assert "supply voltage" in done.faults[0].text
    assert "PLG-07" not in done.fault_ids
