"""`artemis map build` of recorded runs: what of them is missing is said, and what cannot be read before the work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from map_command import call, refused
from office import OFFICE
from synthetic_run import provenance
from test_map_readings import PERIOD, robot_with, scan_of, tick

from artemis.mapping.mapper import Mapper
from artemis.mission.loading import load_model
from artemis.recording.mcap_writer import Recorder
from artemis.vehicle import RobotFile
from artemis_lab.bench.laser_worlds import driven, seen

LMS100 = Path(__file__).parents[2] / "missions" / "robots" / "artemis_lms100.yaml"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run through the office."""
    folder, outline = tmp_path / "run", load_model(LMS100, RobotFile).outline
    folder.mkdir()
    robot = robot_with("front").model_copy(update={"outline": outline}).model_dump_json().encode()
    recorder = Recorder(folder / "recording.mcap", replace(provenance(), robot=robot), threaded=False)
    for number, pose in enumerate(driven([(-2, -3), (0, -3)], 0.25)):
        done = tick(PERIOD * number, pose, scan_of(seen(OFFICE, pose), PERIOD * number))
        recorder.observe(done, [], None)
    recorder.close("done")
    return folder


def test_what_a_recording_lacks_is_told(run: Path, tmp_path: Path) -> None:
    file = run / "recording.mcap"
    assert "not whole" not in call("build", run, "-o", tmp_path / "whole.yaml")
    content = file.read_bytes()
    file.write_bytes(content[: content.index(b"outcome")])
    told = call("build", run, "-o", tmp_path / "cut.yaml")
    assert f"{file}: the recording is not whole: the file is cut off; its last readable tick is 7" in told


def test_every_source_is_opened_before_the_first_is_mapped(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def add(*_: object) -> None:
        raise AssertionError("the first run is mapped already")

    monkeypatch.setattr(Mapper, "add", add)
    output, folder, bad = tmp_path / "m.yaml", tmp_path / "empty", tmp_path / "bad.clf.gz"
    folder.mkdir()
    bad.write_bytes(b"no archive")
    for words, problem in (
        ([tmp_path / "nope"], "nope: no recording here; name a run folder or an MCAP file"),
        ([folder], "recording.mcap: no recording here"),
        ([tmp_path / "nope.clf"], "nope.clf: cannot be read: No such file or directory"),
        ([bad], "bad.clf.gz: cannot be read: Not a gzipped file"),
        ([run, "--scanner", "rear"], "the robot has no scanner 'rear'; it has front"),
    ):
        assert problem in refused("build", run, *words, "-o", output)


def test_two_runs_are_read_in_their_order(run: Path, tmp_path: Path) -> None:
    told = call("build", run, run, "-o", tmp_path / "two.yaml")
    assert "scans       16" in told
