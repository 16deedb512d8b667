"""Each fault of the host is noticed in time, by the right name, and what must follow follows."""

from __future__ import annotations

from pathlib import Path

import pytest
from every_row import Scene, assert_follows, assert_noticed, cases, play
from scenes_by_design import BY_DESIGN, Proof
from scenes_of_the_host import HOST_SCENES


@pytest.mark.sampled(4)
@cases(HOST_SCENES)
def test_fault_is_noticed_in_time_and_what_must_follow_follows(tmp_path: Path, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    assert_follows(run, scene, assert_noticed(run, id, scene))


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("id", "proof"), BY_DESIGN.items(), ids=BY_DESIGN.keys())
def test_what_is_no_fault_does_what_its_row_says(tmp_path: Path, id: str, proof: Proof) -> None:
    proof(tmp_path)
