"""What the benches of bridges and of the operator's link do when something in them fails."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from artemis.bridges.addresses import bound
from artemis.bridges.operator.link_process import LinkSettings
from artemis.errors import ArtemisError
from artemis.testing.observers import ObserverContract
from artemis.values import Mode, Request
from artemis_lab.bench import killed_bridges
from artemis_lab.bench.operator_link import LinkThread

LONG = 20.0


def test_a_run_whose_bridges_cannot_be_killed_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, seen = list[Request | str](), list[object]()

    def fails(*given: object) -> None:
        raise ProcessLookupError("no such process")

    def run_mission(*given: object, watch: Callable[..., None], operator: Callable[..., Callable[[], None]]) -> None:
        async def run() -> None:
            over = asyncio.Event()

            def request(what: Request | str) -> None:
                asked.append(what)
                over.set()

            operator(request, None)
            tick = next(iter(ObserverContract().ticks()))
            moving = replace(tick.set_points, speed=killed_bridges.SPEED)
            watch(replace(tick, mode=Mode.FOLLOW, set_points=moving), ())
            async with asyncio.timeout(LONG):
                await over.wait()

        asyncio.run(run())

    monkeypatch.setattr(killed_bridges, "_kill", fails)
    monkeypatch.setattr(killed_bridges, "run_mission", run_mission)
    monkeypatch.setattr(killed_bridges, "load_mission", lambda path: None)
    monkeypatch.setattr(threading, "excepthook", seen.append)
    robot = Path(__file__).parents[2] / "missions/robots/artemis.yaml"
    killed_bridges.kill_bridges(robot, [], 1, 0)
    assert (asked, len(seen)) == ([Request.END], 1)


def test_a_thread_of_the_link_that_has_ended_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def serve(listening: object, port: socket.socket) -> None:
        assert begun.wait(LONG)
        port.close()

    monkeypatch.setattr(LinkThread, "_serve", staticmethod(serve))
    with bound("127.0.0.1", listening=True) as listening:
        link = LinkThread(listening, LinkSettings(b"", b"", ()))
        assert link._thread is not None
        begun.set()
        link._thread.join(LONG)
        with pytest.raises(ArtemisError, match="the thread of the operator's link has ended"):
            link.take()
        link.close()
