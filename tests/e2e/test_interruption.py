"""Whatever ends a run from outside, the drives are stopped first: signals, a reader of the output that goes away."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from command_line import (
    ARTEMIS,
    PATIENCE,
    assert_left_at_rest,
    endless_mission,
    modes_of,
    only_run,
    read_until,
    started,
    stream,
    write_mission,
)

from artemis.__main__ import main
from artemis.app import Parts, run_mission
from artemis.clock import SimulatedLoop
from artemis.commands import run
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report
from artemis.values import OperatorInput, Tick

INSTALLED = "from importlib.metadata import entry_points as all; all(group='console_scripts')['artemis'].load()()"
REAL_TIME = "simulation: {pace: real_time}\n"


def assert_stopped_on_the_way(folder: Path) -> None:
    run = only_run(folder)
    assert modes_of(run)[-2:] == ["follow", "end"]
    assert_left_at_rest(run)


@pytest.mark.parametrize("program", [ARTEMIS, [ARTEMIS[0], "-c", INSTALLED]])
def test_ctrl_c_while_the_command_is_imported_ends_it_without_a_word(tmp_path: Path, program: list[str]) -> None:
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nprint('goes on')\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(program, capture_output=True, cwd=tmp_path, env=environment, timeout=PATIENCE)
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


@pytest.mark.parametrize("place", ["artemis.cli._prepare_output", "artemis.cli.app", "artemis.cli.leave_threads"])
def test_ctrl_c_beside_a_command_is_its_status(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    monkeypatch.setattr("sys.argv", ["artemis", "--version"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130


@pytest.mark.slow
@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_run_in_order_without_a_terminal(tmp_path: Path, number: signal.Signals) -> None:
    with started("run", endless_mission(tmp_path)) as process:
        read_until(process, "following")
        process.send_signal(number)
        rest, errors = process.communicate(timeout=PATIENCE)
    assert errors == ""
    assert f"ended by {number.name}; drives stopped and released" in rest
    assert process.returncode == 128 + number
    assert_stopped_on_the_way(tmp_path)


@pytest.mark.slow
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("ignored", "sent", "ends_by"),
    [
        ("INT", [signal.SIGINT], signal.SIGINT),  # as a script starts what it ends with `&`
        ("HUP", [signal.SIGHUP, signal.SIGTERM], signal.SIGTERM),  # `nohup`: the first signal is none
    ],
)
def test_a_stop_is_never_ignored_and_only_nohup_outlives_a_terminal(
    tmp_path: Path, ignored: str, sent: list[signal.Signals], ends_by: signal.Signals
) -> None:
    command = f"trap '' {ignored}; exec {' '.join(ARTEMIS)} run {endless_mission(tmp_path)}"
    pipe = subprocess.PIPE
    with subprocess.Popen(["sh", "-c", command], stdin=subprocess.DEVNULL, stdout=pipe, text=True) as process:
        read_until(process, "following")
        for number in sent:
            process.send_signal(number)
        rest, _ = process.communicate(timeout=PATIENCE)
    assert f"ended by {ends_by.name}; drives stopped and released" in rest
    assert process.returncode == 128 + ends_by
    assert_stopped_on_the_way(tmp_path)


@pytest.mark.realtime
def test_a_reader_that_goes_away_ends_the_run_in_order(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=REAL_TIME)
    mission.write_text(mission.read_text().replace("steps:\n", "steps:\n  - wait: {seconds: 3600}\n"))
    with started("run", mission) as process:
        assert stream(process.stdout).readline().startswith("mission line")
        stream(process.stdout).close()
        assert (
            stream(process.stderr).read() == "artemis: standard output cannot be written: Broken pipe; the run ends\n"
        )
        assert process.wait(timeout=PATIENCE) == 143
    run = only_run(tmp_path)
    assert modes_of(run)[-1] == "end"
    assert (run / "report.html").exists()
    assert "follow" not in modes_of(run)


@pytest.fixture
def let_through() -> Iterator[list[int]]:
    """Signals that reached the process instead of the run."""
    heard: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda number, _: heard.append(number)) for number in numbers}
    yield heard
    for number, handler in before.items():
        signal.signal(number, handler)


def short_mission(folder: Path) -> Path:
    """Ends after the bring-up."""
    mission = write_mission(folder)
    mission.write_text(mission.read_text().partition("steps:")[0] + "steps:\n  - wait: {seconds: 0.1}\n")
    return mission


class SignalsWhenClosed:
    """An input device during whose end signals come."""

    Config: ClassVar[type[Config]] = Config

    def read(self, now: float) -> OperatorInput:
        return OperatorInput(source="hand", age=0.0)

    def close(self) -> None:
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.raise_signal(number)


def test_signals_after_the_last_tick_wait_until_the_recording_is_closed(tmp_path: Path, let_through: list[int]) -> None:
    ticks: list[Tick] = []

    def watch(tick: Tick, _: Traffic) -> None:
        ticks.append(tick)
        if tick.wish.finished:
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGTERM)

    source = short_mission(tmp_path)
    parts = Parts(inputs={"hand": SignalsWhenClosed()}, loop=SimulatedLoop)
    outcome = run_mission(load_mission(source), source, watch=watch, parts=parts)
    assert (outcome.failed, outcome.interrupted, outcome.troubles, let_through) == (False, signal.SIGTERM, (), [])
    assert [tick.wish.finished for tick in ticks[-2:]] == [False, True], "nothing is asked of a robot that has ended"
    assert len(list(Recording(outcome.run.path).ticks())) == len(ticks)
    signal.raise_signal(signal.SIGTERM)
    assert let_through == [signal.SIGTERM], "they are the process's own again"


def test_only_ctrl_c_breaks_a_report_off(
    tmp_path: Path, let_through: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:

    def interrupted(*arguments: object) -> None:
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        write_report(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(run, "write_report", interrupted)
    assert run.run_and_report(short_mission(tmp_path), simulate=False) == 0
    assert (only_run(tmp_path) / "report.html").exists()
    assert let_through == []
    signal.raise_signal(signal.SIGTERM)
    assert let_through == [signal.SIGTERM]


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["schema"], ["graph"]])
def test_a_reader_that_goes_away_is_no_bug(arguments: list[str]) -> None:
    with subprocess.Popen([*ARTEMIS, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()
        assert process.wait(timeout=PATIENCE) in (0, 1, -signal.SIGPIPE)


@pytest.mark.exhaustive
def test_without_standard_output_the_run_is_done_all_the_same(tmp_path: Path) -> None:
    mission = write_mission(tmp_path)
    command = f'exec "$0" -m artemis run {mission} >&- 2>{tmp_path}/errors'
    done = subprocess.run(["sh", "-c", command, ARTEMIS[0]], timeout=PATIENCE, stdin=subprocess.DEVNULL)
    assert done.returncode == 0
    assert (tmp_path / "errors").read_text() == ""
    assert_left_at_rest(only_run(tmp_path))
