"""Tables of a bench from made-up rows; what goes wrong in a run is a row; the outside reference by a stand-in."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

import numpy as np
import pytest

from artemis.testing.contracts import ROBOT
from artemis_lab.bench import followers
from artemis_lab.bench.cases import CASES, CLEAN, NOISY, random_case
from artemis_lab.bench.followers import FRAMES, RANDOM, Measurement, Task, installed, run, tasks
from artemis_lab.bench.judge import Figures
from artemis_lab.bench.python_robotics import REFERENCES
from artemis_lab.bench.step_time import step_times, weaving_path
from artemis_lab.bench.tables import Grid, as_csv, grids, problems

FIGURES = Figures(
    rms=0.0123,
    max=0.2,
    steady_rms=0.004,
    steady_max=0.05,
    residual=0.001,
    settling_distance=math.inf,
    overshoot=0.0,
    time=13.25,
    steering_rate=0.5,
)


def task(name: str = "stanley", course: str = "circle", case: str = CLEAN, checkout: Path | None = None) -> Task:
    return Task(follower=name, course=course, case=case, robot=ROBOT, seed=1, checkout=checkout)


# ---------------------------------------------------------------------------------------------- tables


def test_a_grid_as_text_and_as_markdown() -> None:
    grid = Grid(title="Errors [mm]", head=["follower", "circle"], rows=[["one", "1.0"], ["another", "12.5"]])
    assert grid.text() == "Errors [mm]\n\nfollower  circle\none          1.0\nanother     12.5\n"
    lines = ["| follower | circle |", "| --- | --: |", "| one | 1.0 |", "| another | 12.5 |"]
    assert grid.markdown().splitlines() == ["Errors [mm]", "", *lines]


def test_tables_show_figures_and_the_kind_of_a_problem() -> None:
    rows = [
        Measurement(task=task(), figures=FIGURES),
        Measurement(task=task(case=NOISY), figures=None, problem="lost: 2.1 m from the course"),
        Measurement(task=task(course="corner"), figures=FIGURES),
        Measurement(task=task(case=FRAMES), figures=FIGURES),
        Measurement(task=task(case=RANDOM, course="random-1"), figures=FIGURES),
        Measurement(task=task(case=RANDOM, course="random-2"), figures=None, problem="refused: too sharp"),
        Measurement(task=task(case=RANDOM, course="random-3"), figures=None, problem="late: at 1 of 2 m"),
    ]
    fast, disturbed, frames, random, steps = grids(rows, {"stanley": {1000: np.array([1e-5, 2e-5, 3e-5])}})
    shown = dict(zip(fast.head, fast.rows[0], strict=True))
    assert shown["circle RMS/max"] == "12.3/200"
    assert shown["circle noise: RMS"] == "lost"
    assert shown["corner settled [m]"] == "never"
    assert shown["corner noise: RMS"] == "-"
    assert not any(name.startswith("slalom") for name in fast.head)
    assert disturbed.rows[0][:3] == ["stanley, circle", "4.0", "lost"]
    assert frames.rows == [["stanley", "12.3/200, 13.2 s", "-"]]
    assert random.rows == [["stanley", "3", "1", "1", "1", "1.0"]]
    assert steps.rows == [["stanley", "20/30"]]


def test_csv_has_a_line_for_each_run_in_si_units() -> None:
    rows = [
        Measurement(task=task(), figures=FIGURES),
        Measurement(task=task(case=NOISY), figures=None, problem='raised: KeyError("a, b")'),
    ]
    first, second = csv.DictReader(io.StringIO(as_csv(rows)))
    assert (first["follower"], first["course"], first["case"]) == ("stanley", "circle", CLEAN)
    assert float(first["rms_m"]) == 0.0123
    assert (first["time_s"], first["steering_rate_rad_s"], first["problem"]) == ("13.25", "0.5", "")
    assert (second["rms_m"], second["problem"]) == ("", 'raised: KeyError("a, b")')


def test_the_same_problem_is_told_once() -> None:
    rows = [Measurement(task=task(case=case), figures=None, problem="raised: KeyError()") for case in CASES]
    assert problems(rows) == [f"stanley, circle, clean and {len(CASES) - 1} more: raised: KeyError()"]
    many = [Measurement(task=task(name=str(number)), figures=None, problem="lost") for number in range(50)]
    assert problems(many, most=3)[-1] == "and 47 more problems"


# ---------------------------------------------------------------------------------------------- runs


def test_every_follower_does_every_course_in_every_case() -> None:
    names = installed()
    assert {"frenet", "indiveri", "pure_pursuit", "stanley"} <= set(names)
    given = list(
        tasks([*names, *REFERENCES], ["circle", "corner"], ROBOT, seed=7, frames=True, random=3, checkout=Path())
    )
    own = [task for task in given if task.follower == "stanley"]
    assert len(own) == 2 * (len(CASES) + 1) + 3
    assert [task.seed for task in own if task.case == RANDOM] == [7, 8, 9]
    outside = [task for task in given if task.follower == next(iter(REFERENCES))]
    assert {(task.course, task.case) for task in outside} == {
        (c, n) for c in ("circle", "corner") for n in (CLEAN, NOISY)
    }


def test_a_run_keeps_its_track_for_the_figure() -> None:
    clean, noisy = run(task()), run(task(case=NOISY))
    assert clean.problem == noisy.problem == ""
    assert clean.figures is not None
    assert clean.figures.steady_rms == pytest.approx(0.078, abs=0.002)
    assert clean.track is not None
    assert noisy.track is None
    assert run(task(case=NOISY)) == noisy


def test_a_follower_that_raises_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def start(self, *_: object) -> None:
            raise SystemExit("no licence")

    monkeypatch.setattr(followers, "follower", lambda *_: Broken())
    row = run(task())
    assert row.figures is None
    assert row.problem.startswith("raised: SystemExit('no licence') at ")


def test_one_that_is_not_there_is_a_row() -> None:
    assert "no plugin 'standley'" in run(task("standley")).problem


def test_random_cases_vary_within_their_bounds() -> None:
    cases = [random_case(seed) for seed in range(300)]
    assert cases[3] == random_case(3)
    offsets = [case.conditions.start_offset for case in cases]
    angles = [math.degrees(case.conditions.start_heading) for case in cases]
    delays = [case.conditions.delay * case.conditions.period for case in cases]
    rates = [case.steering_rate_deg_s or 0.0 for case in cases]
    for values, low, high in ((offsets, -1, 1), (angles, -60, 60), (delays, 0, 0.1), (rates, 29, 38)):
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high


# ---------------------------------------------------------------------------------------------- step times


def test_the_weaving_path_has_constant_spacing_and_its_own_curvature() -> None:
    path = weaving_path(2000)
    assert np.hypot(np.diff(path.x), np.diff(path.y)) == pytest.approx(path.spacing)
    assert np.gradient(path.heading, path.spacing)[1:-1] == pytest.approx(path.curvature[1:-1], abs=1e-3)


def test_step_times_are_those_of_the_quickest_round() -> None:
    made = [followers.follower(task(), ROBOT, CASES[CLEAN]) for _ in range(2)]
    times = step_times(made, weaving_path(1000), ROBOT)
    assert len(times) == 500
    assert 0 < np.median(times) < 0.015


# ---------------------------------------------------------------------------------------------- outside reference

STAND_IN = """
import math
from utils.angle import angle_mod
k, L, max_steer = 0.5, 2.9, 0.5

