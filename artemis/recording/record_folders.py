"""The folders in which this user's runs on real drives are recorded: one of them may have driven the robot since."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def noted_folders() -> list[Path]:
    """Those of earlier runs on this computer that are still there."""
    try:
        lines = _place().read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return []
    return [Path(line) for line in lines if Path(line).is_dir()]


def note_folder(folder: Path) -> None:
    """Note the folder of a run that begins. One that cannot be noted is not missed: resuming looks in its own first."""
    folder = folder.resolve()
    if folder in noted_folders():
        return
    with suppress(OSError):
        place = _place()
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("a", encoding="utf-8", errors="surrogateescape") as file:
            file.write(f"{folder}\n")


def _place() -> Path:
    """XDG Base Directory Specification."""
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path("~/.local/state").expanduser()) / "artemis" / "record_folders"
