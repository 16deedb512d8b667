"""What an observer says of the network that it tells others by: rows of the fault table."""

from __future__ import annotations

FAILED = "NET-12"


class Complaints:
    """That it is not heard, once as long as that lasts; that somebody is too slow, once, and in the end its cost."""

    def __init__(self, name: str, who: str) -> None:
        """`name` of the observer; `who` hears it, such as subscriber."""
        self._name, self._who = name, who
        self._told = self._slow = False

    def new(self, problem: str, dropped: int, *, closed: bool) -> list[tuple[str, str, str]]:
        """What was not said yet of its present problem (empty: none), and of messages that were dropped in all."""
        words = [problem] if problem and not self._told else []
        if dropped and not self._slow:
            words.append(f"a {self._who} is too slow: messages for it are dropped")
        elif dropped and closed:
            words.append(f"{dropped} messages were dropped: {self._who}s were too slow")
        self._told, self._slow = bool(problem), bool(dropped)
        return [(FAILED, self._name, each) for each in words]
