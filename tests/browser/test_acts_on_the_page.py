"""In a real browser: a goal and a zone are set on the map by finger and by keyboard, and a question is answered."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after, own_key
from msgspec.structs import replace
from page_rig import MISSIONS, PageRig, Recorded, page_rig, recorded
from test_page import PHONE, in_control, until

from artemis.mission.zones import zones_in
from artemis.values import Pose, Request

pytestmark = pytest.mark.realtime
MISSION = {
    "mission": "acts",
    "robot": "robots/artemis_lms100.yaml",
    "bus": "simulation",
    "inputs": {"page": {"plugin": "page", "required": False, "allow": ["goal_pose"]}},
    "steps": [
        {"calibrate": {"steering": "from_potentiometers"}},
        {
            "try": {
                "steps": [{"ask": {"question": "which way?", "answers": ["left", "right"], "at_most_s": 0.5}}],
                "catch": {"timeout": [{"say": "nobody"}]},
            }
        },
        {"goto": {"map": "maps/workshop.yaml", "to": {"from_input": "page"}}},
    ],
    "simulation": {
        "seed": 5,
        "true_robot": {"x_m": 1.0, "y_m": 1.5},
        "world": {"map_file": "maps/workshop.yaml"},
        "localizer": {"plugin": "simulated_tracker"},
    },
}
ASK, GOTO = 1, 2


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Of a robot that asks, and then waits for a goal on a map."""
    folder = tmp_path_factory.mktemp("acts")
    for name in ("maps", "robots"):
        shutil.copytree(MISSIONS / name, folder / name)
    (folder / "mission.yaml").write_text(json.dumps(MISSION))
    return recorded(str(folder / "mission.yaml"), 15.0, folder)


@pytest.fixture
def rig(run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    """The page of that run, while it waits for a goal."""
    with page_rig(run, tmp_path) as made:
        made.show(run.at(lambda tick: tick.position.step == GOTO and "waiting for a goal" in tick.wish.phase))
        yield made


def test_a_question_is_answered(chromium: Any, rig: PageRig) -> None:
    rig.place = rig.run.at(lambda tick: tick.position.step == ASK) + 5
    page = in_control(chromium, rig)
    until(page, "document.getElementById('question').textContent.includes('which way?')")
    page.get_by_role("button", name="right").click()
    assert rig.wait(lambda sample: bool(sample.answers)).answers == ("right",)
    assert page.troubles == []


def test_a_goal_is_set_by_a_drag_and_by_fields(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.click("#tool-goal")
    box = page.locator("#map").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 60, steps=3)
    page.mouse.up()
    assert page.input_value("#act-heading") == "90"
    drawn = [float(page.input_value(f"#act-{name}")) for name in ("x", "y")]
    page.click("#act-do")
    goal = rig.wait(lambda sample: sample.goal is not None).goal
    assert goal is not None
    assert [round(goal.x, 2), round(goal.y, 2)] == drawn
    page.focus("#tool-goal")
    page.keyboard.press("Enter")
    for name, text in (("x", "2.5"), ("y", "-1"), ("heading", "180")):
        page.fill(f"#act-{name}", text)
    page.keyboard.press("Enter")
    rig.wait(lambda sample: sample.goal is not None and sample.goal.x == 2.5)
    assert page.locator("#act").is_hidden()
    assert page.troubles == []


def test_a_zone_is_drawn_listed_and_removed_on_a_phone(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig, **PHONE)
    beside = rig.run.loaded.folder / "maps/workshop.zones.yaml"
    before = beside.read_bytes()
    page.tap("#tool-zone")
    box = page.locator("#map").bounding_box()
    for across, down in ((0.3, 0.5), (0.6, 0.5), (0.6, 0.7)):
        page.touchscreen.tap(box["x"] + box["width"] * across, box["y"] + box["height"] * down)
    page.fill("#zone-name", "wet floor")
    page.tap("#act-do")
    until(page, "document.getElementById('act-said').textContent.startsWith('The zone is saved')")
    zone = zones_in(beside.read_bytes(), "zones").zones[-1]
    assert (zone.name, zone.kind, len(zone.corners)) == ("wet floor", "keep-out", 3)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.tap("#tab-zones")
    remove = page.locator("#zones tr", has_text="wet floor").get_by_role("button")
    remove.tap()
    assert beside.read_bytes() != before, "once more, to be sure"
    remove.tap()
    until(page, "document.getElementById('act-said').textContent.startsWith('The zone is removed')")
    assert beside.read_bytes() == before
    assert page.troubles == []


def test_a_request_that_leads_to_nothing_is_answered(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    tick, traffic = rig.run.ticks[rig.place]
    asked = replace(tick.snapshot.sensed, requests=(Request.ARM,))
    rig.observer.see(replace(tick, snapshot=replace(tick.snapshot, sensed=asked)), traffic, asked.time)
    until(page, "document.getElementById('act-said').textContent == 'Arm: ignored, the drives are armed.'")
    assert page.locator("#act-said.bad").is_visible()


def test_who_has_no_control_is_told_so_and_may_not(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.click("#give")
    page.click("#tool-goal")
    for name in ("x", "y", "heading"):
        page.fill(f"#act-{name}", "1")
    assert page.is_disabled("#act-do")
    assert page.inner_text("#act-why") == "Take control first."
    assert not any(sample.goal == Pose(x=1.0, y=1.0, heading=1.0) for _, sample, _ in rig.samples)
