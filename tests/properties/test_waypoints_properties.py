"""Any track becomes path files that load again and keep to it as well as they say, or a clear error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import TypeVar

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from artemis.commands.path_formats import READERS, read_gpx
from artemis.errors import ConfigError
from artemis.motion.joining import join
from artemis.motion.path import Path, path_from_csv
from artemis.motion.path_points import moving
from artemis.motion.route import Part, Route, route_from_csv
from artemis.motion.waypoints import deviation, drawn, legs_of, rows_of
from artemis.values import Pose

SHORTEST = 0.3
Made = TypeVar("Made")
numbers = st.floats(-100, 100)
points = st.lists(st.tuples(numbers, numbers), min_size=0, max_size=12)
near = st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)), min_size=0, max_size=30)


@st.composite
def drives(draw: st.DrawFn) -> list[Pose]:
    """What a car drives: stretches of one speed and one curvature, forwards and backwards, as ticks of a run."""
    x, y, heading = draw(st.floats(-50, 50)), draw(st.floats(-50, 50)), draw(st.floats(-math.pi, math.pi))
    poses = [Pose(x=x, y=y, heading=heading)]
    stretches = st.tuples(st.floats(-0.012, 0.012), st.floats(-3, 3), st.integers(1, 150))
    for distance, curvature, ticks in draw(st.lists(stretches, min_size=1, max_size=6)):
        for _ in range(ticks):
            heading += distance * curvature
            x, y = x + distance * math.cos(heading), y + distance * math.sin(heading)
            poses.append(Pose(x=x, y=y, heading=math.remainder(heading, math.tau)))
    return poses


def made(make: Callable[[], Made], problems: list[str] | None = None) -> Made | None:
    """What comes out; None if it is refused, in words that can be printed. They are added to `problems`."""
    problems = [] if problems is None else problems
    try:
        return make()
    except ConfigError as error:
        problems += error.problems
    assert problems
    assert all(problem.isprintable() for problem in problems)
    return None


def only(path: Path, *, backward: bool = False) -> Route:
    return Route((Part(path=path, backward=backward),))


def apart(px: float, py: float, x: np.ndarray, y: np.ndarray) -> float:
    """Distance [m] of a point from a line, piece by piece: another way than the one that is tested."""
    nearest = math.inf
    for ax, ay, bx, by in zip(x[:-1].tolist(), y[:-1].tolist(), x[1:].tolist(), y[1:].tolist(), strict=True):
        square = (bx - ax) ** 2 + (by - ay) ** 2
        share = max(0.0, min(1.0, ((px - ax) * (bx - ax) + (py - ay) * (by - ay)) / square)) if square else 0.0
        nearest = min(nearest, math.hypot(px - ax - share * (bx - ax), py - ay - share * (by - ay)))
    return nearest


@given(poses=drives(), smoothing=st.sampled_from([0.0, 0.3, 0.8]), spacing=st.sampled_from([0.02, 0.05, 0.2]))
def test_what_a_car_drives_becomes_files_that_load_again(poses: list[Pose], smoothing: float, spacing: float) -> None:
    legs = legs_of(poses, spacing)
    assert all(leg.backward is not after.backward for leg, after in itertools.pairwise(legs))
    for leg in legs:
        if leg.length < SHORTEST:
            continue
        x, y = np.array([(poses[index].x, poses[index].y) for index in leg.kept]).T
        curve = made(partial(drawn, x, y, spacing=spacing, smoothing=smoothing))
        rows = None if curve is None else made(partial(rows_of, only(curve, backward=leg.backward), "p.csv"))
        if rows is None:
            continue
        off, _ = deviation(x, y, rows.path)
        assert max(apart(px, py, rows.path.x, rows.path.y) for px, py in zip(x[::9], y[::9], strict=True)) <= off + 1e-3
        (again,) = route_from_csv(rows.text, "p.csv").parts
        assert (again.path.x == rows.path.x).all()
        assert again.backward is leg.backward
        assert np.isfinite(again.path.curvature).all()
        if smoothing == 0.3 and spacing < 0.1:
            assert off < 0.05  # even where the steering jumps from lock to lock


@given(given_points=st.one_of(points, near), closed=st.booleans(), smoothing=st.sampled_from([0.0, 0.3, 2.0]))
def test_any_points_become_a_file_that_loads_again_or_an_error(
    given_points: list[tuple[float, float]], closed: bool, smoothing: float
) -> None:
    x, y = np.array(given_points).reshape(-1, 2).T
    kept = moving(x, y)
    x, y = x[kept], y[kept]
    rows = made(lambda: rows_of(only(join(x, y, closed=closed, smoothing=smoothing)), "p.csv"))
    if rows is None:
        return
    again = path_from_csv(rows.text, "p.csv")
    assert (again.x == rows.path.x).all()
    assert np.isfinite(again.curvature).all()
    assert again.closed or not closed


@given(
    latitude=st.floats(-80, 80),
    longitude=st.floats(-180, 180),
    north=st.floats(-500, 500),
    east=st.floats(-500, 500),
)
def test_a_track_lies_as_far_apart_as_on_a_sphere(latitude: float, longitude: float, north: float, east: float) -> None:
    lat = latitude + math.degrees(north / 6.371e6)
    lon = longitude + math.degrees(east / 6.371e6 / math.cos(math.radians(latitude)))
    lon = (lon + 180) % 360 - 180
    text = f'<gpx><trkpt lat="{latitude!r}" lon="{longitude!r}"/><trkpt lat="{lat!r}" lon="{lon!r}"/></gpx>'
    distance = read_gpx(text.encode(), "f")
    assert abs(distance.x[1] - east) < 1e-4 + 0.012 * abs(east)  # the Earth is flattened by a third of a percent
    assert abs(distance.y[1] - north) < 1e-4 + 0.012 * abs(north)


any_text = st.one_of(
    st.text(max_size=80),
    st.text(alphabet='0123456789.,;:- \n#xy{}[]<>/="&!apost', max_size=80),
    st.binary(max_size=60),
)


@given(
    content=any_text, kind=st.sampled_from(sorted(READERS)), head=st.sampled_from(["", "x,y\n", "<gpx>", "poses:\n- "])
)
def test_any_content_is_points_or_refused_with_its_place(content: str | bytes, kind: str, head: str) -> None:
    raw = head.encode() + (content if isinstance(content, bytes) else content.encode(errors="surrogatepass"))
    problems: list[str] = []
    found = made(lambda: READERS[kind](raw, "f"), problems)
    if found is None:
        assert all(problem.startswith("f:") for problem in problems)
    else:
        assert len(found.x) == len(found.y) == len(found.places)
        assert np.isfinite(found.x).all()


def test_the_missions_own_paths_survive_being_imported() -> None:
    for file in sorted((FilePath(__file__).parents[2] / "missions" / "paths").glob("*.csv")):
        route = route_from_csv(file.read_text(), file.name)
        found = READERS["csv"](file.read_bytes(), file.name)
        if len(route.parts) > 1:
            continue
        again = rows_of(only(join(found.x, found.y, closed=False)), "p.csv").path
        assert again.closed is route.closed
        drawn_ = route.parts[0].path.drawn
        assert drawn_ is not None
        corner = drawn_.moved.max()  # smoothing leaves only corners, and ends in a bend, by more than a millimetre
        assert corner < 0.001 or file.stem in ("corner", "square_left", "square_right", "loop_left_home")
        assert corner < 0.002 or file.stem != "loop_left_home"
        assert abs(again.length - route.length) < 0.01 + 3 * corner  # a square has four corners
        assert deviation(found.x, found.y, again)[0] < 0.002 + 2 * corner
