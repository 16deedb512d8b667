"""Goals and initial poses that an operator gives during a run: taken, replaced, refused, recorded, replayed."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
import resuming
from msgspec.structs import replace
from rig import Rig, Run, Seen
from test_goto_missions import mission as fixed_mission

from artemis.app import Parts
from artemis.config import Config
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.values import Mode, OperatorInput, Pose, Request, Tick

pytest.importorskip("websockets", reason="needs the extra web: pip install 'artemis-robot[web]'")
pytestmark = pytest.mark.short_alignment

INPUT = {"plugin": "rosbridge", "allow": ["goal_pose", "done"]}
ASKED = {"from_input": "stick"}
TRACKER = {"plugin": "simulated_tracker", "noise_m": 0.003}
GATE, BACK, NOWHERE = Pose(x=2.5, y=0.8), Pose(x=3.4, y=0.8), Pose(x=9.0, y=9.0)


class Operator:
    """Gives what the test says, once."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self) -> None:
        self.next = OperatorInput(source="stick", age=0.0)

    def read(self, now: float) -> OperatorInput:
        given, self.next = self.next, OperatorInput(source="stick", age=0.0)
        return given

    def close(self) -> None:
        """Nothing is open."""

    def give(self, goal: Pose | None = None, **changes: Any) -> None:  # noqa: ANN401 (of the sample)
        self.next = replace(self.next, goal=goal, **changes)


def mission(folder: Path, to: object = ASKED, *, given: object = INPUT, **keys: Any) -> Path:  # noqa: ANN401
    path = fixed_mission(folder, to, **keys)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"inputs": {"stick": given}}, indent=1))
    return path


def waits(seen: Seen) -> bool:
    return seen.phase.endswith("waiting for a goal of stick")


def play(folder: Path, *acts: tuple[Callable[[Seen], bool], Callable[[Operator], None]]) -> Run:
    operator = Operator()
    rig = Rig(mission(folder), input=operator)
    for number, (when, act) in enumerate(acts):
        rig.when(when, lambda act=act: act(operator), name=str(number))  # type: ignore[misc]
    return rig.run()


def events(run: Run) -> list[tuple[str, str]]:
    """What the journal says of poses."""
    assert run.outcome is not None
    lines = [json.loads(line) for line in run.outcome.run.journal.read_text().splitlines()]
    return [
        (line["kind"], line["text"]) for line in lines if line["kind"] in ("goal", "pose") or "goal" in line["text"][:5]
    ]


def off(run: Run, goal: Pose) -> float:
    """How far from a goal the robot truly is in the end [m]."""
    pose = run.seen[-1].pose
    return math.hypot(pose.x - goal.x, pose.y - goal.y)


def test_the_robot_stands_until_a_goal_comes_drives_there_and_replays(tmp_path: Path) -> None:
    early = [lambda seen: seen.phase == "listening", lambda operator: operator.give(NOWHERE)]
    given = [waits, lambda operator: operator.give(GATE, requests=(Request.DONE,))]
    run = play(tmp_path, tuple(early), tuple(given))  # type: ignore[arg-type]

    assert run.status == 0
    assert off(run, GATE) < 0.03
    assert all(seen.tick.set_points.speed == 0.0 for seen in run.seen if seen.time < run.acts["1"])
    assert [text for _, text in events(run)] == [
        "goal x 9.00 m, y 9.00 m, 0 degrees (by stick): ignored, no step asks for it now",
        "goal: x 2.50 m, y 0.80 m, 0 degrees (by stick)",
    ]
    assert run.recompute().difference is None


