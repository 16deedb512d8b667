"""What `make test` leaves to `make test-ci` and `make test-all`: no more than it says."""

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

@pytest.mark.slow
def test_slow(): ...

def test_short(): ...

@pytest.mark.timeout(900)
def test_longest(): ...

@pytest.mark.realtime
def test_first(): ...
"""
FIRST, SAMPLES = ["test_first", "test_longest"], [f"test_sampled[{number}]" for number in range(7)]
SHORT = [*FIRST, *SAMPLES[::3], "test_short"]
WITH_SLOW = [*FIRST, *SAMPLES[::3], "test_slow", "test_short"]
ALL = [*FIRST, *SAMPLES, "test_long", "test_slow", "test_short"]
TEST_CI = ["-m", "not exhaustive or programs"]
COMMAND = "\n{}: $(READY)\n\t@$(BIN)/python -m pytest{}\n"


@pytest.mark.parametrize(
    ("folder", "words", "expected"),
    [("unit", [], SHORT), ("unit", TEST_CI, WITH_SLOW), ("e2e", TEST_CI, ALL), ("unit", ["-m", ""], ALL)],
)
def test_what_is_left_out_is_what_is_marked(tmp_path: Path, folder: str, words: list[str], expected: list[str]) -> None:
    for name in ("conftest.py", "lateness.py"):
        shutil.copy(ROOT / "tests" / name, tmp_path)
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "test_it.py").write_text(TESTS)
    where = ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path), "-p", "no:cacheprovider", str(tmp_path)]
    command = [sys.executable, "-m", "pytest", "-n", "0", "-q", "--collect-only", *words, *where]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert [line.partition("::")[2] for line in done.stdout.splitlines() if "::" in line] == expected


def test_make_test_all_leaves_nothing_out_and_is_done_every_night() -> None:
    makefile, change, night = ((ROOT / name).read_text() for name in ("Makefile", ".ci/run", ".ci/nightly"))
    for name, words in (
        ("test", ""),
        ("test-ci", f' -m "{TEST_CI[1]}"'),
        ("test-all", ' -m "" --hypothesis-profile=exhaustive'),
    ):
        assert COMMAND.format(name, words) in makefile
    assert "\nfor target in test-all " in night
    for target in ("test-ci", "core-coverage"):
        assert f"\nstep make --no-print-directory {target}\n" in change
    assert '"make --no-print-directory docs"\n' in change
