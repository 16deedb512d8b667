from __future__ import annotations

import copy
import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extras import load_or_skip
from pydantic import ValidationError

from artemis.config import Config
from artemis.errors import ConfigError, PluginError
from artemis.mission import (
    Calibrate,
    Follow,
    LoadedMission,
    Mission,
    PluginUse,
    Step,
    Stop,
    Teleop,
    Wait,
    load_mission,
    mission_schema,
    plugin_from,
    robot_schema,
)
from artemis.mission.problems import describe, nearest
from artemis.mission.schema import BusWords
from artemis.motion.rounding import CURVATURE_SHARE
from artemis.plugins.followers.indiveri import IndiveriFollower
from artemis.progress import WORDS
from artemis.vehicle import RobotFile
from artemis.yaml_file import Data, KeyPath, dotted, load

ROOT = Path(__file__).parents[2]
MISSIONS = sorted((ROOT / "missions").glob("*.yaml"))
GOOD = ROOT / "tests/broken/good"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(GOOD, tmp_path / "missions"))


def loaded_with(folder: Path, old: str, new: str, file: str = "mission.yaml") -> LoadedMission:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    return load_mission(folder / "mission.yaml")


def refusal(folder: Path, old: str, new: str, file: str = "mission.yaml") -> list[str]:
    with pytest.raises(ConfigError) as caught:
        loaded_with(folder, old, new, file)
    return [problem.removeprefix(f"{folder}/") for problem in caught.value.problems]


# ---------------------------------------------------------------------------------------------- what a mission becomes


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.stem)
def test_every_mission_of_the_repository_is_accepted(path: Path) -> None:
    loaded = load_or_skip(path)
    assert loaded.mission.mission == path.stem.replace("_", "-")
    assert loaded.robot.drives


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.stem)
def test_every_mission_begins_with_what_it_shows(path: Path) -> None:
    assert path.read_text().startswith("# ")


def test_the_missions_that_are_promised_exist() -> None:
    names = {"figure_eight", "hidden_errors", "figure_eight_udp", "figure_eight_socketcan", "teleop_scripted"}
    assert names <= {path.stem for path in MISSIONS}


def test_a_step_is_what_its_only_key_holds() -> None:
    steps = load_mission(GOOD / "mission.yaml").mission.steps
    assert [type(step.action) for step in steps] == [Calibrate, Follow, Wait, Teleop, Stop]
    follow = steps[1].action
    assert isinstance(follow, Follow)
    assert (follow.path, follow.laps, follow.max_cross_track_m) == ("paths/line.csv", 1, 0.6)
    assert (follow.follower.plugin, follow.follower.options) == ("indiveri", {"speed_m_s": 0.4})


def test_files_are_kept_by_the_names_that_the_mission_writes() -> None:
    loaded = load_mission(GOOD / "mission.yaml")
    assert set(loaded.files) == {"robots/artemis.yaml", "paths/line.csv", "inputs/loop.csv"}
    assert all(content == (GOOD / name).read_bytes() for name, content in loaded.files.items())


def test_documents_tell_where_each_key_of_mission_and_robot_stands() -> None:
    loaded = load_mission(GOOD / "mission.yaml")
    assert set(loaded.documents) == {str(GOOD / "mission.yaml"), loaded.robot_source}
    assert loaded.documents[str(GOOD / "mission.yaml")].position(("steps", 1, "follow", "laps")) == (10, 82)
    assert loaded.documents[loaded.robot_source].data == load(GOOD / "robots/artemis.yaml").data
    assert loaded.folder == GOOD


def test_what_is_not_written_has_its_default(folder: Path) -> None:
    (folder / "mission.yaml").write_text(
        "mission: short\nrobot: robots/artemis.yaml\nbus: simulation\nsteps: [{wait: {seconds: 1}}]\n"
    )
    loaded = load_mission(folder / "mission.yaml")
    mission = loaded.mission
    assert (mission.tick_hz, mission.record, mission.supervision.stop_distance_m) == (50, "runs/", 0.6)
    assert (mission.simulation.seed, mission.simulation.pace, mission.simulation.operator) == (0, None, ())
    assert (mission.inputs, mission.simulation.inputs, loaded.true_robot.steering_zero_left_deg) == ({}, {}, 0.0)


