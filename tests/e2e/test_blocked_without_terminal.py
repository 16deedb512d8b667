"""A run that a plugin blocks ends also where its terminal is gone, or belongs to another program."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest
from command_line import PATIENCE

BLOCKED = """
import time
from artemis.plugins.process import AskedPlugin, ended_if_blocked

def block():
    asked = AskedPlugin()
    with ended_if_blocked(asked, print, blocked=0.5):
        asked.begin("stick")
        print("blocked", flush=True)
        time.sleep(1000)
"""
IN_BACKGROUND = """
import fcntl, os, signal, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
if not (job := os.fork()):
    os.setpgid(0, 0)
    block()
_, status = os.waitpid(job, os.WUNTRACED)
if os.WIFSTOPPED(status):
    os.kill(job, signal.SIGKILL)
os._exit(0 if os.WIFSTOPPED(status) else os.waitstatus_to_exitcode(status))
"""


def started_at(terminal: int, code: str) -> subprocess.Popen[str]:
    """A process with its standard input at a terminal, which is no terminal of this one any more."""
    process = subprocess.Popen(
        [sys.executable, "-c", BLOCKED + code],
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    os.close(terminal)
    assert process.stdout is not None
    assert process.stdout.readline() == "blocked\n"
    return process


@pytest.mark.realtime
@pytest.mark.parametrize("code", ["block()", IN_BACKGROUND], ids=["terminal gone", "in the background"])
def test_a_blocked_run_ends_without_a_terminal_of_its_own(code: str) -> None:
    master, terminal = pty.openpty()
    with started_at(terminal, code) as process:
        try:
            if code != IN_BACKGROUND:
                os.close(master)
            _, errors = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
            if code == IN_BACKGROUND:
                os.close(master)
    assert process.returncode == 71
    assert "artemis: plugin 'stick' has not answered for 0.5 s: the run is ended" in errors


FULL_PIPE = """
import os
os.set_blocking(2, False)
try:
    while True:
        os.write(2, bytes(1024))
except BlockingIOError:
    os.set_blocking(2, True)
block()
"""


@pytest.mark.realtime
def test_a_blocked_run_ends_where_nobody_reads_what_it_prints() -> None:
    code = [sys.executable, "-c", BLOCKED + FULL_PIPE]
    with subprocess.Popen(code, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            assert process.wait(PATIENCE) == 71
        finally:
            process.kill()
