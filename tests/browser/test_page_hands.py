"""What a hand does at the page besides the stick: a gamepad at the browser, a wheel that is calibrated, a path."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after, own_key
from page_rig import MISSIONS, PageRig, Recorded, page_rig, recorded
from test_page import held, in_control, middle, opened, until

from artemis.states.requests import by_hand
from artemis.values import Mode, Request

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(180)]
CALIBRATION = {
    "mission": "measure",
    "robot": "robots/artemis.yaml",
    "bus": "simulation",
    "inputs": {"page": {"plugin": "page", "required": False}},
    "steps": [{"calibrate": {"steering": {"save": "nothing"}}}],
}
PLUG_IN = """() => {
  const button = () => ({pressed: false, value: 0});
  window.pad = {connected: true, mapping: 'standard', axes: [0, 0, 0, 0], buttons: Array.from({length: 17}, button)};
  navigator.getGamepads = () => [null, window.pad];
}"""
SHOULDER, B = 5, 1


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A step by hand that records a path."""
    return recorded("page_teleop.yaml", 12.0, tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module", autouse=True)
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A wheel that a person is to turn; computed before the browser's driver is there."""
    folder = tmp_path_factory.mktemp("calibrated")
    shutil.copytree(MISSIONS / "robots", folder / "robots")
    (folder / "mission.yaml").write_text(json.dumps(CALIBRATION))
    return recorded(str(folder / "mission.yaml"), 20.0, folder)


@pytest.fixture
def rig(run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    """The page in that step."""
    with page_rig(run, tmp_path) as made:
        made.show(run.at(lambda tick: tick.mode is Mode.TELEOP) + 20)
        yield made


def presses(page: Any, button: int, on: bool = True) -> None:
    page.evaluate(f"pad.buttons[{button}].pressed = {str(on).lower()}")


def test_a_gamepad_drives_while_its_shoulder_button_is_held(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.evaluate(PLUG_IN)
    page.evaluate("pad.axes = [-0.6, -0.9, 0, 0]")
    page.wait_for_timeout(300)
    assert not any(sample.enabled for _, sample, _ in rig.samples), "without the button"
    held(rig, lambda: presses(page, SHOULDER), lambda: presses(page, SHOULDER, on=False))
    rig.wait(lambda sample: sample.enabled and sample.speed > 0 and sample.steering > 0)  # forward, left
    page.evaluate("pad.axes = [0.6, 0.9, 0, 0]")
    rig.wait(lambda sample: sample.enabled and sample.speed < 0 and sample.steering < 0)
    assert "backward" in page.inner_text("#wish")
    presses(page, SHOULDER, on=False)
    rig.wait(lambda sample: not sample.enabled and sample.neutral)
    assert page.troubles == []


def test_a_gamepad_that_is_unplugged_drives_no_more_and_has_to_be_released(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.evaluate(PLUG_IN)
    page.evaluate("pad.axes = [0, -1, 0, 0]")
    held(rig, lambda: presses(page, SHOULDER), lambda: presses(page, SHOULDER, on=False))
    page.evaluate("pad.connected = false")
    rig.wait(lambda sample: not sample.enabled)
    until(page, "document.getElementById('wish').textContent === 'the gamepad was disconnected'")
    since = len(rig.samples)
    page.evaluate("pad.connected = true")
    rig.wait(lambda _: len(rig.samples) > since + 40)
    assert not any(sample.enabled for _, sample, _ in rig.samples[since:]), "held since before"


@pytest.mark.parametrize("hears", [True, False])
def test_b_of_a_gamepad_stops_without_control(hears: bool, chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    page.evaluate(PLUG_IN)
    if not hears:
        rig.reading = False  # no state comes that would have the page do anything
        page.wait_for_selector("body[data-link=slow]")
    presses(page, B)
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    since = len(rig.samples)
    rig.wait(lambda _: len(rig.samples) > since + 20)
    requests = [request for _, sample, _ in rig.samples for request in sample.requests]
    assert requests == [Request.QUICKSTOP], "once, as long as it is held"


def test_a_path_is_recorded_from_a_press_to_the_next(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    until(page, "document.querySelector('[data-ask=record]').textContent === 'Record from here'")
    page.click("[data-ask=record]")
    rig.wait(lambda sample: Request.RECORD in sample.requests)
    assert page.troubles == []


def test_a_wheel_is_turned_while_its_button_is_held(
    chromium: Any, rig: PageRig, calibrated: Recorded, tmp_path: Path
) -> None:
    with page_rig(calibrated, tmp_path) as shown:
        shown.show(calibrated.at(lambda tick: by_hand(tick)[1]) + 5)
        page = in_control_while_calibrating(chromium, shown)
        assert page.locator("#potentiometers tr").count() == 2
        assert "V" in page.inner_text("#potentiometers")
        for turn, wanted in (("0.2", Request.LEFT_TENTH), ("-1", Request.RIGHT_TENTH)):
            button = f"#jog [data-turn='{turn}']"
            page.mouse.move(*middle(page, button))
            turned = len(shown.samples)
            held(shown, page.mouse.down, page.mouse.up)
            shown.wait(lambda sample, wanted=wanted: wanted in sample.requests)  # type: ignore[misc]
            page.mouse.up()
            stands(shown)
            page.focus(button)
            held(shown, lambda: page.keyboard.down("Enter"), lambda: page.keyboard.up("Enter"))
            shown.wait(lambda sample, wanted=wanted: wanted in sample.requests)  # type: ignore[misc]
            page.keyboard.up("Enter")
            stands(shown)
            assert {request for _, sample, _ in shown.samples[turned:] for request in sample.requests} == {wanted}
        page.keyboard.press("Space")
        shown.wait(lambda sample: Request.QUICKSTOP in sample.requests)
        page.click("#accept")
        shown.wait(lambda sample: Request.ACCEPT in sample.requests)
        assert page.troubles == []


def in_control_while_calibrating(chromium: Any, rig: PageRig) -> Any:
    page = opened(chromium, rig)
    page.click("#take")
    page.wait_for_selector("#jog", state="visible")
    until(page, "!document.querySelector('#jog button').disabled")
    return page


def stands(rig: PageRig) -> None:
    """Nothing is asked for any more."""
    rig.wait(lambda sample: not sample.requests and sample.neutral)
    since = len(rig.samples)
    rig.wait(lambda _: len(rig.samples) > since + 20)
    assert not any(sample.requests for _, sample, _ in rig.samples[since:])
