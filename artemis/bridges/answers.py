"""Calls of services that are answered once a tick has taken what they ask for."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

PATIENCE = 0.5
"""A call is answered within this time [s], also where no tick takes it."""


class Answers:
    """Those that wait, on one running loop."""

    def __init__(self) -> None:
        self._waiting: dict[int, asyncio.Future[tuple[bool, str]]] = {}

    async def of(self, number: int) -> tuple[bool, str]:
        """Whether the request of the call with that number has an effect, and a text with the result."""
        waiting: asyncio.Future[tuple[bool, str]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = waiting
        try:
            async with asyncio.timeout(PATIENCE):
                return await waiting
        except TimeoutError:
            return False, f"the run has not taken it within {PATIENCE:g} s"
        finally:
            del self._waiting[number]

    def give(self, numbers: Iterable[int], taken: bool, words: str) -> None:
        """Answer the calls of these numbers, on the loop."""
        for number in numbers:
            if (waiting := self._waiting.get(number)) is not None and not waiting.done():
                waiting.set_result((taken, words))
