"""What the supervisor hears, how it latches it, and how the worst of it becomes the verdict."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, STEERING, drive, drives
from msgspec.structs import replace
from supervision_rig import COASTING, DRIVING, OFF, STEER_LEFT, STOPPING, UNWATCHED, Watch, bus

from artemis.drive_states import DriveState, Nmt
from artemis.supervision import catalogue
from artemis.supervision.policy import Policy
from artemis.supervision.supervisor import Supervisor
from artemis.values import Fault, Mode, Request, Severity, Verdict

SICK, OTHER = STEERING
WARN, LIMIT, S2, S1, S0 = list(Severity)[1:]
FAULT_STATES = [DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED]


def edge(*ids: str) -> dict[str, Any]:
    """Faults that the edge found, for `tick`."""
    return {"faults": tuple(catalogue.fault(id) for id in ids)}


def test_healthy_robot_has_no_fault() -> None:
    watch = Watch()
    assert {watch.tick() for _ in range(100)} == {Verdict()}


# ---------------------------------------------------------------------------------------------- what drives report


@pytest.mark.parametrize(
    ("codes", "ids"),
    [
        ((0x8611,), ["DRV-25"]),
        ((0x1234,), ["DRV-31"]),
        ((-1,), ["DRV-32"]),
        ((0x2310, 0x3210), ["DRV-02", "DRV-03"]),
        ((0x2310, 0x2310), ["DRV-02"]),
        ((0x0000,), []),
        ((0x0000, 0x8130), ["DRV-20"]),
    ],
)
def test_emergency_is_the_fault_of_its_code(codes: tuple[int, ...], ids: list[str]) -> None:
    watch = Watch()
    watch.ill(SICK, emergencies=codes)
    watch.tick()
    assert watch.found() == [(id, SICK) for id in ids]


@pytest.mark.parametrize("exchange", [True, False])
def test_in_bring_up_a_lost_heartbeat_is_no_news_and_any_other_emergency_is(exchange: bool) -> None:
    watch = Watch()
    watch.wish = replace(UNWATCHED, exchange=exchange)
    watch.ill(SICK, emergencies=(0x8130,))
    watch.ill(OTHER, emergencies=(0x4210,))
    watch.tick()
    assert watch.found() == [("DRV-06", OTHER)]


@pytest.mark.parametrize("state", FAULT_STATES)
def test_fault_state_whose_reason_was_heard_is_only_that_reason(state: DriveState) -> None:
    watch = Watch()
    watch.ill(SICK, state=state, emergencies=(0x2310,))
    watch.tick()
    watch.ill(SICK, state=state)
    for _ in range(10):
        watch.tick()
        assert watch.found() == [("DRV-02", SICK)]


def test_reason_explains_one_stay_in_the_fault_state_and_not_the_next() -> None:
    watch = Watch()
    watch.ill(SICK, state=DriveState.FAULT, emergencies=(0x2310,))
    watch.tick()
    watch.ill(SICK, state=DriveState.FAULT)
    watch.tick()
    assert watch.acknowledge() == Verdict(), "it is told only once"
    watch.well()
    watch.tick()
    watch.ill(SICK, state=DriveState.FAULT)
    watch.tick()
    assert watch.found() == [("COM-01", SICK)]


@pytest.mark.parametrize(("ticks", "found"), [(8, []), (9, [("COM-01", SICK)])])
def test_reason_heard_while_nobody_watched_explains_the_fault_that_shows_soon(
    ticks: int, found: list[tuple[str, str]]
) -> None:
    watch = Watch()
    watch.wish = UNWATCHED
    watch.ill(SICK, emergencies=(0x8130,))
    watch.tick()
    watch.wish = OFF
    watch.well()
    for _ in range(ticks - 1):  # of 20 ms
        watch.tick()
    watch.ill(SICK, state=DriveState.FAULT)
    for _ in range(10):
        watch.tick()
        assert watch.found() == found


def test_fault_may_show_just_after_a_reason_is_old() -> None:
    watch = Watch()
    watch.wish = UNWATCHED
    watch.ill(SICK, emergencies=(0x8130,))
    watch.tick(after=0.0)
    watch.wish = OFF
    watch.well()
    watch.tick(after=0.15)
    watch.ill(SICK, state=DriveState.FAULT)
    watch.tick()
    assert "COM-01" not in watch.ids()


@pytest.mark.parametrize("said", [(), (0x0000,)])
def test_reason_heard_while_nobody_watched_explains_no_other_drive(said: tuple[int, ...]) -> None:
    watch = Watch()
    watch.wish = UNWATCHED
    watch.ill(SICK, emergencies=(0x8130,))
    watch.ill(OTHER, emergencies=said)
    watch.tick()
    watch.wish = OFF
    watch.ill(SICK, state=DriveState.FAULT)
    watch.ill(OTHER, state=DriveState.FAULT)
    watch.tick()
    assert watch.found() == [("COM-01", OTHER)]


def test_reason_of_one_drive_does_not_explain_the_fault_of_another() -> None:
    watch = Watch()
    watch.ill(SICK, state=DriveState.FAULT, emergencies=(0x2310,))
    watch.ill(OTHER, state=DriveState.FAULT)
    watch.tick()
    assert watch.found() == [("COM-01", OTHER), ("DRV-02", SICK)]


def test_another_fault_of_the_drive_does_not_explain_its_state() -> None:
    watch = Watch()
    watch.ill(SICK, mode=9)
    watch.tick()
    watch.ill(SICK, state=DriveState.FAULT)
    watch.tick()
    assert watch.found() == [("COM-01", SICK), ("COM-04", SICK)]


# ---------------------------------------------------------------------------------------------- who is watched


def test_drives_are_not_watched_in_bring_up_and_what_edge_and_mode_report_counts() -> None:
    watch = Watch()
    watch.wish = replace(UNWATCHED, fault=catalogue.fault("COM-08", SICK))
    watch.ill(SICK, boots=1, age=None, heartbeat_age=None, nmt=None, mode=0, jumps=5)
    watch.tick(**edge("PLG-02"))
    assert watch.found() == [("COM-08", SICK), ("PLG-02", "")]


def test_bus_schedule_and_inputs_are_watched_at_all_times() -> None:
    watch = Watch()
    watch.wish = replace(UNWATCHED, exchange=False)
    watch.tick(late=0.2, **bus(foreign=(0x000,), blocked=("a frame",), error_frames=1))
    assert watch.ids() == ["COM-17", "COM-20", "PLG-07", "SYS-01", "SYS-03"]


def test_rolling_is_watched_in_bring_up_once_process_data_is_exchanged() -> None:
    watch = Watch()
    watch.wish = UNWATCHED
    watch.roll(0.3)
    watch.ticks(0.5)
    assert watch.ids() == ["RUN-02"]


def test_a_drive_may_change_its_state_while_nobody_watches() -> None:
    watch = Watch()
    watch.tick()
    watch.wish = UNWATCHED
    watch.ill(SICK, state=DriveState.SWITCH_ON_DISABLED)
    watch.tick()
    watch.wish = DRIVING
    watch.ticks(0.9)
    assert watch.found() == [], "it has the time of a new order"


def test_time_of_an_order_begins_anew_after_nobody_watched() -> None:
    watch = Watch()
    watch.ill(SICK, state=DriveState.READY)
    watch.ticks(0.9)
    watch.wish = UNWATCHED
    watch.tick()
    watch.wish = DRIVING
    watch.ticks(0.9)
    assert watch.found() == []
    assert watch.until("COM-03") == pytest.approx(0.1, abs=2 * PERIOD)


@pytest.mark.parametrize("tick", [0.005, 0.02, 0.04, 0.1])
def test_age_of_feedback_is_judged_by_the_ticks_period(tick: float) -> None:
    limit = max(0.08, 2.5 * tick)
    watch = Watch(tick=tick)
    watch.ill(SICK, age=limit)
    watch.ticks(0.5)
    assert "COM-11" not in watch.ids()
    watch.ill(SICK, age=math.nextafter(limit, 1.0) + 1e-9)
    watch.tick()
    assert ("COM-11", SICK) in watch.found()


@pytest.mark.parametrize("blind", [False, True])
def test_potentiometers_are_watched_unless_their_calibration_means_nothing(blind: bool) -> None:
    watch = Watch()
    watch.supervisor = Supervisor(ROBOT, PERIOD, blind=blind)
    watch.ill(SICK, potentiometers=(1.0, 2.0))
    watch.ticks(0.5)
    assert watch.found() == ([] if blind else [("STE-03", SICK)])


def test_lost_adapter_explains_what_is_not_heard() -> None:
    watch = Watch()
    watch.drive(0.4)
    watch.ticks(0.5)
    for name in NAMES:
        watch.ill(name, age=0.5, heartbeat_age=0.5)
    for _ in range(20):
        watch.tick(**edge("COM-22"))
        assert watch.found() == [("COM-22", "")]
    watch.tick()
    assert "COM-29" in watch.ids(), "without it they are silent"


def test_lost_adapter_does_not_explain_late_ticks() -> None:
    watch = Watch()
    watch.tick(late=0.2, **edge("COM-22"))
    assert watch.ids() == ["COM-22", "SYS-01", "SYS-03"]


# ---------------------------------------------------------------------------------------------- latching

ILL = {"nmt": Nmt.STOPPED}


def test_fault_stays_until_it_is_acknowledged() -> None:
    watch = Watch()
    watch.tick(drives=drives(drive(SICK, emergencies=(0x8611,))))
    for _ in range(100):
        watch.tick()
        assert watch.found() == [("DRV-25", SICK)]
    assert watch.acknowledge() == Verdict()
    assert watch.ticks(1.0) == Verdict()


def test_fault_comes_back_when_its_cause_comes_back() -> None:
    watch = Watch()
    watch.ill(SICK, **ILL)
    watch.tick()
    watch.well()
    watch.tick()
    assert watch.acknowledge() == Verdict()
    watch.ill(SICK, **ILL)
    watch.tick()
    assert watch.found() == [("COM-27", SICK)]


def test_first_words_about_a_fault_are_kept() -> None:
    watch = Watch()
    watch.ill(SICK, age=0.09)
    watch.tick()
    watch.ill(SICK, age=1.09)
    watch.tick()
    assert watch.text("COM-11") == f"{SICK}: feedback lost (90 ms old)"


def test_more_severe_stage_replaces_a_milder_one_and_is_never_replaced_by_it() -> None:
    watch = Watch()
    watch.tick()
    for gap, severity in ((0.12, WARN), (0.16, S2), (0.12, S2)):
        watch.tick(after=gap)
        assert watch.severity("COM-31") is severity
        assert len(watch.found()) == 1
    assert watch.text("COM-31").endswith("(160 ms after the one before)")


FAULTS = [
    catalogue.fault("COM-09", SICK),
    catalogue.fault("RUN-11"),
    catalogue.fault("DRV-02", severity=S0),
]


@pytest.mark.parametrize("order", list(itertools.permutations(FAULTS)))
@pytest.mark.parametrize("at_once", [True, False])
def test_the_worst_wins_in_whatever_order_they_came(order: tuple[Fault, ...], at_once: bool) -> None:
    watch = Watch()
    for faults in [order] if at_once else [(fault,) for fault in order]:
        verdict = watch.tick(faults=faults)
    assert (verdict.severity, verdict.to_fault, verdict.stops, verdict.limits) == (S0, True, True, False)
    assert [fault.id for fault in verdict.faults] == ["DRV-02", "RUN-11", "COM-09"]


def test_of_equal_faults_the_first_is_told_first() -> None:
    watch = Watch()
    for id in ("DRV-25", "DRV-02", "DRV-06"):
        verdict = watch.tick(**edge(id))
    assert [fault.id for fault in verdict.faults] == ["DRV-25", "DRV-02", "DRV-06"]


@pytest.mark.parametrize(
    ("id", "stops", "limits", "to_fault"),
    [("COM-09", False, False, False), ("COM-20", False, True, False), ("RUN-11", True, False, False),
     ("DRV-02", True, False, True)],
)  # fmt: skip
def test_verdict_says_what_follows(id: str, stops: bool, limits: bool, to_fault: bool) -> None:
    verdict = Watch().tick(**edge(id))
    assert (verdict.stops, verdict.limits, verdict.to_fault) == (stops, limits, to_fault)
    assert (verdict.final, verdict.alarm) == (False, False)


def test_fault_of_a_mode_is_latched_like_any_other() -> None:
    watch = Watch()
    watch.wish = replace(DRIVING, fault=catalogue.fault("PTH-05"))
    watch.tick()
    watch.wish = DRIVING
    watch.tick()
    assert watch.found() == [("PTH-05", "")]
    assert watch.acknowledge() == Verdict()


# ---------------------------------------------------------------------------------------------- policies


def test_policy_makes_the_reaction_of_a_row_more_severe() -> None:
    watch = Watch({"INP-03": Policy(reaction=S1), "COM-20": Policy(reaction=S2)})
    verdict = watch.tick(**edge("INP-03"), **bus(error_frames=1))
    assert [(fault.id, fault.severity) for fault in verdict.faults] == [("INP-03", S1), ("COM-20", S2)]
    assert not verdict.to_fault, "where a row leads stays as it is"


def test_policy_does_not_touch_the_milder_stages_of_a_row() -> None:
    watch = Watch({"COM-31": Policy(reaction=S1)})
    watch.tick()
    for gap, severity in ((0.12, WARN), (0.16, S1)):
        watch.tick(after=gap)
        assert watch.severity("COM-31") is severity


def test_policy_shortens_the_time_of_a_row() -> None:
    for watch, seconds in ((Watch(), 0.38), (Watch({"STE-01": Policy(after_s=0.1)}), 0.1)):
        watch.angles[0] = 0.2
        assert watch.until("STE-01") == pytest.approx(seconds, abs=PERIOD + 1e-9)


# ---------------------------------------------------------------------------------------------- escalation


def test_robot_that_does_not_slow_down_is_stopped_harder_each_time() -> None:
    watch = Watch()
    watch.drive(0.6)
    watch.ticks(0.5)
    watch.tick(**edge("RUN-11"))
    watch.drive(0.0, actual=0.6)
    watch.until("RUN-03", severity=S1)
    assert (watch.verdict.severity, watch.verdict.to_fault, watch.verdict.final) == (S1, True, True)
    watch.mode, watch.wish = Mode.FAULT, STOPPING
    assert 0.2 <= watch.until("RUN-03", severity=S0) < 0.6
    watch.wish = COASTING
    assert not watch.verdict.alarm
    watch.ticks(2.0)
    assert watch.verdict.alarm
    assert "PRESS THE EMERGENCY STOP" in watch.text("RUN-03")
    assert watch.verdict.final, "nor is it driven again"
    assert watch.severity("RUN-03") is S0


def test_quick_stop_that_nothing_is_wrong_with_but_that_it_does_not_stop_is_switched_off_next() -> None:
    watch = Watch()
    watch.drive(0.6)
    watch.ticks(0.5)
    watch.wish = STOPPING
    watch.until("RUN-03")
    assert watch.severity("RUN-03") is S0
    assert not watch.verdict.alarm


def test_robot_that_does_not_slow_down_though_it_was_switched_off_raises_the_alarm() -> None:
    watch = Watch()
    watch.drive(0.6)
    watch.ticks(0.5)
    watch.wish = COASTING
    watch.until("RUN-03")
    assert (watch.severity("RUN-03"), watch.verdict.alarm) == (S0, True)


def test_robot_that_slows_down_once_it_is_switched_off_raises_no_alarm() -> None:
    watch = Watch()
    watch.drive(0.6)
    watch.ticks(0.5)
    watch.wish = STOPPING
    watch.until("RUN-03")
    watch.wish, speed = COASTING, 0.6
    while speed > 0.0:
        speed = max(0.0, speed - 0.3 * PERIOD)
        watch.roll(speed)
        watch.tick()
    watch.ticks(1.0)
    assert not watch.verdict.alarm


def test_robot_that_did_not_slow_down_is_not_driven_again() -> None:
    watch = Watch()
    watch.drive(0.6)
    watch.ticks(0.5)
    watch.wish = STOPPING
    watch.until("RUN-03")
    watch.roll(0.0)
    watch.wish = OFF
    watch.ticks(1.0)
    watch.acknowledge()
    assert watch.ids() == ["RUN-03"]
    assert watch.verdict.final


def test_requests_without_a_fault_are_nothing_to_judge() -> None:
    assert Watch().tick(requests=tuple(Request)) == Verdict()


def test_found_of_a_drive_that_steers_is_its_own() -> None:
    watch = Watch()
    watch.ill(STEER_LEFT, boots=1, jumps=2)
    watch.tick()
    assert watch.found() == [("COM-26", STEER_LEFT), ("RUN-10", STEER_LEFT)]
