"""Nothing becomes slow unseen: what a tick calls and makes is counted, not timed."""

from __future__ import annotations

import sys

import pytest

from artemis.build import kind_of_build

from .calls import PYTHON, calls, kept, values_made

MARGIN = 1.03
OF_EPOS4 = 450.0
"""Calls of the simulation per tick, at most: an EPOS4 interpolates and watches its inputs and temperature."""


@pytest.mark.skipif(kind_of_build() == "compiled", reason="compiled functions are not counted")
@pytest.mark.skipif(PYTHON not in kept(), reason="nobody has counted with this Python: python -m tests.bench.calls")
def test_tick_calls_no_more_functions_and_makes_no_more_values_than_it_did() -> None:
    if sys.getprofile() is not None:
        pytest.skip("somebody else counts calls")
    before, now = kept()[PYTHON], {**calls(), "values": values_made()}
    assert now.keys() == before.keys()
    more = {room: (before[room], number) for room, number in now.items() if number > MARGIN * before[room]}
    assert not more, (
        f"calls and values per tick, before and now: {more}. If it is worth it, `python -m tests.bench.calls` writes "
        "the new numbers down, to be committed with the change"
    )


@pytest.mark.exhaustive
@pytest.mark.skipif(kind_of_build() == "compiled", reason="compiled functions are not counted")
@pytest.mark.skipif(PYTHON not in kept(), reason="nobody has counted with this Python: python -m tests.bench.calls")
def test_tick_with_drives_of_another_family_calls_no_more_functions() -> None:
    if sys.getprofile() is not None:
        pytest.skip("somebody else counts calls")
    found = calls("artemis_epos4")
    assert found["tick"] <= MARGIN * kept()[PYTHON]["tick"]
    assert found["simulation"] <= OF_EPOS4
