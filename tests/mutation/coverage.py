"""Runs the tests of the safety core, and fails unless they take every line and branch of it."""

from __future__ import annotations

import coverage

from .core import CORE
from .running import ROOT, tested


def main() -> int:
    """Print what is not covered; 1 if anything is not, or if a test fails."""
    modules = [str(ROOT / "artemis" / module) for module in CORE]
    measured = coverage.Coverage(data_file=None, config_file=False, branch=True, include=modules)
    measured.start()
    status = tested(list(dict.fromkeys(ROOT / "tests" / test for tests in CORE.values() for test in tests)))
    measured.stop()
    total = measured.report(show_missing=True)
    return int(status) or int(total < 100)


if __name__ == "__main__":
    raise SystemExit(main())
