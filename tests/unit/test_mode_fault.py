"""Mode fault: how it stops, what it waits for, and where it leads."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from core_builders import (
    NAMES,
    STEERING,
    TRACTION,
    Player,
    drive,
    drives,
    expires,
    fault_of,
    has_event,
    has_fault,
    judged,
    powered,
    shared,
    verdict,
)

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.states.alignment import LOOK_TIME
from artemis.states.fault import FaultMode
from artemis.states.plan import CalibrateStep, Shared
from artemis.supervision import catalogue
from artemis.values import Action, Event, JobKind, JobResult, Request, Verdict


def in_fault(**state: Any) -> tuple[Player, Shared]:
    steps = shared(CalibrateStep(), **{"connected": True, "armed": True, **state})
    player = Player(FaultMode(steps))
    player.world.update(drives=drives(state=DriveState.SWITCH_ON_DISABLED), verdict=verdict("DRV-25"))
    return player, steps


def test_fault_stops_then_switches_off_then_reads_the_error_histories() -> None:
    player, _ = in_fault()
    for _ in range(10):
        wish = player.tick(standing=False)
        assert (wish.traction, wish.steering, wish.command.action) == (Goal.QUICK_STOPPED, Goal.HOLD, Action.QUICKSTOP)
    off = player.tick()
    assert (off.traction, off.steering) == (Goal.DISABLED, Goal.DISABLED)
    asked = player.tick()
    assert {(job.kind, job.drive) for job in asked.jobs} == {(JobKind.READ_HISTORY, name) for name in NAMES}


def test_history_that_cannot_be_read_holds_nothing_up() -> None:
    player, _ = in_fault()
    player.refused |= {(JobKind.READ_HISTORY, name) for name in NAMES}
    player.until(lambda wish: "acknowledge" in wish.phase)


LEFT = TRACTION[0]
DEAF: dict[str, dict[str, Any]] = {
    "age": {"age": 0.1001},
    "never": {"age": None},
    "nmt": {"nmt": Nmt.PRE_OPERATIONAL},
    "unknown": {"nmt": None},
}
STOPS = DriveState.QUICK_STOP_ACTIVE


def halted(player: Player) -> list[str]:
    return [job.drive for job in player.jobs if job.kind is JobKind.HALT]


@pytest.mark.parametrize("sign", DEAF)
def test_driven_wheel_that_takes_no_process_data_is_stopped_by_a_job_once(sign: str) -> None:
    player, _ = in_fault()
    player.world.update(standing=False, drives=drives(drive(LEFT, **DEAF[sign]), state=STOPS))
    for _ in range(10):
        wish = player.tick()
        assert (wish.heartbeat, wish.traction) == (True, Goal.QUICK_STOPPED)
    assert halted(player) == [LEFT]


@pytest.mark.parametrize("standing", [False, True])
def test_driven_wheel_that_is_still_enabled_a_tenth_of_a_second_after_the_stop_is_unresponsive(standing: bool) -> None:
    player, _ = in_fault()
    enabled = drive(LEFT, state=DriveState.OPERATION_ENABLE)
    player.world.update(standing=standing, drives=drives(enabled, state=STOPS))
    for _ in range(5):
        player.tick()
    assert halted(player) == []
    player.tick()
    player.tick()
    assert halted(player) == [LEFT]


def test_wheels_that_turn_unresponsive_one_after_the_other_are_each_stopped_by_a_job() -> None:
    player, _ = in_fault()
    player.world.update(standing=False)
    for names in ((), TRACTION[:1], TRACTION):
        player.world["drives"] = drives(*(drive(name, **DEAF["nmt"]) for name in names))
        player.tick()
    assert halted(player) == list(TRACTION)


def test_drives_that_are_heard_and_steering_that_is_not_need_no_job_to_stop() -> None:
    player, _ = in_fault()
    quiet = drive(LEFT, age=0.1, state=STOPS), drive(STEERING[0], age=None)
    player.world.update(standing=False, drives=drives(*quiet, state=STOPS))
    for _ in range(10):
        player.tick()
    assert halted(player) == []


def test_heartbeat_ends_where_an_unresponsive_wheel_cannot_be_stopped_either() -> None:
    player, _ = in_fault()
    player.refused.add((JobKind.HALT, LEFT))
    player.world.update(standing=False, drives=drives(drive(LEFT, **DEAF["nmt"])))
    assert [player.tick().heartbeat for _ in range(5)] == [True, False, False, False, False]
    player.world.update(standing=True)
    assert player.until(lambda wish: wish.traction is Goal.DISABLED).heartbeat, "all stand: it may begin again"


def test_fault_before_the_drives_were_configured_stops_them_by_jobs_and_exchanges_nothing() -> None:
    player, _ = in_fault(connected=False)
    player.world["standing"] = False
    player.until(lambda wish: "acknowledge" in wish.phase)
    for wish in player.wishes:
        assert not wish.exchange
        assert not wish.heartbeat, "a heartbeat that begins here and ends again trips every drive that has heard it"
    secured = [(JobKind.SECURE, name) for name in NAMES]
    assert [(job.kind, job.drive) for job in player.jobs] == secured + [(JobKind.KEEP_OFF, name) for name in NAMES]


def test_drives_without_our_configuration_are_kept_off_again_and_again_while_a_person_is_waited_for() -> None:
    player, _ = in_fault(connected=False)
    player.until(lambda wish: "acknowledge" in wish.phase)
    asked = [player.time]
    for _ in range(20):
        if jobs := player.tick().jobs:
            assert [(job.kind, job.drive) for job in jobs] == [(JobKind.KEEP_OFF, name) for name in NAMES]
            asked.append(player.time)
    assert [later - before for before, later in pairwise(asked)] == pytest.approx([LOOK_TIME] * 4)


def test_drives_that_do_not_answer_are_not_asked_twice_at_a_time() -> None:
    player, _ = in_fault(connected=False)
    player.until(lambda wish: "acknowledge" in wish.phase)
    asked = player.jobs[-len(NAMES) :]
    answers = [JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, fault="COM-08") for job in asked]
    for late in ((), answers[:3]):
        for _ in range(10):
            assert player.tick(results=late).jobs == ()
    wish = player.tick(results=answers[3:])
    assert len(wish.jobs) == len(NAMES)
    assert wish.fault is None


def test_drive_that_somebody_else_switched_on_is_named() -> None:
    player, _ = in_fault(connected=False)
    player.until(lambda wish: "acknowledge" in wish.phase)
    looks = player.jobs[-len(NAMES) :]
    found = [
        JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True, values=(1,) * (job.drive == LEFT))
        for job in looks
    ]
    assert player.tick(results=found).phase == f"stopped what another master switched on: {LEFT}"
    assert player.tick().phase == "acknowledge to bring the drives up again"


def test_drives_that_exchange_process_data_or_that_another_artemis_has_are_not_looked_at() -> None:
    for connected, fault in ((True, "DRV-25"), (False, "COM-18")):
        player, _ = in_fault(connected=connected)
        player.world["verdict"] = verdict(fault)
        for _ in range(60):
            player.tick()
        assert {job.kind for job in player.jobs} <= {JobKind.READ_HISTORY}


def test_drive_that_cannot_be_secured_is_a_fault_and_tried_until_it_is() -> None:
    player, _ = in_fault(connected=False)
    player.refused.add((JobKind.SECURE, LEFT))
    assert fault_of(player.until(has_fault)) == ("COM-08", LEFT)
    for _ in range(20):
        wish = player.tick()
        assert wish.fault is None, "said once"
        assert LEFT in wish.phase
    assert sum(job.drive == LEFT for job in player.jobs) > 10
    assert sum(job.drive != LEFT for job in player.jobs if job.kind is JobKind.SECURE) == 3
    player.refused.clear()
    player.tick()
    assert LEFT not in player.tick().phase
    number = len(player.jobs)
    player.tick()
    assert len(player.jobs) == number


def test_second_artemis_that_has_not_configured_the_drives_ends_without_a_job() -> None:
    player, _ = in_fault(connected=False)
    player.world["verdict"] = judged("COM-18", final=True)
    wish = player.until(has_event)
    assert (wish.event, wish.exchange, wish.heartbeat, wish.failed) == (Event.END, False, False, True)
    assert player.jobs == []


def test_second_artemis_that_is_heard_while_drives_are_secured_gets_no_further_job() -> None:
    player, _ = in_fault(connected=False)
    player.refused.update((JobKind.SECURE, name) for name in NAMES)
    player.until(lambda wish: bool(wish.jobs))
    player.world["verdict"] = judged("COM-18", final=True)
    assert player.until(has_event).event is Event.END
    assert {job.drive for job in player.jobs} == set(TRACTION)


def test_drives_of_ours_are_stopped_where_another_artemis_begins() -> None:
    player, _ = in_fault()
    player.world.update(verdict=judged("COM-18", final=True), attended=True)
    assert player.tick(standing=False).traction is Goal.QUICK_STOPPED


def waiting_for_acknowledgment(**state: Any) -> tuple[Player, Shared]:
    player, steps = in_fault(**state)
    player.until(lambda wish: "acknowledge" in wish.phase)
    return player, steps


def test_acknowledged_fault_leads_to_a_bring_up_that_waits_for_arm() -> None:
    player, steps = waiting_for_acknowledgment()
    wish = player.tick(requests=(Request.ACKNOWLEDGE,), verdict=Verdict())
    assert wish.event is Event.ACKNOWLEDGED
    assert not powered(wish)
    assert not steps.bring_up.armed


def test_acknowledgment_is_refused_while_the_cause_is_there_and_the_cause_is_named() -> None:
    player, _ = waiting_for_acknowledgment()
    wish = player.tick(requests=(Request.ACKNOWLEDGE,), verdict=verdict("COM-22"))
    assert wish.event is None
    assert "CAN adapter lost" in wish.phase
    assert player.tick().event is None, "refused, not kept"


def test_no_other_request_leads_out_of_fault() -> None:
    player, _ = waiting_for_acknowledgment()
    assert player.tick(requests=(Request.ARM, Request.DONE)).event is None


def test_nobody_there_to_acknowledge_ends_the_run_as_failed() -> None:
    player, _ = waiting_for_acknowledgment()
    wish = player.tick(attended=False)
    assert (wish.event, wish.failed) == (Event.END, True)


@pytest.mark.parametrize("attended", [True, False])
def test_run_ends_when_nobody_acknowledges_for_ten_minutes(attended: bool) -> None:
    """Neither who is there, nor who may still come."""
    player, _ = waiting_for_acknowledgment()
    player.world.update(attended=attended, awaited=True)
    expires(player)


# ---------------------------------------------------------------------------------------------- recovery


@pytest.mark.parametrize(
    ("ids", "reset"),
    [
        (("DRV-25",), ""),
        (("DRV-19",), "communication"),
        (("COM-26",), "node"),
        (("COM-26", "DRV-19"), "node"),
        (("DRV-19", "COM-26"), "node"),
        (("DRV-19", "DRV-25"), "communication"),
    ],
)
def test_reset_that_a_drive_needs_is_kept_though_its_fault_is_acknowledged_early(
    ids: tuple[str, ...], reset: str
) -> None:
    player, steps = in_fault()
    player.world["verdict"] = Verdict()
    player.tick(standing=False, verdict=judged(*ids, device="steer-left"))
    player.tick(standing=False, requests=(Request.ACKNOWLEDGE,))
    assert player.until(has_event).event is Event.ACKNOWLEDGED
    assert steps.bring_up.resets["steer-left"] == reset


def test_reset_of_a_fault_that_came_later_does_not_weaken_that_of_the_first() -> None:
    player, steps = in_fault()
    for ids in (("COM-26",), ("DRV-19",)):
        player.tick(standing=False, verdict=judged(*ids, device="steer-left"))
    assert steps.bring_up.resets["steer-left"] == "node"


@pytest.mark.parametrize(
    ("state", "says", "armed"),
    [
        ({"armed": True}, {"recovers": True}, True),
        ({"armed": False}, {"recovers": True}, False),
        ({"armed": False}, {"recovers": True, "resumes": True}, True),
        ({"armed": False, "held": True}, {"recovers": True, "resumes": True}, False),
    ],
)
def test_fault_that_is_over_by_itself_leads_on_and_arms_only_where_the_mission_says_so(
    state: dict[str, bool], says: dict[str, Any], armed: bool
) -> None:
    player, steps = in_fault(**state)
    player.world["verdict"] = judged("COM-11", **says)
    assert player.until(lambda wish: wish.phase == "recovers automatically").event is None
    assert player.tick(verdict=Verdict()).event is Event.ACKNOWLEDGED
    assert steps.bring_up.armed is armed


def test_fault_that_no_acknowledgment_helps_says_so() -> None:
    player, _ = in_fault()
    player.world["verdict"] = judged("STE-04", final=True)
    wish = player.until(lambda wish: "this run cannot continue" in wish.phase)
    assert catalogue.ROWS["STE-04"].text in wish.phase
    assert wish.event is None
