"""Several inputs in one step: the first that is active has the robot, a later one begins at standstill and at rest."""

from __future__ import annotations

import itertools

import pytest
from core_builders import ROBOT, Player, sensed, shared, verdict
from live_core import Live
from msgspec.structs import replace

from artemis.plugins.stated import STALE
from artemis.robot import Core
from artemis.states.modes import Modes
from artemis.states.plan import Plan, TeleopStep, WaitStep
from artemis.states.priority import HandOver, Priority
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.supervision import catalogue
from artemis.supervision.supervisor import Supervisor
from artemis.values import DriveCommand, Event, Fault, Mode, OperatorInput, Request, SetPoints, Severity, Wish

STEP = TeleopStep(input="pilot", lower=("trainee",), seconds=None)
REST = OperatorInput(source="", age=0.0)
HELD = replace(REST, enabled=True, neutral=False, speed=0.3, steering=0.1)
MOVED = replace(REST, neutral=False)
"""The stick is deflected, the enable button released."""
LOST, FROZEN = replace(HELD, age=None), replace(HELD, age=STALE + 0.01)
DRIVES = DriveCommand(speed=0.3, steering=0.1)
STANDS = DriveCommand(steering=0.0)


def given(*samples: OperatorInput) -> tuple[OperatorInput, ...]:
    """Samples of the step's inputs, in their order."""
    names = ("pilot", "trainee", "guest")
    return tuple(replace(sample, source=name) for name, sample in zip(names, samples, strict=False))


class Two:
    """A pilot, and a trainee behind, tick by tick; the robot begins at rest."""

    def __init__(self, step: TeleopStep = STEP) -> None:
        self.shared = shared(step)
        self._player = Player(TeleopMode(self.shared))

    def tick(self, *samples: OperatorInput, standing: bool = False) -> Wish:
        return self._player.tick(inputs=given(*samples), standing=standing, set_points=None)


# ---------------------------------------------------------------------------------------------- who has the robot


def test_first_active_input_drives_and_the_phase_names_it() -> None:
    two = Two()
    wish = two.tick(REST, HELD, standing=True)
    assert (wish.command, wish.phase) == (DRIVES, "driving: trainee")
    assert Two().tick(HELD, HELD, standing=True).phase == "driving: pilot"
    wish = Two().tick(REST, REST, standing=True)
    assert (wish.command, wish.phase) == (STANDS, "hold the enable button to drive")


def test_higher_input_takes_over_in_motion_at_once() -> None:
    two = Two()
    two.tick(REST, HELD, standing=True)
    two.tick(REST, HELD)
    back = replace(HELD, speed=-0.2, steering=-0.3)
    wish = two.tick(back, HELD)
    assert (wish.command, wish.phase) == (DriveCommand(speed=-0.2, steering=-0.3), "driving: pilot")
    assert two.tick(back, REST).phase == "driving: pilot"


def test_higher_input_with_a_deflected_stick_takes_over_too_as_it_was_at_rest_when_the_step_began() -> None:
    two = Two()
    two.tick(REST, HELD, standing=True)
    two.tick(MOVED, HELD)
    assert two.tick(HELD, HELD).phase == "driving: pilot"


def test_lower_input_gets_the_robot_back_only_at_standstill_and_after_all_its_controls_were_released() -> None:
    two = Two()
    two.tick(HELD, HELD, standing=True)
    wish = two.tick(REST, HELD)  # still held: nobody drives
    assert (wish.command, wish.phase) == (STANDS, "release all controls of trainee")
    assert two.tick(REST, HELD, standing=True).command == STANDS
    two.tick(REST, MOVED, standing=True)  # the button is released, the stick is not
    assert two.tick(REST, HELD, standing=True).phase == "release all controls of trainee"
    two.tick(REST, REST)  # neutral, but in motion
    wish = two.tick(REST, HELD)
    assert (wish.command, wish.phase) == (
        STANDS,
        "release the enable button of trainee, and press it again at standstill",
    )
    two.tick(REST, MOVED, standing=True)
    assert two.tick(REST, HELD, standing=True).phase == "driving: trainee"


