"""`artemis run MISSION --resume RUN` as a process: after a fault, after a kill, and where it is refused."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from command_line import (
    artemis,
    artemis_here,
    endless_mission,
    only_run,
    read_until,
    started,
    stream,
    write_mission,
)

from artemis.errors import RecordingError
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording

FAULT = "simulation:\n  faults: [{at_s: 9.0, inject: DRV-25, node: steer-left}]\n"
"""Halfway along the path; a run that has only the rest of it before it is done earlier."""


def label(output: str, name: str) -> str:
    """What the line with this label says."""
    (text,) = re.findall(rf"^{name:12}  (.*)$", output, re.MULTILINE)
    return str(text)


def runs(folder: Path) -> list[Path]:
    return sorted((folder / "runs").iterdir())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("missions")


@pytest.fixture(scope="module")
def mission(folder: Path) -> Path:
    return write_mission(folder, more=FAULT)


@pytest.fixture(scope="module")
def failed(mission: Path) -> subprocess.CompletedProcess[str]:
    return artemis("run", mission, "--simulate")


@pytest.fixture(scope="module")
def first(folder: Path, failed: subprocess.CompletedProcess[str]) -> Path:
    assert failed.returncode == 1
    return only_run(folder)


@pytest.fixture(scope="module")
def resumed(first: Path, failed: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    """By the command that the failed run has told."""
    return artemis(*label(failed.stdout, "resume").split()[1:])


@pytest.mark.slow
def test_a_failed_run_tells_how_to_go_on(failed: subprocess.CompletedProcess[str], first: Path, mission: Path) -> None:
    assert label(failed.stdout, "resume") == f"artemis run {mission} --simulate --resume {first}"


def test_a_run_that_cannot_be_gone_on_with_tells_no_command_for_it(tmp_path: Path) -> None:
    """Nobody counted how far the robot rolled without power."""
    failed = artemis_here("run", write_mission(tmp_path, more="simulation: {faults: [{at_s: 9.0, inject: SYS-09}]}\n"))

    assert (failed.returncode, "resume" in failed.stdout) == (1, False)
    refused = artemis_here("run", tmp_path / "mission.yaml", "--resume", only_run(tmp_path))
    assert refused.returncode == 2
    assert "the position of the robot is unknown" in refused.stderr


@pytest.mark.slow
def test_a_run_that_a_fault_ended_is_gone_on_with(
    resumed: subprocess.CompletedProcess[str], first: Path, folder: Path
) -> None:
    assert resumed.returncode == 0, resumed.stdout + resumed.stderr
    found = re.fullmatch(r"(\S+): step 2 \(follow\), (\d\.\d\d) m of it done", label(resumed.stdout, "resuming"))
    assert found is not None
    assert found[1] == first.name
    assert 0.3 < float(found[2]) < 0.7
    assert "the robot must not have been moved since" in resumed.stdout
    assert label(resumed.stdout, "result") == "done"
    (second,) = set(runs(folder)) - {first}
    assert f"Resumes {first.name}." in (second / "report.html").read_text()


def test_a_run_that_is_done_is_refused(resumed: subprocess.CompletedProcess[str], folder: Path, mission: Path) -> None:
    second = runs(folder)[-1]
    again = artemis_here("run", mission, "--resume", second)

    assert (again.returncode, again.stdout) == (2, "")
    assert again.stderr == (f"{second}: this run is complete; omit --resume to run the mission again\n")
    assert len(runs(folder)) == 2


def test_a_run_whose_files_have_changed_is_refused_before_anything_moves(first: Path, tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=FAULT)
    (tmp_path / "paths/line.csv").write_text("x_m,y_m\n0,0\n1,0\n")
    refused = artemis_here("run", mission, "--resume", first)

    assert refused.returncode == 2
    assert refused.stderr.startswith("paths/line.csv: is not what it was in ")
    assert not (tmp_path / "runs").exists()


def test_after_a_kill_the_next_run_tells_how_to_go_on(tmp_path: Path) -> None:
    mission = endless_mission(tmp_path)
    with started("run", mission) as process:
        read_until(process, "follow     following")
        process.kill()
        process.wait()
    killed = only_run(tmp_path)
    journal = read_journal(killed / "journal.jsonl")
    assert journal.missing is None

    with started("run", mission) as process:
        said = read_until(process, "listening")
    assert label(said, "last run") == (
        f"ended without shutdown at {journal.entries[-1].time:.2f} s; to resume it: "
        f"artemis run {mission} --resume {killed}"
    )
    with started("run", mission, "--resume", killed) as process:
        said = read_until(process, "listening")
    assert re.search(r"step [12] \((calibrate|follow)\), \d+\.\d\d [ms] of it done", label(said, "resuming"))
    assert "the recording is not whole: the file is cut off" in said


def test_a_run_under_way_is_not_taken_for_one_that_broke_off(tmp_path: Path) -> None:
    mission = endless_mission(tmp_path)
    with started("run", mission) as process:
        read_until(process, "follow     following")
        live = only_run(tmp_path)
        refused = artemis_here("run", mission, "--resume", live)
        with started("run", mission) as second:
            said = read_until(second, "listening")
        process.kill()
        process.wait()

    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == f"{live}: cannot be resumed: this run is still under way; end it first\n"
    assert label(said, "last run") == f"{live} is still under way"


@pytest.mark.exhaustive
@pytest.mark.realtime
def test_a_run_killed_in_real_time_is_gone_on_with_where_it_was(tmp_path: Path) -> None:
    mission = endless_mission(tmp_path, more="simulation: {pace: real_time}\n")
    with started("run", mission) as process:
        read_until(process, "follow     following")
        killed = only_run(tmp_path)
        wait_until_driven(process, killed, 0.3)
        process.kill()
        process.wait()
    done = driven(killed)
    with started("run", mission, "--resume", killed) as process:
        said = read_until(process, "follow     following")
        (resumed,) = [run for run in runs(tmp_path) if Recording(run).resume_point]
        wait_until_driven(process, resumed, done + 0.3)
    assert f"step 2 (follow), {done:.2f} m of it done" in label(said, "resuming")
    assert "the recording is not whole: the file is cut off" in said


def wait_until_driven(process: subprocess.Popen[str], run: Path, distance: float) -> None:
    """Until the process has recorded that so much of the path [m] is done."""
    while driven(run) < distance:
        if process.poll() is not None:
            raise AssertionError(f"ended too early: {stream(process.stdout).read()}")


def driven(run: Path) -> float:
    """How much of its path [m] a run has recorded so far."""
    try:
        last = Recording(run).last_tick()
    except RecordingError:
        return 0.0
    return last.position.done if last is not None else 0.0


HANDLED = """  - try:
      retries: 1
      between: [{say: again}]
      steps: [{wait: {for: run_s > 99999, at_most_s: 0.3}}]
      catch: {timeout: [{say: too late}, {wait: {seconds: 100}}, {say: handled}]}
  - say: all is done
"""


def happened(folder: Path) -> list[str]:
    """What its journal says of the mission."""
    return [entry.text for entry in read_journal(folder / "journal.jsonl").entries if entry.kind == "mission"]


@pytest.mark.slow
def test_a_run_that_is_killed_in_the_branch_of_a_try_does_the_rest_of_it_and_nothing_else(tmp_path: Path) -> None:
    mission = write_mission(tmp_path)
    head = mission.read_text().partition("  - calibrate")[0]
    mission.write_text(head + HANDLED)
    with started("run", mission) as process:
        read_until(process, "mission    too late")
        wait_until_driven(process, only_run(tmp_path), 5.0)  # seconds of the wait that handles it
        process.kill()
        process.wait()
    killed = only_run(tmp_path)
    assert happened(killed)[-1] == "said: too late"
    resumed = artemis("run", mission, "--resume", killed)
    assert resumed.returncode == 0, resumed.stdout + resumed.stderr
    (second,) = set(runs(tmp_path)) - {killed}
    whole = artemis("run", mission)
    assert whole.returncode == 0
    (third,) = set(runs(tmp_path)) - {killed, second}
    assert happened(killed) + happened(second) == happened(third)
