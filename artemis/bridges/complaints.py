"""What an observer reports about its connection to other programs: rows of the fault table."""

from __future__ import annotations

from collections.abc import Iterable

FAILED = "NET-12"


class Complaints:
    """That it reaches no other program, once while that lasts; refused clients, once; slow clients, and the cost."""

    def __init__(self, name: str, who: str) -> None:
        """`name` of the observer; `who` receives its messages, such as subscriber."""
        self._name, self._who = name, who
        self._told = self._slow = False
        self._refused: set[str] = set()

    def new(
        self, problem: str, dropped: int, *, closed: bool, refused: Iterable[str] = ()
    ) -> list[tuple[str, str, str]]:
        """What was not reported yet.

        Args:
            problem: at present; empty: none.
            dropped: messages in all.
            closed: the observer is closed.
            refused: a text for each refused client.
        """
        words = [problem] if problem and not self._told else []
        new = [each for each in refused if each not in self._refused]
        self._refused.update(new)
        words += new
        if dropped and not self._slow:
            words.append(f"a {self._who} is too slow: messages for it are dropped")
        elif dropped and closed:
            words.append(f"{dropped} messages were dropped: {self._who}s were too slow")
        self._told, self._slow = bool(problem), bool(dropped)
        return [(FAILED, self._name, each) for each in words]