def test_higher_input_that_let_go_in_motion_begins_again_at_standstill() -> None:
    two = Two()
    two.tick(HELD, REST, standing=True)
    two.tick(REST, HELD)  # the trainee presses: that does not count, and makes no press of the pilot count
    assert two.tick(HELD, HELD).phase == "release the enable button of pilot, and press it again at standstill"
    two.tick(REST, REST, standing=True)
    assert two.tick(HELD, REST, standing=True).phase == "driving: pilot"


def test_robot_of_one_input_says_what_it_always_did() -> None:
    player = Player(TeleopMode(shared(TeleopStep(input="pilot", seconds=None))))
    assert player.tick(inputs=given(HELD), standing=True, set_points=None).phase == "driving"
    player.tick(inputs=given(REST), standing=False)
    again = "release the enable button, and press it again at standstill"
    assert player.tick(inputs=given(HELD), standing=False).phase == again


def test_any_input_of_the_step_ends_it_and_records() -> None:
    done = replace(REST, requests=(Request.DONE,))
    for samples in ((done, REST), (REST, done)):
        assert Two().tick(*samples, standing=True).event is Event.DONE
    pressed = replace(REST, requests=(Request.RECORD,))
    two = Two(replace(STEP, record="way"))
    two.tick(REST, pressed, standing=True)
    track = two.shared.results.tracks["way"]
    two.tick(HELD, REST, standing=True)
    assert track.poses


def test_step_waits_until_the_controls_of_all_its_inputs_rest() -> None:
    player = Player(ReadyMode(shared(STEP)))
    assert player.tick(inputs=given(REST, MOVED)).phase == "release the controls"
    assert player.tick(inputs=given(MOVED, REST)).phase == "release the controls"
    assert player.tick(inputs=given(REST, REST)).event is Event.TELEOP
    other = replace(MOVED, source="other")
    assert player.tick(inputs=(*given(REST, REST), other)).event is Event.TELEOP


# ---------------------------------------------------------------------------------------------- loss


@pytest.mark.parametrize(("sample", "id"), [(LOST, "INP-01"), (FROZEN, "INP-03")])
def test_loss_of_the_one_that_drives_and_of_one_before_it_stops(sample: OperatorInput, id: str) -> None:
    two = Two()
    two.tick(REST, HELD, standing=True)
    wish = two.tick(REST, sample)
    assert wish.fault == catalogue.fault(id, "trainee")
    assert (wish.command, wish.fault.severity) == (STANDS, Severity.CONTROLLED_STOP)
    two = Two()
    two.tick(REST, HELD, standing=True)
    wish = two.tick(sample, HELD)
    assert (wish.command, wish.fault) == (STANDS, catalogue.fault(id, "pilot"))


@pytest.mark.parametrize(("sample", "id"), [(LOST, "INP-01"), (FROZEN, "INP-03")])
def test_loss_of_a_lower_one_is_a_warning(sample: OperatorInput, id: str) -> None:
    warning = catalogue.fault(id, "trainee", severity=Severity.WARN)
    two = Two()
    wish = two.tick(HELD, sample, standing=True)
    assert (wish.command, wish.fault) == (DRIVES, warning)
    assert two.tick(REST, sample, standing=True).fault == warning
    assert two.tick(REST, REST, standing=True).fault is None
    assert Two().tick(REST, sample, standing=True).fault == warning


def test_nobody_but_the_first_is_needed_when_the_step_begins() -> None:
    assert Two().tick(LOST, REST).fault == catalogue.fault("INP-01", "pilot")
    assert Two().tick(REST, LOST).fault == catalogue.fault("INP-01", "trainee", severity=Severity.WARN)


def test_sample_is_new_enough_up_to_the_limit() -> None:
    assert Two().tick(replace(HELD, age=0.15), REST, standing=True).phase == "driving: pilot"
    assert Two().tick(replace(HELD, age=0.151), REST, standing=True).fault == catalogue.fault("INP-03", "pilot")


def test_one_that_was_lost_has_to_rest_before_it_may_drive_again() -> None:
    two = Two()
    two.tick(REST, LOST, standing=True)
    assert two.tick(REST, HELD, standing=True).phase == "release all controls of trainee"
    two.tick(REST, REST, standing=True)
    assert two.tick(REST, HELD, standing=True).phase == "driving: trainee"


def test_pilot_who_takes_over_from_a_trainee_that_is_lost_in_that_moment_drives_on() -> None:
    two = Two()
    two.tick(REST, HELD, standing=True)
    assert two.tick(HELD, LOST).phase == "driving: pilot"


