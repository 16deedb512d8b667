"""Runs the tests of the safety core, and fails unless they take every line and branch of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import coverage

from .core import CORE
from .running import ROOT

PROCESSES = 2


def main() -> int:
    """Print what is not covered; 1 if anything is not, or if a test fails."""
    modules = [str(ROOT / "artemis" / module) for module in CORE]
    tests = list(dict.fromkeys(str(ROOT / "tests" / test) for tests in CORE.values() for test in tests))
    with TemporaryDirectory() as folder:
        data = [str(Path(folder) / f"part-{number}") for number in range(PROCESSES)]
        measure = [sys.executable, "-m", "coverage", "run", "--rcfile=", "--branch", f"--include={','.join(modules)}"]
        running = [
            subprocess.Popen(
                [*measure, f"--data-file={file}", "-m", "pytest", "-n", "0", "-q", *tests[number::PROCESSES]]
            )
            for number, file in enumerate(data)
        ]
        status = max(process.wait() for process in running)
        measured = coverage.Coverage(str(Path(folder) / "all"), config_file=False, branch=True, include=modules)
        measured.combine(data)
        total = measured.report(show_missing=True)
    return int(status > 0 or total < 100)


if __name__ == "__main__":
    raise SystemExit(main())
