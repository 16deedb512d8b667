"""Noise in the points of a path: found, told, smoothed away; and not found where there is none."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from scipy.spatial import cKDTree

from artemis.errors import ConfigError
from artemis.mission.loading import load_mission, load_model
from artemis.motion.arrays import Array
from artemis.motion.fitting import fitted
from artemis.motion.noise import noise_of
from artemis.motion.path import SMOOTHING, Path, path_from_points
from artemis.motion.path_points import distinct
from artemis.motion.route import Part, Route, route_from_csv
from artemis.motion.track import Track
from artemis.values import Pose
from artemis.vehicle import RobotFile

PATHS = FilePath(__file__).parents[2] / "missions/paths"


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return load_model(PATHS.parent / "robots/artemis.yaml", RobotFile)


def winding(spacing: float = 0.05, length: float = 100.0) -> tuple[Array, Array]:
    """A smooth curve that winds, with radii down to 1.8 m."""
    arc = np.arange(0.0, length, spacing)
    heading = np.cumsum(0.4 * np.sin(arc / 4) + 0.15 * np.sin(arc / 1.9 + 1)) * spacing
    return np.cumsum(np.cos(heading)) * spacing, np.cumsum(np.sin(heading)) * spacing


def jittering(points: tuple[Array, Array], deviation: float, seed: int = 5) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    x, y = (column + random.normal(0.0, deviation, len(column)) for column in points)
    return x, y


def text_of(x: Array, y: Array) -> str:
    return "x,y\n" + "".join(f"{a:.5f},{b:.5f}\n" for a, b in zip(x, y, strict=True))


def from_truth(path: Path, truth: tuple[Array, Array]) -> float:
    """Root mean square distance of a path from a curve [m]."""
    dense = np.linspace(0, len(truth[0]) - 1, 10 * len(truth[0]))
    line = np.column_stack([np.interp(dense, np.arange(len(column)), column) for column in truth])
    off = cKDTree(line).query(np.column_stack([path.x, path.y]))[0]
    return math.sqrt(float(np.mean(off**2)))


@pytest.mark.parametrize("deviation", [0.0003, 0.001, 0.005, 0.02])
@pytest.mark.parametrize("spacing", [0.02, 0.05, 0.1])
def test_the_noise_is_found(deviation: float, spacing: float) -> None:
    noise = noise_of(*jittering(winding(spacing), deviation))
    assert noise.deviation == pytest.approx(deviation, rel=0.25)


def test_noise_that_neighbours_share_is_found_farther_apart() -> None:
    x, y = winding()
    random = np.random.default_rng(1)
    drift = np.zeros(len(x))
    for index in range(1, len(x)):
        drift[index] = 0.7 * drift[index - 1] + random.normal(0.0, 0.005 * math.sqrt(1 - 0.7**2))
    noise = noise_of(x + drift[::-1], y + drift)
    assert noise.deviation == pytest.approx(0.004, rel=0.4)
    assert noise.apart > 0.09


@pytest.mark.parametrize(
    "points",
    [
        winding(),
        winding(0.3),
        tuple(np.round(winding(), 4)),
        (np.arange(0, 20, 0.5), 0.5 * np.sin(np.arange(0, 20, 0.5) * math.tau / 4)),  # a slalom drawn by hand
        (np.arange(0, 20, 0.5), 0.2 * (np.arange(40) % 2)),  # zigzag
        (np.cos(np.arange(0, 6, 0.15)) * 0.35, np.sin(np.arange(0, 6, 0.15)) * 0.35),
        (np.arange(5.0), np.array([0, 0.1, -0.1, 0.1, 0.0])),
        (np.append(np.arange(0, 4, 0.05), np.full(80, 4.0)), np.append(np.zeros(80), np.arange(0, 4, 0.05))),
    ],
)  # fmt: skip
def test_a_smooth_curve_has_none(points: tuple[Array, Array]) -> None:
    assert noise_of(*points).deviation == 0.0


@pytest.mark.parametrize("file", sorted(PATHS.glob("*.csv")), ids=lambda file: file.stem)
def test_the_paths_of_the_missions_stay_as_they_are(file: FilePath) -> None:
    for part in route_from_csv(file.read_text(), file.name).parts:
        drawn = part.path.drawn
        assert drawn is not None
        assert drawn.smoothing == SMOOTHING
        usual = path_from_points(*drawn.points.T, smoothing=SMOOTHING, closed=part.path.closed)
        if len(route_from_csv(file.read_text(), file.name).parts) == 1:
            np.testing.assert_allclose([part.path.x, part.path.y], [usual.x, usual.y], atol=1e-4)


@pytest.mark.parametrize(("deviation", "spacing"), [(0.005, 0.05), (0.005, 0.01), (0.002, 0.005), (0.01, 0.05)])
def test_a_noisy_path_becomes_the_smooth_one_that_was_meant(robot: RobotFile, deviation: float, spacing: float) -> None:
    truth = winding(spacing)
    route = route_from_csv(text_of(*jittering(truth, deviation)), "noisy.csv")
    (part,) = route.parts
    assert from_truth(part.path, truth) < max(0.003, 0.4 * deviation)
    fits, words = fitted(route, robot, 0.7, allow_slowdown=True)
    assert words[0].startswith("the points jitter by ")
    assert " mm RMS, at most " in words[0]
    ideal, _ = fitted(Route((Part(path=path_from_points(*truth)),)), robot, 0.7, allow_slowdown=True)
    assert fits.duration(0.7) < 1.1 * ideal.duration(0.7)
    assert route.problems(robot, 0.5) == []


def test_smoothed_noise_is_told_also_where_corners_may_be_rounded(robot: RobotFile) -> None:
    route = route_from_csv(text_of(*jittering(winding(0.05), 0.005)), "noisy.csv")
    told = [fitted(route, robot, 0.7, round_corners=rounds)[1] for rounds in (0.0, 0.15)]
    assert told[0]
    assert told[1][0] == told[0][0]


def test_smoothing_gives_way_to_the_shape_of_the_path() -> None:
    angle = np.arange(0.0, 5.5, 0.1)
    truth = 0.4 * np.cos(angle), 0.4 * np.sin(angle)
    path = path_from_points(*jittering(truth, 0.005))
    assert path.drawn is not None
    assert path.drawn.noise.deviation == pytest.approx(0.005, rel=0.5)
    assert path.drawn.smoothing < path.drawn.noise.wavelength(SMOOTHING)
    assert float(np.median(path.drawn.moved)) <= 2 * path.drawn.noise.deviation


def test_a_robot_that_stands_between_is_no_reversal() -> None:
    x, y = winding(0.01, 20.0)
    stands = np.concatenate([np.zeros(300, dtype=int), np.arange(1000), np.full(300, 1000), np.arange(1000, len(x))])
    noisy = jittering((x[stands], y[stands]), 0.003)
    route = route_from_csv(text_of(*noisy), "stands.csv")
    assert len(route.parts) == 1
    assert route.length == pytest.approx(20.0, abs=0.2)
    assert from_truth(route.parts[0].path, (x, y)) < 0.003


def test_what_is_averaged_keeps_its_place_in_the_file() -> None:
    x, y = jittering(winding(0.01, 20.0), 0.005)
    px, py, kept = distinct(x, y)
    assert len(px) == len(kept) < len(x) / 2
    assert np.hypot(px - x[kept], py - y[kept]).max() < 0.05


def test_what_a_noisy_localizer_recorded_is_followed_at_its_speed(robot: RobotFile) -> None:
    truth = winding(0.01, 40.0)
    x, y = jittering(truth, 0.005)
    heading = np.unwrap(np.arctan2(np.gradient(truth[1]), np.gradient(truth[0])))
    track = Track()
    for pose in zip(x.tolist(), y.tolist(), heading.tolist(), strict=True):
        track.see(Pose(x=pose[0], y=pose[1], heading=pose[2]), pressed=False)
    (part,) = track.route(robot, 0.5).parts
    assert part.path.length == pytest.approx(40.0, abs=0.2)
    assert from_truth(part.path, truth) < 0.004


def test_a_path_that_stays_too_sharp_is_refused_with_its_noise(robot: RobotFile, tmp_path: FilePath) -> None:
    (tmp_path / "robot.yaml").write_bytes((PATHS.parent / "robots/artemis.yaml").read_bytes())
    (tmp_path / "hand.csv").write_text(text_of(*jittering(winding(0.1), 0.05)))
    (tmp_path / "mission.yaml").write_text(
        "mission: noisy\nrobot: robot.yaml\nbus: simulation\nsteps:\n  - calibrate: {steering: from_potentiometers}\n"
        "  - follow: {path: hand.csv, follower: {speed_m_s: 0.7}}\n"
    )
    with pytest.raises(ConfigError, match=r"hand\.csv: the points jitter by [0-9.]+ mm: smoothed over"):
        load_mission(tmp_path / "mission.yaml")
