"""What README and docs say is true: commands, missions, links, diagrams, tables. And what holds for every file."""

from __future__ import annotations

import ast
import contextlib
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml
from _pytest.mark import ParameterSet
from command_line import artemis_here
from extras import load_or_skip
from pydantic import BaseModel
from typer.main import get_command

from artemis import vehicle
from artemis.app import run_mission
from artemis.cli import app
from artemis.commands.plugins import begin_plugin
from artemis.mission import mission_schema, schema
from artemis.mission.loading import plugin_from
from artemis.mission.markdown import steps_markdown
from artemis.planning import inputs_used
from artemis.plugins.behaviours.approach import ApproachConfig
from artemis.plugins.followers.indiveri import IndiveriConfig
from artemis.plugins.inputs.scripted import ScriptedConfig
from artemis.plugins.registry import CONTRACTS as PLUGIN_CONTRACTS
from artemis.plugins.registry import load
from artemis.plugins.stated import is_live
from artemis.sim.world import PlantParameters
from artemis.states.machine import mermaid
from artemis.testing.localizers import LocalizerContract
from artemis_lab.injections.stage import Needs
from artemis_lab.injections.table import INJECTIONS, NOT_INJECTED

ROOT = Path(__file__).parents[2]
DOCS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
SOURCES = sorted(path for name in ("artemis", "artemis_lab") for path in (ROOT / name).rglob("*.py"))
MAIN_PATH = (
    "plugins/inputs/gamepad.py",
    "robot.py",
    "states/teleop.py",
    "motion/limits.py",
    "devices/drive.py",
    "devices/epos.py",
)
MAIN_PATH_LINES, FILE_LINES, FUNCTION_LINES = 700, 400, 60
KINDS = {"", "sh", "console", "yaml", "python", "toml", "text", "mermaid"}
DEMO = ["run", "missions/figure_eight.yaml"]
MAPPING = ["run", "missions/map_hall.yaml"]
NEEDS_A_BUS = {"sim"}
PATIENCE = 200
"""Seconds for a command: a busy machine that also measures coverage is slow."""


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{relative(self.page)}:{self.line}"


def blocks() -> Iterator[Block]:
    for page in DOCS:
        text = page.read_text()
        for found in re.finditer(r"^```(.*)\n((?:.*\n)*?)^```$", text, re.MULTILINE):
            yield Block(page, text[: found.start()].count("\n") + 1, found[1], found[2])


BLOCKS = list(blocks())


def commands() -> Iterator[str]:
    for block in BLOCKS:
        if block.kind == "sh":
            yield from (line for line in block.text.splitlines() if line.strip() and line[0] != "#")


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)


COMMANDS = sorted({" ".join(shlex.split(line, comments=True)) for line in commands()})
TUTORIALS = ROOT / "docs/tutorials"
"""Done from the first line to the last by tests/e2e/test_tutorials.py."""
YAML_BLOCKS = [block for block in BLOCKS if block.kind == "yaml" and block.page.parent != TUTORIALS]


# ------------------------------------------------------------------------------------------------- blocks and commands


def test_every_block_says_what_it_is() -> None:
    assert not [str(block) for block in BLOCKS if block.kind not in KINDS]
    plain = [block for block in BLOCKS if not block.kind]
    assert not [str(block) for block in plain if re.search(r"^(?:\$ )?(?:artemis|make) ", block.text, re.MULTILINE)]
    assert {block.kind for block in BLOCKS} >= {"sh", "yaml", "python", "mermaid"}
    sessions = [relative(block.page) for block in BLOCKS if block.kind == "console" and block.page.parent != TUTORIALS]
    assert sessions == ["docs/plugins.md"], "tests/e2e/test_plugin_package.py goes through the one of this page"


