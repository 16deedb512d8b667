"""What a script may be besides a table: the same rows as YAML, and what an input of an earlier run gave."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace
from pad import MISSIONS, ROBOT

from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.trial import trial
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.recorded import InputTick, content_of
from artemis.plugins.inputs.scripted import ScriptedConfig, ScriptedInput
from artemis.testing.contracts import InputContract
from artemis.values import OperatorInput, Request

ROWS = "- {time_s: 0, x: 0, y: 0}\n- {time_s: 1, x: 0, y: 1, enable: 1}\n"
HELD = OperatorInput(
    source="pad",
    speed=0.4,
    steering=-0.1,
    enabled=True,
    neutral=False,
    age=0.05,
    raw=(10.0, 700.0),
    axes=(0.1, 0.8),
    centred=(0.1, 0.7),
    shaped=(0.1, 0.6),
    buttons=(True, False),
)
REST = OperatorInput(source="pad", age=0.0)
OTHER = OperatorInput(source="keys", age=0.0, speed=0.2)


def as_yaml(table: str) -> str:
    """The rows of a table as a list of mappings."""
    lines = [line for line in table.splitlines() if line.strip() and not line.startswith("#")]
    header, *rows = ([cell.strip() for cell in line.split(",")] for line in lines)
    return "".join(f"- {{{', '.join(map(': '.join, zip(header, row, strict=True)))}}}\n" for row in rows)


def make(content: str | bytes, file: str = "s.yaml", name: str = "pad", **keys: object) -> ScriptedInput:
    raw = content if isinstance(content, bytes) else content.encode()
    context = PluginContext(name=name, robot=ROBOT, folder=MISSIONS, files={file: raw})
    return ScriptedInput(ScriptedConfig.model_validate({"file": file, **keys}), context)


def problems_of(content: str | bytes, **keys: object) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        make(content, **keys)  # type: ignore[arg-type]  # of the plugin
    return caught.value.problems


def run_of(*samples: OperatorInput | None, dt: float = 0.02) -> bytes:
    """The content of a run in which a second input gave its samples, too."""
    inputs = [(OTHER,) if sample is None else (OTHER, sample) for sample in samples]
    return content_of(InputTick(3.0 + index * dt, given) for index, given in enumerate(inputs))


# ---------------------------------------------------------------------------------------------- rows in YAML


@pytest.mark.parametrize("table", ["loop.csv", "wheel.csv", "show_a_loop.csv"])
def test_the_same_rows_as_yaml_give_the_same_input(table: str) -> None:
    text = (MISSIONS / "inputs" / table).read_text()
    one, other = make(text, "s.csv"), make(as_yaml(text), "s.yml")
    samples = [(one.read(index * 0.02), other.read(index * 0.02)) for index in range(2000)]
    assert any(first.enabled and first.speed for first, _ in samples)
    assert all(first == second for first, second in samples)


def test_a_button_that_a_row_leaves_out_is_released() -> None:
    device = make(ROWS + "- {time_s: 2, x: 0, y: 1}\n- {time_s: 3, y: 0, x: 0, end: 1}\n")
    samples = [device.read(float(second)) for second in range(4)]
    assert [sample.enabled for sample in samples] == [False, True, False, False]
    assert samples[1].buttons == (True, False)
    assert samples[3].requests == (Request.END, Request.DONE)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("", ["s.yaml:1:1: expected a list of rows, found None"]),
        ("[]\n", ["s.yaml:1:1: no rows; expected at least one"]),
        ("time_s: 0\n", ["s.yaml:1:1: expected a list of rows, found {'time_s': 0}"]),
        ("- 3\n", ["s.yaml:1:3: [0]: expected a row such as {time_s: 0, x: 0, y: 0}, found 3"]),
        ("- {time_s: 0, x: 0}\n", ["s.yaml:1:3: [0]: expected time_s, x, y; no y"]),
        (ROWS + "- {time_s: 2, x: 0, y: 2}\n", ["s.yaml:3:21: [2].y: expected -1 to 1, found 2"]),
        (ROWS + "- {time_s: 2, x: 0, y: 0, stop: 1}\n", ["s.yaml:3:27: [2].stop: unknown; known are time_s, x, y, "]),
        (ROWS + "- {time_s: 2, x: 0, y: 0, enable: true}\n", ["[2].enable: expected a number, found True"]),
        (ROWS + "- {time_s: 2, x: 0, y: 0, arm: 2}\n", ["s.yaml:3:27: [2].arm: expected 0 or 1, found 2"]),
        (
            ROWS + "- time_s: 2\n  x: '1'\n  y: 0,5\n",
            [
                "found '1'; remove the quotes",
                "5:3: [2].y: expected a number, found '0,5'; a number with a decimal comma: write 0.5",
            ],
        ),
        (ROWS + "- {time_s: 1, x: 0, y: 0}\n", ["[2].time_s: expected at least 0 and more than in the row before"]),
        (ROWS + "- {time_s: 2, x: 0, y: 010}\n", ["s.yaml:3:21: [2].y: 010 may mean octal or decimal"]),
        (ROWS + "- {steering: 0, time_s: 2}\n", ["no steering, gas, brake", "no steering", "no gas, brake"]),
        (ROWS + "- {time_s: 2, x: 0, x: 0, y: 0}\n", ["s.yaml:3:21: [2].x: duplicate key, first at 3:15"]),
        (ROWS + "- [\n", ["s.yaml:4:1: not YAML: a value is missing"]),
        (b"- {time_s: 0, x: 0, y: \xff}\n", ["s.yaml:1:24: byte 0xff is not UTF-8"]),
    ],
)
def test_what_is_wrong_in_yaml_is_told_with_its_place(rows: str | bytes, expected: list[str]) -> None:
    problems = "\n".join(problems_of(rows))
    assert [part for part in expected if part not in problems] == [], problems


def test_every_problem_of_the_list_is_told_in_its_order() -> None:
    rows = "- {time_s: 0, x: 0, y: 3}\n- {time_s: a, x: 0, y: 0}\n- 1\n- {time_s: 0, x: 0, y: 0}\n"
    assert [problem.split(" ")[0] for problem in problems_of(rows)] == [
        "s.yaml:1:21:",
        "s.yaml:2:4:",
        "s.yaml:3:3:",
        "s.yaml:4:4:",
    ]


def test_a_list_of_something_else_is_refused_in_few_lines() -> None:
    problems = problems_of("- 1\n" * 500)
    assert len(problems) == 21
    assert problems[-1] == "s.yaml: and 481 more problems"


# ---------------------------------------------------------------------------------------------- an earlier run


def test_the_samples_of_the_run_come_again_tick_by_tick() -> None:
    asking = replace(HELD, requests=(Request.RECORD, Request.QUICKSTOP), age=None)
    device = make(run_of(REST, HELD, asking, HELD, REST))
    assert [device.read(7.0 + index * 0.02) for index in range(4)] == [REST, HELD, asking, HELD]


def test_an_input_goes_on_under_another_name() -> None:
    content = run_of(REST, HELD, HELD, REST)
    device = make(content, name="stick", input="pad")
    assert [device.read(index * 0.02) for index in range(2)] == [replace(s, source="stick") for s in (REST, HELD)]


def test_requests_between_two_reads_are_not_lost_and_come_once() -> None:
    press = replace(HELD, requests=(Request.ARM,))
    device = make(run_of(REST, press, HELD, press, HELD, REST))
    assert device.read(0.0).requests == ()
    assert device.read(0.07).requests == (Request.ARM, Request.ARM)
    assert device.read(0.08).requests == ()


def test_where_it_was_lost_it_is_lost_again_and_a_stop_before_it_counts_later() -> None:
    device = make(run_of(REST, replace(HELD, requests=(Request.QUICKSTOP,)), None, REST, REST))
    assert device.read(0.0) == REST
    with pytest.raises(DeviceLost, match="gave nothing in the recorded run"):
        device.read(0.04)
    assert device.read(0.06).requests == (Request.QUICKSTOP,)


def test_nobody_holds_anything_after_the_run() -> None:
    device = make(run_of(REST, HELD, HELD))
    assert [device.read(now).enabled for now in (0.0, 0.02)] == [False, True]
    samples = [device.read(0.04 + index) for index in range(3)]
    assert [(sample.enabled, sample.neutral, sample.speed) for sample in samples] == [(False, True, 0.0)] * 3
    assert [sample.requests for sample in samples] == [(Request.DONE,), (), ()]


def test_without_done_the_end_of_the_run_is_silence() -> None:
    device = make(run_of(REST, HELD, HELD), done_at_end=False)
    assert device.read(0.0).age == 0.0
    sample = device.read(2.04)
    assert (sample.enabled, sample.requests) == (False, ())
    assert sample.age == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"input": "padd"}, "pad: input: no input padd gave anything in the run s.yaml; nearest is 'pad', there are"),
        (
            {"deadzone": 0.1, "gate": "round"},
            "pad: gate: not used with an earlier run; leave it out\npad: deadzone: not",
        ),
        ({"max_speed_m_s": 0.3}, "pad: file: it drove up to 0.4 m/s; 0.3 are allowed"),
        ({"max_speed_m_s": 0.8}, "max_speed_m_s: 0.8; the robot's limit is 0.7"),
    ],
)
def test_keys_that_do_not_fit_the_run_are_refused(keys: Mapping[str, object], expected: str) -> None:
    assert expected in "\n".join(problems_of(run_of(REST, HELD, REST), **keys))


def test_input_is_a_key_for_earlier_runs_only() -> None:
    assert problems_of(ROWS, input="pad") == ["pad: input: names one of an earlier run, and s.yaml is none"]


def test_a_run_without_inputs_is_refused() -> None:
    content = content_of([InputTick(0.0, ()), InputTick(0.02, ())])
    assert problems_of(content) == ["pad: input: no input pad gave anything in the run s.yaml; it had none"]


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda text: text[:-30], "s.yaml:3:1: no tick of a recorded run"),
        (lambda text: text.replace(b"0.4", b'"x"', 1), "s.yaml:2:1: no tick of a recorded run: Expected `float`"),
        (lambda text: text.replace(b'"time":3.02', b'"tide":3.02'), "s.yaml:2:1: no tick of a recorded run"),
        (lambda text: text.replace(b"3.04", b"2.04"), "s.yaml:3:1: time 2.04 after 3.02: not in order"),
        (lambda text: text.replace(b"pad", b"p\xff", 1), "s.yaml:1:1: no tick of a recorded run"),
        (lambda text: text.replace(b'"age"', b'"requests":["fly"],"age"', 1), "s.yaml:1:1: no tick"),
        (lambda text: text.replace(b'"age":', b'"axes":' + b"[" * 9000, 1), "s.yaml:1:1: no tick of a recorded run"),
    ],
)
def test_a_damaged_file_of_samples_is_refused_with_its_line(damage: object, expected: str) -> None:
    assert callable(damage)
    assert expected in "\n".join(problems_of(damage(run_of(REST, HELD, REST))))


def test_samples_survive_their_file_exactly() -> None:
    odd = replace(HELD, speed=0.1 + 0.2, steering=-1e-300, requests=tuple(Request))
    (line,) = content_of([InputTick(1 / 3, (odd,))]).splitlines()
    assert msgspec.json.decode(line, type=InputTick) == InputTick(1 / 3, (odd,))


class TestScriptedFromYaml(InputContract):
    plugin = ScriptedInput
    options: Mapping[str, object] = {"file": "loop.yaml"}
    files: Mapping[str, bytes] = {"loop.yaml": as_yaml((MISSIONS / "inputs/loop.csv").read_text()).encode()}


class TestScriptedFromARun(InputContract):
    plugin = ScriptedInput
    options: Mapping[str, object] = {"file": "runs/one", "input": "pad"}
    files: Mapping[str, bytes] = {"runs/one": run_of(REST, REST, *[replace(HELD, age=0.02)] * 200, REST)}


def test_as_yaml_writes_rows() -> None:
    assert as_yaml("# a\ntime_s, x\n0, 1\n") == "- {time_s: 0, x: 1}\n"
    assert Path(MISSIONS / "inputs").is_dir()


def test_a_trial_tells_what_a_plugin_raises_instead_of_ending_the_check() -> None:
    def broken(config: Config, context: PluginContext) -> None:
        raise KeyError(context.name)

    context = PluginContext(name="pad", robot=ROBOT, folder=MISSIONS)
    ((key, problem),) = trial(broken, ScriptedConfig(file="x"), context)
    assert key == ("plugin",)
    assert problem.startswith("the plugin cannot be made: KeyError('pad') at test_scripted_files.py:")
