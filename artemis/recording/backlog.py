"""What waits for a slow disk: a bounded number of ticks, of which the oldest goes first, and every event."""

from __future__ import annotations

from collections import deque
from threading import Condition
from typing import Generic, TypeVar

Data = TypeVar("Data")
Event = TypeVar("Event")


class Backlog(Generic[Data, Event]):
    """Between the ticks, which never wait, and the thread that writes."""

    def __init__(self, bound: int) -> None:
        """Of the data at most `bound` may wait."""
        self._bound = bound
        self._data: deque[Data] = deque()
        self._events: deque[Event] = deque()
        self._closed = False
        self._news = Condition()

    def put_data(self, data: Data) -> Data | None:
        """Let data wait; returns the oldest that waited, if it had to make room."""
        with self._news:
            dropped = self._data.popleft() if len(self._data) >= self._bound else None
            self._data.append(data)
            self._news.notify()
        return dropped

    def put_event(self, event: Event) -> None:
        """Let an event wait: none is ever dropped."""
        with self._news:
            self._events.append(event)
            self._news.notify()

    def close(self) -> None:
        """Nothing more will come."""
        with self._news:
            self._closed = True
            self._news.notify()

    def take(self) -> tuple[Event | None, Data | None]:
        """Wait for the next event or, if none waits, the oldest data; neither: all is taken and nothing more comes."""
        with self._news:
            self._news.wait_for(lambda: self._events or self._data or self._closed)
            if self._events:
                return self._events.popleft(), None
            return None, self._data.popleft() if self._data else None
