"""A thread with a loop of its own, and who hands data over to it."""

from __future__ import annotations

import asyncio
import threading

import pytest

from artemis.bridges import loop_thread
from artemis.bridges.loop_thread import LoopThread

LONG = 20.0


class Worker(LoopThread):
    """Takes data, one lot after the other, once it may."""

    def __init__(self) -> None:
        super().__init__("worker")
        self.may, self.taken = threading.Event(), list[int]()

    def take(self, number: int) -> None:
        assert self.may.wait(LONG)
        self.taken.append(number)

    async def _main(self, end: asyncio.Event) -> None:
        await end.wait()

    def _give_back(self) -> None:
        """Nothing is open."""


def test_who_hands_over_more_than_is_taken_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_thread, "MOST_WAITING", 4)
    worker, handed = Worker(), list[int]()
    worker.start()

    def hand_over() -> None:
        for number in range(20):
            worker.hand_over(worker.take, number)
            handed.append(number)

    giver = threading.Thread(target=hand_over)
    giver.start()
    giver.join(0.2)
    assert len(handed) <= 5, "four wait, and one is being taken"
    worker.may.set()
    giver.join(LONG)
    worker.close()
    assert worker.taken == handed == list(range(20))


def test_nobody_waits_for_a_thread_that_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_thread, "MOST_WAITING", 1)
    worker = Worker()
    worker.may.set()
    worker.start()
    worker.close()
    for number in range(5):
        worker.hand_over(worker.take, number)
    worker.soon(worker.take, 5)
    assert worker.taken == []
