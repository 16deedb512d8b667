"""Answers that are typed at the terminal, each with the question of the mission that it is for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from artemis.app import Watch
from artemis.attendance import Typed
from artemis.commands.terminal import listen_to_keys
from artemis.devices.can_bus import Traffic
from artemis.progress import Answer, TypedAnswer
from artemis.values import Mode, Request, Tick

READING = 0.3
"""Nobody reads a question sooner [s]: what is typed sooner is for the one before, if that was not answered."""


class Answering:
    """Sees every tick, and knows which question stands at the terminal, and since when."""

    def __init__(self, questions: Collection[int]) -> None:
        """`questions`: the numbers of the mission's steps that ask."""
        self._questions = questions
        self._asked: TypedAnswer | None = None
        self._before: TypedAnswer | None = None
        self._now, self._done = 0.0, 0.0

    def listen(
        self, request: Callable[[Request | Answer], None], typed: Typed | None, keys: Mapping[bytes, Request | str]
    ) -> Callable[[], None]:
        """As `listen_to_keys`; answers go to `request` with their question."""
        return listen_to_keys(lambda it: request(self.answer(it) if isinstance(it, str) else it), typed, keys)

    def beside(self, watch: Watch) -> Watch:
        """What sees every tick, and `watch`."""

        def both(tick: Tick, traffic: Traffic) -> None:
            self.see(tick)
            watch(tick, traffic)

        return both

    def see(self, tick: Tick) -> None:
        """The next tick."""
        position, self._now = tick.position, tick.snapshot.time
        asks = tick.mode is Mode.READY and position.step in self._questions
        lasts = self._asked is not None and self._asked.step == position.step and position.done >= self._done
        if not (asks and lasts):
            answered = tick.snapshot.sensed.answers or tick.snapshot.sensed.typed
            self._before = None if answered else self._asked
            self._asked = TypedAnswer(text="", step=position.step, shown=self._now) if asks else None
        self._done = position.done

    def answer(self, text: str) -> TypedAnswer:
        """What is typed now."""
        asked = self._asked
        if self._before is not None and (asked is None or self._now - asked.shown < READING):
            asked = self._before
        return TypedAnswer(text=text, step=-1 if asked is None else asked.step, shown=asked.shown if asked else 0.0)
