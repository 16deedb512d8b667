"""Zones that are drawn at a page: in the file beside the map, never lost, and in the next plan."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from artemis.bridges.page.port import PagePort
from artemis.bridges.page.session import ZoneChange
from artemis.clock import SimulatedLoop
from artemis.errors import ArtemisError
from artemis.mission.loading import load_mission
from artemis.mission.zones import HEAD, with_zone, zones_in
from artemis.motion.planned_route import PLANNER
from artemis.page.hub import Hub
from artemis.page.zones import ZoneFiles
from artemis.route_planning.device import RoutePlanner
from artemis.route_planning.zones import MapZone
from artemis.values import Job, JobKind, JobResult, Pose

MISSIONS = Path(__file__).parents[2] / "missions"
MAP = "maps/workshop.yaml"
SQUARE = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))
STEPS: dict[str, Any] = {"steps": [{"wait": {"seconds": 1}}, {"goto": {"map": MAP, "to": "store"}}]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(MISSIONS / "maps", tmp_path / "maps")
    return tmp_path


def change(files: ZoneFiles, **words: object) -> ZoneChange:
    given: dict[str, Any] = {"seq": 1, "beat": 1, "map": MAP, "known": files.told()[0]["tag"], **words}
    return ZoneChange(**given)


def test_a_zone_is_added_below_the_others_and_comments_stay(folder: Path) -> None:
    files, beside = ZoneFiles(folder, STEPS), folder / "maps/workshop.zones.yaml"
    before = beside.read_text()
    files.change(change(files, name="wet floor", corners=SQUARE))
    (told,) = files.told()
    assert (told["map"], told["steps"]) == (MAP, [1])
    assert told["zones"][-1] == {"name": "wet floor", "kind": "keep-out", "speed": None, "corners": SQUARE}
    assert set(before.splitlines()) <= set(beside.read_text().splitlines())
    files.change(change(files, remove=len(told["zones"])))
    assert beside.read_text() == before


def test_a_map_that_has_no_zones_gets_its_file(folder: Path) -> None:
    (folder / "maps/workshop.zones.yaml").unlink()
    files = ZoneFiles(folder, STEPS)
    files.change(change(files, corners=SQUARE))
    assert [zone["name"] for zone in files.told()[0]["zones"]] == [""]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({"corners": SQUARE[:2]}, "corners: expected a list of at least 3, found a list of 2"),
        ({"corners": ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0))}, "on one line"),
        ({"corners": SQUARE, "name": "under-the-crane"}, "already"),
        ({"corners": SQUARE, "known": "of yesterday"}, "another operator has changed"),
        ({"corners": SQUARE, "map": "maps/other.yaml"}, "no step plans routes on maps/other.yaml"),
        ({"remove": 99}, "no zone"),
    ],
)
def test_what_cannot_be_is_refused_and_the_file_stays(folder: Path, words: dict[str, Any], why: str) -> None:
    files, beside = ZoneFiles(folder, STEPS), folder / "maps/workshop.zones.yaml"
    beside.write_text(beside.read_text().replace("{kind: keep-out", "{name: under-the-crane, kind: keep-out", 1))
    before = beside.read_bytes()
    with pytest.raises(ArtemisError) as caught:
        files.change(change(files, **words))
    assert why in str(caught.value)
    assert beside.read_bytes() == before


def test_a_file_that_is_wrong_is_told_and_not_written(folder: Path) -> None:
    files, beside = ZoneFiles(folder, STEPS), folder / "maps/workshop.zones.yaml"
    beside.write_text("zones: 3\n")
    (told,) = files.told()
    assert "workshop.zones.yaml:1" in told["problem"]
    with pytest.raises(ArtemisError):
        files.change(change(files, corners=SQUARE))
    assert beside.read_text() == "zones: 3\n"


def test_the_hub_changes_zones_beside_its_loop_and_tells_all_pages(folder: Path) -> None:
    async def main() -> tuple[list[dict[str, Any]], Any]:
        files, told = ZoneFiles(folder, STEPS), list[dict[str, Any]]()
        port = PagePort("zones of a test")
        hub = Hub((os.getpid(),), "zones of a test", files)
        session = hub.connected("phone", told.append)
        try:
            port.watch(lambda: None)
            hub.begin()
            while not hub.reaches_run:
                await asyncio.sleep(0)
            words = {"t": "zone", "seq": 1, "beat": 1, "map": MAP, "known": files.told()[0]["tag"], "corners": SQUARE}
            now = hub.now
            session.receive(json.dumps({"t": "take"}), now)
            hub.seats.beat(now)
            session.receive(json.dumps(words), now)
            async with asyncio.timeout(10):
                while not [message for message in told if message["t"] == "act"]:
                    await asyncio.sleep(0.001)
                while hub._changing:
                    await asyncio.sleep(0.001)
        finally:
            hub.close()
            port.close()
        return [message for message in told if message["t"] == "act"], json.loads(hub.parts["zones"][1])

    acts, ((zones),) = asyncio.run(main())
    assert acts == [{"t": "act", "why": ""}]
    assert zones["zones"][-1]["corners"] == [list(corner) for corner in SQUARE]


# ---------------------------------------------------------------------------------------------------- the next plan


def planned(planner: RoutePlanner) -> JobResult:
    step = next(iter(planner._destinations))
    job = Job(id=1, kind=JobKind.PLAN, drive=PLANNER, value=step)
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(planner.perform(job))


@pytest.mark.slow
def test_the_next_plan_heeds_a_zone_that_was_drawn_and_refuses_a_file_that_is_wrong(folder: Path) -> None:
    for name in ("goto_workshop.yaml", "robots"):
        (shutil.copytree if (MISSIONS / name).is_dir() else shutil.copy)(MISSIONS / name, folder / name)
    loaded = load_mission(folder / "goto_workshop.yaml")
    planner = RoutePlanner(loaded.robot, loaded.destinations, zones_in, virtual=True)
    planner._pose = Pose(x=1.0, y=1.5)
    first = planned(planner)
    assert first.ok
    files = ZoneFiles(folder, STEPS)
    files.change(change(files, name="closed", corners=((7.0, 0.5), (9.0, 0.5), (9.0, 3.0), (7.0, 3.0))))
    shut = planned(planner)
    assert (shut.ok, shut.fault) == (False, ""), "the store lies in it"
    assert 'zones changed: new {name: "closed", kind: keep-out, corners: [[7, 0.5], [9, 0.5]' in shut.detail
    assert "zones changed" not in planned(planner).detail
    (folder / "maps/workshop.zones.yaml").write_text("zones: 3\n")
    wrong = planned(planner)
    assert (wrong.ok, wrong.fault, "workshop.zones.yaml:1" in wrong.detail) == (False, "PTH-11", True)
    files_again = (MISSIONS / "maps/workshop.zones.yaml").read_bytes()
    (folder / "maps/workshop.zones.yaml").write_bytes(files_again)
    assert planned(planner).values == first.values


@pytest.mark.parametrize("name", [r"a\\b", "it's", 'a "b"', 'it\'s "it"', "Größe", "x: {y}"])
def test_a_name_is_read_as_it_was_written(name: str) -> None:
    zone = MapZone(kind="keep-out", corners=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), name=name)
    assert zones_in(with_zone(HEAD, "m", zone), "m").zones == (zone,)


@pytest.mark.parametrize("name", ["two\nlines", "two\u2028lines", "bell\a"])
def test_a_name_that_is_not_one_line_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="on one line"):
        MapZone(kind="keep-out", corners=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), name=name)
