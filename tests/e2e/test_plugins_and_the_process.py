"""Plugins that block the process, end it, flood its output, keep it alive: named, and the drives are safe."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest
from command_line import (
    PATIENCE,
    artemis,
    assert_left_at_rest,
    endless_mission,
    only_run,
    read_until,
    started,
    stream,
)

from artemis.recording.journal import read_journal

REAL_TIME = "simulation: {pace: real_time}\n"
PLUGIN = """
import os, threading, time
from typing import ClassVar, Literal

from artemis.config import Config
from artemis.values import OperatorInput


class EvilConfig(Config):
    does: str


class Evil:
    Config: ClassVar[type[Config]] = EvilConfig

    def __init__(self, config, context):
        self.does, self.name, self.reads = config.does, context.name, 0
        if self.does == "constructor":
            self.block()

    def read(self, now):
        self.reads += 1
        if self.reads == 30:
            getattr(self, self.does, lambda: None)()
        return OperatorInput(source=self.name, age=0.0)

    def close(self):
        if self.does == "close":
            self.block()

    def block(self):
        while True:
            pass

    def sleep(self):
        while True:
            time.sleep(1000)

    def lock(self):
        both = threading.Lock()
        both.acquire()
        both.acquire()

    def leave(self):
        os._exit(0)

    def thread(self):
        threading.Thread(target=self.sleep, name="forgotten").start()

    def flood(self):
        for number in range(1000):
            print("spam", number)

    def mumble(self):
        print("the end of it", end="")

    def move(self):
        os.chdir("/")

    def noise(self):
        threading.Thread(target=self.flood, name="noisy").start()
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the installed plugin."""
    folder = tmp_path / "site"
    info = folder / "evil-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "evil.py").write_text(PLUGIN)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[artemis.inputs]\nevil = evil:Evil\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return folder


def mission(folder: Path, does: str, more: str = "") -> Path:
    """Waits for a second, with the plugin beside it."""
    file = endless_mission(folder, more=more)
    head = file.read_text().partition("steps:")[0]
    file.write_text(f"{head}inputs:\n  stick: {{plugin: evil, does: {does}}}\nsteps:\n  - wait: {{seconds: 1}}\n{more}")
    return file


def assert_named(process: subprocess.Popen[str], folder: Path, method: str) -> None:
    """The process has ended, and says whose fault it was and where; the journal says it, too."""
    errors = stream(process.stderr).read()
    assert process.wait(timeout=PATIENCE) == 71
    assert "artemis: plugin 'stick' (evil of evil 1.0) has not answered for 5 s: the run is ended" in errors
    assert "evil.py" in errors
    assert f", in {method}" in errors
    journal = read_journal(only_run(folder) / "journal.jsonl")
    assert "plugin 'stick' (evil of evil 1.0) has not answered" in journal.entries[-1].text


@pytest.mark.slow
@pytest.mark.sampled(2)
@pytest.mark.realtime
@pytest.mark.usefixtures("site")
@pytest.mark.parametrize(("does", "method"), [("lock", "lock"), ("constructor", "block")])
def test_a_plugin_that_blocks_for_ever_is_named_and_the_process_ends(tmp_path: Path, does: str, method: str) -> None:
    with started("run", mission(tmp_path, does, REAL_TIME)) as process:
        assert_named(process, tmp_path, method)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.usefixtures("site")
def test_a_plugin_that_blocks_in_simulated_time_may_until_somebody_asks_for_the_end(tmp_path: Path) -> None:
    with started("run", mission(tmp_path, "sleep")) as process:
        read_until(process, "listening")
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(6.0)
        process.send_signal(signal.SIGINT)
        assert_named(process, tmp_path, "sleep")


@pytest.mark.usefixtures("site")
def test_a_plugin_that_ends_the_process_is_refused_and_named(tmp_path: Path) -> None:
    done = artemis("run", mission(tmp_path, "leave"))
    assert done.returncode == 1
    assert "PLG-02 stick: plugin raised an error (RuntimeError('os._exit(0): nothing but artemis may end" in done.stdout
    assert "result        FAILED" in done.stdout
    assert_left_at_rest(only_run(tmp_path))


@pytest.mark.usefixtures("site")
def test_a_plugin_that_changes_the_working_folder_does_not_lose_the_report(tmp_path: Path) -> None:
    mission(tmp_path, "move")
    done = artemis("run", "mission.yaml", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (only_run(tmp_path) / "report.html").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("site")
def test_a_thread_that_a_plugin_leaves_is_named_and_keeps_nothing_alive(tmp_path: Path) -> None:
    done = artemis("run", mission(tmp_path, "thread"))
    assert done.returncode == 0
    assert "result        done" in done.stdout
    assert "artemis: thread 'forgotten' was left running; artemis ends without it" in done.stderr
    assert ", in sleep" in done.stderr


@pytest.mark.usefixtures("site")
@pytest.mark.parametrize(("does", "name"), [("flood", "stick"), ("noise", "noisy")])
def test_what_a_plugin_prints_is_named_and_does_not_flood_the_terminal(tmp_path: Path, does: str, name: str) -> None:
    done = artemis("run", mission(tmp_path, does))
    assert done.returncode == 0
    assert done.stdout.count("spam") == 10
    assert f"{name} prints: spam 0\n" in done.stdout
    assert f"{name} printed 990 more lines" in done.stdout
    assert "result        done" in done.stdout


@pytest.mark.usefixtures("site")
def test_a_line_that_a_plugin_does_not_end_is_shown(tmp_path: Path) -> None:
    done = artemis("run", mission(tmp_path, "mumble"))
    assert done.returncode == 0
    assert "stick prints: the end of it\n" in done.stdout


def test_the_last_words_of_a_command_of_another_package_are_shown(site: Path) -> None:
    (site / "evil-1.0.dist-info" / "entry_points.txt").write_text("[artemis.commands]\nbye = evil_command:bye\n")
    (site / "evil_command.py").write_text(
        "import sys\n\ndef bye(app):\n    app.command('bye')(lambda: sys.exit('bye: no such thing'))\n"
    )
    done = artemis("bye")
    assert (done.returncode, done.stderr) == (1, "bye: no such thing\n")


def test_a_command_of_another_package_that_exits_as_it_is_loaded_harms_no_other(site: Path) -> None:
    (site / "evil-1.0.dist-info" / "entry_points.txt").write_text("[artemis.commands]\nbye = evil_command:bye\n")
    (site / "evil_command.py").write_text("import sys\n\nsys.exit(0)\n")
    done = artemis("--version")
    assert (done.returncode, done.stderr) == (0, "artemis: no commands of evil_command:bye: SystemExit: 0\n")
    assert done.stdout
