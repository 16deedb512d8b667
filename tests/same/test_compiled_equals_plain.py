"""The compiled artemis is the same program: what it records is the same to the last bit."""

from __future__ import annotations

import subprocess
from random import Random

import pytest

from .digests import FAST, HERE, differing

SEEDS = Random(1).sample(range(1, 10_000), 20)
"""Of the campaigns; many more: `make fast-equals-plain`."""

TAKES = """
from artemis.plugins.followers.frenet import FrenetConfig
from artemis.sim.epos2 import SimEpos2
from artemis.sim.world import Supply
assert FrenetConfig.model_validate({"speed_m_s": 0.5, "approach_m": 0.4}).approach_m == 0.4
assert Supply.model_validate({"idle_w": 20.0}).idle_w == 20.0
"""
"""What no mission of `missions/` and no campaign asks for, and has failed when it was compiled."""


@pytest.mark.exhaustive
@pytest.mark.timeout(1200)
def test_compiled_artemis_records_the_same() -> None:
    """And building it leaves alone what other tests, and every `artemis` of this folder, read at the same time."""
    entry_points = HERE / "artemis_robot.egg-info" / "entry_points.txt"
    written = entry_points.stat().st_mtime_ns
    subprocess.run(["make", "fast"], cwd=HERE, check=True, capture_output=True)
    assert entry_points.stat().st_mtime_ns == written
    assert differing(FAST, [], SEEDS) == ("compiled", [])
    subprocess.run([FAST, "-c", TAKES], cwd="/", check=True, capture_output=True)
