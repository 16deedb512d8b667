"""Steps that wait for somebody, or for a condition; what a mission knows of a tick; steps that come to rest."""

from __future__ import annotations

import pytest
from core_builders import NAMES, PERIOD, Player, shared, snapshot
from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.progress import MEASURED, Position
from artemis.states.condition import Compare
from artemis.states.mode import PATIENCE
from artemis.states.plan import AskStep, Plan, Shared, TeleopStep, WaitStep, with_behaviours, with_followers
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.states.tree import End, Leaf, Say, Steps, Try, tree_of
from artemis.supervision import catalogue
from artemis.values import Event, Odometry, OperatorInput, Request, Wish

ASK = AskStep(question="which way?", answers=("left", "right"))
HELD = OperatorInput(source="stick", enabled=True, neutral=False, speed=0.3, age=0.01)


def asking(step: AskStep = ASK, **world: object) -> tuple[Player, Shared]:
    steps = shared(step, WaitStep(seconds=1.0))
    player = Player(ReadyMode(steps))
    player.world.update({"attended": True, **world})
    return player, steps


def test_a_question_is_the_phase_with_its_numbered_answers() -> None:
    player, _ = asking()
    wish = player.tick()
    assert (wish.phase, wish.event, wish.over) == ("which way? (1 left, 2 right)", None, False)


@pytest.mark.parametrize("answer", ["right", "2"])
def test_an_answer_ends_it_and_is_kept(answer: str) -> None:
    player, steps = asking()
    player.tick(answers=("up",))
    assert steps.position.step == 0
    player.tick(answers=(answer,))
    assert (steps.position.step, steps.position.answer) == (1, "right")


def test_nobody_there_ends_the_run_at_once_and_nobody_who_answers_after_a_while() -> None:
    player, _ = asking(attended=False)
    wish = player.tick()
    assert (wish.event, wish.failed, wish.fault) == (Event.END, True, None)
    assert wish.phase == "no operator can answer: which way? (1 left, 2 right)"
    player, _ = asking()
    player.tick()
    player.time += PATIENCE - PERIOD
    assert player.tick().event is None
    wish = player.tick()
    assert wish.event is Event.END
    assert wish.fault is not None
    assert wish.fault.id == "OPR-03"


def test_a_question_with_a_time_limit_waits_for_that_alone() -> None:
    player, steps = asking(replace(ASK, at_most=2 * PATIENCE), attended=False)
    player.tick()
    player.time += PATIENCE + 1.0
    assert player.tick().event is None
    player.time += PATIENCE
    player.tick()
    assert (steps.position.step, steps.position.ended) == (2, "timeout")
    assert player.tick().failed


def test_waiting_for_a_condition_looks_at_the_run_s_time_the_distance_and_the_battery() -> None:
    for signal, value, world in (
        ("run_s", 1.0, {}),
        ("driven_m", 0.5, {"odometry": Odometry(distance=-0.6, driven=0.6)}),
        ("battery_v", 25.0, {"battery_v": 26.0}),
        ("stick.done", 0.5, {"inputs": (replace(HELD, requests=(Request.DONE,)),)}),
    ):
        steps = shared(WaitStep(condition=Compare(signal, ">", value)), WaitStep(seconds=1.0))
        player = Player(ReadyMode(steps))
        player.tick()
        player.tick()
        assert steps.position.step == 0
        player.time += 2.0 if signal == "run_s" else 0.0
        player.tick(**world)
        assert steps.position.step == 1, signal


def test_time_and_distance_of_earlier_runs_count() -> None:
    for signal, begin in ("run_s", Position(time=9.0)), ("driven_m", Position(driven=9.0)):
        steps = shared(WaitStep(condition=Compare(signal, ">", 9.5)), WaitStep(seconds=1.0))
        steps.position = begin
        player = Player(ReadyMode(steps))
        player.tick()
        assert steps.position == begin
        player.time += 0.6
        player.tick(odometry=Odometry(driven=0.6))
        assert steps.position == replace(begin, step=1)


