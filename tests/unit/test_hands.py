"""The controls of inputs that give nothing: they are waited for by name, and none of them counts as released."""

from __future__ import annotations

import pytest
from core_builders import PERIOD, Player, shared, snapshot
from live_core import Live
from msgspec.structs import replace

from artemis.plugins.stated import STALE
from artemis.states.hands import WAITED, OperatorHands, hands_on
from artemis.states.plan import TeleopStep
from artemis.states.ready import ReadyMode
from artemis.supervision import catalogue
from artemis.values import Event, Mode, OperatorInput, Request, Tick

STEP = TeleopStep(input="pilot", lower=("trainee",), seconds=None)
PILOT = OperatorInput(source="pilot", age=0.0)
TRAINEE = OperatorInput(source="trainee", age=0.0)
HELD = replace(TRAINEE, enabled=True, neutral=False, speed=0.3)
SILENT = replace(TRAINEE, age=None, neutral=False)
BOTH, ALONE, PRESSED = (PILOT, TRAINEE), (PILOT,), (PILOT, HELD)
LOST = (catalogue.fault("INP-01", "trainee"),)
NO_REPORTS = "release the controls; no reports from trainee"
AGAIN = "release all controls of trainee"


# ---------------------------------------------------------------------------------------------- what is waited for


@pytest.mark.parametrize(
    ("inputs", "lost", "words"),
    [
        (BOTH, (), None),
        (PRESSED, (), "release the controls"),
        (ALONE, ("trainee",), NO_REPORTS),
        ((), ("pilot", "trainee"), "release the controls; no reports from pilot, trainee"),
        (PRESSED, ("guest",), "release the controls; no reports from guest"),
        (
            (PILOT, SILENT),
            ("guest",),
            "release the controls; trainee was not heard yet: move it once; no reports from guest",
        ),
    ],
)
def test_what_a_person_has_to_do(inputs: tuple[OperatorInput, ...], lost: tuple[str, ...], words: str | None) -> None:
    assert hands_on(inputs, lost) == words


def test_spare_input_is_waited_for_as_long_as_it_may_come_back_and_any_other_for_ever() -> None:
    hands = OperatorHands(("pilot", "trainee"), {"trainee"})
    for time, given, words in (
        (0.0, BOTH, None),
        (1.0, ALONE, NO_REPORTS),
        (1.0 + WAITED, ALONE, NO_REPORTS),
        (1.0 + WAITED + PERIOD, ALONE, None),
        (8.0, BOTH, None),
        (8.1, ALONE, NO_REPORTS),  # lost once more: it may come back again
        (600.0, (TRAINEE,), "release the controls; no reports from pilot"),
        (1200.0, (TRAINEE,), "release the controls; no reports from pilot"),
    ):
        seen = snapshot(time, inputs=given)
        hands.see(seen)
        assert hands.held(seen) == words


def test_inputs_of_other_steps_are_waited_for_where_all_have_to_rest() -> None:
    hands, seen = (
        OperatorHands(("pilot", "trainee"), {"trainee"}),
        snapshot(inputs=(PILOT, replace(HELD, source="other"))),
    )
    hands.see(seen)
    assert hands.held(seen, ("pilot",)) is None
    assert hands.held(seen, ("pilot", "trainee")) == NO_REPORTS
    assert hands.held(snapshot(inputs=PRESSED), ("pilot",)) is None


# ---------------------------------------------------------------------------------------------- a step by hand begins


def test_step_by_hand_waits_for_an_input_that_gives_nothing() -> None:
    player = Player(ReadyMode(shared(STEP)))
    wish = player.tick(inputs=ALONE)
    assert (wish.event, wish.phase) == (None, NO_REPORTS)
    assert player.tick(inputs=BOTH).event is Event.TELEOP


def test_step_by_hand_begins_without_an_input_that_stays_away() -> None:
    player = Player(ReadyMode(shared(STEP)))
    player.world["inputs"] = ALONE
    assert player.until(lambda wish: wish.event is Event.TELEOP)
    assert player.time == pytest.approx(WAITED, abs=2 * PERIOD)
    assert player.mode.shared.hands.released == {"pilot"}


