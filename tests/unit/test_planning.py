"""What a mission says of its steps is in the plan, and so is the speed that loading has checked."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from shutil import copy

import pytest
from core_builders import ROBOT

from artemis.config import Config
from artemis.errors import ConfigError, PluginError
from artemis.mission.loading import load_mission
from artemis.planning import files_named, localizer_of, made, plan_from
from artemis.plugins import registry
from artemis.plugins.contracts import PluginContext
from artemis.states.plan import CalibrateStep, FollowStep, Plan, TeleopStep
from artemis.states.steering import SteeringStep

MISSIONS = Path(__file__).parents[2] / "missions"
STICK = {"plugin": "scripted", "file": "stick.csv"}


@pytest.mark.parametrize("speed", [0.25, None])
def test_steps_know_the_speed_that_was_checked(tmp_path: Path, speed: float | None) -> None:
    copy(MISSIONS / "robots" / "artemis.yaml", tmp_path / "robot.yaml")
    copy(MISSIONS / "inputs" / "loop.csv", tmp_path / "stick.csv")
    copy(MISSIONS / "paths" / "slalom.csv", tmp_path / "path.csv")
    mission = {
        "mission": "two-speeds",
        "robot": "robot.yaml",
        "bus": "simulation",
        "inputs": {"stick": STICK if speed is None else {**STICK, "max_speed_m_s": speed}},
        "steps": [
            {"calibrate": {"steering": "from_potentiometers"}},
            {"follow": {"path": "path.csv", "follower": {"plugin": "indiveri", "speed_m_s": 0.15}}},
            {"teleop": {"input": "stick", "until": {"button": "done"}}},
        ],
        "simulation": {"inputs": {"stick": {**STICK, "max_speed_m_s": 0.6}}},
    }
    (tmp_path / "mission.yaml").write_text(json.dumps(mission))
    _, follow, teleop = plan_from(load_mission(tmp_path / "mission.yaml")).steps
    assert isinstance(follow, FollowStep)
    assert follow.speed == 0.15
    assert isinstance(teleop, TeleopStep)
    assert teleop.speed == speed, "the mission's input's, not its stand-in's"


def test_files_of_a_localizer_are_its_map_with_the_image() -> None:
    loaded = load_mission(MISSIONS / "patrol_hall.yaml")
    use = localizer_of(loaded, simulated=True)
    assert use is not None
    assert set(files_named(use, loaded.files)) == {"maps/hall.yaml", "maps/hall.pgm"} < set(loaded.files)


def calibrating(folder: Path, *words: object) -> Plan:
    """The plan of a mission with these steps `calibrate: {steering: ...}`."""
    copy(MISSIONS / "robots" / "artemis.yaml", folder / "robot.yaml")
    steps = [{"calibrate": {"steering": one}} for one in words]
    mission = {"mission": "measure", "robot": "robot.yaml", "bus": "simulation", "steps": steps}
    (folder / "mission.yaml").write_text(json.dumps(mission))
    return plan_from(load_mission(folder / "mission.yaml"))


def test_steering_is_measured_as_the_mission_says(tmp_path: Path) -> None:
    words = {"wheels": "left", "reference_deg": {"left": 9.0}, "save": "ask"}
    plan = calibrating(tmp_path, words)
    assert plan.steps == (SteeringStep(sides=("left",), reference={"left": math.radians(9.0)}, save="ask"),)
    assert not plan.blind
    assert calibrating(tmp_path, "from_potentiometers", {}).steps == (CalibrateStep(), SteeringStep())


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ([{"save": "drives"}, "from_potentiometers"], "no other step may stand beside"),
        (["from_potentiometers", {"save": "ask"}], "no other step may stand beside"),
        ([{"save": "drives", "reference_deg": {"right": -5.1}}], "reference_deg.right is -5.1: a zero that is wrong"),
    ],
)
def test_steering_is_not_saved_unseen_or_beside_other_steps(tmp_path: Path, words: list[object], problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        calibrating(tmp_path, *words)


def test_new_potentiometers_make_a_run_blind_and_tell_how_the_wheels_are_found(tmp_path: Path) -> None:
    plan = calibrating(tmp_path, {"potentiometers": "new", "reference_deg": {"right": -4.0}})
    assert plan.blind
    assert plan.found == {"right": math.radians(-4.0)}


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (({"potentiometers": "new"}, "from_potentiometers"), "steps: new potentiometers are calibrated in a mission"),
        (({"potentiometers": "new", "wheels": "left"},), "with new potentiometers both wheels are measured"),
        (({"reference_deg": {"left": 46}},), "reference_deg.left: expected at most 45, found 46"),
        (({"safe": "drives"},), "did you mean save?"),
        ((None,), "steering"),
    ],
)
def test_a_step_that_cannot_be_done_is_refused(tmp_path: Path, words: tuple[object, ...], problem: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(problem)):
        calibrating(tmp_path, *words)


class Leisurely:
    """A follower that may be told a speed."""

    class Config(Config):
        speed_m_s: float | None = None

    def __init__(self, config: object, context: PluginContext) -> None: ...


@pytest.mark.parametrize(("says", "refused"), [({}, True), ({"speed_m_s": None}, True), ({"speed_m_s": 0.1}, False)])
def test_follower_without_a_speed_is_checked_for_the_robot_s_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: dict[str, object], refused: bool
) -> None:
    monkeypatch.setattr(registry, "load", lambda group, name: Leisurely)
    copy(MISSIONS / "robots" / "artemis.yaml", tmp_path / "robot.yaml")
    copy(MISSIONS / "paths" / "straight.csv", tmp_path / "path.csv")
    mission = {
        "mission": "leisurely",
        "robot": "robot.yaml",
        "bus": "simulation",
        "steps": [
            {"calibrate": {"steering": "from_potentiometers"}},
            {"follow": {"path": "path.csv", "follower": {"plugin": "leisurely", **says}}},
        ],
        "supervision": {"stop_distance_m": 0.1},
    }
    (tmp_path / "mission.yaml").write_text(json.dumps(mission))
    if refused:
        with pytest.raises(ConfigError, match=r"0\.7 m/s cannot be stopped in time"):
            load_mission(tmp_path / "mission.yaml")
    else:
        load_mission(tmp_path / "mission.yaml")


@pytest.mark.parametrize("error", [ValueError("no table"), SystemExit(0)], ids=repr)
def test_plugin_that_cannot_be_made_refuses_the_run_with_its_name_and_reason(error: BaseException) -> None:
    class Unwilling(Leisurely):
        def __init__(self, config: object, context: PluginContext) -> None:
            raise error

    context = PluginContext(name="unwilling", robot=ROBOT, folder=Path())
    with pytest.raises(PluginError, match=r"PLG-01 unwilling: .*cannot be made: (ValueError|SystemExit)\(") as refused:
        made(Unwilling, Config(), context)
    assert refused.value.__cause__ is error


def test_plugin_that_refuses_its_configuration_says_so_itself() -> None:
    class Careful(Leisurely):
        def __init__(self, config: object, context: PluginContext) -> None:
            raise ConfigError("careful: too fast")

    with pytest.raises(ConfigError, match=r"^careful: too fast$"):
        made(Careful, Config(), PluginContext(name="careful", robot=ROBOT, folder=Path()))
