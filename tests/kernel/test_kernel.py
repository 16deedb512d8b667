"""Missions over CAN interfaces and by input devices of the Linux kernel, where there are some."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


def passes_of(script: str) -> list[str]:
    """What a script in `scripts` says of what passed; skips the test if it can try nothing here.

    The environment variable of its name in capitals has words for it, such as `--slow 10`.
    """
    words = os.environ.get(script.upper(), "").split()
    done = subprocess.run([SCRIPTS / script, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = [line for line in done.stdout.splitlines() if line.startswith("PASS ")]
    if not passed:
        pytest.skip(done.stdout.replace("\n", "; "))
    return passed


@pytest.mark.kernel
@pytest.mark.timeout(900)
def test_missions_are_driven_over_can_interfaces_of_the_kernel() -> None:
    assert all("m, up to 0." in line for line in passes_of("kernel_can"))


@pytest.mark.kernel
@pytest.mark.timeout(3600)
def test_missions_are_driven_by_devices_of_the_kernel() -> None:
    assert passes_of("kernel_hid")


@pytest.mark.kernel
@pytest.mark.timeout(3600)
def test_missions_are_driven_by_event_devices_of_the_kernel() -> None:
    assert passes_of("kernel_evdev")
