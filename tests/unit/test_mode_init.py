"""Bring-up, step by step, with drives that obey, and with drives that do not."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from core_builders import (
    LOST_HEARTBEAT,
    NAMES,
    PERIOD,
    STEERING,
    TRACTION,
    WATCH,
    ObedientDrives,
    Player,
    expires,
    fault_of,
    has_event,
    has_fault,
    powered,
    shared,
    volts,
)
from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal, Nmt
from artemis.states.init import InitMode
from artemis.states.plan import CalibrateStep
from artemis.values import DriveCommand, Event, JobKind, OperatorInput, Request, SetPoints, Wish


class BringUp:
    """Init with drives that obey."""

    def __init__(self, *, armed: bool = True) -> None:
        self.shared = shared(CalibrateStep(), armed=armed)
        self.state = self.shared.bring_up
        self.drives = ObedientDrives()
        self.player = Player(InitMode(self.shared), self.drives.react)

    def fault(self) -> tuple[str, str]:
        return fault_of(self.player.until(has_fault, longest=60.0))


def test_init_listens_before_it_says_anything() -> None:
    bring_up = BringUp()
    first = bring_up.player.until(lambda wish: bool(wish.jobs or wish.exchange or wish.heartbeat))
    assert first.jobs
    assert bring_up.player.time - PERIOD == pytest.approx(0.3, abs=PERIOD)


def test_init_secures_traction_before_steering_before_it_configures_anything() -> None:
    bring_up = BringUp()
    bring_up.player.until(has_event)
    orders = [(wish.jobs[0].kind, {job.drive for job in wish.jobs}) for wish in bring_up.player.wishes if wish.jobs]
    assert orders[:5] == [
        (JobKind.SECURE, set(TRACTION)),
        (JobKind.SECURE, set(STEERING)),
        (JobKind.CONFIGURE, set(NAMES)),
        (JobKind.REFERENCE, set(STEERING)),
        (JobKind.CLEAR_TARGET, set(NAMES)),
    ]
    ids = [job.id for job in bring_up.player.jobs]
    assert len(set(ids)) == len(ids)


def test_init_exchanges_nothing_before_every_drive_is_configured() -> None:
    bring_up = BringUp()
    bring_up.player.until(lambda wish: bool(wish.jobs) and wish.jobs[0].kind is JobKind.CONFIGURE)
    assert not any(wish.exchange or wish.heartbeat for wish in bring_up.player.wishes)
    assert not bring_up.state.connected


def test_init_goes_its_way_and_says_when_the_wheels_are_aligned() -> None:
    bring_up = BringUp()
    last = bring_up.player.until(has_event)
    assert last.event is Event.ALIGNED
    assert last.reset_pose
    assert bring_up.state.connected
    assert bring_up.state.aligned
    phases = [phase for phase, _ in itertools.groupby(wish.phase for wish in bring_up.player.wishes)]
    assert phases[:6] == ["listening", "secure", "configure", "first contact", "proving the watchdog", "reading poten"
                          "tiometers"]  # fmt: skip


def test_init_withholds_the_heartbeat_once_with_all_drives_off() -> None:
    bring_up = BringUp()
    bring_up.player.until(has_event)
    wishes = bring_up.player.wishes
    withheld = [wish for wish in wishes if wish.exchange and not wish.heartbeat]
    assert withheld
    assert all((wish.traction, wish.steering) == (Goal.DISABLED, Goal.DISABLED) for wish in withheld)
    reset = next(number for number, wish in enumerate(wishes) if wish.traction is Goal.FAULT_RESET)
    assert wishes.index(withheld[-1]) < reset
    assert not any(map(powered, wishes[:reset])), "no torque before the watchdog is proven"
    assert all(wish.heartbeat for wish in wishes[reset:])


def test_armed_init_takes_its_arm() -> None:
    bring_up = BringUp(armed=True)
    bring_up.player.until(has_event)
    assert not bring_up.state.armed, "the next bring-up waits for its own"


def test_init_that_is_not_armed_waits_with_the_drives_off_until_it_is() -> None:
    bring_up = BringUp(armed=False)
    bring_up.player.until(lambda wish: wish.phase == "waiting for arm")
    for _ in range(200):
        wish = bring_up.player.tick()
        assert wish.phase == "waiting for arm"
        assert not powered(wish)
    bring_up.player.tick(requests=(Request.ACKNOWLEDGE,))
    assert bring_up.player.tick().phase == "waiting for arm", "an acknowledgment is no arm"
    assert bring_up.player.tick(requests=(Request.ARM,)).phase != "waiting for arm"
    assert bring_up.player.until(has_event).event is Event.ALIGNED


PRESSED = (OperatorInput(source="stick"), OperatorInput(source="other", neutral=False, age=0.0))


def test_arm_with_a_control_pressed_is_refused_and_not_kept() -> None:
    bring_up = BringUp(armed=False)
    player = bring_up.player
    player.until(lambda wish: wish.phase == "waiting for arm")
    assert player.tick(inputs=PRESSED, requests=(Request.ARM,)).phase == "release the controls"
    assert player.tick().phase == "waiting for arm"
    assert player.tick(requests=(Request.ARM,)).phase != "waiting for arm"


@pytest.mark.parametrize("attended", [True, False])
def test_bring_up_that_is_armed_goes_on_once_the_controls_are_released(attended: bool) -> None:
    bring_up = BringUp(armed=True)
    player = bring_up.player
    player.world.update(inputs=PRESSED, attended=attended)
    player.until(lambda wish: wish.phase == "release the controls")
    for _ in range(50):
        wish = player.tick()
        assert (wish.phase, powered(wish), wish.event) == ("release the controls", False, None)
    player.world["inputs"] = ()
    assert player.until(has_event).event is Event.ALIGNED


@pytest.mark.parametrize(("armed", "inputs"), [(False, ()), (True, PRESSED)], ids=["not armed", "controls held"])
def test_bring_up_ends_as_failed_when_nobody_comes_for_ten_minutes(
    armed: bool, inputs: tuple[OperatorInput, ...]
) -> None:
    bring_up = BringUp(armed=armed)
    bring_up.player.world["inputs"] = inputs
    bring_up.player.until(lambda wish: wish.phase in ("waiting for arm", "release the controls"))
    expires(bring_up.player)


def test_later_bring_ups_keep_the_pose() -> None:
    bring_up = BringUp()
    assert bring_up.player.until(has_event).reset_pose
    bring_up.state.armed = True
    bring_up.player.enter()
    assert not bring_up.player.until(has_event).reset_pose


def test_nobody_there_to_arm_ends_the_run_as_failed() -> None:
    bring_up = BringUp(armed=False)
    bring_up.player.world["attended"] = False
    wish = bring_up.player.until(has_event)
    assert (wish.event, wish.failed) == (Event.END, True)
    assert not any(map(powered, bring_up.player.wishes))


def test_bring_up_waits_for_somebody_who_may_still_come_to_arm() -> None:
    bring_up = BringUp(armed=False)
    bring_up.player.world.update(attended=False, awaited=True)
    bring_up.player.until(lambda wish: "waiting for arm" in wish.phase)
    expires(bring_up.player)


@pytest.mark.parametrize("kind", [JobKind.SECURE, JobKind.CONFIGURE, JobKind.REFERENCE, JobKind.CLEAR_TARGET])
@pytest.mark.parametrize("name", ["traction-right", "steer-left"])
def test_job_that_fails_in_init_is_a_fault_of_its_drive(kind: JobKind, name: str) -> None:
    if kind is JobKind.REFERENCE and name in TRACTION:
        return
    bring_up = BringUp()
    bring_up.player.refused.add((kind, name))
    assert bring_up.fault() == ("COM-08", name)
    assert "broken in the test" in str(bring_up.player.wishes[-1].fault)
    after = [bring_up.player.tick() for _ in range(10)]
    assert not any(map(powered, after))
    assert not any(wish.fault or wish.event or wish.jobs for wish in after)


def test_configuration_is_not_begun_when_a_drive_cannot_be_secured() -> None:
    bring_up = BringUp()
    bring_up.player.refused.add((JobKind.SECURE, "traction-left"))
    bring_up.fault()
    assert {(job.kind, job.drive) for job in bring_up.player.jobs} == {(JobKind.SECURE, name) for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_drive_that_does_not_miss_our_heartbeat_is_refused(name: str) -> None:
    bring_up = BringUp()
    bring_up.drives.unresponsive.add(name)
    assert bring_up.fault() == ("COM-30", name)
    assert not any(map(powered, bring_up.player.wishes))


def test_drive_in_fault_for_another_reason_has_not_proven_that_it_watches() -> None:
    bring_up = BringUp()
    bring_up.drives.changes["steer-right"] = {"emergencies": (0x8120,)}
    assert bring_up.fault() == ("COM-30", "steer-right")


def test_emergency_in_one_tick_and_fault_state_in_another_prove_it_too() -> None:
    bring_up = BringUp()
    player, late = bring_up.player, "steer-right"
    player.until(lambda wish: wish.exchange and not wish.heartbeat)
    for _ in range(WATCH - 1):
        player.tick()
    feedback = bring_up.drives.react(player.wishes[-1], SetPoints())
    assert all(LOST_HEARTBEAT in each.emergencies for each in feedback)
    waiting = [replace(each, state=DriveState.SWITCH_ON_DISABLED) if each.name == late else each for each in feedback]
    assert player.tick(drives=tuple(waiting)).traction is Goal.DISABLED
    both = player.tick(drives=tuple(replace(each, emergencies=()) for each in feedback))
    assert both.traction is Goal.FAULT_RESET


@pytest.mark.parametrize("state", [DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED])
@pytest.mark.parametrize("silent", [False, True], ids=["first contact", "heartbeat withheld"])
def test_fault_before_a_drive_can_miss_our_heartbeat_is_not_reset(state: DriveState, silent: bool) -> None:
    bring_up = BringUp()
    player = bring_up.player
    player.until(lambda wish: wish.exchange and wish.heartbeat is not silent)
    for _ in range(WATCH - 3 if silent else 2):
        player.tick()
    bring_up.drives.changes["steer-left"] = {"state": state}
    assert fault_of(player.tick()) == ("COM-01", "steer-left")
    assert not any(Goal.FAULT_RESET in (wish.traction, wish.steering) for wish in player.wishes)


def test_fault_that_cannot_be_reset_is_a_fault_of_its_drive() -> None:
    bring_up = BringUp()
    bring_up.player.until(lambda wish: wish.traction is Goal.FAULT_RESET)
    bring_up.drives.changes["traction-left"] = {"state": DriveState.FAULT}
    assert bring_up.fault() == ("COM-01", "traction-left")


@pytest.mark.parametrize(
    "trouble", [{"age": None}, {"nmt": Nmt.PRE_OPERATIONAL}, {"state": DriveState.READY}], ids=["mute", "nmt", "state"]
)
def test_drive_that_does_not_come_into_contact_is_a_fault(trouble: dict[str, object]) -> None:
    bring_up = BringUp()
    bring_up.drives.changes["steer-left"] = dict(trouble)
    assert bring_up.fault() == ("COM-08", "steer-left")


@pytest.mark.parametrize("shown", [(0.0, 2.48), (2.51, 4.99), (0.09, 2.48), (2.51, 4.91)])
def test_potentiometer_at_a_rail_is_open_or_shorted(shown: tuple[float, float]) -> None:
    bring_up = BringUp()
    bring_up.drives.changes["steer-left"] = {"potentiometers": shown}
    assert bring_up.fault() == ("STE-04", "steer-left")
    assert not any(map(powered, bring_up.player.wishes))


@pytest.mark.parametrize(("off_by_deg", "ok"), [(2.9, True), (3.1, False), (-3.1, False)])
def test_potentiometers_of_a_wheel_must_agree_to_three_degrees(off_by_deg: float, ok: bool) -> None:
    bring_up = BringUp()
    first, second = volts("right", 0.0)
    bring_up.drives.angles["steer-right"] = 0.0
    bring_up.drives.changes["steer-right"] = {"potentiometers": (first, second + off_by_deg / 72.0)}
    if ok:
        bring_up.player.until(powered)
    else:
        assert bring_up.fault() == ("STE-03", "steer-right")
        assert not any(map(powered, bring_up.player.wishes))


def test_angle_told_to_a_drive_is_the_mean_of_many_readings() -> None:
    bring_up = BringUp()
    turned = math.radians(12.0)
    readings = itertools.count()

    def shaky(wish: Wish, points: SetPoints) -> Any:
        noise = math.radians(1.0) * (-1) ** next(readings)
        bring_up.drives.changes["steer-left"] = {"potentiometers": volts("left", turned + noise)}
        return bring_up.drives.react(wish, points)

    player = Player(InitMode(bring_up.shared), shaky)
    ordered = player.until(lambda wish: bool(wish.jobs) and wish.jobs[0].kind is JobKind.REFERENCE)
    told = {job.drive: job.value for job in ordered.jobs}
    assert told["steer-left"] == pytest.approx(turned, abs=math.radians(0.05))
    assert told["steer-right"] == pytest.approx(bring_up.drives.angles["steer-right"], abs=1e-6)


def test_wheel_that_does_not_reach_its_angle_is_a_fault() -> None:
    bring_up = BringUp()
    bring_up.drives.changes["steer-right"] = {"position": math.radians(20.0), "potentiometers": volts("right", 0.35)}
    assert bring_up.fault() == ("STE-01", "steer-right")


def test_encoder_that_turns_another_way_than_the_potentiometers_is_a_fault() -> None:
    bring_up = BringUp()
    bring_up.player.until(powered)
    bring_up.drives.changes["steer-left"] = {"potentiometers": volts("left", math.radians(7.0))}  # its shaft slips
    assert bring_up.fault() == ("STE-05", "steer-left")


def test_wheels_end_straight_with_the_drives_enabled() -> None:
    bring_up = BringUp()
    bring_up.player.until(has_event)
    assert bring_up.player.wishes[-1].command == DriveCommand()
    assert [bring_up.drives.angles[name] for name in STEERING] == pytest.approx([0.0, 0.0], abs=math.radians(0.5))
    assert set(bring_up.drives.states.values()) == {DriveState.OPERATION_ENABLE}


def test_init_never_wishes_a_speed() -> None:
    bring_up = BringUp()
    bring_up.player.until(has_event)
    assert {wish.command.speed for wish in bring_up.player.wishes} == {0.0}


def test_init_begins_from_the_start_when_it_is_entered_again() -> None:
    bring_up = BringUp()
    bring_up.player.until(lambda wish: wish.phase == "first contact")
    bring_up.player.enter()
    wish = bring_up.player.tick()
    assert (wish.phase, wish.heartbeat, wish.exchange) == ("listening", True, False), "they still watch us"
    assert not bring_up.state.connected
