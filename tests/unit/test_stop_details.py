"""How the robot stops and waits, to the tick and to the word: coming to rest, quickstop, fault."""

from __future__ import annotations

from typing import Any

import pytest
from core_builders import NAMES, ROBOT, Player, drive, drives, fault_of, has_event, judged, shared, snapshot, verdict

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.motion.perception import STANDING_TIME
from artemis.states.fault import FaultMode
from artemis.states.mode import PATIENCE
from artemis.states.plan import CalibrateStep, Plan
from artemis.states.quickstop import QuickstopMode
from artemis.values import Event, JobKind, JobResult, Request, Verdict, Wish

# ---------------------------------------------------------------------------------------------- coming to rest


def rolling(*times: float, name: str = "traction-left", age: float | None = 0.02) -> list[Wish]:
    """Wishes of a quick stop whose robot rolls on, with the feedback of one drive of that age."""
    mode = QuickstopMode(shared(connected=True, aligned=True))
    seen = drives(
        drive(name, age=age, state=DriveState.SWITCH_ON_DISABLED), age=0.02, state=DriveState.SWITCH_ON_DISABLED
    )
    mode.enter(snapshot(0.0))
    return [mode.step(snapshot(time, standing=False, drives=seen)) for time in (0.0, *times)]


def test_steering_holds_a_robot_that_rolls_for_ten_seconds_and_traction_is_off_after_the_stop_time() -> None:
    stop = Plan(robot=ROBOT, steps=()).stop_time
    *_, driven, off, held, over = rolling(stop - 0.01, stop, 9.99, 10.0)
    assert [wish.traction for wish in (driven, off, held, over)] == [Goal.QUICK_STOPPED] + [Goal.DISABLED] * 3
    assert [wish.steering for wish in (driven, off, held, over)] == [Goal.HOLD] * 3 + [Goal.DISABLED]
    assert [wish.phase for wish in (driven, off, held, over)] == ["stopping"] * 3 + ["switching off"]


@pytest.mark.parametrize(("name", "age", "holds"), [
    ("traction-left", 0.499, True), ("traction-left", 0.5, False), ("traction-right", None, False),
    ("steer-left", 9.0, True),
])  # fmt: skip
def test_steering_lets_go_with_traction_where_a_driven_wheel_is_not_heard_any_more(
    name: str, age: float | None, holds: bool
) -> None:
    stop = Plan(robot=ROBOT, steps=()).stop_time
    *_, driven, off = rolling(stop - 0.01, stop, name=name, age=age)
    assert (driven.steering, off.traction) == (Goal.HOLD, Goal.DISABLED)
    assert off.steering is (Goal.HOLD if holds else Goal.DISABLED)


def test_job_of_another_kind_that_fails_while_the_robot_stops_takes_no_heartbeat() -> None:
    player = Player(QuickstopMode(shared(connected=True, aligned=True)))
    player.world["standing"] = False
    player.tick()
    failed = JobResult(id=99, kind=JobKind.READ_HISTORY, drive="traction-left", ok=False, fault="COM-08")
    assert player.tick(results=(failed,)).heartbeat
    assert player.tick(results=()).heartbeat


def test_robot_that_stands_is_switched_off_in_the_very_tick_in_which_that_counts() -> None:
    for time, off in ((STANDING_TIME - 0.001, False), (STANDING_TIME, True)):
        mode = QuickstopMode(shared(connected=True, aligned=True))
        mode.enter(snapshot(0.0))
        mode.step(snapshot(0.0))
        stopped = drives(state=DriveState.QUICK_STOP_ACTIVE)
        assert (mode.step(snapshot(time, drives=stopped)).phase == "switching off") is off


@pytest.mark.parametrize(("changes", "unresponsive"), [
    ({"age": 0.1}, False), ({"age": 0.101}, True), ({"age": None}, True), ({"nmt": Nmt.PRE_OPERATIONAL}, True),
])  # fmt: skip
def test_driven_wheel_that_is_not_heard_is_stopped_by_sdo_in_the_first_tick(
    changes: dict[str, Any], unresponsive: bool
) -> None:
    mode = QuickstopMode(shared(connected=True, aligned=True))
    stops = DriveState.QUICK_STOP_ACTIVE
    seen = snapshot(0.0, standing=False, drives=drives(drive("traction-left", state=stops, **changes), state=stops))
    mode.enter(seen)
    assert [job.drive for job in mode.step(seen).jobs] == ["traction-left"] * unresponsive


# ---------------------------------------------------------------------------------------------- quickstop

HOLDS: dict[str, Any] = {"verdict": judged("INP-03", device="stick")}


def test_controlled_stop_that_does_not_come_to_rest_becomes_a_quick_one_after_the_stop_time() -> None:
    stop = Plan(robot=ROBOT, steps=()).stop_time
    mode = QuickstopMode(shared(connected=True, aligned=True))
    mode.enter(snapshot(0.0, standing=False, **HOLDS))
    times = 0.0, stop - 0.01, stop, stop + 0.02
    goals = [mode.step(snapshot(time, standing=False, **HOLDS)).traction for time in times]
    assert goals == [Goal.ENABLED, Goal.ENABLED, Goal.QUICK_STOPPED, Goal.QUICK_STOPPED]


