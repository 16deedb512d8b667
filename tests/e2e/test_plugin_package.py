"""A package as `artemis plugins new` writes it: installed in an environment of its own, tried, and driven with."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from command_line import PATIENCE, assert_left_at_rest, modes_of, only_run

from artemis.commands.plugins import GROUPS, begin_plugin
from artemis.recording.mcap_reader import Recording

ROOT = Path(__file__).parents[2]
(SESSION,) = re.findall(r"^```console\n(.*?)^```$", (ROOT / "docs/plugins.md").read_text(), re.MULTILINE | re.DOTALL)
OFFLINE = ["--no-index", "--no-build-isolation", "--disable-pip-version-check"]
"""For pip: everything that a package of a plugin needs is there already."""

pytestmark = [pytest.mark.exhaustive, pytest.mark.slow, pytest.mark.timeout(4 * PATIENCE)]


class Environment:
    """A virtual environment which also finds what this one has, artemis and pip among it; packages go into it alone."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, symlinks=True)
        (packages,) = folder.glob("lib/python*/site-packages")
        ours = sysconfig.get_path("purelib")
        (packages / "ours.pth").write_text(f"import site; site.addsitedir({ours!r})\n")
        self._python = str(folder / "bin" / "python")
        self._variables = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHON"))
        }

    def run(self, folder: Path, program: str, *arguments: str) -> str:
        """What `program` prints; it must end well."""
        line = [self._python, "-m", program, *arguments, *(OFFLINE if program == "pip" else [])]
        done = subprocess.run(
            line,
            cwd=folder,
            env=self._variables,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE,
        )
        assert done.returncode == 0, f"{program} {shlex.join(arguments)}:\n{done.stdout}{done.stderr}"
        return done.stdout


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    return Environment(tmp_path_factory.mktemp("environment"))


SUITES = {"localizer": r"\b5 passed", "observer": r"\b5 passed", "scanner": r"\b8 passed"}
"""What pytest says of the tests of a new package."""


def shown_by(environment: Environment, folder: Path, words: str) -> str:
    program, *arguments = shlex.split(words)
    return environment.run(folder, program, *arguments)


def assert_listed_and_driven_with(kind: str, plugins: str, told: str, folder: Path) -> None:
    listed = (
        rf"^{GROUPS[kind]} +curves-{kind} +artemis-curves-{kind} 0\.1\.0 +artemis_curves_{kind}:Curves{kind.title()}"
    )
    assert re.search(listed, plugins, re.MULTILINE)
    run = only_run(folder)
    assert {"input": "teleop", "behaviour": "act"}.get(kind, "follow") in modes_of(run)
    assert_left_at_rest(run)
    located = {tick.snapshot.pose.source for tick in Recording(run).ticks()}
    assert located == {"curves-localizer" if kind == "localizer" else "odometry"}
    scans = [scan for tick in Recording(run).ticks() for scan in tick.snapshot.sensed.scans]
    assert (len(scans) > 50) is (kind == "scanner")
    assert kind != "observer" or len((run / "seen.txt").read_text().splitlines()) == 9
    distance = re.search(r"^distance +(\d+\.\d+) m", told, re.MULTILINE)
    assert distance
    assert float(distance[1]) > 2.0


def test_a_new_package_works_at_once(environment: Environment, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The session of the docs, line by line."""
    folder, shown = tmp_path_factory.mktemp("session"), {}  # kept: the environment refers to it
    for line in SESSION.splitlines():
        words = line.removeprefix("$ ").replace("curves", "curves-input")
        if words.startswith("cd "):
            folder /= words.removeprefix("cd ")
        else:
            shown[words] = shown_by(environment, folder, words)
    assert re.search(r"\b1[0-9] passed", shown["pytest"])
    assert_listed_and_driven_with("input", shown["artemis plugins"], shown["artemis run mission.yaml"], folder)


OTHERS = [kind for kind in GROUPS if kind != "input"]


@pytest.fixture(scope="module")
def others(environment: Environment, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with a package of each other kind, installed together, and what `artemis plugins` shows."""
    folder = tmp_path_factory.mktemp("others")
    for kind in OTHERS:
        begin_plugin(kind, f"curves-{kind}", folder)
    editable = " ".join(f"-e './artemis-curves-{kind}[test]'" for kind in OTHERS)
    shown_by(environment, folder, f"pip install {editable}")
    return folder, shown_by(environment, folder, "artemis plugins")


@pytest.mark.parametrize("kind", OTHERS)
def test_so_does_one_of_another_kind(kind: str, environment: Environment, others: tuple[Path, str]) -> None:
    package, plugins = others[0] / f"artemis-curves-{kind}", others[1]
    assert re.search(SUITES.get(kind, r"\b1[0-9] passed"), shown_by(environment, package, "pytest"))
    told = shown_by(environment, package, "artemis run mission.yaml")
    assert_listed_and_driven_with(kind, plugins, told, package)


def test_code_of_a_new_package_is_clean(tmp_path: Path) -> None:
    """By the rules of artemis itself, also with the longest name."""
    for kind in GROUPS:
        begin_plugin(kind, f"a{kind[0]}-{'x' * 27}", tmp_path)
    packages = sorted(tmp_path.iterdir())
    environment = {**os.environ, "MYPYPATH": ":".join(str(folder) for folder in (ROOT, *(p / "src" for p in packages)))}
    settings = str(ROOT / "pyproject.toml")
    for package in packages:
        for line in (["check"], ["format", "--check"]):
            tool = [sys.executable, "-m", "ruff", *line, "--no-cache", "--config", settings, "."]
            done = subprocess.run(tool, cwd=package, capture_output=True, text=True, timeout=PATIENCE)
            assert done.returncode == 0, done.stdout
    checked = [str(package / part) for package in packages for part in ("src", "tests")]
    cache = str(ROOT / ".mypy_cache")  # that of `make check`: what a plugin imports is not checked again
    tool = [sys.executable, "-m", "mypy", "--strict", "--config-file", settings, "--cache-dir", cache, *checked]
    done = subprocess.run(tool, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=4 * PATIENCE)
    assert done.returncode == 0, done.stdout
