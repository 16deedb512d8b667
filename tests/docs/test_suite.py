"""What `make test` leaves to `make test-ci` and `make test-all`: no more than it says."""

from __future__ import annotations

import json
import os
import shlex
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
PROGRAMS_LEFT = [SAMPLES[1], SAMPLES[2], SAMPLES[4], SAMPLES[5], "test_long", "test_slow"]
ALL = [*FIRST, *SAMPLES, "test_long", "test_slow", "test_short"]
TEST_CI = ["-m", "not exhaustive or programs", "--left"]
LATE = "; status=$$?; $(MAKE) --no-print-directory late && exit $$status\n"
COMMAND = "\n{}: $(READY)\n\t@$(BIN)/python -m pytest{}" + LATE


@pytest.mark.parametrize(
    ("folder", "words", "expected"),
    [("unit", [], SHORT), ("unit", TEST_CI, ["test_slow"]), ("e2e", TEST_CI, PROGRAMS_LEFT), ("unit", ["-m", ""], ALL)],
)
def test_what_is_left_out_is_what_is_marked(tmp_path: Path, folder: str, words: list[str], expected: list[str]) -> None:
    done = pytest_of(tmp_path, folder, TESTS, "--collect-only", *words)
    assert [line.partition("::")[2] for line in done.stdout.splitlines() if "::" in line] == expected


def pytest_of(
    tmp_path: Path, folder: str, tests: str, *words: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    (tmp_path / "tests" / folder).mkdir(parents=True, exist_ok=True)
    for name in ("conftest.py", "lateness.py"):
        shutil.copy(ROOT / "tests" / name, tmp_path / "tests")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    file = tmp_path / "tests" / folder / "test_it.py"
    if not file.exists() or file.read_text() != tests:
        file.write_text(tests)
    command = [sys.executable, "-m", "pytest", "-n", "0", "-q", *words]
    environment = os.environ | {"PYTEST_XDIST_WORKER": "gw0"} | environment
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)


SKIPPING = """
import pytest

def test_passes(): ...

@pytest.mark.skipif({lacks}, reason={reason!r})
def test_needs_an_extra(): ...
"""


def test_the_continuous_integration_runs_with_the_extras_what_make_test_skipped(tmp_path: Path) -> None:
    lacking = SKIPPING.format(lacks=True, reason="needs the extra ros2")
    assert pytest_of(tmp_path, "unit", lacking, CI="true").returncode == 0
    pytest_of(tmp_path, "unit", lacking, "-k", "passes")
    pytest_of(tmp_path, "unit", lacking, "tests/unit/test_it.py::test_passes")
    done = pytest_of(tmp_path, "unit", lacking, "--left", CI="true")
    assert done.returncode == 1
    assert "needs the extra ros2" in done.stdout.partition("the continuous integration has to run it")[2]
    done = pytest_of(tmp_path, "unit", SKIPPING.format(lacks=False, reason=""), "--left", CI="true")
    assert done.returncode == 0
    assert "1 passed" in done.stdout


def test_only_files_with_tests_for_it_are_imported_by_what_runs_the_rest(tmp_path: Path) -> None:
    short = "print('imported')\ndef test_short(): ..."
    assert "imported" in pytest_of(tmp_path, "unit", short, "-s").stdout
    assert "imported" not in pytest_of(tmp_path, "unit", short, "-s", *TEST_CI).stdout
    slow = "import pytest\n@pytest.mark.slow\ndef test_slow(): ..."
    assert "1 passed" in pytest_of(tmp_path, "unit", slow, *TEST_CI).stdout, "it has changed since"


@pytest.mark.parametrize(
    ("reason", "status"),
    [
        ("/dev/uhid: is missing", 0),
        ("library of Avalon: built by scripts/serial_peers", 0),
        ("libLMS1xx: built by scripts/scanner_peers", 0),
        ("rawlog-grabber of MRPT: installed by scripts/scanner_peers", 1),
        ("Fast DDS: built by scripts/ros2_peers", 1),
        ("installed by scripts/ros_peers", 1),
    ],
)
def test_the_continuous_integration_skips_what_needs_hardware_or_is_fetched_from_its_authors(
    tmp_path: Path, reason: str, status: int
) -> None:
    lacking = SKIPPING.format(lacks=True, reason=reason)
    assert pytest_of(tmp_path, "unit", lacking, CI="true").returncode == 0
    assert pytest_of(tmp_path, "unit", lacking, "--left", CI="true").returncode == status


IN_REAL_TIME = """
import os, pytest

@pytest.mark.realtime
@pytest.mark.{marker}
@pytest.mark.parametrize("number", [1, 2])
def test_in_time(number):
    assert number != int(os.environ["WRONG"]), "its reason"

def test_other(): ...
"""
"""A test that fails with one number."""


def late_in(tmp_path: Path) -> list[str]:
    kept: list[str] = json.loads((tmp_path / ".pytest_cache/v/artemis/late").read_text())
    return [name.partition("::")[2] for name in kept]


