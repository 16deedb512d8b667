"""The monitor itself: every planted bug is caught, and a sound system has none."""

from __future__ import annotations

import pytest
from bugs import BUGS, Bug, planted
from staged import SCENARIOS, run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", SCENARIOS)
def test_sound_system_breaks_no_invariant(name: str) -> None:
    assert run(SCENARIOS[name], replayed=True).violations == ()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_monitor_catches(bug: Bug) -> None:
    with planted(bug):
        result = run(SCENARIOS[bug.scenario], replayed=bug.replayed)

    assert bug.broken in {violation.invariant for violation in result.violations}, result


def test_there_are_enough_bugs() -> None:
    assert len({bug.name for bug in BUGS}) == len(BUGS) >= 30
