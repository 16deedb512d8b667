"""`artemis report` on runs made by hand: circles, of which the true poses turn a little away."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import synthetic_run

from artemis.commands.report import report, report_with
from artemis.errors import ConfigError
from artemis.motion.comparison import compare
from artemis.motion.truth import truth_from
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.report import truth_charts, truth_figures
from artemis.report.figures import style
from artemis.report.series import read_series
from artemis.report.trajectories import estimated_trajectory, true_trajectory
from artemis.values import Pose


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    synthetic_run.record(folder / "recording.mcap", synthetic_run.run(hz=25.0))
    return folder


@pytest.fixture(scope="module")
def tum(run: Path) -> str:
    """The run's true poses, as exported."""
    report(run, None, None, None, False, "tum")
    return (run / "true.tum").read_text()


@pytest.fixture(scope="module")
def real_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that does not know its true poses."""
    folder = tmp_path_factory.mktemp("real")
    recorder = Recorder(folder / "recording.mcap", synthetic_run.provenance(), threaded=False)
    for each in islice(synthetic_run.run(hz=25.0), 200):
        recorder.observe(each.tick, each.frames)
    recorder.close()
    return folder


def rows(text: str) -> dict[str, str]:
    """What was printed: name and value."""
    return {line[:12].strip(): line[14:] for line in text.splitlines() if line[12:14] == "  "}


def test_the_trajectories_are_written_as_tum(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report(run, None, None, None, False, "tum")

    series = read_series(Recording(run))
    true = true_trajectory(series)
    assert true is not None
    said = capsys.readouterr().out
    for name, expected in (("estimated.tum", estimated_trajectory(series)), ("true.tum", true)):
        found = truth_from((run / name).read_text(), name)
        np.testing.assert_allclose(found.time, expected.time, atol=1e-9)
        np.testing.assert_allclose(found.poses, expected.poses, atol=1e-8)
        assert f"written       {run / name}\n" in said


def test_a_real_run_writes_what_it_knows(real_run: Path) -> None:
    report(real_run, None, None, None, False, "tum")

    assert (real_run / "estimated.tum").exists()
    assert not (real_run / "true.tum").exists()


def test_a_simulated_run_is_compared_with_its_own_truth(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report(run, "simulation", None, None, False, None)

    said = rows(capsys.readouterr().out)
    series = read_series(Recording(run))
    end = 1000 * math.hypot(*(series.estimated - series.true)[-1, :2])
    assert said["clock"] == "the run's own"
    assert said["alignment"] == "none: both in one frame"
    assert said["place [mm]"].endswith(f"at the end {end:.1f}")
    assert float(said["over 5 m"].split()[-2]) == pytest.approx(math.degrees(0.002), abs=0.02)
    page = (run / "report.html").read_text()
    assert said["place [mm]"] in page
    assert [page.index(f"<h2>{title}</h2>") for title in ("Truth", "Path and its error", "Errors", "Relative errors")]


def test_a_truth_is_taken_from_a_file(run: Path, tum: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "truth.txt.gz"
    file.write_bytes(gzip.compress(tum.encode()))
    report(run, "simulation", None, None, False, None)
    by_itself = rows(capsys.readouterr().out)

    report(run, str(file), "none", None, True, None)

    from_file = rows(capsys.readouterr().out)
    assert from_file.pop("truth").startswith(f"{file}: ")
    assert from_file == {name: text for name, text in by_itself.items() if name != "truth"}


def test_the_best_fit_is_the_default_for_files(
    run: Path, tum: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "truth.tum").write_text(tum)

    report(run, str(tmp_path / "truth.tum"), None, "0.2,-0.1,90", True, None)

    said = rows(capsys.readouterr().out)
    assert said["alignment"].startswith("best fit of all places: odom is at x ")
    assert said["point"] == "0.2 m ahead and -0.1 m left of the rear axle's centre, turned by 90 deg"


def test_places_alone_say_what_they_do_not_tell(
    run: Path, tum: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = truth_from(tum, "true.tum")
    lines = [f"{time},{x},{y}" for time, (x, y, _) in zip(found.time, found.poses, strict=True)]
    (tmp_path / "truth.csv").write_text("\n".join(["time_s,x_m,y_m", *lines]))

    report(run, str(tmp_path / "truth.csv"), None, None, True, None)

    said = rows(capsys.readouterr().out)
    assert said["relative"] == "not known: the truth knows no heading"
    assert not any(name.startswith(("heading", "over")) for name in said)
    assert "Relative errors" not in (run / "report.html").read_text()


@pytest.mark.parametrize(
    ("truth", "align", "sensor", "same_clock", "export", "problem"),
    [
        (None, "best", None, False, None, "are about a truth: name it with --truth"),
        (None, None, "1,2", False, None, "are about a truth"),
        (None, None, None, True, None, "are about a truth"),
        ("simulation", "worst", None, False, None, "--align worst: expected none, start, best"),
        ("simulation", None, "1", False, None, "--sensor 1: expected X,Y or X,Y,DEG"),
        ("simulation", None, "1,nan", False, None, "--sensor 1,nan: expected"),
        ("simulation", None, "1,2,x", False, None, "--sensor 1,2,x: expected"),
        (None, None, None, False, "kitti", "--export kitti: expected tum"),
        ("nowhere.csv", None, None, False, None, "nowhere.csv: file not found"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    run: Path,
    truth: str | None,
    align: str | None,
    sensor: str | None,
    same_clock: bool,
    export: str | None,
    problem: str,
) -> None:
    with pytest.raises(ConfigError) as caught:
        report(run, truth, align, sensor, same_clock, export)

    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"\x1f\x8b but not packed", "cannot be unpacked"),
        (gzip.compress(b"time_s,x_m,y_m\n" * 100, mtime=0)[:-9], "cannot be unpacked"),
        (b"time_s,x_m,y_m\n0,\xff,0\n", ":2:3: byte 0xff is not UTF-8"),
        (b"time_s,x_m,y_m\n900,0,0\n901,1,0\n", "the truth spans 900.00 to 901.00 s by the run's clock, the run"),
        (b"time_s,x_m\n0,0\n", ":1:1: expected the columns time, x, y; no y"),
    ],
)
def test_a_damaged_truth_is_refused_by_its_name(run: Path, tmp_path: Path, content: bytes, problem: str) -> None:
    file = tmp_path / "truth.csv"
    file.write_bytes(content)

    with pytest.raises(ConfigError) as caught:
        report(run, str(file), None, None, True, None)

    assert str(caught.value).startswith(str(file))
    assert problem in str(caught.value)


def test_a_real_run_has_no_truth_of_its_own(real_run: Path) -> None:
    with pytest.raises(ConfigError, match="the run was not simulated; name a file"):
        report(real_run, "simulation", None, None, False, None)


def test_poses_count_since_the_odometry_got_its_origin(run: Path) -> None:
    series = read_series(Recording(run))

    assert estimated_trajectory(replace(series, placed=100)).time[0] == series.moment[100]
    with pytest.raises(ConfigError, match="the run ended before the odometry got its origin"):
        estimated_trajectory(replace(series, placed=len(series.time)))


def test_lines_are_broken_where_nothing_is_known(run: Path, tum: str) -> None:
    lines = [line for line in tum.splitlines() if line[0] != "#" and not 8.0 < float(line.split()[0]) < 12.0]
    series = read_series(Recording(run))
    truth = truth_from("\n".join(lines), "truth.tum")
    comparison = compare(estimated_trajectory(series), truth, alignment="none", sensor=Pose(), same_clock=True)

    with style():
        (pieces,) = truth_figures.error_map(comparison).axes[0].collections

    lengths = [np.hypot(*np.diff(np.asarray(path.vertices), axis=0)[0]) for path in pieces.get_paths()]
    assert max(lengths) < 0.1
    for chart in truth_charts.error_charts(comparison):
        assert np.isnan(chart.lines[0].values).sum() == 1


@pytest.mark.parametrize("other", [False, True])
def test_a_damaged_recording_is_reported(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], other: bool
) -> None:
    recording = (run / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(recording[: len(recording) // 2])

    if other:
        report_with(run, tmp_path, "start")
    else:
        report(tmp_path, None, None, None, False, None)
    out = capsys.readouterr().out

    (line,) = [line for line in out.splitlines() if line.startswith(f"{tmp_path}: ")]
    assert line.startswith(f"{tmp_path}: the recording is not whole: the file is cut off; its last readable tick is ")
