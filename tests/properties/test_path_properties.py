"""Paths under any shape, place and start."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.motion.path import Path, path_from_csv, path_from_points
from artemis.motion.route import route_from_csv


def wave(amplitude: float, length: float, turned: float) -> Path:
    """A sine of the given amplitude and wavelength over 6 m, turned about its start."""
    x = np.linspace(0.0, 6.0, 121)
    y = amplitude * np.sin(math.tau * x / length)
    cosine, sine = math.cos(turned), math.sin(turned)
    return path_from_points(cosine * x - sine * y, sine * x + cosine * y)


waves = st.builds(wave, st.floats(0.0, 0.4), st.floats(3.0, 9.0), st.floats(-math.pi, math.pi))


@given(path=waves, share=st.floats(0.05, 0.95), offset=st.floats(-0.3, 0.3), guess=st.floats(-0.1, 0.1))
def test_projection_inverts_an_offset_from_the_path(path: Path, share: float, offset: float, guess: float) -> None:
    point = path.at(share * path.length)
    x, y = point.x - offset * math.sin(point.heading), point.y + offset * math.cos(point.heading)
    found = path.project(x, y, near=point.arc_length + guess)
    assert abs(found.arc_length - point.arc_length) < 2e-3
    assert abs(found.cross_track - offset) < 1e-4


@given(path=waves, x=st.floats(-9, 9), y=st.floats(-9, 9), share=st.floats(0, 1), window=st.floats(0.05, 1))
def test_projection_never_leaves_its_window(path: Path, x: float, y: float, share: float, window: float) -> None:
    near = share * path.length
    found = path.project(x, y, near=near, window=window)
    if 0 <= found.arc_length <= path.length:
        assert abs(found.arc_length - near) <= window + 2 * path.spacing


@given(path=waves, share=st.floats(0, 1))
def test_path_is_smooth_between_its_samples(path: Path, share: float) -> None:
    arc_length = share * (path.length - 0.01)
    here, there = path.at(arc_length), path.at(arc_length + 0.01)
    assert abs(math.dist((here.x, here.y), (there.x, there.y)) - 0.01) < 1e-5
    assert abs(math.remainder(there.heading - here.heading, math.tau) - here.curvature * 0.01) < 1e-3


@given(st.one_of(st.text(max_size=80), st.text(alphabet="0123456789.,; -\n#xyeinf", max_size=80)))
def test_any_text_is_a_path_or_refused_with_its_places(text: str) -> None:
    problems: list[str] | None = None
    try:
        path = path_from_csv(text, "p.csv")
    except ConfigError as error:
        problems = error.problems
    if problems is None:
        assert np.isfinite(path.x).all()
        assert np.isfinite(path.curvature).all()
        assert path.length > 0
    else:
        assert problems
        assert all(problem.startswith("p.csv:") for problem in problems)


near = st.floats(-0.4, 0.4)
rows = st.lists(st.tuples(near, near, st.floats(-4, 4)), min_size=2, max_size=12)


@given(st.one_of(st.text(alphabet="0123456789.,; -\n#xyeinfhadg", max_size=80), rows), st.booleans())
def test_any_points_are_a_route_that_a_car_can_be_put_on_or_refused(
    given_rows: str | list[tuple[float, float, float]], headings: bool
) -> None:
    if isinstance(given_rows, str):
        text = given_rows
    else:
        lines = [",".join(map(str, row if headings else row[:2])) for row in given_rows]
        text = "\n".join(["x,y,heading" if headings else "x,y", *lines])
    problems: list[str] | None = None
    try:
        route = route_from_csv(text, "p.csv")
    except ConfigError as error:
        problems = error.problems
    if problems is not None:
        assert problems
        assert all(problem.startswith("p.csv:") for problem in problems)
        return
    assert route.length > 0
    for part in route.parts:
        assert np.isfinite(part.path.curvature).all()
    for one, other in pairwise(route.parts):
        end, begin = one.path.at(one.path.length), other.path.at(0.0)
        assert math.dist((end.x, end.y), (begin.x, begin.y)) < 0.05
        turn = one.heading_at(one.path.length) - other.heading_at(0.0)
        assert abs(math.remainder(turn, math.tau)) < math.radians(46)
    back = route.directed(from_end=True, backward=None)
    assert [part.backward for part in reversed(back.parts)] == [not part.backward for part in route.parts]


@given(radius=st.floats(0.33, 20), count=st.integers(40, 200), left=st.booleans(), share=st.floats(-1, 3))
def test_circles_are_circles(radius: float, count: int, left: bool, share: float) -> None:
    count = max(count, math.ceil(math.tau * radius))
    angle = np.linspace(0, math.tau, count + 1) * (1 if left else -1)
    path = path_from_points(radius * np.cos(angle), radius * np.sin(angle))
    point = path.at(share * path.length)
    assert path.closed
    assert abs(math.hypot(point.x, point.y) - radius) < 0.001
    assert abs(point.curvature * radius - (1 if left else -1)) < 0.02
