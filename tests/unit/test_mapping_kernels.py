"""The inner loops of mapping: what they say of shifted scans, and that the compiled ones say the same."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from office import OFFICE

from artemis.mapping import kernels, kernels_numpy
from artemis.mapping.likelihood import LikelihoodGrid, turn_step
from artemis.mapping.se2 import Array, between, compose
from artemis_lab.bench.laser_worlds import ANGLES, SETTINGS, scan, seen

SMALL = 512
START = np.array([0.0, 0.0, 0.3])


def grid_of(*poses: np.ndarray) -> LikelihoodGrid:
    grid = LikelihoodGrid(SETTINGS, SMALL)
    grid.build([scan(OFFICE, pose) for pose in poses], poses)
    return grid


def test_a_scan_matches_where_it_was_taken() -> None:
    found = grid_of(START).refine(scan(OFFICE, START), START)
    assert found.pose == pytest.approx(START, abs=1e-6)
    assert found.score > 0.95


@pytest.mark.slow
@given(x=st.floats(-0.3, 0.3), y=st.floats(-0.3, 0.3), turn=st.floats(-0.2, 0.2))
def test_the_search_finds_a_moved_robot_to_a_cell_and_refining_to_millimetres(x: float, y: float, turn: float) -> None:
    grid = LikelihoodGrid(SETTINGS, SMALL)
    grid.build([scan(OFFICE, START)], [START])
    true = compose(START, [x, y, turn])
    moved = scan(OFFICE, true)
    searched = grid.search(moved, START, 0.45, 0.3)
    assert np.abs(searched.pose - true)[:2].max() < 0.1
    assert abs(searched.pose[2] - true[2]) < 2 * turn_step(moved, SETTINGS.cell)
    refined = grid.refine(moved, searched.pose)
    assert np.hypot(*(refined.pose - true)[:2]) < 0.02
    assert abs(refined.pose[2] - true[2]) < 0.005


@pytest.mark.exhaustive
def test_the_search_is_exact() -> None:
    """No pose of the window is better: all of them are tried one by one."""
    grid, points = grid_of(START), scan(OFFICE, compose(START, [0.12, -0.2, 0.1]))[::4]
    found = grid.search(points, START, 0.3, 0.15)
    best = -1.0
    half, step = 6, turn_step(points, SETTINGS.cell)
    for t in range(-int(np.ceil(0.15 / step)), int(np.ceil(0.15 / step)) + 1):
        c, s = np.cos(START[2] + t * step), np.sin(START[2] + t * step)
        u = np.floor((START[0] + c * points[:, 0] - s * points[:, 1]) * 20 + 0.5).astype(int)
        v = np.floor((START[1] + s * points[:, 0] + c * points[:, 1]) * 20 + 0.5).astype(int)
        for dy in range(-half, half + 1):
            for dx in range(-half, half + 1):
                best = max(best, float(grid._field[(v + dy) % SMALL, (u + dx) % SMALL].mean()))
    assert found.score == pytest.approx(best, abs=1e-5)


def test_a_circle_is_left_out_of_the_search() -> None:
    grid, points = grid_of(START), scan(OFFICE, START)
    best = grid.search(points, START, 1.0, 0.1)
    other = grid.search(points, START, 1.0, 0.1, left_out=np.array([0.0, 0.0, 0.4]))
    assert np.hypot(*(other.pose - START)[:2]) >= 0.4 - 1e-9
    assert other.score < best.score - 0.3


def test_a_search_with_a_floor_finds_nothing_below_it() -> None:
    grid = grid_of(START)
    found = grid.search(scan(OFFICE, compose(START, [5.0, 3.0, 1.0])), START, 0.2, 0.1, floor=0.9)
    assert found.score == -1
    assert found.pose == pytest.approx(START)


def test_a_grid_that_was_built_again_has_forgotten() -> None:
    grid, fresh = grid_of(START, compose(START, [1, 1, 1])), grid_of(START)
    grid.search(scan(OFFICE, START), START, 0.2, 0.1)
    grid.build([scan(OFFICE, START)], [START])
    for each in ("_field", "_fine", "_coarse"):
        grid.search(scan(OFFICE, START), START, 0.2, 0.1)
        fresh.search(scan(OFFICE, START), START, 0.2, 0.1)
        assert np.array_equal(getattr(grid, each), getattr(fresh, each)), each


def test_what_is_out_of_range_is_no_point_and_lines_have_normals() -> None:
    ranges: Array = np.array(seen(OFFICE, START), np.float64)
    ranges[:40], ranges[50] = 0.0, 99.0
    points = kernels_numpy.surface_points(ranges, np.array(ANGLES, np.float64), 0.1, 40.0, 0.03)
    assert 60 < len(points) <= len(ranges) - 41
    length = np.hypot(points[:, 2], points[:, 3])
    assert np.all((np.abs(length - 1) < 1e-9) | (length == 0))
    assert (length > 0).mean() > 0.8
    assert len(kernels_numpy.surface_points(np.zeros(50), np.linspace(0.0, 5.0, 50), 0.1, 40.0, 0.03)) == 0


def test_rays_pass_and_end() -> None:
    ends, passes = np.zeros((40, 40), np.int32), np.zeros((40, 40), np.int32)
    kernels_numpy.count_rays(ends, passes, np.array([[0.025, 1.025]]), np.array([0.025, 0.025]), 20, -0.5, -0.5)
    assert ends[30, 10] == 1
    assert ends.sum() == 1
    assert passes[10:30, 10].tolist() == [1] * 20
    assert passes.sum() == 20


@pytest.mark.skipif(not kernels.COMPILED, reason="numba is not installed (extra slam)")
def test_the_compiled_loops_give_the_same() -> None:
    from artemis.mapping import kernels_numba

    results = [everything(module) for module in (kernels_numpy, kernels_numba)]
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-6)


@pytest.mark.skipif(not kernels.COMPILED, reason="numba is not installed (extra slam)")
def test_the_compiled_loops_give_the_same_where_the_grid_goes_round() -> None:
    from artemis.mapping import kernels_numba
    from artemis.mapping.likelihood import _blot

    blot, points = _blot(SETTINGS), np.zeros((400, 4))
    points[:, :2] = np.random.default_rng(1).uniform(-30.0, 30.0, (400, 2))
    fields = []
    for module in (kernels_numpy, kernels_numba):
        field, owner = np.zeros((64, 64), np.float32), np.zeros((64, 64), np.int32)
        module.stamp(field, owner, points, 0, 40, blot, 20.0)
        fields += [(field.copy(), owner)]
        module.wipe(field, points, 30, blot.shape[2] // 2, 20.0)
        fields += [(field, owner)]
    for one, other in zip(fields[:2], fields[2:], strict=True):
        assert one[0].any()
        assert np.array_equal(one, other)


def everything(module: ModuleType) -> list[np.ndarray]:
    """What each of the functions gives."""
    from artemis.mapping.likelihood import _blot

    blot, size = _blot(SETTINGS), SMALL
    field, owner = np.zeros((size, size), np.float32), np.zeros((size, size), np.int32)
    fine, coarse = np.zeros((size // 4, size // 4), np.float32), np.zeros((size // 16, size // 16), np.float32)
    points = np.zeros((1000, 4))
    count = 0
    for pose in (START, compose(START, [1.0, 0.5, 0.7])):
        part = module.surface_points(seen(OFFICE, pose), ANGLES, 0.1, 40.0, 0.03)
        module.place(points, count, part, pose)
        count += len(part)
    module.stamp(field, owner, points, 0, count, blot, 20.0)
    module.raise_levels(field, fine, coarse, points, count, blot.shape[2] // 2, 20.0)
    true = compose(START, [0.2, -0.1, 0.1])
    other = module.surface_points(seen(OFFICE, true), ANGLES, 0.1, 40.0, 0.03)
    found = [points[:count], field, owner, fine, coarse, other]
    for half in (4, 30):
        searched = module.search(field, fine, coarse, other, START, half, 12, 0.02, 20.0, 0.02, 0.1, np.zeros(3))
        found.append(np.array(searched))
    score, x, y, heading, told = module.refine(
        field, owner, points, other, START, 20.0, 12, 0.08, START, 0.5 * np.eye(3)
    )
    found += [np.array([score, x, y, heading]), np.asarray(told)]
    ends, passes = np.zeros((500, 500), np.int32), np.zeros((500, 500), np.int32)
    module.count_rays(ends, passes, points[:count, :2].copy(), true, 20.0, -12.0, -12.0)
    found += [ends, passes]
    module.wipe(field, points, count, blot.shape[2] // 2, 20.0)
    module.wipe_levels(fine, coarse, points, count, blot.shape[2] // 2, 20.0)
    assert not field.any()
    assert not fine.any()
    assert not coarse.any()
    assert between(START, true) == pytest.approx([0.2, -0.1, 0.1])
    return found
