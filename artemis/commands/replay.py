"""`artemis replay`."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from artemis.commands.wholeness import tell_missing
from artemis.errors import ConfigError, RecordingError
from artemis.mission.loading import load_mission
from artemis.mission.page import has_page
from artemis.planning import core_from
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import made_with
from artemis.recording.replay import replay
from artemis.yaml_file import MAX_BYTES, survey


def replay_run(run: Path) -> int:
    """Recompute every command of a run. Returns 0 when all are equal, 1 when one differs.

    Raises:
        RecordingError: the recording cannot be read, or holds no mission or no tick.
        ConfigError: this version of artemis refuses the mission, or misses a plugin of it.
    """
    recording = Recording(run)
    with tempfile.TemporaryDirectory() as folder:
        simulated = recording.mission.get("bus") == "simulation"
        page: dict[str, Any] | None = (
            {} if has_page(recording.mission) else None
        )  # that one was added by the command line, or is there
        loaded = load_mission(_unpack(recording, Path(folder)), simulated, tried=False, page=page)
        loaded = replace(loaded, routes={**loaded.routes, **recording.routes})
        result = replay(recording, core_from(loaded, recording.resume_point, simulated))
    if not result.ticks:
        raise RecordingError(f"{recording.path}: holds no tick; {recording.missing or 'nothing to recompute'}")
    tell_missing(recording)
    if result.difference:
        sys.stdout.write(result.difference + "\n" + _versions(recording))
        return 1
    of = f" of the {recording.number} ticks that are there" if result.ticks < recording.number else " ticks"
    sys.stdout.write(f"{result.ticks}{of} recomputed: every command equal, bit for bit\n")
    return 0


def _versions(recording: Recording) -> str:
    """What of other versions made the recording: corners are rounded by numpy and scipy, whose last bits change."""
    other = {name: (recording.versions.get(name, "?"), now) for name, now in made_with().items()}
    told = [f"{name} {then}, here {now}" for name, (then, now) in other.items() if then != now]
    return f"it was recorded with {'; '.join(told)}\n" if told else ""


def _unpack(recording: Recording, folder: Path) -> Path:
    """Lay the run's files out as the mission names them; the mission's path."""
    for name, content in recording.files.items():
        target = folder / name
        if not target.resolve().is_relative_to(folder.resolve()):
            raise RecordingError(f"the recording holds a file outside its folder: {name}")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    missions = [name for name, content in recording.files.items() if _is_mission(name, content)]
    if len(missions) != 1:
        raise RecordingError("the recording does not hold its mission file")
    return folder / missions[0]


def _is_mission(name: str, content: bytes) -> bool:
    """Whether a recorded file is the mission itself: no other file may have a key `mission` at its top."""
    if "/" in name or b"mission" not in content or len(content) > MAX_BYTES:
        return False
    try:
        document, _ = survey(content, name)
    except ConfigError:  # no YAML: a path or another table
        return False
    return isinstance(document.data, dict) and "mission" in document.data
