"""A run as the page that started it sees it: its words, its last lines, how it ends, and that it ends with the page.

Real processes, and times that the tests give.
"""

from __future__ import annotations

import itertools
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
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
        run.end(0.0)
        until(run, lambda: run.look(0.0) is not None)
        assert (run.look(0.0), run.outcome) == (0, "done")


@pytest.mark.parametrize(("result", "told"), [("FAILED: DRV-25", "failed: DRV-25"), ("done", "done")])
def test_its_result_is_what_it_reports_after_its_last_tick_whatever_it_prints(
    tmp_path: Path, result: str, told: str
) -> None:
    says = f"manager.tell('READY=1', 'STATUS=follow'); manager.tell('STOPPING=1'); manager.tell('STATUS={result}');"
    with started(tmp_path, f"{TICKING}{says} print('result  of a plugin\\n' * 60)") as run:
        until(run, lambda: run.look(0.0) is not None)
        assert (run.look(0.0), run.outcome) == (0, told)


def test_its_last_lines_are_kept_and_not_all_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(started_run, "MOST_OUTPUT", 5000)
    first = "from signal import *; pthread_sigmask(SIG_BLOCK, [SIGTERM]); print(*range(2000), sep='\\n', flush=True)"
    with started(tmp_path, f"{first}; sigwait([SIGTERM]); print('x' * 5000); raise SystemExit(2)") as run:
        while run.lines()[-1:] != ["1999"]:
            PAUSE.wait(0.01)
        run.look(0.0)
        assert len(run.lines()) == MOST_LINES
        run.end(0.0)
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


def test_one_that_ticks_is_asked_once_to_end_and_then_to_stop_quickly(tmp_path: Path) -> None:
    program = """
signal.signal(signal.SIGTERM, lambda *_: print("SIGTERM", flush=True))
signal.signal(signal.SIGHUP, lambda *_: print("SIGHUP", flush=True))
manager.tell("READY=1", "STATUS=" + str(os.getpid()))
sys.stdin.read()
print("END", flush=True)
signal.pause()
"""
    with started(tmp_path, TICKING + program) as run:
        until(run, lambda: run.is_ready)
        run.end(0.0)
        until(run, lambda: run.lines() == ["END"])
        assert run.killed_at == inf, "it has all time to end in order"
        run.end(0.0)
        until(run, lambda: run.lines() == ["END", "SIGHUP"])


DEAF = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, signal.SIGINT]); "


@pytest.mark.parametrize("asked", [StartedRun.end, StartedRun.cancel])
def test_one_that_hangs_before_its_first_tick_is_killed_some_time_after_it_was_told_to_end(
    tmp_path: Path, asked: Callable[[StartedRun, float], None]
) -> None:
    with started(tmp_path, TICKING + DEAF + "manager.tell('STATUS=deaf'); signal.pause()") as run:
        until(run, lambda: run.status == "deaf")
        asked(run, 100.0)
        asked(run, 105.0)
        assert run.look(100.0 + CANCEL_TIME) is None
        until(run, lambda: run.look(101.0 + CANCEL_TIME) is not None)
        assert run.outcome == (
            f"it did not end within {CANCEL_TIME:g} s: killed by SIGKILL before its first tick; "
            "it had enabled no drive, and one that was enabled stops by its own watchdog"
        )


def test_one_that_ticks_after_all_has_all_time_to_end_in_order(tmp_path: Path) -> None:
    program = DEAF + "manager.tell('STATUS=deaf'); signal.sigwait([signal.SIGTERM]); manager.tell('READY=1'); "
    with started(tmp_path, TICKING + program + "signal.pause()") as run:
        until(run, lambda: run.status == "deaf")
        run.cancel(0.0)
        until(run, lambda: run.is_ready)
        run.cancel(0.0)
        assert (run.look(HANG - 1.0), run.killed_at) == (None, inf)


def test_one_that_is_not_waited_for_after_its_last_tick(tmp_path: Path) -> None:
    over = "manager.tell('READY=1', 'STOPPING=1'); signal.pause()"
    words = "it was not waited for after its last tick; the drives were released before, its report may be missing"
    with started(tmp_path, TICKING + over) as run:
        until(run, lambda: run.is_stopping)
        run.end(0.0)
        assert run.look(100.0) is None, "its report is being made"
        run.cancel(100.0)
        until(run, lambda: run.look(100.0) is not None)
        assert (run.look(100.0), run.outcome) == (-signal.SIGINT, words)
    with started(tmp_path, TICKING + DEAF + over) as run:
        until(run, lambda: run.is_stopping)
        run.cancel(100.0)
        run.cancel(105.0)
        assert run.look(100.0 + CANCEL_TIME) is None
        until(run, lambda: run.look(101.0 + CANCEL_TIME) is not None)
        assert run.outcome == f"it did not end within {CANCEL_TIME:g} s: {words}"


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