def test_teleoperation_that_is_to_rest_ramps_down_and_leaves_without_being_over() -> None:
    steps = shared(TeleopStep(input="stick", seconds=None), WaitStep(seconds=1.0))
    player = Player(TeleopMode(steps))
    player.world["inputs"] = (HELD,)
    assert player.tick(standing=True).command.speed == 0.3
    steps.rests = True
    wish = player.tick(standing=False)
    assert (wish.command.speed, wish.phase, wish.event) == (0.0, "stopping", None)
    wish = player.tick(standing=True)
    assert (wish.event, wish.over) == (Event.DONE, False)


# ---------------------------------------------------------------------------------------------- faults, the end


def in_a_try(*catch: str, again_on: tuple[str, ...] = ("any",), retries: int = 0) -> Shared:
    caught = tuple((name, Steps((Say("s", name),))) for name in catch)
    node = Try(path="t", steps=Steps((Leaf(0, "w"),)), catch=caught, again_on=again_on, retries=retries)
    plan = Plan(robot=shared().plan.robot, steps=(WaitStep(seconds=9.0),), tree=tree_of(Steps((node,))))
    return Shared(plan)


@pytest.mark.parametrize(
    ("steps", "kept"),
    [
        (in_a_try("fault"), ("DRV-25", "COM-03", "PTH-06")),
        (in_a_try("fault:DRV-25"), ("DRV-25",)),
        (in_a_try("fault:COM-03", "fault:DRV-25"), ("DRV-25", "COM-03")),
        (in_a_try("any"), ()),
        (in_a_try("lost"), ("PTH-06",)),
        (in_a_try(again_on=("fault",), retries=1), ("DRV-25", "COM-03", "PTH-06")),
        (in_a_try("timeout"), ()),
        (shared(WaitStep(seconds=1.0)), ()),
    ],
)
def test_faults_are_kept_for_a_mission_that_names_them_the_most_severe_first(
    steps: Shared, kept: tuple[str, ...]
) -> None:
    later, first, worst = (catalogue.fault(id) for id in ("COM-03", "PTH-06", "DRV-25"))
    steps.note_faults([first])
    steps.note_faults([worst, first])
    steps.note_faults([later])  # the others were acknowledged
    assert steps.position.faults == kept


@pytest.mark.parametrize("name", MEASURED)
def test_every_tick_tells_the_signals_that_missions_may_ask_for(name: str) -> None:
    steps = shared(WaitStep(condition=Compare(name, ">=", 0.0)))
    battery = BatteryState(volts=24.0, charge=0.5, charge_std=0.1, watts=9.0)
    seen = replace(snapshot(1.0, battery_v=24.0), battery=battery)
    steps.advance(Wish(), seen, standing=True)
    assert steps.position.step == 1


def test_a_mission_that_is_over_stays_so() -> None:
    plan = Plan(robot=shared().plan.robot, steps=(), tree=tree_of(Steps((End("e", "failed", "enough"),))))
    steps = Shared(plan)
    assert steps.current is None
    assert steps.advance(Wish(), snapshot(), standing=True) == ()
    assert Player(ReadyMode(steps)).tick().event is Event.END


def test_a_mission_that_ended_with_an_outcome_has_failed() -> None:
    steps = shared(WaitStep(seconds=1.0))
    steps.position = Position(step=1, ended="timeout")
    wish = Player(ReadyMode(steps)).tick()
    assert (wish.event, wish.failed) == (Event.END, True)


def test_steps_of_other_kinds_keep_what_changes_followers_and_behaviours() -> None:
    steps = (WaitStep(seconds=1.0), ASK)
    assert with_followers(steps, lambda follower: follower) == steps
    assert with_behaviours(steps, lambda name, behaviour: behaviour) == steps
    assert len(NAMES) == 4
