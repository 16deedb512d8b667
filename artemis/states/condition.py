"""Conditions of a mission: one line over declared signals, such as `battery_v < 23.2 and not stick.done`.

either  = both { "or" both }
both    = one { "and" one }
one     = "not" one | "(" either ")" | signal [relation (number | 'text')]
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from msgspec import Struct

from artemis.errors import ConfigError, similar
from artemis.progress import ANY_BATTERY, CONDITION_WORDS

Value = float | str | bool
Signals = Mapping[str, Value]
"""What is known in a tick, by name. A signal without a value yet is missing."""
ROUND = "round"
"""The signal that only conditions within a `repeat` may ask for."""
MAX_DEPTH = 50
"""Parentheses and `not` inside each other."""
_TOKEN = re.compile(
    r"\s*(?:([0-9]+\.?[0-9]*)|([a-z][a-z0-9_-]*(?:\.[a-z_]+)?)|(<=|>=|==|!=|<|>|\(|\)|-)|('[^']*')|(\S))"
)
_RELATIONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


class SignalKind(Struct, frozen=True, kw_only=True):
    """What a condition may ask for."""

    kind: type
    """float, str or bool."""
    values: tuple[str, ...] = ()
    """Of a text: all that it can be; (): anything."""


class Has(Struct, frozen=True):
    """A signal that is true or false."""

    signal: str


class Compare(Struct, frozen=True):
    """A signal against a value; false as long as the signal has no value."""

    signal: str
    relation: str
    value: float | str


class Not(Struct, frozen=True):
    """The contrary."""

    of: Condition


class Both(Struct, frozen=True):
    """All of them."""

    of: tuple[Condition, ...]


class Either(Struct, frozen=True):
    """One of them at least."""

    of: tuple[Condition, ...]


Condition = Has | Compare | Not | Both | Either


def holds(condition: Condition, signals: Signals) -> bool:
    """Whether it is true of what is known; not where it depends on a signal without a value yet."""
    return _truth(condition, signals) is True


def _truth(condition: Condition, signals: Signals) -> bool | None:
    """Three-valued, as S. C. Kleene has it (Introduction to Metamathematics, 1952, section 64); None: unknown."""
    match condition:
        case Has(signal):
            return bool(signals.get(signal, False))
        case Compare(signal, relation, value):
            known = signals.get(signal)
            return None if known is None else _RELATIONS[relation](known, value)
        case Not(of):
            found = _truth(of, signals)
            return None if found is None else not found
    decides = isinstance(condition, Either)
    parts = [_truth(part, signals) for part in condition.of]
    return decides if decides in parts else None if None in parts else not decides


def comparisons(condition: Condition) -> Iterator[Has | Compare]:
    """What it asks of single signals, from left to right."""
    if isinstance(condition, Has | Compare):
        yield condition
        return
    for part in (condition.of,) if isinstance(condition, Not) else condition.of:
        yield from comparisons(part)


def asks_battery(condition: Condition | None) -> bool:
    """Whether it asks for a signal that rises while the battery is charged."""
    return condition is not None and any(part.signal in ANY_BATTERY for part in comparisons(condition))


def names_asked(text: str) -> set[str]:
    """The signals that a text asks for, whether or not it is a condition."""
    return {name for _, name, *_ in _TOKEN.findall(text) if name and name not in CONDITION_WORDS}


def parse(text: str, declared: Mapping[str, SignalKind]) -> Condition:
    """The condition that a mission writes.

    Raises:
        ConfigError: it cannot be read, asks for a signal that is not declared, or compares what cannot be compared.
    """
    return _Parser(text, declared).result()


class _Parser:
    def __init__(self, text: str, declared: Mapping[str, SignalKind]) -> None:
        self._text, self._declared = text, declared
        self._tokens: list[tuple[str, str]] = []
        self._next = self._depth = 0
        for number, name, mark, quoted, other in _TOKEN.findall(text):
            if other:
                raise self._wrong(f"cannot read {other!r}")
            kind = "number" if number else "text" if quoted else "mark" if mark or name in CONDITION_WORDS else "name"
            self._tokens.append((kind, number or name or mark or quoted))

    def result(self) -> Condition:
        found = self._either()
        if self._next < len(self._tokens):
            raise self._wrong(f"unexpected {self._token!r}")
        return found

    @property
    def _token(self) -> str:
        return self._tokens[self._next][1] if self._next < len(self._tokens) else ""

    def _wrong(self, reason: str, hint: str = "write for example battery_v < 23.2 and not stick.done") -> ConfigError:
        return ConfigError(f"condition {self._text!r}: {reason}; {hint}")

    def _take(self, *tokens: str) -> bool:
        taken = self._next < len(self._tokens) and self._tokens[self._next] in [("mark", token) for token in tokens]
        self._next += taken
        return taken

    def _list(self, word: str, part: Callable[[], Condition]) -> Sequence[Condition]:
        parts = [part()]
        while self._take(word):
            parts.append(part())
        return parts

    def _either(self) -> Condition:
        parts = self._list("or", self._both)
        return parts[0] if len(parts) == 1 else Either(tuple(parts))

    def _both(self) -> Condition:
        parts = self._list("and", self._one)
        return parts[0] if len(parts) == 1 else Both(tuple(parts))

    def _one(self) -> Condition:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._wrong("too many parentheses")
        try:
            if self._take("not"):
                return Not(self._one())
            if self._take("("):
                inner = self._either()
                if not self._take(")"):
                    raise self._wrong("a parenthesis is not closed")
                return inner
            return self._comparison()
        finally:
            self._depth -= 1

    def _comparison(self) -> Condition:
        if self._next == len(self._tokens) or self._tokens[self._next][0] != "name":
            raise self._wrong(f"expected a signal, found {self._token or 'the end'!r}")
        name = self._token
        signal = self._declared.get(name)
        if signal is None:
            hint = "it exists only inside `repeat`" if name == ROUND else similar(name, self._declared)
            raise self._wrong(f"unknown signal {name!r}", hint)
        self._next += 1
        relation = self._token
        if not self._take(*_RELATIONS):
            if signal.kind is not bool:
                what = "a number: compare it" if signal.kind is float else "a text: compare it with =="
                raise self._wrong(f"{name} is {what}")
            return Has(name)
        if signal.kind is bool:
            raise self._wrong(f"{name} is true or false: write {name}, or not {name}")
        return Compare(name, relation, self._value(name, signal, relation))

    def _value(self, name: str, signal: SignalKind, relation: str) -> float | str:
        sign = -1.0 if self._take("-") else 1.0
        kind, token = self._tokens[self._next] if self._next < len(self._tokens) else ("", "the end")
        self._next += 1
        if signal.kind is float:
            if kind != "number":
                raise self._wrong(f"{name} is a number, compared with {token}")
            return sign * float(token)
        if kind != "text":
            raise self._wrong(f"{name} is a text, compared with {token}: texts stand in single quotes")
        if relation not in ("==", "!="):
            raise self._wrong(f"{name} is a text: it can only be compared by == and !=")
        value = token[1:-1]
        if signal.values and value not in signal.values:
            raise self._wrong(f"{name} is never {value!r}", similar(value, signal.values))
        return value
