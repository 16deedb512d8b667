"""A test that fails while the machine is too busy for real time is skipped; any other failure stays one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import lateness

from artemis.supervision.catalogue import ROWS

TESTS = Path(__file__).parents[1]

CASES = """
import os, signal, subprocess, time
import pytest

def held_up():
    other = f"kill -STOP {os.getpid()}; sleep 0.3; kill -CONT {os.getpid()}"
    assert subprocess.run(["sh", "-c", other]).returncode == 0
    time.sleep(0.05)

@pytest.mark.realtime
def test_in_real_time_held_up():
    held_up()
    raise ValueError("its reason")

def test_without_real_time_held_up():
    held_up()
    raise ValueError

@pytest.mark.realtime
def test_passes_held_up():
    held_up()

@pytest.mark.realtime
def test_in_real_time_on_time(monkeypatch):
    monkeypatch.setattr("lateness.excuse", lambda begun, ended, shown: "")
    raise ValueError

@pytest.mark.realtime
def test_in_real_time_whose_run_stopped_for_a_late_host():
    raise ValueError("FAULT      SYS-01 control loop late (67 ms)")
"""


def test_only_what_runs_in_real_time_on_a_busy_machine_is_excused(tmp_path: Path) -> None:
    case = tmp_path / "test_cases.py"
    case.write_text(CASES)
    options = ["-n", "0", "-q", "-p", "no:cacheprovider", "-p", "conftest", "-c", str(TESTS.parent / "pyproject.toml")]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(case)],
        cwd=TESTS,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout.count("SKIPPED [1]") == 2
    assert "for real time (SYS-01 control loop late (67 ms)" in done.stdout
    assert "this machine is too busy for real time (" in done.stdout
    assert "its reason" in done.stdout
    failed = {line.split("::")[1].split()[0] for line in done.stdout.splitlines() if line.startswith("FAILED")}
    assert failed == {"test_without_real_time_held_up", "test_in_real_time_on_time"}
    assert "1 passed" in done.stdout


def test_a_machine_is_late_where_a_robot_stops() -> None:
    assert ROWS["SYS-01"].within == lateness.SYS_01