@pytest.mark.parametrize(("stale", "age", "counts"), [((), STALE, True), ((), 0.2, False), ((0.15, 0.25), 0.2, True)])
def test_only_what_is_new_enough_to_drive_by_was_seen_at_rest(
    stale: tuple[float, ...], age: float, counts: bool
) -> None:
    player = Player(ReadyMode(shared(replace(STEP, stale=stale))))
    other = replace(PILOT, source="other")
    assert player.tick(inputs=(PILOT, replace(TRAINEE, age=age), other)).event is Event.TELEOP
    assert player.mode.shared.hands.released == ({"pilot", "trainee"} if counts else {"pilot"})


# ---------------------------------------------------------------------------------------------- a whole core


class Desk(Live):
    """The decision core with a pilot whose controls rest, and a trainee."""

    def __init__(self, **plan: bool) -> None:
        super().__init__(STEP, **plan)
        self.inputs = BOTH

    def loses(self) -> Tick:
        """One tick without anything from the trainee."""
        return self.tick(inputs=ALONE, faults=LOST)

    def moves(self, *inputs: OperatorInput, seconds: float = 2.0) -> bool:
        """Whether it drives by these inputs."""
        ticks = [self.tick(inputs=inputs) for _ in range(round(seconds / PERIOD))]
        return any(tick.set_points.speed for tick in ticks)


def test_wheels_are_not_aligned_while_an_input_gives_nothing() -> None:
    desk = Desk()
    desk.inputs = PRESSED
    desk.until(lambda tick: tick.wish.phase == "release the controls")
    assert desk.loses().wish.phase == NO_REPORTS
    for _ in range(50):
        assert desk.tick().wish.phase == "release the controls"
    desk.inputs = BOTH
    desk.until(Mode.TELEOP)


def test_arm_without_a_word_of_an_input_has_no_effect() -> None:
    desk = Desk(armed=False)
    desk.until(lambda tick: tick.wish.phase == "waiting for arm")
    tick = desk.tick(inputs=ALONE, faults=LOST, requests=(Request.ARM,))
    assert (tick.mode, tick.wish.phase) == (Mode.INIT, NO_REPORTS)
    assert desk.tick().wish.phase == "waiting for arm"


def test_stop_is_not_armed_again_while_an_input_gives_nothing() -> None:
    desk = Desk()
    desk.until(Mode.TELEOP)
    desk.tick(requests=(Request.QUICKSTOP,))
    desk.until(lambda tick: tick.wish.phase == "stopped: arm to continue")
    desk.inputs = PRESSED
    tick = desk.tick(inputs=ALONE, faults=LOST, requests=(Request.ARM,))
    assert (tick.mode, tick.wish.phase) == (Mode.QUICKSTOP, NO_REPORTS)
    assert desk.tick(requests=(Request.ARM,)).wish.phase == "release the controls"


def test_button_that_was_never_released_drives_nothing_however_often_its_input_is_lost_for_a_tick() -> None:
    desk = Desk()
    desk.until(lambda tick: tick.wish.phase == "reading potentiometers")
    desk.inputs = PRESSED
    desk.until(Mode.READY)
    for _ in range(20):
        assert desk.loses().wish.phase == NO_REPORTS
        assert not desk.moves(*PRESSED, seconds=0.1)
        assert desk.ticks[-1].wish.phase == "release the controls"
    assert Mode.TELEOP not in [tick.mode for tick in desk.ticks]


def test_input_that_comes_back_in_a_step_has_to_be_released_before_it_drives() -> None:
    desk = Desk()
    desk.inputs = ALONE
    desk.until(Mode.TELEOP)
    assert not desk.moves(*PRESSED)
    assert desk.ticks[-1].wish.phase == AGAIN
    desk.tick(inputs=BOTH)
    assert desk.moves(*PRESSED)


def test_input_that_comes_back_held_in_the_very_tick_in_which_the_step_begins_does_not_drive() -> None:
    desk = Desk()
    desk.inputs = ALONE
    desk.until(lambda tick: tick.wish.event is Event.TELEOP)
    tick = desk.tick(inputs=PRESSED)
    assert (tick.mode, tick.wish.phase) == (Mode.TELEOP, AGAIN)
    assert not desk.moves(*PRESSED)


def test_frozen_input_that_goes_on_held_in_the_tick_in_which_the_step_begins_does_not_drive() -> None:
    desk = Desk()
    desk.inputs = (PILOT, replace(TRAINEE, age=1.0))
    desk.until(lambda tick: tick.wish.event is Event.TELEOP)
    assert not desk.moves(*PRESSED)
