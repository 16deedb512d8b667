"""The error between a map's motions and verified ones."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.mapping.se2 import Array, between, compose
from artemis_lab.bench.relations import ErrorSize, Relations, errors, read_relations
from artemis_lab.commands.bench_slam import LogDrive, measure

TIMES: Array = np.linspace(0.0, 14.5, 30)
POSES: Array = np.cumsum(np.tile([0.1, 0.02, 0.05], (30, 1)), axis=0)
FIRST, SECOND = np.arange(0, 20), np.arange(5, 25)
VERIFIED = Relations(first=TIMES[FIRST], second=TIMES[SECOND], motion=between(POSES[FIRST], POSES[SECOND]))


def test_the_truth_has_no_error_in_any_frame_and_order() -> None:
    moved = compose([5.0, -3.0, 2.0], POSES)
    metres, degrees = errors(VERIFIED, TIMES[::-1], moved[::-1])
    assert len(metres) == 20
    assert metres.max() < 1e-9
    assert degrees.max() < 1e-7


def test_a_known_step_is_the_error_of_the_relations_across_it() -> None:
    wrong = POSES.copy()
    wrong[15:] = compose(compose(POSES[15], [0.3, 0.4, np.radians(2)]), between(POSES[15], POSES[15:]))
    metres, degrees = errors(VERIFIED, TIMES, wrong)
    across = (FIRST < 15) & (SECOND >= 15)
    assert metres[~across].max() < 1e-9
    assert degrees[across] == pytest.approx(2.0)
    size = ErrorSize.of(degrees)
    assert size.max == pytest.approx(2.0)
    assert size.mean == pytest.approx(2 * across.mean())
    assert size.square_mean == pytest.approx(4 * across.mean())


def test_poses_are_interpolated_and_gaps_left_out() -> None:
    half = Relations(first=np.array([0.25]), second=np.array([0.75]), motion=np.array([[0.1, 0.0, 0.0]]))
    straight = np.c_[np.arange(4) * 0.1, np.zeros((4, 2))]
    assert errors(half, np.linspace(0.0, 1.5, 4), straight)[0] == pytest.approx([0.0])
    assert len(errors(half, np.linspace(0.0, 1.5, 4) + 100, straight)[0]) == 0


def test_relations_beyond_the_last_pose_can_be_left_out() -> None:
    """A pose that is seconds old would be taken for that of their end, and the robot may have turned since."""
    first_half = TIMES <= 6.0
    metres, degrees = errors(VERIFIED, TIMES[first_half], POSES[first_half])
    assert degrees.max() > 10
    metres, degrees = errors(VERIFIED.until(6.0), TIMES[first_half], POSES[first_half])
    assert len(metres) == 8
    assert degrees.max() < 1e-7


def test_relations_are_read(tmp_path: Path) -> None:
    file = tmp_path / "a.relations.gz"
    with gzip.open(file, "wt") as out:
        out.write("# a comment\n1.5 2.5 0.1 0.2 9 9 9 0.3\n\n")
    read = read_relations(file)
    assert (read.first[0], read.second[0]) == (1.5, 2.5)
    assert read.motion.tolist() == [[0.1, 0.2, 0.3]]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1 2 3\n", ":1: 3 fields; a relation has 8"),
        ("\n1 2 3 4 5 6 7 x\n", ":2: could not convert"),
        ("# nothing\n", "no relations"),
    ],
)
def test_damaged_relations_are_refused(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "a.relations").write_text(text)
    with pytest.raises(ConfigError, match=problem):
        read_relations(tmp_path / "a.relations")


@pytest.mark.exhaustive
def test_a_log_is_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = "FLASER 5 2.0 2.0 2.0 2.0 2.0 0 0 0 0 0 0 {time} host 0\n"
    (tmp_path / "a.clf").write_text("".join(line.format(time=float(k)) for k in range(30)))
    (tmp_path / "a.relations").write_text("1 2 0 0 0 0 0 0\n")
    measure(tmp_path / "a.clf", tmp_path / "a.relations", LogDrive(backwards=True, scale=0.8, turn_deg_m=10))
    assert "relations: 1 of 1" in capsys.readouterr().out
    (tmp_path / "a.relations").write_text("1001 1002 0 0 0 0 0 0\n")
    with pytest.raises(ConfigError, match="no relation of this log"):
        measure(tmp_path / "a.clf", tmp_path / "a.relations", LogDrive(odometry=False))


FOLDER = os.environ.get("ARTEMIS_SLAM_DATA", "")


@pytest.mark.skipif(not FOLDER, reason="ARTEMIS_SLAM_DATA names no folder with intel.clf.gz and intel.relations.gz")
def test_the_intel_map_is_better_than_published_ones(capsys: pytest.CaptureFixture[str]) -> None:
    measure(Path(FOLDER) / "intel.clf.gz", Path(FOLDER) / "intel.relations.gz", LogDrive())
    found = [line.split() for line in capsys.readouterr().out.splitlines() if "median" in line]
    metres, degrees = float(found[0][2]), float(found[1][2])
    assert metres <= 0.0157
    assert degrees <= 0.425