def test_the_true_robot_is_ready_to_use() -> None:
    assert load_mission(GOOD / "mission.yaml").true_robot.steering_zero_left_deg == 0.8


def test_the_words_of_a_real_bus_are_kept_as_they_are(folder: Path) -> None:
    words = {"interface": "udp_multicast", "channel": "239.74.163.2", "hop_limit": 0}
    bus = loaded_with(folder, "bus: simulation", f"bus: {json.dumps(words)}").mission.bus
    assert isinstance(bus, BusWords)
    assert bus.words == words


def test_a_relative_mission_path_names_its_files_relatively(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert load_mission(Path("mission.yaml")).robot_source == "robots/artemis.yaml"
    monkeypatch.chdir(folder.parent)
    assert load_mission(Path("missions/mission.yaml")).robot_source == "missions/robots/artemis.yaml"


def test_a_plugin_comes_with_its_options_as_its_own_config() -> None:
    plugin, config = plugin_from(
        "artemis.followers", PluginUse.model_validate({"plugin": "indiveri", "speed_m_s": 0.3})
    )
    assert plugin is IndiveriFollower
    assert isinstance(config, IndiveriFollower.Config)
    with pytest.raises(PluginError, match="nobody"):
        plugin_from("artemis.followers", PluginUse(plugin="nobody"))
    with pytest.raises(ConfigError, match="indiveri: speed_m_s: this key is missing"):
        plugin_from("artemis.followers", PluginUse(plugin="indiveri"))


def test_a_loaded_mission_goes_through_json_and_back() -> None:
    mission = load_mission(GOOD / "mission.yaml").mission
    assert Mission.model_validate_json(mission.model_dump_json(exclude_unset=True)) == mission


# ---------------------------------------------------------------------------------------------- what does not fit


@pytest.mark.parametrize(("speed", "accepted"), [("0.7", True), ("0.7000000000000001", False)])
def test_a_follower_is_no_faster_than_the_robot(folder: Path, speed: str, accepted: bool) -> None:
    edit = ("speed_m_s: 0.4", f"speed_m_s: {speed}")
    # The path says 0.4 m/s as well, so that only the limit of the robot's speed can be hurt.
    if accepted:
        loaded_with(folder, *edit)
    else:
        (problem,) = refusal(folder, *edit)
        assert problem.endswith("speed_m_s: 0.7 m/s is above the robot's limits.speed_m_s of 0.7")


def test_a_follower_is_no_faster_than_the_wheels(folder: Path) -> None:
    problems = refusal(folder, "wheel_speed_m_s: 0.72", "wheel_speed_m_s: 0.39", "robots/artemis.yaml")
    expected = "0.4 m/s is above the robot's limits.wheel_speed_m_s of 0.39"
    assert f"mission.yaml:10:65: steps[1].follow.follower.speed_m_s: {expected}" in problems


@pytest.mark.parametrize(("distance", "accepted"), [("0.248", True), ("0.247", False)])
def test_the_fastest_step_must_stop_within_the_stop_distance(folder: Path, distance: str, accepted: bool) -> None:
    # 0.7 m/s by hand: 0.12 s * 0.7 m/s + (0.7 m/s)**2 / (2 * 1.5 m/s**2) = 0.2473 m
    edit = ("stop_distance_m: 0.6", f"stop_distance_m: {distance}")
    if accepted:
        loaded_with(folder, *edit)
    else:
        (problem,) = refusal(folder, *edit)
        assert problem == (
            "mission.yaml:12:14: steps[3].teleop.input: 0.7 m/s cannot be stopped in time: 0.12 s to react and "
            "1.5 m/s² of braking need 0.248 m, supervision.stop_distance_m is 0.247"
        )


def test_without_a_supervision_part_its_default_holds(folder: Path) -> None:
    (folder / "robots/artemis.yaml").write_text(
        (folder / "robots/artemis.yaml")
        .read_text()
        .replace("quick_stop_deceleration_m_s2: 1.5", "quick_stop_deceleration_m_s2: 0.4")
        .replace(" deceleration_m_s2: 1.0", " deceleration_m_s2: 0.4")
    )
    problems = refusal(folder, "supervision:\n  stop_distance_m: 0.6\n", "")
    assert [problem.split(": ")[1] for problem in problems] == ["steps[3].teleop.input"]
    assert problems[0].endswith("need 0.697 m, supervision.stop_distance_m is 0.6")


def test_an_input_that_is_slower_than_the_robot_needs_less_way(folder: Path) -> None:
    mission = (folder / "mission.yaml").read_text().replace("stop_distance_m: 0.6", "stop_distance_m: 0.15")
    (folder / "mission.yaml").write_text(mission)
    loaded_with(folder, "file: inputs/loop.csv}", "file: inputs/loop.csv, max_speed_m_s: 0.3}")


def test_a_bend_that_is_too_sharp_is_refused_at_the_path(folder: Path) -> None:
    bend = "0.3, 0.0, 0.4\n0.4, 0.0, 0.4\n0.5, 0.0, 0.4\n"
    problems = refusal(folder, bend, "0.2, 0.1, 0.4\n0.2, 0.2, 0.4\n0.2, 0.3, 0.4\n", "paths/line.csv")
    head = "mission.yaml:10:14: steps[1].follow.path: paths/line.csv: "
    assert problems
    assert all(problem.startswith(head) for problem in problems)


def test_words_that_the_back_end_does_not_know_are_refused_where_they_stand(folder: Path) -> None:
    words = "bus: {interface: udp_multicast, channel: 239.74.163.2, hop_limits: 0}"
    (problem,) = refusal(folder, "bus: simulation", words)
    assert problem.startswith("mission.yaml:4:56: bus.hop_limits: ")


def test_calibration_may_come_any_time_before_the_path(folder: Path) -> None:
    first = "  - calibrate: {steering: from_potentiometers}\n"
    loaded = loaded_with(folder, first, first + "  - wait: {seconds: 1}\n")
    assert [next(iter(step.model_fields_set)) for step in loaded.mission.steps[:3]] == ["calibrate", "wait", "follow"]


def test_problems_come_in_the_order_of_their_lines(folder: Path) -> None:
    (folder / "mission.yaml").write_text((folder / "mission.yaml").read_text().replace("laps: 1", "laps: 0"))
    problems = refusal(folder, "record: runs/", "record: 0x10\nmision: x")
    assert [int(problem.split(":")[1]) for problem in problems] == [10, 22, 23]


def test_one_part_of_a_step_that_is_wrong_does_not_hide_another(folder: Path) -> None:
    problems = refusal(folder, "plugin: indiveri, speed_m_s: 0.4}, laps: 1", "plugin: indivery, speed_m_s: x}, laps: 2")
    assert [problem.split(": ")[1] for problem in problems] == [
        "steps[1].follow.follower.plugin",
        "steps[1].follow.laps",
    ]


def test_an_unknown_key_of_a_step_hides_nothing_of_its_other_keys(folder: Path) -> None:
    keys = "path: paths/lin.csv, follower: {plugin: indiveri, speed_m_s: 0.9}, lapz: 1"
    problems = refusal(folder, "path: paths/line.csv, follower: {plugin: indiveri, speed_m_s: 0.4}, laps: 1", keys)
    assert [problem.split(": ")[1].removeprefix("steps[1].follow.") for problem in problems] == [
        "path",
        "follower.speed_m_s",
        "lapz",
    ]


def test_a_key_that_is_wrong_hides_nothing_of_other_keys(folder: Path) -> None:
    steps = (folder / "mission.yaml").read_text().partition("steps:")[2].partition("supervision:")[0]
    problems = refusal(folder, f"steps:{steps}", "steps:\n  - say: x\nspeed: 3\n")
    assert [problem.split(": ")[1] for problem in problems] == ["steps", "speed"]
    problems = refusal(folder, "record: runs/", "record: paths/line.csv\nlocaliser: {plugin: simulated_tracker}")
    assert [problem.split(": ")[1] for problem in problems] == ["steps", "speed", "record", "localiser"]
    shutil.copy(ROOT / "missions/robots/artemis_epos4.yaml", folder / "robots")
    problems = refusal(folder, "artemis.yaml\nbus: simulation\ntick_hz: 50", "artemis_epos4.yaml\nbus: x\ntick_hz: 60")
    assert [problem.split(": ")[1] for problem in problems[:2]] == ["bus", "tick_hz"]


# ---------------------------------------------------------------------------------------------- every key, mutated


def keys(data: Data, path: KeyPath = ()) -> list[KeyPath]:
    match data:
        case dict():
            return [found for key in data for found in ((*path, key), *keys(data[key], (*path, key)))]
        case list():
            return [found for index, item in enumerate(data) for found in keys(item, (*path, index))]
    return []


def part_of(data: Data, path: KeyPath) -> Any:  # noqa: ANN401  whatever is there
    part: Any = data
    for key in path:
        part = part[key]
    return part


FILES: dict[str, type[Config]] = {"mission.yaml": Mission, "robots/artemis.yaml": RobotFile}
DATA = {file: load(GOOD / file).data for file in FILES}
KEYS = [(file, path) for file, data in DATA.items() for path in keys(data) if not str(path[1:2]).count("-right")]
WRONG: list[Data] = [[], {"x": 1}, None, "???", -1e9]


OPTIONS = {"stick", "follower", "true_robot"}
"""Mappings that the mission's schema hands on to the schema of a plugin or of the simulation."""


@pytest.mark.parametrize(
    ("file", "path"),
    [(file, path) for file, path in KEYS if path[-1] == "plugin" or not OPTIONS & {*path[-2:-1]}],
    ids=lambda part: part if isinstance(part, str) else dotted(part),
)
def test_no_key_takes_every_kind_of_value(file: str, path: KeyPath) -> None:
    refused = 0
    for wrong in WRONG:
        data = copy.deepcopy(DATA[file])
        part_of(data, path[:-1])[path[-1]] = wrong
        try:
            FILES[file].model_validate(data)
        except ValidationError:
            refused += 1
    assert refused >= 3


OWN_NAMES = {"drives", "inputs", "true_robot"}
"""Mappings whose keys the writer chooses (or another schema than the mission's knows)."""


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("file", "path"),
    [(file, path) for file, path in KEYS if path[-2:-1] == () or path[-2] not in OWN_NAMES],
    ids=lambda part: part if isinstance(part, str) else dotted(part),
)
def test_every_misspelt_key_is_named_with_the_right_one(folder: Path, file: str, path: KeyPath) -> None:
    data, key = copy.deepcopy(DATA[file]), str(path[-1])
    around = part_of(data, path[:-1])
    around[key + "z"] = around.pop(key)
    (folder / file).write_text(json.dumps(data))
    with pytest.raises(ConfigError) as caught:
        load_mission(folder / "mission.yaml")
    hints = (f"{key}z: unknown key; did you mean {key}?", f"{key}: this key is missing; did you write {key}z for it?")
    assert any(problem.endswith(hints) for problem in caught.value.problems)


