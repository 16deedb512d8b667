"""The folder that a run leaves behind: `runs/<UTC>-<mission>/`."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import count
from pathlib import Path, PurePath

from artemis.errors import RecordingError
from artemis.recording.disk import write_whole


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFolder:
    """Where everything of one run lies."""

    path: Path

    @property
    def recording(self) -> Path:
        """The MCAP file."""
        return self.path / "recording.mcap"

    @property
    def journal(self) -> Path:
        """The journal."""
        return self.path / "journal.jsonl"

    @property
    def report(self) -> Path:
        """The page for people."""
        return self.path / "report.html"

    @property
    def files(self) -> Path:
        """Copies of the files that the mission names."""
        return self.path / "files"

    @property
    def paths(self) -> Path:
        """Paths that were recorded by driving."""
        return self.path / "paths"

    @property
    def map(self) -> Path:
        """The map that was made on the way, its image and its graph beside it."""
        return self.path / "map.yaml"

    @property
    def calibration(self) -> Path:
        """What was measured of the machine."""
        return self.path / "calibration.json"


def keep_paths(folder: RunFolder, paths: Mapping[str, str]) -> list[str]:
    """Write the paths that were driven by hand as `paths/NAME.csv`; what the disk refused."""
    refused = []
    for name, text in paths.items():
        file = folder.paths / f"{name}.csv"
        try:
            file.parent.mkdir(exist_ok=True)
            write_whole(file, text)
        except (OSError, RecordingError) as error:
            refused.append(f"{error}; `artemis path record {folder.path}` makes it again")
    return refused


def keep_calibration(folder: RunFolder, found: Mapping[str, object]) -> list[str]:
    """Write what was measured of the steering, by side, as `calibration.json`; what the disk refused."""
    if not found:
        return []
    try:
        write_whole(folder.calibration, json.dumps({"steering": found}, indent=2) + "\n")
    except RecordingError as error:
        return [f"{error}; the journal has the values"]
    return []


def create_run_folder(root: Path, mission: str, start: datetime, files: Mapping[str, bytes]) -> RunFolder:
    """Make the folder of a run that starts at `start` (UTC), with copies of the mission's `files` by their names.

    Two runs of one second get different folders. A name that leads out of the mission's folder (`../`, `/`) is
    copied under the rest of its path.

    Raises:
        RecordingError: the folder or a copy cannot be made.
    """
    name = re.sub(r"[^\w.-]+", "-", mission).strip("-.") or "mission"
    target = root
    try:
        folder = RunFolder(path=_new_folder(root, f"{start:%Y%m%dT%H%M%SZ}-{name}"))
        for file, content in files.items():
            target = _free(folder.files.joinpath(*_inner_parts(file)))
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    except OSError as error:
        problem = f"{error.filename or target}: {error.strerror}"
        raise RecordingError(f"cannot make the folder of the run: {problem}; see `record:` in the mission") from error
    return folder


def _new_folder(root: Path, name: str) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    for number in count(1):
        path = root / (name if number == 1 else f"{name}-{number}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise AssertionError("count() never ends")


def _inner_parts(file: str) -> list[str]:
    path = PurePath(file)
    return [part for part in path.parts if part not in ("..", ".", path.anchor)]


def _free(path: Path) -> Path:
    """`path`, or where that is taken: with a number before the suffix."""
    candidates = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
    return path if not path.exists() else next(candidate for candidate in candidates if not candidate.exists())
