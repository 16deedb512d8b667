"""The decision core as a whole, with drives that obey: judgement, mode, wish and gate in one tick."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from core_builders import (
    NAMES,
    PERIOD,
    ROBOT,
    ROUTE,
    STEERING,
    TRACTION,
    StubFollower,
    following,
)
from live_core import AHEAD, STICK, Live
from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal
from artemis.progress import Position
from artemis.robot import LIMITED_SPEED, Core
from artemis.states.plan import FollowStep, Plan, TeleopStep, WaitStep
from artemis.supervision import catalogue
from artemis.values import Action, DriveCommand, Mode, Pose, Request, SetPoints


def driving() -> Live:
    """In the middle of teleop, at full speed."""
    live = Live(TeleopStep(input="stick", seconds=None))
    live.until(Mode.TELEOP)
    live.until(lambda tick: tick.set_points.speed > 0.5, inputs=(STICK,))
    return live


def test_run_without_steps_is_brought_up_and_ends_in_order() -> None:
    live = Live()
    live.until(lambda tick: tick.wish.finished)
    modes = itertools.groupby(tick.mode for tick in live.ticks)
    assert [mode for mode, _ in modes] == [Mode.INIT, Mode.READY, Mode.END]
    assert not live.ticks[-1].failed
    assert {tick.set_points.speed for tick in live.ticks} == {0.0}


def test_steps_are_done_one_after_the_other() -> None:
    follower = StubFollower(lambda: replace(StubFollower().answer(), finished=True))
    live = Live(WaitStep(seconds=0.1), FollowStep(route=ROUTE, follower=follower), WaitStep(seconds=0.1))
    live.until(Mode.END)
    modes = itertools.groupby(tick.mode for tick in live.ticks)
    assert [mode for mode, _ in modes] == [Mode.INIT, Mode.READY, Mode.FOLLOW, Mode.READY, Mode.END]
    assert follower.starts == 1
    assert live.ticks[-1].position == Position(step=3)
    assert not live.ticks[-1].failed


def test_same_things_sensed_give_the_same_ticks() -> None:
    live = driving()
    live.tick(drives=live.seen[-1].drives, faults=(catalogue.fault("COM-22"),))
    for _ in range(50):
        live.tick()
    again = Core(Plan(robot=ROBOT, steps=(TeleopStep(input="stick", seconds=None),)), PERIOD)
    assert [again.decide(each) for each in live.seen] == live.ticks


# ---------------------------------------------------------------------------------------------- in the same tick


def test_fault_of_a_drive_stops_the_robot_in_the_tick_that_sees_it() -> None:
    live = driving()
    live.drives.changes["traction-left"] = {"emergencies": (0x2310,), "state": DriveState.FAULT_REACTION_DISABLED}
    tick = live.tick(inputs=(STICK,))
    assert (tick.mode, tick.wish.command.action) == (Mode.FAULT, Action.QUICKSTOP)
    assert (tick.wish.traction, tick.wish.steering) == (Goal.QUICK_STOPPED, Goal.HOLD)
    assert tick.set_points.speed == 0.0


def test_request_of_a_quick_stop_stops_the_robot_in_an_extra_tick() -> None:
    live = driving()
    held = live.ticks[-1].set_points.steering
    tick = live.tick(inputs=(STICK,), requests=(Request.QUICKSTOP,), urgent=True)
    assert (tick.mode, tick.wish.command.action, tick.wish.traction) == (
        Mode.QUICKSTOP,
        Action.QUICKSTOP,
        Goal.QUICK_STOPPED,
    )
    assert (tick.set_points.speed, tick.set_points.steering) == (0.0, held)


def test_nothing_turns_a_quick_stop_into_a_milder_one() -> None:
    live = driving()
    before = live.drives.react(live.ticks[-1].wish, live.ticks[-1].set_points)
    live.tick(inputs=(STICK,), requests=(Request.QUICKSTOP,), urgent=True, drives=before)
    late = catalogue.fault("SYS-01")
    tick = live.tick(drives=before, faults=(late,))  # feedback is a tick old: it does not show the stop yet
    assert tick.wish.traction is Goal.QUICK_STOPPED


def test_extra_tick_takes_no_time_and_so_changes_no_set_point() -> None:
    live = driving()
    before = live.ticks[-1].set_points
    tick = live.tick(inputs=(replace(STICK, speed=-0.7, steering=-1.0),), urgent=True)
    assert tick.snapshot.dt == 0.0
    assert tick.set_points == before


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["speed", "steering"])
def test_command_that_is_not_a_number_never_leaves_the_gate(field: str, number: Any) -> None:
    live = driving()
    before = live.ticks[-1].set_points
    tick = live.tick(inputs=(replace(STICK, **{field: number}),))
    assert tick.wish.fault is not None
    assert (tick.wish.fault.id, tick.wish.fault.device) == ("RUN-11", "teleop")
    assert 0.0 < tick.set_points.speed < before.speed, "it slows down at once"
    following = live.tick(inputs=(STICK,))
    assert following.mode is Mode.QUICKSTOP
    numbers = [value for each in live.ticks for value in _numbers(each.set_points)]
    assert all(map(math.isfinite, numbers))


def _numbers(points: SetPoints) -> list[float]:
    return [points.speed, points.steering, points.speed_left, points.speed_right, points.steering_left,
            points.steering_right]  # fmt: skip


# ---------------------------------------------------------------------------------------------- the gate


def test_controlled_stop_ramps_down_with_the_wheels_held_and_the_drives_enabled() -> None:
    live = driving()
    first = live.ticks[-1].set_points
    speeds = []
    for _ in range(60):
        tick = live.tick(inputs=())
        assert (tick.wish.traction, tick.wish.steering) == (Goal.ENABLED, Goal.ENABLED)
        speeds.append(tick.set_points.speed)
        assert tick.set_points.steering == pytest.approx(first.steering, abs=math.radians(1.0))
    steps = [before - after for before, after in zip([first.speed, *speeds], speeds, strict=False)]
    assert max(steps) == pytest.approx(1.0 * PERIOD), "1 m/s² of the robot file"
    assert speeds[-1] == 0.0


@pytest.mark.parametrize(("held_up", "counted"), [(0.0, 1.0), (0.001, 1.0), (0.012, 0.5), (0.02, 0.1), (0.05, 0.1)])
def test_set_points_follow_those_before_by_the_time_since_they_were_sent(held_up: float, counted: float) -> None:
    live = driving()
    before, live.time = live.ticks[-1].set_points, live.time + max(0.0, held_up - PERIOD)
    sent = live.seen[-1].time + held_up
    after = live.tick(inputs=(replace(STICK, speed=0.0, steering=-1.0),), sent=sent).set_points
    assert before.speed - after.speed == pytest.approx(counted * 1.0 * PERIOD), "1 m/s² of the robot file"
    turned = max(before.steering_left - after.steering_left, before.steering_right - after.steering_right)
    assert turned == pytest.approx(counted * math.radians(33.0) * PERIOD), "33 degrees a second of the robot file"


def test_set_points_that_always_take_long_to_be_sent_ramp_as_fast() -> None:
    live = driving()
    speeds = [live.tick(inputs=(AHEAD,), sent=live.time - PERIOD + 0.012).set_points.speed for _ in range(6)]
    speeds += [
        live.tick(inputs=(replace(AHEAD, speed=0.0),), sent=live.time - PERIOD + 0.012).set_points.speed
        for _ in range(5)
    ]
    steps = [before - after for before, after in itertools.pairwise(speeds[5:])]
    assert steps == pytest.approx([1.0 * PERIOD] * 5), "1 m/s² of the robot file"


def test_speed_is_limited_while_a_verdict_says_so() -> None:
    live = driving()
    live.tick(inputs=(STICK,), faults=(catalogue.fault("COM-20"),))
    for _ in range(40):
        tick = live.tick(inputs=(STICK,))
    assert tick.mode is Mode.TELEOP
    assert tick.set_points.speed == pytest.approx(LIMITED_SPEED)


def fastest(live: Live, seconds: float = 3.0, **sensed: Any) -> float:
    """Speed that leaves the gate, while it is asked for 0.7 m/s all the time."""
    made = [live.tick(**sensed) for _ in range(round(seconds / PERIOD))]
    assert {tick.wish.command.speed for tick in made} == {0.7}, "the wish is recorded as it was"
    assert not any(tick.snapshot.verdict.faults for tick in made), "within the robot's limits (RUN-12)"
    return max(tick.set_points.speed for tick in made)


@pytest.mark.parametrize(("checked", "driven"), [(0.3, 0.3), (None, 0.7), (0.7, 0.7)])
def test_follower_drives_no_faster_than_what_was_checked_for_its_step(checked: float | None, driven: float) -> None:
    command = DriveCommand(speed=0.7)
    arc_lengths = itertools.count(start=0.0, step=0.02)
    follower = StubFollower(lambda: replace(following(arc_length=next(arc_lengths)), command=command))
    live = Live(FollowStep(route=ROUTE, follower=follower, speed=checked))
    live.drives.changes = {name: {"frames": 1} for name in NAMES}
    live.until(Mode.FOLLOW)
    assert fastest(live) == pytest.approx(driven, abs=1e-12)


@pytest.mark.parametrize(("checked", "driven"), [(0.3, 0.3), (None, 0.7)])
def test_hand_drives_no_faster_than_what_was_checked_for_its_input(checked: float | None, driven: float) -> None:
    live = Live(TeleopStep(input="stick", seconds=None, speed=checked))
    live.until(Mode.TELEOP)
    assert fastest(live, inputs=(AHEAD,)) == pytest.approx(driven, abs=1e-12)


def test_each_step_has_its_own_speed() -> None:
    live = Live(TeleopStep(input="stick", seconds=3.0, speed=0.2), TeleopStep(input="stick", seconds=None, speed=0.4))
    live.until(Mode.TELEOP)
    assert max(live.tick(inputs=(AHEAD,)).set_points.speed for _ in range(100)) == pytest.approx(0.2)
    live.until(Mode.READY)
    live.until(Mode.TELEOP)
    assert fastest(live, inputs=(AHEAD,)) == pytest.approx(0.4)


def test_set_points_of_drives_that_are_off_are_where_the_wheels_are() -> None:
    live = Live()
    tick = live.until(lambda tick: tick.wish.exchange)
    assert not any(live.drives.states[name] is DriveState.OPERATION_ENABLE for name in NAMES)
    points = tick.set_points
    assert (points.steering_left, points.steering_right) == tuple(live.drives.angles[name] for name in STEERING)
    assert (points.speed, points.speed_left, points.speed_right) == (0.0, 0.0, 0.0)


def test_speed_begins_at_zero_when_traction_is_enabled_again() -> None:
    live = driving()
    live.tick(requests=(Request.QUICKSTOP,))
    live.until(lambda tick: tick.wish.traction is Goal.DISABLED)
    live.tick(requests=(Request.ARM,))
    back = live.until(Mode.TELEOP)
    assert back.set_points.speed == 0.0
    assert live.tick(inputs=(STICK,)).set_points.speed <= 0.5 * PERIOD + 1e-9, "0.5 m/s² of the robot file"


# ---------------------------------------------------------------------------------------------- faults and recovery


def in_fault() -> Live:
    live = driving()
    live.drives.changes["traction-left"] = {"emergencies": (0x2310,)}
    live.tick(inputs=(STICK,))
    live.drives.changes["traction-left"] = {}
    live.until(lambda tick: "acknowledge" in tick.wish.phase)
    return live


def test_acknowledge_arm_and_move_are_three_acts() -> None:
    live = in_fault()
    live.tick(requests=(Request.ACKNOWLEDGE,))
    live.until(lambda tick: tick.wish.phase == "waiting for arm")
    for _ in range(100):
        tick = live.tick()
        assert (tick.mode, tick.wish.traction, tick.wish.steering) == (Mode.INIT, Goal.DISABLED, Goal.DISABLED)
    live.tick(requests=(Request.ARM,))
    live.until(Mode.TELEOP)
    for _ in range(5):
        assert live.tick(inputs=(replace(STICK, enabled=False),)).set_points.speed == 0.0


@pytest.mark.parametrize("request_", [Request.ARM, Request.DONE, Request.QUICKSTOP])
def test_nothing_but_an_acknowledgment_leads_out_of_fault(request_: Request) -> None:
    live = in_fault()
    live.tick(requests=(request_,))
    for _ in range(50):
        assert live.tick().mode is Mode.FAULT


def test_acknowledgment_is_refused_while_the_cause_is_there() -> None:
    live = in_fault()
    lost = catalogue.fault("COM-22")
    live.tick(faults=(lost,))
    tick = live.tick(faults=(lost,), requests=(Request.ACKNOWLEDGE,))
    assert [fault.id for fault in tick.snapshot.verdict.faults] == ["COM-22"]
    assert "CAN adapter lost" in tick.wish.phase
    for _ in range(100):  # a stuck button acknowledges once in 2 s
        assert live.tick(faults=(lost,)).mode is Mode.FAULT
    live.tick(requests=(Request.ACKNOWLEDGE,))
    assert live.tick().mode is Mode.INIT


def test_run_that_nobody_attends_ends_after_a_fault_as_failed() -> None:
    live = driving()
    live.drives.changes["traction-left"] = {"boots": 1}
    live.tick(inputs=(STICK,), attended=False)
    live.drives.changes["traction-left"] = {}
    live.until(lambda tick: tick.wish.finished, attended=False)
    assert live.ticks[-1].failed


def test_drive_that_does_not_enable_is_a_fault_that_names_it() -> None:
    live = Live()
    live.until(lambda tick: tick.wish.steering is Goal.ENABLED)
    live.drives.lazy.add("steer-right")
    tick = live.until(Mode.FAULT, longest=5.0)
    assert [(fault.id, fault.device) for fault in tick.snapshot.verdict.faults] == [("COM-03", "steer-right")]


@pytest.mark.parametrize("name", [TRACTION[0], STEERING[1]])
def test_drives_are_watched_while_the_robot_waits_for_its_arm(name: str) -> None:
    live = in_fault()
    live.tick(requests=(Request.ACKNOWLEDGE,))
    live.until(lambda tick: tick.wish.phase == "waiting for arm")
    live.drives.changes[name] = {"age": 0.2}
    live.tick()
    assert live.tick().mode is Mode.FAULT


# ---------------------------------------------------------------------------------------------- pose


def test_pose_counts_from_where_the_wheels_were_aligned() -> None:
    live = Live(WaitStep(seconds=1.0))
    live.until(lambda tick: tick.wish.exchange)
    live.drives.distances = dict.fromkeys(TRACTION, 0.3)  # pushed by hand
    assert live.until(lambda tick: tick.snapshot.odometry.distance > 0.29).mode is Mode.INIT
    assert live.until(Mode.READY).snapshot.odometry.pose == Pose()


def test_origin_is_where_the_run_was_first_ready_and_stays_after_a_fault() -> None:
    live = driving()
    resets = [tick for tick in live.ticks if tick.wish.reset_pose]
    assert len(resets) == 1
    live = in_fault()
    live.tick(requests=(Request.ACKNOWLEDGE,))
    live.until(Mode.TELEOP, requests=(Request.ARM,))
    assert len([tick for tick in live.ticks if tick.wish.reset_pose]) == 1
