"""`artemis plugins`: what it lists, what it writes, and what it refuses."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from artemis.cli import app
from artemis.commands.plugins import GROUPS, begin_plugin, show_plugins
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission

ROOT = Path(__file__).parents[2]


def install(folder: Path, package: str, source: str) -> None:
    """A package with an input `pad`, for as long as the folder is searched."""
    module = package.replace("-", "_")
    (folder / f"{module}.py").write_text(source)
    info = folder / f"{module}-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(f"[artemis.inputs]\npad = {module}:Pad\n")


def refusal(kind: str, name: str, folder: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        begin_plugin(kind, name, folder)
    return caught.value.problems


# ---------------------------------------------------------------------------------------------- the list


def test_every_group_is_listed_with_its_origin(capsys: pytest.CaptureFixture[str]) -> None:
    assert show_plugins() == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    place = "artemis.plugins.followers.indiveri:IndiveriFollower"
    assert ["artemis.followers", "indiveri", "artemis-robot", "0.1.0", place] in lines
    assert ["artemis.inputs", "scripted"] in [line[:2] for line in lines]


def test_a_broken_plugin_is_listed_with_its_reason_and_the_status_is_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "broken-pad", "import nothing_of_the_kind\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    done = CliRunner().invoke(app, ["plugins"])
    assert done.exit_code == 1
    lines = done.stdout.splitlines()
    at = next(number for number, line in enumerate(lines) if "pad" in line.split())
    assert lines[at].split() == ["artemis.inputs", "pad", "broken-pad", "1.2", "broken_pad:Pad"]
    assert "BROKEN: " in lines[at + 1]
    assert "No module named 'nothing_of_the_kind'" in lines[at + 1]
    assert any("scripted" in line for line in lines[at:])


def test_two_packages_with_one_name_are_both_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(tmp_path, "one-pad", "class Pad: ...\n")
    install(tmp_path, "other-pad", "class Pad: ...\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert show_plugins() == 1
    assert capsys.readouterr().out.count("is claimed by one-pad (one_pad:Pad) and other-pad (other_pad:Pad)") == 2


# ---------------------------------------------------------------------------------------------- new packages


@pytest.mark.parametrize("kind", GROUPS)
def test_a_new_package_has_all_that_it_needs(kind: str, tmp_path: Path) -> None:
    begin_plugin(kind, "slow-one", tmp_path)
    package = tmp_path / "artemis-slow-one"
    made = {path.relative_to(package).as_posix() for path in package.rglob("*") if path.is_file()}
    assert made - {"path.csv"} == {
        "README.md",
        "mission.yaml",
        "pyproject.toml",
        "robot.yaml",
        "src/artemis_slow_one/__init__.py",
        "src/artemis_slow_one/py.typed",
        "tests/test_artemis_slow_one.py",
    }
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    assert project["name"] == "artemis-slow-one"
    assert project["dependencies"] == ["artemis-robot"]
    points = project["entry-points"]
    assert points == {GROUPS[kind]: {"slow-one": f"artemis_slow_one:SlowOne{kind.capitalize()}"}}
    assert not [path for path in package.rglob("*") if path.is_file() and "$" in path.read_text()]
    missing = "slow-one: unknown key, and no installed behaviour" if kind == "behaviour" else "no plugin 'slow-one'"
    with pytest.raises(ConfigError) as refused:
        load_mission(package / "mission.yaml")
    assert all(missing in problem for problem in refused.value.problems)  # nothing else is wrong in it


def test_the_command_says_what_it_made(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["plugins", "new", "input", "pad", "--folder", str(tmp_path)])
    assert (done.exit_code, done.stdout) == (
        0,
        f"{tmp_path / 'artemis-pad'}: created; see README.md for what to do next\n",
    )


@pytest.mark.parametrize(
    "name", ["", "Pad", "2pads", "pad_one", "pad--one", "-pad", "pad-", "../pad", "päd", "pad one", "pad\n", "p" * 31]
)
def test_an_impossible_name_is_refused(name: str, tmp_path: Path) -> None:
    (problem,) = refusal("input", name, tmp_path)
    assert problem.startswith(f"{name!r} is no name of a plugin: expected at most 30 small letters")
    assert list(tmp_path.iterdir()) == []


def test_names_that_are_taken_are_refused(tmp_path: Path) -> None:
    assert refusal("input", "scripted", tmp_path) == [
        "the input 'scripted' is installed already, from artemis-robot; another name"
    ]
    (problem,) = refusal("input", "robot", tmp_path)
    assert re.fullmatch(r"a package artemis-robot \S+ is installed already; another name", problem)
    assert refusal("behaviour", "follow", tmp_path) == ["'follow' is a step of artemis' own; another name"]
    begin_plugin("follower", "scripted", tmp_path)


def test_what_is_there_is_never_overwritten(tmp_path: Path) -> None:
    begin_plugin("input", "pad", tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert refusal("follower", "pad", tmp_path) == [
        f"{tmp_path / 'artemis-pad'}: exists already; choose another name or --folder"
    ]
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_everything_wrong_is_said_at_once(tmp_path: Path) -> None:
    assert [problem.split(";")[0].split(":")[0] for problem in refusal("bird", "Pad", tmp_path / "none")] == [
        "no plugins of kind 'bird'",
        "'Pad' is no name of a plugin",
        f"--folder {tmp_path / 'none'}",
    ]


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str, encoding: str) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_text", full)
    (problem,) = refusal("input", "pad", tmp_path)
    assert problem == f"{tmp_path / 'artemis-pad' / 'pyproject.toml'}: cannot be written: No space left on device"


def test_what_it_writes_from_is_packed_with_artemis() -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["artemis"]
    packed = {path for pattern in data for path in (ROOT / "artemis").glob(pattern)}
    needed = {path for path in (ROOT / "artemis/plugins/templates").rglob("*") if path.is_file()}
    assert needed
    assert needed | set((ROOT / "artemis/testing").glob("*.yaml")) <= packed