class State:
    def __init__(self, x=0.0, y=0.0, yaw=0.0, v=0.0):
        self.x, self.y, self.yaw, self.v = x, y, yaw, v

def stanley_control(state, cx, cy, cyaw, last):
    print("chatter")
    fx, fy = state.x + L * math.cos(state.yaw), state.y + L * math.sin(state.yaw)
    index = min(range(last, min(last + 60, len(cx))), key=lambda i: math.hypot(fx - cx[i], fy - cy[i]))
    error = (cy[index] - fy) * math.cos(state.yaw) - (cx[index] - fx) * math.sin(state.yaw)
    return angle_mod(cyaw[index] - state.yaw) + math.atan2(k * error, state.v), index
"""
ANGLE = "import math\ndef angle_mod(x):\n    return math.remainder(x, math.tau)\n"


def checkout(folder: Path, module: str = STAND_IN) -> Path:
    """Something with the names of the outside reference."""
    for file, text in {"utils/angle.py": ANGLE, "PathTracking/stanley_control/stanley_control.py": module}.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    return folder


def test_the_outside_reference_drives_with_this_robots_wheelbase(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(checkout(tmp_path)))
    row = run(task("[PR] Stanley", checkout=tmp_path))
    assert row.problem == ""
    assert row.figures is not None
    assert row.figures.steady_rms == pytest.approx(0.078, abs=0.005)  # the rear axle, inside the front axle's circle
    assert capsys.readouterr().out == ""


def test_what_is_missing_of_the_outside_reference_is_said(tmp_path: Path) -> None:
    problem = run(task("[PR] LQR steer", checkout=tmp_path)).problem
    assert problem.startswith("refused: ")
    assert problem.endswith("lqr_steer_control.py is not there; expected a checkout of PythonRobotics")
    broken = checkout(tmp_path, module="import no_such_solver\n")
    problem = run(task("[PR] Stanley", checkout=broken)).problem
    assert problem == "refused: stanley_control.py: No module named 'no_such_solver'"
