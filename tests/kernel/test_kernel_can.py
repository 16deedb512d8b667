"""Two processes over CAN interfaces of the Linux kernel, where there are some."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "kernel_can"
WORDS = "KERNEL_CAN"
"""Environment variable with words for the script, such as `--slow 10` or the names of two connected interfaces."""


@pytest.mark.kernel
@pytest.mark.timeout(900)
def test_missions_are_driven_over_can_interfaces_of_the_kernel() -> None:
    done = subprocess.run([SCRIPT, *os.environ.get(WORDS, "").split()], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = [line for line in done.stdout.splitlines() if line.startswith("PASS ")]
    if not passed:
        pytest.skip(done.stdout.replace("\n", "; "))
    assert all("m, up to 0." in line for line in passed)
