"""Parts of a mission that stand in files of their own."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission

MISSIONS = Path(__file__).parents[2] / "missions"
CALLING = "mission: m\nrobot: r.yaml\nbus: simulation\nsteps:\n  - call: {part: p, with: {s: 1}}\n"
CALLING += "parts:\n  p: {file: part.yaml}\n"


def problems_of(folder: Path, part: str, mission: str = CALLING) -> list[str]:
    shutil.copy(MISSIONS / "robots/artemis.yaml", folder / "r.yaml")
    (folder / "m.yaml").write_text(mission)
    (folder / "part.yaml").write_text(part)
    with pytest.raises(ConfigError) as error:
        load_mission(folder / "m.yaml")
    return [problem.removeprefix(f"{folder}/") for problem in error.value.problems]


def test_part_may_stand_in_a_file_that_several_missions_call() -> None:
    one, other = (load_mission(MISSIONS / f"two_robots_{name}.yaml") for name in ("first", "second"))
    assert "parts/laps.yaml" in one.files
    assert [path for path, _ in one.tree.steps] == [path for path, _ in other.tree.steps]
    assert {file for file in one.files if "loop" in file} == {"paths/loop_left.csv"}
    assert {file for file in other.files if "loop" in file} == {"paths/loop_right.csv"}


@pytest.mark.parametrize(
    ("part", "problem"),
    [
        (
            "takes: {s: }\nsteps:\n  - wait: {second: $s}\n",
            "part.yaml:3:12: steps[0].wait.second: unknown key; did you mean seconds?",
        ),
        (
            "takes: {s: }\nsteps:\n  - wait: {seconds: $t}\n",
            "part.yaml:3:12: steps[0].wait.seconds: the part takes no t; arguments: s",
        ),
        ("takes: {s: }\nstep: []\n", "part.yaml:2:1: step: unknown key; did you mean steps?"),
        ("takes: {s: }\nsteps: [\n", "part.yaml:3:1: not YAML"),
        ("- wait: {seconds: 1}\n", "part.yaml:1:1: expected a mapping, found a list of 1"),
        ("file: part.yaml\n", "part.yaml:1:1: file: a part's file has its steps itself"),
    ],
)
def test_what_is_wrong_in_the_file_of_a_part_is_told_with_its_place(tmp_path: Path, part: str, problem: str) -> None:
    assert any(found.startswith(problem) for found in problems_of(tmp_path, part)), problems_of(tmp_path, part)


@pytest.mark.parametrize(
    ("file", "problem"),
    [
        ("prt.yaml", "m.yaml:7:7: parts.p.file: file not found: prt.yaml; did you mean part.yaml?"),
        ("../part.yaml", "m.yaml:7:7: parts.p.file: outside the mission's folder"),
        ("part.yaml, takes: {s: }", "m.yaml:7:3: parts.p: a part has either file, or steps (and takes)"),
    ],
)
def test_file_of_a_part_is_one_that_is_there_and_all_of_the_part(tmp_path: Path, file: str, problem: str) -> None:
    (found,) = problems_of(
        tmp_path, "takes: {s: }\nsteps: [{wait: {seconds: $s}}]\n", CALLING.replace("part.yaml", file)
    )
    assert found.startswith(problem)


@pytest.mark.parametrize(
    "word",
    [
        "repeat: {times: 2, steps: [STEP]}",
        "try: {steps: [STEP], catch: {any: [{say: x}]}}",
        "try: {retries: 1, steps: [{say: x}], between: [STEP]}",
        "during: {at_most_s: 1, steps: [STEP]}",
        "during: {steps: [{wait: {seconds: 1}}], when: [{if: run_s > 1, steps: [STEP]}]}",
        "choose: [{steps: [STEP]}]",
        "together: {steps: [{wait: {seconds: 1}}], beside: [STEP]}",
    ],
)
def test_misspelt_key_in_a_word_is_told_with_the_nearest_of_its_step(tmp_path: Path, word: str) -> None:
    mission = f"mission: m\nrobot: r.yaml\nbus: simulation\nsteps:\n  - {word}\n".replace("STEP", "{wait: {second: 1}}")
    assert any("second: unknown key; did you mean seconds?" in found for found in problems_of(tmp_path, "", mission))


@pytest.mark.parametrize(
    "steps",
    [
        "[{repeat: {times: 2, steps: [CALIBRATE, {teleop: {input: stick, until: {button: done}}}]}}]",
        "[{choose: [{if: run_s > 9, steps: [CALIBRATE]}, {steps: [{wait: {seconds: 1}}]}]}]",
        "[{during: {steps: [{wait: {seconds: 9}}], when: [{if: run_s > 9, steps: [CALIBRATE]}]}}]",
    ],
)
@pytest.mark.parametrize(
    ("keys", "problem"),
    [("potentiometers: new", "in a mission of their own"), ("save: ask", "no other step may stand beside")],
)
def test_words_hide_no_step_beside_a_calibration_that_has_to_be_alone(
    tmp_path: Path, steps: str, keys: str, problem: str
) -> None:
    calibrate = f"{{calibrate: {{steering: {{{keys}, reference_deg: {{left: 0, right: 0}}}}}}}}"
    mission = "mission: m\nrobot: r.yaml\nbus: simulation\ninputs: {stick: {plugin: keyboard}}\nsteps: "
    found = problems_of(tmp_path, "", mission + steps.replace("CALIBRATE", calibrate) + "\n")
    assert any(problem in one for one in found)


def chain(length: int, argument: str) -> str:
    """A mission whose parts call each other, each with an argument made of its own."""
    parts = [
        f"  p{n}: {{takes: {{x: }}, steps: [{{call: {{part: p{n + 1}, with: {{x: {argument}}}}}}}]}}\n"
        for n in range(length)
    ]
    last = f"  p{length}: {{takes: {{x: }}, steps: [{{wait: {{seconds: 1}}}}]}}\n"
    head = "mission: m\nrobot: r.yaml\nbus: simulation\nsteps: [{call: {part: p0, with: {x: ab}}}]\nparts:\n"
    return head + "".join(parts) + last


@pytest.mark.parametrize("argument", ['"${x}${x}"', "[$x, $x]", "{a: $x, b: $x}"])
def test_arguments_of_parts_do_not_grow_without_limit(tmp_path: Path, argument: str) -> None:
    (found,) = problems_of(tmp_path, "", chain(18, argument))
    assert ": the argument x of part p" in found
    assert found.endswith("larger than 2000 characters and values together: write it where it is used")


def test_parts_call_each_other_only_so_deep(tmp_path: Path) -> None:
    (found,) = problems_of(tmp_path, "", chain(200, "$x"))
    assert "m.yaml:25:" in found
    assert found.endswith("parts call each other more than 20 deep")
