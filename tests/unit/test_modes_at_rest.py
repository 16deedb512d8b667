"""Stopping, standing and ending: quickstop, fault, end."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from typing import Any

import pytest
from core_builders import (
    NAMES,
    PERIOD,
    ObedientDrives,
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
    snapshot,
    verdict,
)

from artemis.drive_states import DriveState, Goal
from artemis.motion.perception import STANDING_TIME
from artemis.states.alignment import OFF_TIME
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.hands import hands_on
from artemis.states.mode import LISTEN, ModeLogic, RoutineMode
from artemis.states.plan import CalibrateStep, Shared
from artemis.states.quickstop import QuickstopMode
from artemis.supervision import catalogue
from artemis.values import (
    Action,
    DriveCommand,
    Event,
    JobKind,
    JobResult,
    OperatorInput,
    Request,
    SetPoints,
    Verdict,
    Wish,
)

ALL_OFF = {"drives": drives(state=DriveState.SWITCH_ON_DISABLED)}


# ---------------------------------------------------------------------------------------------- quickstop

STOPPED = {"standing": True, **ALL_OFF}


def quickstop(**state: Any) -> tuple[Player, Shared]:
    steps = shared(CalibrateStep(), **{"connected": True, "aligned": True, "armed": False, **state})
    return Player(QuickstopMode(steps)), steps


def stopped(**state: Any) -> tuple[Player, Shared]:
    """A quick stop that is over: the robot stood long enough, its drives are off."""
    player, steps = quickstop(**state)
    player.world.update(STOPPED)
    player.until(is_off)
    return player, steps


def is_off(wish: Wish) -> bool:
    return (wish.traction, wish.steering) == (Goal.DISABLED, Goal.DISABLED)


def test_quick_stop_is_the_traction_drives_own_and_steering_holds() -> None:
    player, _ = quickstop()
    wish = player.tick(standing=False)
    assert (wish.traction, wish.steering, wish.command.action) == (Goal.QUICK_STOPPED, Goal.HOLD, Action.QUICKSTOP)


def test_controlled_stop_ramps_down_with_the_drives_enabled_and_the_wheels_held() -> None:
    player, _ = quickstop()
    wish = player.tick(standing=False, verdict=verdict("INP-03"), set_points=SetPoints(speed=0.3, steering=0.2))
    assert powered(wish)
    assert wish.command == DriveCommand(speed=0.0, steering=0.2)
    for _ in range(5):
        assert powered(player.tick(verdict=verdict("INP-03"))), "and holds them when it stands"


def test_controlled_stop_with_a_drive_that_is_off_becomes_a_quick_stop() -> None:
    player, _ = quickstop()
    one_off = drives(drive("traction-left", state=DriveState.SWITCH_ON_DISABLED))
    assert player.tick(standing=False, verdict=verdict("INP-03"), drives=one_off).traction is Goal.QUICK_STOPPED


def test_drives_are_switched_off_once_the_robot_stands() -> None:
    player, _ = quickstop()
    for _ in range(20):
        assert player.tick(standing=False).traction is Goal.QUICK_STOPPED
    assert is_off(player.tick())


def test_what_stood_a_moment_ago_may_just_have_begun_to_move() -> None:
    player, _ = quickstop()
    for _ in range(round(STANDING_TIME / PERIOD)):
        assert player.tick().traction is Goal.QUICK_STOPPED
    player.until(is_off, longest=2 * PERIOD)


def test_drives_are_switched_off_at_the_latest_after_the_stop_time() -> None:
    player, _ = quickstop()
    player.world["standing"] = False
    player.until(lambda wish: wish.traction is Goal.DISABLED)
    assert player.time == pytest.approx(1.0 + 2 * 0.7 / 1.5, abs=2 * PERIOD), "twice the robot's own, and a second"


def test_drives_that_were_not_configured_are_stopped_by_jobs_and_not_judged() -> None:
    player, _ = quickstop(connected=False, aligned=False)
    while player.time < 0.4:
        wish = player.tick(standing=False)
        assert bool(wish.jobs) <= (player.time > LISTEN), "listening comes first"
        assert not wish.exchange
        assert not wish.heartbeat
        assert not wish.supervised
    then_kept_off = [(kind, name) for kind in (JobKind.SECURE, JobKind.KEEP_OFF) for name in NAMES]
    assert [(job.kind, job.drive) for job in player.jobs] == then_kept_off
    assert player.tick(requests=(Request.ARM,)).event is Event.ACKNOWLEDGED


def test_drive_that_was_not_configured_and_cannot_be_stopped_is_a_fault_and_never_called_stopped() -> None:
    player, _ = quickstop(connected=False, aligned=False)
    player.refused.add((JobKind.SECURE, "traction-right"))
    assert fault_of(player.until(has_fault)) == ("COM-08", "traction-right")
    for _ in range(5):
        assert player.tick(requests=(Request.ARM,)).event is None
    assert not any("stopped" in wish.phase for wish in player.wishes)


def test_stop_takes_the_arm_of_a_bring_up() -> None:
    player, steps = quickstop(armed=True)
    player.enter()
    assert not steps.bring_up.armed


@pytest.mark.parametrize("mode", ["quickstop", "end"])
def test_unresponsive_drive_is_stopped_by_a_job_in_every_stop_or_by_our_silence(mode: str) -> None:
    player = quickstop()[0] if mode == "quickstop" else Player(EndMode(shared(connected=True)))
    player.refused.add((JobKind.HALT, "traction-left"))
    enabled = drive("traction-left", state=DriveState.OPERATION_ENABLE)
    player.world.update(standing=False, drives=drives(enabled, state=DriveState.QUICK_STOP_ACTIVE))
    player.until(lambda wish: bool(wish.jobs), longest=0.2)
    assert [(job.kind, job.drive) for job in player.jobs] == [(JobKind.HALT, "traction-left")]
    for _ in range(10):
        assert not player.tick().heartbeat


def test_stop_that_is_asked_for_again_and_again_gives_an_unresponsive_drive_no_heartbeat_back() -> None:
    player, steps = quickstop()
    player.refused.add((JobKind.HALT, "traction-left"))
    player.world["standing"] = False
    for _ in range(8):  # more often than a drive needs to be found unresponsive
        player._entered = False
        player.tick()
    assert [job.drive for job in player.jobs] == ["traction-left", "traction-right"], "each once"
    assert not player.tick().heartbeat
    assert not EndMode(steps).step(snapshot(player.time, standing=False)).heartbeat, "nor does the end"


@pytest.mark.parametrize("mode", [QuickstopMode, FaultMode])
def test_steering_drive_that_does_not_switch_off_is_switched_off_by_sdo(mode: type[RoutineMode]) -> None:
    player = Player(mode(shared(CalibrateStep(), connected=True, aligned=True)))
    on = drive("steer-left", state=DriveState.OPERATION_ENABLE)
    player.world.update(STOPPED, drives=drives(on, state=DriveState.SWITCH_ON_DISABLED))
    player.until(
        lambda wish: any(job.kind is JobKind.HALT for job in wish.jobs), longest=STANDING_TIME + OFF_TIME + 0.1
    )
    assert [job.drive for job in player.jobs if job.kind is JobKind.HALT] == ["steer-left"]
    assert player.wishes[-1].heartbeat
    player.world.update(drives=drives(state=DriveState.SWITCH_ON_DISABLED))
    player.until(lambda wish: wish.phase != "switching off", longest=3 * PERIOD)


@pytest.mark.parametrize("mode", [QuickstopMode, FaultMode])
def test_drive_that_cannot_be_switched_off_hears_no_heartbeat_until_it_has_noticed(mode: type[RoutineMode]) -> None:
    player = Player(mode(shared(CalibrateStep(), connected=True, aligned=True)))
    player.refused.add((JobKind.HALT, "steer-left"))
    on = drive("steer-left", state=DriveState.OPERATION_ENABLE)
    player.world.update(STOPPED, drives=drives(on, state=DriveState.SWITCH_ON_DISABLED))
    player.until(lambda wish: not wish.heartbeat, longest=STANDING_TIME + OFF_TIME + 0.1)
    silent = player.time
    player.until(lambda wish: wish.heartbeat, longest=1.0)
    assert player.time - silent > 0.5, "twice what the drives watch, and more"


def test_quick_stop_during_a_controlled_stop_makes_it_a_quick_one() -> None:
    player, _ = quickstop()
    held: dict[str, Any] = {"standing": False, "verdict": verdict("INP-03")}
    assert powered(player.tick(**held))
    player.enter(snapshot(requests=(Request.QUICKSTOP,), **held))
    assert player.tick(requests=(Request.QUICKSTOP,), **held).traction is Goal.QUICK_STOPPED
    assert player.tick(**held).traction is Goal.QUICK_STOPPED, "and it stays one"


def test_drives_stay_held_after_a_controlled_stop_whose_cause_was_acknowledged() -> None:
    player, _ = quickstop()
    assert powered(player.tick(standing=False, verdict=verdict("INP-03")))
    assert powered(player.tick())
    assert player.tick(requests=(Request.ARM,)).event is Event.REARMED
    assert player.jobs == []
    assert all(map(powered, player.wishes))


def test_nobody_there_to_arm_ends_the_run_as_failed() -> None:
    player, _ = quickstop()
    player.world["attended"] = False
    for _ in range(20):
        assert player.tick(standing=False).event is None, "not before it stands"
    wish = player.until(has_event)
    assert (wish.event, wish.failed) == (Event.END, True)


def test_a_stop_that_holds_the_drives_under_power_waits_for_nobody_who_only_may_come() -> None:
    player, _ = quickstop()
    player.world.update(attended=False, awaited=True)
    assert powered(player.tick(standing=False, verdict=verdict("INP-03")))
    wish = player.until(has_event)
    assert (wish.event, wish.failed, wish.phase) == (Event.END, True, "no operator to arm")


@pytest.mark.parametrize("attended", [True, False])
def test_quickstop_waits_for_arm(attended: bool) -> None:
    """Also for somebody who may still come, as long as the drives are off."""
    player, _ = quickstop()
    player.world.update(attended=attended, awaited=True)
    player.world.update(STOPPED)
    for _ in range(100):
        wish = player.tick()
        assert not powered(wish)
        assert wish.event is None
    assert "arm" in wish.phase
    assert not any(wish.failed for wish in player.wishes)


@pytest.mark.parametrize(
    "obstacle",
    [{"verdict": verdict("INP-03")}, {"inputs": (OperatorInput(source="stick", neutral=False),)}],
    ids=["latched fault", "controls not released"],
)
def test_arm_is_refused_while_something_stands_against_it(obstacle: dict[str, Any]) -> None:
    player, _ = stopped()
    assert player.tick(requests=(Request.ARM,), **obstacle).event is None
    for _ in range(50):
        wish = player.tick()
        assert not powered(wish), "the arm was refused, not kept"


def test_operator_is_told_what_stands_against_arming() -> None:
    player, _ = stopped()
    assert catalogue.ROWS["INP-03"].text in player.tick(verdict=verdict("INP-03", "stick")).phase
    assert "release" in player.tick(inputs=(OperatorInput(source="stick", neutral=False),)).phase


def test_armed_quickstop_clears_the_targets_then_enables_then_is_ready() -> None:
    player, _ = quickstop()
    robot = ObedientDrives()
    player = Player(player.mode, robot.react)
    player.until(is_off)
    ordered = player.tick(requests=(Request.ARM,))
    assert {(job.kind, job.drive) for job in ordered.jobs} == {(JobKind.CLEAR_TARGET, name) for name in NAMES}
    assert not powered(ordered)
    assert player.until(has_event).event is Event.REARMED
    assert set(robot.states.values()) == {DriveState.OPERATION_ENABLE}
    assert {wish.command.speed for wish in player.wishes} == {0.0}


def test_target_that_cannot_be_cleared_is_a_fault_and_nothing_is_enabled() -> None:
    player, _ = stopped()
    player.refused.add((JobKind.CLEAR_TARGET, "traction-right"))
    player.tick(requests=(Request.ARM,))
    assert fault_of(player.until(has_fault)) == ("COM-08", "traction-right")
    assert not any(map(powered, player.wishes))


def test_failed_target_is_the_fault_that_its_job_met() -> None:
    player, _ = stopped()
    (job, *others) = player.tick(requests=(Request.ARM,)).jobs
    ended = [JobResult(id=each.id, kind=each.kind, drive=each.drive, ok=True) for each in others]
    kept = JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=False, detail="kept 7", fault="COM-10")
    wish = player.tick(results=(kept, *ended))
    assert fault_of(wish) == ("COM-10", job.drive)
    assert "kept 7" in str(wish.fault)


def test_armed_before_the_wheels_were_aligned_leads_to_a_new_bring_up() -> None:
    player, steps = stopped(aligned=False)
    wish = player.tick(requests=(Request.ARM,))
    assert wish.event is Event.ACKNOWLEDGED
    assert not powered(wish)
    assert steps.bring_up.armed, "which need not be armed again"


# ---------------------------------------------------------------------------------------------- recovery of a stop


@pytest.mark.parametrize("attended", [True, False])
def test_stop_that_is_over_by_itself_goes_on_only_where_the_mission_says_so(attended: bool) -> None:
    for resumes in (True, False):
        player, _ = quickstop()
        player.world.update(STOPPED, attended=attended, verdict=judged("INP-03", recovers=True, resumes=resumes))
        player.until(is_off)
        player.tick()
        wish = player.tick(verdict=Verdict())
        kinds = {job.kind for job in wish.jobs}
        assert kinds == ({JobKind.CLEAR_TARGET} if resumes else set())
        assert (wish.event is Event.END) is (not resumes and not attended)


def test_stop_by_a_person_never_goes_on_by_itself() -> None:
    player, _ = quickstop(held=True)
    player.world.update(STOPPED, verdict=judged("INP-03", recovers=True, resumes=True))
    player.until(is_off)
    player.tick()
    for _ in range(20):
        assert player.tick(verdict=Verdict()).jobs == ()
    assert player.tick(verdict=Verdict(), requests=(Request.ARM,)).jobs


@pytest.mark.parametrize("when", ["while it stops", "at rest"])
def test_stop_that_a_person_acknowledged_goes_on_only_by_an_arm(when: str) -> None:
    player, _ = quickstop()
    player.world.update(STOPPED, verdict=judged("INP-03", recovers=True, resumes=True))
    if when == "while it stops":
        player.tick(requests=(Request.ACKNOWLEDGE,))
    player.until(is_off)
    if when == "at rest":
        player.tick(requests=(Request.ACKNOWLEDGE,))
    for _ in range(20):
        assert player.tick(verdict=Verdict()).jobs == ()
    assert player.tick(verdict=Verdict(), requests=(Request.ARM,)).jobs


def test_run_ends_when_nobody_arms_for_ten_minutes() -> None:
    expires(stopped()[0])


# ---------------------------------------------------------------------------------------------- end


def ending(**state: Any) -> Player:
    return Player(EndMode(shared(CalibrateStep(), **{"connected": True, **state})), ObedientDrives(ON_STATE).react)


ON_STATE = DriveState.OPERATION_ENABLE


def test_ordered_end_stops_switches_off_disarms_and_then_ends_the_heartbeat() -> None:
    player = ending()
    for _ in range(5):
        assert player.tick(standing=False).traction is Goal.QUICK_STOPPED
    last = player.until(lambda wish: wish.finished)
    off = next(number for number, wish in enumerate(player.wishes) if is_off(wish))
    assert all(map(is_off, player.wishes[off:]))
    disarm = next(number for number, wish in enumerate(player.wishes) if wish.jobs)
    assert disarm > off, "off before disarmed"
    assert [(job.kind, job.drive) for job in player.jobs] == [(JobKind.DISARM, name) for name in NAMES], (
        "traction first"
    )
    beats = [wish.heartbeat for wish in player.wishes]
    assert beats == [True] * (len(beats) - 1) + [False], "the heartbeat lasts until the very end"
    assert not player.wishes[-2].exchange, "and its last comes alone"
    assert not last.exchange


def test_ordered_end_judges_no_drive_any_more() -> None:
    player = ending()
    player.until(lambda wish: wish.finished)
    assert not any(wish.supervised for wish in player.wishes)


def test_drive_that_does_not_switch_off_does_not_hold_the_end_up_for_long() -> None:
    player = ending()
    player.world["drives"] = drives(state=DriveState.QUICK_STOP_ACTIVE)
    player.until(lambda wish: wish.finished, longest=1.0)
    assert {job.kind for job in player.jobs} == {JobKind.DISARM}


def test_drives_that_refuse_to_be_disarmed_do_not_hold_the_end_up() -> None:
    player = ending()
    player.refused |= {(JobKind.DISARM, name) for name in NAMES}
    player.until(lambda wish: wish.finished, longest=1.0)
    assert [fault_of(wish) for wish in player.wishes if wish.failed] == [("COM-34", name) for name in NAMES]


def test_end_before_the_drives_were_configured_only_disarms() -> None:
    player = ending(connected=False)
    player.until(lambda wish: wish.finished, longest=1.0)
    assert all(wish.phase == "listening" for wish in player.wishes[:14]), "not a frame before that"
    assert not any(wish.exchange for wish in player.wishes)
    assert not any(wish.heartbeat for wish in player.wishes[:-2])
    assert {job.kind for job in player.jobs} == {JobKind.DISARM}


def test_end_of_a_second_artemis_sends_nothing() -> None:
    player = ending(connected=False)
    player.world["verdict"] = judged("COM-18", final=True)
    player.until(lambda wish: wish.finished, longest=1.0)
    assert not any(wish.exchange or wish.heartbeat or wish.jobs for wish in player.wishes)


def test_ended_stays_ended() -> None:
    player = ending()
    player.until(lambda wish: wish.finished)
    assert all(player.tick().finished for _ in range(5))


def test_mode_without_being_entered_enters_itself() -> None:
    mode: ModeLogic = EndMode(shared())
    assert mode.step(snapshot(1.0)).jobs


def test_a_device_that_said_nothing_yet_has_to_be_moved_once() -> None:
    unknown, pushed = OperatorInput(source="stick", neutral=False), OperatorInput(source="pad", neutral=False, age=0.0)
    assert hands_on([unknown]) == "release the controls; stick was not heard yet: move it once"
    assert hands_on([pushed]) == "release the controls"
    assert hands_on([OperatorInput(source="stick")]) is None
