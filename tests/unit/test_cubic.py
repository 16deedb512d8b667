"""Cubic curves and systems of equations with few diagonals, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.linalg import solveh_banded

from artemis.motion.cubic import Cubic, solved, spline


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 40, 1000])
def test_spline_is_scipys(closed: bool, count: int) -> None:
    if closed and count == 2:
        return
    dice = np.random.default_rng(count)
    parameter = np.cumsum(dice.uniform(0.05, 2.0, count))
    points = dice.normal(size=(count, 2))
    if closed:
        points[-1] = points[0]
    ours = spline(parameter, points, closed=closed)
    theirs = CubicSpline(parameter, points, bc_type="periodic" if closed else "not-a-knot")
    at = np.append(parameter, dice.uniform(parameter[0], parameter[-1], 5 * count))
    for order in (0, 1, 2):
        wanted = theirs(at, order)
        np.testing.assert_allclose(ours(at, order), wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_curve_with_given_slopes_is_scipys() -> None:
    dice = np.random.default_rng(1)
    parameter = np.cumsum(dice.uniform(0.05, 2.0, 30))
    values, slopes = dice.normal(size=(2, 30))
    at = dice.uniform(parameter[0] - 0.1, parameter[-1] + 0.1, 200)
    np.testing.assert_allclose(
        Cubic(parameter, values, slopes)(at), CubicHermiteSpline(parameter, values, slopes)(at), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 100])
@pytest.mark.parametrize("diagonals", [1, 2])
def test_solution_is_lapacks(count: int, diagonals: int) -> None:
    dice = np.random.default_rng(10 * count + diagonals)
    main, beside, beyond = dice.uniform(4.5, 9.0, count), dice.normal(size=count), dice.normal(size=count)
    beside, beyond = np.clip(beside, -1.1, 1.1), np.clip(beyond, -1.1, 1.1)
    right = dice.normal(size=(count, 3))
    bands = np.zeros((3, count))
    bands[2] = main
    bands[1, 1:] = beside[1:]
    bands[0, 2:] = beyond[2:] if diagonals == 2 else 0.0
    found = solved(main, beside[1:], beyond[2:] if diagonals == 2 else None, right)
    rows = max(3 - count, 0)
    np.testing.assert_allclose(found, solveh_banded(bands[rows:], right), rtol=1e-11, atol=1e-13)
