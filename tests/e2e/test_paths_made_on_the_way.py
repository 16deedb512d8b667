"""A path that is planned or recorded in a run is made beside the ticks: none is late for it, or loads modules."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import PATIENCE, artemis, only_run
from rig import CALIBRATE, STICK, Steps, write_mission
from rig import stick as table

from artemis.mapping.map_file import map_files
from artemis.mapping.occupancy import OccupancyMap
from artemis.whole_files import write_bytes

OUTLINE = "\noutline: {front_m: 0.68, rear_m: 0.12, half_width_m: 0.27}\n"
WATCHED = """
import sys
from pathlib import Path
from artemis import robot
from artemis.commands import run
from artemis.motion import path, fitting

decide, loaded, ticking = robot.Core.decide, set(), False

def watched(core, sensed):
    global ticking
    before, ticking = set(sys.modules), True
    try:
        return decide(core, sensed)
    finally:
        loaded.update(set(sys.modules) - before)
        ticking = False

def beside(function):
    def called(*given, **words):
        assert not ticking, function.__name__
        return function(*given, **words)
    return called

robot.Core.decide = watched
fits = path.path_from_points, fitting.fitted
for module in [each for name, each in sys.modules.items() if name.startswith("artemis.")]:
    for function in fits:
        if getattr(module, function.__name__, None) is function:
            setattr(module, function.__name__, beside(function))
status = run.run_and_report(Path(sys.argv[1]), True)
print("loaded in ticks:", *sorted(loaded))
sys.exit(status)
"""


def to_a_place(folder: Path, **simulation: Any) -> Path:  # noqa: ANN401 (keys of a mission)
    """A metre on a map."""
    steps: Steps = [CALIBRATE, {"goto": {"map": "floor.yaml", "to": {"x_m": 1.8, "y_m": 0.8, "heading_deg": 0}}}]
    localizer = {"plugin": "simulated_tracker", "noise_m": 0.003}
    true_robot = {"x_m": 0.8, "y_m": 0.8}
    path = write_mission(folder, steps, simulation={"true_robot": true_robot, "localizer": localizer, **simulation})
    with (folder / "artemis.yaml").open("a") as robot:
        robot.write(OUTLINE)
    cells = np.zeros((40, 70), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    write_bytes(map_files(folder / "floor.yaml", OccupancyMap(cells=cells, resolution=0.05, origin=(0.0, 0.0, 0.0))))
    return path


def shown(folder: Path, **simulation: Any) -> Path:  # noqa: ANN401 (keys of a mission)
    """A curve by hand, backwards along it by itself."""
    rows = [(0.0, 0.0, 0.0, 0), (8.0, 0.0, 0.0, 1), (8.2, 0.0, 0.6, 1), (9.5, -0.9, 0.5, 1), (11.5, 0.0, 0.0, 1)]
    files = {"stick.csv": table(*rows, (12.5, 0.0, 0.0, 0))}
    path = {"recorded": "shown"}
    follower = {"plugin": "indiveri", "speed_m_s": 0.3}
    steps: Steps = [
        CALIBRATE,
        {"teleop": {"input": "stick", "until": {"button": "done"}, "record": "shown"}},
        {"follow": {"path": path, "from_end": True, "allow_slowdown": True, "follower": follower}},
    ]
    return write_mission(folder, steps, files, inputs=STICK, simulation=simulation)


@pytest.mark.parametrize("mission", [to_a_place, shown])
def test_no_tick_fits_a_path_or_loads_a_module(tmp_path: Path, mission: Callable[..., Path]) -> None:
    command = [sys.executable, "-c", WATCHED, str(mission(tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.partition("loaded in ticks:")[2].split() == []


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(180)
@pytest.mark.parametrize("mission", [to_a_place, shown])
def test_in_real_time_no_tick_is_late_for_it(tmp_path: Path, mission: Callable[..., Path]) -> None:
    done = artemis("run", mission(tmp_path, pace="real_time"))
    assert done.returncode == 0, done.stdout + done.stderr
    journal = [json.loads(line) for line in (only_run(tmp_path) / "journal.jsonl").read_text().splitlines()]
    assert [entry["text"] for entry in journal if entry["kind"] == "fault"] == []
