"""Modes that run a step of the plan, as pure logic: hand-made snapshots in, wishes out."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from typing import Any

import pytest
from core_builders import (
    NAMES,
    PERIOD,
    ROUTE,
    ObedientDrives,
    Player,
    StubFollower,
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
from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal
from artemis.states.calibrate import CalibrateMode
from artemis.states.mode import ON, finish_jobs
from artemis.states.modes import Modes
from artemis.states.plan import BringUp, CalibrateStep, FollowStep, Shared, Step, TeleopStep, WaitStep
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.values import (
    Action,
    Cause,
    DriveCommand,
    Event,
    Fault,
    JobKind,
    JobResult,
    Mode,
    OperatorInput,
    Request,
    SetPoints,
    Severity,
    Snapshot,
    Verdict,
    Wish,
)

# ---------------------------------------------------------------------------------------------- from mode to mode

WAYS: dict[Mode, list[Event]] = {
    Mode.INIT: [],
    Mode.READY: [Event.ALIGNED],
    Mode.CALIBRATE: [Event.ALIGNED, Event.CALIBRATE],
    Mode.TELEOP: [Event.ALIGNED, Event.TELEOP],
    Mode.FOLLOW: [Event.ALIGNED, Event.FOLLOW],
    Mode.ACT: [Event.ALIGNED, Event.ACT],
    Mode.QUICKSTOP: [Event.STOP],
    Mode.FAULT: [Event.FAULT],
    Mode.END: [Event.END],
}


def modes_in(mode: Mode, steps: Shared | None = None) -> Modes:
    modes = Modes(steps or shared(CalibrateStep(), connected=True, aligned=True))
    for event in WAYS[mode]:
        modes.advance(snapshot(), event)
    assert modes.mode is mode
    return modes


def mode_after(modes: Modes, seen: Snapshot, wished: Event | None) -> Mode:
    modes.advance(seen, wished)
    return modes.mode


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_has_logic_that_bears_silent_drives(mode: Mode) -> None:
    silent = tuple(drive(name, state=DriveState.UNKNOWN, age=None, nmt=None, heartbeat_age=None) for name in NAMES)
    modes = modes_in(mode)
    for tick in range(10):
        assert isinstance(modes.step(snapshot(tick * PERIOD, drives=silent)), Wish)


STOP, DRIVE_FAULT = verdict("INP-03"), verdict("DRV-25")
SEVERE = Verdict(severity=Severity.QUICK_STOP, faults=STOP.faults)
DRIVE = DRIVE_FAULT.faults
ENDED = (Request.END,)
ASKED_STOP = Cause(event=Event.STOP, request=Request.QUICKSTOP)


@pytest.mark.parametrize(
    ("present", "seen", "wished", "following"),
    [
        (Mode.FOLLOW, {}, None, Mode.FOLLOW),
        (Mode.FOLLOW, {}, Event.DONE, Mode.READY),
        (Mode.FOLLOW, {"requests": ENDED}, Event.DONE, Mode.END),
        (Mode.FOLLOW, {"requests": (Request.END, Request.QUICKSTOP)}, Event.DONE, Mode.QUICKSTOP),
        (Mode.FOLLOW, {"requests": ENDED, "verdict": STOP}, Event.DONE, Mode.QUICKSTOP),
        (Mode.FOLLOW, {"requests": (Request.QUICKSTOP,), "verdict": DRIVE_FAULT}, Event.DONE, Mode.FAULT),
        (Mode.QUICKSTOP, {}, Event.REARMED, Mode.READY),
        (Mode.QUICKSTOP, {"requests": (Request.QUICKSTOP,)}, Event.REARMED, Mode.QUICKSTOP),
        (Mode.QUICKSTOP, {"verdict": SEVERE}, Event.REARMED, Mode.QUICKSTOP),
        (Mode.QUICKSTOP, {"verdict": STOP}, None, Mode.QUICKSTOP),
        (Mode.QUICKSTOP, {"verdict": DRIVE_FAULT}, Event.REARMED, Mode.FAULT),
        (Mode.FAULT, {"requests": (Request.QUICKSTOP,), "verdict": DRIVE_FAULT}, None, Mode.FAULT),
        (Mode.FAULT, {"requests": ENDED, "verdict": DRIVE_FAULT}, None, Mode.END),
        (Mode.END, {"requests": (Request.QUICKSTOP,), "verdict": DRIVE_FAULT}, Event.DONE, Mode.END),
    ],
)
def test_most_urgent_event_wins(present: Mode, seen: dict[str, Any], wished: Event | None, following: Mode) -> None:
    modes = modes_in(present)
    modes.advance(snapshot(**seen), wished)
    assert modes.mode is following


@pytest.mark.parametrize(
    ("present", "seen", "wished", "cause"),
    [
        (Mode.FOLLOW, {}, None, None),
        (Mode.FOLLOW, {}, Event.DONE, Cause(event=Event.DONE)),
        (Mode.FOLLOW, {}, Event.REARMED, None),
        (Mode.FOLLOW, {"verdict": STOP}, Event.DONE, Cause(event=Event.STOP, faults=STOP.faults)),
        (Mode.FOLLOW, {"requests": (Request.QUICKSTOP,), "verdict": STOP}, None, ASKED_STOP),
        (Mode.QUICKSTOP, {"requests": (Request.QUICKSTOP,)}, None, ASKED_STOP),
        (Mode.FOLLOW, {"verdict": judged("COM-13", "INP-03", "DRV-25")}, None, Cause(event=Event.FAULT, faults=DRIVE)),
        (Mode.FAULT, {"verdict": DRIVE_FAULT}, None, None),
        (Mode.FAULT, {"verdict": DRIVE_FAULT}, Event.END, Cause(event=Event.END, faults=DRIVE)),
        (Mode.FAULT, {"verdict": DRIVE_FAULT, "requests": ENDED}, None, Cause(event=Event.END, request=Request.END)),
        (Mode.READY, {"requests": ENDED}, Event.END, Cause(event=Event.END, request=Request.END)),
        (Mode.READY, {}, Event.END, Cause(event=Event.END)),
    ],
)
def test_cause_of_a_mode_is_what_changed_it(
    present: Mode, seen: dict[str, Any], wished: Event | None, cause: Cause | None
) -> None:
    assert modes_in(present).advance(snapshot(**seen), wished) == cause


@pytest.mark.parametrize("severity", Severity)
def test_robot_is_stopped_from_a_controlled_stop_on(severity: Severity) -> None:
    fault = Fault(id="X", severity=severity, text="x", to_fault=False)
    seen = snapshot(verdict=Verdict(severity=severity, faults=(fault,)))
    modes = modes_in(Mode.TELEOP)
    modes.advance(seen, None)
    assert (modes.mode is Mode.QUICKSTOP) is (severity >= Severity.CONTROLLED_STOP)


@pytest.mark.parametrize(("steps", "failed"), [((CalibrateStep(),), True), ((), False)])
def test_run_that_is_ended_before_its_last_step_has_failed(steps: tuple[Any, ...], failed: bool) -> None:
    modes = modes_in(Mode.READY, shared(*steps))
    modes.advance(snapshot(requests=ENDED), None)
    assert modes.failed is failed


def test_milder_stop_does_not_begin_a_stop_anew_and_a_more_severe_one_does_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    modes = modes_in(Mode.QUICKSTOP)
    entered: list[Snapshot] = []
    monkeypatch.setattr(modes._logic[Mode.QUICKSTOP], "enter", entered.append)
    for found, times in ((STOP, 0), (SEVERE, 1), (SEVERE, 1), (STOP, 1)):
        modes.advance(snapshot(verdict=found), None)
        assert len(entered) == times


def test_end_that_was_asked_for_during_a_stop_comes_after_it() -> None:
    modes = modes_in(Mode.FOLLOW)
    assert mode_after(modes, snapshot(requests=(Request.END, Request.QUICKSTOP)), None) is Mode.QUICKSTOP
    assert modes.advance(snapshot(), None) == Cause(event=Event.END, request=Request.END)
    assert modes.mode is Mode.END


def test_end_that_a_mode_asked_for_during_a_stop_comes_after_it() -> None:
    for found, stopped in ((SEVERE, Mode.QUICKSTOP), (DRIVE_FAULT, Mode.FAULT)):
        modes = modes_in(Mode.QUICKSTOP)
        assert mode_after(modes, snapshot(verdict=found), Event.END) is stopped
        assert mode_after(modes, snapshot(verdict=found), None) is Mode.END


def test_run_that_ends_with_a_fault_has_failed_though_its_steps_are_done() -> None:
    modes = modes_in(Mode.READY, shared())
    assert mode_after(modes, snapshot(verdict=DRIVE_FAULT), Event.END) is Mode.FAULT
    assert mode_after(modes, snapshot(verdict=DRIVE_FAULT), None) is Mode.END
    assert modes.failed


def test_power_is_off_where_nothing_else_is_left_and_the_alarm_ends_the_heartbeat() -> None:
    for alarm in (False, True):
        off = Verdict(severity=Severity.OFF, faults=DRIVE_FAULT.faults, to_fault=True, alarm=alarm)
        wish = modes_in(Mode.FAULT).step(snapshot(standing=False, verdict=off))
        assert (wish.command.action, wish.traction, wish.steering) == (Action.DISABLE, Goal.DISABLED, Goal.HOLD)
        assert wish.heartbeat is not alarm


@pytest.mark.parametrize(
    ("says", "armed", "held"),
    [
        ({}, True, True),
        ({"recovers": True}, False, True),
        ({"recovers": True}, True, False),
        ({"recovers": True, "resumes": True}, False, False),
    ],
)
def test_fault_that_may_not_go_on_by_itself_waits_for_an_arm_whatever_recovers_later(
    says: dict[str, Any], armed: bool, held: bool
) -> None:
    steps = shared(CalibrateStep(), connected=True, aligned=True)
    modes = modes_in(Mode.READY, steps)
    steps.bring_up.armed = armed
    modes.advance(snapshot(verdict=judged("DRV-25", **says)), None)
    assert steps.bring_up.held is held
    modes.advance(snapshot(verdict=judged("SYS-01", recovers=True, resumes=True)), None)
    modes.advance(snapshot(), None)
    assert steps.bring_up.held is held, "until a person arms"


def test_what_does_not_stop_the_robot_needs_no_arm() -> None:
    steps = shared(CalibrateStep(), connected=True, aligned=True, armed=False)
    modes_in(Mode.READY, steps).advance(snapshot(verdict=judged("COM-13")), None)
    assert not steps.bring_up.held


def test_mode_that_is_entered_again_begins_anew() -> None:
    modes = modes_in(Mode.QUICKSTOP)
    stopped = snapshot(verdict=Verdict(), drives=drives(state=DriveState.SWITCH_ON_DISABLED))
    modes.step(stopped)
    assert modes.step(snapshot(0.2, drives=stopped.sensed.drives)).traction is Goal.DISABLED
    modes.advance(stopped, Event.REARMED)
    modes.advance(snapshot(0.3, standing=False, requests=(Request.QUICKSTOP,)), None)
    assert modes.step(snapshot(0.3, standing=False)).traction is Goal.QUICK_STOPPED


# ---------------------------------------------------------------------------------------------- jobs


def test_jobs_are_wished_once_and_waited_for_until_the_last_has_ended() -> None:
    jobs = BringUp().jobs(JobKind.SECURE, NAMES[:2])
    waiting = finish_jobs(ON, jobs)
    assert next(waiting).jobs == jobs
    ended = [JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True) for job in jobs]
    stranger = JobResult(id=99, kind=JobKind.SECURE, drive="steer-left", ok=True)
    for results in ((), (ended[1],), (stranger,)):
        assert waiting.send(snapshot(results=results)) == ON
    with pytest.raises(StopIteration) as returned:
        waiting.send(snapshot(0.1, results=(ended[0],)))
    results, last = returned.value.value
    assert results == tuple(ended), "in the order of the jobs"
    assert last.time == 0.1


# ---------------------------------------------------------------------------------------------- ready, calibrate

STEPS: list[tuple[Step, Event]] = [
    (CalibrateStep(), Event.CALIBRATE),
    (FollowStep(route=ROUTE, follower=StubFollower()), Event.FOLLOW),
    (TeleopStep(input="stick", seconds=None), Event.TELEOP),
]


@pytest.mark.parametrize(("step", "event"), STEPS)
def test_ready_asks_for_the_mode_of_the_step(step: Any, event: Event) -> None:
    assert Player(ReadyMode(shared(step))).tick(inputs=(OperatorInput(source="stick"),)).event is event


def test_ready_walks_the_plan_to_its_end() -> None:
    steps = shared(*(step for step, _ in STEPS), WaitStep(seconds=0.1))
    player = Player(ReadyMode(steps))
    player.world["inputs"] = (OperatorInput(source="stick"),)
    for _, event in STEPS:
        assert player.tick().event is event
        assert player.tick().event is event, "until the step is done"
        steps.advance(Wish(over=True), snapshot(), standing=True)
    assert player.until(has_event).event is Event.END
    assert steps.current is None


def test_ready_waits_as_long_as_the_step_says() -> None:
    steps = shared(WaitStep(seconds=1.0), WaitStep(seconds=0.5))
    player = Player(ReadyMode(steps))
    player.until(has_event)
    assert player.time == pytest.approx(1.5, abs=0.1)


def test_ready_stands_enabled_with_the_wheels_where_they_are() -> None:
    wish = Player(ReadyMode(shared(WaitStep(seconds=1.0)))).tick(set_points=SetPoints(steering=0.3))
    assert powered(wish)
    assert wish.command == DriveCommand(speed=0.0, steering=0.3)


def test_teleop_begins_only_with_the_controls_released() -> None:
    player = Player(ReadyMode(shared(TeleopStep(input="stick", seconds=None))))
    for _ in range(5):
        assert player.tick(inputs=(OperatorInput(source="stick", neutral=False),)).event is None
    others = (OperatorInput(source="stick"), OperatorInput(source="other", neutral=False))
    assert player.tick(inputs=others).event is Event.TELEOP


def test_step_by_hand_whose_controls_nobody_releases_for_ten_minutes_ends_the_run() -> None:
    steps = shared(TeleopStep(input="stick", seconds=None), done=3.0)
    player = Player(ReadyMode(steps))
    player.world["inputs"] = (OperatorInput(source="stick", neutral=False),)
    expires(player)


def test_calibrate_aligns_and_is_done() -> None:
    steps = shared(CalibrateStep())
    robot = ObedientDrives(DriveState.OPERATION_ENABLE)
    player = Player(CalibrateMode(steps), robot.react)
    assert player.until(has_event).event is Event.DONE
    assert steps.current is None
    kinds = [job.kind for job in player.jobs]
    assert kinds[:2] == [JobKind.REFERENCE] * 2
    assert {wish.command.speed for wish in player.wishes} == {0.0}


def test_calibrate_holds_the_wheels_where_it_finds_them_until_it_knows_how_they_stand() -> None:
    robot = ObedientDrives(DriveState.OPERATION_ENABLE)
    player = Player(CalibrateMode(shared(CalibrateStep())), robot.react)
    found = SetPoints(steering=0.1)
    assert player.tick(set_points=found).command == DriveCommand(speed=0.0, steering=0.1)


def test_calibrate_that_fails_is_a_fault_and_not_done() -> None:
    steps = shared(CalibrateStep())
    robot = ObedientDrives(DriveState.OPERATION_ENABLE)
    robot.changes["steer-left"] = {"potentiometers": (0.0, 0.0)}
    player = Player(CalibrateMode(steps), robot.react)
    assert fault_of(player.until(has_fault)) == ("STE-04", "steer-left")
    assert isinstance(steps.current, CalibrateStep)


# ---------------------------------------------------------------------------------------------- teleop


def stick(**changes: Any) -> OperatorInput:
    held = OperatorInput(source="stick", speed=0.4, steering=-0.2, enabled=True, neutral=False, age=0.01)
    return replace(held, **changes)


def teleop(seconds: float | None = None) -> tuple[Player, Shared]:
    steps = shared(TeleopStep(input="stick", seconds=seconds))
    player = Player(TeleopMode(steps))
    player.world["inputs"] = (replace(stick(), source="other", speed=9.0), stick())
    return player, steps


def test_teleop_drives_as_its_own_input_says() -> None:
    player, _ = teleop()
    wish = player.tick()
    assert wish.command == DriveCommand(speed=0.4, steering=-0.2)
    assert powered(wish)


def test_teleop_stands_with_the_wheels_held_while_the_enable_button_is_up() -> None:
    player, _ = teleop()
    wish = player.tick(inputs=(stick(enabled=False),), set_points=SetPoints(speed=0.4, steering=0.1))
    assert wish.command == DriveCommand(speed=0.0, steering=0.1)
    assert "enable button" in wish.phase


@pytest.mark.parametrize(("age", "id"), [(0.15, None), (0.1501, "INP-03"), (None, "INP-01")])
def test_sample_older_than_150_ms_is_a_fault_and_the_robot_stops(age: float | None, id: str | None) -> None:
    player, _ = teleop()
    wish = player.tick(inputs=(stick(age=age),), set_points=SetPoints(steering=0.1))
    assert has_fault(wish) is (id is not None)
    if id is not None:
        assert fault_of(wish) == (id, "stick")
        assert wish.command == DriveCommand(speed=0.0, steering=0.1)


def test_input_that_is_not_there_is_a_fault() -> None:
    player, _ = teleop()
    assert fault_of(player.tick(inputs=())) == ("INP-01", "stick")


def test_teleop_ends_on_request_once_the_robot_stands() -> None:
    player, steps = teleop()
    moving = SetPoints(speed=0.4, steering=0.1)
    first = player.tick(inputs=(stick(requests=(Request.DONE,)),), standing=False, set_points=moving)
    assert (first.event, first.command) == (None, DriveCommand(speed=0.0, steering=0.1))
    again = player.tick(standing=False)
    assert (again.event, again.command.speed) == (None, 0.0), "the request was made once"
    assert player.tick().event is Event.DONE
    assert steps.current is None


def test_somebody_elses_request_ends_nothing() -> None:
    player, _ = teleop()
    done = replace(stick(requests=(Request.DONE,)), source="other")
    assert player.tick(inputs=(done, stick())).command.speed == 0.4


def test_teleop_ends_when_its_time_is_over() -> None:
    player, _ = teleop(seconds=1.0)
    assert player.until(has_event).event is Event.DONE
    assert player.time == pytest.approx(1.0, abs=2 * PERIOD)


def test_two_teleop_steps_end_one_by_one() -> None:
    steps = shared(*(TeleopStep(input="stick", seconds=None) for _ in range(2)))
    player = Player(TeleopMode(steps))
    player.world["inputs"] = (stick(),)
    player.tick(inputs=(stick(requests=(Request.DONE,)),))
    assert steps.position.step == 1
    player.enter()
    assert player.tick().event is None
