"""Who attends a run: a scripted operator, somebody at the terminal or at a device; and the signals that end it."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf

from artemis.mission.schema import Operation
from artemis.progress import Answer
from artemis.values import Request

OPERATOR_GRACE = 5.0
"""A scripted operator counts as present until this long after its last act [s]."""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a run."""
Typed = Callable[[bytes], None]
"""Is called with what is typed at the terminal; with nothing once that is closed."""
Operator = Callable[[Callable[[Request | Answer], None], Typed | None], Callable[[], None]]
"""Given where requests go, and all that is typed (None: nobody wants it), begins to listen to somebody at a terminal;
returns how to stop."""


class Attendance:
    """Who can act in a run, and whether anybody is there."""

    def __init__(self, acts: Sequence[Operation], operator: Operator | None) -> None:
        """Nobody has acted yet.

        Args:
            acts: Of the scripted operator; none where the run is not simulated.
            operator: Somebody at a terminal; None: nobody.
        """
        self._acts, self._operator = acts, operator
        self._until = max((act.at_s for act in acts), default=-inf) + OPERATOR_GRACE
        self._listeners: list[Typed] = []
        self.awaited = False
        """The mission has a device that needs a person: somebody may come to it."""
        self.hands = False
        """Somebody was heard at one."""
        self.interrupted: int | None = None
        """The signal that ends the run: the first."""
        self._taken: list[signal.Signals] = []
        self._over = False
        """The last tick was: nothing is asked for any more."""

    @property
    def expected(self) -> bool:
        """Somebody will be there, by what is known before the run."""
        return self._operator is not None or bool(self._acts)

    def is_undisturbed(self) -> bool:
        """No signal has asked for the end."""
        return self.interrupted is None

    def there(self, time: float) -> tuple[bool, bool]:
        """Whether anybody is there at a run time [s], and whether somebody may still come."""
        return self._operator is not None or self.hands or time <= self._until, self.awaited

    def hear(self, listener: Typed) -> bool:
        """Have an input device hear what is typed at the terminal; whether there is one."""
        self._listeners.append(listener)
        return self._operator is not None

    @contextmanager
    def holding_signals(self) -> Iterator[None]:
        """Those that `begin` took break nothing off before the end of this: the recording is closed in it."""
        before = {number: signal.getsignal(number) for number in ENDING}
        try:
            yield
        finally:
            for number in self._taken:
                signal.signal(number, before[number])

    def begin(self, loop: asyncio.AbstractEventLoop, request: Callable[[Request | Answer], None]) -> Callable[[], None]:
        """Pass on what everybody asks for from now on; returns how to stop. Signals stay taken: `holding_signals`.

        SIGINT, SIGTERM and SIGHUP end the run, whoever started it; a second one stops quickly. SIGINT does so
        also where a shell had it ignored, as for a script's `artemis run ... &`: nothing may refuse to stop a robot.
        SIGHUP alone stays ignored where it was (`nohup`) and nobody is at the terminal: that run was to outlive it.
        Where somebody was, the person who could have stopped the robot is gone: a quick stop.
        """
        for act in self._acts:
            loop.call_later(act.at_s, request, Request[act.do.upper()] if act.answer is None else act.answer)

        def ask(what: Request) -> None:
            if not self._over:
                request(what)

        self._take_signals(loop, ask)

        def tell(typed: bytes) -> None:
            for listener in self._listeners:
                listener(typed)

        listening = None if self._operator is None else self._operator(request, tell if self._listeners else None)

        def stop() -> None:
            self._over = True
            if listening is not None:
                listening()

        return stop

    def _take_signals(self, loop: asyncio.AbstractEventLoop, ask: Callable[[Request], None]) -> None:
        if threading.current_thread() is not threading.main_thread():  # no other hears signals
            return

        def interrupt(number: int, _: object) -> None:
            """Between two instructions of whatever runs: also of a plugin that does not return."""
            again, self.interrupted = self.interrupted is not None, self.interrupted or number
            if self._over:
                return
            loop.call_soon_threadsafe(ask, Request.END)
            if again or (number == signal.SIGHUP and self._operator is not None):
                loop.call_soon_threadsafe(ask, Request.QUICKSTOP)

        for number in ENDING:
            outlives = number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN
            if self._operator is not None or not outlives:
                signal.signal(number, interrupt)
                self._taken.append(number)
