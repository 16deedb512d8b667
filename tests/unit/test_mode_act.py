"""A behaviour does a step: what it says, what it breaks, how it ends, and where it goes on."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest
from core_builders import ROBOT, Player, fault_of, shared, snapshot
from msgspec.structs import replace

from artemis.config import Config
from artemis.drive_states import Goal
from artemis.plugins.contracts import Acting, Declared, State
from artemis.progress import Acted, SignalValue
from artemis.states.act import ActMode, Observing
from artemis.states.condition import Compare
from artemis.states.plan import BehaviourStep, Plan, Shared, Step, WaitStep
from artemis.states.ready import ReadyMode
from artemis.states.tree import Leaf, Steps, Together, tree_of
from artemis.supervision import catalogue
from artemis.values import DriveCommand, Event, Odometry, SetPoints, Snapshot, Wish

DECLARED = Declared(outcomes=("stuck",), resumable=True, signals={"gas_ppm": "ppm"})
COMMAND = DriveCommand(speed=0.2, steering=0.1)


class StubBehaviour:
    """Answers what the test says, and counts."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, answer: Callable[[], Any] | None = None) -> None:
        self.starts: list[State | None] = []
        self.steps = 0
        self.answer = answer or (lambda: Acting(command=COMMAND, state=(self.steps,), phase="at it"))

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        self.starts.append(state)

    def step(self, snapshot: Snapshot) -> Acting:
        self.steps += 1
        answer: Acting = self.answer()
        return answer


def step_of(behaviour: StubBehaviour, declared: Declared = DECLARED, **options: Any) -> BehaviourStep:
    return BehaviourStep(name="stub", behaviour=behaviour, declared=declared, **options)


def act(answer: Callable[[], Any] | None = None, **options: Any) -> tuple[Player, StubBehaviour, Shared]:
    behaviour = StubBehaviour(answer)
    steps = shared(step_of(behaviour, **options), WaitStep(seconds=1.0))
    return Player(ActMode(steps)), behaviour, steps


def ended(player: Player) -> tuple[Event | None, bool, str]:
    wish = player.tick()
    return wish.event, wish.over, wish.outcome


MOVING: dict[str, Any] = {"standing": False}


def test_it_does_what_the_behaviour_says_and_keeps_what_it_told() -> None:
    player, behaviour, steps = act()
    wish = player.tick()
    assert (wish.command, wish.phase, wish.traction, wish.steering) == (COMMAND, "at it", Goal.ENABLED, Goal.ENABLED)
    assert wish.acted == (Acted(step=0, state="[1]"),)
    assert (behaviour.starts, behaviour.steps, steps.position.state) == ([None], 1, "[1]")
    player.tick()
    assert (len(behaviour.starts), steps.position.state) == (1, "[2]")
    assert steps.position.done == pytest.approx(0.04)


def test_without_a_command_the_robot_stands_with_its_wheels_as_they_are() -> None:
    player, _, _ = act(lambda: Acting(), declared=replace(DECLARED, moves=False))
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert (wish.command, wish.phase) == (DriveCommand(steering=0.2), "stub")


@pytest.mark.parametrize(("outcome", "over", "told"), [("done", True, ""), ("stuck", False, "stuck")])
def test_it_ends_with_its_outcome_once_the_robot_stands(outcome: str, over: bool, told: str) -> None:
    player, behaviour, steps = act(lambda: Acting(command=COMMAND, outcome=outcome, state=(7,)))
    wish = player.tick(**MOVING)
    assert (wish.command.speed, wish.event, wish.over, wish.outcome) == (0.0, None, False, "")
    assert (wish.phase, wish.acted[0].state) == ("stopping", "[7]")
    assert player.tick(**MOVING).event is None
    assert behaviour.steps == 1  # it has ended: it is not asked again
    assert ended(player) == (Event.DONE, over, told)
    assert (steps.position.step, steps.position.ended) == ((1, "") if over else (2, "stuck"))


def test_it_comes_to_rest_where_something_else_is_next() -> None:
    player, behaviour, steps = act()
    player.tick()
    steps.rests = True
    assert (player.tick(**MOVING).command.speed, behaviour.steps) == (0.0, 1)
    steps.rests = True
    assert ended(player) == (Event.DONE, False, "")


def test_a_step_that_was_interrupted_is_not_started_again() -> None:
    player, behaviour, _ = act()
    player.tick()
    player.enter()  # after a stop
    player.tick()
    assert (behaviour.starts, behaviour.steps) == ([None], 2)


def test_a_step_that_goes_on_after_another_one_is_given_its_state() -> None:
    player, behaviour, steps = act()
    player.tick()
    steps.entry += 1
    player.tick()
    assert behaviour.starts == [None, (1,)]


def test_a_run_that_is_gone_on_with_gives_it_its_state() -> None:
    behaviour = StubBehaviour()
    steps = shared(step_of(behaviour), done=4.0)
    steps.position = replace(steps.position, state='[3,"b"]')
    wish = Player(ActMode(steps)).tick()
    assert behaviour.starts == [(3, "b")]
    assert wish.done == pytest.approx(4.02)


