"""A run as the page that started it sees it: its words, its last lines, how it ends, and that it ends with the page."""

from __future__ import annotations

import itertools
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from artemis.page import started_run
from artemis.page.started_run import CANCEL_TIME, HANG, MOST_LINES, StartedRun

PAUSE = threading.Event()
"""Never set."""
TICKING = """
import os, signal, sys
from artemis.notify import ServiceManager
manager = ServiceManager()
assert "NOTIFY_SOCKET" not in os.environ
"""


@contextmanager
def started(tmp_path: Path, program: str) -> Iterator[StartedRun]:
    run = StartedRun([sys.executable, "-c", program], tmp_path, (), 0.0)
    try:
        yield run
    finally:
        run.kill()
        until(run, lambda: run.look(0.0) is not None)
        run.close()


def until(run: StartedRun, done: object) -> None:
    for _ in itertools.repeat(None, 6000):
        if done():  # type: ignore[operator]
            return
        run.look(0.0)
        PAUSE.wait(0.01)
    raise AssertionError(run.lines())


def test_its_words_and_its_end(tmp_path: Path) -> None:
    program = TICKING + "print('so far\\x1b[31m'); manager.tell('READY=1', 'STATUS=init: listening'); sys.stdin.read()"
    with started(tmp_path, program) as run:
        until(run, lambda: run.is_ready)
        assert (run.status, run.is_stopping, run.look(0.0)) == ("init: listening", False, None)
        run.end()
        until(run, lambda: run.look(0.0) is not None)
        assert run.look(0.0) == -15
        assert run.outcome == "killed by SIGTERM; the drives stop by themselves"


def test_its_last_lines_are_kept_and_not_all_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(started_run, "MOST_OUTPUT", 5000)
    first = "from signal import *; pthread_sigmask(SIG_BLOCK, [SIGTERM]); print(*range(2000), sep='\\n', flush=True)"
    with started(tmp_path, f"{first}; sigwait([SIGTERM]); print('x' * 5000); raise SystemExit(2)") as run:
        while run.lines()[-1:] != ["1999"]:
            PAUSE.wait(0.01)
        run.look(0.0)
        assert len(run.lines()) == MOST_LINES
        run.end()
        until(run, lambda: run.look(0.0) is not None)
        lines = run.lines()
        assert len(lines) <= MOST_LINES
        assert lines[-1] == "x" * started_run.LONGEST_LINE
        assert (run.look(0.0), run.outcome) == (2, "refused; nothing has moved")


def test_one_that_does_not_tick_any_more_is_killed_but_not_while_it_ends(tmp_path: Path) -> None:
    program = TICKING + "manager.tell(*sys.argv[1:] or ['READY=1']); signal.pause()"
    with started(tmp_path, program) as run:
        until(run, lambda: run.is_ready)
        assert run.look(HANG - 1.0) is None
        until(run, lambda: run.look(HANG + 1.0) is not None)
        assert run.outcome.startswith(f"it did not tick for {HANG:g} s: killed by SIGKILL")
    with started(tmp_path, program.replace("['READY=1']", "['READY=1', 'STOPPING=1']")) as run:
        until(run, lambda: run.is_stopping)
        assert run.look(100.0) is None


def test_one_that_hangs_after_its_last_tick_is_killed_some_time_after_it_was_cancelled(tmp_path: Path) -> None:
    deaf = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM]); manager.tell('READY=1', 'STOPPING=1')"
    with started(tmp_path, TICKING + deaf + "; signal.sigwait([signal.SIGHUP])") as run:
        until(run, lambda: run.is_stopping)
        run.cancel(100.0)
        run.cancel(105.0)
        assert run.look(100.0 + CANCEL_TIME) is None
        until(run, lambda: run.look(101.0 + CANCEL_TIME) is not None)
        assert run.outcome == "killed by SIGKILL after its last tick: summary and report may be missing"


def test_one_that_begins_or_drives_has_all_time_to_end_in_order(tmp_path: Path) -> None:
    with started(tmp_path, TICKING + "manager.tell('READY=1'); signal.sigwait([signal.SIGHUP])") as run:
        until(run, lambda: run.is_ready)
        run.cancel(0.0)
        until(run, lambda: run.look(0.0) is not None)
        assert run.outcome == "killed by SIGTERM; the drives stop by themselves"
    deaf = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM]); manager.tell('STATUS=deaf'); signal.pause()"
    with started(tmp_path, TICKING + deaf) as run:
        until(run, lambda: run.status == "deaf")
        run.cancel(0.0)
        run.look(CANCEL_TIME + 1.0)
        assert run.look(CANCEL_TIME + 2.0) is None


def test_it_sees_the_end_of_the_page(tmp_path: Path) -> None:
    program = "import sys, os; sys.stdin.read(); open('ended', 'w').close()"
    page = f"""
from pathlib import Path; import sys, os
from artemis.page.started_run import StartedRun
run = StartedRun([sys.executable, "-c", {program!r}], Path({str(tmp_path)!r}), (), 0.0)
print("begun", flush=True)
os._exit(9)  # as if it was killed
"""
    with started(tmp_path, page) as run:
        until(run, lambda: run.look(0.0) is not None)
        assert "begun" in run.lines()
        until(run, lambda: (tmp_path / "ended").exists())
