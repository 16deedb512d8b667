"""Path files are written whole or not at all."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from artemis.commands.path_files import comments, write_files
from artemis.errors import ConfigError


def test_files_are_written_beside_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("mine")
    write_files({tmp_path / "a.csv": "1", tmp_path / "b.csv": "2"}, force=False)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {
        "other.csv": "mine",
        "a.csv": "1",
        "b.csv": "2",
    }


def test_one_file_that_is_there_keeps_all_from_being_written(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("mine")
    files = {tmp_path / "a.csv": "1", tmp_path / "b.csv": "2", tmp_path / "no" / "c.csv": "3"}
    with pytest.raises(ConfigError) as caught:
        write_files(files, force=False)
    assert caught.value.problems == [
        f"{tmp_path}/b.csv: exists already; choose another name or --force",
        f"{tmp_path}/no: no such folder",
    ]
    assert [file.name for file in tmp_path.iterdir()] == ["b.csv"]


def test_a_folder_that_is_not_there_is_told_once(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    with pytest.raises(ConfigError) as refused:
        write_files({nowhere / "a.csv": "123", nowhere / "b.csv": "456"}, force=False)
    assert refused.value.problems == [f"{nowhere}: no such folder"]


def test_a_full_disk_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Path.write_bytes

    def full(self: Path, content: bytes) -> int:
        whole(self, content[:1])
        if self.name.startswith("b"):
            raise OSError(errno.ENOSPC, "No space left on device")
        return 1

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(ConfigError, match=r"b\.csv: cannot be written: No space left on device"):
        write_files({tmp_path / "a.csv": "123", tmp_path / "b.csv": "456"}, force=False)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_replaced_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv.part").mkdir()
    with pytest.raises(ConfigError, match=r"a\.csv: cannot be written"):
        write_files({tmp_path / "a.csv": "123"}, force=False)


def test_a_comment_is_one_line(tmp_path: Path) -> None:
    assert comments(["a", "b\nc", "\x1b[2J"]) == "# a\n# 'b\\nc'\n# '\\x1b[2J'\n"