def test_trainee_that_had_the_robot_matters_until_it_stands() -> None:
    two = Two()
    two.tick(REST, HELD, standing=True)
    two.tick(REST, REST)
    assert two.tick(REST, LOST).fault == catalogue.fault("INP-01", "trainee")
    two = Two()
    two.tick(REST, HELD, standing=True)
    two.tick(REST, REST, standing=True)
    wish = two.tick(REST, LOST, standing=True)
    assert wish.fault is not None
    assert wish.fault.severity is Severity.WARN


def test_needed_are_all_up_to_the_one_that_is_active() -> None:
    three = Two(replace(STEP, lower=("trainee", "guest")))
    for samples, needed in (
        ((REST, REST, REST), 1),
        ((REST, REST, HELD), 3),
        ((REST, HELD, HELD), 2),
        ((HELD, HELD, HELD), 1),
    ):
        three.tick(*samples, standing=True)
        assert three.shared.needed == ("pilot", "trainee", "guest")[:needed]
    assert three.tick(REST, LOST, LOST, standing=True).fault == catalogue.fault(
        "INP-01", "trainee", severity=Severity.WARN
    )
    assert three.tick(LOST, LOST, HELD, standing=True).fault == catalogue.fault("INP-01", "pilot")


def test_lower_one_of_two_never_begins_but_at_standstill_and_at_rest_whatever_both_have_done() -> None:
    samples = (REST, MOVED, HELD, LOST)
    for history in itertools.product(itertools.product(samples, samples, (True, False)), repeat=3):
        priority = Priority([True, True])
        turns = [priority.decide((first, second), standing=standing) for first, second, standing in history]
        first, second, _ = history[-1]
        assert turns[-1].active == (0 if first is HELD else 1 if second is HELD else None)
        if turns[-1].active != 1 or not turns[-1].drives:
            continue
        lost = [n for n, (first, second, _) in enumerate(history) if first is HELD or second is LOST]
        since = history[lost[-1] + 1 :] if lost else history
        released = [(second, standing) for _, second, standing in since if second is not HELD]
        assert not lost or REST in [second for second, _ in released]
        assert not released or released[-1][1], "pressed in motion"
    assert Priority([True]).decide((REST,), standing=True) == HandOver(None, False, True, 1)


# ---------------------------------------------------------------------------------------------- the supervisor's part

INPUT_LOST = catalogue.fault("INP-01", "trainee")


def test_each_input_is_heard_until_its_own_limit() -> None:
    """One over a network is heard for longer than a device on this computer."""
    later = replace(STEP, stale=(STALE, 0.25))
    for step, trainee, drives in (
        (STEP, STALE, True),
        (STEP, STALE + 0.001, False),
        (later, STALE + 0.001, True),
        (later, 0.25, True),
        (later, 0.251, False),
    ):
        wish = Two(step).tick(REST, replace(HELD, age=trainee), standing=True)
        assert (wish.command == DRIVES, wish.fault is None) == (drives, drives)
    wish = Two(later).tick(replace(HELD, age=STALE + 0.001), REST, standing=True)
    assert wish.fault is not None
    assert (wish.command, wish.fault.id, wish.fault.device) == (STANDS, "INP-03", "pilot")


def judged(fault: Fault, *spare: str) -> Severity:
    supervisor = Supervisor(ROBOT, 0.02)
    return supervisor.judge(sensed(faults=(fault,)), Wish(), Mode.TELEOP, SetPoints(), spare).severity


def test_what_is_wrong_with_a_spare_input_is_a_warning() -> None:
    assert judged(INPUT_LOST) is Severity.CONTROLLED_STOP
    assert judged(INPUT_LOST, "trainee") is Severity.WARN
    assert judged(INPUT_LOST, "pilot") is Severity.CONTROLLED_STOP
    assert judged(catalogue.fault("INP-06", "trainee"), "trainee") is Severity.WARN
    assert judged(catalogue.fault("NET-01", "trainee"), "trainee") is Severity.WARN
    assert judged(catalogue.fault("PLG-02", "trainee"), "trainee") is catalogue.ROWS["PLG-02"].severity


