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
    subprocess.run(["make", "fast"], cwd=HERE, check=True, capture_output=True)
    assert differing(FAST, [], SEEDS) == ("compiled", [])
