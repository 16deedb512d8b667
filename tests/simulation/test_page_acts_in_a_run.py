"""Runs on simulated drives in which somebody at the page acts: a goal, a zone, an answer, a wheel that is turned."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from math import degrees, hypot
from pathlib import Path
from typing import Any

import pytest

from artemis.app import Outcome, Parts, run_mission
from artemis.bridges.operator.session import Arrived, Given, GivenAnswer, GivenPose, LinkReport
from artemis.bridges.page.session import REQUESTS, ZoneChange
from artemis.clock import SimulatedLoop
from artemis.commands.replay import replay_run
from artemis.mission.loading import load_mission, plugin_from
from artemis.page.zones import ZoneFiles
from artemis.planning import inputs_used, setup_for
from artemis.plugins.inputs.page import PageInput, PageInputConfig
from artemis.states.requests import by_hand
from artemis.values import Mode, Request, Tick

MISSIONS = Path(__file__).parents[2] / "missions"
WORKSHOP: dict[str, Any] = {
    "robot": "robots/artemis_lms100.yaml",
    "simulation": {
        "seed": 5,
        "true_robot": {"x_m": 1.0, "y_m": 1.5},
        "world": {"map_file": "maps/workshop.yaml"},
        "localizer": {"plugin": "simulated_tracker", "noise_m": 0.005, "noise_deg": 0.3},
    },
}


class Somebody:
    """At a page, on virtual time: an empty hand, and what a test has it do after a tick."""

    def __init__(self, acts: Callable[[Somebody, Tick], None]) -> None:
        self._acts, self._report = acts, LinkReport("held", "phone", 0.0)
        self.jog = 0.0
        self.journal: list[str] = []

    def give(self, given: Given) -> None:
        now = asyncio.get_running_loop().time()
        self._report.given.append(given)
        self._report.asked = now

    def ask(self, word: str) -> None:
        self._report.requests.append(REQUESTS[word])
        self._report.asked = asyncio.get_running_loop().time()

    def see(self, tick: Tick) -> None:
        self._acts(self, tick)

    def watch(self, news: Callable[[], None]) -> None:
        pass

    def take(self) -> list[LinkReport]:
        held, axes = self.jog != 0.0, (0.0, 0.0, self.jog) if self.jog else (0.0, 0.0)
        now = asyncio.get_running_loop().time()
        report, self._report = self._report, LinkReport("held", "phone", 0.0)
        report.newest = Arrived(now, True, held, not held, 0.0, 0.0, 0.0, axes)
        return [report]

    def tell(self, status: bytes) -> None:
        raise AssertionError

    def close(self) -> None:
        pass


def run(folder: Path, somebody: Somebody, steps: list[Any], mission: dict[str, Any]) -> tuple[Outcome, list[Tick]]:
    """A run of a mission whose input is the page, with its ticks; it replays."""
    page = {"plugin": "page", "required": False, "allow": ["goal_pose"]}
    words = {"mission": "acts", "bus": "simulation", "inputs": {"page": page}, "steps": steps, **mission}
    source = folder / "mission.yaml"
    source.write_text(json.dumps(words))
    loaded = load_mission(source)
    _, config = plugin_from("artemis.inputs", inputs_used(loaded, simulated=True)["page"])
    assert isinstance(config, PageInputConfig)
    device = PageInput(config, replace(setup_for(loaded, "page"), real_time=False), somebody)
    ticks: list[Tick] = []

    def watch(tick: Tick, _: object) -> None:
        ticks.append(tick)
        somebody.see(tick)

    outcome = run_mission(loaded, source, watch=watch, parts=Parts(inputs={"page": device}, loop=SimulatedLoop))
    somebody.journal = [json.loads(line)["text"] for line in outcome.run.journal.read_text().splitlines()]
    assert replay_run(outcome.run.path) == 0
    return outcome, ticks


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("maps", "robots"):
        shutil.copytree(MISSIONS / name, tmp_path / name)
    return tmp_path


@pytest.mark.exhaustive
def test_the_robot_drives_to_a_goal_that_is_set_around_a_zone_that_was_drawn(folder: Path) -> None:
    files = ZoneFiles(folder, {"steps": [{"goto": {"map": "maps/workshop.yaml"}}]})

    def acts(somebody: Somebody, tick: Tick) -> None:
        if tick.mode is Mode.READY and tick.wish.phase == "waiting for a goal of page":
            zone = ZoneChange(
                1, 1, "maps/workshop.yaml", files.told()[0]["tag"], "wet", ((3, 1), (4, 1), (4, 2), (3, 2))
            )
            if not any(each["name"] == "wet" for each in files.told()[0]["zones"]):
                files.change(zone)
            somebody.give(GivenPose("goal_pose", 5.0, 1.5, 0.0))

    goto = {"goto": {"map": "maps/workshop.yaml", "to": {"from_input": "page"}, "speed_m_s": 0.5}}
    steps = [{"calibrate": {"steering": "from_potentiometers"}}, goto]
    somebody = Somebody(acts)
    outcome, ticks = run(folder, somebody, steps, WORKSHOP)
    assert not outcome.failed
    places = [tick.snapshot.pose.pose for tick in ticks if tick.snapshot.pose.frame == "map"]
    assert hypot(places[-1].x - 5.0, places[-1].y - 1.5) < 0.05
    assert not [pose for pose in places if 3.0 <= pose.x <= 4.0 and 1.0 <= pose.y <= 2.0]


@pytest.mark.exhaustive
def test_a_goal_that_is_not_reached_by_any_route_is_refused_with_the_reason(folder: Path) -> None:
    given = list[float]()

    def acts(somebody: Somebody, tick: Tick) -> None:
        if tick.wish.phase.endswith("waiting for a goal of page"):
            if not given:
                somebody.give(GivenPose("goal_pose", -50.0, 0.0, 0.0))
                given.append(tick.snapshot.time)
            elif tick.wish.phase.startswith("no route to x -50.00 m"):
                somebody.ask("end")

    goto = {"goto": {"map": "maps/workshop.yaml", "to": {"from_input": "page"}}}
    _, ticks = run(folder, Somebody(acts), [{"calibrate": {"steering": "from_potentiometers"}}, goto], WORKSHOP)
    assert any("it lies outside of the map" in tick.wish.phase or "no route" in tick.wish.phase for tick in ticks)


def test_a_question_is_answered_at_the_page(folder: Path) -> None:
    def acts(somebody: Somebody, tick: Tick) -> None:
        if tick.mode is Mode.READY and tick.position.step == 1 and 0.2 < tick.position.done < 0.25:
            somebody.give(GivenAnswer(0, "left"))
            somebody.give(GivenAnswer(1, "right"))

    ask = {"ask": {"question": "which way?", "answers": ["left", "right"], "at_most_s": 5}}
    end = {"choose": [{"if": "answer == 'right'", "steps": [{"say": "to the right"}]}]}
    steps = [{"calibrate": {"steering": "from_potentiometers"}}, ask, end]
    somebody = Somebody(acts)
    outcome, ticks = run(folder, somebody, steps, {"robot": "robots/artemis.yaml"})
    assert not outcome.failed
    assert any("to the right" in text for text in somebody.journal)
    assert any("'left' answers a question that is over" in text for text in somebody.journal)
    assert [tick.snapshot.sensed.answers for tick in ticks if tick.snapshot.sensed.answers] == [("right",)]


@pytest.mark.exhaustive
@pytest.mark.short_alignment
def test_a_wheel_is_turned_straight_and_accepted_at_the_page(folder: Path) -> None:
    """The button is held for a second, lets go, and the wheel stays; then what was read is accepted."""
    turned, rested = list[float](), list[float]()
    accepted = [0.0]

    def acts(somebody: Somebody, tick: Tick) -> None:
        (accepts, turns), now = by_hand(tick), tick.snapshot.time
        here = next(drive.position for drive in tick.snapshot.sensed.drives if drive.name == "steer-left")
        if turns:
            (turned if somebody.jog else rested).append(here)
        somebody.jog = 0.2 if turns and len(turned) < 50 and len(rested) > 5 else 0.0
        if accepts and now > accepted[-1] + 1.0 and (not turns or len(rested) > 60):
            somebody.ask("accept")
            accepted.append(now)

    calibrate = {"calibrate": {"steering": {"wheels": "left", "save": "nothing"}}}
    outcome, ticks = run(folder, Somebody(acts), [calibrate], {"robot": "robots/artemis.yaml"})
    assert not outcome.failed
    assert degrees(turned[-1] - turned[0]) == pytest.approx(1.0, abs=0.35)
    assert degrees(abs(rested[-1] - turned[-1])) < 0.3
    assert any(Request.ACCEPT in tick.snapshot.sensed.requests for tick in ticks)
