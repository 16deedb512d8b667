"""Bring-up to the tick: what is sent in each phase, how long is waited, how the watchdog is proven."""

from __future__ import annotations

from itertools import groupby

import core_builders
import pytest
from core_builders import NAMES, PERIOD, ROBOT, ObedientDrives, Player, fault_of, has_event, has_fault, shared
from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal
from artemis.motion.potentiometers import memory_numbers
from artemis.states import init
from artemis.states.init import ANSWER_TIME, HEARTBEATS, WATCH_TIME, InitMode
from artemis.states.mode import PATIENCE
from artemis.states.plan import CalibrateStep, Plan, Shared
from artemis.values import RESETS, Event, JobKind, JobResult, Wish

Sent = tuple[bool, bool, bool]
"""Exchange, heartbeat, supervised."""


def bring_up(drives: ObedientDrives | None = None, **state: bool) -> Player:
    return Player(InitMode(shared(CalibrateStep(), **state)), (drives or ObedientDrives()).react)


def sent(wish: Wish) -> Sent:
    return wish.exchange, wish.heartbeat, wish.supervised


def phases(player: Player) -> list[tuple[str, Sent, Goal, Goal]]:
    """What was sent and wanted in one phase after the other."""
    return [key for key, _ in groupby((wish.phase, sent(wish), wish.traction, wish.steering) for wish in player.wishes)]


@pytest.mark.parametrize("connected", [False, True])
def test_each_phase_sends_what_belongs_to_it(connected: bool) -> None:
    player = bring_up(connected=connected)
    player.until(has_event)
    off, reset = (Goal.DISABLED, Goal.DISABLED), (Goal.FAULT_RESET, Goal.FAULT_RESET)
    assert phases(player)[:7] == [
        *((phase, (False, connected, False), *off) for phase in ("listening", "secure", "configure")),
        ("first contact", (True, True, False), *off),
        ("proving the watchdog", (True, False, False), *off),
        ("proving the watchdog", (True, True, False), *reset),
        ("reading potentiometers", (True, True, True), *off),
    ]


def test_drives_hear_five_heartbeats_before_one_is_withheld() -> None:
    player = bring_up()
    player.until(lambda wish: wish.phase == "proving the watchdog")
    waking = [wish for wish in player.wishes if wish.phase == "first contact"]
    assert len(waking) == 1 + HEARTBEATS == 6, "one until all drives are off, then five"


