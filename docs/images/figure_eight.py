"""Draw `figure_eight.png`: run the demo mission, and save the first figure of its report. `make picture` does it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from shutil import copytree

from artemis.app import run_mission
from artemis.mission import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.report.figures import path_figure, style
from artemis.report.series import read_series

HERE = Path(__file__).parent
MISSIONS = HERE.parents[1] / "missions"

with tempfile.TemporaryDirectory() as folder:
    missions = copytree(MISSIONS, Path(folder) / "missions", ignore=lambda *_: ["runs"])
    mission = missions / "figure_eight.yaml"
    run = run_mission(load_mission(mission), mission).run
    with style():
        figure = path_figure(read_series(Recording(run.path)))
        figure.set_size_inches(8, 5.2)
        figure.savefig(HERE / "figure_eight.png", dpi=120, facecolor="white")
