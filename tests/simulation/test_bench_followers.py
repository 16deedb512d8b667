"""`artemis bench followers`: tables, CSV and figures of two followers on one course, and the whole stack."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from unittest.mock import patch

import pytest

from artemis import cli
from artemis.testing.contracts import ROBOT
from artemis_lab.bench.cases import CASES
from artemis_lab.bench.followers import FRAMES, Task, run
from artemis_lab.commands import bench_followers

pytestmark = pytest.mark.slow
BENCH = ["artemis", "bench", "followers"]


def bench(*arguments: str | Path) -> int:
    """The command's exit status."""
    with patch.object(sys, "argv", [*BENCH, *map(str, arguments)]), pytest.raises(SystemExit) as ended:
        cli.main()
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.exhaustive
def test_two_followers_on_one_course(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_followers, "SIZES", (1000,))
    chosen = ["--follower", "stanley", "--follower", "pure_pursuit", "--course", "circle", "--random", "1"]
    assert bench(*chosen, "--no-frames", "--output", tmp_path / "out") == 0
    shown = capsys.readouterr().out
    text = (tmp_path / "out" / "followers.txt").read_text()
    assert text in shown
    assert "skipped, no checkout is given" in text
    (line,) = [line for line in text.splitlines() if line.startswith("stanley ")][:1]
    assert "67.6/80.0" in line
    rows = list(csv.DictReader((tmp_path / "out" / "followers.csv").read_text().splitlines()))
    assert {row["follower"] for row in rows} == {"stanley", "pure_pursuit"}
    assert len(rows) == 2 * (len(CASES) + 1)
    assert "| stanley |" in (tmp_path / "out" / "followers.md").read_text()
    assert (tmp_path / "out" / "circle.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in (tmp_path / "out").glob("*.png")) == ["circle.png"]


def test_the_whole_stack_is_judged_by_the_true_pose(tmp_path: Path) -> None:
    row = run(Task(follower="stanley", course="circle", case=FRAMES, robot=ROBOT, seed=1))
    assert row.problem == ""
    assert row.figures is not None
    assert row.figures.steady_rms == pytest.approx(0.080, abs=0.003)


def test_a_mission_that_is_refused_is_a_row_with_its_reason() -> None:
    slow = ROBOT.model_copy(update={"limits": ROBOT.limits.model_copy(update={"steering_deg": 10.0})})
    row = run(Task(follower="stanley", course="circle", case=FRAMES, robot=slow, seed=1))
    assert row.figures is None
    assert row.problem.startswith("refused: ")
    assert "too sharp" in row.problem


def test_unknown_names_are_refused_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench("--follower", "stanly", "--course", "square") == cli.REFUSED
    assert "no follower 'stanly'; nearest is 'stanley'" in capsys.readouterr().err
    assert bench("--course", "square") == cli.REFUSED
    assert "no course 'square'" in capsys.readouterr().err
