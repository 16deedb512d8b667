"""Past runs in a real browser: the list, a replay by mouse, touch and keys, two runs over each other, a report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after, own_key, run
from page_rig import PageRig, Recorded, page_rig, recorded
from test_page import CONTRAST, PHONE, opened, until

pytestmark = pytest.mark.realtime
FAULT = "fault_recovery_by_hand.yaml"


@pytest.fixture(scope="module", autouse=True)
def past(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs: one with a fault, and a figure eight after it; before the browser's driver is there."""
    folder = tmp_path_factory.mktemp("past")
    recorded(FAULT, 25.0, folder)
    recorded("figure_eight.yaml", 20.0, folder)
    return folder


@pytest.fixture
def rig(past: Path, run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    """The page of another run."""
    with page_rig(run, tmp_path, runs=past) as made:
        made.show(900)
        yield made


def listed(chromium: Any, rig: PageRig, **options: Any) -> Any:
    page = opened(chromium, rig, **options)
    page.goto(f"{rig.url}/runs/")
    until(page, "document.querySelectorAll('.run dl').length === 2")
    return page


def replayed(page: Any) -> Any:
    page.wait_for_url("**/runs/replay?**")
    until(page, "Boolean(window.artemis?.shown) && document.getElementById('making').hidden")
    return page


def seen(page: Any) -> float:
    time: float = page.evaluate("artemis.time")
    return time


def test_runs_are_listed_with_what_became_of_them(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    first, second = page.locator(".run").all()
    assert "figure-eight" in first.inner_text()
    assert "fault" not in first.locator(".told").inner_text()
    assert "1 fault" in second.inner_text()
    assert "✖ failed" in second.inner_text()
    assert page.locator("text=Distance").count() == 2
    with page.expect_download() as begun:
        first.locator("[data-act=download]").click()
    assert begun.value.suggested_filename.endswith("figure-eight.zip")
    assert begun.value.failure() is None
    assert not page.troubles


def test_a_report_is_made_and_opened_in_a_page_of_its_own(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    row = page.locator(".run").nth(1)
    with page.context.expect_page() as opening:
        row.locator("[data-act=report]").click()
    report = opening.value
    report.wait_for_selector("#timeline canvas", state="attached")
    assert report.evaluate("window.origin") == "null", "it has no cookie and asks for nothing"
    assert "DRV" in report.inner_text("body") or "COM" in report.inner_text("body")


def test_a_replay_goes_where_hands_and_keys_want(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.locator(".run").nth(1).locator("[data-act=replay]").click()
    replayed(page)
    line = page.locator("#line")
    box = line.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 30)
    half = seen(page)
    assert half == pytest.approx(float(line.get_attribute("aria-valuemax")) / 2, abs=0.2)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowLeft")
    assert seen(page) == pytest.approx(half + 0.9, abs=0.01)
    page.keyboard.press("Home")
    page.keyboard.press("n")
    until(page, "artemis.shown.mode === 'fault'")
    fault = seen(page)
    until(page, "document.getElementById('fault-count').textContent !== '0'")
    assert "fault" in line.get_attribute("aria-valuetext")
    assert page.inner_text("#announce")
    page.keyboard.press("k")
    until(page, f"artemis.time > {fault} + 0.5")
    page.keyboard.press("k")
    assert page.inner_text("#play") == "Play"
    page.locator("#log button").first.click()
    until(page, "artemis.shown.mode === 'init'")
    assert {url.split("/")[2] for url in asked} == {rig.url.split("/")[2]}
    assert not page.troubles


def test_two_runs_lie_over_each_other(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    for box in page.locator(".run input").all():
        box.check()
    page.click("#replay-both")
    replayed(page)
    until(page, "Boolean(artemis.beside?.state)")
    page.keyboard.press("End")
    until(page, "artemis.shown.over")
    assert len(page.locator("#legend li").all()) == 2
    page.click("#tab-with")
    page.select_option("#at", "clock")
    until(page, "artemis.beside !== null")
    page.select_option("#other", "")
    until(page, "artemis.beside === null")
    assert not page.troubles


def test_a_replay_on_a_phone(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig, **PHONE)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.locator("[data-act=replay]").first.tap()
    replayed(page)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    box = page.locator("#line").bounding_box()
    touch = page.context.new_cdp_session(page)
    for kind, share in (("touchStart", 0.2), ("touchMove", 0.3), ("touchMove", 0.4)):
        point = {"x": box["x"] + share * box["width"], "y": box["y"] + 30}
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, "artemis.time > 0.38 * document.getElementById('line').getAttribute('aria-valuemax')")
    before = seen(page)
    page.locator("#play").tap()
    try:
        until(page, f"artemis.time > {before}", 3000)
    except AssertionError:  # so soon after a drag Chromium may take a tap for the end of its fling
        page.locator("#play").tap()
        until(page, f"artemis.time > {before}")


@pytest.mark.parametrize("width", [390, 820, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_replay_does_not_look_live(scheme: str, width: int, chromium: Any, rig: PageRig) -> None:
    """Words that say so are in view wherever the page is scrolled to, and stripes that the live page has not."""
    page = listed(chromium, rig, viewport={"width": width, "height": 844}, color_scheme=scheme)
    page.locator("[data-act=replay]").first.click()
    replayed(page)
    for down in (0, 5000):
        page.evaluate(f"scrollTo(0, {down})")
        for selector, words in (("#past", "not the present state of the robot"), ("#simulated", "simulation")):
            assert words in page.inner_text(selector)
            box = page.locator(selector).bounding_box()
            assert box["width"] > 50
            assert 0 <= box["x"]
            assert box["x"] + box["width"] <= width
            assert 0 <= box["y"] < 200
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            assert page.evaluate(f"document.elementFromPoint({x}, {y}).closest('{selector}') !== null"), (
                "nothing over it"
            )
        assert "live robot" in page.inner_text("#stop")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    stripes = "getComputedStyle(document.getElementById('past')).backgroundImage"
    assert "repeating-linear-gradient" in page.evaluate(stripes)
    contrast = page.evaluate(CONTRAST.replace("[['text', 'panel']", "[['on-past', 'past'], ['on-past', 'past-too']"))
    assert min(value for name, value in contrast if name == "on-past") >= 4.5


@pytest.mark.parametrize("width", [390, 820])
def test_a_simulation_says_so_on_a_phone(width: int, chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig, viewport={"width": width, "height": 844})
    box = page.locator("#simulated").bounding_box()
    assert page.inner_text("#simulated") == "simulation"
    assert box["x"] + box["width"] <= width
    assert page.locator("#past").count() == 0


def test_every_part_of_a_replay_has_a_name(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    for place in ("", "replay"):
        if place:
            page.locator("[data-act=replay]").first.click()
            replayed(page)
        nameless = page.evaluate(
            "[...document.querySelectorAll('button, select, input, a, [role=slider], canvas[role]')].filter(each => "
            "!(each.getAttribute('aria-label') || each.labels?.length || each.textContent.trim())).length"
        )
        assert nameless == 0


def test_stop_is_sent_from_there_too(chromium: Any, rig: PageRig) -> None:
    page = listed(chromium, rig)
    page.click("#stop")
    rig.wait(lambda sample: bool(sample.requests))
    until(page, "document.getElementById('banner').textContent === 'Stop was sent to the robot.'")
