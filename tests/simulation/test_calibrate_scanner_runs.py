"""`artemis calibrate scanner` on simulated drives whose scanner sits where nobody knows."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest
from rig import MISSIONS, run

from artemis.calibration.scanner_drive import scanner_drive
from artemis.calibration.scanner_fit import fit_mounting
from artemis.commands.calibrate_scanner import calibrate_scanner
from artemis.recording.mcap_reader import Recording
from artemis.yaml_file import read, survey

pytestmark = [pytest.mark.exhaustive, pytest.mark.short_alignment, pytest.mark.timeout(900)]
DRIVE = MISSIONS / "calibrate_scanner.yaml"
TRUE = "{x_m: 0.60, y_m: -0.03, heading_deg: 3, upside_down: true}"


def test_a_mounting_is_found_within_its_interval(tmp_path: Path) -> None:
    """A scanner that looks to the right; other mountings: ../unit/test_calibrate_scanner.py, without a run."""
    words = "{x_m: 0.096, y_m: -0.081, heading_deg: -94.9, upside_down: false}"
    text = DRIVE.read_text().replace(TRUE, words).replace("seed: 31", "seed: 2")
    for folder in ("robots", "paths"):
        shutil.copytree(MISSIONS / folder, tmp_path / folder)
    mission = tmp_path / "drive.yaml"
    mission.write_text(text)
    outcome = run(mission, longest=400.0).outcome
    assert outcome is not None
    recording = Recording(outcome.run.path)

    drive = scanner_drive(recording.ticks(), recording.robot, "front")
    found = fit_mounting(drive.odometry, drive.scanner)

    assert not drive.mirrored
    off = [abs(found.mounting[0] - 0.096), abs(found.mounting[1] + 0.081)]
    off.append(abs(math.remainder(found.mounting[2] - math.radians(-94.9), math.tau)))
    assert all(each < width for each, width in zip(off, found.half_width.tolist(), strict=True))
    assert all(each < most for each, most in zip(off, (0.005, 0.005, math.radians(0.2)), strict=True))


def test_the_mission_is_told_and_its_mounting_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcome = run(DRIVE, longest=400.0).outcome
    assert outcome is not None
    robot = tmp_path / "robot.yaml"
    robot.write_bytes((MISSIONS / "robots" / "artemis_lms100.yaml").read_bytes())

    calibrate_scanner(outcome.run.path, None, robot, yes=True)

    told = capsys.readouterr().out
    assert "it is the other way up than the robot file says" in told
    assert f"written: {robot}" in told
    front = survey(read(robot), "")[0].data["scanners"]["front"]  # type: ignore[index, call-overload]
    assert front["upside_down"] is True  # type: ignore[index, call-overload]
    assert front["x_m"] == pytest.approx(0.6, abs=0.005)  # type: ignore[index, call-overload]
    assert front["y_m"] == pytest.approx(-0.03, abs=0.005)  # type: ignore[index, call-overload]
    assert front["heading_deg"] == pytest.approx(3.0, abs=0.2)  # type: ignore[index, call-overload]
