"""A hard stop that is found is the stop: what else holds the motor is passed or refused, and never taken for it."""

from __future__ import annotations

from math import degrees, radians
from pathlib import Path
from typing import Any

import pytest
import yaml
from rig import MISSIONS, Rig, Run
from test_angle_sensors import mission

from artemis.values import Mode

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
NAME = "small_car"
STEERING = "steering"
TIMES = [1.1, 1.3, 1.6, 2.0, 2.4, 2.8, 3.3, 3.7, 4.3, 4.9, 5.5, 6.2, 7.0, 8.1, 9.3, 10.4, 11.0, 11.6, 12.2]
"""From the beginning of the search to straight wheels [s]."""
PASSING = [
    ("COM-12", 0.2),
    ("COM-12", 0.07),
    ("STE-01", 0.15),
    ("STE-02", 0.07),
    ("STE-02", 0.25),
    ("STE-02", 0.6),
    ("STE-02", 2.0),
]
"""What holds the motor for a moment, and for how long [s]."""
UNSTATED = {"angle": "hard_stop", "stop_deg": 47.0}
STATED = {**UNSTATED, "travel_deg": 94.0}


def car(**middle: object) -> dict[str, Any]:
    """The small car, with these words about its steering motor."""
    robot: dict[str, Any] = yaml.safe_load((MISSIONS / f"robots/{NAME}.yaml").read_text())
    if middle:
        robot["calibration"]["steering"]["middle"] = middle
    return robot


def true_angle(seen: Run, time: float) -> float:
    """Of the wheels [degrees]; 0 is truly straight."""
    return degrees(sum(seen.truth_at(time).wheel_angles) / 2.0)


def homed_or_refused(seen: Run) -> bool:
    """Whether it drove; a robot that drives does so with wheels that were truly straight at first."""
    driving = seen.in_mode(Mode.FOLLOW)
    if not driving:
        assert seen.status == 1
        assert seen.faults
        return False
    assert abs(true_angle(seen, driving[0].now)) < 0.6
    return seen.status == 0


@pytest.mark.sampled(4)
@pytest.mark.parametrize("at_s", TIMES)
def test_what_holds_the_motor_for_a_moment_is_not_taken_for_the_stop(at_s: float, tmp_path: Path) -> None:
    drove = 0
    for number, (id, seconds) in enumerate(PASSING):
        (tmp_path / str(number)).mkdir()
        fault = {"at_s": at_s, "inject": id, "node": STEERING, "duration_s": seconds}
        file = mission(tmp_path / str(number), car(), {"start_steering_middle_deg": -9.0}, [fault])
        drove += homed_or_refused(Rig(file, longest=120.0).run())
    assert drove >= 3, "and most of it is passed"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("source", [UNSTATED, STATED], ids=["unstated", "stated"])
@pytest.mark.parametrize("held_at", [-20.0, 10.0, 20.0, 30.0, 39.0])
def test_a_kerb_is_not_taken_for_the_stop(held_at: float, source: dict[str, Any], tmp_path: Path) -> None:
    seen = against_kerb(tmp_path, source, (-47.0, held_at))
    assert not homed_or_refused(seen)
    assert [fault.id for fault in seen.faults][:1] == ["CAL-03"]


@pytest.mark.parametrize("held_at", [40.5, 43.0, 44.5])
def test_a_kerb_near_the_stop_is_found_by_the_way_between_both_stops(held_at: float, tmp_path: Path) -> None:
    seen = against_kerb(tmp_path, STATED, (-47.0, held_at))
    assert not homed_or_refused(seen)
    assert "the robot file says 94" in seen.faults[0].text


@pytest.mark.parametrize("held_at", [-44.0, -20.0, 5.0])
def test_a_kerb_on_the_other_side_is_told(held_at: float, tmp_path: Path) -> None:
    assert not homed_or_refused(against_kerb(tmp_path, STATED, (held_at, 47.0)))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("leaves", [4.0, 5.0, 6.0, 7.0, 8.0])
def test_a_kerb_that_gives_way_is_not_taken_for_the_stop(leaves: float, tmp_path: Path) -> None:
    homed_or_refused(against_kerb(tmp_path, UNSTATED, (-47.0, 20.0), leaves))


def against_kerb(folder: Path, source: dict[str, Any], ends: tuple[float, float], leaves: float = 200.0) -> Run:
    """A run whose wheels turn no farther than to both `ends` [degrees] until it `leaves` [s]."""
    rig = Rig(
        mission(folder, car(**source), {"start_steering_middle_deg": -25.0 if ends[1] < 0.0 else 12.0}), longest=120.0
    )

    def turns_to(low: float, high: float) -> None:
        assert rig.world is not None
        rig.world.steered[STEERING].stops = radians(low), radians(high)

    return rig.at(0.2, lambda: turns_to(*ends)).at(leaves, lambda: turns_to(-47.0, 47.0), "leaves").run()
