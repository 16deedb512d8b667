"""What behaviours declare and answer, checked; and their answers as plain values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from math import isfinite
from typing import TypeGuard

import numpy as np
from msgspec import Struct, json

from artemis.plugins.answers import NUMBER
from artemis.plugins.contracts import Acting, Declared, State
from artemis.plugins.guard import one_line, told
from artemis.progress import DONE, TAKEN_SIGNALS, SignalValue
from artemis.values import Action, DriveCommand

MAX_STATE_BYTES = 1000
"""Of a state, as JSON."""
_OUTCOME, _SIGNAL = re.compile("[a-z][a-z0-9-]{0,63}"), re.compile("[a-z][a-z0-9_]{0,63}")
_TAKEN = (DONE, "fault", "lost", "any", "resume", "restart")
_LARGEST = 2**53
"""Of a whole number: what every reader of JSON keeps."""


class Answered(Struct, frozen=True, kw_only=True):
    """A behaviour's answer, of plain values."""

    command: DriveCommand | None
    outcome: str
    """Empty: it has not ended."""
    state: str
    """JSON."""
    phase: str
    signals: tuple[SignalValue, ...]


def misdeclared(facts: Declared) -> Iterator[str]:
    """What is wrong with what the class of a behaviour states; each completes a sentence about the class."""
    if not isinstance(facts.outcomes, tuple):
        yield f"states outcomes = {facts.outcomes!r:.40}: a tuple of names is meant"
    else:
        for name in facts.outcomes:
            if not isinstance(name, str) or not _OUTCOME.fullmatch(name):
                yield f"declares the outcome {name!r:.70}: small letters, digits and hyphens are meant, a letter first"
            elif name in _TAKEN:
                yield f"declares the outcome {name!r}: this name has a meaning already"
    for name in ("moves", "resumable"):
        if not isinstance(stated := getattr(facts, name), bool):
            yield f"states {name} = {stated!r:.40}: True or False is meant"
    if not isinstance(facts.signals, Mapping):
        yield f"states signals = {facts.signals!r:.40}: units by name are meant"
        return
    for name, unit in facts.signals.items():
        if not isinstance(name, str) or not isinstance(unit, str) or not _SIGNAL.fullmatch(name):
            yield f"declares the signal {name!r:.70}: small letters, digits and underscores are meant, a letter first"
        elif name in TAKEN_SIGNALS:
            yield f"declares the signal {name!r}: it is artemis' own"
        elif unit and not name.endswith(suffix := "_" + re.sub("[^a-z0-9]+", "_", unit.lower()).strip("_")):
            yield f"declares the signal {name!r} in {unit}: its name has to end with {suffix}"


def answered(answer: object, facts: Declared) -> Answered | str:
    """A behaviour's answer of plain values; or what is wrong. The gate judges the command's numbers (RUN-11)."""
    if not isinstance(answer, Acting):
        return "no Acting"
    command = answer.command
    if command is not None:
        if not facts.moves:
            return "a command, but its class states moves = False"
        if (command := _plain_command(command)) is None:
            return "a command that is none"
    outcome = "" if answer.outcome is None else answer.outcome
    if outcome not in ("", DONE, *facts.outcomes):
        return f"the outcome {told(outcome):.70}, which its class does not declare"
    if (state := state_text(answer.state)) is None:
        return f"a state that is no tuple of finite numbers and texts, or of more than {MAX_STATE_BYTES} bytes"
    if not isinstance(answer.phase, str):
        return "a phase that is no text"
    signals = _plain_signals(answer.signals, facts)
    if isinstance(signals, str):
        return signals
    return Answered(command=command, outcome=str(outcome), state=state, phase=one_line(answer.phase), signals=signals)


def state_text(state: object) -> str | None:
    """A behaviour's state as JSON; None: it is none."""
    if not isinstance(state, tuple):
        return None
    plain: list[int | float | str] = []
    for part in state:
        if isinstance(part, str):
            plain.append(str(part))
        elif _is_number(part):
            plain.append(int(part) if isinstance(part, int | np.integer) else float(part))
        else:
            return None
    try:
        text = json.encode(plain).decode()
    except UnicodeEncodeError:  # half of a surrogate pair
        return None
    return text if len(text.encode()) <= MAX_STATE_BYTES else None


def state_from(text: str) -> State | None:
    """Inverse of `state_text`; of an empty text None: there was none."""
    return tuple(json.decode(text)) if text else None


def _is_number(part: object) -> TypeGuard[float]:
    """Whether it is finite, and if it is whole, no larger than JSON's."""
    if isinstance(part, int | np.integer):
        return abs(int(part)) <= _LARGEST
    return isinstance(part, NUMBER) and isfinite(part)


def _plain_command(command: object) -> DriveCommand | None:
    if not isinstance(command, DriveCommand) or not isinstance(command.action, Action):
        return None
    if not isinstance(command.speed, NUMBER) or not isinstance(command.steering, NUMBER):
        return None
    try:
        return DriveCommand(speed=float(command.speed), steering=float(command.steering), action=command.action)
    except OverflowError:  # a whole number too large for a float
        return None


def _plain_signals(signals: object, facts: Declared) -> tuple[SignalValue, ...] | str:
    if not isinstance(signals, Mapping):
        return "signals that are no mapping"
    plain = []
    for name, value in signals.items():
        if name not in facts.signals:
            return f"the signal {told(name):.70}, which its class does not declare"
        if not _is_number(value):
            return f"the signal {name} = {told(value):.40}: a finite number is meant"
        plain.append(SignalValue(name=str(name), value=float(value)))
    return tuple(plain)