def test_the_next_step_of_the_same_kind_begins_anew() -> None:
    behaviour = StubBehaviour(lambda: Acting(outcome="done", state=(1,)))
    steps = shared(step_of(behaviour), step_of(behaviour))
    player = Player(ActMode(steps))
    player.tick()
    assert (steps.position.step, steps.position.state) == (1, "")
    player.enter()
    player.tick()
    assert behaviour.starts == [None, None]


def raising() -> Acting:
    raise ZeroDivisionError("in the plugin")


def test_one_that_raises_is_a_fault_and_the_robot_stands() -> None:
    player, _, _ = act(raising)
    wish = player.tick(set_points=SetPoints(speed=0.3, steering=0.2))
    assert fault_of(wish) == ("PLG-02", "stub")
    assert wish.fault is not None
    assert wish.fault.text.partition(" at test_mode_act.py:")[0].endswith("(ZeroDivisionError('in the plugin')")
    assert wish.command == DriveCommand(steering=0.2)


def test_one_that_raises_after_its_start_is_told_without_it() -> None:
    player, behaviour, _ = act()
    player.tick()
    behaviour.answer = raising
    wish = player.tick()
    assert wish.fault is not None
    assert wish.fault.text.partition(" at test_mode_act.py:")[0].endswith("(ZeroDivisionError('in the plugin')")


def test_an_answer_that_cannot_be_read_is_told_without_the_start() -> None:
    class Unreadable(Acting, frozen=True):
        def __getattribute__(self, name: str) -> Any:
            if name == "outcome":
                raise ZeroDivisionError("in the answer")
            return super().__getattribute__(name)

    player, _, _ = act(lambda: Unreadable())
    wish = player.tick()
    assert wish.fault is not None
    assert wish.fault.text.partition(" at test_mode_act.py:")[0].endswith("(ZeroDivisionError('in the answer')")


def test_a_step_of_another_kind_is_over_for_it() -> None:
    player = Player(ActMode(shared(WaitStep(seconds=1.0))))
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert (wish.event, wish.command) == (Event.DONE, DriveCommand(steering=0.2))


def test_one_that_raises_at_its_start_is_started_again_before_it_is_asked() -> None:
    player, behaviour, _ = act()
    start = behaviour.start

    def fails(snapshot: Snapshot, state: State | None = None) -> None:
        raise SystemExit(1)

    behaviour.start = fails  # type: ignore[method-assign]
    wish = player.tick()
    assert fault_of(wish) == ("PLG-02", "stub")
    assert "start: SystemExit(1)" in str(wish.fault)
    behaviour.start = start  # type: ignore[method-assign]
    player.enter()
    assert player.tick().fault is None
    assert (behaviour.starts, behaviour.steps) == ([None], 1)


@pytest.mark.parametrize(
    "answer", [None, 42, COMMAND, Acting(outcome="nothing"), Acting(state=("x" * 2000,)), Acting(signals={"x": 1.0})]
)
def test_garbage_is_a_fault_and_the_robot_stands(answer: Any) -> None:
    player, _, steps = act(lambda: answer)
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert fault_of(wish) == ("PLG-06", "stub")
    assert wish.command == DriveCommand(steering=0.2)
    assert steps.position.state == ""


def test_one_that_moves_is_not_asked_where_nobody_knows_the_place_of_the_robot() -> None:
    player, behaviour, _ = act()
    assert fault_of(player.tick(odometry=Odometry(lost=True))) == ("RUN-08", "")
    assert behaviour.steps == 0
    still, observer, _ = act(lambda: Acting(), declared=Declared(moves=False))
    assert still.tick(odometry=Odometry(lost=True)).fault is None
    assert observer.steps == 1


def test_the_robot_drives_no_faster_than_its_keys_say() -> None:
    assert act(speed=0.25)[2].top_speed == 0.25
    assert act()[2].top_speed == ROBOT.limits.speed_m_s


# ---------------------------------------------------------------------------------------------- beside other steps


def beside(behaviour: StubBehaviour) -> Shared:
    """A wait, and the behaviour beside it."""
    still = replace(DECLARED, moves=False)
    steps = (WaitStep(seconds=10.0), step_of(behaviour, still), WaitStep(seconds=1.0))
    leaves = [Leaf(number, f"steps[{number}]") for number in range(3)]
    word = Together(path="steps[0].together", steps=Steps((leaves[0],)), beside=(Steps((leaves[1],)),))
    return Shared(Plan(robot=ROBOT, steps=steps, tree=tree_of(Steps((word, leaves[2])))))


class Beyond:
    """Ticks in which nothing but time passes."""

    def __init__(self, steps: Shared) -> None:
        self.steps, self.others, self.time = steps, Observing(steps), 0.0

    def tick(self) -> Wish:
        seen = snapshot(self.time)
        wish = self.others.ask(seen, Wish())
        self.steps.advance(wish, seen, standing=True)
        self.time += 0.02
        return wish


def observing(**changes: Any) -> Callable[[], Acting]:
    return lambda: Acting(state=("seen",), **changes)


