"""The space bar and Escape are Stop wherever the focus is, on every page that shows a robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after, own_key, run
from page_rig import PageRig, Recorded, page_rig
from test_page import in_control, opened, until
from test_past_runs import replayed

from artemis.values import Request

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(180)]


@pytest.fixture
def rig(run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    """The page of a run, and that run among the past ones."""
    with page_rig(run, tmp_path, runs=Path(run.loaded.mission.record)) as made:
        made.show(900)
        yield made


def requests(rig: PageRig, wanted: Request) -> int:
    return sum(request is wanted for _, sample, _ in rig.samples for request in sample.requests)


def pass_ticks(rig: PageRig) -> None:
    """What was confirmed to a page reaches the run with its next tick."""
    since = len(rig.samples)
    rig.wait(lambda _: len(rig.samples) > since + 10)


def stops(rig: PageRig, page: Any, key: str) -> None:
    """A press of the key is one stop."""
    before = requests(rig, Request.QUICKSTOP)
    page.keyboard.press(key)
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    pass_ticks(rig)
    assert requests(rig, Request.QUICKSTOP) == before + 1


@pytest.mark.parametrize("key", ["Space", "Escape"])
@pytest.mark.parametrize("clicked", ["[data-ask=arm]", "#tab-drives", "#range", "#follow", "#stick", "#map", "#stop"])
def test_a_key_stops_after_a_click_on(clicked: str, key: str, chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.click(clicked)
    if clicked == "#stop":
        rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
        since = len(rig.samples)
        rig.wait(lambda _: len(rig.samples) > since + 5)
    if clicked == "[data-ask=arm]":
        rig.wait(lambda sample: Request.ARM in sample.requests)
    before = page.locator("#follow").get_attribute("aria-pressed"), page.input_value("#range")
    rig.wait(lambda sample: not sample.requests)
    stops(rig, page, key)
    assert requests(rig, Request.ARM) == (clicked == "[data-ask=arm]"), "the button was not pressed once more"
    assert (page.locator("#follow").get_attribute("aria-pressed"), page.input_value("#range")) == before
    assert page.troubles == []


def test_a_key_that_is_held_stops_once_and_presses_nothing(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.focus("#give")
    for _ in range(5):
        page.keyboard.down("Space")  # from the second on a repetition
    page.keyboard.up("Space")
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    assert page.locator("#give").is_visible(), "control was not given back"
    assert page.evaluate("scrollY") == 0
    assert requests(rig, Request.QUICKSTOP) == 1


@pytest.mark.parametrize("place", ["/runs/", "/runs/replay"])
@pytest.mark.parametrize("key", ["Space", "Escape"])
def test_a_key_stops_at_past_runs(key: str, place: str, chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    page.goto(f"{rig.url}/runs/")
    page.wait_for_selector("[data-act=replay]")
    if place == "/runs/":
        page.focus("[data-act=choose]")
    else:
        page.locator("[data-act=replay]").first.click()
        replayed(page)
        page.click("#play")
        until(page, "artemis.playing")
    stops(rig, page, key)
    until(page, "document.getElementById('banner').textContent === 'Stop was sent to the robot.'")
    if place == "/runs/":
        assert not page.is_checked("[data-act=choose]")
        page.keyboard.press("Enter")
        assert page.is_checked("[data-act=choose]"), "what the space bar did elsewhere"
    else:
        assert page.evaluate("artemis.playing"), "it was not pressed once more"


def test_stop_at_past_runs_is_sent_until_it_is_confirmed(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    page.goto(f"{rig.url}/runs/")
    asked: list[str] = []

    def refuse(route: Any) -> None:
        asked.append(route.request.post_data_json["id"])
        route.abort() if len(asked) < 3 else route.continue_()

    page.route("**/stop", refuse)
    page.keyboard.press("Space")
    until(page, "document.getElementById('banner').textContent.startsWith('Stop is not confirmed')")
    until(page, "document.getElementById('banner').textContent === 'Stop was sent to the robot.'")
    assert len(asked) == 3
    assert len(set(asked)) == 1, "one press"
    pass_ticks(rig)
    assert requests(rig, Request.QUICKSTOP) == 1
