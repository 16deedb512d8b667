from __future__ import annotations

from math import atan2, cos, pi, radians, sin, tan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.axles import Geometry
from artemis.motion.ackermann import Ackermann
from artemis.motion.angles import difference, wrap

SETTINGS = settings(derandomize=True, deadline=None)


@st.composite
def cars(draw: st.DrawFn) -> Ackermann:
    track = draw(st.floats(0.2, 2.0))
    return Ackermann(
        Geometry(
            wheelbase_m=draw(st.floats(0.3, 3.0)),
            track_m=track,
            scrub_radius_m=draw(st.floats(0.0, 0.15 * track)),
            driven_axle=draw(st.sampled_from(["front", "rear"])),
        )
    )


ARTEMIS = Ackermann(Geometry(wheelbase_m=0.560, track_m=0.436, scrub_radius_m=0.0625, driven_axle="front"))
steerings = st.one_of(st.floats(-radians(79), radians(79)), st.floats(-1e-9, 1e-9), st.sampled_from([0.0, pi / 3]))
speeds = st.floats(-2.0, 2.0)
rates = st.floats(-2.0, 2.0)


@SETTINGS
@given(cars(), steerings)
def test_wheel_angles_invert(car: Ackermann, steering: float) -> None:
    left, right = car.wheel_angles(steering)
    assert car.steering_from_left(left) == pytest.approx(steering, abs=1e-9)
    assert car.steering_from_right(right) == pytest.approx(steering, abs=1e-9)
    assert car.steering_from_wheel_angles(left, right) == pytest.approx(steering, abs=1e-9)


@SETTINGS
@given(cars(), st.floats(-pi, pi), st.floats(-pi, pi))
def test_virtual_angle_rises_with_each_wheel(car: Ackermann, one: float, other: float) -> None:
    low, high = min(one, other), max(one, other)
    assert car.steering_from_left(low) <= car.steering_from_left(high)
    assert car.steering_from_right(low) <= car.steering_from_right(high)


@SETTINGS
@given(cars(), speeds, steerings, rates, rates)
def test_speeds_invert(car: Ackermann, speed: float, steering: float, rate_left: float, rate_right: float) -> None:
    wheels = car.wheel_speeds(speed, steering, rate_left, rate_right)
    found, residual = car.twist_from_wheels(*wheels, steering, rate_left, rate_right)
    assert found == pytest.approx(speed, abs=1e-9)
    assert residual == pytest.approx(0.0, abs=1e-9)


@SETTINGS
@given(speeds, steerings.filter(lambda steering: abs(steering) > 1e-3))
def test_speeds_agree_with_the_singular_form(speed: float, steering: float) -> None:
    """Thesis equations 3.7 to 3.9, signed: omega (L / sin(delta) -+ R_L)."""
    omega = speed * sin(steering) / 0.560
    left, right = ARTEMIS.wheel_angles(steering)
    expected = (omega * (0.560 / sin(left) - 0.0625), omega * (0.560 / sin(right) + 0.0625))
    assert ARTEMIS.wheel_speeds(speed, steering) == pytest.approx(expected, abs=1e-9)


@SETTINGS
@given(steerings.filter(lambda steering: abs(steering) > 1e-3))
def test_angles_agree_with_the_textbook_form(steering: float) -> None:
    """The rear axle's radius R_H = L / tan(alpha), and the kingpins at +-B/2 beside it."""
    rear = 0.560 / tan(steering)
    sign = 1.0 if steering > 0 else -1.0
    left, right = atan2(sign * 0.560, sign * (rear - 0.1555)), atan2(sign * 0.560, sign * (rear + 0.1555))
    assert ARTEMIS.wheel_angles(steering) == pytest.approx((left, right), abs=1e-9)


@SETTINGS
@given(cars(), steerings)
def test_wheel_rates_are_the_derivative_of_the_angles(car: Ackermann, steering: float) -> None:
    step = 1e-6
    before, after = car.wheel_angles(steering - step), car.wheel_angles(steering + step)
    numeric = tuple((b - a) / (2 * step) for a, b in zip(before, after, strict=True))
    assert car.wheel_rates(steering, 1.0) == pytest.approx(numeric, rel=1e-6)


@SETTINGS
@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_wrapped_angles_point_where_they_did(angle: float, reference: float) -> None:
    for wrapped, full in ((wrap(angle), angle), (difference(angle, reference), angle - reference)):
        assert -pi < wrapped <= pi
        assert (cos(wrapped), sin(wrapped)) == pytest.approx((cos(full), sin(full)), abs=1e-9)
