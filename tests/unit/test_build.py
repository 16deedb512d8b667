"""It is said which artemis runs."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

import pytest
from typer.testing import CliRunner

import artemis
from artemis import build
from artemis.cli import app

MODULES = (Path(__file__).parents[2] / "setup.py").read_text().split('"""')[3].split()


def test_version_names_the_interpreter_and_the_build() -> None:
    told = CliRunner().invoke(app, ["--version"])
    assert told.exit_code == 0
    assert told.output == build.described() + "\n"
    assert told.output.startswith("artemis ")
    assert told.output.endswith(f", {build.kind_of_build()}\n")


@pytest.mark.parametrize(("file", "kind"), [("bus.py", "plain"), ("bus.cpython-311-x86_64-linux-gnu.so", "compiled")])
def test_build_is_known_by_the_file_of_a_module_that_would_be_compiled(
    file: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Spec:
        origin = f"/somewhere/artemis/sim/{file}"

    def find(name: str) -> type[Spec]:
        assert f"{name.replace('.', '/')}.py" in MODULES
        return Spec

    monkeypatch.setattr(build, "find_spec", find)
    assert build.kind_of_build() == kind


@pytest.mark.parametrize(
    ("origin", "what"),
    [
        ('{"url": "file:///srv/artemis", "dir_info": {"editable": true}}', "--editable '/srv/artemis[web]'"),
        ('{"url": "file:///srv/my%20artemis", "dir_info": {}}', "'/srv/my artemis[web]'"),
        (
            '{"url": "file:///tmp/artemis_robot-0.1.0-py3-none-any.whl"}',
            "'/tmp/artemis_robot-0.1.0-py3-none-any.whl[web]'",
        ),
        (None, "'artemis-robot[web]'"),
        (
            '{"url": "https://example.org/artemis.git", "vcs_info": {"vcs": "git", "commit_id": "5f0e"}}',
            "'artemis-robot[web] @ git+https://example.org/artemis.git@5f0e'",
        ),
        (
            '{"url": "https://example.org/a.whl", "archive_info": {}}',
            "'artemis-robot[web] @ https://example.org/a.whl'",
        ),
    ],
)
def test_an_extra_is_installed_from_where_artemis_came(
    origin: str | None, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Distribution:
        def read_text(self, name: str) -> str | None:
            return origin if name == "direct_url.json" else None

    class EggInfo:
        def read_text(self, name: str) -> None:
            """It has none."""

    monkeypatch.setattr(metadata, "distributions", lambda name: iter([EggInfo(), Distribution()]))
    monkeypatch.setattr(sys, "executable", "/srv/artemis/.venv/bin/python")
    assert build.install("web") == f"/srv/artemis/.venv/bin/python -m pip install {what}"


def test_modules_that_are_compiled_exist() -> None:
    root = Path(artemis.__file__).parents[1]
    assert [module for module in MODULES if not (root / module).exists()] == []
    assert sorted(MODULES) == MODULES