def test_one_beside_is_asked_while_the_steps_run_and_its_state_is_in_the_position() -> None:
    behaviour = StubBehaviour(observing(signals={"gas_ppm": 3.0}))
    ticks = Beyond(beside(behaviour))
    ticks.tick()  # the words begin
    assert behaviour.steps == 0
    wish = ticks.tick()
    assert wish.acted == (Acted(step=1, state='["seen"]', signals=(SignalValue(name="gas_ppm", value=3.0),)),)
    assert (behaviour.starts, ticks.steps.position.step) == ([None], 0)
    assert "seen" in ticks.steps.position.place
    ticks.tick()
    assert (len(behaviour.starts), behaviour.steps) == (1, 2)


def test_one_beside_that_ends_badly_ends_all() -> None:
    behaviour = StubBehaviour(observing(outcome="stuck"))
    ticks = Beyond(beside(behaviour))
    ticks.tick()
    ticks.tick()
    assert (ticks.steps.position.ended, ticks.steps.beside) == ("stuck", {})


def test_one_beside_that_is_done_is_not_asked_again() -> None:
    behaviour = StubBehaviour(observing(outcome="done"))
    ticks = Beyond(beside(behaviour))
    for _ in range(5):
        ticks.tick()
    assert (behaviour.steps, ticks.steps.position.step, ticks.steps.position.ended) == (1, 0, "")


def test_one_beside_goes_on_from_its_state_in_another_run() -> None:
    first = Beyond(beside(StubBehaviour(observing())))
    first.tick()
    first.tick()
    behaviour = StubBehaviour(observing())
    steps = beside(behaviour)
    steps.position = first.steps.position
    second = Beyond(steps)
    second.tick()
    second.tick()
    assert behaviour.starts == [("seen",)]


@dataclass
class Running:
    """What observers see of a run: which steps run beside the present one, by number, with their states."""

    beside: dict[int, str]
    plan: Plan


def test_one_beside_is_started_where_it_begins_or_was_not_running() -> None:
    behaviour = StubBehaviour(observing())
    plan = Plan(robot=ROBOT, steps=(WaitStep(seconds=9.0), step_of(behaviour, replace(DECLARED, moves=False))))
    run = Running({0: "", 1: ""}, plan)
    others = Observing(run)  # type: ignore[arg-type]
    starts = []
    for beside in (
        {0: "", 1: ""},
        {1: '["seen"]'},
        {1: ""},
        {1: "[2]"},
        {},
        {1: "[3]"},
        {0: ""},
        {1: "[4]"},
        {1: "[5]"},
    ):
        run.beside = beside
        wish = others.ask(snapshot(), Wish())
        assert wish.fault is None
        assert [acted.step for acted in wish.acted] == [1] * (1 in beside)
        starts.append(len(behaviour.starts))
    assert starts == [1, 1, 2, 2, 2, 3, 3, 4, 4]
    earlier = Acted(step=0, outcome="done", state="", signals=())
    assert [acted.step for acted in others.ask(snapshot(), Wish(acted=(earlier,))).acted] == [0, 1]
    behaviour.answer = raising
    other = catalogue.fault("RUN-08")
    assert others.ask(snapshot(), Wish(fault=other)).fault is other
    assert behaviour.starts == [None, None, (3,), (4,)]


@pytest.mark.parametrize(("answer", "id"), [(raising, "PLG-02"), (lambda: Acting(command=COMMAND), "PLG-06")])
def test_one_beside_that_breaks_is_a_fault(answer: Callable[[], Acting], id: str) -> None:
    ticks = Beyond(beside(StubBehaviour(answer)))
    ticks.tick()
    assert fault_of(ticks.tick()) == (id, "stub")
    assert ticks.steps.position.ended == ""


def test_what_it_told_last_counts_until_it_begins_anew() -> None:
    told = StubBehaviour(lambda: Acting(outcome="done", signals={"gas_ppm": 5.0}))
    steps = shared(step_of(told), WaitStep(seconds=1.0), step_of(told))
    player = Player(ActMode(steps))
    player.tick()
    assert steps.position.step == 1
    assert steps.position.told == (SignalValue(name="gas_ppm", value=5.0),)
    steps.advance(Wish(over=True), snapshot(), standing=True)
    assert steps.position.step == 2
    assert not steps.position.told


def test_what_it_told_is_known_to_a_run_that_goes_on_after_it_has_ended() -> None:
    told = StubBehaviour(lambda: Acting(outcome="done", signals={"gas_ppm": 5.0}))
    steps: tuple[Step, ...] = (step_of(told), WaitStep(seconds=1.0), WaitStep(condition=Compare("gas_ppm", ">", 4.0)))
    first = shared(*steps)
    Player(ActMode(first)).tick()
    assert first.position.step == 1
    second = Shared(replace(first.plan, begin=first.position))
    player = Player(ReadyMode(second))
    while second.position.step < 3 and player.time < 3.0:
        player.tick()
    assert second.current is None


def test_ready_asks_for_the_mode_of_the_step() -> None:
    assert Player(ReadyMode(shared(step_of(StubBehaviour())))).tick().event is Event.ACT
