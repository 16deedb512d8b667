"""A robot that waits, in a real browser: a mission is chosen and started, its page comes, and the end comes back."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, own_key, run
from command_line import MISSIONS, read_until, started

from artemis_lab.bench.ports import free_port

pytestmark = pytest.mark.realtime
TAKES = 90_000
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
BROKEN = "mission: broken\nrobot: robots/artemiz.yaml\nbus: simulation\nsteps: [{wait: {seconds: 1}}]\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "missions"
    made.mkdir()
    for part in ("robots", "paths"):
        shutil.copytree(MISSIONS / part, made / part)
    for name in ("figure_eight.yaml", "figure_eight_socketcan.yaml"):
        shutil.copy(MISSIONS / name, made)
    (made / "broken.yaml").write_text(BROKEN)
    return made


@pytest.fixture
def page(folder: Path, chromium: Any) -> Iterator[Any]:
    """A paired browser at the page of the folder."""
    with started("page", folder, "--page-port", str(free_port())) as serving:
        (address,) = re.findall(r"http\S+#\w+", read_until(serving, "pair#"))
        context = chromium.new_context()
        context.set_default_timeout(TAKES)
        made = context.new_page()
        made.troubles = []
        made.on("pageerror", lambda error: made.troubles.append(str(error)))
        made.goto(address)
        made.wait_for_selector("body.waiting[data-link=ok]")
        yield made
        assert made.troubles == []
        context.close()


def end_the_run(page: Any) -> None:
    """Take control and press End twice, as often as it takes: on a busy computer a request may be too old to count."""
    from playwright.sync_api import Error

    while not page.is_visible("#last"):
        with suppress(Error):  # the page that waits takes the place of the run's at this moment
            page.evaluate(
                "() => { const [take, end] = ['#take', '[data-ask=end]'].map(each => document.querySelector(each));"
                " if (end && !document.body.classList.contains('mine')) take.click(); end?.click(); end?.click(); }"
            )
        page.wait_for_timeout(500)


@pytest.mark.exhaustive
def test_a_mission_is_started_and_comes_back_with_its_end(page: Any) -> None:
    page.wait_for_selector(".mission.real")
    assert page.is_disabled("[aria-label='Start figure-eight']"), "nobody has control"
    assert "broken.yaml:2:1: robot: file not found" in page.text_content(".mission.wrong .problems")
    page.click("#take")
    page.wait_for_selector("body.mine")
    assert page.is_disabled("[aria-label='Start broken']")
    page.click("[aria-label='Start figure-eight']")
    page.wait_for_selector("#map")
    page.wait_for_selector("body[data-link=ok]")
    page.wait_for_selector("#phase:has-text('arm')")
    end_the_run(page)
    page.wait_for_selector("#last:not([hidden])")
    assert "failed" in page.text_content("#last-title")
    page.click("#last summary")
    assert "ended" in page.text_content("#last-lines")


def test_a_real_robot_is_asked_about_by_keys_too_and_fits_a_phone(page: Any) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_selector(".mission.real")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.focus("#take")
    page.keyboard.press("Enter")
    page.wait_for_selector("body.mine")
    page.focus("[aria-label='Start figure-eight-socketcan']")
    page.keyboard.press("Enter")
    page.wait_for_selector("#sure[open]")
    assert "ARTEMIS, on socketcan vcan0" in page.text_content("#sure-text")
    assert page.evaluate("document.activeElement.id") == "not-sure", "the answer that does nothing"
    assert page.is_disabled("#start-real"), "it has to be read first"
    page.wait_for_selector("#start-real:enabled")
    page.keyboard.press("Escape")
    page.wait_for_selector("#sure", state="hidden")
    assert page.is_hidden("#run")
