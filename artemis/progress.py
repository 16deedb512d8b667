"""How far a mission is, and what happened in it: parts of a tick; and the words that a mission is made of."""

from __future__ import annotations

from msgspec import Struct

WORDS = ("repeat", "try", "during", "choose", "together", "call")
"""Compose steps."""
TIMELESS = ("say", "end", "stop")
"""Steps in which no time passes: they have no number."""
BLOCKED = "blocked"
"""The outcome of a step that stood for an obstacle for too long."""
SHORT = "battery-short"
"""The outcome of a step whose path, or what is left of it, is longer than the battery reaches."""
NO_PATH = "no-path"
"""The outcome of a `goto` to whose place no route leads."""
DONE = "done"
"""The outcome of a step that has done what it is for."""
OWN_STEPS = ("calibrate", "follow", "goto", "wait", "teleop", "ask", *TIMELESS, *WORDS)
"""Artemis' own steps and words: no behaviour can have such a name."""
OF_BATTERY = ("charge_percent", "range_m", "time_left_s")
"""Signals that only a robot has whose file describes its battery."""
ANY_BATTERY = ("battery_v", *OF_BATTERY)
"""Signals that rise while the battery is charged."""
MEASURED = ("run_s", "driven_m", *ANY_BATTERY)
"""Artemis' own signals that are numbers."""
CONDITION_WORDS = ("and", "or", "not")
TAKEN_SIGNALS = (*MEASURED, "round", "answer", *CONDITION_WORDS)
"""No signal of a behaviour can have such a name."""


class SignalValue(Struct, frozen=True, kw_only=True, gc=False):
    """What a behaviour measured: a signal for the mission's conditions."""

    name: str
    value: float


class Acted(Struct, frozen=True, kw_only=True, gc=False):
    """What the behaviour of one of the mission's steps told in a tick."""

    step: int
    outcome: str = ""  # how it ended; empty: it has not
    state: str = ""  # what it needs to resume (JSON)
    signals: tuple[SignalValue, ...] = ()


class Position(Struct, frozen=True, kw_only=True, omit_defaults=True, gc=False):
    """How far a mission is done."""

    step: int = 0
    """Which of its steps is done now, counted from 0 as they stand in the mission; after the last: their number."""
    done: float = 0.0
    """How much of it is done, here or in an earlier run: distance along its path [m], or time [s]."""
    state: str = ""
    """What the behaviour that does it told last (JSON); empty: none does, or it has told nothing yet."""
    place: str = ""
    """In the words around it (`artemis.states.advance.Place`, JSON); empty: the mission is a list of steps."""
    faults: tuple[str, ...] = ()
    """The fault table's ids of what stopped the step, the most severe first, as far as a `try` of the mission names
    them: it is told of them when the robot may continue."""
    answer: str = ""
    """The newest one to a question of the mission."""
    told: tuple[SignalValue, ...] = ()
    """What behaviours told last, also those that have ended; forgotten where a step with this signal begins."""
    ended: str = ""
    """How the mission ended, if not by doing all of its steps."""
    driven: float = 0.0
    """Distance driven in the earlier runs that this one resumes [m]; the present run's is the odometry's."""
    time: float = 0.0
    """How long these lasted [s]."""


class MissionEvent(Struct, frozen=True, kw_only=True, gc=False):
    """Something that happened in a mission, for people."""

    kind: str  # said, ended, fired, expired, caught, retry, round, end, goal, answer
    place: str  # key path in the mission
    text: str


class TypedAnswer(Struct, frozen=True, kw_only=True, gc=False):
    """An answer that was typed at the terminal."""

    text: str
    step: int  # the number of the step whose question it is for; -1: none was there
    shown: float  # since when that was asked [s of the run]


Answer = str | TypedAnswer
"""To a question of the mission: the answer itself, or its number from 1."""
