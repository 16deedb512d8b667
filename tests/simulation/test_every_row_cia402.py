"""Drives of the profile CiA 402: what they report, and what happens to them, is noticed in time and stops the robot."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, name_of, play, scenes
from rig import MISSIONS
from scenes_of_motion import MOTION_SCENES
from scenes_of_the_bus import BUS_SCENES
from watched import DRIVES, TRACTION

from artemis.mission.loading import load_model
from artemis.sim.cia402 import ERRORS_402
from artemis.sim.epos_errors import Reaction
from artemis.supervision.catalogue import ROWS
from artemis.vehicle import RobotFile
from artemis_lab.injections.drives import UNKNOWN
from artemis_lab.injections.emergencies import CODES

FILE = "artemis_cia402.yaml"
ROBOT = load_model(MISSIONS / "robots" / FILE, RobotFile)
LATER = 0.06
"""Their targets are looked at so much later in a bring-up than those of the first generation [s]."""
UNITS = ROBOT.drives[TRACTION[0]].tables.velocity_scale


def errors() -> Iterator[tuple[str, Scene]]:
    """Each code, and one that nobody knows, once, on one drive after the other, heard and not heard."""
    nodes = itertools.cycle(DRIVES)
    for id, codes in {**CODES["cia402"], "DRV-31": (UNKNOWN,)}.items():
        for code, heard in itertools.product(codes, (True, False)):
            node = next(nodes)
            off = code == UNKNOWN or ERRORS_402[code].reaction is Reaction.POWER_OFF
            options = {"code": code, "heard": heard}
            coasts = [node] if off and node in TRACTION else []
            scene = Scene(inject=id, robot=FILE, units=UNITS, node=node, options=options, coasts=coasts)
            yield (id if heard else "COM-01"), scene


def others() -> Iterator[tuple[str, Scene]]:
    """Faults of the bus and of motion, as those of drives of the first generation.

    In Switched On nobody sees such a drive: the next set-point takes it back into operation at once.
    """
    for id, scene in scenes({**BUS_SCENES, **MOTION_SCENES}):
        if scene.robot is not None or ROWS[id].is_missed_by(ROBOT) or scene.options.get("state") == "switched on":
            continue
        if id == "COM-06" and scene.at is not None:
            lost = [{**fault, "at_s": fault["at_s"] + LATER} for fault in scene.along]
            scene = replace(scene, at=scene.at + LATER, along=lost)
        yield id, replace(scene, robot=FILE, units=UNITS)


@pytest.mark.sampled(12)
@pytest.mark.parametrize(("id", "scene"), list(errors()), ids=name_of)
def test_error_is_noticed_in_time_and_stops_the_robot(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


@pytest.mark.sampled(40)
@pytest.mark.parametrize(("id", "scene"), list(others()), ids=name_of)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))
