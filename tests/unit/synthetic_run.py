"""A run made by hand for the tests of recording and report: bring-up, a lap on a circle, an optional fault."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Goal, Nmt
from artemis.motion.path import path_from_csv
from artemis.recording.journal import Journal
from artemis.recording.mcap_writer import Recorder
from artemis.recording.provenance import Provenance, ResumePoint, first_entries
from artemis.values import (
    DriveCommand,
    DriveFeedback,
    Fault,
    Job,
    JobKind,
    JobResult,
    LocatedPose,
    Mode,
    Odometry,
    OperatorInput,
    Pose,
    Request,
    Sensed,
    SetPoints,
    Severity,
    Snapshot,
    Tick,
    Tracking,
    Verdict,
    Wish,
)
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

START = datetime(2026, 3, 1, 12, 0, 0, 250000, tzinfo=UTC)
RADIUS = 2.0
SPEED = 0.5
DRIVES = ("traction-left", "traction-right", "steer-left", "steer-right")
CIRCLE = "x,y\n" + "".join(
    f"{RADIUS * math.sin(angle):.5f},{RADIUS * (1 - math.cos(angle)):.5f}\n"
    for angle in (math.tau * i / 200 for i in range(200))
)
MISSION = {"mission": "circle", "steps": [{"follow": {"path": "paths/circle.csv", "laps": 1}}]}


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    tick: Tick
    frames: list[tuple[bool, Frame]]
    true_pose: Pose


def robot() -> RobotFile:
    return RobotFile.model_validate(load(Path(__file__).parents[2] / "missions/robots/artemis.yaml").data)


def provenance() -> Provenance:
    return Provenance(
        start=START,
        mission=msgspec.json.encode(MISSION),
        robot=robot().model_dump_json().encode(),
        files={"paths/circle.csv": CIRCLE.encode()},
    )


def run(laps: int = 1, *, hz: float = 50.0, fault_at: float | None = None) -> Iterator[Observed]:
    """Init until 1.5 s, ready until 2 s, then the circle; after the laps 0.5 s of ready and the end."""
    length = path_from_csv(CIRCLE, "circle.csv").with_laps(laps).length
    steering = math.atan(robot().geometry.wheelbase_m / RADIUS)
    distance = 0.0
    ended = None
    for index in range(10_000_000):
        time = index / hz
        if fault_at is not None and time >= fault_at:
            mode = Mode.FAULT
        elif time < 2.0:
            mode = Mode.INIT if time < 1.5 else Mode.READY
        else:
            mode = Mode.FOLLOW if distance < length else Mode.READY
        if mode is Mode.READY and distance >= length:
            ended = time if ended is None else ended
        finished = ended is not None and time > ended + 0.5
        speed = SPEED * min(1.0, time - 2.0) if mode is Mode.FOLLOW else 0.0
        distance += speed * math.cos(steering) / hz
        yield _observed(index, time, Mode.END if finished else mode, distance, length, speed, steering)
        if finished or (fault_at is not None and time > fault_at + 1.0):
            return


def record(
    path: Path,
    observed: Iterator[Observed],
    *,
    threaded: bool = False,
    outcome: str = "done",
    journal: Journal | None = None,
    resume_point: ResumePoint | None = None,
) -> Path:
    made_from = replace(provenance(), resume_point=resume_point)
    recorder = Recorder(path, made_from, threaded=threaded, journal=journal, errors=robot().errors)
    for entry in first_entries("circle", "ARTEMIS", made_from, None) if journal else []:
        recorder.note(entry)
    for each in observed:
        recorder.observe(each.tick, each.frames, each.true_pose)
    recorder.close(outcome)
    return path


def _observed(
    index: int, time: float, mode: Mode, distance: float, length: float, speed: float, steering: float
) -> Observed:
    offset = 0.06 * math.exp(-distance) + 0.01 * math.sin(3.0 * distance)
    angle, radius = distance / RADIUS, RADIUS - offset
    estimated = Pose(
        x=radius * math.sin(angle), y=RADIUS - radius * math.cos(angle), heading=math.remainder(angle, math.tau)
    )
    drift = 0.002 * distance
    true = Pose(
        x=estimated.x * math.cos(drift) - estimated.y * math.sin(drift),
        y=estimated.x * math.sin(drift) + estimated.y * math.cos(drift),
        heading=estimated.heading + drift,
    )
    set_points = _set_points(speed, steering if mode is Mode.FOLLOW else 0.0, distance)
    sensed = _sensed(index, time, mode, set_points)
    faults = (
        Fault(id="DRV-25", severity=Severity.OFF, text="steer-left: following error <too large>", device="steer-left"),
    )
    verdict = Verdict(severity=Severity.OFF, faults=faults, to_fault=True) if mode is Mode.FAULT else Verdict()
    odometry = Odometry(pose=estimated, speed=speed, steering=set_points.steering, distance=distance, slip=0.001)
    snapshot = Snapshot(
        sensed=sensed,
        dt=0.02 if index else 0.0,
        pose=LocatedPose(pose=odometry.pose),
        odometry=odometry,
        standing=speed == 0.0,
        set_points=set_points,
        verdict=verdict,
    )
    driving = mode is Mode.FOLLOW
    wish = Wish(
        command=DriveCommand(speed=speed, steering=set_points.steering),
        traction=Goal.ENABLED if time >= 1.0 else Goal.DISABLED,
        steering=Goal.ENABLED if time >= 1.0 else Goal.DISABLED,
        jobs=(Job(id=1, kind=JobKind.CONFIGURE, drive="traction-left"),) if index == 20 else (),
        phase=("listen" if time < 0.3 else "configure" if time < 1.0 else "align") if mode is Mode.INIT else "",
        tracking=Tracking(arc_length=min(distance, length), length=length, cross_track=offset) if driving else None,
        finished=mode is Mode.END,
    )
    tick = Tick(snapshot=snapshot, mode=mode, wish=wish, set_points=set_points)
    return Observed(tick=tick, frames=_frames(index, time, sensed), true_pose=true)


def _set_points(speed: float, steering: float, distance: float) -> SetPoints:
    wave = steering * (1.0 + 0.15 * math.sin(2.0 * distance))
    return SetPoints(
        speed=speed,
        steering=wave,
        speed_left=0.94 * speed,
        speed_right=1.06 * speed,
        steering_left=1.05 * wave,
        steering_right=0.95 * wave,
    )


def _sensed(index: int, time: float, mode: Mode, set_points: SetPoints) -> Sensed:
    if mode is Mode.FAULT:
        state = DriveState.FAULT
    elif time < 0.1:
        state = DriveState.UNKNOWN
    else:
        state = DriveState.SWITCH_ON_DISABLED if time < 1.0 else DriveState.OPERATION_ENABLE
    velocities = dict(zip(DRIVES, (set_points.speed_left, set_points.speed_right, 0.0, 0.0), strict=True))
    angles = dict(zip(DRIVES, (0.0, 0.0, set_points.steering_left, set_points.steering_right), strict=True))
    drives = tuple(
        DriveFeedback(
            name=name,
            state=state,
            statusword=0x0537,
            position=angles[name] * 0.98 if name.startswith("steer") else time * 0.4,
            velocity=round((velocities[name] + 0.004 * math.sin(31.0 * time)) / 0.01) * 0.01,
            current=0.4 + 0.1 * math.sin(7.0 * time),
            mode=3,
            potentiometers=(2.51, 2.49) if name.startswith("steer") else (0.0, 0.0),
            age=0.004 if time >= 0.1 else None,
            nmt=Nmt.OPERATIONAL if time >= 0.1 else None,
            heartbeat_age=0.013 if time >= 0.1 else None,
            boots=1 if index == 5 and name == "steer-left" else 0,
        )
        for name in DRIVES
    )
    results = (JobResult(id=1, kind=JobKind.CONFIGURE, drive="traction-left", ok=True, detail="38 objects"),)
    return Sensed(
        index=index,
        time=time,
        drives=drives,
        inputs=(OperatorInput(source="stick", age=0.01, axes=(0.0, 0.5), buttons=(False, True)),),
        requests=(Request.ARM,) if index == 50 else (),
        results=results if index == 40 else (),
    )


def _frames(index: int, time: float, sensed: Sensed) -> list[tuple[bool, Frame]]:
    frames = [(True, Frame(0x80, b"", False, time)), (True, Frame(0x77F, b"\x05", False, time))]
    for node, drive in enumerate(sensed.drives, start=1):
        position = int(drive.position * 1e5).to_bytes(4, "little", signed=True)
        for base in (0x180, 0x280):
            frames.append((False, Frame(base + node, position + b"\x37\x05\x00\x00", False, time + 0.001)))
        for base in (0x200, 0x300):
            frames.append((True, Frame(base + node, b"\x0f\x00" + position, False, time + 0.002)))
    return frames
