"""The missions of a folder: what is one, what a check says, and what changes meanwhile."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from artemis.page import mission_folder
from artemis.page.mission_folder import MOST_FILES, CheckedMission, MissionFolder

CHECK = """
import json, os, sys
for name in sys.argv[1:]:
    text = open(name).read()
    if "ends" in text:
        os._exit(3)
    print("a plugin prints", flush=True)
    problems = ["no"] * 60 if "wrong" in text else []
    print(json.dumps({"file": name, "hash": text, "problems": problems, "simulated": True}), flush=True)
"""


def in_folder(tmp_path: Path, play: Callable[[MissionFolder], object], check: str = CHECK) -> None:
    """Have something done with the folder on a running loop."""

    async def main() -> None:
        news = asyncio.Event()
        folder = MissionFolder(tmp_path / "missions", [sys.executable, "-c", check], news.set)
        try:
            await asyncio.wait_for(play(folder), 60.0)  # type: ignore[arg-type]
        finally:
            await folder.close()

    (tmp_path / "missions").mkdir(exist_ok=True)
    asyncio.run(main())


async def checked(folder: MissionFolder) -> dict[str, CheckedMission]:
    folder.look()
    while any(not facts.checked for facts in folder.missions):
        await asyncio.sleep(0.01)
    return {facts.file: facts for facts in folder.missions}


def write(tmp_path: Path, name: str, more: str = "") -> Path:
    path = tmp_path / "missions" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"# A lap.\nmission: {path.stem}\n{more}\n")
    return path


def test_missions_are_listed_and_one_that_ends_its_check_holds_up_no_other(tmp_path: Path) -> None:
    for name, more in (("a.yaml", "wrong"), ("b.yml", "ends"), ("c.yaml", ""), ("d.txt", "")):
        write(tmp_path, name, more)
    (tmp_path / "missions" / "robot.yaml").write_text("robot: A\nits: {mission: none}\n")
    os.mkfifo(tmp_path / "missions" / "pipe.yaml")

    async def play(folder: MissionFolder) -> None:
        found = await checked(folder)
        assert sorted(found) == ["a.yaml", "b.yml", "c.yaml"]
        assert [found[name].may_start for name in sorted(found)] == [False, False, True]
        assert len(found["a.yaml"].problems) == mission_folder.MOST_PROBLEMS
        assert found["b.yml"].problems == ("b.yml: its check ended with status 3 and without a word",)

    in_folder(tmp_path, play)


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    outside = tmp_path / "outside.yaml"
    outside.write_text("mission: outside\n")
    write(tmp_path, "inside.yaml")
    (tmp_path / "missions" / "link.yaml").symlink_to(outside)
    (tmp_path / "missions" / "near.yaml").symlink_to("inside.yaml")
    (tmp_path / "missions" / "gone.yaml").symlink_to("nothing")

    async def play(folder: MissionFolder) -> None:
        found = await checked(folder)
        assert {name: facts.may_start for name, facts in found.items()} == {
            "inside.yaml": True,
            "link.yaml": False,
            "near.yaml": True,
        }
        assert found["link.yaml"].problems == ("link.yaml: is a link to a file outside of the folder",)

    in_folder(tmp_path, play)


def test_a_file_that_changes_or_goes_is_seen(tmp_path: Path) -> None:
    path, other = write(tmp_path, "a.yaml", "first"), write(tmp_path, "b.yaml")

    async def play(folder: MissionFolder) -> None:
        first = (await checked(folder))["a.yaml"].hash
        folder.look()
        assert all(facts.checked for facts in folder.missions), "nothing changed: nothing is checked again"
        path.write_text("mission: a\nsecond: and longer\n")
        other.unlink()
        folder.look()
        assert folder.get("a.yaml") == CheckedMission(file="a.yaml", checked=False)
        found = await checked(folder)
        assert list(found) == ["a.yaml"]
        assert found["a.yaml"].hash != first
        folder.look(anew=True)
        while folder.missions[0].checked:
            await asyncio.sleep(0)
        await checked(folder)

    in_folder(tmp_path, play)


def test_a_file_that_changes_while_it_is_checked_is_checked_again(tmp_path: Path) -> None:
    path = write(tmp_path, "a.yaml", "first")

    async def play(folder: MissionFolder) -> None:
        folder.look()
        path.write_text("mission: a\nsecond: and longer\n")
        assert "second" in (await checked(folder))["a.yaml"].hash

    in_folder(tmp_path, play)


def test_a_check_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_folder, "PATIENCE", 0.2)
    write(tmp_path, "a.yaml")

    async def play(folder: MissionFolder) -> None:
        assert (await checked(folder))["a.yaml"].problems == ("a.yaml: its check did not end within 0.2 s",)

    in_folder(tmp_path, play, "import signal; signal.pause()")


def test_too_many_files_and_no_folder_are_said(tmp_path: Path) -> None:
    for number in range(MOST_FILES + 1):
        (tmp_path / f"{number:03}.yaml").touch()

    async def play(_: MissionFolder) -> None:
        crowd = MissionFolder(tmp_path, [], lambda: None)
        crowd.look()
        assert crowd.note == f"only the first {MOST_FILES} of {MOST_FILES + 1} files are shown"
        none = MissionFolder(tmp_path / "none", [], lambda: None)
        none.look()
        assert (none.note, none.missions) == ("none: No such file or directory", [])

    in_folder(tmp_path, play)
