"""Whole runs with a scanner that sees nothing: what an acknowledgment accepts, and what it never does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, Run, run, write_mission

from artemis.values import Mode

pytestmark = pytest.mark.short_alignment

ALONG = {"follow": {"path": {"waypoints": [[0, 0], [5, 0]]}, "follower": {"speed_m_s": 0.5}}}
HALL = {"walls": [{"points": [[-2, -2.5], [10, -2.5], [10, 2.5], [-2, 2.5], [-2, -2.5]]}]}
COVERED = 8.0
TAKEN = "acknowledge: the view of scanner front is taken as it is"


def driven(folder: Path, *acts: tuple[float, str], faults: list[dict[str, Any]], world: dict[str, Any]) -> Run:
    operator = [{"at_s": at, "do": what} for at, what in acts]
    simulation = {"seed": 3, "world": world, "operator": operator, "faults": faults}
    return run(write_mission(folder, [CALIBRATE, ALONG], robot="artemis_lms100.yaml", simulation=simulation))


def requests(done: Run) -> list[str]:
    """What the journal says of each request."""
    assert done.outcome is not None
    lines = (done.outcome.run.path / "journal.jsonl").read_text().splitlines()
    return [entry["text"] for entry in map(json.loads, lines) if entry["kind"] == "request"]


@pytest.mark.slow
@pytest.mark.parametrize("id", [None, "DRV-25"])
def test_robot_whose_scanner_is_covered_drives_only_once_it_is_uncovered(tmp_path: Path, id: str | None) -> None:
    """Whatever an acknowledgment is for: the cover, or a fault beside it."""
    beside = [] if id is None else [{"at_s": COVERED + 0.5, "inject": id, "node": "steer-left"}]
    again = [(12.0, "acknowledge"), (13.5, "arm"), (15.0, "acknowledge"), (17.5, "acknowledge"), (19.0, "arm")]
    cover = {"at_s": COVERED, "inject": "LAS-06", "duration_s": 16.0}
    done = driven(tmp_path, *again, (26.0, "acknowledge"), (30.0, "arm"), faults=[cover, *beside], world=HALL)
    stopped = done.first(lambda seen: seen.mode in (Mode.QUICKSTOP, Mode.FAULT)).time
    blind = [seen for seen in done.seen if stopped + 1.0 < seen.time < COVERED + 16.0]
    assert not any(seen.tick.set_points.speed for seen in blind)
    assert all("LAS-06" in [fault.id for fault in seen.tick.snapshot.verdict.faults] for seen in blind)
    assert TAKEN not in requests(done)
    assert done.status == 0
    assert done.recompute().difference is None


@pytest.mark.slow
def test_cover_that_slides_over_the_window_of_a_robot_that_drives_is_not_accepted(tmp_path: Path) -> None:
    cover = {"at_s": COVERED, "inject": "LAS-06", "within_s": 1.1}
    done = driven(tmp_path, (12.0, "acknowledge"), (13.5, "arm"), faults=[cover], world=HALL)
    limited = [seen.time for seen in done.seen if "LAS-06" in [it.id for it in seen.tick.snapshot.verdict.faults]]
    assert limited[0] < COVERED + 0.6
    assert not any(seen.tick.set_points.speed for seen in done.seen if seen.time > COVERED + 3.0)
    assert TAKEN not in requests(done)
    assert done.recompute().difference is None


def test_open_ground_is_taken_as_it_is_by_somebody_who_looks(tmp_path: Path) -> None:
    """In the first second, too early: nothing stands there yet that could be acknowledged."""
    acts = [(0.4, "acknowledge"), (4.0, "acknowledge"), (5.0, "arm")]
    done = driven(tmp_path, *acts, faults=[], world={"walls": []})
    assert requests(done) == ["acknowledge: ignored, there is no fault to acknowledge", TAKEN, "arm"]
    assert (done.status, set(done.fault_ids)) == (0, {"LAS-06"})
    assert not any(seen.tick.snapshot.verdict.faults for seen in done.seen if seen.time > 4.0)
    assert done.recompute().difference is None
