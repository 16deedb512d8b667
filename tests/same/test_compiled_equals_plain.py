"""The compiled artemis is the same program: what it records is the same to the last bit."""

from __future__ import annotations

import subprocess
from random import Random

import pytest

from .digests import FAST, HERE, differing

SEEDS = Random(1).sample(range(1, 10_000), 20)
"""Of the campaigns; many more: `make fast-equals-plain`."""


@pytest.mark.exhaustive
@pytest.mark.timeout(1200)
def test_compiled_artemis_records_the_same() -> None:
    """And building it leaves alone what other tests, and every `artemis` of this folder, read at the same time."""
    entry_points = HERE / "artemis_robot.egg-info" / "entry_points.txt"
    written = entry_points.stat().st_mtime_ns
    subprocess.run(["make", "fast"], cwd=HERE, check=True, capture_output=True)
    assert entry_points.stat().st_mtime_ns == written
    assert differing(FAST, [], SEEDS) == ("compiled", [])
