"""Steps of a mission that behaviour plugins do: what is refused, and what conditions may ask of them."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest
import yaml
from mission_trees import Walker, built, problems
from pydantic import Field

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.planning import plan_from
from artemis.plugins import registry
from artemis.plugins.contracts import Acting, PluginContext, State
from artemis.states.plan import BehaviourStep
from artemis.states.tree import During
from artemis.values import Snapshot

MISSIONS = Path(__file__).parents[2] / "missions"
CALIBRATE = {"calibrate": {"steering": "from_potentiometers"}}
WAIT = {"wait": {"seconds": 1.0}}
APPROACH = {"approach": {"until": "driven_m > 1", "at_most_m": 2.0}}


class GasConfig(Config):
    threshold_ppm: Annotated[float, Field(gt=0)] = 50.0
    table_file: str | None = None


class Gas:
    """Observes."""

    Config: ClassVar[type[Config]] = GasConfig
    outcomes: ClassVar[tuple[str, ...]] = ("leak",)
    moves: ClassVar[bool] = False
    signals: ClassVar[Mapping[str, str]] = {"gas_ppm": "ppm"}

    def __init__(self, config: GasConfig, context: PluginContext) -> None:
        self.table = context.files.get(config.table_file or "")

    def start(self, snapshot: Snapshot, state: State | None = None) -> None: ...

    def step(self, snapshot: Snapshot) -> Acting:
        return Acting()


class Nose(Gas):
    """Tells the same signal."""


class Broken:
    """No behaviour."""


KINDS = {"watch-gas": Gas, "nose": Nose, "broken": Broken, "follow": Gas, "action": Gas, "copy": Gas, "odd_": Gas}


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    found, loads = registry._found, EntryPoint.load
    added = [EntryPoint(name, f"{__name__}:{kind.__name__}", "artemis.behaviours") for name, kind in KINDS.items()]

    def load(point: EntryPoint) -> object:
        return globals()[point.attr] if point.module == __name__ else loads(point)

    monkeypatch.setattr(registry, "_found", lambda group: found(group) + [p for p in added if p.group == group])
    monkeypatch.setattr(EntryPoint, "load", load)


def mission(folder: Path, *steps: Mapping[str, Any]) -> Path:
    shutil.copytree(MISSIONS / "robots", folder / "robots", dirs_exist_ok=True)
    path = folder / "mission.yaml"
    whole = {"mission": "m", "robot": "robots/artemis.yaml", "bus": "simulation", "steps": list(steps)}
    path.write_text(yaml.safe_dump(whole, sort_keys=False))
    return path


def refused(folder: Path, *steps: Mapping[str, Any]) -> list[str]:
    """What is wrong in a mission, without its name and the places."""
    with pytest.raises(ConfigError) as caught:
        load_mission(mission(folder, *steps))
    return [problem.split(": ", 1)[1] for problem in caught.value.problems]


# ---------------------------------------------------------------------------------------------- loading


def test_a_step_of_a_behaviour_is_made_with_its_keys_and_files(tmp_path: Path) -> None:
    (tmp_path / "gas.csv").write_text("1,2\n")
    loaded = load_mission(mission(tmp_path, CALIBRATE, {"watch-gas": {"table_file": "gas.csv"}}, APPROACH))
    assert loaded.files["gas.csv"] == b"1,2\n"
    _, watch, approach = plan_from(loaded).steps
    assert isinstance(watch, BehaviourStep)
    assert isinstance(approach, BehaviourStep)
    assert isinstance(watch.behaviour, Gas)
    assert (watch.name, watch.declared.outcomes, watch.declared.moves) == ("watch-gas", ("leak",), False)
    assert watch.behaviour.table == b"1,2\n"
    assert (approach.name, approach.speed, approach.declared.resumable) == ("approach", 0.2, True)


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        ({"aproach": {}}, "steps[1].aproach: unknown key; did you mean approach?"),
        ({"wach-gas": {}}, "steps[1].wach-gas: unknown key; did you mean watch-gas?"),
        ({"dance": {}}, "steps[1].dance: unknown key, and no installed behaviour; known keys: action, approach"),
        ({"watch-gas": None}, "steps[1]: watch-gas is empty; write its keys, or {} where it has none"),
        ({"watch-gas": 5}, "steps[1].watch-gas: expected a mapping, found 5"),
        ({"watch-gas": {}, **WAIT}, "steps[1]: a step has exactly one key of "),
        ({"watch-gas": {"threshold": 3}}, "steps[1].watch-gas.threshold: unknown key; did you mean threshold_ppm?"),
        ({"watch-gas": {"threshold_ppm": 0}}, "steps[1].watch-gas.threshold_ppm: expected more than 0, found 0"),
        ({"watch-gas": {"until": "run_s > 1"}}, "steps[1].watch-gas.until: unknown key"),
        ({"watch-gas": {"table_file": "no.csv"}}, "steps[1].watch-gas.table_file: file not found: no.csv"),
        ({"broken": {}}, "steps[1].broken: artemis.behaviours: plugin 'broken' of "),
        ({"approach": {"at_most_m": 1.0}}, "steps[1].approach.until: this key is missing"),
        (
            {"approach": {"until": "x > 1", "at_most_m": 1}},
            "steps[1].approach.until: condition 'x > 1': unknown signal 'x'",
        ),
        ({"approach": {"until": 3, "at_most_m": 1}}, "steps[1].approach.until: expected text, found 3"),
        (
            {"approach": {"until": "run_s > 1", "at_most_m": 1, "speed_m_s": 9}},
            "steps[1].approach.speed_m_s: 9 m/s is above the robot's limits.speed_m_s of 0.7",
        ),
    ],
)
def test_what_is_wrong_in_such_a_step_is_said(tmp_path: Path, step: Mapping[str, Any], problem: str) -> None:
    found = refused(tmp_path, CALIBRATE, step)
    assert any(one.startswith(problem) or problem in one for one in found), found


def test_the_place_of_a_wrong_key_is_said(tmp_path: Path) -> None:
    path = mission(tmp_path, CALIBRATE, {"approach": {"until": "run_s > 1", "at_most_m": 1, "far": 2}})
    with pytest.raises(ConfigError) as caught:
        load_mission(path)
    line = path.read_text().splitlines().index("    far: 2") + 1
    what = "unknown key; known keys: at_most_m, speed_m_s, until"
    assert caught.value.problems == [f"{path}:{line}:5: steps[1].approach.far: {what}"]


def test_one_that_moves_needs_aligned_wheels_and_one_that_does_not_does_not(tmp_path: Path) -> None:
    assert refused(tmp_path, APPROACH) == ["steps[0].approach: calibrate first: no step before this one does"]
    load_mission(mission(tmp_path, {"watch-gas": {}}))


def test_a_behaviour_with_the_name_of_a_step_is_broken() -> None:
    listed = {found.name: found.error or "" for found in registry.listing(registry.BEHAVIOURS, check=True)}
    assert "has the name of a step of artemis' own" in listed["follow"]
    assert "has no method start()" in listed["broken"]
    assert listed["approach"] == listed["watch-gas"] == ""


@pytest.mark.parametrize("name", ["action", "copy", "odd_"])
def test_no_name_of_a_behaviour_is_taken_for_something_else(name: str, tmp_path: Path) -> None:
    loaded = load_mission(mission(tmp_path, {name: {"threshold_ppm": 3.0}}))
    ((path, step),) = loaded.tree.steps
    assert (path[-1], step.word, step.behaviour, step.action) == (name, name, name, {"threshold_ppm": 3.0})
    assert refused(tmp_path, {name: None}) == [f"steps[0]: {name} is empty; write its keys, or {{}} where it has none"]


# ---------------------------------------------------------------------------------------------- in the tree


def test_its_outcomes_can_be_caught_and_no_others() -> None:
    steps = {"try": {"steps": [{"watch-gas": {}}], "catch": {"leak": [WAIT]}}}
    assert problems(steps) == []
    steps["try"]["catch"] = {"leek": [WAIT]}
    assert problems(steps) == ["steps[0].try.catch.leek: no step within ends with leek; did you mean leak?"]


def test_one_that_moves_can_get_lost() -> None:
    def catching(step: Mapping[str, Any]) -> dict[str, Any]:
        return {"try": {"steps": [step], "catch": {"lost": [WAIT]}}}

    assert problems(catching(APPROACH)) == []
    assert "no step within ends with lost" in problems(catching({"watch-gas": {}}))[0]


def test_its_signals_can_be_asked_for_in_the_whole_mission() -> None:
    asking = {"wait": {"for": "gas_ppm > 3"}}
    assert problems({"watch-gas": {}}, asking) == []
    assert "unknown signal 'gas_ppm'" in problems(asking)[0]
    assert problems({"watch-gas": {}}, {"nose": {}}) == [
        "steps: nose and watch-gas both publish the signal gas_ppm: use one of them"
    ]


def test_only_one_that_does_not_move_runs_beside_others() -> None:
    assert problems({"together": {"steps": [WAIT], "beside": [{"watch-gas": {}}]}}) == []
    assert problems({"together": {"steps": [WAIT], "beside": [APPROACH]}}) == [
        "steps[0].together.beside[0].approach: moves the robot: steps beside others must not"
    ]


def test_until_is_a_condition_that_brings_the_robot_to_rest() -> None:
    assert isinstance(built(APPROACH).tree.root.of[0], During)
    walk = Walker(APPROACH, WAIT)
    assert walk.tick(driven_m=0.5, standing=False) == "steps.0.approach"
    assert not walk.rests
    assert walk.tick(driven_m=1.1, standing=False) == "steps.0.approach"
    assert walk.rests
    assert walk.tick(driven_m=0.9, standing=False) == "steps.0.approach"
    assert walk.rests  # it ends, whatever becomes of the condition
    assert walk.tick(driven_m=0.9) == "steps.1.wait"
    assert walk.told() == ["fired driven_m > 1", "ended done"]


def test_its_own_outcome_ends_it_too() -> None:
    walk = Walker({"try": {"steps": [APPROACH], "catch": {"too-far": [WAIT]}}})
    assert walk.tick("too-far", standing=False) == "steps.0.try.catch.too-far.0.wait"


def test_a_repeat_of_one_that_is_done_at_once_takes_time() -> None:
    repeat = {"repeat": {"times": 3, "steps": [APPROACH]}}
    assert problems(repeat) == []
    walk = Walker(repeat)
    assert [walk.tick(driven_m=5.0) for _ in range(3)][-1] == "over"