@pytest.mark.parametrize(("follower", "reserve"), [("frenet", True), ("indiveri", False)])
def test_corners_are_rounded_before_the_run_where_the_follower_wants_that(
    folder: Path, follower: str, reserve: bool
) -> None:
    """In a tick it would take too long."""
    robot = load_mission(folder / "mission.yaml").robot
    most = math.tan(math.radians(robot.limits.steering_deg)) / robot.geometry.wheelbase_m
    radius = 1 / (0.95 * most)
    turn = [(radius * math.sin(0.05 * n), radius * (1 - math.cos(0.05 * n))) for n in range(63)]
    lead = [(0.05 * n - 2.0, 0.0) for n in range(40)]
    rows = "".join(f"{x:.5f},{y:.5f}\n" for x, y in [*lead, *turn, *((x, 2 * radius) for x, _ in lead[::-1])])
    (folder / "paths/turn.csv").write_text(f"x,y\n{rows}")
    follow = f"path: paths/turn.csv, allow_slowdown: true, follower: {{plugin: {follower}, speed_m_s: 0.2}}"
    steps = f"  - calibrate: {{steering: from_potentiometers}}\n  - follow: {{{follow}}}\n"
    (folder / "m.yaml").write_text(f"mission: m\nrobot: robots/artemis.yaml\nbus: simulation\nsteps:\n{steps}")
    (route,) = load_mission(folder / "m.yaml").routes.values()
    sharpest = float(np.abs(route.parts[0].path.curvature).max())
    assert (sharpest <= CURVATURE_SHARE * most + 1e-6) is reserve


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        ("right", None),
        ("2", None),
        ("rihgt", "no question of the mission has this answer; did you mean right?"),
        ("3", "no question of the mission has this answer; answers: left, right"),
    ],
)
def test_answers_of_the_scripted_operator_are_those_of_a_question(
    folder: Path, answer: str, problem: str | None
) -> None:
    file, operator = folder / "m.yaml", f"{{at_s: 1, do: answer, answer: '{answer}'}}"
    text = f"mission: m\nrobot: robots/artemis.yaml\nbus: simulation\nsimulation: {{operator: [{operator}]}}\nsteps:\n"
    file.write_text(f"{text}  - ask: {{question: where, answers: [left, right]}}\n  - wait: {{seconds: 1}}\n")
    found: list[str] = []
    try:
        load_mission(file)
    except ConfigError as error:
        found = error.problems
    at = f"{file}:4:47: simulation.operator[0].answer: "
    assert found == ([] if problem is None else [at + problem])
    file.write_text(f"{text}  - wait: {{seconds: 1}}\n")
    with pytest.raises(ConfigError, match=r"operator\[0\].answer: no step of the mission asks a question"):
        load_mission(file)


