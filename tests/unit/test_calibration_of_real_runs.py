"""Real runs of a tricycle: never worse than the plain fit, and intervals that hold for other runs."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from plain_odometry_fit import BASE, CIRCLES, FREE, RATE, SPLITS, corrected, mean_error, plain_fit, rates, real_runs

from artemis.calibration.fit import Fit, fit
from artemis.calibration.kinematics import ONE_WHEEL

pytestmark = pytest.mark.timeout(900)


@cache
def fit_of(names: frozenset[str]) -> Fit:
    """Of some of the runs, made once."""
    return fit(real_runs(*sorted(names)), BASE, ONE_WHEEL)


def apart(one: Fit, other: Fit) -> list[float]:
    """Differences of two fits in units of the 95 % interval of a difference."""
    pairs = zip(one.estimates[: len(ONE_WHEEL)], other.estimates, strict=False)
    return [float(abs(a.value - b.value) / np.hypot(a.half_width, b.half_width)) for a, b in pairs]


def test_the_truth_of_the_real_runs_was_stretched_onto_the_times_of_the_odometry() -> None:
    """So the clocks are estimated before any fit is judged: what they show is one rate, whatever was stretched how."""
    taken, true = np.array(rates()).T

    assert np.ptp(taken) > 0.02
    assert np.ptp(true) < 0.007


@pytest.mark.slow
@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    "fitted", SPLITS, ids=lambda names: "+".join(name[8:10] + name[10:12] + name[-1] for name in names)
)
def test_circles_are_never_worse_than_by_the_plain_fit(fitted: tuple[str, ...]) -> None:
    runs, others = real_runs(*fitted), real_runs(*(name for name in CIRCLES if name not in fitted))
    found = fit_of(frozenset(fitted))

    assert mean_error(others, found.machine, found.sensor) < mean_error(others, plain_fit(runs))


@pytest.mark.slow
def test_circles_calibrate_free_runs() -> None:
    """Worse than by the plain fit, by which its error of the clock helps there; hardly worse than without that."""
    circles, free = real_runs(*CIRCLES), real_runs(*FREE)
    found = fit_of(frozenset(CIRCLES))
    ours, plain = mean_error(free, found.machine, found.sensor), mean_error(free, plain_fit(circles))

    assert ours < 0.016
    assert ours < 1.45 * plain
    assert ours < 1.08 * mean_error(free, plain_fit([corrected(run) for run in circles]))


@pytest.mark.exhaustive
def test_the_clock_of_the_truth_is_found_though_it_was_taken_for_that_of_the_odometry() -> None:
    """The published times of all runs show one rate."""
    taken = [rate for rate, _ in rates()[: len(CIRCLES)]]
    found = [rate * (1.0 + clock.drift) for rate, clock in zip(taken, fit_of(frozenset(CIRCLES)).clocks, strict=True)]

    assert found == pytest.approx([RATE] * len(CIRCLES), rel=0.004)
    assert np.ptp(found) < 0.6 * np.ptp(taken)


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
def test_intervals_hold_across_disjoint_halves() -> None:
    halves = [frozenset(half) for half in combinations(CIRCLES, 3) if CIRCLES[0] in half]
    found = [(fit_of(half), fit_of(frozenset(CIRCLES) - half)) for half in halves]

    beyond = [share > 1.0 for pair in found for share in apart(*pair)]

    assert np.mean(beyond) <= 0.05
