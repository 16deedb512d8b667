"""The monitor itself: every planted bug is caught, and a sound system has none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from _pytest.mark import ParameterSet
from bugs import BUGS, HELD_ONCE, Bug, planted
from staged import LEFT, OF_CIA402, OF_EPOS4, REAR_DRIVEN, RIGHT, SCENARIOS, SMALL_CAR, STEER, drive, fault, follow, run

pytestmark = pytest.mark.slow


@pytest.mark.slow
@pytest.mark.sampled(20)
@pytest.mark.parametrize("name", SCENARIOS)
def test_sound_system_breaks_no_invariant(name: str) -> None:
    assert run(SCENARIOS[name], replayed=True).violations == ()


@pytest.mark.parametrize(
    "given", [fault("COM-26", 12.0, RIGHT), fault("COM-27", 16.0, STEER), fault("DRV-29", 11.5, LEFT)]
)
def test_what_an_epos4_tells_otherwise_breaks_no_invariant(given: dict[str, Any]) -> None:
    assert run(follow(given), OF_EPOS4).violations == ()


def test_inner_wheel_of_a_rear_driven_robot_stops_with_the_robot() -> None:
    given = drive(rows="9,0,1,1\n9.3,1,1,1\n12,1,1,0\n13,0,0,0\n", seconds=8.0, top=0.6)
    assert run(given, REAR_DRIVEN).violations == ()


@pytest.mark.parametrize("robot", [OF_CIA402, pytest.param(OF_EPOS4, marks=pytest.mark.exhaustive)])
def test_monitor_sees_how_drives_of_other_families_are_enabled(robot: Path) -> None:
    (bug,) = [bug for bug in BUGS if bug.name == "nobody asks who the drives are"]
    assert run(SCENARIOS[bug.scenario], robot).violations == ()
    with planted(bug):
        result = run(SCENARIOS[bug.scenario], robot)
    assert bug.broken in {violation.invariant for violation in result.violations}, result


def test_monitor_judges_wheels_that_were_held_for_a_moment() -> None:
    given = drive(fault("STE-02", 2.0, "steering", duration_s=0.25))
    assert run(given, SMALL_CAR).violations == ()
    with planted(HELD_ONCE):
        result = run(given, SMALL_CAR)
    assert HELD_ONCE.broken in {violation.invariant for violation in result.violations}, result


def planted_bugs() -> Iterator[ParameterSet]:
    """All of them; `make test` plants the first one for each invariant."""
    broken: set[str] = set()
    for bug in BUGS:
        yield pytest.param(bug, id=bug.name, marks=[pytest.mark.exhaustive] if bug.broken in broken else [])
        broken.add(bug.broken)


@pytest.mark.parametrize("bug", list(planted_bugs()))
def test_monitor_catches(bug: Bug) -> None:
    with planted(bug):
        result = run(SCENARIOS[bug.scenario], replayed=bug.replayed)

    assert bug.broken in {violation.invariant for violation in result.violations}, result


def test_there_are_enough_bugs() -> None:
    assert len({bug.name for bug in BUGS}) == len(BUGS) >= 30
