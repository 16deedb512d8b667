"""Runs observers beside the ticks, which never wait for them: each in a thread of its own, behind a bounded queue.

A tick wakes nobody: that would cost it more than all else (docs/decisions/0015-a-tick-wakes-no-observer.md). The
threads look whether there is something.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Condition, RLock, Thread
from typing import Generic, TypeVar

from artemis.devices.can_bus import Traffic
from artemis.plugins.contracts import Observer
from artemis.plugins.guard import GARBAGE, PLUGIN_ERRORS, RAISED, Problem, one_line, told
from artemis.plugins.process import AskedPlugin
from artemis.values import Tick

QUEUE_TICKS = 500
"""Ticks that may wait for an observer."""
LOOK = 0.005
"""An observer's thread looks for new ticks this often [s]."""
PATIENCE = 5.0
"""A plugin has this long to end [s]; then its thread is left behind."""
SLOW = "PLG-03"

Data = TypeVar("Data")
Order = tuple[Callable[..., None], tuple[object, ...]]


class Beside(Generic[Data]):
    """Between the ticks and who works on their data: in a thread, or at once where it is not `threaded`.

    Of the data only so many may wait, then the oldest is dropped. Orders are never dropped, and go before data.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[Data], None],
        *,
        threaded: bool,
        bound: int = QUEUE_TICKS,
        failed: Callable[[BaseException], None] = lambda error: None,
        look: float | None = None,
    ) -> None:
        """Begin. `work` is done on the data; should it raise, `failed` is told, and nothing is done until the end.

        The thread is woken at once; with `look` it looks so often [s] instead, and who hands over wakes nobody.
        """
        self._work, self._bound, self._failed, self._look = work, bound, failed, look
        self._data: deque[Data] = deque()
        self._orders: deque[Order] = deque()
        self._closed = False
        self._lock = RLock()  # a signal may be handled while it is held
        self._news = Condition(self._lock)
        self._thread = Thread(target=self._run, name=name, daemon=True) if threaded else None
        if self._thread:
            self._thread.start()

    def put(self, data: Data) -> Data | None:
        """Hand data over; returns the oldest that waited, if it had to make room."""
        if self._thread is None:
            self._work(data)
            return None
        with self._lock:
            dropped = self._data.popleft() if len(self._data) >= self._bound else None
            self._data.append(data)
            if self._look is None:
                self._news.notify()
        return dropped

    def order(self, action: Callable[..., None], *arguments: object) -> None:
        """Have something done that must not be dropped."""
        if self._thread is None:
            action(*arguments)
            return
        with self._news:
            self._orders.append((action, arguments))
            if self._look is None:
                self._news.notify()

    def close(self, patience: float | None = None) -> bool:
        """Do what waits; False: that is not done within `patience` [s]. Orders and data are then done at once."""
        if self._thread:
            with self._news:
                self._closed = True
                self._news.notify()
            self._thread.join(patience)
            if self._thread.is_alive():
                return False
            self._thread = None
            self._do_all()  # what the thread left, if it has died
        return True

    def _run(self) -> None:
        try:
            self._do_all()
        except BaseException as error:
            self._failed(error)
            raise

    def _do_all(self) -> None:
        """Do what waits until nothing more comes."""
        while True:
            with self._news:
                while not (self._orders or self._data or self._closed):
                    self._news.wait(self._look)
                order = self._orders.popleft() if self._orders else None
                data = [self._data.popleft()] if order is None and self._data else []
            if order is not None:
                action, arguments = order
                action(*arguments)
            elif data:
                self._work(data[0])
            else:
                return


class Observation:
    """An observer at work: itself one which never raises and never waits, whatever the other does.

    One that raises is stopped; one that is slow misses the oldest ticks that wait. Both are problems, said once.
    All methods of the observer are called in one thread.
    """

    def __init__(
        self,
        name: str,
        observer: Observer,
        *,
        threaded: bool,
        patience: float | None = PATIENCE,
        bound: int = QUEUE_TICKS,
        asked: AskedPlugin | None = None,
    ) -> None:
        """Begin. `threaded` in real time; else it sees each tick at once. `patience` [s] at the end; None: endless.

        `asked` is told of one that is not `threaded`.
        """
        self.name, self._observer, self._patience = name, observer, patience
        self._asked = asked if asked is not None and not threaded else AskedPlugin()
        self._problems: deque[Problem] = deque()
        self._stopped = self._closed = False
        self._first_dropped = 0
        self.dropped = 0
        """Ticks that it did not see because it was slow."""
        self._beside: Beside[tuple[Tick, Traffic, float] | None] = Beside(
            name, self._work, threaded=threaded, bound=bound, look=LOOK
        )

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Hand a tick over."""
        if not self._stopped and (dropped := self._beside.put((tick, traffic, now))) is not None:
            self._count(dropped)
            if self.dropped == 1:
                self._complain(SLOW, f"it misses ticks, from tick {self._first_dropped} on")

    def take_problems(self) -> list[Problem]:
        """What went wrong since the last call."""
        return [self._problems.popleft() for _ in range(len(self._problems))] if self._problems else []

    def close(self) -> None:
        """Let it see what waits, and close it; harmless when repeated. What then went wrong is in `take_problems`."""
        if self._closed:
            return
        self._closed = True
        if (dropped := self._beside.put(None)) is not None:
            self._count(dropped)
        if not self._beside.close(self._patience):
            self._complain(SLOW, "it does not end")
        if self.dropped:
            what = "1 tick was not seen: it" if self.dropped == 1 else f"{self.dropped} ticks were not seen, the first"
            self._complain(SLOW, f"{what} is {self._first_dropped}")

    def _count(self, dropped: tuple[Tick, Traffic, float]) -> None:
        if self.dropped == 0:
            self._first_dropped = dropped[0].snapshot.sensed.index
        self.dropped += 1

    def _work(self, seen: tuple[Tick, Traffic, float] | None) -> None:
        """In the thread: show it a tick, or close it."""
        self._asked.begin(self.name)
        try:
            if seen is None:
                self._observer.close()
            elif not self._stopped:
                self._observer.see(*seen)
            if not self._stopped:
                for problem in self._observer.take_problems():
                    self._pass_on(problem)
        except PLUGIN_ERRORS as error:
            self._stopped = True
            self._complain(RAISED, told(error))
        finally:
            self._asked.end()

    def _pass_on(self, problem: object) -> None:
        match problem:
            case (str(id), self.name, str(words)):
                self._complain(id, one_line(words))
            case _:
                self._complain(GARBAGE, told(problem))

    def _complain(self, id: str, words: str) -> None:
        self._problems.append((id, self.name, words))