@pytest.mark.parametrize("marker", ["skipif(False, reason='')", "exhaustive"])
def test_what_failed_in_real_time_beside_other_tests_has_to_pass_alone(tmp_path: Path, marker: str) -> None:
    tests, all = IN_REAL_TIME.format(marker=marker), ("-m", "")
    done = pytest_of(tmp_path, "unit", tests, *all, CI="true", WRONG="1")
    assert (done.returncode, late_in(tmp_path)) == (0, ["test_in_time[1]"])
    assert "2 passed, 1 skipped" in done.stdout
    assert "`make late` repeats it alone" in done.stdout
    assert "its reason" in done.stdout
    for _ in range(2):
        again = pytest_of(tmp_path, "unit", tests, *all, "--late", WRONG="1")
        assert (again.returncode, late_in(tmp_path)) == (1, ["test_in_time[1]"])
        assert "1 failed" in again.stdout
        assert "test_in_time[1]" in again.stdout.partition("still not passed")[2]
    passed = pytest_of(tmp_path, "unit", tests, *all, "--late", WRONG="0")
    assert (passed.returncode, late_in(tmp_path)) == (0, [])
    assert "1 passed" in passed.stdout
    none = pytest_of(tmp_path, "unit", tests, *all, "--late", WRONG="1")
    assert (none.returncode, late_in(tmp_path)) == (0, []), "nothing was late"


def test_a_run_of_some_tests_forgets_none_that_was_late_unless_it_passed(tmp_path: Path) -> None:
    tests = IN_REAL_TIME.format(marker="skipif(False, reason='')")
    pytest_of(tmp_path, "unit", tests, WRONG="1")
    pytest_of(tmp_path, "unit", tests, "-k", "in_time and 2", WRONG="2")
    assert late_in(tmp_path) == ["test_in_time[1]", "test_in_time[2]"]
    pytest_of(tmp_path, "unit", tests, "--left", WRONG="0")
    assert late_in(tmp_path) == ["test_in_time[2]"]
    pytest_of(tmp_path, "unit", tests, WRONG="0")
    assert late_in(tmp_path) == [], "a complete run begins anew"


def test_what_fails_without_real_time_is_no_test_that_was_late(tmp_path: Path) -> None:
    tests = IN_REAL_TIME.format(marker="skipif(False, reason='')").replace(
        "test_other(): ...", "test_other(): raise ValueError"
    )
    assert "1 failed, 2 passed" in pytest_of(tmp_path, "unit", tests, WRONG="0").stdout
    assert late_in(tmp_path) == []


ENDS_BADLY = """
import pytest

@pytest.fixture
def rest():
    yield
    raise ValueError("its reason")

@pytest.mark.realtime
def test_in_time(rest): ...
"""


def test_what_a_test_in_real_time_leaves_behind_is_not_forgotten(tmp_path: Path) -> None:
    assert pytest_of(tmp_path, "unit", ENDS_BADLY).returncode == 0
    assert late_in(tmp_path) == ["test_in_time"]
    for _ in range(2):
        done = pytest_of(tmp_path, "unit", ENDS_BADLY, "--late")
        assert done.returncode == 1
        assert "its reason" in done.stdout


LEAVES = """
import gc, pytest, socket

@pytest.mark.realtime
def test_in_time():
    left = [socket.socket()]
    left.append(left)
    assert False

def test_next():
    gc.collect()
"""


def test_what_is_left_by_a_test_that_is_repeated_is_not_of_the_next(tmp_path: Path) -> None:
    done = pytest_of(tmp_path, "unit", LEAVES)
    assert (done.returncode, late_in(tmp_path)) == (0, ["test_in_time"]), done.stdout


def test_a_test_in_real_time_that_fails_alone_has_failed(tmp_path: Path) -> None:
    script = "unset PYTEST_XDIST_WORKER; exec " + shlex.join([sys.executable, "-m", "pytest", "-n", "0", "-q"])
    pytest_of(tmp_path, "unit", "import pytest\n@pytest.mark.realtime\ndef test_in_time(): raise ValueError", "--co")
    assert subprocess.run(["sh", "-c", script], cwd=tmp_path, capture_output=True, check=False).returncode == 1


def test_one_that_was_late_and_is_not_found_is_told(tmp_path: Path) -> None:
    tests = IN_REAL_TIME.format(marker="skipif(False, reason='')")
    pytest_of(tmp_path, "unit", tests, WRONG="1")
    done = pytest_of(tmp_path, "unit", tests.replace("in_time", "of_another_name"), "--late", WRONG="0")
    assert done.returncode == 1
    assert "test_in_time[1]" in done.stdout.partition("still not passed")[2]


def test_make_test_all_leaves_nothing_out_and_is_done_every_night() -> None:
    makefile, change, night = ((ROOT / name).read_text() for name in ("Makefile", ".ci/run", ".ci/nightly"))
    for name, words in (
        ("test", ""),
        ("test-ci", f' -m "{TEST_CI[1]}" --left'),
        ("test-all", ' -m "" --hypothesis-profile=exhaustive'),
    ):
        assert COMMAND.format(name, words) in makefile
    assert "\nfor target in test-all " in night
    for target in ("test", "test-ci", "core-coverage"):
        assert f"\nstep make --no-print-directory {target}\n" in change
    assert '"make --no-print-directory docs"\n' in change


def test_a_compilation_that_fails_beside_the_tests_is_named_and_leaves_no_file() -> None:
    lines = (ROOT / ".ci/run").read_text().splitlines()
    assert not any(line.startswith("step wait") for line in lines), "a process id names nothing"
    at = lines.index('wait "$compiler" || failed+=("make fast")')
    assert lines[at + 1 : at + 3] == ['cat "$compiling"', 'rm "$compiling"']
