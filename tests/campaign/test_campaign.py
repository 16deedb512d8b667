"""The command as a process: runs in worker processes, table, exit statuses, and what an interruption keeps."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from campaign_files import write_campaign
from command_line import artemis_here

from artemis_lab.campaign.monitor.evidence import Violation
from artemis_lab.campaign.one_run import Result
from artemis_lab.campaign.runs import ResultFile, load_campaign, run_seed, table

ARTEMIS = [sys.executable, "-m", "artemis", "campaign"]
FIRST, SLICE = 4, 4
"""Seeds of short runs; `.ci/run` does 120."""
PATIENCE = 500.0
"""Longest time for anything on a busy machine [s]."""
pytestmark = [pytest.mark.slow, pytest.mark.timeout(PATIENCE)]


def artemis_campaign(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [*ARTEMIS, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, stdin=subprocess.DEVNULL)


def seeds_in(results: Path) -> list[int]:
    return [json.loads(line)["seed"] for line in results.read_text().splitlines()]


@pytest.mark.exhaustive
def test_slice_of_seeds_breaks_no_invariant(tmp_path: Path) -> None:
    done = artemis_campaign(write_campaign(tmp_path, runs=SLICE, first_seed=FIRST, workers=2))

    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{SLICE} runs, 0 violations in 0 of them" in done.stdout
    assert re.search(rf"{SLICE // 2} of {SLICE} runs, 0 failed; \d+ a minute, \d+ minutes left", done.stdout)
    (results,) = tmp_path.glob("runs/small-*/results.jsonl")
    assert sorted(seeds_in(results)) == list(range(FIRST, FIRST + SLICE))


@pytest.mark.exhaustive
def test_interrupted_campaign_keeps_its_runs_and_goes_on(tmp_path: Path) -> None:
    path = write_campaign(
        tmp_path, runs=8, first_seed=FIRST, workers=1
    )  # three of them cannot be called back once they wait
    results = load_campaign(path).folder / "results.jsonl"
    with subprocess.Popen([*ARTEMIS, str(path)], stdout=subprocess.PIPE, text=True) as process:
        while not (results.exists() and results.read_bytes().count(b"\n") >= 2):
            assert process.poll() is None, "ended too early"
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        shown = process.communicate(timeout=PATIENCE)[0]

    assert process.returncode == 130, shown
    finished = seeds_in(results)
    assert 2 <= len(finished) < 8
    assert f"interrupted after {len(finished)} of 8 runs" in shown

    again = artemis_campaign(path)

    assert again.returncode == 0, again.stdout
    assert f"continues after {len(finished)} finished runs" in again.stdout
    assert sorted(seeds_in(results)) == list(range(FIRST, FIRST + 8))
    assert seeds_in(results)[: len(finished)] == finished


@pytest.mark.exhaustive
def test_broken_invariant_is_told_with_what_runs_it_alone(tmp_path: Path) -> None:
    path = write_campaign(tmp_path, runs=2, first_seed=FIRST, workers=1)
    campaign = load_campaign(path)
    broken = Violation("I4", 6.5, "stopped too late")
    ResultFile(campaign.folder).add(
        Result(seed=FIRST, status=1, time_s=9.0, injected=("DRV-02",), violations=(broken,))
    )

    done = artemis_here("campaign", path)

    assert done.returncode == 1, done.stderr
    assert f"seed {FIRST}: I4 at 6.500 s: stopped too late" in done.stdout
    assert f"artemis campaign {path} --seed {FIRST}" in done.stdout
    checked = artemis_here("check", campaign.scenario_folder(FIRST) / "mission.yaml")
    assert checked.returncode == 0, checked.stderr


def test_one_seed_runs_in_sight_and_keeps_its_folder(tmp_path: Path) -> None:
    path = write_campaign(tmp_path)

    done = artemis_here("campaign", path, "--seed", "7")

    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 violations" in done.stdout
    assert "proving the watchdog" in done.stdout
    first, cut, resumed = sorted(load_campaign(path).scenario_folder(7).glob("runs/*"))
    assert cut.name == f"{first.name}-cut"
    for run in (first, cut, resumed):
        assert {"journal.jsonl", "recording.mcap"} <= {file.name for file in run.iterdir()}


def test_wrong_campaign_is_refused(tmp_path: Path) -> None:
    done = artemis_here("campaign", write_campaign(tmp_path, runs=0))

    assert done.returncode == 2
    assert "campaign.yaml:3" in done.stderr


@pytest.mark.slow
def test_cluster_that_is_not_there_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

    done = artemis_here("campaign", write_campaign(tmp_path, cluster="tcp://127.0.0.1:1"))

    assert done.returncode == 2, done.stderr
    assert "no scheduler at tcp://127.0.0.1:1" in done.stderr


@pytest.mark.slow
def test_cluster_that_loses_a_worker_finds_what_one_computer_finds(tmp_path: Path) -> None:
    """A scheduler and two workers of Dask, each a process; one keeps the seeds that it gets until it is killed."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    words = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**words) as cluster, (tmp_path / "shown").open("w+") as shown:
        path = write_campaign(tmp_path, runs=SLICE, first_seed=FIRST, cluster=cluster.scheduler_address)
        campaign = load_campaign(path)
        results = campaign.folder / "results.jsonl"
        lost = cluster.workers[0].pid
        os.kill(lost, signal.SIGSTOP)
        with subprocess.Popen([*ARTEMIS, str(path)], stdout=shown, stderr=shown, stdin=subprocess.DEVNULL) as process:
            while not (results.exists() and results.stat().st_size):
                assert process.poll() is None, "ended too early"
                time.sleep(0.05)
            os.kill(lost, signal.SIGKILL)
            assert len(seeds_in(results)) < SLICE
            assert process.wait(PATIENCE) == 0, (tmp_path / "shown").read_text()

    assert sorted(seeds_in(results)) == list(range(FIRST, FIRST + SLICE))
    here = {seed: run_seed(seed, campaign.robot, campaign.robot_source) for seed in campaign.seeds}
    found = ResultFile(campaign.folder).finished
    assert found == here
    assert table(found.values()) == table(here.values())
