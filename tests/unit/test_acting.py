"""What a behaviour may declare and answer, and what becomes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest

from artemis.config import Config
from artemis.mission.words import Step
from artemis.plugins.acting import MAX_STATE_BYTES, Answered, answered, misdeclared, state_from, state_text
from artemis.plugins.contracts import Acting, Behaviour, Declared, Following, declared
from artemis.plugins.registry import breaches
from artemis.progress import OWN_STEPS, TAKEN_SIGNALS, SignalValue
from artemis.values import DriveCommand, Tracking

FACTS = Declared(outcomes=("stuck",), signals={"gas_ppm": "ppm"})
COMMAND = DriveCommand(speed=0.2, steering=0.1)


def plain(answer: object, facts: Declared = FACTS) -> Answered:
    found = answered(answer, facts)
    assert isinstance(found, Answered), found
    return found


def test_a_class_that_states_nothing_moves_and_is_not_resumable() -> None:
    assert declared(object) == Declared(outcomes=(), moves=True, resumable=False, signals={})


def test_names_of_artemis_own_steps_are_all_kept_from_behaviours() -> None:
    assert set(OWN_STEPS) == {field.alias or name for name, field in Step.model_fields.items()}


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ({"outcomes": "stuck"}, "states outcomes = 'stuck': a tuple"),
        ({"outcomes": ("Stuck",)}, "declares the outcome 'Stuck'"),
        ({"outcomes": (3,)}, "declares the outcome 3"),
        ({"outcomes": ("x" * 65,)}, "declares the outcome 'xxxx"),
        ({"outcomes": ("done",)}, "declares the outcome 'done': this name has a meaning already"),
        ({"outcomes": ("fault",)}, "declares the outcome 'fault'"),
        ({"moves": 1}, "states moves = 1: True or False"),
        ({"resumable": None}, "states resumable = None"),
        ({"signals": ["gas_ppm"]}, "states signals = ['gas_ppm']: units by name"),
        ({"signals": {"gas": "ppm"}}, "declares the signal 'gas' in ppm: its name has to end with _ppm"),
        ({"signals": {"speed_ms": "m/s"}}, "its name has to end with _m_s"),
        ({"signals": {"Gas_ppm": "ppm"}}, "declares the signal 'Gas_ppm'"),
        *(({"signals": {name: ""}}, f"declares the signal {name!r}: it is artemis' own") for name in TAKEN_SIGNALS),
        ({"signals": {"not": ""}}, "declares the signal 'not'"),
        ({"signals": {"gas_ppm": None}}, "declares the signal 'gas_ppm'"),
    ],
)
def test_what_cannot_be_declared_is_said(stated: dict[str, Any], problem: str) -> None:
    (found,) = misdeclared(Declared(**stated))
    assert found.startswith(problem) or problem in found


@pytest.mark.parametrize(
    "stated",
    [{}, {"outcomes": ("too-far", "timeout")}, {"signals": {"speed_m_s": "m/s", "ratio": "", "turned_deg": "deg"}}],
)
def test_what_can_be_declared_is_no_problem(stated: dict[str, Any]) -> None:
    assert list(misdeclared(Declared(**stated))) == []


def test_a_class_is_checked_with_all_that_it_declares() -> None:
    class Odd:
        class Config(Config):
            until: str = "run_s > 1"

        outcomes: ClassVar[tuple[str, ...]] = ("Bad",)

        def start(self) -> None: ...

    assert breaches(Odd, Behaviour) == [
        "has no method step()",
        "declares the outcome 'Bad': small letters, digits and hyphens are meant, a letter first",
        "has a default of until in its Config: only a mission may write this condition",
    ]


# ---------------------------------------------------------------------------------------------- answers


def test_an_answer_becomes_plain_values() -> None:
    command = DriveCommand(speed=np.float32(0.5), steering=1)  # type: ignore[arg-type]
    state: Any = (np.int64(3), np.float64(0.5), "a")
    signals: Any = {"gas_ppm": np.float32(2)}
    given = Acting(command=command, state=state, signals=signals)
    found = plain(given)
    assert found.command == DriveCommand(speed=0.5, steering=1.0)
    assert [type(number) for number in (found.command.speed, found.command.steering)] == [float, float]
    assert (found.outcome, found.state, found.signals) == (
        "",
        '[3,0.5,"a"]',
        (SignalValue(name="gas_ppm", value=2.0),),
    )


@pytest.mark.parametrize("outcome", ["done", "stuck"])
def test_declared_outcomes_are_taken(outcome: str) -> None:
    assert plain(Acting(outcome=outcome)).outcome == outcome


GARBAGE: dict[str, tuple[object, str]] = {
    "None": (None, "no Acting"),
    "a command alone": (COMMAND, "no Acting"),
    "a follower's": (Following(command=COMMAND, tracking=Tracking(arc_length=0, length=1, cross_track=0)), "no Acting"),
    "text for a command": (Acting(command="go"), "a command that is none"),  # type: ignore[arg-type]
    "text for a speed": (Acting(command=DriveCommand(speed="fast")), "a command that is none"),  # type: ignore[arg-type]
    "a speed too large": (Acting(command=DriveCommand(speed=10**400)), "a command that is none"),
    "an outcome of nobody": (Acting(outcome="arrived"), "the outcome 'arrived', which its class does not declare"),
    "a number for an outcome": (Acting(outcome=1), "the outcome 1, which"),  # type: ignore[arg-type]
    "a list for a state": (Acting(state=[1]), "a state that is no tuple"),  # type: ignore[arg-type]
    "None in a state": (Acting(state=(None,)), "a state that is no tuple"),  # type: ignore[arg-type]
    "a state not a number": (Acting(state=(math.nan,)), "a state that is no tuple of finite numbers"),
    "a whole number too large": (Acting(state=(2**60,)), "a state that is no tuple"),
    "half a letter": (Acting(state=("\ud800",)), "a state that is no tuple"),
    "a large state": (Acting(state=("x" * MAX_STATE_BYTES,)), f"or of more than {MAX_STATE_BYTES} bytes"),
    "no text for a phase": (Acting(phase=3), "a phase that is no text"),  # type: ignore[arg-type]
    "signals in a list": (Acting(signals=["gas_ppm"]), "signals that are no mapping"),  # type: ignore[arg-type]
    "a signal of nobody": (Acting(signals={"gas_m": 1.0}), "the signal 'gas_m', which its class does not declare"),
    "a signal not a number": (Acting(signals={"gas_ppm": math.inf}), "the signal gas_ppm = inf: a finite number"),
    "text for a signal": (Acting(signals={"gas_ppm": "much"}), "the signal gas_ppm = 'much'"),  # type: ignore[dict-item]
}


@pytest.mark.parametrize(("answer", "problem"), GARBAGE.values(), ids=GARBAGE)
def test_garbage_is_said(answer: object, problem: str) -> None:
    found = answered(answer, FACTS)
    assert isinstance(found, str)
    assert found.startswith(problem) or found.endswith(problem)


def test_one_that_does_not_move_commands_nothing() -> None:
    still = Declared(moves=False)
    assert answered(Acting(command=DriveCommand()), still) == "a command, but its class states moves = False"
    assert plain(Acting(), still).command is None


def test_an_infinite_command_is_left_to_the_gate() -> None:
    found = plain(Acting(command=DriveCommand(speed=math.inf)))
    assert found.command == DriveCommand(speed=math.inf)


def test_a_phase_can_be_written_and_is_short() -> None:
    assert plain(Acting(phase="a\ud800" + "b" * 300)).phase == r"a\ud800" + "b" * 193
    assert plain(Acting(phase="\x1b[31mred\nü")).phase == r"\x1b[31mred\nü"


@pytest.mark.parametrize("state", [(), (1, -2.5, "x"), (0.1, 1e300, 2**53, "ü", "")])
def test_a_state_survives_as_text(state: tuple[int | float | str, ...]) -> None:
    text = state_text(state)
    assert text
    again = state_from(text)
    assert again == state
    assert list(map(type, again or ())) == list(map(type, state))


def test_no_text_is_no_state() -> None:
    assert state_from("") is None


@pytest.mark.parametrize("name", ["unit", "lambda"])
def test_a_behaviour_is_a_class(name: str) -> None:
    made: dict[str, Callable[[], None] | str] = {"unit": "text", "lambda": lambda: None}
    assert breaches(made[name], Behaviour)[0].startswith("is not a class")
