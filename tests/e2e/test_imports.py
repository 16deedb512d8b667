"""What a run does not need is not imported before the run: it would delay the start, and take memory, for nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from command_line import PATIENCE, ROBOT, write_mission

RUN = """
import sys
from pathlib import Path
from artemis.commands import run
run._conclude = lambda *_: print("imported:", *sys.modules)
sys.exit(run.run_and_report(Path(sys.argv[1]), True))
"""
RUN_AND_REPORT = """
import sys
from pathlib import Path
from artemis.commands import run
status = run.run_and_report(Path(sys.argv[1]), True)
print("imported:", *sys.modules)
sys.exit(status)
"""
CHECK = """
import sys
from pathlib import Path
from artemis.mission.loading import load_mission
load_mission(Path(sys.argv[1]))
print("imported:", *sys.modules)
"""

BRIDGES = ("rosbags", "cyclonedds", "websockets", "foxglove")
"""What talks to other programs."""


def imported(program: str, mission: Path) -> set[str]:
    """Modules, and packages above them, that are there before the report of a run."""
    command = [sys.executable, "-c", program, str(mission)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    names = done.stdout.partition("imported: ")[2].split()
    assert "artemis.mission.loading" in names
    return set(names)


def unwanted(names: set[str], *packages: str) -> list[str]:
    return sorted(name for name in names if name.startswith(tuple(f"{p}." for p in packages)) or name in packages)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("program", [CHECK, RUN])
def test_a_run_along_a_path_imports_no_scipy(tmp_path: Path, program: str) -> None:
    names = imported(program, write_mission(tmp_path))

    assert unwanted(names, "matplotlib", "artemis.calibration", "artemis.report.figures", "scipy") == []


def test_the_report_of_a_run_needs_no_matplotlib(tmp_path: Path) -> None:
    names = imported(RUN_AND_REPORT, write_mission(tmp_path))

    assert "artemis.report.page" in names
    assert unwanted(names, "matplotlib", "PIL") == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("program", [CHECK, RUN])
def test_a_run_without_a_path_imports_no_scipy(tmp_path: Path, program: str) -> None:
    mission = tmp_path / "wait.yaml"
    mission.write_text("mission: wait\nrobot: robot.yaml\nbus: simulation\nsteps:\n  - wait: {seconds: 0.1}\n")
    (tmp_path / "robot.yaml").write_bytes(ROBOT.read_bytes())
    names = imported(program, mission)

    assert unwanted(names, "matplotlib", "artemis.calibration", "scipy") == []


def test_the_main_path_imports_nothing_of_other_programs() -> None:
    """What a tick does is known without them; what they say comes in as samples, and goes out as ticks."""
    program = (
        "import sys, artemis.robot, artemis.devices.drive, artemis.plugins.guard; print('imported:', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    names = set(done.stdout.partition("imported: ")[2].split())

    assert "artemis.states.modes" in names
    assert unwanted(names, "artemis.bridges", "artemis.page", *BRIDGES) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("program", [CHECK, RUN])
def test_a_run_without_other_programs_imports_nothing_that_talks_to_them(tmp_path: Path, program: str) -> None:
    names = imported(program, write_mission(tmp_path))
    own = [f"artemis.bridges.{name}" for name in ("ros1", "ros2", "rosbridge", "ros_types", "topics", "received")]

    assert unwanted(names, *own, *BRIDGES) == []
