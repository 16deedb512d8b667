"""What modes seldom meet: all drives silent, no operator to arm, a lost emergency, an end of waiting."""

from __future__ import annotations

import pytest
from core_builders import (
    NAMES,
    TRACTION,
    ObedientDrives,
    Player,
    expires,
    fault_of,
    has_event,
    has_fault,
    judged,
    powered,
    shared,
    snapshot,
)

from artemis.drive_states import DriveState
from artemis.states.act import ActMode
from artemis.states.calibrate import CalibrateMode
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.follow import FollowMode
from artemis.states.hands import hands_on
from artemis.states.init import InitMode
from artemis.states.mode import ON, Failed, RoutineMode, is_second
from artemis.states.modes import Modes
from artemis.states.plan import CalibrateStep
from artemis.states.quickstop import QuickstopMode
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.supervision import catalogue
from artemis.values import Event, JobKind, JobResult, Mode, OperatorInput, Request, Severity, Verdict, Wish

LEFT, RIGHT = TRACTION


def bring_up(*, armed: bool = True) -> Player:
    return Player(InitMode(shared(CalibrateStep(), armed=armed)), ObedientDrives().react)


# ---------------------------------------------------------------------------------------------- init


@pytest.mark.parametrize(("silent", "fault"), [(NAMES, ("COM-32", "")), (NAMES[1:], ("COM-08", NAMES[1]))])
def test_no_drive_that_answers_is_another_fault_than_some_that_do_not(
    silent: tuple[str, ...], fault: tuple[str, str]
) -> None:
    player = bring_up()
    player.refused |= {(JobKind.SECURE, name) for name in silent}
    assert fault_of(player.until(has_fault)) == fault
    assert not any(job.kind is JobKind.CONFIGURE for job in player.jobs), "nothing goes on while one is not secured"


def test_nobody_there_to_arm_a_bring_up_ends_the_run_as_failed() -> None:
    player = bring_up(armed=False)
    player.world["attended"] = False
    wish = player.until(has_event)
    assert (wish.event, wish.failed, wish.phase) == (Event.END, True, "no operator to arm")
    assert not any(map(powered, player.wishes))


def test_run_ends_when_nobody_arms_a_bring_up_for_ten_minutes() -> None:
    player = bring_up(armed=False)
    player.until(lambda wish: wish.phase == "waiting for arm")
    expires(player)


def test_armed_bring_up_with_the_controls_pressed_waits_though_nobody_else_is_there() -> None:
    player = bring_up(armed=True)
    player.world.update(attended=False, inputs=(OperatorInput(source="stick", neutral=False, age=0.0),))
    player.until(lambda wish: wish.phase == "release the controls")
    assert player.tick().event is None
    player.world["inputs"] = ()
    assert player.until(has_event).event is Event.ALIGNED


@pytest.mark.parametrize(
    ("codes", "told"),
    [({LEFT: (0x8130,), RIGHT: (0x8130, 0x2310)}, None), ({LEFT: (0x8130,), RIGHT: (0x2310, 0x8130)}, RIGHT)],
)
def test_drives_whose_emergencies_were_lost_tell_by_their_histories_why_they_are_in_fault(
    codes: dict[str, tuple[int, ...]], told: str | None
) -> None:
    drives = ObedientDrives()
    player = Player(InitMode(shared(CalibrateStep())), drives.react)
    for name in codes:
        drives.changes[name] = {"emergencies": ()}
    asked = player.until(lambda wish: any(job.kind is JobKind.READ_HISTORY for job in wish.jobs)).jobs
    assert [job.drive for job in asked] == list(codes)
    player.tick(
        results=tuple(JobResult(id=j.id, kind=j.kind, drive=j.drive, ok=True, values=codes[j.drive]) for j in asked)
    )
    if told is None:
        assert player.until(has_event).event is Event.ALIGNED
    else:
        fault = player.wishes[-1]
        assert fault_of(fault) == ("COM-30", told)
        assert "in fault for another reason: 0x2310, 0x8130" in str(fault.fault)


