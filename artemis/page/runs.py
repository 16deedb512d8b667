"""The runs of a folder, and the facts of each for a list. Reads, and changes nothing."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import msgspec

from artemis.errors import RecordingError
from artemis.recording.journal import Entry, JournalContent, is_under_way, read_journal
from artemis.recording.mcap_file import MAGIC
from artemis.recording.mcap_reader import Recording
from artemis.recording.run_folder import RunFolder
from artemis.values import Tick

MOST_FAULTS = 30
"""Different faults of a run that a list names."""
REPLAY = "replay"
"""The folder in that of a run that what replays it is kept in."""


class RunFacts(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the list."""

    mission: str = ""
    robot: str = ""
    simulated: bool = False
    start: str = ""
    """Date and time in UTC (ISO 8601); empty: unknown."""
    duration: float = 0.0
    """Run time [s]."""
    state: str = "unfinished"
    """`over`, `running`, or `unfinished`: it ended without a word."""
    outcome: str = ""
    """How it ended, in short."""
    problem: str = ""
    """What of it cannot be read; empty: nothing."""
    faults: dict[str, int] = {}
    """Number of occurrences by the text of a fault."""
    distance: float | None = None
    """That the rear axle's centre drove, forwards and backwards [m]; None: unknown."""


def runs_of(root: Path) -> list[str]:
    """Names of the folders of runs in `root`, the newest first. What symbolic links lead to is none of it."""
    found = []
    with suppress(OSError), os.scandir(root) as entries:  # no folder yet: no run yet
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) and is_run(Path(entry.path)):
                found.append(entry.name)
    return sorted(found, reverse=True)


def is_run(folder: Path) -> bool:
    """Whether a folder is one of a run."""
    run = RunFolder(path=folder)
    return any(file.is_file() and not file.is_symlink() for file in (run.recording, run.journal))


def find(roots: Sequence[Path], root: str, name: str) -> Path | None:
    """The folder of the run `name` in the folder of this number; None: there is none."""
    if not root.isdecimal() or not root.isascii() or len(root) > 3 or int(root) >= len(roots):
        return None
    if name != os.path.basename(name) or name in ("", ".", "..") or "\0" in name:
        return None
    folder = roots[int(root)] / name
    return folder if folder.is_dir() and not folder.is_symlink() and is_run(folder) else None


def signature(folder: Path) -> list[int]:
    """What changes when a run's files do: sizes and times of its recording and journal."""
    run, found = RunFolder(path=folder), []
    for file in (run.recording, run.journal):
        try:
            seen = file.stat()
        except OSError:
            found += [0, 0]
        else:
            found += [seen.st_size, seen.st_mtime_ns]
    return found


def has_report(folder: Path) -> bool:
    """Whether there is one, of the recording as it is now."""
    run = RunFolder(path=folder)
    try:
        return run.report.stat().st_mtime_ns >= run.recording.stat().st_mtime_ns
    except OSError:
        return False


def facts_of(folder: Path) -> RunFacts:
    """The facts in the journal; where those do not suffice, in the recording, which is then read completely."""
    run = RunFolder(path=folder)
    journal = _journal(run.journal)
    entries: Sequence[Entry] = journal.entries if journal is not None else ()
    begun = entries[0].data if entries and entries[0].kind == "start" else {}
    ended = [entry for entry in entries if entry.kind == "end"]
    alive = not ended and is_under_way(run.journal)
    driven = ended[-1].data.get("driven_m") if ended else None
    problems = [journal.missing] if journal is not None and journal.missing else []
    outcome, duration = ended[-1].text if ended else "", entries[-1].time if entries else 0.0
    if not alive and (not begun or driven is None or not _is_whole(run.recording)):
        try:
            recording = Recording(folder)
        except RecordingError as error:
            problems.append(_short(error, folder))
        else:
            problems += [recording.missing] if recording.missing else []
            last = _last(recording, problems)
            outcome = outcome or recording.outcome
            duration = max(duration, last.snapshot.time if last else 0.0)
            driven = driven if last is None else last.snapshot.odometry.driven
            begun = begun or _of_recording(recording)
            entries = entries or tuple(_events(recording, problems))
    return RunFacts(
        mission=str(begun.get("mission", "")),
        robot=str(begun.get("robot", "")),
        simulated=begun.get("bus") == "simulation",
        start=str(begun.get("date", "")),
        duration=duration,
        state="over" if ended or outcome else "running" if alive else "unfinished",
        outcome=outcome,
        problem="; ".join(problems),
        faults=dict(Counter(entry.text for entry in entries if entry.kind == "fault").most_common(MOST_FAULTS)),
        distance=driven if isinstance(driven, int | float) else None,
    )


def _journal(file: Path) -> JournalContent | None:
    try:
        return read_journal(file)
    except RecordingError:
        return None


def _is_whole(recording: Path) -> bool:
    """Whether the file was ended as it should; what is in it is not looked at."""
    try:
        with recording.open("rb") as file:
            file.seek(-len(MAGIC), os.SEEK_END)
            return file.read() == MAGIC  # the last bytes of a whole file, too (MCAP specification, "Magic")
    except OSError:
        return False


def _short(error: RecordingError, folder: Path) -> str:
    return str(error).removeprefix(f"{folder}{os.sep}")


def _last(recording: Recording, problems: list[str]) -> Tick | None:
    try:
        return recording.last_tick()
    except RecordingError as error:
        problems.append(_short(error, recording.path.parent))
        return None


def _events(recording: Recording, problems: list[str]) -> list[Entry]:
    try:
        return list(recording.entries())
    except RecordingError as error:
        problems.append(_short(error, recording.path.parent))
        return []


def _of_recording(recording: Recording) -> dict[str, object]:
    """The content of the first entry of its journal."""
    found: dict[str, object] = {"date": recording.start.isoformat()}
    with suppress(RecordingError):
        found |= {"mission": recording.mission.get("mission", ""), "bus": recording.mission.get("bus")}
        found["robot"] = recording.robot.robot
    return found
