"""The report of a run on a phone: nothing to be moved to the side, no words too small, and a finger on its charts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after
from page_rig import Recorded, recorded
from test_page import PHONE, TAKES, until

from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(180)]
LEAST = 11.0
"""Of letters [px]; a phone has about 160 in an inch, so 1.7 mm."""
OUTSIDE = """[...document.querySelectorAll('body *')].filter(each => {
  const box = each.getBoundingClientRect();
  return box.width > 0 && (box.left < -1 || box.right > innerWidth + 1) && !each.closest('.u-legend, svg');
}).map(each => each.tagName + '.' + each.className)"""
SMALL = """[...document.querySelectorAll('body *')].filter(each =>
  [...each.childNodes].some(node => node.nodeType === 3 && node.textContent.trim()) && each.checkVisibility()
  && !['SCRIPT', 'STYLE'].includes(each.tagName) && !each.closest('svg')
  && parseFloat(getComputedStyle(each).fontSize) < least).map(each => each.textContent.trim().slice(0, 40))"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """With a fault."""
    return recorded("fault_recovery_by_hand.yaml", 25.0, tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def report(run: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (recording,) = Path(run.loaded.mission.record).glob("*")
    file = tmp_path_factory.mktemp("report") / "report.html"
    write_report(Recording(recording), file)
    return file


@pytest.mark.parametrize("width", [390, 360])
def test_a_report_is_read_on_a_phone(width: int, chromium: Any, report: Path) -> None:
    options = {**PHONE, "viewport": {"width": width, "height": 844}}
    page = chromium.new_context(**options).new_page()
    page.set_default_timeout(TAKES)
    troubles: list[str] = []
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.goto(report.as_uri())
    until(page, "document.querySelectorAll('.plot canvas').length > 5")
    page.evaluate("for (const each of document.querySelectorAll('details')) each.open = true")
    assert page.evaluate("[innerWidth, document.documentElement.scrollWidth]") == [width, width]
    assert page.evaluate(OUTSIDE) == []
    assert page.evaluate(SMALL.replace("least", str(LEAST))) == []
    assert page.locator("h2", has_text="Faults").bounding_box()["y"] < 2 * 844, "what is wrong comes first"
    chart = page.locator(".u-over").nth(1)
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    assert box["width"] > 0.7 * width
    point = {"x": box["x"] + box["width"] / 2, "y": box["y"] + 40}
    finger = page.context.new_cdp_session(page)
    finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    finger.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{**point, "x": point["x"] + 20}]})
    until(page, "/^1[1-6]/.test(document.getElementById('readout').textContent)")
    assert troubles == []
