"""The image of packaging/Containerfile, built and run by podman: `scripts/container`."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ("podman", "runc", "mmdebstrap")
PATIENCE = 3000
"""Seconds, on a busy machine: packages of Debian and Python are installed."""


@pytest.mark.exhaustive
@pytest.mark.timeout(PATIENCE + 60)
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, for the base image")
def test_the_image_is_built_and_runs() -> None:
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        pytest.skip(f"needs the programs {', '.join(missing)}: scripts/container --tools")
    done = subprocess.run([ROOT / "scripts/container"], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS") == 8, done.stdout