def test_another_goal_on_the_way_replaces_the_first_once_the_robot_stands(tmp_path: Path) -> None:
    def on_the_way(seen: Seen) -> bool:
        return seen.mode is Mode.FOLLOW and seen.tick.set_points.speed > 0.3

    run = play(
        tmp_path,
        (waits, lambda operator: operator.give(GATE)),
        (on_the_way, lambda operator: operator.give(GATE)),
        (on_the_way, lambda operator: operator.give(BACK)),
    )
    assert run.status == 0
    assert off(run, BACK) < 0.03
    planning = [seen for seen in run.seen if seen.phase == "planning a route to x 3.40 m, y 0.80 m, 0 degrees"]
    assert planning
    assert all(seen.standing for seen in planning)
    assert [text for _, text in events(run)] == [
        "goal: x 2.50 m, y 0.80 m, 0 degrees (by stick)",
        "goal: x 3.40 m, y 0.80 m, 0 degrees (by stick)",
    ]
    assert run.recompute().difference is None


def test_a_goal_to_which_no_route_leads_is_refused_with_the_reason_and_another_one_waited_for(tmp_path: Path) -> None:
    run = play(
        tmp_path,
        (waits, lambda operator: operator.give(NOWHERE)),
        (lambda seen: seen.phase.startswith("no route"), lambda operator: operator.give(GATE)),
    )
    assert run.status == 0
    refused = run.first(lambda seen: seen.phase.startswith("no route"))
    assert refused.phase == (
        "no route to x 9.00 m, y 9.00 m, 0 degrees: the goal lies outside of the map; waiting for a goal of stick"
    )
    assert off(run, GATE) < 0.03


def test_a_goal_that_was_interrupted_by_a_stop_is_driven_to_after_an_arm(tmp_path: Path) -> None:
    operator, path = Operator(), mission(tmp_path)
    words = json.loads(path.read_text())
    words["simulation"]["operator"] = [{"at_s": 15.0, "do": "arm"}]
    path.write_text(json.dumps(words))
    rig = Rig(path, input=operator)
    rig.when(waits, lambda: operator.give(GATE), name="goal")
    rig.while_following(rig.request(Request.QUICKSTOP), name="stop")
    run = rig.run()
    assert Mode.QUICKSTOP in run.modes
    assert run.status == 0
    assert off(run, GATE) < 0.03
    assert len(events(run)) == 1


def test_a_run_that_resumes_another_drives_to_the_goal_that_was_given_there(tmp_path: Path) -> None:
    operator, path = Operator(), mission(tmp_path)
    words = json.loads(path.read_text())
    words["simulation"]["pace"] = "fast"
    path.write_text(json.dumps(words))

    def on_the_way(tick: Tick) -> bool:
        if tick.wish.phase.endswith("waiting for a goal of stick"):
            operator.give(GATE)
        return bool(tick.wish.tracking and tick.wish.tracking.arc_length > 0.6)

    first = resuming.run(path, until=on_the_way, parts=Parts(inputs={"stick": operator}))
    assert first.ticks[-1].position.state == "[0,2.5,0.8,0.0]"
    second = resuming.run(path, first.folder, parts=Parts(inputs={"stick": Operator()}))
    assert second.outcome.exit_status == 0
    assert not any("waiting for a goal" in tick.wish.phase for tick in second.ticks)
    assert [event.text for tick in (*first.ticks, *second.ticks) for event in tick.events if event.kind == "goal"] == [
        "x 2.50 m, y 0.80 m, 0 degrees (by stick)"
    ]
    end = second.ticks[-1].snapshot.pose.pose
    assert math.hypot(end.x - GATE.x, end.y - GATE.y) < 0.03


@pytest.mark.parametrize(
    ("to", "given", "refused"),
    [
        ({"from_input": "stik"}, INPUT, "no such input: stik; did you mean stick?"),
        (ASKED, {"plugin": "rosbridge"}, "stick gives no goals: add `allow: [goal_pose]` to it"),
        (ASKED, {"plugin": "keyboard"}, "stick gives no goals: its plugin has none"),
        ({"from_inputs": "stick"}, INPUT, "from_inputs"),
        ("gate", {"plugin": "rosbridge", "allow": ["initialpose"]}, "initialpose: the mission's localizer takes none"),
    ],
)
def test_what_nobody_can_give_is_refused(tmp_path: Path, to: object, given: object, refused: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load_mission(mission(tmp_path, to, given=given))
    assert refused in str(raised.value)
