"""What `make test` leaves to `make test-all`: no more than it says."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = """
import pytest

@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", range(7))
def test_sampled(number): ...

@pytest.mark.exhaustive
def test_long(): ...

def test_short(): ...

@pytest.mark.timeout(900)
def test_longest(): ...

@pytest.mark.realtime
def test_first(): ...
"""
SHORT = ["test_first", "test_longest", "test_sampled[0]", "test_sampled[3]", "test_sampled[6]", "test_short"]
ALL = ["test_first", "test_longest", *(f"test_sampled[{number}]" for number in range(7)), "test_long", "test_short"]


@pytest.mark.parametrize(("words", "expected"), [([], SHORT), (["-m", ""], ALL)])
def test_samples_are_tried_in_full_by_make_test_all(tmp_path: Path, words: list[str], expected: list[str]) -> None:
    for name in ("conftest.py", "lateness.py"):
        shutil.copy(ROOT / "tests" / name, tmp_path)
    (tmp_path / "test_it.py").write_text(TESTS)
    where = ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path), "-p", "no:cacheprovider", str(tmp_path)]
    command = [sys.executable, "-m", "pytest", "-n", "0", "-q", "--collect-only", *words, *where]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert [line.partition("::")[2] for line in done.stdout.splitlines() if "::" in line] == expected


def test_make_test_all_leaves_nothing_out_and_ci_runs_it() -> None:
    assert 'test-all: $(READY)\n\t@$(BIN)/python -m pytest -m ""' in (ROOT / "Makefile").read_text()
    assert "make --no-print-directory test-all\n" in (ROOT / ".ci" / "run").read_text()