def test_spare_are_inputs_that_are_first_in_no_step_and_not_needed_by_the_mode() -> None:
    assert Plan(robot=shared().plan.robot, steps=()).spare == frozenset()
    second = TeleopStep(input="guest", seconds=None)
    plan = Plan(
        robot=shared().plan.robot, steps=(replace(STEP, lower=("trainee", "guest")), WaitStep(seconds=1.0), second)
    )
    assert plan.spare == {"trainee"}
    kept = shared(STEP)
    modes = Modes(kept)
    kept.needed = ("pilot", "trainee")
    assert modes.spare == {"trainee"}
    modes.mode = Mode.TELEOP
    assert modes.spare == frozenset()
    kept.needed = ("pilot",)
    assert modes.spare == {"trainee"}
    assert STEP.inputs == ("pilot", "trainee")
    assert TeleopStep(input="pilot", seconds=None).lower == ()


# ---------------------------------------------------------------------------------------------- a whole core


class Desk(Live):
    """The decision core, with two inputs that rest."""

    def __init__(self) -> None:
        super().__init__(STEP)
        self.inputs = given(REST, REST)
        self.until(Mode.TELEOP)

    def drive(self, *samples: OperatorInput, speed: float) -> None:
        """Until that speed is reached."""
        sign = 1.0 if speed > 0 else -1.0
        self.until(lambda tick: sign * tick.set_points.speed >= abs(speed), inputs=given(*samples))


def test_take_over_into_the_other_direction_has_no_jump_and_passes_standstill() -> None:
    desk = Desk()
    full = replace(HELD, speed=0.4, steering=0.4)
    desk.drive(REST, full, speed=0.39)
    begun = len(desk.ticks)
    back = replace(HELD, speed=-0.4, steering=-0.4)
    desk.drive(back, full, speed=-0.39)
    points = [tick.set_points for tick in desk.ticks[begun - 1 :]]
    limits = desk.core._gate
    for before, after in itertools.pairwise(points):
        assert abs(after.speed - before.speed) <= max(limits._acceleration, limits._deceleration) * 0.02 + 1e-9
        assert abs(after.steering_left - before.steering_left) <= limits._rate * 0.02 + 1e-9
        assert before.speed * after.speed >= 0.0
    assert 0.0 in [point.speed for point in points]
    assert {tick.mode for tick in desk.ticks[begun:]} == {Mode.TELEOP}


@pytest.mark.parametrize("first", [True, False])
def test_stop_from_any_of_them_stops_at_once_whoever_drives(first: bool) -> None:
    desk = Desk()
    desk.drive(HELD, REST, speed=0.25)
    stop = replace(REST, neutral=False)
    samples = given(HELD, stop) if first else given(stop, HELD)
    tick = desk.tick(inputs=samples, requests=(Request.QUICKSTOP,), urgent=True)
    assert (tick.mode, tick.set_points.speed) == (Mode.QUICKSTOP, 0.0)
    desk.until(lambda tick: tick.wish.phase == "release the controls", inputs=given(REST, stop))  # it is still held
    for _ in range(10):
        assert desk.tick(inputs=given(REST, stop), requests=(Request.ARM,)).mode is Mode.QUICKSTOP
    desk.until(Mode.READY, inputs=given(REST, REST), requests=(Request.ARM,))


def test_lower_one_that_is_unplugged_is_told_and_the_pilot_drives_on() -> None:
    desk = Desk()
    desk.drive(HELD, REST, speed=0.25)
    for _ in range(50):
        tick = desk.tick(inputs=given(HELD), faults=(INPUT_LOST,))
    assert (tick.mode, tick.snapshot.verdict.severity) == (Mode.TELEOP, Severity.WARN)
    assert tick.set_points.speed == pytest.approx(0.3)
    desk.until(lambda tick: not tick.snapshot.verdict.faults, inputs=given(HELD, REST))


def test_lower_one_that_drives_and_is_unplugged_stops_the_robot() -> None:
    desk = Desk()
    desk.drive(REST, HELD, speed=0.25)
    tick = desk.tick(inputs=given(REST), faults=(INPUT_LOST,))
    assert (tick.mode, tick.snapshot.verdict.severity) == (Mode.QUICKSTOP, Severity.CONTROLLED_STOP)
    assert tick.snapshot.verdict == replace(verdict("INP-01", "trainee"), recovers=True)
    assert isinstance(desk.core, Core)
