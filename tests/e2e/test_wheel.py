"""The wheel in an empty environment, far from any checkout: it makes a robot of its own and drives it, simulated."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATIENCE = 900
"""Seconds for everything that is installed, on a busy machine."""
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "artemis", "artemis_lab")


def done(folder: Path, *command: str | Path) -> str:
    """What a command prints that knows nothing of this checkout."""
    words = list(map(str, command))
    known = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL"))}
    ended = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=PATIENCE, env=known)
    assert ended.returncode == 0, f"{words}: {ended.stdout}{ended.stderr}"
    return ended.stdout


@pytest.mark.exhaustive
@pytest.mark.timeout(4 * PATIENCE)
def test_wheel_drives_in_an_empty_environment(tmp_path: Path) -> None:
    source, env = tmp_path / "source", tmp_path / "env"
    source.mkdir()
    for name in SOURCES:
        whole = ROOT / name
        if whole.is_dir():
            shutil.copytree(whole, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        else:
            shutil.copy(whole, source)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    done(tmp_path, *pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", tmp_path, source)
    (wheel,) = tmp_path.glob("*.whl")
    shutil.rmtree(source)
    done(tmp_path, sys.executable, "-m", "venv", "--without-pip", env)
    done(tmp_path, *pip, "--python", env, "install", wheel)

    artemis = env / "bin" / "artemis"
    done(tmp_path, artemis, "init", "--yes", "machine")
    said = done(tmp_path, artemis, "run", "machine/first.yaml")

    assert "\nresult        done\n" in said
    (run,) = (tmp_path / "machine" / "runs").iterdir()
    assert "uPlot=function" in (run / "report.html").read_text()
    assert "bit for bit" in done(tmp_path, artemis, "replay", run)
    assert "keyboard" in done(tmp_path, artemis, "plugins")
    assert not list(env.glob("lib/*/site-packages/matplotlib")), "an extra, as none of this needs it"