# ---------------------------------------------------------------------------------------------- words and schemas


def test_the_nearest_name_is_proposed_whatever_its_case() -> None:
    assert nearest("FOLOW", ["follow", "wait"]) == "; did you mean follow?"
    assert nearest("xyz", ["wait", "follow"], "steps") == "; steps: follow, wait"
    assert nearest("xyz", [], "inputs") == "; there are no inputs"
    assert nearest("?", [f"n{i:02}" for i in range(20)]).endswith("n10, n11, ...")


def test_a_text_that_is_too_long_is_told_in_plain_words(folder: Path) -> None:
    question = "ask: {question: " + "x" * 1001 + ", answers: [a]}"
    first = "  - calibrate: {steering: from_potentiometers}\n"
    (problem,) = refusal(folder, first, f"{first}  - {question}\n")
    assert "steps[1].ask.question: expected at most 1000 characters, found 'xxx" in problem


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "nothing"),
        (True, "true"),
        (0.5, "0.5"),
        ("a\n", r"'a\n'"),
        ("", "empty text"),
        ({}, "a mapping"),
        ([1, 2], "a list of 2"),
        ("x" * 100, "'" + "x" * 59 + "..."),
    ],
)
def test_values_are_described_in_plain_words(value: object, words: str) -> None:
    assert describe(value) == words


