"""Where a further run begins on the map so far: near the end of the run before, elsewhere, or nobody knows."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from office import OFFICE
from twin_rooms import APART, STANDS, TWINS

from artemis.commands.map_build import _another
from artemis.errors import ConfigError
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.laser import Reading
from artemis.mapping.se2 import Array
from artemis_lab.bench.laser_worlds import SETTINGS, scan

ENDED = np.array([2.6, 2.1, 0.0])
"""Where the run before ended, in the left one of two rooms that look alike."""
MANY = 20


def begun(scans: list[Array]) -> tuple[Array, int]:
    """Where a run of these scans, of a robot that stands, begins on the map of the rooms; and how many it keeps."""
    keys, found = KeyScans(), list[Array]()
    for pose in STANDS:
        keys.append(scan(TWINS, pose), pose, np.zeros(2))
    mapper: Any = SimpleNamespace(keys=keys, pose=ENDED, solve=lambda: None, begin_run=found.append)
    run = [Reading(time=0.1 * number, odometry=np.zeros(3), points=each) for number, each in enumerate(scans)]
    kept = len(list(_another(mapper, Path("b.clf"), iter(run), SETTINGS)))
    return found[0], kept


def test_a_run_that_may_begin_in_another_place_that_looks_alike_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    start, kept = begun([scan(TWINS, ENDED + APART)] * MANY)
    assert start == pytest.approx(ENDED, abs=0.02)
    assert kept == MANY
    notice, begins = capsys.readouterr().out.splitlines()
    assert notice == (
        "notice      b.clf: its first scans fit x 2.60 m, y 2.10 m, heading 0 deg, near where the run before ended, "
        "and as well x 9.60 m, y 2.10 m, heading 0 deg: did it begin there?"
    )
    assert begins == "run         b.clf: begins 0.0 m from where the one before ended"


def test_a_run_that_begins_farther_away_in_one_of_two_places_is_refused() -> None:
    there = ENDED + np.array([-1.0, 0.9, 0.3])
    with pytest.raises(ConfigError, match=r"and as well x 8\.60 m, y 3\.00 m, heading 17 deg; begin it where"):
        begun([scan(TWINS, there)] * MANY)


@pytest.mark.parametrize("first", [0, SETTINGS.least_points - 1])
def test_a_run_is_not_begun_on_a_scan_that_shows_little(first: int) -> None:
    """It is of another building."""
    elsewhere = scan(OFFICE, np.array([-2.0, -3.0, 0.0]))
    with pytest.raises(ConfigError, match="fit neither where the run before ended nor"):
        begun([elsewhere[:first]] + [elsewhere] * MANY)


def test_scans_that_show_little_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    seen = scan(TWINS, ENDED)
    start, kept = begun([seen[:5]] * 3 + [seen] * MANY)
    assert start == pytest.approx(ENDED, abs=0.02)
    assert kept == MANY + 3
    assert "notice" in capsys.readouterr().out
