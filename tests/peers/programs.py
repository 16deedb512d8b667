"""Programs that a test has begun."""

from __future__ import annotations

import subprocess
from pathlib import Path

from lateness import skip_if_late


def until(process: subprocess.Popen[str], words: str) -> list[str]:
    """The lines of a process up to one with these words; skips a test whose run this computer is too busy for."""
    lines = []
    assert process.stdout is not None
    for line in process.stdout:
        lines.append(line.rstrip())
        skip_if_late(line)
        if words in line:
            return lines
    raise AssertionError("\n".join(lines))


def bridge_of(run: subprocess.Popen[str]) -> int:
    """The process of the run's observer."""
    children = [pid for of in Path(f"/proc/{run.pid}/task").glob("*/children") for pid in of.read_text().split()]
    (bridge,) = [pid for pid in children if b"own_process" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    return int(bridge)
