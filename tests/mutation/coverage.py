"""Runs the tests of the safety core, and fails unless they take every line and branch of it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import coverage

from .core import CORE
from .running import ROOT

RULES = """\
[run]
branch = true
data_file = {folder}/data
disable_warnings = no-data-collected
include =
    {modules}
patch = subprocess
"""
"""Pytest's workers are measured, its first process only hands out work."""


def main() -> int:
    """Print what is not covered; 1 if anything is not, or if a test fails."""
    modules = [str(ROOT / "artemis" / module) for module in CORE]
    tests = list(dict.fromkeys(str(ROOT / "tests" / test) for tests in CORE.values() for test in tests))
    with TemporaryDirectory() as folder:
        rules = Path(folder) / "rules"
        rules.write_text(RULES.format(folder=folder, modules="\n    ".join(modules)))
        measure = [sys.executable, "-m", "coverage", "run", f"--rcfile={rules}", "-m"]
        how = ["-n", str(os.cpu_count()), "-q", "-m", "not exhaustive", "--hypothesis-profile=few"]
        status = subprocess.run([*measure, "pytest", *how, *tests], check=False).returncode
        measured = coverage.Coverage(config_file=str(rules))
        measured.combine()
        total = measured.report(show_missing=True)
    return int(status != 0 or total < 100)


if __name__ == "__main__":
    raise SystemExit(main())
