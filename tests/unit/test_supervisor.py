"""Every check of the supervisor at its boundary, and what happens to what it found."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from core_builders import NAMES, PERIOD, ROBOT, drive, drives, sensed

from artemis.supervision import catalogue
from artemis.supervision.supervisor import ENABLE_TIME, HEARTBEAT_LOST, Supervisor
from artemis.values import DriveFeedback, DriveState, Fault, Goal, Mode, Nmt, Request, Sensed, Severity, Verdict, Wish

WATCHED = Wish(traction=Goal.ENABLED, steering=Goal.ENABLED)
OFF = Wish()
UNWATCHED = replace(OFF, supervised=False)
SICK = "steer-left"
JUST_ABOVE = 1 + 1e-9


class Judge(Supervisor):
    """A supervisor in the middle of a run."""

    def see(self, sensed: Sensed, wish: Wish = WATCHED) -> Verdict:
        return self.judge(sensed, wish, Mode.FOLLOW)

    def acknowledge(self, sensed: Sensed, mode: Mode = Mode.FAULT) -> Verdict:
        return self.judge(replace(sensed, requests=(Request.ACKNOWLEDGE,)), WATCHED, mode)


def supervisor(tick: float = PERIOD) -> Judge:
    return Judge(ROBOT, tick)


def found(verdict: Verdict) -> list[tuple[str, str]]:
    return sorted((fault.id, fault.device) for fault in verdict.faults)


def judged(sick: DriveFeedback, *, tick: float = PERIOD) -> list[tuple[str, str]]:
    """What is found when one drive is like this, all others healthy and all enabled."""
    return found(supervisor(tick).see(sensed_with(0.0, sick), WATCHED))


def sensed_with(time: float, *different: DriveFeedback, state: DriveState = DriveState.OPERATION_ENABLE) -> Sensed:
    return sensed(time, drives=drives(*different, state=state))


def test_a_healthy_robot_has_no_fault() -> None:
    assert supervisor().see(sensed(), WATCHED) == Verdict()


# ---------------------------------------------------------------------------------------------- single checks


def test_known_emergency_is_its_fault() -> None:
    assert judged(drive(SICK, emergencies=(0x8611,))) == [("DRV-25", SICK)]


def test_unknown_emergency_is_a_fault_too() -> None:
    assert judged(drive(SICK, emergencies=(0x1234,))) == [("DRV-99", SICK)]


def test_several_emergencies_are_several_faults() -> None:
    assert judged(drive(SICK, emergencies=(0x2310, 0x3210))) == [("DRV-02", SICK), ("DRV-03", SICK)]


def test_emergency_that_says_all_is_well_again_is_no_fault() -> None:
    assert judged(drive(SICK, emergencies=(0x0000,))) == []


def test_boot_up_is_a_fault() -> None:
    assert judged(drive(SICK, boots=1)) == [("COM-26", SICK)]


@pytest.mark.parametrize(("tick", "limit"), [(0.02, 0.080), (0.005, 0.080), (0.032, 0.080), (0.04, 0.100)])
def test_feedback_is_stale_after_80_ms_or_two_and_a_half_ticks(tick: float, limit: float) -> None:
    assert judged(drive(SICK, age=limit), tick=tick) == []
    assert judged(drive(SICK, age=limit * JUST_ABOVE), tick=tick) == [("COM-11", SICK)]


def test_feedback_that_never_came_is_stale() -> None:
    assert ("COM-11", SICK) in judged(drive(SICK, age=None))


def test_heartbeat_is_lost_after_250_ms() -> None:
    assert HEARTBEAT_LOST == 0.25
    assert judged(drive(SICK, heartbeat_age=0.25)) == []
    assert judged(drive(SICK, heartbeat_age=0.25 * JUST_ABOVE)) == [("COM-28", SICK)]
    assert judged(drive(SICK, heartbeat_age=None)) == [("COM-28", SICK)]


@pytest.mark.parametrize("nmt", [state for state in (*Nmt, None) if state is not Nmt.OPERATIONAL])
def test_every_nmt_state_but_operational_is_a_fault(nmt: Nmt | None) -> None:
    assert judged(drive(SICK, nmt=nmt)) == [("COM-27", SICK)]


def test_statusword_that_means_nothing_is_a_fault_that_shows_it() -> None:
    senseless = drive(SICK, state=DriveState.UNKNOWN, statusword=0x0165)
    verdict = supervisor().see(sensed_with(0.0, senseless), OFF)
    assert found(verdict) == [("COM-05", SICK)]
    assert "0x0165" in verdict.faults[0].text


FAULT_STATES = [DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED]


@pytest.mark.parametrize("state", FAULT_STATES)
def test_fault_whose_reason_was_not_heard_is_a_fault(state: DriveState) -> None:
    assert judged(drive(SICK, state=state)) == [("COM-01", SICK)]


@pytest.mark.parametrize("state", FAULT_STATES)
def test_fault_whose_reason_was_heard_is_only_that_reason(state: DriveState) -> None:
    judge = supervisor()
    faulty = drive(SICK, state=state)
    assert found(judge.see(sensed_with(0.0, replace(faulty, emergencies=(0x2310,))), WATCHED)) == [("DRV-02", SICK)]
    assert found(judge.see(sensed_with(0.02, faulty), WATCHED)) == [("DRV-02", SICK)]


def test_reason_of_one_drive_does_not_explain_the_fault_of_another() -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, drive(SICK, state=DriveState.FAULT, emergencies=(0x2310,))), WATCHED)
    verdict = judge.see(sensed_with(0.02, drive("steer-right", state=DriveState.FAULT)), WATCHED)
    assert ("COM-01", "steer-right") in found(verdict)


@pytest.mark.parametrize("name", NAMES)
def test_wrong_operating_mode_is_a_fault(name: str) -> None:
    verdict = supervisor().see(sensed_with(0.0, drive(name, mode=1)), WATCHED)
    assert found(verdict) == [("COM-04", name)]
    assert "mode 1" in verdict.faults[0].text


@pytest.mark.parametrize("name", NAMES)
def test_fault_names_its_drive(name: str) -> None:
    verdict = supervisor().see(sensed_with(0.0, drive(name, boots=1)), WATCHED)
    assert verdict.faults[0].device == name
    assert verdict.faults[0].text.startswith(f"{name}: ")


# ---------------------------------------------------------------------------------------------- enabling

OTHERS = [state for state in DriveState if state not in (DriveState.OPERATION_ENABLE, *FAULT_STATES)]


@pytest.mark.parametrize("state", [state for state in OTHERS if state is not DriveState.UNKNOWN])
def test_drive_that_leaves_operation_enable_by_itself_is_a_fault(state: DriveState) -> None:
    judge = supervisor()
    assert judge.see(sensed(0.0), WATCHED) == Verdict()
    assert found(judge.see(sensed_with(0.02, drive(SICK, state=state)), WATCHED)) == [("COM-02", SICK)]


def test_drive_that_was_told_to_leave_operation_enable_is_none() -> None:
    judge = supervisor()
    judge.see(sensed(0.0), WATCHED)
    off = sensed_with(0.02, state=DriveState.SWITCH_ON_DISABLED)
    assert judge.see(off, OFF) == Verdict()
    assert judge.see(replace(off, time=0.04), WATCHED) == Verdict(), "and may be enabled again"


def test_drive_has_one_second_to_be_enabled() -> None:
    assert ENABLE_TIME == 1.0
    judge = supervisor()
    slow = drive(SICK, state=DriveState.READY)
    assert judge.see(sensed_with(5.0, slow), WATCHED) == Verdict()
    assert judge.see(sensed_with(6.0, slow), WATCHED) == Verdict()
    assert found(judge.see(sensed_with(6.0 + 1e-6, slow), WATCHED)) == [("COM-03", SICK)]


def test_time_to_be_enabled_begins_anew_with_each_order() -> None:
    judge = supervisor()
    slow = drive(SICK, state=DriveState.READY)
    judge.see(sensed_with(0.0, slow), WATCHED)
    judge.see(sensed_with(0.9, slow), OFF)
    assert judge.see(sensed_with(1.8, slow), WATCHED) == Verdict()
    assert judge.see(sensed_with(2.7, slow), WATCHED) == Verdict()


@pytest.mark.parametrize(("name", "role"), [("traction-left", "traction"), ("steer-right", "steering")])
def test_each_role_is_judged_by_its_own_goal(name: str, role: str) -> None:
    judge = supervisor()
    slow = drive(name, state=DriveState.READY)
    wanted = Wish(traction=Goal.ENABLED) if role == "traction" else Wish(steering=Goal.ENABLED)
    other = Wish(steering=Goal.ENABLED) if role == "traction" else Wish(traction=Goal.ENABLED)
    for wish, expected in ((other, []), (wanted, [("COM-03", name)])):
        judge.see(sensed_with(0.0, slow), wish)
        assert found(judge.see(sensed_with(1.1, slow), wish)) == expected


@pytest.mark.parametrize("goal", [goal for goal in Goal if goal is not Goal.ENABLED])
def test_a_drive_that_need_not_be_enabled_is_never_late(goal: Goal) -> None:
    judge = supervisor()
    wish = Wish(traction=goal, steering=goal)
    for time in (0.0, 2.0):
        assert judge.see(sensed_with(time, state=DriveState.SWITCH_ON_DISABLED), wish) == Verdict()


# ---------------------------------------------------------------------------------------------- not supervised


def test_drives_are_not_judged_in_bring_up() -> None:
    ill = drive(SICK, emergencies=(0x8130,), boots=1, age=None, heartbeat_age=None, nmt=None, mode=0)
    assert supervisor().see(sensed_with(0.0, ill), UNWATCHED) == Verdict()


def test_what_edge_and_mode_report_counts_in_bring_up_too() -> None:
    lost = catalogue.fault("COM-22")
    failed = catalogue.fault("COM-08", SICK)
    verdict = supervisor().see(sensed(faults=(lost,)), replace(UNWATCHED, fault=failed))
    assert found(verdict) == [("COM-08", SICK), ("COM-22", "")]


def test_a_drive_may_change_its_state_while_nobody_watches() -> None:
    judge = supervisor()
    judge.see(sensed(0.0), WATCHED)
    judge.see(sensed_with(0.02, state=DriveState.SWITCH_ON_DISABLED), UNWATCHED)
    assert judge.see(sensed_with(0.04, state=DriveState.SWITCH_ON_DISABLED), WATCHED) == Verdict()


# ---------------------------------------------------------------------------------------------- the schedule


@pytest.mark.parametrize(
    ("late", "found_in"),
    [((0.02,) * 5, None), ((0.021,) * 3, 2), ((0.021, 0.021, 0.0, 0.021, 0.021), None), ((0.06,), None), ((0.061,), 0)],
)
def test_three_late_ticks_in_a_row_or_one_very_late_are_a_fault(late: tuple[float, ...], found_in: int | None) -> None:
    judge = supervisor()
    verdicts = [found(judge.see(sensed(number * PERIOD, late=seconds))) for number, seconds in enumerate(late)]
    expected = len(late) if found_in is None else found_in
    assert verdicts == [[]] * expected + [[("SYS-01", "")]] * (len(late) - expected)


def test_extra_ticks_are_never_late_and_interrupt_no_row() -> None:
    judge = supervisor()
    for late, urgent in ((0.03, False), (0.0, True), (0.03, False), (0.0, True)):
        assert judge.see(sensed(late=late, urgent=urgent)) == Verdict()
    assert found(judge.see(sensed(late=0.03))) == [("SYS-01", "")]


# ---------------------------------------------------------------------------------------------- latching

ILL = drive(SICK, nmt=Nmt.STOPPED)


def test_fault_stays_until_it_is_acknowledged() -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, drive(SICK, emergencies=(0x8611,))))
    for tick in range(1, 20):
        assert found(judge.see(sensed(tick * PERIOD))) == [("DRV-25", SICK)]
    assert judge.acknowledge(sensed(0.4)) == Verdict()
    assert judge.see(sensed(1.0)) == Verdict()


def test_acknowledgment_leaves_what_is_still_there() -> None:
    judge = supervisor()
    silent = drive(SICK, heartbeat_age=1.0)
    judge.see(sensed_with(0.0, replace(silent, emergencies=(0x8611,))))
    assert found(judge.acknowledge(sensed_with(0.02, silent))) == [("COM-28", SICK)]
    assert judge.acknowledge(sensed(0.04)) == Verdict()


def test_acknowledgment_does_not_hide_what_comes_with_it() -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, drive(SICK, emergencies=(0x8611,))))
    assert found(judge.acknowledge(sensed_with(0.02, ILL))) == [("COM-27", SICK)]


@pytest.mark.parametrize("mode", Mode)
def test_acknowledgment_counts_only_where_an_operator_is_asked_for_it(mode: Mode) -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, drive(SICK, emergencies=(0x8611,))))
    left = found(judge.acknowledge(sensed(0.02), mode))
    assert left == ([] if mode in (Mode.FAULT, Mode.QUICKSTOP) else [("DRV-25", SICK)])


def test_fault_comes_back_when_its_cause_comes_back() -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, ILL))
    judge.see(sensed(0.02))
    judge.acknowledge(sensed(0.04))
    assert found(judge.see(sensed_with(0.06, ILL))) == [("COM-27", SICK)]


def test_first_words_about_a_fault_are_kept() -> None:
    judge = supervisor()
    judge.see(sensed_with(0.0, drive(SICK, age=0.09)))
    verdict = judge.see(sensed_with(1.0, drive(SICK, age=1.09)))
    assert [fault.text for fault in verdict.faults] == [f"{SICK}: feedback lost (90 ms old)"]


FAULTS = [
    Fault(id="A", severity=Severity.WARN, text="a", to_fault=False),
    Fault(id="B", severity=Severity.CONTROLLED_STOP, text="b", to_fault=False),
    Fault(id="C", severity=Severity.OFF, text="c"),
]


@pytest.mark.parametrize("order", list(itertools.permutations(FAULTS)))
@pytest.mark.parametrize("at_once", [True, False])
def test_the_worst_wins_in_whatever_order_they_came(order: tuple[Fault, ...], at_once: bool) -> None:
    judge = supervisor()
    verdict = Verdict()
    for faults in [order] if at_once else [(fault,) for fault in order]:
        verdict = judge.see(sensed(faults=faults))
    assert (verdict.severity, verdict.to_fault) == (Severity.OFF, True)
    assert [fault.id for fault in verdict.faults] == ["C", "B", "A"]


def test_reaction_falls_back_to_what_is_left_after_an_acknowledgment() -> None:
    judge = supervisor()
    judge.see(sensed(faults=tuple(FAULTS)))
    verdict = judge.acknowledge(sensed(faults=(FAULTS[1],)))
    assert (verdict.severity, verdict.to_fault) == (Severity.CONTROLLED_STOP, False)


def test_fault_of_a_mode_is_latched_like_any_other() -> None:
    judge = supervisor()
    judge.see(sensed(), replace(WATCHED, fault=catalogue.fault("PTH-06")))
    assert found(judge.see(sensed(0.02))) == [("PTH-06", "")]
    assert judge.acknowledge(sensed(0.04)) == Verdict()