def test_controlled_stop_of_drives_that_are_not_ours_yet_switches_them_off() -> None:
    player = Player(QuickstopMode(shared()))
    player.world.update(HOLDS)
    player.until(lambda wish: wish.phase.startswith("acknowledge"))
    assert (player.wishes[-1].traction, player.wishes[-1].exchange) == (Goal.DISABLED, False)


def test_armed_stop_says_so() -> None:
    player = Player(QuickstopMode(shared(connected=True, aligned=True)))
    player.world.update(HOLDS)
    player.tick()
    wish = player.tick(requests=(Request.ARM,), verdict=Verdict())
    assert (wish.event, wish.phase) == (Event.REARMED, "armed again")


def test_stop_that_goes_on_by_itself_waits_for_it_with_nobody_there_and_no_longer_than_for_a_person() -> None:
    mode = QuickstopMode(shared(connected=True, aligned=True))
    seen: dict[str, Any] = {"attended": False, "verdict": judged("INP-03", recovers=True, resumes=True)}
    mode.enter(snapshot(0.0, **seen))
    for time, event in ((0.0, None), (PATIENCE, None), (PATIENCE + 0.02, Event.END)):
        wish = mode.step(snapshot(time, **seen))
        assert (wish.event, wish.fault is not None) == (event, event is Event.END)
    assert (wish.phase, fault_of(wish)) == ("stopped", ("OPR-03", ""))


def test_stop_with_nobody_there_ends_the_run_without_blaming_anybody() -> None:
    mode = QuickstopMode(shared(connected=True, aligned=True))
    alone = snapshot(0.0, attended=False, **HOLDS)
    mode.enter(alone)
    wish = mode.step(alone)
    assert (wish.event, wish.failed, wish.fault, wish.phase) == (Event.END, True, None, "no operator to arm")


BOTH = judged("INP-03", "PTH-09", device="stick")


@pytest.mark.parametrize(("says", "phase"), [
    ({"final": True}, "this run cannot continue; end it: stick: "), ({"recovers": True}, "recovers automatically"),
    ({}, "acknowledge: stick: "),
])  # fmt: skip
def test_stop_names_the_first_of_its_causes(says: dict[str, bool], phase: str) -> None:
    player = Player(QuickstopMode(shared(connected=True, aligned=True)))
    player.world["verdict"] = judged("INP-03", "PTH-09", device="stick", **says)
    first = player.world["verdict"].faults[0].text
    wish = player.tick(standing=True)
    assert wish.phase == (phase if "recovers" in says else phase.removesuffix("stick: ") + first)


def test_a_stop_while_the_watchdog_is_proven_secures_the_drives_as_before_the_bring_up() -> None:
    parts = shared(connected=True, aligned=True)
    parts.bring_up.proving = True
    Player(QuickstopMode(parts)).tick(standing=True)
    assert not parts.bring_up.connected


# ---------------------------------------------------------------------------------------------- fault


def in_fault(**state: Any) -> Player:  # noqa: ANN401 (of the bring-up)
    player = Player(FaultMode(shared(CalibrateStep(), **{"connected": True, **state})))
    player.world.update(drives=drives(state=DriveState.SWITCH_ON_DISABLED), verdict=verdict("DRV-25", "steer-left"))
    return player


def test_fault_is_not_judged_any_more_once_the_drives_are_off_and_says_what_it_does() -> None:
    player = in_fault()
    player.until(lambda wish: wish.phase == "reading error histories")
    stopped = len(player.wishes) - 1
    player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again")
    assert [wish.supervised for wish in player.wishes] == [True] * stopped + [False] * (len(player.wishes) - stopped)
    wish = player.tick(requests=(Request.ACKNOWLEDGE,), verdict=Verdict())
    assert (wish.event, wish.phase, wish.supervised) == (Event.ACKNOWLEDGED, "acknowledged", False)


@pytest.mark.parametrize("state", [{"connected": False}, {"proving": True}])
def test_fault_of_drives_that_are_not_ours_yet_or_miss_our_heartbeat_is_not_judged(state: dict[str, bool]) -> None:
    player = in_fault(**state)
    player.until(lambda wish: "acknowledge" in wish.phase)
    assert not any(wish.supervised for wish in player.wishes)


def test_fault_that_is_over_by_itself_says_that_it_recovered() -> None:
    player = in_fault()
    player.world["verdict"] = judged("COM-11", recovers=True)
    player.until(lambda wish: wish.phase == "recovers automatically")
    assert player.tick(verdict=Verdict()).phase == "recovered"


