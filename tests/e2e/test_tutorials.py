"""Every tutorial, done from its first line to its last in an empty folder: what it says that is printed, is printed."""

from __future__ import annotations

import os
import re
import subprocess
import sysconfig
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import PATIENCE

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs/tutorials").glob("*.md"))
OFFLINE = "--no-index --no-build-isolation --disable-pip-version-check"
"""For pip: everything that a package of a plugin needs is there already."""
REFUSED = " || echo "
"""Behind a command that is to fail."""
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")

pytestmark = [pytest.mark.exhaustive, pytest.mark.slow, pytest.mark.timeout(6 * PATIENCE)]


class Shell:
    """A reader's, in a virtual environment which also finds what this one has, artemis and pip among it."""

    def __init__(self, folder: Path) -> None:
        self.top = self.folder = folder / "work"
        self.top.mkdir()
        venv.create(folder / "env", symlinks=True)
        (packages,) = folder.glob("env/lib/python*/site-packages")
        (packages / "ours.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
        for program, more in (("artemis", ""), ("pytest", ""), ("pip", OFFLINE)):
            script = folder / "env/bin" / program
            script.unlink(missing_ok=True)
            script.write_text(f'#!/bin/sh\nexec "{folder}/env/bin/python" -m {program} "$@" {more}\n')
            script.chmod(0o755)
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHON"))}
        self._variables = {**kept, "PATH": f"{folder}/env/bin:{kept['PATH']}", "COLUMNS": "200"}

    def type(self, command: str) -> list[str]:
        """What a command prints; it must end well, and badly where the page says so."""
        if command.startswith("cd "):
            self.folder /= command.removeprefix("cd ")
            return []
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=self.folder,
            env=self._variables,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=3 * PATIENCE,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        said = (done.stderr + done.stdout).splitlines()
        assert REFUSED not in command or said[-1] == command.partition(REFUSED)[2], "it did not fail"
        return said


def session(text: str) -> Iterator[tuple[str, list[str]]]:
    """Commands, each with the lines that are shown of what it prints."""
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, *shown = part.splitlines()
        yield command, [line for line in shown if line != "..."]


def is_like(shown: str, said: str) -> bool:
    """The same words, and numbers that differ by no more than another version of a library rounds."""
    if " ".join(NUMBER.sub("#", shown).split()) != " ".join(NUMBER.sub("#", said).split()):
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(said), strict=True)
    return all(abs(float(a) - float(b)) <= 0.01 * abs(float(a)) for a, b in pairs)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_is_as_it_says(page: Path, tmp_path: Path) -> None:
    shell = Shell(tmp_path)
    for kind, text in BLOCK.findall(page.read_text()):
        if kind in ("yaml", "python"):
            name = text.partition("\n")[0].removeprefix("# ")
            assert name.endswith((".yaml", ".py")), "its first line says which file it is"
            (shell.top / name).write_text(text)
        for command, shown in session(text) if kind == "console" else ():
            said = shell.type(command)
            place = 0
            for line in shown:
                found = next((at for at in range(place, len(said)) if is_like(line, said[at])), None)
                assert found is not None, f"{command}\n  does not say: {line}\n" + "\n".join(said[place:])
                place = found + 1


def test_each_tutorial_is_in_the_menu_of_the_site() -> None:
    listed = re.findall(r"^docs/tutorials/(\w+)$", (ROOT / "docs/site/index.txt").read_text(), re.MULTILINE)
    assert sorted(listed) == [page.stem for page in PAGES]
