"""Browsers are sent 20 states a second on average, whatever the tick rate."""

from __future__ import annotations

import asyncio
import json
import os
from typing import Any

import pytest
from msgspec.structs import replace
from page_rig import Recorded, recorded

from artemis.clock import SimulatedLoop
from artemis.page import observer
from artemis.page.hub import Hub
from artemis.page.observer import PageObserver, PageObserverConfig
from artemis.page.server import PageServer
from artemis.planning import setup_for

SECONDS = 20


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return recorded("figure_eight.yaml", 1.0, tmp_path_factory.mktemp("runs"))


class Sent:
    """In place of the thread of the server: counts."""

    problem = ""

    def __init__(self) -> None:
        self.states: list[Any] = []

    def put(self, update: dict[str, Any]) -> None:
        self.states.append(update["state"])


def shown(run: Recorded, monkeypatch: pytest.MonkeyPatch) -> tuple[PageObserver, Sent, list[float]]:
    """An observer with a clock that stands where a test puts it."""
    page = PageObserver(PageObserverConfig(), setup_for(run.loaded, "page"))
    sent, now = Sent(), [0.0]
    page._thread = sent  # type: ignore[assignment]
    monkeypatch.setattr(observer, "stopwatch", lambda: now[0])
    return page, sent, now


@pytest.mark.parametrize("tick_hz", [25, 30, 50, 60, 100, 200])
@pytest.mark.parametrize("jitter", [0.0, 0.004])
def test_twenty_states_a_second_are_made(
    tick_hz: int, jitter: float, run: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, sent, now = shown(run, monkeypatch)
    tick, traffic = run.ticks[-1]
    for number in range(SECONDS * tick_hz):
        now[0] = 1000.0 + number / tick_hz + jitter * (number % 3)
        page.see(tick, traffic, tick.snapshot.time)
    assert len(sent.states) == pytest.approx(20 * SECONDS, abs=2)


def test_after_a_pause_no_state_is_made_up_for(run: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    page, sent, now = shown(run, monkeypatch)
    tick, traffic = run.ticks[-1]
    page.see(tick, traffic, 0.0)
    for number in range(50):
        now[0] = 10.0 + number * 0.02
        page.see(tick, traffic, 0.0)
    assert len(sent.states) <= 1 + 20 + 1


def test_the_last_state_of_a_run_is_made_at_once(run: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    page, sent, now = shown(run, monkeypatch)
    tick, traffic = run.ticks[-1]
    page.see(tick, traffic, 0.0)
    now[0] = 0.01
    page.see(replace(tick, wish=replace(tick.wish, finished=True)), traffic, 0.0)
    assert len(sent.states) == 2


class Link:
    """A browser's connection, as far as it is sent something; it takes a while to take it."""

    def __init__(self, takes: float) -> None:
        self._takes = takes
        self.told: list[dict[str, Any]] = []

    async def send_text(self, text: str) -> None:
        await asyncio.sleep(self._takes)
        self.told.append(json.loads(text))


@pytest.mark.parametrize(("takes", "least"), [(0.0, 400), (0.012, 399), (0.15, 100)])
def test_a_browser_is_sent_every_state_that_it_takes(takes: float, least: int) -> None:
    async def main() -> list[dict[str, Any]]:
        hub, link = Hub((os.getpid(),), "nobody"), Link(takes)
        server = object.__new__(PageServer)
        server._hub = hub
        telling = asyncio.create_task(server._tell(link))  # type: ignore[arg-type]
        for number in range(20 * SECONDS):
            await asyncio.sleep(0.05)
            hub.put({"state": b"%d" % number})
        await asyncio.sleep(0.4)
        telling.cancel()
        return [message for message in link.told if "state" in message]

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        states = runner.run(main())
    assert least <= len(states) <= 20 * SECONDS
    assert states[-1]["state"] == 20 * SECONDS - 1


def test_a_browser_is_told_that_the_page_is_there_while_nothing_is_new() -> None:
    async def main() -> list[dict[str, Any]]:
        link = Link(0.0)
        server = object.__new__(PageServer)
        server._hub = Hub((os.getpid(),), "nobody")
        telling = asyncio.create_task(server._tell(link))  # type: ignore[arg-type]
        await asyncio.sleep(4.0)
        telling.cancel()
        return link.told

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        told = runner.run(main())
    assert 9 <= len(told) <= 11
    assert [message["age"] for message in told][-1] == pytest.approx(4.0, abs=0.41)
