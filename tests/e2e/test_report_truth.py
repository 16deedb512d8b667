"""A run, its true poses as a tracker would tell them, and how far `artemis report` finds the odometry from these."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import artemis_here, only_run, write_mission

from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import as_tum, truth_from
from artemis.values import Pose

WRONG = "simulation: {true_robot: {wheel_scale_left: 1.01, wheel_scale_right: 1.01, steering_zero_left_deg: 0.8}}\n"
SENSOR = Pose(x=0.3, y=-0.1, heading=math.radians(20.0))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Along 5 m of a wave."""
    folder = tmp_path_factory.mktemp("truth")
    mission = write_mission(folder, more=WRONG)
    wave = "".join(f"{x:.2f},{0.3 * (1 - math.cos(1.5 * x)):.4f}\n" for x in np.arange(0.0, 5.0, 0.05))
    (folder / "paths/line.csv").write_text("x_m,y_m\n" + wave)
    done = artemis_here("run", mission)
    assert done.returncode == 0, done.stderr
    return only_run(folder)


def numbers(text: str, name: str) -> list[float]:
    """The numbers in the row that begins with `name`."""
    (row,) = (line[14:] for line in text.splitlines() if line[:12].strip() == name)
    return [float(number) for number in re.findall(r"[+-]?\d+(?:\.\d+)?", row)]


@pytest.mark.exhaustive
def test_a_tracker_with_another_clock_finds_what_the_simulation_knows(run: Path, tmp_path: Path) -> None:
    known = artemis_here("report", run, "--truth", "simulation", "--export", "tum", "--align", "best")
    assert known.returncode == 0, known.stderr
    true = truth_from((run / "true.tum").read_text(), "true.tum")
    random = np.random.default_rng(3)
    time = np.arange(true.time[0] + 1.0, true.time[-1], 1 / 33.0) + random.uniform(-0.01, 0.01)
    noise = random.normal(size=(len(time), 3)) * 0.001
    poses = true.of_point(SENSOR).placed(Pose(x=9.0, y=-4.0, heading=2.2)).at(time) + noise
    tracker = Trajectory(time=1000.0 + time * 1.0004, poses=poses)
    (tmp_path / "tracker.tum").write_text(as_tum(tracker))

    found = artemis_here("report", run, "--truth", tmp_path / "tracker.tum", "--sensor", "0.3,-0.1,20")

    assert found.returncode == 0, found.stderr
    offset, uncertainty, *_ = numbers(found.stdout, "clock")
    middle = float(np.mean(true.time[[0, -1]]))
    assert offset == pytest.approx(1000.0 + 4e-4 * middle, abs=0.012)
    assert uncertainty < 12
    np.testing.assert_allclose(numbers(found.stdout, "place [mm]"), numbers(known.stdout, "place [mm]"), atol=12.0)
    percent, _, turn = numbers(found.stdout, "over 2 m")
    expected, _, expected_turn = numbers(known.stdout, "over 2 m")
    assert percent == pytest.approx(expected, abs=0.3)
    assert turn == pytest.approx(expected_turn, abs=0.1)
    assert "<h2>Truth</h2>" in (run / "report.html").read_text()


def test_what_cannot_be_compared_is_refused_in_words(run: Path, tmp_path: Path) -> None:
    circle = tmp_path / "circle.csv"
    rows = (f"{0.05 * i:.2f},{math.cos(0.01 * i):.5f},{math.sin(0.01 * i):.5f}\n" for i in range(1200))
    circle.write_text("time_s,x_m,y_m\n" + "".join(rows))

    refused = artemis_here("report", run, "--truth", circle)

    assert refused.returncode == 2
    assert refused.stdout == ""
    assert refused.stderr.startswith(f"{circle}: ")
