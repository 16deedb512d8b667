"""Virtual time: it jumps, it keeps order, and it leaves nothing behind."""

from __future__ import annotations

import asyncio
import gc
import logging
import weakref
from collections.abc import Coroutine
from typing import Any

import pytest

from artemis.clock import RealTimeLoop, run, stopwatch, until, wall_date


def simulate(main: Coroutine[Any, Any, None]) -> None:
    run(main, simulated=True)


def pending_timers() -> int:
    scheduled: list[asyncio.TimerHandle] = asyncio.get_running_loop()._scheduled  # type: ignore[attr-defined]
    return sum(not handle.cancelled() for handle in scheduled)


def test_virtual_time_starts_at_zero_and_jumps_to_the_next_timer() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert loop.time() == 0.0
        begun = stopwatch()
        await asyncio.sleep(3600.0)
        assert loop.time() == pytest.approx(3600.0, abs=1e-9)
        assert stopwatch() - begun < 5.0

    simulate(main())


def test_virtual_time_stands_still_while_code_runs() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        before = loop.time()
        sum(range(100_000))
        await asyncio.sleep(0)
        assert loop.time() == before

    simulate(main())


def test_timers_fire_at_their_times_in_their_order() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        fired: list[tuple[str, float]] = []

        def fire(name: str) -> None:
            fired.append((name, loop.time()))

        for name, when in (("third", 0.3), ("first", 0.1), ("second", 0.2)):
            loop.call_at(when, fire, name)
        await asyncio.sleep(1.0)
        assert [name for name, _ in fired] == ["first", "second", "third"]
        assert [time for _, time in fired] == pytest.approx([0.1, 0.2, 0.3])

    simulate(main())


def test_until_returns_at_its_deadline() -> None:
    async def main() -> None:
        await until(0.25)
        assert asyncio.get_running_loop().time() == pytest.approx(0.25, abs=1e-9)

    simulate(main())


@pytest.mark.parametrize("deadline", [-1.0, 0.5, 1.0])
def test_until_a_past_deadline_returns_at_once_and_lets_nobody_in_between(deadline: float) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(1.0)
        others: list[str] = []
        loop.call_soon(others.append, "ran")
        await until(deadline)
        assert others == []
        assert loop.time() == pytest.approx(1.0)

    simulate(main())


def test_cancelled_until_leaves_no_timer() -> None:
    async def main() -> None:
        waiting = asyncio.create_task(until(100.0))
        await asyncio.sleep(0.1)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        assert pending_timers() == 0
        assert asyncio.get_running_loop().time() == pytest.approx(0.1)

    simulate(main())


def test_until_cancelled_at_its_very_deadline_is_cancelled_quietly(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        waiting = asyncio.create_task(until(1.0))
        asyncio.get_running_loop().call_at(1.0, waiting.cancel)  # runs first: it was there before the task began
        with pytest.raises(asyncio.CancelledError):
            await waiting

    with caplog.at_level(logging.ERROR, "asyncio"):
        simulate(main())
    assert caplog.messages == []


def test_a_real_loop_waits_really() -> None:
    async def main() -> None:
        begun = stopwatch()
        await until(asyncio.get_running_loop().time() + 0.02)
        assert stopwatch() - begun >= 0.019

    run(main(), simulated=False)


def test_result_of_the_coroutine_is_handed_back() -> None:
    async def main() -> str:
        return "done"

    assert run(main(), simulated=True) == "done"


def test_date_on_the_wall_is_in_utc() -> None:
    offset = wall_date().utcoffset()
    assert offset is not None
    assert not offset


class Node:
    """Refers to itself, so that only a garbage collection frees it."""

    def __init__(self) -> None:
        self.itself = self


def test_no_collection_in_real_time_looks_at_what_was_loaded_before() -> None:
    """A full one would hold the loop up for longer than a robot may be without commands."""
    loaded = [Node() for _ in range(50_000)]

    async def main() -> int:
        return len(gc.get_objects())  # those that the next full collection looks at

    assert run(main(), simulated=False) < 5_000
    assert all(node.itself is node for node in loaded)


def test_garbage_is_collected_before_and_in_real_time_also_what_an_earlier_loop_kept() -> None:
    def garbage() -> weakref.ref[Node]:
        return weakref.ref(Node())

    kept = Node()
    with asyncio.Runner(loop_factory=RealTimeLoop) as runner:

        async def main() -> None:
            inside = garbage()
            gc.collect()
            assert inside() is None

        runner.run(main())
    earlier = weakref.ref(kept)
    del kept
    RealTimeLoop().close()
    assert earlier() is None