def test_every_row_is_in_a_table() -> None:
    outside = [
        f"{relative(page)}: {rows[0][:60]}"
        for page in DOCS
        for found in re.findall(r"(?:^\|.*\n)+", prose(page), re.MULTILINE)
        if not re.fullmatch(r"\|[-:| ]+\|", ((rows := found.splitlines())[1:] or [""])[0])
    ]
    assert outside == []


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the commands need, where they may leave runs behind."""
    folder = tmp_path_factory.mktemp("checkout")
    shutil.copytree(ROOT / "missions", folder / "missions", ignore=shutil.ignore_patterns("runs"))
    return folder


@pytest.fixture(scope="module")
def demo(checkout: Path) -> None:
    """There is a run of the demo, RUN; tracker.tum are its true poses."""
    runs = checkout / "missions" / "runs"
    others = set(runs.glob("*"))
    done = artemis(checkout, *DEMO)
    assert done.returncode == 0, done.stderr
    (run,) = set(runs.iterdir()) - others
    (checkout / "RUN").symlink_to(run)
    assert artemis(checkout, "report", "RUN", "--export", "tum").returncode == 0
    shutil.copy(run / "true.tum", checkout / "tracker.tum")


def artemis(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command in `folder`, in this process: a second less for each."""
    with contextlib.chdir(folder):
        return artemis_here(*arguments)


def tried() -> Iterator[ParameterSet]:
    """Every command; those that drive, or look at what was driven, take longest."""
    for command in COMMANDS:
        driven = command.startswith(("artemis run ", "artemis calibrate ")) or "RUN" in command.split()
        yield pytest.param(command, marks=[pytest.mark.exhaustive] if driven else [])