def test_acknowledgment_while_the_robot_stops_is_remembered_and_is_no_arm() -> None:
    player = in_fault(armed=True)
    player.tick(requests=(Request.ACKNOWLEDGE,), standing=False)
    player.tick(standing=False)
    player.world["verdict"] = Verdict()
    wish = player.until(has_event)
    assert (wish.event, wish.phase) == (Event.ACKNOWLEDGED, "acknowledged")
    assert not player.mode.shared.bring_up.armed


def test_drives_that_cannot_be_secured_are_named_in_one_order() -> None:
    player = in_fault(connected=False)
    player.refused |= {(JobKind.SECURE, name) for name in NAMES}
    player.until(lambda wish: wish.phase.startswith(f"not secured: {', '.join(sorted(NAMES))}; "))


def test_drives_that_another_artemis_has_meanwhile_are_not_tried_again() -> None:
    player = in_fault(connected=False)
    player.refused |= {(JobKind.SECURE, name) for name in NAMES}
    player.until(lambda wish: bool(wish.jobs))
    player.world["verdict"] = judged("COM-18", final=True)
    player.until(has_event)
    assert len(player.jobs) == 2, "traction, once"


def test_fault_with_nobody_there_ends_the_run_and_says_so_only_after_the_time_of_a_person() -> None:
    player = in_fault()
    player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again")
    wish = player.tick(attended=False)
    assert (wish.event, wish.failed, wish.fault, wish.phase) == (Event.END, True, None, "no operator to acknowledge")
    player.time += PATIENCE
    assert fault_of(player.tick()) == ("OPR-03", "")


@pytest.mark.parametrize(
    ("state", "final"), [(DriveState.OPERATION_ENABLE, False), (DriveState.QUICK_STOP_ACTIVE, False), (None, True)]
)
def test_nobody_who_only_may_come_is_waited_for_under_power_or_for_nothing(
    state: DriveState | None, final: bool
) -> None:
    player = in_fault()
    player.world.update(attended=False, awaited=True)
    for _ in range(20):
        assert player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again").event is None
    more = {} if state is None else {"drives": drives(state=state)}
    assert player.tick(verdict=judged("DRV-25", final=final), **more).event is Event.END


def test_fault_that_no_operator_can_acknowledge_does_not_miss_one() -> None:
    player = in_fault()
    player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again")
    assert player.tick(attended=False, verdict=judged("COM-18", final=True)).phase == "fault"


@pytest.mark.parametrize("recovers", [False, True])
@pytest.mark.parametrize("resumes", [False, True])
@pytest.mark.parametrize("armed", [False, True])
@pytest.mark.parametrize("held", [False, True])
def test_fault_with_nobody_there_is_waited_for_only_where_it_may_go_on_by_itself(
    recovers: bool, resumes: bool, armed: bool, held: bool
) -> None:
    player = in_fault(armed=armed, held=held)
    player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again")
    player.world.update(verdict=judged("COM-11", recovers=recovers, resumes=resumes), attended=False)
    goes_on = recovers and not held and (resumes or armed)
    assert player.tick().event is (None if goes_on else Event.END)


def test_fault_is_acknowledged_within_ten_minutes_of_the_histories_and_not_a_tick_later() -> None:
    mode, off = FaultMode(shared(connected=True)), drives(state=DriveState.SWITCH_ON_DISABLED)
    seen: dict[str, Any] = {"verdict": verdict("DRV-25", "steer-left"), "drives": off}
    mode.enter(snapshot(0.0, **seen))
    *_, asked = [mode.step(snapshot(time, **seen)) for time in (0.0, 1.0, 2.0)]
    told = tuple(JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True) for job in asked.jobs)
    assert {result.kind for result in told} == {JobKind.READ_HISTORY}
    for time, results, event in ((3.0, told, None), (603.0, (), None), (603.02, (), Event.END)):
        assert mode.step(snapshot(time, results=results, **seen)).event is event


@pytest.mark.parametrize(
    ("says", "phase"), [({"final": True}, "this run cannot continue; end it: "), ({}, "cannot acknowl")]
)
def test_fault_names_the_first_of_its_causes(says: dict[str, bool], phase: str) -> None:
    player = in_fault()
    player.world["verdict"] = found = judged("DRV-25", "DRV-02", device="steer-left", **says)
    player.until(lambda wish: "acknowledge to" in wish.phase or "cannot continue" in wish.phase)
    wish = player.tick(requests=(Request.ACKNOWLEDGE,))
    assert wish.phase.startswith(phase)
    assert wish.phase.endswith(found.faults[0].text)


def test_acknowledgment_that_was_refused_is_forgotten() -> None:
    player = in_fault(armed=True)
    player.until(lambda wish: wish.phase == "acknowledge to bring the drives up again")
    assert player.tick(requests=(Request.ACKNOWLEDGE,)).phase.startswith("cannot acknowledge yet: ")
    assert player.tick().phase == "acknowledge to bring the drives up again"
    assert player.tick(verdict=Verdict()).phase == "recovered"
    assert player.mode.shared.bring_up.armed
