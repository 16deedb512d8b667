"""The map of a report, drawn by hand: the frame, cells of a map, corrected poses."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import synthetic_run
from matplotlib.image import imread

from artemis.mapping.occupancy import OccupancyMap
from artemis.recording.mcap_reader import Recording
from artemis.report.chart_data import ShownRun
from artemis.report.path_map import PathMap
from artemis.report.series import Series, read_series


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Series:
    """Along half a circle of 2 m radius."""
    path = tmp_path_factory.mktemp("run") / "recording.mcap"
    return read_series(Recording(synthetic_run.record(path, synthetic_run.run(hz=5.0, fault_at=15.0))))


def drawn(run: Series) -> PathMap:
    return PathMap([ShownRun(name="", series=run)])


def test_one_metre_is_as_long_in_every_direction_and_y_points_up(run: Series) -> None:
    (places,) = drawn(run).places()
    moved, driven = places[-1, 1:3] - places[0, 1:3], run.estimated[-1, :2] - run.estimated[0, :2]

    assert moved[0] / driven[0] == pytest.approx(-moved[1] / driven[1])


def test_a_line_is_broken_where_the_pose_was_corrected(run: Series) -> None:
    moved = run.estimated.copy()
    moved[len(moved) // 2 :, 0] += 1.0

    pieces = [
        re.findall(r'class="estimated" d="([^"]*)"', drawn(each).svg)[-1].count("M")
        for each in (run, replace(run, estimated=moved))
    ]

    assert pieces == [1, 2]


def test_a_run_with_a_localizer_starts_where_that_first_found_it(run: Series) -> None:
    """Before, its pose is that of the odometry, from the origin."""
    std, moved = np.full(len(run.time), 0.01), run.estimated.copy()
    std[:5] = np.nan
    moved[5:, :2] += (1.0, 1.5)
    for source, first in (("tracker", 5), ("odometry", 0)):
        found = drawn(replace(run, estimated=moved, std=std, source=source))
        ((x, y),) = re.findall(r'class="start" transform="translate\(([-\d.]+) ([-\d.]+)\)', found.svg)
        assert (float(x), float(y)) == pytest.approx(tuple(found.places()[0][first, 1:3]), abs=0.06)


def test_cells_of_a_map_lie_where_they_are(run: Series) -> None:
    cells = np.zeros((3, 4), dtype=np.int8)
    cells[0, 3], cells[2, 0], cells[1] = 100, 50, -1  # row 0 has the lowest y
    content = OccupancyMap(cells=cells, resolution=0.5, origin=(-1.0, -2.0, 0.0))
    found = drawn(replace(run, map=content))

    (image,) = re.findall(r"<image.*?/>", found.svg)
    (packed,) = re.findall(r"base64,([^\"]*)", image)
    alpha = np.rint(100 * imread(io.BytesIO(base64.b64decode(packed)))[..., -1])
    np.testing.assert_array_equal(alpha, [[50, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 100]])
    x, y, scale = map(
        float, re.findall(r"translate\(([-\d.]+) ([-\d.]+)\) rotate\(-0.0000\) scale\(([\d.]+)\)", image)[0]
    )
    ((_, at_x, at_y, _),) = found.places()[0][:1]
    begin = run.estimated[0]
    assert at_x - x == pytest.approx((begin[0] + 1.0) * scale / 0.5, abs=0.02)
    assert y - at_y == pytest.approx((begin[1] + 2.0) * scale / 0.5, abs=0.02)


def test_a_run_that_never_had_a_pose_has_a_map_without_ways(tmp_path: Path) -> None:
    path = synthetic_run.record(tmp_path / "recording.mcap", iter(()))
    found = drawn(read_series(Recording(path)))

    assert found.names == {}
    assert "NaN" not in found.svg
    assert "nan" not in found.svg