@pytest.mark.sampled(3)
@pytest.mark.timeout(2 * PATIENCE)
@pytest.mark.parametrize("command", list(tried()))
def test_command_of_the_docs_works(command: str, checkout: Path, request: pytest.FixtureRequest) -> None:
    program, *arguments = shlex.split(command)
    if program == "make":
        assert re.search(rf"^{re.escape(arguments[0])}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
        return
    assert program == "artemis"
    files = [Path(word) for word in arguments if "/" in word]
    assert all((ROOT / file).is_file() for file in files)
    parse(arguments)
    texts = [(ROOT / file).read_text() for file in files if file.suffix == ".yaml"]
    elsewhere = any("bus: simulation" not in text or "plugin: keyboard" in text for text in texts)
    if arguments[0] in NEEDS_A_BUS or (arguments[0] == "run" and elsewhere):
        return  # two processes, and a person, are the end-to-end tests' business
    if arguments[0] == "run" and len(arguments) == 2 and arguments != MAPPING:
        return  # tests/simulation runs every other mission, and the demo has just run
    if "RUN" in arguments:
        request.getfixturevalue("demo")
    done = artemis(checkout, *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def parse(arguments: list[str]) -> None:
    """Raises where the command line does not know a command, an option or an argument."""
    command: Any = get_command(app)
    name, rest = "artemis", arguments
    while rest and rest[0] in getattr(command, "commands", ()):
        name, *rest = rest
        command = command.commands[name]
    command.make_context(name, rest)


def typed() -> Iterator[ParameterSet]:
    """Lines that begin with `artemis` in blocks of text: what a reader types at a robot, or with files of their own."""
    for block in BLOCKS:
        for number, line in enumerate(block.text.splitlines() if block.kind == "text" else (), block.line + 1):
            if found := re.match(r"\s*(?:sudo -u artemis |alone: )?(?:\S+/)?artemis ([a-z].*)", line):
                yield pytest.param(found[1], id=f"{relative(block.page)}:{number}")


@pytest.mark.parametrize("line", list(typed()))
def test_command_in_a_block_of_text_is_one(line: str) -> None:
    parse(shlex.split(line, comments=True))


def test_commands_in_blocks_of_text_are_found() -> None:
    found = {str(case.values[0]).split()[0] for case in typed()}
    assert found >= {"run", "page", "map", "calibrate", "doctor", "init", "campaign", "path"}


def test_unknown_option_in_the_docs_would_be_found() -> None:
    for command in (["run", "missions/figure_eight.yaml"], ["path", "record", "RUN"], ["page", "missions"]):
        with pytest.raises(Exception, match="No such option"):
            parse([*command, "--fast"])


def test_page_of_commands_lists_every_command() -> None:
    group: Any = get_command(app)
    listed = re.findall(r"^\| `artemis (\w+)", (ROOT / "docs/commands.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(group.commands)


# --------------------------------------------------------------------------------------------------- missions and files


@pytest.mark.sampled(3)
@pytest.mark.slow
@pytest.mark.parametrize("block", YAML_BLOCKS, ids=str)
def test_mission_of_the_docs_runs_to_its_end(block: Block, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "missions", tmp_path, ignore=shutil.ignore_patterns("runs"), dirs_exist_ok=True)
    mission = tmp_path / "of_the_docs.yaml"
    mission.write_text(block.text)
    loaded = load_or_skip(mission)
    assert loaded.mission.mission == yaml.safe_load(block.text)["mission"]
    if any(is_live(plugin_from("artemis.inputs", use)[0]) for use in inputs_used(loaded, simulated=True).values()):
        return  # it waits for a person
    assert not run_mission(loaded, mission, simulate=True).failed


def test_a_mission_of_the_docs_is_no_block_of_text() -> None:
    assert [str(block) for block in BLOCKS if block.kind == "text" and re.search("^mission:", block.text, re.M)] == []


def models(model: type[BaseModel], seen: set[type[BaseModel]] | None = None) -> Iterator[type[BaseModel]]:
    """A model, and every model in its fields, once each: steps have steps within."""
    seen = set() if seen is None else seen
    if model in seen:
        return
    seen.add(model)
    yield model
    for field in model.model_fields.values():
        for part in parts(field.annotation):
            yield from models(part, seen)


def parts(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from parts(argument)


@pytest.mark.parametrize(
    "model",
    [schema.Mission, vehicle.RobotFile, PlantParameters, ScriptedConfig, IndiveriConfig, ApproachConfig],
    ids=lambda model: model.__name__,
)
def test_every_key_of_a_file_is_in_the_docs(model: type[BaseModel]) -> None:
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", prose(ROOT / "docs/missions.md")))))
    keys = {field.alias or key for each in models(model) for key, field in each.model_fields.items()}
    assert keys - named == set()


def names_in_the_program_of(page: str) -> dict[str, Any]:
    """What the only Python block of a page defines."""
    (block,) = (block for block in BLOCKS if block.kind == "python" and relative(block.page) == page)
    names: dict[str, Any] = {"__name__": "my_package"}
    exec(compile(block.text, str(block), "exec"), names)
    return names


def test_every_program_of_the_docs_is_tried() -> None:
    pages = [relative(block.page) for block in BLOCKS if block.kind == "python" and block.page.parent != TUTORIALS]
    assert sorted(pages) == ["docs/localisation.md", "docs/missions.md"] + ["docs/plugins.md"] * 3 + ["docs/testing.md"]


def test_test_of_the_docs_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names_in_the_program_of("docs/testing.md")["test_mute_drive_is_noticed"]()


def test_tests_of_a_mission_of_the_docs_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names = names_in_the_program_of("docs/missions.md")
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert len(tests) == 2
    for test in tests:
        test()


PROGRAMS_OF_PLUGINS = [block.text for block in BLOCKS if block.kind == "python" and block.page.name == "plugins.md"]


def test_plugin_of_the_docs_is_what_the_command_writes(tmp_path: Path) -> None:
    begin_plugin("input", "curves", tmp_path)
    (plugin,) = tmp_path.glob("artemis-curves/src/*/*.py")
    assert PROGRAMS_OF_PLUGINS[0] == plugin.read_text()


STOP_OF_THE_STICK = """
    def test_a_press_of_stop_wakes_and_counts_once(self) -> None:
        woken = []
        self.given = lambda: PluginContext(name="stick", robot=self.robot, folder=Path(), wake=lambda: woken.append(1))
        device = self.make()
        for line in (b"0 0 0 1\\n", b"0 0 0 1\\n", b"0 0 damaged\\n"):
            device.take(line)
        assert [device.read(now).requests for now in (0.0, 0.1)] == [(Request.QUICKSTOP,), ()]
        assert (woken, device.read(0.2).age) == ([1], 0.2)


from artemis.plugins.contracts import PluginContext
from artemis.values import Request
"""


def test_device_of_the_docs_keeps_its_contract(tmp_path: Path) -> None:
    (tmp_path / "artemis_stick.py").write_text(PROGRAMS_OF_PLUGINS[1])
    (tmp_path / "test_stick.py").write_text(PROGRAMS_OF_PLUGINS[2] + STOP_OF_THE_STICK)
    line = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "test_stick.py"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout
    assert re.search(r"^1\d passed in", done.stdout, re.MULTILINE)


def test_localizer_of_the_docs_keeps_its_contract() -> None:
    class Tried(LocalizerContract):
        plugin = names_in_the_program_of("docs/localisation.md")["BeaconLocalizer"]

        def make(self) -> Any:  # noqa: ANN401
            beacon = super().make()
            beacon._heard += [(0.0, 1.0, 2.0, 0.5), (0.1, 1.0, 2.0, 0.4)]
            return beacon

    for name in (name for name in dir(Tried) if name.startswith("test_")):
        getattr(Tried(), name)()
    assert [fix.time for _, fix in Tried().found()] == [0.0, -0.1]


@pytest.mark.parametrize("name", ["scripted", "indiveri", "simulated_tracker"])
def test_built_in_plugins_are_in_the_docs(name: str) -> None:
    assert any(load(group, name) for group in PLUGIN_CONTRACTS if name in names_of(group))
    assert f"`{name}`" in (ROOT / "docs/missions.md").read_text()


def names_of(group: str) -> set[str]:
    from artemis.plugins.registry import listing

    return {found.name for found in listing(group)}


# ------------------------------------------------------------------------------------------- links, diagrams and tables


@pytest.mark.parametrize("page", DOCS, ids=relative)
def test_links_of_a_page_resolve(page: Path) -> None:
    targets = [target for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)) if not re.match(r"[a-z]+:", target)]
    broken = []
    for target in targets:
        file, _, heading = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        if not there.exists() or not there.is_relative_to(ROOT) or (heading and heading not in headings(there)):
            broken.append(target)
    assert broken == []


def headings(page: Path) -> set[str]:
    """Anchors of a page as GitHub makes them."""
    found = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in found}


def between(page: str, name: str) -> str:
    text = (ROOT / page).read_text()
    (found,) = re.findall(rf"<!-- {name}:.*?-->\n(.*?)<!-- end of {name} -->", text, re.DOTALL)
    return str(found)


def test_mode_diagram_is_the_table_that_runs() -> None:
    assert between("docs/architecture.md", "modes") == f"```mermaid\n{mermaid()}\n```\n"


def test_mission_diagram_is_of_the_mission_above(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "missions", tmp_path, ignore=shutil.ignore_patterns("runs"), dirs_exist_ok=True)
    section = (ROOT / "docs/missions.md").read_text().partition("## The picture of a mission")[2]
    (tmp_path / "of_the_docs.yaml").write_text(section.partition("```yaml\n")[2].partition("```")[0])
    drawn = artemis_here("graph", tmp_path / "of_the_docs.yaml").stdout
    assert between("docs/missions.md", "mission") == f"```mermaid\n{drawn}```\n"
    artemis_here("graph", tmp_path / "of_the_docs.yaml", "--svg", tmp_path / "mission.svg")
    assert (tmp_path / "mission.svg").read_text() == (ROOT / "docs/images/mission.svg").read_text()


def test_reference_of_steps_is_the_schema() -> None:
    assert between("docs/missions.md", "steps") == steps_markdown(mission_schema())
    assert "|  |\n" not in steps_markdown(mission_schema()), "a key without a meaning"


def test_injection_table_is_the_code() -> None:
    rows = ["| fault | what happens | to | parameters (defaults) |\n|---|---|---|---|\n"]
    for id, injection in INJECTIONS.items():
        fields = injection.parameters.model_fields.items()
        parameters = ", ".join(parameter(name, field.get_default()) for name, field in fields) or "-"
        where = "-" if injection.needs is Needs.NOTHING else injection.needs.value
        rows.append(f"| {id} | {injection.text} | {where} | {parameters} |\n")
    reasons: dict[str, list[str]] = {}
    for id, reason in NOT_INJECTED.items():
        reasons.setdefault(reason, []).append(id)
    rows.append("\n| fault | why it cannot be injected |\n|---|---|\n")
    rows += [f"| {', '.join(ids)} | {reason} |\n" for reason, ids in reasons.items()]
    assert between("docs/testing.md", "injections") == "".join(rows)


def parameter(name: str, default: object) -> str:
    if default is None:
        return f"`{name}`"
    if isinstance(default, int) and name in ("code", "index", "statusword"):
        return f"`{name}` (0x{default:0{4 if default < 0x10000 else 8}X})"
    return f"`{name}` ({str(default).lower() if isinstance(default, bool) else default})"


def test_decisions_are_numbered_and_have_their_parts() -> None:
    pages = sorted((ROOT / "docs/decisions").glob("*.md"))
    for page in pages:
        text = page.read_text()
        assert text.startswith(f"# {int(page.name[:4])}. "), page.name
        parts = [text.find(f"\n## {part}\n") for part in ("Context", "Decision", "Consequences")]
        assert 0 < parts[0] < parts[1] < parts[2], page.name
    assert len({page.name[:4] for page in pages}) == len(pages)


def test_picture_is_small() -> None:
    assert (ROOT / "docs/images/drive.gif").stat().st_size < 800_000


# ----------------------------------------------------------------------------------------------------- sizes and names


def test_main_path_is_short() -> None:
    lines = {name: len((ROOT / "artemis" / name).read_text().splitlines()) for name in MAIN_PATH}
    assert sum(lines.values()) < MAIN_PATH_LINES, lines


def test_no_source_file_is_long() -> None:
    lines = {relative(path): len(path.read_text().splitlines()) for path in SOURCES}
    assert {name: count for name, count in lines.items() if count > FILE_LINES} == {}


def test_no_function_is_long() -> None:
    lengths: dict[str, int] = {}
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lengths[f"{relative(path)}:{node.lineno} {node.name}"] = (node.end_lineno or 0) - node.lineno + 1
    assert {name: length for name, length in lengths.items() if length >= FUNCTION_LINES} == {}


FORBIDDEN: Mapping[str, re.Pattern[str]] = {
    "a path of one machine": re.compile(r"(?<![\w.~-])/(?:home|work|root|Users|opt)/\w"),
    "a package registry": re.compile("|".join(("py" + r"pi\.", "python" + "hosted", "conda" + r"\.org"))),
    "something left to do": re.compile(r"\b(?:TO" + r"DO|FIX" + r"ME|X" + r"XX)\b"),
}


def project_files() -> Iterator[Path]:
    """Text files of the project, wherever it was unpacked."""
    for name in ("artemis", "artemis_lab", "docs", "missions", "tests", ".ci", "scripts"):
        for path in sorted((ROOT / name).rglob("*")):
            made = {"runs", "__pycache__"} & set(path.relative_to(ROOT).parts)
            if path.is_file() and path.suffix not in (".png", ".pyc") and not made:
                yield path
    yield from (ROOT / name for name in ("README.md", "CHANGELOG.md", "Makefile", "pyproject.toml"))


@pytest.mark.parametrize("kind", FORBIDDEN)
def test_no_file_names(kind: str) -> None:
    found = [
        f"{relative(path)}: {match[0]}"
        for path in project_files()
        if (match := FORBIDDEN[kind].search(path.read_text(errors="replace")))
    ]
    assert found == []