def test_aligned_robot_stands_on_until_the_mode_changes() -> None:
    player = bring_up()
    player.until(has_event)
    for _ in range(3):
        wish = player.tick()
        assert powered(wish)
        assert (wish.event, wish.reset_pose, wish.command.speed) == (None, False, 0.0)


def test_second_bring_up_of_a_run_leaves_the_odometry_its_origin() -> None:
    player = bring_up()
    assert player.until(has_event).reset_pose
    player.mode.shared.bring_up.armed = True
    player.enter()
    assert not player.until(has_event).reset_pose


# ---------------------------------------------------------------------------------------------- the others


def test_mode_without_a_routine_says_so() -> None:
    with pytest.raises(TypeError, match="RoutineMode has no routine"):
        RoutineMode(shared()).routine(snapshot())


def test_routine_that_failed_is_told_by_its_fault() -> None:
    fault = catalogue.fault("COM-30", LEFT, "seen")
    assert str(Failed(ON, fault)) == fault.text


def test_armed_stop_stands_on_until_the_mode_changes() -> None:
    robot = ObedientDrives(DriveState.OPERATION_ENABLE)
    player = Player(QuickstopMode(shared(CalibrateStep(), connected=True, aligned=True)), robot.react)
    player.until(lambda wish: wish.phase == "stopped: arm to continue")
    player.tick(requests=(Request.ARM,))
    player.until(has_event)
    for _ in range(3):
        wish = player.tick()
        assert powered(wish)
        assert (wish.event, wish.command.speed, wish.phase) == (None, 0.0, "stopping")


def test_stop_that_no_arm_helps_says_so() -> None:
    player = Player(QuickstopMode(shared(CalibrateStep(), connected=True, aligned=True)))
    player.world.update(verdict=judged("INP-03", device="stick", final=True))
    wish = player.until(lambda wish: wish.phase.startswith("this run cannot continue; end it: stick"))
    assert wish.event is None
    assert player.tick(requests=(Request.ARM,)).event is None


@pytest.mark.parametrize(("fault", "connected", "second"), [
    ("COM-18", False, True), ("COM-18", True, False), ("COM-22", False, False),
])  # fmt: skip
def test_another_artemis_has_the_drives_where_it_is_heard_before_they_are_ours(
    fault: str, connected: bool, second: bool
) -> None:
    assert is_second(shared(connected=connected), snapshot(verdict=judged("RUN-12", fault))) is second


def test_several_devices_that_said_nothing_yet_are_all_named() -> None:
    silent = [OperatorInput(source=name, neutral=False) for name in ("stick", "pad")]
    assert hands_on(silent) == "release the controls; stick, pad was not heard yet: move it once"


def test_every_mode_has_its_own_logic() -> None:
    found = Modes(shared())._logic
    assert {mode: type(logic) for mode, logic in found.items()} == {
        Mode.INIT: InitMode,
        Mode.READY: ReadyMode,
        Mode.CALIBRATE: CalibrateMode,
        Mode.TELEOP: TeleopMode,
        Mode.FOLLOW: FollowMode,
        Mode.ACT: ActMode,
        Mode.QUICKSTOP: QuickstopMode,
        Mode.FAULT: FaultMode,
        Mode.END: EndMode,
    }


def test_stop_in_the_very_first_tick_is_obeyed() -> None:
    modes = Modes(shared())
    modes.advance(snapshot(verdict=judged("INP-03")), None)
    assert modes.mode is Mode.QUICKSTOP


def test_run_has_failed_once_a_mode_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = Modes(shared())
    for wish, failed in ((Wish(), False), (Wish(failed=True), True), (Wish(), True)):
        monkeypatch.setattr(modes._logic[Mode.INIT], "step", lambda seen, wish=wish: wish)
        modes.step(snapshot())
        assert modes.failed is failed


def test_heartbeat_that_a_mode_withholds_stays_withheld_where_power_off_is_all_that_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    modes = Modes(shared())
    off = Verdict(severity=Severity.OFF, faults=judged("RUN-03").faults)
    for heartbeat in (False, True):
        monkeypatch.setattr(modes._logic[Mode.INIT], "step", lambda seen, beat=heartbeat: Wish(heartbeat=beat))
        assert modes.step(snapshot(verdict=off)).heartbeat is heartbeat
