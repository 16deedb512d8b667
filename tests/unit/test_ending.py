"""Why a run ends before its last step, from its ticks."""

from __future__ import annotations

from core_builders import snapshot
from msgspec.structs import replace

from artemis.progress import Position
from artemis.recording.ending import Ending
from artemis.supervision import catalogue
from artemis.values import Cause, Event, Fault, Mode, Request, SetPoints, Snapshot, Tick, Wish

STEERING = catalogue.fault("DRV-25", "steer-left")
LOST = catalogue.fault("COM-34", "steer-left", "no answer")
END = Cause(event=Event.END)


def told(*ticks: tuple[Mode, Cause | None, Fault | None]) -> str:
    seen: Snapshot = snapshot()
    ending = Ending()
    for mode, cause, fault in ticks:
        wish = Wish(fault=fault, failed=fault is not None)
        ending.see(Tick(snapshot=seen, mode=mode, cause=cause, wish=wish, set_points=SetPoints()))
    return ending.reason


def test_all_that_stopped_the_robot_is_told_once_and_in_order() -> None:
    stop = Mode.QUICKSTOP, Cause(event=Event.STOP, request=Request.QUICKSTOP), None
    fault = Mode.FAULT, Cause(event=Event.FAULT, faults=(STEERING,)), None
    gave_up = Mode.FAULT, None, catalogue.fault("OPR-03")
    ended = Mode.END, Cause(event=Event.END, faults=(STEERING,)), None
    late = f"OPR-03 {catalogue.fault('OPR-03').text}"
    assert told(stop, fault, gave_up, gave_up, ended) == (
        f"quick stop requested, then DRV-25 {STEERING.text}, then {late}"
    )


def test_faults_that_came_together_are_told_once_though_others_came_with_them_later() -> None:
    right = catalogue.fault("DRV-25", "steer-right")
    first = Mode.QUICKSTOP, Cause(event=Event.STOP, faults=(STEERING,)), None
    more = Mode.FAULT, Cause(event=Event.FAULT, faults=(STEERING, right, LOST)), None
    assert told(first, more) == f"DRV-25 {STEERING.text}, then DRV-25 {right.text}, COM-34 {LOST.text}"


def test_what_was_recovered_from_ended_nothing() -> None:
    fault = Mode.FAULT, Cause(event=Event.FAULT, faults=(STEERING,)), None
    again = Mode.INIT, Cause(event=Event.ACKNOWLEDGED), None
    assert told(fault, again, (Mode.END, END, None)) == ""
    assert told(fault, again, (Mode.END, Cause(event=Event.END, request=Request.END), None)) == "end requested"


def test_a_run_without_an_operator_says_what_it_needed_one_for() -> None:
    ending, wish = Ending(), Wish(failed=True, phase="no operator can answer: which? (1 left, 2 right)")
    tick = Tick(snapshot=snapshot(), mode=Mode.READY, cause=None, wish=wish, set_points=SetPoints())
    ending.see(tick)
    assert ending.reason == wish.phase
    ended = Ending()
    ended.see(replace(tick, position=Position(ended="timeout")))
    assert ended.reason == "", "the mission's own words follow"


def test_a_drive_that_does_not_end_normally_is_the_reason() -> None:
    assert told((Mode.END, END, None), (Mode.END, None, LOST)) == f"COM-34 {LOST.text}"
