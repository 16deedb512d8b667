"""The process of a page that waits, without its server: what it starts, and no longer starts."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from artemis.bridges.page.session import Take
from artemis.notify import ServiceManager
from artemis.page import started_run
from artemis.page.mission_folder import CheckedMission, MissionFolder
from artemis.page.observer import PageObserverConfig
from artemis.page.waiting import Cancel, Confirm, Start, Waiting, Watcher
from artemis.page.waiting_page import WaitingPage
from artemis_lab.bench.ports import free_port

MISSION = CheckedMission(file="lap.yaml", mission="lap", bus="simulation", simulated=True, hash="aa")
REAL = CheckedMission(file="real.yaml", mission="real", bus="socketcan can0", hash="bb")

HANGS = """
import signal
from artemis.notify import ServiceManager
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, signal.SIGINT])
ServiceManager().tell(*{words})
signal.pause()
"""
"""A run that does not go on: before its first tick, or as its report is on a disk that does not answer."""
ENDS = """
import sys, time
from artemis.notify import ServiceManager
manager = ServiceManager()
manager.tell("READY=1")
sys.stdin.read()
manager.tell("STOPPING=1")
open("report", "w").close()
"""


def at_page(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    play: Callable[[WaitingPage, Waiting, Watcher], Coroutine[Any, Any, None]],
    program: str = "",
) -> None:
    """Have something done by who has control; `program` stands for each run."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    known = {each.file: each for each in (MISSION, REAL)}
    monkeypatch.setattr(MissionFolder, "get", lambda _, file: known.get(file))

    async def main() -> None:
        nothing = [sys.executable, "-c", ""]
        command = [sys.executable, "-c", program]
        config = PageObserverConfig(port=free_port())
        page = WaitingPage(tmp_path, config, None, nothing, lambda mission: command, ServiceManager())
        watcher = Watcher("1.1.1.1")
        page._waiting.obey(watcher, Take(who="a test"), 0.0)
        try:
            await asyncio.wait_for(play(page, page._waiting, watcher), 60.0)
        finally:
            await page.close()

    asyncio.run(main())


def test_a_page_that_ends_starts_nothing_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def play(page: WaitingPage, waiting: Waiting, watcher: Watcher) -> None:
        waiting.obey(watcher, Start(file=REAL.file, hash=REAL.hash), 0.0)
        page.end()
        waiting.obey(watcher, Confirm(file=REAL.file, hash=REAL.hash), 1.0)
        assert watcher.refused == "this page is ending"
        waiting.obey(watcher, Start(file=MISSION.file, hash=MISSION.hash), 0.0)
        assert watcher.refused == "this page is ending"
        assert (waiting.state, page._server.run) == ("waiting", None)
        await page._look()

    at_page(tmp_path, monkeypatch, play)


@pytest.mark.parametrize(
    ("words", "state", "outcome"),
    [
        (["STATUS=imports a plugin"], "starting", "SIGKILL before its first tick; it had enabled no drive"),
        (["READY=1", "STOPPING=1"], "ending", "after its last tick; the drives were released before"),
    ],
)
def test_a_run_that_hangs_before_its_first_tick_or_after_its_last_can_be_cancelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], state: str, outcome: str
) -> None:
    monkeypatch.setattr(started_run, "CANCEL_TIME", 0.1)

    async def play(page: WaitingPage, waiting: Waiting, watcher: Watcher) -> None:
        looking = asyncio.create_task(page._look())
        waiting.obey(watcher, Start(file=MISSION.file, hash=MISSION.hash), 0.0)
        while (
            waiting.state != state
            or (run := page._server.run) is None
            or words[0] not in ("READY=1", f"STATUS={run.status}")
        ):
            await asyncio.sleep(0.01)
        waiting.obey(Watcher("2.2.2.2"), Cancel(), 0.0)
        assert page._server.told()["run"]["cancelled"] is not None
        while waiting.last is None:
            await asyncio.sleep(0.01)
        assert (waiting.state, waiting.last.status) == ("waiting", -9)
        assert outcome in waiting.last.outcome
        page.end()
        await looking

    at_page(tmp_path, monkeypatch, play, HANGS.format(words=words))


@pytest.mark.parametrize("asked", [0, 1])
def test_a_page_that_fails_ends_its_run_in_order_before_it_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: int
) -> None:
    async def play(page: WaitingPage, waiting: Waiting, watcher: Watcher) -> None:
        waiting.obey(watcher, Start(file=MISSION.file, hash=MISSION.hash), 0.0)
        run = page._server.run
        assert run is not None
        while not run.is_ready:
            run.look(asyncio.get_running_loop().time())
            await asyncio.sleep(0.01)
        for _ in range(asked):
            page.end()

    at_page(tmp_path, monkeypatch, play, ENDS)
    assert (tmp_path / "report").exists()