@pytest.mark.parametrize(("after", "fault"), [(7, ("COM-01", "traction-left")), (9, None)])
def test_drive_that_is_in_fault_sooner_than_it_could_miss_us_has_another_reason(
    after: int, fault: tuple[str, str] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(core_builders, "WATCH", after)
    player = bring_up()
    wish = player.until(lambda wish: has_fault(wish) or has_event(wish))
    assert (fault_of(wish) if has_fault(wish) else None) == fault


@pytest.mark.parametrize(
    ("changes", "fault", "problem"),
    [
        ({"age": None}, "COM-08", "no process data after configuration; state switch on disabled"),
        ({"state": DriveState.READY}, "COM-08", "no process data after configuration; state ready to switch on"),
        ({"state": DriveState.FAULT}, "COM-01", "no process data after configuration; state fault"),
    ],
)
def test_drive_that_is_not_off_in_time_is_a_fault_after_one_and_a_half_seconds(
    changes: dict[str, object], fault: str, problem: str
) -> None:
    drives = ObedientDrives()
    drives.changes["steer-right"] = changes
    player = bring_up(drives)
    player.until(lambda wish: wish.phase == "first contact")
    begun = player.time
    wish = player.until(has_fault)
    assert player.time - begun == pytest.approx(ANSWER_TIME, abs=2 * PERIOD)
    assert pytest.approx(1.5) == ANSWER_TIME
    assert fault_of(wish) == (fault, "steer-right")
    assert problem in str(wish.fault)
    assert [sent(player.tick()) for _ in range(3)] == [(False, False, False)] * 3, "and says nothing more"


def test_a_drive_that_is_allowed_more_is_waited_for_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(init, "change_time", lambda plan, usual: usual + 2.0)
    drives = ObedientDrives()
    drives.changes["steer-right"] = {"state": DriveState.READY}
    player = bring_up(drives)
    player.until(lambda wish: wish.phase == "first contact")
    begun = player.time
    player.until(has_fault)
    assert player.time - begun == pytest.approx(ANSWER_TIME + 2.0, abs=2 * PERIOD)


def test_drive_that_does_not_notice_a_missing_heartbeat_is_a_fault() -> None:
    drives = ObedientDrives()
    drives.unresponsive.add("traction-right")
    player = bring_up(drives)
    wish = player.until(has_fault)
    assert fault_of(wish) == ("COM-30", "traction-right")
    assert "no fault without our heartbeat; state switch on disabled" in str(wish.fault)
    assert sent(wish) == (False, False, False)


def test_drive_whose_fault_is_not_reset_is_a_fault() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    player.until(lambda wish: wish.traction is Goal.FAULT_RESET)
    drives.lazy.update(NAMES)
    drives.states = dict.fromkeys(NAMES, DriveState.FAULT)
    wish = player.until(has_fault)
    assert fault_of(wish) == ("COM-01", NAMES[0])
    assert "fault reset refused; state fault" in str(wish.fault)


def test_what_the_steering_drives_keep_is_read_with_the_configuration() -> None:
    player = bring_up()
    asked = player.until(lambda wish: any(job.kind is JobKind.CONFIGURE for job in wish.jobs)).jobs
    assert [(job.kind, job.drive) for job in asked] == [(JobKind.CONFIGURE, name) for name in NAMES] + [
        (JobKind.READ_CALIBRATION, name) for name in NAMES if name.startswith("steer")
    ]
    assert player.until(has_event).event is Event.ALIGNED


def results_of(player: Player, values: dict[str, tuple[int, ...]]) -> tuple[JobResult, ...]:
    """What the last jobs bring back, all well: each steering drive keeps these numbers."""
    return tuple(
        JobResult(
            id=job.id,
            kind=job.kind,
            drive=job.drive,
            ok=True,
            values=values.get(job.drive, ()) if job.kind is JobKind.READ_CALIBRATION else (),
        )
        for job in player.wishes[-1].jobs
    )


@pytest.mark.parametrize(("kept", "fault"), [
    ((0, 0, 0, 0), None), ((1, 2, 3, 4), ("CAL-02", "steer-left")),
    (memory_numbers(ROBOT.potentiometers("left")), None),
])  # fmt: skip
def test_steering_drive_that_keeps_another_calibration_is_a_fault(
    kept: tuple[int, ...], fault: tuple[str, str] | None
) -> None:
    player = bring_up()
    player.until(lambda wish: any(job.kind is JobKind.CONFIGURE for job in wish.jobs))
    player.tick(results=results_of(player, {"steer-left": kept}))
    wish = player.wishes[-1] if fault else player.until(has_event)
    assert (fault_of(wish) if has_fault(wish) else None) == fault


def forgetful() -> Player:
    """After the configuration of drives of which one forgets it with the heartbeat."""
    player = bring_up()
    player.until(lambda wish: any(job.kind is JobKind.CONFIGURE for job in wish.jobs))
    told = results_of(player, {})
    player.tick(results=tuple(replace(each, values=(1,)) if each.drive == "traction-left" else each for each in told))
    return player


def test_drive_that_forgets_with_the_heartbeat_is_configured_again_after_the_proof() -> None:
    player = forgetful()
    assert player.until(has_event).event is Event.ALIGNED
    proof = [wish.phase for wish in player.wishes].index("proving the watchdog")
    again = [(job.kind, job.drive, job.value) for wish in player.wishes[proof:] for job in wish.jobs]
    assert again[:2] == [
        (JobKind.SECURE, "traction-left", RESETS["communication"]),
        (JobKind.CONFIGURE, "traction-left", 0.0),
    ]


def test_drive_that_cannot_be_configured_again_is_a_fault() -> None:
    player = forgetful()
    player.refused.add((JobKind.CONFIGURE, "traction-left"))
    assert fault_of(player.until(has_fault)) == ("COM-08", "traction-left")


def test_drive_that_cannot_be_configured_is_a_fault() -> None:
    player = bring_up()
    player.refused.add((JobKind.CONFIGURE, "traction-right"))
    assert fault_of(player.until(has_fault)) == ("COM-08", "traction-right")


def test_bring_up_is_armed_within_ten_minutes_and_not_a_tick_later() -> None:
    player = bring_up(armed=False)
    player.until(lambda wish: wish.phase == "waiting for arm")
    player.time += PATIENCE - PERIOD
    assert player.tick().event is None
    assert player.tick().event is Event.END


@pytest.mark.parametrize("blind", [False, True])
def test_robot_with_new_potentiometers_is_taken_as_it_is_found_and_cannot_drive(blind: bool) -> None:
    run = Shared(Plan(robot=ROBOT, steps=(CalibrateStep(),), found={"left": 0.1} if blind else None))
    player = Player(InitMode(run), ObedientDrives().react)
    wish = player.until(has_event)
    assert (wish.event, wish.phase, wish.reset_pose) == (Event.ALIGNED, "as found" if blind else "aligned", True)
    assert wish.traction is player.tick().traction is (Goal.DISABLED if blind else Goal.ENABLED)
    assert run.bring_up.aligned is not blind


def test_history_that_cannot_be_read_or_is_empty_proves_nothing() -> None:
    for result, told in (
        ({"ok": True}, "in fault for another reason: none"),
        ({"ok": False, "detail": "no answer"}, "in fault for another reason: no answer"),
    ):
        drives = ObedientDrives()
        drives.changes["steer-left"] = {"emergencies": ()}
        player = bring_up(drives)
        (job,) = player.until(lambda wish: any(job.kind is JobKind.READ_HISTORY for job in wish.jobs)).jobs
        assert job.drive == "steer-left"
        found = JobResult(id=job.id, kind=job.kind, drive=job.drive, **result)
        wish = player.tick(results=(found,))
        assert fault_of(wish) == ("COM-30", "steer-left")
        assert told in str(wish.fault)


@pytest.mark.parametrize("when", ["first contact", "heartbeat withheld", "fault reset"])
def test_drive_that_restarts_before_it_is_proven_is_a_fault(when: str) -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    reached = {
        "first contact": lambda wish: wish.phase == "first contact",
        "heartbeat withheld": lambda wish: wish.phase == "proving the watchdog",
        "fault reset": lambda wish: wish.traction is Goal.FAULT_RESET,
    }
    player.until(reached[when])
    drives.changes["steer-left"] = {"boots": 1}
    assert fault_of(player.until(has_fault, longest=3 * PERIOD)) == ("COM-26", "steer-left")


def test_drive_that_restarts_while_another_is_asked_for_its_history_is_a_fault() -> None:
    drives = ObedientDrives()
    drives.changes["steer-left"] = {"emergencies": ()}  # lost: the drive is asked
    player = bring_up(drives)
    player.until(lambda wish: any(job.kind is JobKind.READ_HISTORY for job in wish.jobs))
    drives.changes["traction-left"] = {"boots": 1}
    assert fault_of(player.tick(results=())) == ("COM-26", "traction-left")


def test_first_of_several_drives_that_are_late_is_named_with_its_own_state() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    drives.changes["traction-right"] = {"age": None}
    drives.changes["steer-right"] = {"state": DriveState.FAULT}
    wish = player.until(has_fault)
    assert fault_of(wish) == ("COM-08", "traction-right")
    assert "no process data after configuration; state switch on disabled" in str(wish.fault)


def test_drive_that_is_in_fault_before_it_could_miss_us_is_told_so() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    player.until(lambda wish: wish.phase == "first contact")
    player.tick()
    drives.changes["traction-right"] = {"state": DriveState.FAULT}
    wish = player.until(has_fault)
    assert fault_of(wish) == ("COM-01", "traction-right")
    assert "before it could miss us" in str(wish.fault)


def test_fault_reset_that_is_not_obeyed_for_another_reason_is_told_so() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    player.until(lambda wish: wish.traction is Goal.FAULT_RESET)
    drives.changes["traction-left"] = {"age": None}
    wish = player.until(has_fault)
    assert fault_of(wish) == ("COM-08", "traction-left")
    assert "fault reset refused; state switch on disabled" in str(wish.fault)


def test_drive_has_one_and_a_half_seconds_and_not_a_tick_longer() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    drives.changes["traction-right"] = {"age": None}
    player.until(lambda wish: wish.phase == "first contact")
    player.time = player.time - PERIOD + ANSWER_TIME
    assert not has_fault(player.tick())
    assert has_fault(player.tick())


def test_drive_may_miss_us_from_the_very_end_of_its_time_on() -> None:
    drives = ObedientDrives()
    player = bring_up(drives)
    player.until(lambda wish: wish.phase == "proving the watchdog")
    last_beat = player.time - 2 * PERIOD
    for name in NAMES:
        drives.changes[name] = {"state": DriveState.FAULT, "emergencies": (0x8130,)}
    player.time = last_beat + WATCH_TIME
    assert not has_fault(player.tick())
