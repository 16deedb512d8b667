"""What tests do without the packages of extras (pyproject.toml) that `make test` does not install."""

from __future__ import annotations

from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.mission import LoadedMission, load_mission

PACKAGES = {"cyclonedds", "distributed", "evdev", "foxglove", "numba"}
"""Top-level packages of the extras that are not part of `dev`."""


def is_about_an_extra(problem: str) -> bool:
    """Whether a problem of a mission file is a missing package of an extra."""
    return "needs the package" in problem


def load_or_skip(path: Path) -> LoadedMission:
    """A valid mission; skips the test if all that is wrong with the mission is an extra that is not installed."""
    try:
        return load_mission(path)
    except ConfigError as error:
        if all(is_about_an_extra(problem) for problem in error.problems):
            pytest.skip("; ".join(error.problems))
        raise
