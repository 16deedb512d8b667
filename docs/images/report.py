"""Takes a picture of the report of a figure eight with Debian's chromium: docs/images/report.png."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from artemis.app import run_mission
from artemis.mission.loading import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report

ROOT = Path(__file__).parents[2]
SIZE = "1120,1960"
"""Of the window: as far as the first charts [px]."""


def main() -> None:
    """Drive, write the page, open it."""
    with tempfile.TemporaryDirectory() as scratch:
        missions = Path(scratch) / "missions"
        shutil.copytree(ROOT / "missions", missions, ignore=shutil.ignore_patterns("runs"))
        mission = missions / "fault_recovery.yaml"
        outcome = run_mission(load_mission(mission), mission)
        write_report(Recording(outcome.run.path), outcome.run.report)
        out = ROOT / "docs/images/report.png"
        words = [
            "--headless",
            "--no-sandbox",
            "--hide-scrollbars",
            "--virtual-time-budget=5000",
            f"--window-size={SIZE}",
        ]
        profile = f"--user-data-dir={scratch}/profile"
        subprocess.run(
            ["chromium", *words, f"--window-size={SIZE}", profile, f"--screenshot={out}", outcome.run.report.as_uri()],
            check=True,
            capture_output=True,
        )
    sys.stdout.write(f"{out}\n")


if __name__ == "__main__":
    main()
