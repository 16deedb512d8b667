"""Paths: read, smoothed, sampled, projected onto."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.motion import path_points
from artemis.motion import table as table_module
from artemis.motion.path import Path, PathPoint, check_drivable, path_from_csv, path_from_points
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

PATHS = FilePath(__file__).parents[2] / "missions" / "paths"


def shipped(name: str) -> Path:
    return path_from_csv((PATHS / name).read_text(encoding="utf-8"), name)


def circle(radius: float = 2.0, count: int = 120, noise: float = 0.0, smoothing: float = 0.3) -> Path:
    angle = np.linspace(0.0, math.tau, count + 1)
    off = np.random.default_rng(7).normal(0.0, noise, (2, count + 1)) if noise else np.zeros((2, count + 1))
    off[:, -1] = off[:, 0]
    x, y = radius * np.sin(angle) + off[0], radius - radius * np.cos(angle) + off[1]
    return path_from_points(x, y, smoothing=smoothing)


def problems_of(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        path_from_csv(text, "p.csv")
    return caught.value.problems


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(load(FilePath(__file__).parents[2] / "missions" / "robots" / "artemis.yaml").data)


# ---------------------------------------------------------------------------------------------- reading


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n0.5,0\n1,0\n",
        "x;y\n0;0\n0.5;0\n1;0",
        "# a comment\n\nx_m  y_m\n0 0 # start\n\t0.5\t0\r\n1 0\n",
        "\ufeffY, X\n0, 0\n0, 0.5\n0, 1\n",
    ],
)
def test_separators_headers_and_comments_are_understood(text: str) -> None:
    path = path_from_csv(text, "p.csv")
    assert path.length == pytest.approx(1.0)
    assert path.at(0.25).x == pytest.approx(0.25)
    assert not path.closed


def test_every_problem_is_reported_with_its_place() -> None:
    text = "x,y,speed\n0,0,0.3\n0.5,nan,0.3\n1.0,0,0.3\n1.5,0\n2.0, abc,inf\n2.2,0,-1\n4,0,0.3\n"
    problems = problems_of(text)
    assert [problem.split(": ")[0] for problem in problems] == [
        "p.csv:3:5",
        "p.csv:5:5",
        "p.csv:6:6",
        "p.csv:6:10",
        "p.csv:7:7",
        "p.csv:8:1",
    ]
    assert "y: expected a finite number, found 'nan'" in problems[0]
    assert "expected 3 columns (x, y, speed), found 2" in problems[1]
    assert "expected more than 0 m/s" in problems[4]
    assert "1.80 m from the point before" in problems[5]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "p.csv:1:1: no rows: expected a line with the columns, such as x,y, and rows below it, such as 0,0.5"),
        (
            "# nothing\n",
            "p.csv:1:1: no rows: expected a line with the columns, such as x,y, and rows below it, such as 0,0.5",
        ),
        (
            "x,y\n",
            "p.csv:1:1: no rows: expected a line with the columns, such as x,y, and rows below it, such as 0,0.5",
        ),
        ("1,2\n", "1 distinct points"),
        ("1,2\n1,2\n1,2.0001\n", "1 distinct points"),
        ("1\n2\n", "no y"),
        ("x,why\n0,0\n1,0\n", "p.csv:1:3: unknown column 'why'; nearest is 'y'"),
        ("x,x\n0,0\n1,0\n", "p.csv:1:3: second column for x"),
        ("x y\n0 0\n1.1 0\n", "p.csv:3:1: 1.10 m from the point before; expected at most 1 m"),
        ("0,0\n1e300,0\n2,0\n2.5,0\n3,0\n3.5,0\n", "p.csv:2:1: 1e+300 m from the point before"),
        ("0,0\n1e300,0\n2,0\n", "p.csv:1:1: path of 2e+300 m; expected at most 20000 m"),
        (
            "0,0\n3,0\n3,3\n",
            "expected at most 1 m: waypoints are joined by `artemis path import`, or by straight lines in the mission: "
            "path: {waypoints: [[0, 0], [3, 0], [3, 3]]}",
        ),
        ("x y\n0 0\n0.5 0\n1 0\n0.6 0.01", "p.csv:4:1: the path reverses here"),
        ("0,0,0,1,5\n", "5 columns without names"),
    ],
)
def test_what_is_no_path_is_refused(text: str, expected: str) -> None:
    assert expected in "\n".join(problems_of(text))


def test_waypoints_are_told_once() -> None:
    assert len(problems_of("0,0\n3,0\n3,3\n")) == 1


def test_of_many_waypoints_the_first_are_shown() -> None:
    (problem,) = problems_of("".join(f"{2 * i},0.5\n" for i in range(9)))

    assert problem.endswith("[12, 0.5], [14, 0.5], ...]}")


def test_gap_over_an_unreadable_point_is_not_blamed_on_the_next() -> None:
    assert len(problems_of("0,0\n0.8,0\n1.6,?\n2.4,0\n")) == 1


def test_a_file_of_another_kind_gives_a_short_message() -> None:
    problems = problems_of("x,y\n" + "a,b\n" * 500)
    assert len(problems) == table_module.MAX_PROBLEMS + 1
    assert "980 more problems" in problems[-1]


def test_a_cell_is_shown_in_short_and_printable() -> None:
    header, row = problems_of("x,y," + "\x1b" * 500 + "\n0,0,1\n0.5,\x1b[2J" + "9" * 500 + ",1\n1,0,1\n")
    for problem in (header, row):
        assert problem.isprintable()
        assert len(problem) < 200
    assert header.startswith(r"p.csv:1:5: unknown column '\x1b\x1b")
    assert row.startswith(r"p.csv:3:5: y: expected a finite number, found '\x1b[2J999")


def test_more_columns_than_any_table_has_are_one_problem() -> None:
    (problem,) = problems_of("x,y" + ",z" * 100_000 + "\n0,0\n")
    assert problem == "p.csv:1:1: 100002 columns; expected at most 20"


def test_huge_files_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "MAX_ROWS", 10)
    assert "more than 10 rows" in problems_of("\n".join(f"{0.1 * i},0" for i in range(20)))[0]
    monkeypatch.setattr(table_module, "MAX_CHARACTERS", 10)
    assert "characters; expected at most 10" in problems_of("0,0\n0.5,0\n1,0\n")[0]


def test_paths_too_long_to_sample_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_points, "MAX_LENGTH", 2.0)
    (problem,) = problems_of("\n".join(f"{0.5 * i},0" for i in range(20)))
    assert problem.startswith("p.csv:1:1: path of 10 m; expected at most 2 m")


def test_standstill_points_are_dropped() -> None:
    path = path_from_csv("0,0\n0,0\n0.0004,0.0003\n0.5,0\n0.5,0\n1,0\n", "p.csv")
    assert path.drawn is not None
    assert len(path.drawn.points) == 3
    assert path.length == pytest.approx(1.0)


def test_recorded_speed_is_found_by_arc_length() -> None:
    path = path_from_csv("x,y,speed_m_s\n0,0,0.2\n1,0,0.2\n2,0,0.4\n", "p.csv")
    assert path.speed_at(0.5) == pytest.approx(0.2)
    assert path.speed_at(1.5) == pytest.approx(0.3, abs=0.005)
    assert path.speed_at(9.0) == pytest.approx(0.4)
    assert path_from_csv("0,0\n1,0", "p.csv").speed_at(0.5) == math.inf


def test_a_path_is_driven_at_its_own_speed_where_that_is_lower() -> None:
    path = path_from_csv("0,0\n1,0", "p.csv")
    ramp = np.linspace(0.1, 0.5, len(path.x))
    slow = path.with_speed(ramp)
    assert (path.speeds(0.3) == 0.3).all()
    assert (slow.speeds(0.3) == np.minimum(ramp, 0.3)).all()
    assert [slow.speed_at(place) for place in (0.0, 0.5, 1.0)] == pytest.approx([0.1, 0.3, 0.5], abs=0.005)
    assert path.speed is None
    assert path.with_speed(np.full(len(path.x), 0.2)).duration(0.3) == pytest.approx(5.0)


def test_what_is_left_of_a_closed_path_stays_so_with_another_speed() -> None:
    rest = circle().with_laps(2).begun_at(1.0, done=2.0)
    assert rest.with_speed(np.full(len(rest.x), 0.2)).length == rest.length


# ---------------------------------------------------------------------------------------------- the curve


def test_samples_stand_at_constant_arc_length() -> None:
    path = shipped("figure_eight.csv")
    steps = np.hypot(np.diff(path.x), np.diff(path.y))
    assert 0.019 < path.spacing <= 0.02
    np.testing.assert_allclose(steps, path.spacing, atol=2e-6)
    assert path.arc_length[-1] == pytest.approx(path.length)


def test_circle_has_its_length_curvature_and_headings() -> None:
    path = circle()
    assert path.closed
    assert path.length == pytest.approx(2 * math.tau, abs=1e-3)
    np.testing.assert_allclose(path.curvature, 0.5, atol=1e-3)
    quarter = path.at(path.length / 4)
    assert math.dist((quarter.x, quarter.y), (2.0, 2.0)) < 1e-3
    assert quarter.heading == pytest.approx(math.pi / 2, abs=1e-3)


def moved(path: Path) -> float:
    assert path.drawn is not None
    return float(path.drawn.moved.max())


def test_noise_of_a_recording_does_not_reach_the_curvature() -> None:
    noise = 0.001
    rough, smooth = circle(count=250, noise=noise, smoothing=0.0), circle(count=250, noise=noise)
    assert rough.closed
    assert smooth.closed
    assert np.max(np.abs(rough.curvature - 0.5)) > 3.0
    assert np.max(np.abs(smooth.curvature - 0.5)) < 0.5
    assert noise / 2 < moved(smooth) < 4 * noise


def test_smoothing_hardly_moves_the_tightest_drivable_circle() -> None:
    path = circle(radius=0.33, count=60)
    assert moved(path) < 0.001
    np.testing.assert_allclose(path.curvature, 1 / 0.33, rtol=0.01)


def test_smoothing_halves_its_wavelength() -> None:
    x = np.linspace(0.0, 6.0, 601)
    path = path_from_points(x, 0.002 * np.sin(math.tau * x / 0.3), spacing=0.01, smoothing=0.3)
    middle = (path.x > 2) & (path.x < 4)
    assert np.max(np.abs(path.y[middle])) == pytest.approx(0.001, rel=0.02)


def test_without_smoothing_the_path_goes_through_its_points() -> None:
    text = (PATHS / "figure_eight.csv").read_text(encoding="utf-8")
    assert moved(path_from_csv(text, "p.csv", smoothing=0.0)) == 0.0
    assert 0.0 < moved(path_from_csv(text, "p.csv")) < 0.001


@pytest.mark.parametrize("repeat_first", [True, False])
def test_loop_is_closed_with_and_without_a_repeated_point(repeat_first: bool) -> None:
    angle = np.linspace(0.0, math.tau, 101)[: 101 if repeat_first else 100]
    path = path_from_points(np.cos(angle), np.sin(angle))
    assert path.closed
    assert path.length == pytest.approx(math.tau, abs=2e-3)
    assert path.curvature[0] == pytest.approx(path.curvature[-1])


def test_end_that_meets_the_start_at_an_angle_is_open() -> None:
    side = np.linspace(0.0, 1.0, 11)
    flat = np.zeros(10)
    x = np.concatenate([side[:-1], flat + 1, 1 - side[:-1], np.zeros(11)])
    y = np.concatenate([flat, side[:-1], flat + 1, 1 - side])
    assert not path_from_points(x, y).closed


def test_two_points_make_a_straight_path() -> None:
    path = path_from_points(np.array([0.0, 0.0]), np.array([1.0, 0.0]))
    assert path.length == pytest.approx(1.0)
    assert path.at(0.5).heading == pytest.approx(-math.pi / 2)
    assert not path.curvature.any()


def test_open_path_goes_on_straight_beyond_its_ends() -> None:
    path = path_from_points(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.0, 0.0]))
    assert path.at(1.3).x == pytest.approx(1.3)
    assert path.at(-0.3).x == pytest.approx(-0.3)
    assert path.project(1.2, 0.1, near=1.0).arc_length == pytest.approx(1.2)
    assert path.project(-0.4, 0.1, near=0.0).arc_length == pytest.approx(-0.4)


def test_curvature_holds_at_the_ends_of_an_open_arc() -> None:
    angle = np.linspace(0.0, 2.0, 60)
    path = path_from_points(np.sin(angle), 1 - np.cos(angle), smoothing=0.0)
    assert path.at(0.0).curvature == pytest.approx(1.0, abs=0.01)
    assert path.at(path.length).curvature == pytest.approx(1.0, abs=0.01)
    assert path.at(path.length + 0.1).curvature == 0.0


# ---------------------------------------------------------------------------------------------- laps


def test_laps_lengthen_a_closed_path_only() -> None:
    path = circle()
    twice = path.with_laps(2)
    assert twice.length == pytest.approx(2 * path.length)
    assert path.laps == 1
    again = twice.at(path.length + 1.0)
    assert math.dist((again.x, again.y), (path.at(1.0).x, path.at(1.0).y)) < 1e-9
    with pytest.raises(ConfigError, match="open"):
        shipped("straight.csv").with_laps(2)
    with pytest.raises(ConfigError, match="at least 1"):
        path.with_laps(0)


def test_projection_counts_on_into_the_next_lap() -> None:
    path = circle().with_laps(3)
    lap = path.length / 3
    ahead, behind = path.at(0.1), path.at(-0.1)
    assert path.project(ahead.x, ahead.y, near=lap - 0.05).arc_length == pytest.approx(lap + 0.1, abs=1e-4)
    assert path.project(behind.x, behind.y, near=2 * lap + 0.05).arc_length == pytest.approx(2 * lap - 0.1, abs=1e-4)


# ---------------------------------------------------------------------------------------------- projection


@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.3])
def test_cross_track_is_positive_to_the_left(offset: float) -> None:
    path = circle()
    point = path.at(3.003)
    x, y = point.x - offset * math.sin(point.heading), point.y + offset * math.cos(point.heading)
    found = path.project(x, y, near=2.9)
    assert found.cross_track == pytest.approx(offset, abs=1e-4)
    assert found.arc_length == pytest.approx(3.003, abs=1e-3)
    assert found.heading == pytest.approx(point.heading, abs=1e-3)
    assert found.curvature == pytest.approx(0.5, abs=2e-3)
    assert math.dist((found.x, found.y), (point.x, point.y)) < 1e-3


def test_projection_stays_on_its_branch_at_a_crossing() -> None:
    path = shipped("figure_eight.csv")
    half = path.length / 2
    crossing = path.at(half)
    assert math.hypot(crossing.x, crossing.y) < 0.01
    assert path.project(0.0, 0.0, near=0.0).arc_length == pytest.approx(0.0, abs=0.01)
    assert path.project(0.0, 0.0, near=half).arc_length == pytest.approx(half, abs=0.01)
    assert path.project(0.0, 0.0, near=half - 0.8).arc_length < half - 0.4


def test_projection_costs_the_same_on_a_long_path(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = 0

    class Counted(list[float]):
        def __getitem__(self, index: int) -> float:  # type: ignore[override]  # only indices are used
            nonlocal reads
            reads += 1
            return super().__getitem__(index)

    counts = []
    for samples in (1_000, 1_000_000):
        zero = np.zeros(samples + 1)
        path = Path(np.linspace(0.0, samples * 0.02, samples + 1), zero, zero, zero, spacing=0.02)
        monkeypatch.setattr(path._samples, "x", Counted(path._samples.x))
        reads = 0
        assert path.project(10.0, 0.2, near=9.9).arc_length == pytest.approx(10.0)
        counts.append(reads)
    assert counts[0] == counts[1] < 50


# ---------------------------------------------------------------------------------------------- drivable


@pytest.mark.parametrize("name", ["figure_eight.csv", "circle.csv", "straight.csv", "slalom.csv"])
def test_shipped_paths_start_at_the_origin_and_are_drivable(name: str, robot: RobotFile) -> None:
    path = shipped(name)
    start = path.at(0.0)
    assert math.hypot(start.x, start.y) < 0.001
    assert abs(start.heading) < 0.005
    assert path.closed == (name in ("figure_eight.csv", "circle.csv"))
    assert check_drivable(path, robot, 0.4) == []


def test_figure_eight_has_the_published_size() -> None:
    path = shipped("figure_eight.csv")
    turned = math.atan2(2.2, 3.0)
    x = path.x * math.cos(turned) - path.y * math.sin(turned)
    y = path.x * math.sin(turned) + path.y * math.cos(turned)
    assert np.ptp(x) == pytest.approx(6.0, abs=0.005)
    assert np.ptp(y) == pytest.approx(2.2, abs=0.005)


def test_too_sharp_a_curve_is_named_with_its_place(robot: RobotFile) -> None:
    angle = np.linspace(0.0, math.pi / 2, 60)
    lead = np.arange(0.0, 1.0, 0.05)
    x = np.concatenate([lead, 1 + 0.25 * np.sin(angle), np.full(20, 1.25)])
    y = np.concatenate([0 * lead, 0.25 - 0.25 * np.cos(angle), 0.3 + lead])
    problems = check_drivable(path_from_points(x, y, smoothing=0.05), robot, 0.01)
    assert len(problems) == 1
    assert "possible 3.09 1/m (60 deg" in problems[0]
    assert "too sharp at 1." in problems[0]


def test_too_fast_for_the_steering_says_how_fast_is_possible(robot: RobotFile) -> None:
    path = shipped("slalom.csv")
    assert check_drivable(path, robot, 0.55) == []
    (problem,) = check_drivable(path, robot, 0.7)
    assert "possible 33 deg/s; drive at most 0.57 m/s" in problem
    slow = path_from_points(path.x, path.y, speed=np.full(len(path.x), 0.3))
    assert check_drivable(slow, robot, 0.7) == []


# ---------------------------------------------------------------------------------------------- the rest of a path


def wave() -> Path:
    """Open, with a speed at every point."""
    x = np.linspace(0.0, 6.0, 61)
    return path_from_points(x, 0.3 * np.sin(2 * x), speed=0.2 + 0.02 * x)


def ring(laps: int = 1) -> Path:
    angles = np.linspace(0.0, math.tau, 80, endpoint=False)
    points = 1.5 * np.sin(angles), 1.0 - np.cos(angles)
    return path_from_points(*points, speed=0.3 + 0.1 * np.sin(angles)).with_laps(laps)


def assert_same_point(rest: PathPoint, whole: PathPoint) -> None:
    """Halfway between two samples rounding decides from which of them a point is reached: 1 um apart at most."""
    assert (rest.x, rest.y) == pytest.approx((whole.x, whole.y), abs=1e-6)
    assert math.remainder(rest.heading - whole.heading, math.tau) == pytest.approx(0.0, abs=1e-4)
    assert rest.curvature == pytest.approx(whole.curvature, abs=1e-2)


@pytest.mark.parametrize("path", [wave(), ring(), ring(3)], ids=["open", "lap", "three laps"])
@pytest.mark.parametrize("share", [0.001, 0.2, 0.5, 0.9, 0.999])
def test_the_rest_of_a_path_is_the_same_curve_to_the_same_end(path: Path, share: float) -> None:
    rest = path.rest(share * path.length)
    begin = path.length - rest.length

    assert begin == pytest.approx(share * path.length, abs=path.spacing)
    assert begin <= share * path.length + 1e-9
    assert rest.closed == path.closed
    for distance in np.linspace(0.0, rest.length, 57):
        assert_same_point(rest.at(float(distance)), path.at(float(begin + distance)))
        assert rest.speed_at(float(distance)) == pytest.approx(path.speed_at(float(begin + distance)), abs=2e-3)
        point = path.at(float(begin + distance))
        beside = rest.project(
            point.x - 0.05 * math.sin(point.heading), point.y + 0.05 * math.cos(point.heading), distance
        )
        assert beside.cross_track == pytest.approx(0.05, abs=1e-4)
        assert beside.arc_length == pytest.approx(distance, abs=1e-3)


@pytest.mark.parametrize("path", [wave(), ring(3)], ids=["open", "laps"])
def test_samples_of_the_rest_are_samples_of_the_path(path: Path) -> None:
    rest = path.rest(0.7 * path.length / path.laps)
    first = round((path.length - rest.length) / path.spacing)

    count = len(path.x) - first
    assert np.array_equal(rest.x[:count], path.x[first:])
    assert np.array_equal(rest.y[:count], path.y[first:])
    assert np.array_equal(rest.heading[:count], path.heading[first:])
    assert np.all(np.abs(np.diff(rest.heading)) < 0.1)  # continuous, also over the seam
    assert rest.x[0] == (rest.x[-1] if path.closed else path.x[first])


def test_the_rest_of_laps_counts_those_that_are_left() -> None:
    path = ring(5)
    lap = path.length / 5

    assert [path.rest(distance * lap).laps for distance in (0.5, 1.5, 4.5)] == [5, 4, 1]
    assert path.rest(2.25 * lap).length == pytest.approx(2.75 * lap, abs=path.spacing)


def test_the_rest_of_a_rest_is_the_rest() -> None:
    for path in (wave(), ring(3)):
        once = path.rest(0.6 * path.length)
        twice = path.rest(0.25 * path.length)
        twice = twice.rest(0.6 * path.length - (path.length - twice.length))
        assert twice.length == pytest.approx(once.length, abs=path.spacing + 1e-9)
        assert_same_point(twice.at(twice.length), once.at(once.length))
        assert_same_point(twice.at(0.5), once.at(once.length - twice.length + 0.5))


@pytest.mark.parametrize("distance", [0.0, -0.4, 0.01])
def test_nothing_driven_leaves_the_path_itself(distance: float) -> None:
    path = wave()
    assert path.rest(distance) is path


@pytest.mark.parametrize("path", [wave(), ring(2)], ids=["open", "laps"])
@pytest.mark.parametrize("beyond", [0.0, 0.3])
def test_of_a_path_that_is_driven_the_last_piece_is_left(path: Path, beyond: float) -> None:
    rest = path.rest(path.length + beyond)

    assert rest.length == pytest.approx(path.spacing)
    assert_same_point(rest.at(rest.length), path.at(path.length))
