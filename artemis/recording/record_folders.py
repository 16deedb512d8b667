"""The folders in which this user's runs on real drives are recorded: one of them may have driven the robot since."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from artemis.user_folders import user_folder


def noted_folders() -> list[Path]:
    """Those of earlier runs on this computer that are still there."""
    try:
        lines = _place().read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except (OSError, RuntimeError):
        return []
    return [Path(line) for line in lines if Path(line).is_dir()]


def note_folder(folder: Path) -> None:
    """Note the folder of a run that begins. One that cannot be noted is not missed: resuming looks in its own first."""
    folder = folder.resolve()
    if folder in noted_folders():
        return
    with suppress(OSError, RuntimeError):  # a user without a home
        place = _place()
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("a", encoding="utf-8", errors="surrogateescape") as file:
            file.write(f"{folder}\n")


def _place() -> Path:
    return user_folder("XDG_STATE_HOME", ".local/state") / "record_folders"
