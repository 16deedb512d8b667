"""How long something has to be wrong until it is a fault, and what an extra tick changes of that."""

from __future__ import annotations

import pytest
from core_builders import PERIOD, STEERING
from supervision_rig import Watch

from artemis.values import Severity

SICK, OTHER = STEERING

# ---------------------------------------------------------------------------------------------- how long


@pytest.mark.parametrize(("early", "found"), [(1e-6, True), (1.05e-6, False)])
def test_time_of_a_row_is_over_a_millionth_of_a_second_early(early: float, found: bool) -> None:
    watch = Watch()
    watch.ill(SICK, frames=3)
    watch.tick(after=0.0)
    watch.tick(after=0.08 - early)
    assert bool(watch.found()) is found, "time in floating point is not exact"


def test_each_row_has_its_own_time() -> None:
    watch = Watch()
    watch.ill(SICK, current=1.9)
    watch.ticks(0.2)
    watch.angles[0] = 0.2
    assert watch.until("STE-01") == pytest.approx(0.38, abs=PERIOD)


def test_each_drive_has_its_own_time() -> None:
    watch = Watch()
    watch.ill(SICK, current=1.9)
    watch.ticks(0.2)
    watch.ill(OTHER, current=1.9)
    watch.ticks(0.2)
    assert watch.found() == [("STE-02", SICK)]


def test_each_limit_of_a_row_has_its_own_time() -> None:
    watch = Watch()
    watch.drive(0.4)
    watch.speeds = 0.4, 0.28
    watch.ticks(1.0)
    assert watch.severity("RUN-05") is Severity.LIMIT
    watch.speeds = 0.4, 0.0
    assert watch.until("RUN-05", severity=Severity.CONTROLLED_STOP) > 0.12


# ---------------------------------------------------------------------------------------------- extra ticks


def test_extra_ticks_are_never_late_and_interrupt_no_time() -> None:
    watch = Watch()
    for late, urgent in ((0.03, False), (0.0, True), (0.03, False), (0.0, True)):
        watch.tick(late=late, urgent=urgent, after=0.0 if urgent else PERIOD)
        assert watch.found() == []
    watch.tick(late=0.03)
    assert watch.found() == [("SYS-01", "")]


def test_extra_ticks_keep_the_time_of_the_motion() -> None:
    watch = Watch()
    watch.angles[0] = 0.2
    while watch.time < 0.37:
        watch.tick()
        watch.tick(urgent=True, after=0.001)
    assert watch.found() == []
    watch.ticks(0.06)
    assert watch.found() == [("STE-01", SICK)]


def test_extra_tick_begins_the_time_of_what_it_sees() -> None:
    watch = Watch()
    watch.ill(SICK, frames=3)
    watch.tick(urgent=True)
    watch.ticks(0.06)
    assert watch.found() == []
    watch.tick()
    assert watch.found() == [("COM-15", SICK)]


def test_motion_is_not_measured_in_extra_ticks() -> None:
    watch = Watch()
    for _ in range(20):
        watch.distances[0] += 0.1
        watch.tick(urgent=True)
    assert watch.found() == []
