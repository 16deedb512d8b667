"""Where a run stopped, from what it left behind, so that another can go on there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from artemis.errors import ConfigError, RecordingError
from artemis.recording.journal import Entry, read_journal
from artemis.recording.mcap_reader import RecordedTick, Recording
from artemis.recording.provenance import Resumption
from artemis.recording.run_folder import RunFolder
from artemis.values import Pose

DONE, BROKEN = "done", "did not end in order"
"""How a run ended: with its last step, and by a failure of the program."""
LONGEST_GAP = 1.0
"""A robot that went on for longer than this [s] after the last recorded tick is anywhere."""
MOVING = 0.01
"""Speed [m/s]."""


def where_it_stopped(run: Path, files: Mapping[str, bytes], steps: int) -> tuple[Resumption, list[str]]:
    """Step, progress and place at which a run stopped; and what an operator should know about them.

    Args:
        run: Its folder, or its recording; a damaged one counts as far as it is whole.
        files: The mission file and all that it names, as they are now.
        steps: How many the mission has.

    Raises:
        ConfigError: it was finished, its mission is another one now, or nothing of it can be recovered.
    """
    try:
        recording = Recording(run)
        last, before = recording.last_tick(), recording.resumption
    except RecordingError as error:
        raise _refused(run, str(error)) from error
    _check_files(recording, files)
    entries = recording.journal.entries if recording.journal else ()
    if last is None:
        raise _refused(run, recording.missing or "it holds no tick")
    if last.record.step >= steps or DONE in (recording.outcome, entries[-1].text if _ended(entries) else ""):
        raise ConfigError(f"{run}: this run is done, there is nothing to resume; leave --resume away to drive it again")
    notes = [f"the recording is not whole: {recording.missing}"] if recording.missing else []
    pose, true_pose = Pose(), None
    if before or recording.places_robot():
        pose, true_pose = last.record.odometry.pose, last.record.true_pose
        if true_pose is None:
            notes += _doubts(run, last, entries)
    resumption = Resumption(
        run=recording.path.resolve().parent.name,
        step=last.record.step,
        done=last.record.done,
        pose=pose,
        true_pose=true_pose,
    )
    return resumption, notes


def unfinished_run(root: Path, mission: str) -> tuple[Path, float] | None:
    """The folder of the mission's newest run in `root`, and until when [s] it ran, if nobody ended it."""
    pattern = re.compile(rf"\d{{8}}T\d{{6}}Z-{re.escape(mission)}(-\d+)?")
    folders = [path for path in root.iterdir() if pattern.fullmatch(path.name)] if root.is_dir() else []
    for folder in sorted(folders, reverse=True):
        try:
            entries = read_journal(RunFolder(path=folder).journal).entries
        except RecordingError:
            continue
        begun = any(entry.kind == "mode" for entry in entries)  # else the bus could not even be opened
        if begun and entries[0].data.get("mission") == mission:
            return None if _ended(entries) and entries[-1].text != BROKEN else (folder, entries[-1].time)
    return None


def _check_files(recording: Recording, files: Mapping[str, bytes]) -> None:
    """The mission, and every file that it names, is what it was."""
    then = recording.files
    changed = [name for name in files if then.get(name) != files[name]]
    if changed:
        raise ConfigError(
            [
                f"{name}: is not what it was in {recording.path.parent}, so that run cannot be resumed; bring the file "
                "back from the copy there, or leave --resume away to start afresh"
                for name in changed
            ]
        )


def _ended(entries: tuple[Entry, ...]) -> bool:
    return bool(entries) and entries[-1].kind == "end"


def _doubts(run: Path, last: RecordedTick, entries: tuple[Entry, ...]) -> list[str]:
    """Why a real robot may not stand where the recording ends."""
    time, speed = last.record.time, abs(last.record.odometry.speed)
    until = entries[-1].time if entries else time
    if until > time + LONGEST_GAP:
        seen = f"its recording ends at {time:.2f} s, the run went on until {until:.2f} s"
        raise _refused(run, f"{seen}: nobody knows where the robot is")
    return [f"the robot was moving with {speed:.2f} m/s when the recording ends: it stands further on"] * (
        speed > MOVING
    )


def _refused(run: Path, reason: str) -> ConfigError:
    return ConfigError(f"{run}: cannot be resumed: {reason}; leave --resume away to start afresh")
