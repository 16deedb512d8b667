from __future__ import annotations

import errno
import os
from datetime import UTC, datetime
from pathlib import Path

import pytest

from artemis.errors import RecordingError
from artemis.recording.disk import write_whole
from artemis.recording.run_folder import create_run_folder

START = datetime(2026, 3, 1, 12, 30, 5, tzinfo=UTC)


def test_a_run_folder_is_named_by_date_and_mission(tmp_path: Path) -> None:
    folder = create_run_folder(tmp_path / "runs", "figure-eight", START, {})

    assert folder.path == tmp_path / "runs" / "20260301T123005Z-figure-eight"
    assert folder.path.is_dir()
    assert folder.recording == folder.path / "recording.mcap"
    assert folder.journal == folder.path / "journal.jsonl"
    assert folder.report == folder.path / "report.html"


def test_two_runs_of_one_second_have_different_folders(tmp_path: Path) -> None:
    names = [create_run_folder(tmp_path, "circle", START, {}).path.name for _ in range(3)]

    assert names == ["20260301T123005Z-circle", "20260301T123005Z-circle-2", "20260301T123005Z-circle-3"]


@pytest.mark.parametrize(
    ("mission", "name"),
    [("../../etc", "etc"), ("a b/c", "a-b-c"), ("...", "mission"), ("Würzburg 1.5", "Würzburg-1.5")],
)
def test_no_mission_name_leads_out_of_the_folder(tmp_path: Path, mission: str, name: str) -> None:
    assert create_run_folder(tmp_path, mission, START, {}).path == tmp_path / f"20260301T123005Z-{name}"


def test_files_of_the_mission_are_copied_inside(tmp_path: Path) -> None:
    files = {"mission.yaml": b"a", "../paths/eight.csv": b"b", "paths/eight.csv": b"c", "/abs/robot.yaml": b"d"}
    folder = create_run_folder(tmp_path, "m", START, files)

    copies = {str(p.relative_to(folder.files)): p.read_bytes() for p in folder.files.rglob("*") if p.is_file()}
    assert copies == {"mission.yaml": b"a", "paths/eight.csv": b"b", "paths/eight-2.csv": b"c", "abs/robot.yaml": b"d"}
    assert [path.name for path in tmp_path.iterdir()] == [folder.path.name]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(RecordingError, match=r"runs: File exists; see `record:` in the mission"):
        create_run_folder(tmp_path / "runs", "m", START, {})


def test_a_disk_that_is_full_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error while a file is written has no name in it, other than one while it is opened."""

    def full(_: Path, __: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RecordingError, match=r"files/mission\.yaml: No space left on device; see `record:`"):
        create_run_folder(tmp_path / "runs", "m", START, {"mission.yaml": b"a"})


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "report.html"
    write_whole(file, "before")
    write_bytes = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        write_bytes(path, content[:3])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RecordingError, match=r"report\.html: cannot be written: No space left on device"):
        write_whole(file, "afterwards")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert file.read_text() == "before"
