from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest

from artemis.commands.calibrate_odometry import calibrate_closing, calibrate_with_truth
from artemis.errors import CalibrationError, ConfigError

DATA = Path(__file__).parents[1] / "data" / "odometry"
MACHINE = DATA / "tricycle.yaml"
RUNS = [DATA / f"140120211415_run-0{number}.csv.gz" for number in (1, 2)]
CHECK = [DATA / f"1401202114{number}.csv.gz" for number in ("40_run-02", "54_run-01")]
ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"


def cart(folder: Path) -> Path:
    file = folder / "cart.yaml"
    file.write_text(
        "machine: cart\ncolumns: [time, distance, steering]\ncounts: running\nmetres_per_count: 0.001\n"
        "radians_per_steering_unit: 0.0174532925\nwheelbase_m: 1.0\n"
    )
    return file


def loop(folder: Path, side: int, zero: float = 1.0, wheelbase: float = 1.03) -> Path:
    """A table of a cart that truly drives a circle of 2 m and counts with a false zero [deg] and wheelbase."""
    file = folder / f"loop{side}.csv"
    angle = side * np.degrees(np.arctan(wheelbase / 2.0)) + zero
    distance = 2 * pi * np.hypot(2.0, wheelbase)
    rows = [f"{0.1 * n:.1f},{1000 * distance * n / 400:.3f},{angle:.6f}" for n in range(401)]
    file.write_text("\n".join(rows))
    return file


@pytest.mark.slow
def test_tables_are_fitted_checked_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibrate_with_truth(RUNS, [], MACHINE, CHECK, tmp_path, None)

    told = capsys.readouterr().out
    lines = {line.partition("  ")[0]: line.split() for line in told.splitlines()}
    assert 0.9 < float(lines["steering zero [deg]"][4]) < 1.4
    for name in (each.name for each in CHECK):
        nominal, fitted = (float(lines[f"check {name}, {odometry}"][6]) for odometry in ("nominal", "fitted"))
        assert fitted < min(45.0, 0.5 * nominal)
    page = (tmp_path / "calibration.html").read_text()
    assert page.count("<svg") == 3
    assert "Not estimated (nominal value kept)" in page


@pytest.mark.exhaustive
def test_a_truth_file_stands_for_the_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables, truths = [], []
    for side in (1, -1):
        tables.append(loop(tmp_path, side))
        truths.append(str(tmp_path / f"truth{side}.csv"))
        turn = np.linspace(0.0, 2 * pi, 401)
        rows = [
            f"{0.1 * n:.1f},{2 * sin(a):.6f},{side * 2 * (1 - cos(a)):.6f},{side * a:.6f}"
            for n, a in enumerate(turn.tolist())
        ]
        Path(truths[-1]).write_text("\n".join(["time_s,x_m,y_m,heading_rad", *rows]))

    calibrate_with_truth(tables, truths, cart(tmp_path), [], tmp_path / "new", None)

    lines = {line.partition("  ")[0]: line.split() for line in capsys.readouterr().out.splitlines()}
    assert float(lines["steering zero [deg]"][4]) == pytest.approx(1.0, abs=0.05)
    assert float(lines["wheelbase [m]"][3]) == pytest.approx(1.03, abs=0.03)
    assert (tmp_path / "new" / "calibration.html").exists()


def test_loops_that_return_to_their_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [loop(tmp_path, 1), loop(tmp_path, -1)]

    calibrate_closing(runs, None, cart(tmp_path), None, None)
    told = capsys.readouterr().out

    lines = {line.partition("  ")[0]: line.split() for line in told.splitlines()}
    assert float(lines["steering zero [deg]"][4]) == pytest.approx(1.0, abs=0.15)
    assert "scale" in told.partition("Not estimated (nominal value kept)")[2]
    assert (tmp_path / "calibration.html").read_text().count("<svg") == 2


def test_measured_ends_by_their_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [loop(tmp_path, 1), loop(tmp_path, -1)]
    ends = tmp_path / "ends.csv"
    ends.write_text("run,x_m,y_m,heading_deg\n1,0,0,0\n2,0,0,0\n")

    calibrate_closing(runs, ends, cart(tmp_path), None, None)

    assert "loop-1.csv" in capsys.readouterr().out
    ends.write_text("run,x_m,y_m,heading_deg\n1,0,0,0\n")
    with pytest.raises(ConfigError, match=r"ends.csv:1:1: run: expected the numbers 1 to 2"):
        calibrate_closing(runs, ends, cart(tmp_path), None, None)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (-1.0, "the sign of the steering angle"),
        (57.29578, "the steering angles are in degrees, but are declared as radians"),
        (0.01745329, "the steering angles are in radians, but are declared as degrees"),
    ],
)
def test_a_wrong_sign_or_unit_is_refused_by_name(unit: float, words: str, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    key = "radians_per_steering_unit: "
    wrong.write_text(MACHINE.read_text().replace(f"{key}1.0", f"{key}{unit}"))

    with pytest.raises(CalibrationError, match=words):
        calibrate_with_truth(RUNS, [], wrong, [], tmp_path, None)

    assert not (tmp_path / "calibration.html").exists()


@pytest.mark.slow
def test_the_truth_of_another_run_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    rows = [f"{0.05 * n:.2f},{0.1 * cos(0.05 * n):.5f},{0.1 * sin(0.13 * n):.5f},0.0" for n in range(1800)]
    other.write_text("\n".join(["time_s,x_m,y_m,heading_rad", *rows]))

    with pytest.raises(CalibrationError, match="does not explain the runs"):
        calibrate_with_truth(RUNS[:1], [str(other)], MACHINE, [], tmp_path, None, same_clock=True)


def test_what_does_not_fit_together_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="2 for 1 runs"):
        calibrate_with_truth(RUNS[:1], ["a.csv", "b.csv"], MACHINE, [], tmp_path, None)
    with pytest.raises(ConfigError, match="no robot file"):
        calibrate_with_truth(RUNS[:1], [], MACHINE, [], tmp_path, ROBOT)
    with pytest.raises(ConfigError, match="no true poses; give --truth"):
        calibrate_with_truth([loop(tmp_path, 1)], [], cart(tmp_path), [], tmp_path, None)
    broken = tmp_path / "broken.csv.gz"
    broken.write_bytes(RUNS[0].read_bytes()[:1000])
    with pytest.raises(ConfigError, match="cannot be unpacked"):
        calibrate_with_truth([broken], [], MACHINE, [], tmp_path, None)
