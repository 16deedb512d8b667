"""Units and container file, against the project that they name; `tests/packaging` builds the container."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from artemis import cli
from artemis.page.started_run import END_TIME, FED_EVERY, HANG
from artemis.page.waiting_page import LOOK

ROOT = Path(__file__).parents[2]
PACKAGING = ROOT / "packaging"
UNITS = sorted(PACKAGING.glob("*.service"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ARTEMIS = "/" + "opt/artemis/bin/artemis"


def test_all_is_every_extra_but_those_of_tests() -> None:
    extras = PROJECT["optional-dependencies"]
    (words,) = extras["all"]
    named = words.removeprefix("artemis-robot[").removesuffix("]").split(",")
    assert sorted(named) == sorted(set(extras) - {"all", "dev", "web-tests"})
    page = (ROOT / "docs/installing.md").read_text()
    (told,) = re.findall(r"single parts are (.+?)\. ", page, re.DOTALL)
    assert sorted(re.findall("`([a-z0-9]+)`", told)) == sorted(named)


def service(unit: Path) -> configparser.SectionProxy:
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read(unit)
    return parser["Service"]


def command_of(words: list[str]) -> Any:  # noqa: ANN401 (click's)
    """The command as the command line understands it."""
    root: Any = get_command(cli.app)
    name, command, rest = root.resolve_command(root.make_context("artemis", words, resilient_parsing=True), words)
    context = command.make_context(name, list(rest))
    return name, context.params


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_s_commands_are_commands(unit: Path) -> None:
    keys = service(unit)
    for key in ("ExecStart", "ExecStartPre"):
        if key in keys:
            program, *words = keys[key].split()
            assert program == ARTEMIS
            name, params = command_of(words)
            assert name in ("run", "page", "check"), params


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_unit_speaks_to_its_manager_and_ends_in_order(unit: Path) -> None:
    keys = service(unit)
    mission = "page" not in keys["ExecStart"]
    assert (keys["Type"], keys["KillMode"]) == ("notify", "mixed" if mission else "control-group")
    assert float(keys["WatchdogSec"]) > max(HANG, FED_EVERY, 10 * LOOK)
    assert float(keys["TimeoutStopSec"]) > END_TIME
    if not mission:  # also where the page hangs the run gets the signal that ends it in order, and the time for that
        assert keys["WatchdogSignal"] == "SIGTERM"
        assert float(keys["TimeoutAbortSec"]) > END_TIME
    assert keys["Restart"] == ("no" if mission else "always"), "a mission never begins again by itself"
    assert ("[Install]" in unit.read_text().splitlines()) != mission


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs the program systemd-analyze")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_understands_a_unit(unit: Path, tmp_path: Path) -> None:
    copy = tmp_path / unit.name
    copy.write_text(unit.read_text().replace(ARTEMIS, shutil.which("true") or ""))
    done = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True, timeout=60)
    of_ours = [line for line in done.stderr.splitlines() if unit.name in line]
    assert (done.returncode, of_ours) == (0, [])


def test_the_container_file_names_what_there_is() -> None:
    text = (PACKAGING / "Containerfile").read_text()
    lines = re.sub(r"^#.*\n", "", text, flags=re.MULTILINE).replace("\\\n", "").splitlines()
    said = dict(line.split(" ", 1) for line in lines)
    extras = re.findall(r"^ARG EXTRAS=([\w,]+)$", text, re.MULTILINE)[0].split(",")
    assert set(extras) <= set(PROJECT["optional-dependencies"])
    assert re.findall(r'"(\w+)"\]$', said["ENTRYPOINT"]) == ["artemis"]
    assert "artemis" in PROJECT["scripts"]
    assert said["USER"] == re.findall(r"useradd .* (\w+)$", said["RUN"])[0] != "root"
    assert command_of(re.findall(r'"(\w+)"', said["CMD"]))[0] == "doctor"
    makefile = (ROOT / "Makefile").read_text()
    assert "\nwheel:" in makefile
    assert "--wheel-dir build/dist " in makefile, "where it is built from"
    (shown,) = re.findall(r" artemis (page /missions)$", text, re.MULTILINE)
    assert command_of(shown.split())[0] == "page"
    assert "--privileged" not in re.sub(r"Not --privileged", "", text)
    (stop,) = re.findall(r"--stop-timeout (\d+)", text)
    assert float(stop) > END_TIME
