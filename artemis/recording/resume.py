"""Where a run stopped, from what it left behind, so that another can resume it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import chain, takewhile
from math import degrees
from pathlib import Path

from msgspec.structs import replace

from artemis.errors import ConfigError, RecordingError
from artemis.motion.track import Track
from artemis.progress import Position
from artemis.recording.journal import Entry, is_under_way, read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import ResumePoint
from artemis.recording.record_folders import noted_folders
from artemis.recording.run_folder import RunFolder
from artemis.recording.schemas import TickRecord
from artemis.states.outline import numbered
from artemis.values import Mode, Pose, Request

DONE, BROKEN = "done", "did not end normally"
"""How a run ended: with its last step, and by a failure of the program."""
LONGEST_GAP = 1.0
"""A robot that went on for longer than this [s] after the last recorded tick is anywhere."""
MOVING = 0.01
"""Speed [m/s]."""
SIMULATION = "simulation"
"""The bus of a simulated run."""
_DISK = ("DSK-02", "DSK-03", "DSK-05")
_DRIVING = (Mode.TELEOP.value, Mode.FOLLOW.value, Mode.ACT.value)


def where_it_stopped(
    run: Path, files: Mapping[str, bytes], steps: int, *, simulated: bool, root: Path
) -> tuple[ResumePoint, list[str]]:
    """Step, progress and place at which a run stopped; and what an operator should know about them.

    Args:
        run: Its folder, or its recording; a damaged one counts as far as it is whole.
        files: The mission file and all that it names and that must not have changed, as they are now.
        steps: How many the mission has.
        simulated: The run that resumes it is.
        root: Where the mission's runs lie.

    Raises:
        ConfigError: it is under way or was finished, its mission is another one now, it was simulated and this one is
            not or the other way round, the position of the robot is unknown now, or nothing of it can be recovered.
    """
    try:
        return _where_it_stopped(Recording(run), run, files, steps, simulated, root)
    except RecordingError as error:
        raise _refused(run, str(error)) from error


def _where_it_stopped(
    recording: Recording, run: Path, files: Mapping[str, bytes], steps: int, simulated: bool, root: Path
) -> tuple[ResumePoint, list[str]]:
    if is_under_way(RunFolder(path=recording.path.parent).journal):
        raise ConfigError(f"{run}: cannot be resumed: this run is still under way; end it first")
    last, before = recording.last_tick(), recording.resume_point
    was_simulated = recording.mission.get("bus") == SIMULATION
    _check_files(recording, files)
    entries = recording.journal.entries if recording.journal else ()
    if last is None:
        raise _refused(run, recording.missing or "it holds no tick")
    if last.position.step >= steps or DONE in (recording.outcome, entries[-1].text if _ended(entries) else ""):
        raise ConfigError(f"{run}: this run is complete; omit --resume to run the mission again")
    if was_simulated and not simulated:
        raise _refused(run, "it was simulated, and this run is not; it can be resumed only with --simulate")
    if simulated and not was_simulated:
        raise _refused(run, "it was not simulated, and this run is")
    if last.snapshot.pose.lost:
        why = (
            "wheels rolled while their encoders were not read"
            if last.snapshot.odometry.lost
            else "no localizer had seen it for long"
        )
        raise _refused(run, f"{why}: the position of the robot is unknown")
    if not simulated and (since := _driven_since(recording, root)) is not None:
        raise _refused(run, f"{since.name} has driven the robot since: only that run knows where it is")
    notes = [f"the recording is not whole: {recording.missing}"] if recording.missing else []
    if last.true_pose is None:
        if unrecorded := _unrecorded(recording, last, entries):
            raise _refused(run, f"{unrecorded}: the position of the robot is unknown")
        notes += _moving(last)
    pose, true_pose = Pose(), None
    if before or recording.places_robot():
        pose, true_pose = last.snapshot.pose.pose, last.true_pose
    position, snapshot = last.position, last.snapshot
    driven, time = position.driven + snapshot.odometry.driven, position.time + snapshot.time
    resume_point = ResumePoint(
        run=recording.path.resolve().parent.name,
        position=replace(position, driven=driven, time=time),
        pose=pose,
        true_pose=true_pose,
        tracks=_tracks(run, recording, last.position),
    )
    return resume_point, notes


def unfinished_run(root: Path, mission: str, *, simulated: bool) -> tuple[Path, float | None] | None:
    """The folder of the mission's newest run in `root`, and until when [s] it ran, if it was not ended in order.

    None instead of a time: it is still under way.
    """
    for folder, entries in _journals(root, re.escape(mission)):
        begun = any(entry.kind == "mode" for entry in entries)  # else the bus could not even be opened
        facts = entries[0].data if begun else {}
        if begun and facts.get("mission") == mission and (facts.get("bus") == SIMULATION) is simulated:
            if is_under_way(RunFolder(path=folder).journal):
                return folder, None
            return None if _ended(entries) and entries[-1].text != BROKEN else (folder, entries[-1].time)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class LastPlace:
    """Where a run left the robot, as far as that still tells where it is."""

    pose: Pose | None
    """On the map; None: nobody knows where the robot is now."""
    told: str
    """Which run left it where; or why its place is unknown."""


def last_place(mine: Path, mission: str, robot: str, files: Mapping[str, bytes], *, simulated: bool) -> LastPlace:
    """Where the newest run of a mission left the robot, of those before the run in the folder `mine`, beside it.

    Args:
        mine: Folder of the run that begins.
        mission: Its mission.
        robot: Its robot.
        files: What the poses are relative to, such as a map, as it is now: by the names in the mission.
        simulated: Simulated runs count, and only they; each of their robots stands where its mission puts it.
    """
    for folder, entries in _journals(mine.parent, re.escape(mission)):
        facts = entries[0].data if entries else {}
        if folder.name >= mine.name or (facts.get("mission"), facts.get("robot")) != (mission, robot):
            continue
        if (facts.get("bus") == SIMULATION) != simulated:
            continue
        try:
            recording = Recording(folder)
            last = recording.last_tick()
            if last is not None:
                return _place_left(recording, last, entries, files, mine)
        except RecordingError:
            continue
    return LastPlace(pose=None, told="no earlier run of this mission")


def _place_left(
    recording: Recording, last: TickRecord, entries: tuple[Entry, ...], files: Mapping[str, bytes], mine: Path
) -> LastPlace:
    located, run = last.snapshot.pose, recording.path.resolve().parent.name
    changed = next((name for name, content in files.items() if recording.files.get(name) != content), None)
    why = ""
    if located.lost or located.frame != "map":
        why = f"{run} did not know where the robot was when it ended"
    elif changed is not None:
        why = f"{changed} is not what it was in {run}"
    elif last.true_pose is None:  # else each run's robot is simulated
        since = _driven_since(recording, mine.parent, but=mine.resolve())
        unrecorded = _unfinished(recording, entries) or _unrecorded(recording, last, entries) or " ".join(_moving(last))
        why = f"{since.name} has driven the robot since {run}" if since else unrecorded and f"{run}: {unrecorded}"
    if why:
        return LastPlace(pose=None, told=why)
    pose, ended = located.pose, recording.start + timedelta(seconds=last.snapshot.time)
    place = f"x {pose.x:.2f} m, y {pose.y:.2f} m, heading {degrees(pose.heading):.0f} deg"
    return LastPlace(pose=pose, told=f"{place}: there {run} ended at {ended:%Y-%m-%d %H:%M:%S}")


def _journals(root: Path, mission: str = ".*") -> Iterator[tuple[Path, tuple[Entry, ...]]]:
    """Every run of a mission (a pattern) in `root`, the newest first, with its journal."""
    pattern = re.compile(rf"\d{{8}}T\d{{6}}Z-{mission}(-\d+)?")
    folders = [path for path in root.iterdir() if pattern.fullmatch(path.name)] if root.is_dir() else []
    for folder in sorted(folders, reverse=True):
        try:
            yield folder, read_journal(RunFolder(path=folder).journal).entries
        except RecordingError:
            continue


def _check_files(recording: Recording, files: Mapping[str, bytes]) -> None:
    """The mission, and every file that it names, is what it was."""
    then = recording.files
    changed = [name for name in files if then.get(name) != files[name]]
    if changed:
        raise ConfigError(
            [
                f"{name}: is not what it was in {recording.path.parent}, so that run cannot be resumed; bring the file "
                "back from the copy there, or omit --resume to start from the beginning"
                for name in changed
            ]
        )


def _ended(entries: tuple[Entry, ...]) -> bool:
    return bool(entries) and entries[-1].kind == "end"


def _unfinished(recording: Recording, entries: tuple[Entry, ...]) -> str:
    """Why nobody knows what a run did at last; empty: it was ended, and is recorded in full."""
    if recording.missing:
        return f"its recording is not whole: {recording.missing}"
    return "" if _ended(entries) else "it was not ended in order"


def _unrecorded(recording: Recording, last: TickRecord, entries: tuple[Entry, ...]) -> str:
    """Why a real robot may stand anywhere but where the recording ends; empty: it does not."""
    time = last.snapshot.time
    until = entries[-1].time if entries else time
    if until > time + LONGEST_GAP:
        return f"its recording ends at {time:.2f} s, the run lasted until {until:.2f} s"
    if not entries and recording.missing:
        return "its recording is cut off, and no journal shows how long the run lasted"
    for entry in entries:
        if entry.kind == "fault" and entry.data.get("id") in _DISK and entry.time > time:
            return f"the disk failed ({entry.data['id']} at {entry.time:.2f} s) after what is recorded"
    return ""


def _moving(last: TickRecord) -> list[str]:
    """That a robot stands further along than recorded, if it does."""
    speed = abs(last.snapshot.odometry.speed)
    return [
        f"the robot was moving with {speed:.2f} m/s when the recording ends: it stands further along than recorded"
    ] * (speed > MOVING)


def _driven_since(recording: Recording, root: Path, but: Path | None = None) -> Path | None:
    """A run of whichever mission that began after this one, and drove the same robot, in `root` or where others lie.

    None: there is none `but` that in this folder.
    """
    begun, roots = f"{recording.start:%Y%m%dT%H%M%SZ}", {root.resolve(), *noted_folders()}
    later = [takewhile(lambda found: found[0].name[:16] >= begun, _journals(each)) for each in sorted(roots)]
    for folder, entries in chain.from_iterable(later):
        facts = entries[0].data if entries else {}
        if facts.get("bus") == SIMULATION or facts.get("robot") != recording.robot.robot or folder == but:
            continue
        drove = any(entry.kind == "mode" and entry.data.get("to") in _DRIVING for entry in entries)
        if drove and datetime.fromisoformat(facts["date"]) > recording.start:
            return folder
    return None


def _tracks(run: Path, recording: Recording, position: Position) -> dict[str, Track]:
    """What was driven in steps that record it, up to a position: made again from the ticks as mode teleop made it.

    Raises:
        ConfigError: ticks are missing of a path that is needed.
    """
    before, steps = recording.resume_point, enumerate(numbered(recording.mission["steps"]))
    records = {number: body for number, (_, word, body) in steps if word == "teleop" and body.get("record")}
    tracks = deepcopy(before.tracks) if before else {}
    if not records:
        return tracks
    current, index = before.position.step if before else 0, -1
    for tick in recording.ticks():
        teleop = records.get(current) if tick.mode is Mode.TELEOP else None
        if teleop is not None and tick.wish.done == 0.0:
            tracks.pop(teleop["record"], None)
        if teleop is not None and not tick.snapshot.pose.lost:
            if tick.snapshot.sensed.index != index + 1:
                raise _refused(run, f"ticks are missing while the path {teleop['record']} was recorded")
            sources = teleop.get("inputs") or [teleop["input"]]
            samples = (sample for sample in tick.snapshot.sensed.inputs if sample.source in sources)
            pressed = any(Request.RECORD in sample.requests for sample in samples)
            tracks.setdefault(teleop["record"], Track()).see(tick.snapshot.pose.pose, pressed=pressed)
        current, index = tick.position.step, tick.snapshot.sensed.index
    earlier = [body["record"] for number, body in records.items() if number < position.step]
    missing = [name for name in earlier if name not in tracks and not position.place]  # in a list each was done
    if missing:
        raise _refused(run, f"nothing is left of the path {missing[0]}, which was recorded by driving")
    return tracks


def _refused(run: Path, reason: str) -> ConfigError:
    return ConfigError(f"{run}: cannot be resumed: {reason}; omit --resume to start from the beginning")