def test_a_step_made_in_code_needs_exactly_one_key_too() -> None:
    with pytest.raises(ValidationError, match="exactly one key"):
        Step()
    with pytest.raises(ValidationError, match="exactly one key"):
        Step(stop=Stop(), wait=Wait(seconds=1.0))


def test_the_schemas_know_every_key_and_explain_some() -> None:
    mission, robot = mission_schema(), robot_schema()
    properties: Any = mission["properties"]
    assert list(Mission.model_fields) == list(properties)
    definitions: Any = mission["$defs"]
    actions = {"calibrate", "follow", "goto", "wait", "teleop", "ask", "say", "end", "stop"}
    assert set(definitions["Step"]["properties"]) == {*actions, *WORDS, "approach"}
    approach = definitions["Step"]["properties"]["approach"]
    assert approach["description"].startswith("Drives straight ahead")
    assert approach["properties"]["at_most_m"]["description"].endswith("the outcome `too-far`.")
    assert definitions["Step"]["additionalProperties"] is False
    assert definitions["Follow"]["properties"]["max_cross_track_m"]["description"].startswith("Farther from the path")
    assert definitions["Follow"]["description"] == "Drive along a path to its end."
    geometry: Any = robot["$defs"]
    assert geometry["Geometry"]["properties"]["scrub_radius_m"]["description"].startswith("Distance of the contact")
    assert geometry["Drive"]["properties"]["motor"]["description"] == geometry["Motor"]["description"]
    assert geometry["SettingWords"]["properties"]["index"]["description"].startswith("Of the object in the drive's")
    assert json.loads(json.dumps(mission)) == mission
