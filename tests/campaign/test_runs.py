"""Many runs: what is finished stays, what is left is done, one table."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from campaign_files import write_campaign

from artemis.errors import ConfigError
from artemis_lab.campaign import runs
from artemis_lab.campaign.monitor.evidence import Violation
from artemis_lab.campaign.one_run import InterruptedRun, Result
from artemis_lab.campaign.runs import FaultTotals, ResultFile, drawn, load_campaign, run_campaign, table


class Here(Executor):
    """Does the work at once, without doing it."""

    def submit(self, work: Any, /, *args: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        future: Future[Any] = Future()
        future.set_result(Result(seed=args[0], status=0, time_s=1.0))
        return future


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def executor(_: object) -> Any:  # noqa: ANN401
        yield Here(), 1

    monkeypatch.setattr(runs, "_executor", executor)


def never() -> bool:
    return False


def test_every_seed_is_run_once(tmp_path: Path) -> None:
    campaign = load_campaign(write_campaign(tmp_path, runs=10, first_seed=5))
    results, told = ResultFile(campaign.folder), []

    assert run_campaign(campaign, results, lambda result: told.append(result.seed), never)

    assert sorted(told) == list(range(5, 15))
    assert sorted(results.finished) == list(range(5, 15))


def test_interrupted_campaign_goes_on_where_it_stopped(tmp_path: Path) -> None:
    campaign = load_campaign(write_campaign(tmp_path, runs=10))
    first: list[int] = []
    second: list[int] = []

    done = run_campaign(campaign, ResultFile(campaign.folder), lambda r: first.append(r.seed), lambda: len(first) >= 4)
    assert not done
    results = ResultFile(campaign.folder)
    assert sorted(results.finished) == sorted(first)
    assert run_campaign(campaign, results, lambda r: second.append(r.seed), never)

    assert sorted(first + second) == list(range(1, 11))


def test_run_that_a_signal_ended_is_no_result_and_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def interrupted_once(self: Here, work: object, /, *args: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        future: Future[Any] = Future()
        asked.append(args[0])
        if args[0] == 3 and asked.count(3) == 1:
            future.set_exception(InterruptedRun(15))
        else:
            future.set_result(Result(seed=args[0], status=0, time_s=1.0))
        return future

    monkeypatch.setattr(Here, "submit", interrupted_once)
    campaign = load_campaign(write_campaign(tmp_path, runs=5))
    results = ResultFile(campaign.folder)

    assert run_campaign(campaign, results, lambda _: None, never)

    assert sorted(results.finished) == [1, 2, 3, 4, 5]
    assert sorted(asked) == [1, 2, 3, 3, 4, 5]


def test_dead_worker_ends_the_campaign_and_names_the_seeds_under_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dies_at_two(self: Here, work: object, /, *args: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        future: Future[Any] = Future()
        if args[0] == 2:
            future.set_exception(BrokenProcessPool("a process in the pool died"))
        elif args[0] == 1:
            future.set_result(Result(seed=1, status=0, time_s=1.0))
        return future  # all others are under way

    monkeypatch.setattr(Here, "submit", dies_at_two)
    monkeypatch.setattr(runs, "AHEAD", 1)
    campaign = load_campaign(write_campaign(tmp_path, runs=10))

    with pytest.raises(BrokenProcessPool) as died:
        run_campaign(campaign, ResultFile(campaign.folder), lambda _: None, never)

    assert died.value.__notes__ == ["under way were the seeds 2"]
    assert sorted(ResultFile(campaign.folder).finished) == [1]


def test_run_that_never_ends_shows_where_it_is_and_dies() -> None:
    script = """
from artemis_lab.campaign import runs

def spin(*_, **__):
    while True:
        pass

runs.HANGS, runs.scenario, runs.run_scenario = 0.2, lambda *_: None, spin
runs.run_seed(1, None, b"")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)

    assert done.returncode == 1
    assert "in spin" in done.stderr
    assert "in run_seed" in done.stderr


@pytest.mark.parametrize("cut", range(0, 200, 7))
def test_torn_results_lose_only_the_last_run(cut: int, tmp_path: Path) -> None:
    results = ResultFile(tmp_path)
    violation = Violation("I4", 6.5, "too far")
    results.add(Result(seed=1, status=1, time_s=7.0, injected=("DRV-02",), violations=(violation,)))
    whole = results.path.read_bytes()
    results.add(Result(seed=2, status=0, time_s=9.0, seen=(("DRV-02", 0.01, 0.04),)))
    content = results.path.read_bytes()
    results.path.write_bytes(content[: max(len(whole), len(content) - 1 - cut)])

    again = ResultFile(tmp_path)
    again.add(Result(seed=3, status=None, time_s=3.0))

    assert [json.loads(line)["seed"] for line in again.path.read_text().splitlines()] == [1, 3]
    assert ResultFile(tmp_path).finished[1].violations == (violation,)


def test_another_robot_or_other_seeds_are_another_campaign(tmp_path: Path) -> None:
    first = load_campaign(write_campaign(tmp_path)).folder
    assert load_campaign(write_campaign(tmp_path)).folder == first

    assert load_campaign(write_campaign(tmp_path, runs=4)).folder != first
    path = write_campaign(tmp_path)
    robot = tmp_path / "robot.yaml"
    robot.write_text(robot.read_text().replace("speed_m_s: 0.7 ", "speed_m_s: 0.6 "))
    assert load_campaign(path).folder != first


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"runs": 0}, "runs"),
        ({"robot": "nowhere.yaml"}, "nowhere.yaml"),
        ({"campaign": "My Campaign"}, "campaign"),
        ({"workers": "many"}, "workers"),
        ({"run": 4}, "did you mean runs"),
        ({"first_seed": -1}, "first_seed"),
    ],
)
def test_wrong_campaign_is_refused(keys: dict[str, Any], problem: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        load_campaign(write_campaign(tmp_path, **keys))

    assert problem in str(refused.value)


def test_kinds_of_runs_are_counted() -> None:
    broken = (Violation("I3", 6.5, "late"),)
    results = [
        Result(seed=1, status=0, time_s=9.0, kinds=("follow", "calibrate")),
        Result(seed=2, status=0, time_s=9.0, kinds=("follow", "resumed"), violations=broken),
    ]

    assert drawn(results) == [("follow", 2, 1), ("calibrate", 1, 0), ("resumed", 1, 1)]


def test_table_has_a_line_for_every_fault() -> None:
    broken = (Violation("I3", 6.5, "late"),)
    results = [
        Result(seed=1, status=0, time_s=9.0),
        Result(seed=2, status=1, time_s=9.0, injected=("DRV-02", "DRV-02"), seen=(("DRV-02", 0.01, 0.04),)),
        Result(seed=3, status=1, time_s=9.0, injected=("DRV-02", "COM-11"), seen=(("DRV-02", 0.03, 0.04),)),
        Result(seed=4, status=1, time_s=9.0, injected=("COM-11",), violations=broken),
    ]

    assert table(results) == [
        FaultTotals(id="", runs=1, judged=0, worst=None, within=None, failed=0),
        FaultTotals(id="COM-11", runs=2, judged=0, worst=None, within=None, failed=1),
        FaultTotals(id="DRV-02", runs=2, judged=2, worst=0.03, within=0.04, failed=0),
    ]
