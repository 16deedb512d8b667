"""Missions driven by input devices of the Linux kernel, where there may be some."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "kernel_hid"
WORDS = "KERNEL_HID"
"""Environment variable with words for the script, such as `--slow 15`."""


@pytest.mark.kernel
@pytest.mark.timeout(3600)
def test_missions_are_driven_by_devices_of_the_kernel() -> None:
    done = subprocess.run([SCRIPT, *os.environ.get(WORDS, "").split()], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    if not any(line.startswith("PASS ") for line in done.stdout.splitlines()):
        pytest.skip(done.stdout.replace("\n", "; "))
