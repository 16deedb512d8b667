"""Somebody at the terminal in a lesson, who teaches a device in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator


class LessonPerson(ABC):
    """Does what the newest words say. `told` are all of them."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self._acts: Iterator[str | None] = iter(())

    def say(self, text: str) -> None:
        self.told.append(text)
        self._acts = self.act(text)

    def typed(self) -> str | None:
        return next(self._acts, None)

    @abstractmethod
    def act(self, text: str) -> Iterator[str | None]:
        """What the person does, one thing for each look at the terminal: a line, or None while a control is moved."""
