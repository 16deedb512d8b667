"""Real runs of a tricycle: never much worse than the plain fit, and intervals that hold for other runs."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from plain_odometry_fit import BASE, mean_error, plain_fit, real_runs

from artemis.calibration.fit import Fit, fit
from artemis.calibration.kinematics import ONE_WHEEL

CIRCLES = tuple(f"1401202114{number}_run-0{run}" for number in (15, 40, 54) for run in (1, 2))
FREE = ("free/140120211525_run-01", "free/140120211611_run-01")
SPLITS = [fitted for count in range(2, 6) for fitted in combinations(CIRCLES, count)][::3]
"""Every third of all."""


@cache
def fit_of(names: frozenset[str]) -> Fit:
    """Of some of the runs, made once."""
    return fit(real_runs(*sorted(names)), BASE, ONE_WHEEL)


def apart(one: Fit, other: Fit) -> list[float]:
    """Differences of two fits in units of the 95 % interval of a difference."""
    pairs = zip(one.estimates[: len(ONE_WHEEL)], other.estimates, strict=False)
    return [float(abs(a.value - b.value) / np.hypot(a.half_width, b.half_width)) for a, b in pairs]


@pytest.mark.exhaustive
@pytest.mark.sampled(24)
@pytest.mark.parametrize("fitted", SPLITS, ids=lambda names: "+".join(name[8:10] + name[-1] for name in names))
def test_circles_are_hardly_worse_than_by_the_plain_fit(fitted: tuple[str, ...]) -> None:
    """Of all 56 splits 47 are better, on average by 43 % (6.5 cm, not 11.4); the others are worse by up to 6.0 %."""
    runs, others = real_runs(*fitted), real_runs(*(name for name in CIRCLES if name not in fitted))

    found = fit_of(frozenset(fitted))

    assert mean_error(others, found.machine, found.sensor) < 1.07 * mean_error(others, plain_fit(runs))


@pytest.mark.exhaustive
def test_single_runs_are_better_than_by_the_plain_fit_on_average() -> None:
    """In one direction the tracker's place is not separate from distance and zero: any one of them may be lucky."""
    errors = []
    for name in CIRCLES:
        runs, others = real_runs(name), real_runs(*(other for other in CIRCLES if other != name))
        found = fit_of(frozenset([name]))
        errors.append((mean_error(others, found.machine, found.sensor), mean_error(others, plain_fit(runs))))

    ours, plain = np.mean(errors, axis=0)

    assert ours < 0.7 * plain


@pytest.mark.exhaustive
def test_fits_of_circles_and_of_free_runs_agree_within_their_intervals() -> None:
    assert max(apart(fit_of(frozenset(CIRCLES[:2])), fit_of(frozenset(FREE)))) < 1.0


@pytest.mark.exhaustive
def test_free_runs_calibrate_circles_better_than_the_plain_fit() -> None:
    free, circles = real_runs(*FREE), real_runs(*CIRCLES)

    found = fit_of(frozenset(FREE))

    assert mean_error(circles, found.machine, found.sensor) < mean_error(circles, plain_fit(free))


@pytest.mark.exhaustive
@pytest.mark.timeout(900)
def test_intervals_hold_across_disjoint_halves() -> None:
    halves = [frozenset(half) for half in combinations(CIRCLES, 3) if CIRCLES[0] in half]
    found = [(fit_of(half), fit_of(frozenset(CIRCLES) - half)) for half in halves]

    beyond = [share > 1.0 for pair in found for share in apart(*pair)]

    assert np.mean(beyond) <= 0.05
