"""`artemis devices --mission M`: what it says of scanners."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path

import pytest

from artemis.commands import devices
from artemis.mission.loading import load_mission

MISSIONS = Path(__file__).parents[2] / "missions"


def told(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str = "", new: str = "", bus: str = "simulation"
) -> str:
    for name in ("robots", "paths"):
        shutil.copytree(MISSIONS / name, folder / name, dirs_exist_ok=True)
    robot = folder / "robots" / "artemis_lms100.yaml"
    robot.write_text(robot.read_text().replace(old, new) if old else robot.read_text())
    mission = folder / "look.yaml"
    mission.write_text((MISSIONS / "look_around.yaml").read_text().replace("bus: simulation", f"bus: {bus}"))
    devices._show_scanners(load_mission(mission))
    return capsys.readouterr().out


def test_a_simulated_scanner(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    title, line = told(tmp_path, capsys).splitlines()
    assert title == "scanners of ARTEMIS (simulated)"
    assert line.startswith("  front  lms1xx at 192.168.0.1: 541 beams from -135 to 135 degrees, 5")
    assert line.endswith(" of them return")


def test_one_that_is_not_there_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
        title, line = told(
            tmp_path, capsys, "host: 192.168.0.1", f"host: 127.0.0.1\n    port: {port}", "{interface: virtual}"
        ).splitlines()
    assert title == "scanners of ARTEMIS"
    assert line.startswith(f"  front  lms1xx at 127.0.0.1, {port}: 127.0.0.1:{port}: ")
    assert "refused" in line


def test_a_robot_without_scanners_has_no_such_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (MISSIONS / "robots" / "artemis_lms100.yaml").read_text()
    assert told(tmp_path, capsys, text[text.index("scanners:") :], "") == ""
