"""The default follower on the frame-level stack: the true error on each path, by odometry alone."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path as FilePath

import numpy as np
import pytest
from rig import MISSIONS, Run, run
from scipy.spatial import cKDTree

from artemis.motion.arrays import Array
from artemis.motion.path import path_from_csv
from artemis.recording.mcap_reader import Recording
from artemis.report.summary import Summary, summary
from artemis.values import Mode

pytestmark = pytest.mark.slow

ran = cache(lambda name: run(MISSIONS / f"follow_{name}.yaml", longest=120.0))


def true_errors(seen: Run, file: str) -> Array:
    """Distance of the true rear axle from the points of a path file [m], and where it is along x, shape (n, 2)."""
    path = path_from_csv((MISSIONS / "paths" / file).read_text(), file, smoothing=0.0, spacing=0.005)
    origin = seen.first(lambda s: s.tick.wish.reset_pose).pose
    cos, sin = math.cos(origin.heading), math.sin(origin.heading)
    rows, near = [], 0.0
    for tick in seen.in_mode(Mode.FOLLOW):
        x, y = tick.pose.x - origin.x, tick.pose.y - origin.y
        x, y = x * cos + y * sin, y * cos - x * sin
        found = path.project(x, y, near=near, window=0.3)
        near = found.arc_length
        rows.append((math.hypot(x - found.x, y - found.y), found.arc_length))
    return np.array(rows)


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.slow
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "file", "mean", "most"),
    [
        ("figure_eight", "figure_eight.csv", 0.004, 0.008),
        ("circle", "circle.csv", 0.004, 0.008),
        ("slalom", "slalom.csv", 0.006, 0.012),
        ("corner", "corner.csv", 0.025, 0.115),
    ],
)
def test_on_its_path(name: str, file: str, mean: float, most: float) -> None:
    seen = ran(name)
    assert (seen.status, seen.fault_ids) == (0, [])
    errors = true_errors(seen, file)[:, 0]
    assert rms(errors) <= mean
    assert errors.max() <= most
    assert max(tick.tick.set_points.speed for tick in seen.in_mode(Mode.FOLLOW)) > 0.6


@pytest.mark.slow
def test_onto_a_path_beside_it() -> None:
    seen = ran("straight")
    assert (seen.status, seen.fault_ids) == (0, [])
    errors = true_errors(seen, "beside.csv")
    outside = errors[errors[:, 0] > 0.02, 1]
    assert errors[0, 0] == pytest.approx(0.5, abs=0.01)
    assert outside.max() <= 2.5
    assert errors[errors[:, 1] > 3.0, 0].max() < 0.01


@pytest.mark.exhaustive  # six minutes of driving
def test_a_path_that_jitters_is_driven_as_it_was_meant(tmp_path: FilePath) -> None:
    """200 m with a point each 5 cm and 5 mm of noise; nothing that the robot measures is wrong."""
    arc = np.arange(0.0, 200.0, 0.05)
    heading = 0.05 * np.cumsum(0.4 * np.sin(arc / 4) + 0.15 * np.sin(arc / 1.9 + 1))
    meant = 0.05 * np.cumsum([np.cos(heading), np.sin(heading)], axis=1).T
    given = meant + np.random.default_rng(5).normal(0.0, 0.005, meant.shape)
    np.savetxt(tmp_path / "hand.csv", given, fmt="%.5f", delimiter=",", header="x,y", comments="")
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    words = (MISSIONS / "follow_straight.yaml").read_text()
    head = words[: words.index("robot:")]
    (tmp_path / "hand.yaml").write_text(
        f"{head}robot: robot.yaml\nbus: simulation\nsteps:\n  - calibrate: {{steering: from_potentiometers}}\n"
        "  - follow: {path: hand.csv, follower: {speed_m_s: 0.6}}\n"
    )
    seen = run(tmp_path / "hand.yaml", longest=500.0)
    assert (seen.status, seen.fault_ids) == (0, [])
    followed = seen.in_mode(Mode.FOLLOW)
    assert len(followed) / 50 < 1.1 * 200.0 / 0.6
    believed = np.array([(tick.tick.snapshot.pose.pose.x, tick.tick.snapshot.pose.pose.y) for tick in followed])
    line = np.array([np.interp(np.arange(0, len(meant), 0.1), np.arange(len(meant)), column) for column in meant.T]).T
    assert rms(cKDTree(line).query(believed)[0]) < 0.003


def summary_of(name: str) -> Summary:
    outcome = ran(name).outcome
    assert outcome is not None
    return summary(Recording(outcome.run.path))


def test_the_corner_that_was_given_is_scored_too() -> None:
    found = summary_of("corner")
    assert found.cross_track_max is not None
    assert found.true_given_rms is not None
    assert found.true_given_max is not None
    assert found.cross_track_max < 0.01
    assert 0.01 < found.true_given_rms < 0.025
    assert 0.07 < found.true_given_max < 0.115
    assert summary_of("slalom").true_given_rms is None
