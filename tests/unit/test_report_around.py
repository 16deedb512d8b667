"""What a report shows of obstacles, planned routes, and the map of a `goto`."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from core_builders import snapshot
from test_map_readings import scan_of

from artemis.mission.loading import load_model
from artemis.motion.planned_route import packed_route, planned_route
from artemis.report.around import EVERY, DrivenAround
from artemis.report.known_map import known_map
from artemis.values import JobKind, JobResult, LocatedPose, Mode, Pose, SetPoints, Tick, Wish
from artemis.vehicle import RobotFile

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = load_model(MISSIONS / "robots" / "artemis_lms100.yaml", RobotFile)
AT = LocatedPose(pose=Pose(x=1.0, y=2.0, heading=np.pi / 2))


def tick(time: float, pose: LocatedPose = AT, **sensed: object) -> Tick:
    seen = snapshot(time, pose=pose, **sensed)  # type: ignore[arg-type]
    return Tick(snapshot=seen, mode=Mode.FOLLOW, wish=Wish(), set_points=SetPoints())


def test_what_was_near_is_kept_now_and_then_while_the_robot_is_slowed_down() -> None:
    ranges = np.zeros(181)
    ranges[[90, 120]] = 1.0, 3.5  # ahead, and too far away
    scan = scan_of(ranges, 0.0)
    around = DrivenAround(ROBOT)
    around.see(tick(0.0, scans=(scan,)), slowed=False)
    assert not around.seen
    around.see(tick(0.1), slowed=True)
    around.see(tick(0.2), slowed=True)
    around.see(tick(0.1 + EVERY, LocatedPose(lost=True)), slowed=True)
    ((point,),) = around.seen
    assert point == pytest.approx([1.0, 2.0 + 0.56 + 1.0], abs=0.02)  # the scanner sits above the front axle
    around.see(tick(0.2 + EVERY), slowed=True)
    assert len(around.seen) == 2


def test_routes_are_kept_and_drawn() -> None:
    points = np.column_stack([np.arange(3.0), np.zeros(3), np.full(3, 0.4)])
    result = JobResult(
        id=1, kind=JobKind.PLAN, drive="a route", ok=True, values=packed_route(planned_route(points, ROBOT, 0.4))
    )
    around = DrivenAround(ROBOT)
    around.see(tick(0.0, results=(result,)), slowed=False)
    (route,) = around.routes
    assert route[[0, -1]] == pytest.approx(np.array([[0.0, 0.0], [2.0, 0.0]]), abs=1e-6)


def test_the_map_of_a_goto_is_known_wherever_the_step_stands() -> None:
    files = {f"maps/workshop.{kind}": (MISSIONS / "maps" / f"workshop.{kind}").read_bytes() for kind in ("yaml", "pgm")}
    steps = [{"calibrate": {}}, {"try": {"steps": [{"goto": {"map": "maps/workshop.yaml", "to": "store"}}]}}]
    recording = SimpleNamespace(mission={"steps": steps}, files=files)
    found = known_map(recording)  # type: ignore[arg-type]
    assert found is not None
    assert found.cells.shape == (144, 204)
    assert known_map(SimpleNamespace(mission={"steps": steps[:1]}, files=files)) is None  # type: ignore[arg-type]
