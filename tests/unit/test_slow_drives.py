"""Drives that may take seconds to change their state: what waits for them, and what does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from core_builders import (
    LOST_HEARTBEAT,
    NAMES,
    PERIOD,
    ObedientDrives,
    Player,
    drive,
    drives,
    fault_of,
    has_event,
    has_fault,
)

from artemis.drive_states import DriveState, Goal
from artemis.mission.loading import load_model
from artemis.states.end import EndMode
from artemis.states.init import InitMode
from artemis.states.plan import CalibrateStep, Plan, Shared
from artemis.values import DriveFeedback, SetPoints, Wish
from artemis.vehicle import RobotFile

CIA402 = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_cia402.yaml", RobotFile)
PROVING = "proving the watchdog"


def slow() -> Shared:
    """Of a robot whose drives may take 30 s for a change of state."""
    known = {}
    for name, each in CIA402.drives.items():
        assert each.cia402 is not None
        known[name] = each.model_copy(update={"cia402": each.cia402.model_copy(update={"state_time_s": 30.0})})
    return Shared(Plan(robot=CIA402.model_copy(update={"drives": known}), steps=(CalibrateStep(),)))


class Late(ObedientDrives):
    """One of them notices that our heartbeat is lost so long [s] after it was withheld."""

    def __init__(self, late: float) -> None:
        super().__init__()
        self.unresponsive = {NAMES[0]}
        self._left = round(late / PERIOD)

    def react(self, wish: Wish, points: SetPoints) -> tuple[DriveFeedback, ...]:
        """As the others, but later."""
        noticed = False
        if wish.phase == PROVING and not wish.heartbeat:
            self._left -= 1
            noticed = self._left == 0
        if noticed:
            self.states[NAMES[0]] = DriveState.FAULT
        self.changes[NAMES[0]] = {"emergencies": (LOST_HEARTBEAT,)} if noticed else {}
        return super().react(wish, points)


@pytest.mark.parametrize("late", [1.4, 1.6, 20.0])
def test_a_drive_that_misses_our_heartbeat_late_does_not_watch_however_slowly_it_changes_its_state(late: float) -> None:
    """What may take long is a change of state; the time after which a drive misses the heartbeat is written into it."""
    player = Player(InitMode(slow()), Late(late).react)

    wish = player.until(lambda wish: has_fault(wish) or has_event(wish), longest=60.0)

    if late > 1.5:
        assert fault_of(wish) == ("COM-30", NAMES[0])
        silent = [wish for wish in player.wishes if wish.phase == PROVING and not wish.heartbeat]
        assert len(silent) * PERIOD == pytest.approx(1.5, abs=2 * PERIOD)
    else:
        assert wish.fault is None


def test_the_reset_after_the_proof_may_take_as_long_as_a_change_of_state() -> None:
    machines = ObedientDrives()
    player = Player(InitMode(slow()), machines.react)
    player.until(lambda wish: wish.phase == PROVING and wish.traction is Goal.FAULT_RESET)
    machines.lazy = {NAMES[0]}
    for _ in range(round(20.0 / PERIOD)):
        assert player.tick().fault is None
    machines.lazy = set()
    assert player.until(has_event).fault is None


@pytest.mark.parametrize(("needed", "waits"), [(5.0, True), (29.9, True), (30.1, False)])
def test_the_end_waits_for_a_drive_to_be_off_as_long_as_it_may_take(needed: float, waits: bool) -> None:
    shared = slow()
    shared.bring_up.connected = True
    player = Player(EndMode(shared))
    off = drives(state=DriveState.SWITCH_ON_DISABLED)
    on = drives(drive(NAMES[0], state=DriveState.QUICK_STOP_ACTIVE), state=DriveState.SWITCH_ON_DISABLED)
    player.world["drives"] = on
    player.until(lambda wish: wish.phase == "ending")
    begun = player.time - PERIOD
    while player.time < begun + needed:
        player.tick()
    assert bool(player.jobs) is not waits
    player.world["drives"] = off
    player.until(lambda wish: wish.finished)
