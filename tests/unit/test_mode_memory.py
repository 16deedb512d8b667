"""What modes remember beyond one tick: a heartbeat that is withheld, a stop under way, an arm that is missing, time."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from core_builders import (
    PERIOD,
    TRACTION,
    ObedientDrives,
    Player,
    drive,
    drives,
    has_event,
    judged,
    shared,
    snapshot,
    verdict,
)
from live_core import AHEAD, REST, Live

from artemis.drive_states import DriveState, Goal
from artemis.motion.perception import STANDING_TIME
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.init import InitMode
from artemis.states.mode import ModeLogic
from artemis.states.modes import Modes
from artemis.states.plan import CalibrateStep, Shared, TeleopStep, WaitStep
from artemis.states.quickstop import QuickstopMode
from artemis.values import Event, JobKind, JobResult, Mode, Request, Verdict

LEFT, RIGHT = TRACTION
STOPS, OFF = DriveState.QUICK_STOP_ACTIVE, DriveState.SWITCH_ON_DISABLED
MODES: list[Callable[[Shared], ModeLogic]] = [QuickstopMode, FaultMode, EndMode]


def stopping(mode: Callable[[Shared], ModeLogic]) -> Player:
    """Drives of ours that stop, all heard; in fault it is one of the steering drives that has failed."""
    player = Player(mode(shared(CalibrateStep(), connected=True, aligned=True)))
    player.world.update(standing=False, drives=drives(state=STOPS))
    if mode is FaultMode:
        player.world["verdict"] = verdict("DRV-25", "steer-left")
    return player


def unresponsive(player: Player, *names: str) -> None:
    """These still drive, whatever they were told."""
    enabled = [drive(name, age=None) for name in names]
    player.world["drives"] = drives(*enabled, state=STOPS)


# ---------------------------------------------------------------------------------------------- the heartbeat


@pytest.mark.parametrize("mode", MODES)
def test_heartbeat_withheld_for_one_wheel_does_not_return_when_the_other_is_stopped_later(
    mode: Callable[[Shared], ModeLogic],
) -> None:
    player = stopping(mode)
    player.refused.add((JobKind.HALT, LEFT))
    unresponsive(player, LEFT)
    player.tick()
    assert not player.tick().heartbeat
    unresponsive(player, LEFT, RIGHT)
    assert [job.drive for job in player.tick().jobs] == [RIGHT]
    assert [player.tick().heartbeat for _ in range(20)] == [False] * 20, "the first wheel still drives"


@pytest.mark.parametrize("order", [(LEFT, RIGHT), (RIGHT, LEFT)])
def test_heartbeat_is_withheld_where_one_of_two_wheels_cannot_be_stopped(order: tuple[str, str]) -> None:
    player = stopping(QuickstopMode)
    player.refused.add((JobKind.HALT, order[0]))
    unresponsive(player, *order)
    assert player.tick().heartbeat, "both are asked first"
    assert [player.tick().heartbeat for _ in range(5)] == [False] * 5


@pytest.mark.parametrize("mode", [QuickstopMode, FaultMode])
def test_heartbeat_withheld_for_a_drive_that_stays_on_does_not_return_when_another_is_switched_off(
    mode: Callable[[Shared], ModeLogic],
) -> None:
    player = stopping(mode)
    on = [drive(name, state=DriveState.OPERATION_ENABLE) for name in ("steer-left", "steer-right")]
    player.world.update(standing=True, drives=drives(*on, state=OFF))
    player.until(lambda wish: any(job.kind is JobKind.HALT for job in wish.jobs))
    left, right = (job for job in player.wishes[-1].jobs if job.kind is JobKind.HALT)
    failed, done = (
        JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=ok, fault="" if ok else "COM-08")
        for job, ok in ((left, False), (right, True))
    )
    assert not player.tick(results=(failed,)).heartbeat
    assert not player.tick(results=(done,)).heartbeat
    assert not player.tick(results=()).heartbeat


# ---------------------------------------------------------------------------------------------- the stop under way


@pytest.mark.parametrize("mode", MODES)
def test_stop_that_is_over_is_forgotten(mode: Callable[[Shared], ModeLogic]) -> None:
    player = stopping(mode)
    player.refused.add((JobKind.HALT, LEFT))
    unresponsive(player, LEFT)
    player.tick()
    assert not player.tick().heartbeat
    assert player.mode.shared.bring_up.stop is not None
    player.world.update(standing=True, drives=drives(state=OFF))
    player.time += STANDING_TIME
    player.tick()
    assert player.mode.shared.bring_up.stop is None


def test_next_stop_has_its_own_time_and_heartbeat_and_stops_an_unresponsive_wheel_again() -> None:
    player = stopping(QuickstopMode)
    player.refused.add((JobKind.HALT, LEFT))
    unresponsive(player, LEFT)
    player.until(lambda wish: not wish.heartbeat)
    player.world.update(standing=True, drives=drives(state=OFF))
    player.until(lambda wish: wish.traction is Goal.DISABLED)
    player.time += 100.0
    player.refused.clear()
    player.world["standing"] = False
    unresponsive(player, LEFT)
    player.enter()
    first = player.tick()
    assert (first.traction, first.heartbeat) == (Goal.QUICK_STOPPED, True)
    assert [(job.kind, job.drive) for job in first.jobs] == [(JobKind.HALT, LEFT)]
    assert player.tick().traction is Goal.QUICK_STOPPED


# ---------------------------------------------------------------------------------------------- the arm that is missing


def test_arm_after_a_stop_lets_what_recovers_by_itself_go_on_again() -> None:
    robot = ObedientDrives()
    steps = shared(CalibrateStep(), connected=True, aligned=True, armed=False, held=True)
    player = Player(QuickstopMode(steps), robot.react)
    player.until(lambda wish: wish.phase == "stopped: arm to continue")
    assert steps.bring_up.held
    player.tick(requests=(Request.ARM,))
    assert not steps.bring_up.held
    assert player.until(has_event).event is Event.REARMED


def test_arm_that_is_refused_is_still_missing() -> None:
    steps = shared(CalibrateStep(), connected=True, aligned=True, armed=False, held=True)
    player = Player(QuickstopMode(steps))
    player.world["drives"] = drives(state=OFF)
    player.until(lambda wish: wish.phase == "stopped: arm to continue")
    player.tick(requests=(Request.ARM,), verdict=verdict("INP-03", "stick"))
    assert steps.bring_up.held


@pytest.mark.parametrize("armed", [True, False], ids=["armed before", "armed when it waits"])
def test_arm_of_a_bring_up_lets_what_recovers_by_itself_go_on_again(armed: bool) -> None:
    steps = shared(CalibrateStep(), armed=armed, held=True)
    player = Player(InitMode(steps), ObedientDrives().react)
    if not armed:
        player.until(lambda wish: wish.phase == "waiting for arm")
        assert steps.bring_up.held
        player.tick(requests=(Request.ARM,))
    assert player.until(has_event).event is Event.ALIGNED
    assert not steps.bring_up.held


def test_fault_that_recovers_by_itself_goes_on_after_an_earlier_stop_was_armed() -> None:
    steps = shared(WaitStep(seconds=9.0), connected=True, aligned=True, armed=False)
    modes, robot = Modes(steps), ObedientDrives(DriveState.OPERATION_ENABLE)
    modes.advance(snapshot(), Event.ALIGNED)
    modes.advance(snapshot(requests=(Request.QUICKSTOP,)), None)
    assert (modes.mode, steps.bring_up.held) == (Mode.QUICKSTOP, True)
    stop = Player(modes._logic[Mode.QUICKSTOP], robot.react)
    stop.until(lambda wish: wish.phase == "stopped: arm to continue")
    stop.tick(requests=(Request.ARM,))
    assert stop.until(has_event).event is Event.REARMED
    modes.advance(snapshot(), Event.REARMED)
    found = judged("COM-11", recovers=True, resumes=True)
    modes.advance(snapshot(verdict=found), None)
    fault = Player(modes._logic[Mode.FAULT], robot.react)
    fault.world["verdict"] = found
    fault.until(lambda wish: wish.phase == "recovers automatically")
    assert fault.tick(verdict=Verdict()).event is Event.ACKNOWLEDGED


# ---------------------------------------------------------------------------------------------- time


def test_seconds_of_a_step_by_hand_go_on_after_each_of_two_stops() -> None:
    live = Live(TeleopStep(input="stick", seconds=2.0))
    by_hand = 0
    for _ in range(2):
        live.until(Mode.TELEOP)
        by_hand += 1
        for _ in range(24):
            assert live.tick(inputs=(AHEAD,)).mode is Mode.TELEOP
            by_hand += 1
        live.until(Mode.QUICKSTOP, requests=(Request.QUICKSTOP,), inputs=(REST,))
        live.until(lambda tick: tick.wish.phase == "stopped: arm to continue", inputs=(REST,))
        live.until(lambda tick: tick.mode is Mode.READY, requests=(Request.ARM,), inputs=(REST,))
    live.until(Mode.TELEOP)
    while live.ticks[-1].mode is Mode.TELEOP:
        live.tick(inputs=(REST,))
        by_hand += 1
    assert by_hand * PERIOD == pytest.approx(2.0, abs=0.1)
    assert live.ticks[-1].position.step == 1
