"""Where the last run left the robot is taken for its place only if nothing is known to have moved it since."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import resuming
from resuming import FAR, HALF, Done, driven, of_a_robot
from rig import CALIBRATE, follow, straight, write_mission

from artemis.app import Parts
from artemis.clock import SimulatedLoop
from artemis.mission.actions import PluginUse
from artemis.plugins.contracts import PluginContext
from artemis.values import Mode, Pose, PoseFix, Tick

pytestmark = pytest.mark.short_alignment

BUS = {"interface": "udp_multicast", "channel": "239.74.163.78"}
THERE = Pose(x=2.0, y=-1.0, heading=0.5)
FLOOR = "t,x,y,heading\n0.0,2.0,-1.0,0.5\n"
COVARIANCE = (1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4)


class Begins:
    """A localizer that begins where the last run left the robot, and knows for sure where it is."""

    def __init__(self, context: PluginContext) -> None:
        self.last = context.last_pose()

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        return (PoseFix(time=now, pose=THERE, covariance=COVARIANCE, source="floor"),)

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """Of a real robot on a floor that a file describes."""
    floor = {"plugin": "tracker", "file": "floor.csv"}
    return write_mission(tmp_path, [CALIBRATE], {"floor.csv": FLOOR}, bus=BUS, localizer=floor)


def begun(mission: Path, *, simulate: bool = False) -> tuple[Pose | None, Done]:
    """What a run takes for the robot's place, and the run, in which nothing drives."""
    found: list[Begins] = []

    def plugins(group: str, use: PluginUse, context: PluginContext) -> Any:  # noqa: ANN401 (as a localizer)
        found.append(Begins(context))
        return found[-1]

    parts = Parts(machine=None if simulate else of_a_robot(mission), loop=SimulatedLoop, plugins=plugins)
    done = resuming.run(mission, until=at_rest, simulate=simulate, parts=parts)
    return found[0].last, done


def at_rest(tick: Tick) -> bool:
    return tick.mode is Mode.READY and tick.snapshot.pose.frame == "map"


def drives(mission: Path) -> Done:
    """Another mission drives the same robot."""
    folder = mission.parent / "another"
    other = write_mission(folder, [CALIBRATE, follow(0.4)], {"line.csv": straight(FAR)}, bus=BUS, mission="other")
    keys = json.loads(other.read_text()) | {"record": str(mission.parent / "runs")}
    other.write_text(json.dumps(keys))
    parts = Parts(machine=of_a_robot(other), loop=SimulatedLoop)
    return resuming.run(other, until=driven(HALF), parts=parts)


def is_there(pose: Pose | None) -> bool:
    return pose is not None and math.dist((pose.x, pose.y), (THERE.x, THERE.y)) < 0.01


def said(done: Done) -> list[tuple[str, int]]:
    return [(entry.text, int(entry.level)) for entry in done.journal if entry.kind == "place"]


def test_a_run_says_which_one_its_place_is_from(mission: Path) -> None:
    nobody, first = begun(mission)
    assert nobody is None
    assert said(first) == [("the robot is looked for on the whole map: no earlier run of this mission", 3)]
    last, second = begun(mission)
    assert is_there(last)
    ((told, level),) = said(second)
    assert told.startswith(f"x 2.00 m, y -1.00 m, heading 29 deg: there {first.folder.name} ended at 2")
    assert level == 2
    assert second.told == [told]


def test_another_mission_that_drove_the_robot_makes_the_place_unknown(mission: Path) -> None:
    begun(mission)
    second = drives(mission)
    last, done = begun(mission)
    assert last is None
    ((told, _),) = said(done)
    assert f"{second.folder.name} has driven the robot since" in told


def test_a_place_on_what_has_changed_is_unknown(mission: Path) -> None:
    begun(mission)
    (mission.parent / "floor.csv").write_text(FLOOR + "1.0,2.0,-1.0,0.5\n")
    last, done = begun(mission)
    assert last is None
    assert "floor.csv is not what it was in" in said(done)[0][0]


def test_a_run_that_was_not_ended_in_order_tells_nothing_of_the_robot(mission: Path) -> None:
    """It is recorded until its last entry; how long the robot went on after that, nobody knows."""
    _, first = begun(mission)
    journal = first.outcome.run.journal
    content = journal.read_bytes()
    journal.write_bytes(content[: content.rindex(b"\n", 0, -1) + 1])
    last, done = begun(mission)
    assert last is None
    assert f"{first.folder.name}: it was not ended in order" in said(done)[0][0]


def test_a_recording_without_its_end_tells_nothing_of_the_robot(mission: Path) -> None:
    """It holds all but the last half second, in which the robot may have moved by a metre."""
    _, first = begun(mission)
    recording = first.folder / "recording.mcap"
    recording.write_bytes(recording.read_bytes()[:-20_000])
    last, done = begun(mission)
    assert last is None
    assert f"{first.folder.name}: its recording is not whole: " in said(done)[0][0]


def test_a_simulated_run_tells_nothing_of_the_robot(mission: Path) -> None:
    begun(mission, simulate=True)
    assert begun(mission)[0] is None
    assert is_there(begun(mission, simulate=True)[0])
