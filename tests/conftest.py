"""For all tests: which of them `make test` leaves to `make test-all`, their order, and how Hypothesis tries.

Anything may run on any worker of pytest-xdist, beside anything else.
"""

from __future__ import annotations

import gc
import os
import sys
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import settings

sys.path.append(str(Path(__file__).parent / "simulation"))  # tests of replay run missions on the rig that is there

READINGS = 10
"""Of each potentiometer in an alignment, instead of 100: two seconds less each time that a run aligns its wheels."""
WHOLE_RUNS = ("simulation", "replay")

settings.register_profile("short", settings.default, deadline=None)
settings.register_profile("exhaustive", settings.default, deadline=None, max_examples=400)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Tests stay until the end: who looks for garbage among thousands of them again and again does little else."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs in real time comes first: one after the other on one worker, while the others do the rest."""
    items.sort(key=lambda item: item.get_closest_marker("realtime") is None)
    counts: Counter[str] = Counter()
    for item in items:
        if sampled := item.get_closest_marker("sampled"):
            name = item.nodeid.partition("[")[0]
            if counts[name] % sampled.args[0]:
                item.add_marker(pytest.mark.exhaustive)
            counts[name] += 1


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors: the one with the tests in real time mostly waits."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(scope="module", autouse=True)
def _short_alignment(request: pytest.FixtureRequest) -> Iterator[None]:
    """In whole runs, but for modules with the mark `full_alignment`."""
    if request.path.parent.name not in WHOLE_RUNS or request.node.get_closest_marker("full_alignment"):
        yield
    else:
        with patch("artemis.states.alignment.READINGS", READINGS):
            yield
