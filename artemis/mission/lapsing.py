"""Conditions that some day never hold again, because what they ask of only grows."""

from __future__ import annotations

from artemis.states.condition import Compare, Condition, Either, Has, Not

GROWING = ("run_s", "driven_m")
"""Signals that never sink."""
_BELOW, _ABOVE = ("<", "<=", "=="), (">", ">=", "!=")


def lapses(condition: Condition, at_last: bool = False) -> bool:
    """Whether it is `at_last` for ever, once the signals that only grow have grown enough, whatever the others are."""
    match condition:
        case Compare(signal, relation):
            return signal in GROWING and relation in (_ABOVE if at_last else _BELOW)
        case Has():
            return False
        case Not(of):
            return lapses(of, not at_last)
    parts = [lapses(part, at_last) for part in condition.of]
    return any(parts) if isinstance(condition, Either) is at_last else all(parts)
