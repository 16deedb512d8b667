from __future__ import annotations

import math

import pytest

from artemis.motion.angles import SERIES_BELOW, difference, sinc, wrap


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.0, 0.0),
        (3.0, 3.0),
        (-3.0, -3.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (4.0, 4.0 - math.tau),
        (-4.0, math.tau - 4.0),
        (3 * math.pi, math.pi),
        (100 * math.tau + 0.5, 0.5),
    ],
)
def test_wrap_keeps_the_direction(angle: float, expected: float) -> None:
    assert wrap(angle) == pytest.approx(expected, abs=1e-12)


def test_half_turn_is_positive_from_both_sides() -> None:
    assert wrap(-math.pi) == math.pi
    assert wrap(math.pi) == math.pi
    assert wrap(math.nextafter(-math.pi, 0.0)) == math.nextafter(-math.pi, 0.0)


def test_infinite_angle_is_refused() -> None:
    with pytest.raises(ValueError, match="domain"):
        wrap(math.inf)


@pytest.mark.parametrize(
    ("angle", "reference", "expected"),
    [(0.3, 0.1, 0.2), (3.1, -3.1, 6.2 - math.tau), (-3.1, 3.1, math.tau - 6.2), (0.0, math.pi, math.pi)],
)
def test_difference_is_the_shortest_rotation(angle: float, reference: float, expected: float) -> None:
    assert difference(angle, reference) == pytest.approx(expected, abs=1e-12)


def test_sinc_at_zero_is_one() -> None:
    assert sinc(0.0) == 1.0


def test_sinc_is_continuous_where_the_series_ends() -> None:
    below, above = math.nextafter(SERIES_BELOW, 0.0), SERIES_BELOW
    assert sinc(below) == pytest.approx(sinc(above), abs=3e-16)
    assert sinc(below) < 1.0


@pytest.mark.parametrize("z", [-2.0, -1e-3, 0.5, 3.0])
def test_sinc_is_the_ratio(z: float) -> None:
    assert sinc(z) * z == pytest.approx(math.sin(z), rel=1e-15)
