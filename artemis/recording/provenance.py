"""What a run is made from: its files, and the run that it resumes."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

import msgspec

from artemis.build import version
from artemis.motion.track import Track
from artemis.progress import Position
from artemis.recording.journal import Entry, Level
from artemis.values import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumePoint:
    """Where an earlier run stopped, and this one resumes it."""

    run: str
    """Name of the earlier run's folder."""
    position: Position
    """How far the mission was done."""
    pose: Pose
    """Where it was then: the odometry of the resuming run begins there."""
    true_pose: Pose | None = None
    """Where the robot really was, in the same frame, if the recording knows."""
    tracks: dict[str, Track] = field(default_factory=dict)
    """What had been recorded by driving, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What a run is made from."""

    start: datetime
    """Date and time on the wall at run time 0, with time zone."""
    mission: bytes
    """The resolved mission, JSON, with the bus that the run was on."""
    robot: bytes
    """The resolved robot, JSON."""
    files: Mapping[str, bytes]
    """Contents of every file that the mission names, by the name there."""
    routes: bytes = b""
    """Those of the mission's path files, as `packed_routes`; none: the mission has none."""
    resume_point: ResumePoint | None = None
    """The run that is resumed."""


def made_with() -> dict[str, str]:
    """Versions of everything that decides what the same mission does, to the last bit."""
    packages = {name: version(name) for name in ("numpy", "scipy")}
    return {"artemis": version("artemis-robot"), "python": platform.python_version(), **packages}


def first_entries(
    mission: str,
    robot: str,
    provenance: Provenance,
    warning: str | None,
    remarks: Sequence[str] = (),
    ignored: Sequence[str] = (),
) -> list[Entry]:
    """How a journal begins: of what it is, and since when; which run is resumed; what was wrong before the start.

    And what was changed in the mission's paths; and where the robot may touch obstacles, which is among the remarks.
    """
    facts = {
        "mission": mission,
        "robot": robot,
        "artemis": version("artemis-robot"),
        "date": provenance.start.isoformat(),
        "bus": msgspec.json.decode(provenance.mission).get("bus"),
    }
    entries = [Entry(time=0.0, kind="start", text=f"mission {mission}: {robot}", data=facts)]
    if (resumed := provenance.resume_point) is not None:
        pose = [resumed.pose.x, resumed.pose.y, resumed.pose.heading]
        data = {"run": resumed.run, "step": resumed.position.step, "done": resumed.position.done, "pose": pose}
        entries.append(Entry(time=0.0, kind="resume", text=f"resumes {resumed.run}", data=data))
    if warning:
        entries.append(Entry(time=0.0, kind="warning", text=warning, level=Level.WARNING))
    entries += [Entry(time=0.0, kind="obstacles", text=text, level=Level.WARNING) for text in ignored]
    return entries + [Entry(time=0.0, kind="path", text=remark) for remark in remarks if remark not in ignored]
