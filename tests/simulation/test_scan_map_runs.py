"""Whole runs of a robot that finds itself on the map of a simulated hall by its laser scanner."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig import CALIBRATE, MISSIONS, Rig, Run, Seen, run
from test_asked_goals import Operator, events

from artemis.motion.path import path_from_csv
from artemis.values import LocatedPose, Mode, Pose, PoseFix
from artemis.yaml_file import load

pytestmark = [pytest.mark.slow, pytest.mark.short_alignment]

PATROL = MISSIONS / "patrol_hall.yaml"
LAP = MISSIONS / "paths" / "hall_lap.csv"
HINT = {"x_m": 0, "y_m": 0, "heading_deg": 0}
WALK = [[0, 6, -1.2], [8, 2, 1.2], [16, 6, -1.2]]
"""To and fro through the path: run time, x and y."""
FURNITURE = {
    "boxes": [{"x_m": 3.0, "y_m": -1.6, "length_m": 0.8, "width_m": 0.6, "heading_deg": 15}],
    "persons": [{"path": WALK, "repeat": True}],
}
"""Not on the map; what else stood there is gone."""


def hall(
    folder: Path,
    steps: list[dict[str, Any]],
    start: object = "global",
    *,
    true: dict[str, float] | None = None,
    furniture: dict[str, Any] | None = None,
    **keys: Any,  # noqa: ANN401 (of a mission)
) -> Path:
    """A mission in the hall of the patrol."""
    mission: Any = dict(load(PATROL).data)  # type: ignore[arg-type]  # it is a mission
    for name in ("maps", "paths", "robots"):
        shutil.copytree(MISSIONS / name, folder / name, dirs_exist_ok=True)
    simulation = {**mission["simulation"], **keys.pop("simulation", {})}
    if true is not None:
        simulation["true_robot"] = true
    if furniture is not None:
        simulation["world"] = {**simulation["world"], **furniture}
    mission |= {"steps": steps, "localizer": {**mission["localizer"], "start": start}, "simulation": simulation, **keys}
    path = folder / "mission.yaml"
    path.write_text(json.dumps(mission))
    return path


def followed(**options: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    return [CALIBRATE, {"follow": {"path": "paths/hall_lap.csv", "follower": {"speed_m_s": 0.5}, **options}}]


def standing(seconds: float) -> list[dict[str, Any]]:
    return [{"wait": {"seconds": seconds}}]


def off(seen: Seen) -> float:
    """Error of the pose on the map [m]."""
    pose = seen.tick.snapshot.pose.pose
    return math.dist((pose.x, pose.y), (seen.pose.x, seen.pose.y))


def fixes(done: Run) -> list[tuple[float, PoseFix]]:
    return [(seen.time, fix) for seen in done.seen for fix in seen.tick.snapshot.sensed.fixes]


def away_from_path(done: Run) -> np.ndarray[Any, np.dtype[np.float64]]:
    """True distance of the rear axle from the path [m], at each tick that follows it."""
    path = path_from_csv(LAP.read_text(), LAP.name, smoothing=0.0, spacing=0.005)
    found = []
    for seen in done.in_mode(Mode.FOLLOW):
        if (tracking := seen.tick.wish.tracking) is not None:
            at = path.project(seen.pose.x, seen.pose.y, near=tracking.arc_length % path.length, window=0.5)
            found.append(math.hypot(seen.pose.x - at.x, seen.pose.y - at.y))
    return np.array(found)


@pytest.mark.slow
def test_a_path_is_followed_by_the_scanner_and_again_the_same(tmp_path: Path) -> None:
    """Until the slice ends: somebody ends the run after some metres."""
    operator = [{"at_s": 21.0, "do": "end"}]
    done = run(hall(tmp_path, followed(), HINT, simulation={"operator": operator}), longest=40.0)
    assert done.fault_ids == []
    following = done.in_mode(Mode.FOLLOW)
    settled = away_from_path(done)[250:]  # it begins 0.1 m beside the path
    assert len(settled) > 400
    assert math.sqrt(float(np.mean(settled**2))) <= 0.02
    assert max(off(seen) for seen in following) < 0.04
    odometry = following[-1].tick.snapshot.odometry.pose
    assert math.dist((odometry.x, odometry.y), (following[-1].pose.x, following[-1].pose.y)) > 0.1
    told = fixes(done)
    assert all(fix.covariance and fix.doubt == 0.0 and fix.quality > 0.8 for _, fix in told)
    assert all(0.0 < now - fix.time < 0.15 for now, fix in told)
    replayed = done.recompute()
    assert (replayed.ticks, replayed.difference) == (len(done.seen), None)


@pytest.mark.exhaustive
def test_a_patrol_stands_for_no_obstacle_where_none_is() -> None:
    assert run(PATROL, longest=200.0).fault_ids == []


@pytest.mark.slow
def test_a_robot_that_began_elsewhere_is_found_where_an_operator_says_and_replays_without_the_hint(
    tmp_path: Path,
) -> None:
    pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
    wrong = {"x_m": 6, "y_m": 1, "heading_deg": 180}
    inputs = {"stick": {"plugin": "rosbridge", "allow": ["initialpose"]}}
    operator = Operator()
    rig = Rig(hall(tmp_path, standing(2.0), wrong, inputs=inputs), input=operator)
    initial = LocatedPose(pose=Pose(x=0.2, y=-0.1, heading=0.1), frame="map", source="stick")
    rig.at(2.5, lambda: operator.give(initial_pose=initial), name="told")
    done = rig.run()
    before = [fix for now, fix in fixes(done) if now <= 2.5]
    after = [fix for now, fix in fixes(done) if now > 2.8]
    assert {fix.doubt for fix in before} == {1.0}
    assert {fix.doubt for fix in after} == {0.0}
    assert off(done.seen[-1]) < 0.04
    assert ("pose", "initial pose x 0.20 m, y -0.10 m, 6 degrees (by stick)") in events(done)
    assert done.recompute().difference is None


@pytest.mark.slow
def test_the_same_run_gives_the_same_fixes(tmp_path: Path) -> None:
    one, other = (run(hall(tmp_path / name, standing(1.0), HINT)) for name in ("one", "other"))
    assert fixes(one) == fixes(other)
    assert len(fixes(one)) > 20


@pytest.mark.exhaustive
def test_people_and_moved_furniture_do_not_mislead_it(tmp_path: Path) -> None:
    operator = [{"at_s": 20.0, "do": "end"}]
    mission = hall(tmp_path, followed(), HINT, furniture=FURNITURE, obstacles="off", simulation={"operator": operator})
    done = run(mission, longest=40.0)
    assert done.fault_ids == []
    assert max(off(seen) for seen in done.in_mode(Mode.FOLLOW)) < 0.06


def person_at(time: float) -> tuple[float, float]:
    """Where the person is that walks to and fro [m], at a run time."""
    (_, x0, y0), (half, x1, y1), (whole, _, _) = WALK
    share = 1.0 - abs(time % whole - half) / half
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


def room_before(seen: Seen) -> float:
    """From the true outline of the robot to the middle of the person [m]."""
    x, y = person_at(seen.time)
    dx, dy, heading = x - seen.pose.x, y - seen.pose.y, seen.pose.heading
    ahead, left = math.cos(heading) * dx + math.sin(heading) * dy, math.cos(heading) * dy - math.sin(heading) * dx
    return math.hypot(max(-0.12 - ahead, ahead - 0.68, 0.0), max(abs(left) - 0.27, 0.0))


@pytest.mark.exhaustive
def test_it_waits_for_people_where_it_finds_itself_by_a_map(tmp_path: Path) -> None:
    operator = [{"at_s": 45.0, "do": "end"}]
    mission = hall(tmp_path, followed(), HINT, furniture=FURNITURE, simulation={"operator": operator})
    done = run(mission, longest=60.0)
    assert set(done.fault_ids) == {"LAS-08"}
    following = done.in_mode(Mode.FOLLOW)
    assert max(off(seen) for seen in following) < 0.06
    waited = [seen for seen in following if (free := seen.tick.set_points.clearance) and free.blocked]
    assert waited, "the person walks through its path"
    assert following[-1].pose.x > 6.5, "it drives on"
    touched = [seen for seen in following if room_before(seen) < 0.2 and abs(seen.tick.snapshot.odometry.speed) > 0.1]
    assert touched == [], "nobody is driven into; who walks into a robot that stands is another matter"


@pytest.mark.slow
def test_a_robot_that_is_switched_on_anywhere_is_found_while_it_stands(tmp_path: Path) -> None:
    done = run(hall(tmp_path, standing(6.0), "global", true={"x_m": 9.0, "y_m": 5.2, "heading_deg": 150}))
    told = fixes(done)
    assert done.fault_ids == []
    assert told[0][1].doubt >= 1.0
    assert not told[0][1].covariance
    assert done.seen[30].tick.snapshot.pose.lost
    last = done.seen[-1]
    assert not last.tick.snapshot.pose.lost
    assert off(last) < 0.04


@pytest.mark.slow
def test_a_wrong_start_is_noticed_and_the_robot_looked_for(tmp_path: Path) -> None:
    done = run(hall(tmp_path, standing(6.0), HINT, true={"x_m": 9.0, "y_m": 5.2, "heading_deg": 150}))
    assert fixes(done)[0][1].doubt >= 1.0
    assert off(done.seen[-1]) < 0.04


@pytest.mark.exhaustive
def test_a_run_begins_where_the_last_one_ended(tmp_path: Path) -> None:
    true = {"x_m": 4.0, "y_m": 5.3, "heading_deg": 170}
    first = run(hall(tmp_path, standing(6.0), "last", true=true))
    assert fixes(first)[0][1].doubt >= 1.0, "there is no last one: it is looked for"
    again = run(hall(tmp_path, standing(0.5), "last", true={**true, "x_m": 4.2}))
    assert fixes(again)[0][1].doubt == 0.0
    assert off(again.seen[-1]) < 0.04


@pytest.mark.slow
def test_a_kidnapped_robot_says_so_stops_and_is_found_again(tmp_path: Path) -> None:
    carried = {"at_s": 9.0, "inject": "PTH-06", "x_m": 1.0, "y_m": 4.5, "heading_deg": 160}
    keys: dict[str, Any] = {"recovery": {"LOC-03": {"resume": "continue"}}, "simulation": {"faults": [carried]}}
    done = run(hall(tmp_path, followed(), HINT, **keys), longest=40.0)
    assert done.fault_ids[0] == "LOC-03"
    lost = [seen for seen in done.seen if seen.time > 9.0 and seen.tick.snapshot.pose.lost]
    assert lost[0].time < 10.5
    assert lost[0].mode is Mode.QUICKSTOP
    found = next(seen for seen in done.seen if seen.time > lost[-1].time)
    assert found.time < 20.0
    assert off(found) < 0.05
    assert done.fault_ids[-1] in ("PTH-05", "PTH-06"), "it goes on by itself, but not from beside its path"


@pytest.mark.exhaustive
@pytest.mark.timeout(400)
def test_laps_are_driven_within_two_centimetres_where_the_odometry_is_metres_off(tmp_path: Path) -> None:
    done = run(hall(tmp_path, followed(laps=8), HINT), longest=900.0)
    assert done.fault_ids == []
    following = done.in_mode(Mode.FOLLOW)
    wheels = [seen.tick.snapshot.odometry.pose for seen in following]
    assert max(math.dist((by.x, by.y), (s.pose.x, s.pose.y)) for by, s in zip(wheels, following, strict=True)) > 5.0
    settled = away_from_path(done)[150:]
    assert math.sqrt(float(np.mean(settled**2))) <= 0.02
    assert not any(seen.tick.snapshot.pose.lost for seen in following)
