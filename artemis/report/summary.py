"""A run in a few numbers."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from artemis.motion.arrays import Array
from artemis.recording.mcap_reader import Recording
from artemis.report.series import Interval, Series, read_series


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a person wants to know first. Lengths in m, times in s, speeds in m/s, angles in rad; None: not known."""

    mission: str
    robot: str
    start: datetime
    result: str
    """How the run ended, in words."""
    missing: str | None
    """What the recording lacks."""
    ticks: int
    duration: float
    wall_duration: float | None
    real_time_factor: float | None
    """Run time through time on the wall."""
    distance: float
    """Distance of the rear axle centre."""
    max_speed: float
    """Of the virtual front wheel."""
    max_wheel_speed: float
    max_steering: float
    """Of a wheel."""
    cross_track_rms: float | None
    cross_track_max: float | None
    """By the estimated pose."""
    source: str
    """Of that: `odometry`, or a localizer's name."""
    true_cross_track_rms: float | None
    true_cross_track_max: float | None
    """By the true pose."""
    given_rms: float | None
    given_max: float | None
    """Distance from the path before smoothing and rounding, by the estimated pose; None also where those changed
    nothing."""
    true_given_rms: float | None
    true_given_max: float | None
    """By the true pose."""
    position_error_end: float | None
    """Distance of the last estimated from the last true position."""
    odometry_error_max: float | None
    """Greatest distance of the position by odometry alone from the true one; None also without a localizer."""
    frames: int
    charge: tuple[float, float] | None
    """Of the battery at the start and at the end, 0 to 1."""
    joules: float | None
    """Taken of it."""
    bus_load_mean: float
    bus_load_max: float
    """Shares, each frame counted with its most stuff bits."""
    waited: float
    """For obstacles."""
    ignored: tuple[str, ...]
    """Where the robot may have touched obstacles, in words."""
    max_late: float
    """How late the latest tick began."""
    steps: tuple[Interval, ...]
    faults: tuple[str, ...]
    """Each fault as it came."""
    resumed: str | None
    """The run that this one resumes."""


def summary(recording: Recording, series: Series | None = None) -> Summary:
    """The summary of a run; `series` saves reading the recording again."""
    run = series or read_series(recording)
    duration = float(run.time[-1] - run.time[0]) if len(run.time) else 0.0
    wall = recording.wall_duration
    return Summary(
        mission=str(recording.mission.get("mission", "")),
        robot=recording.robot.robot,
        start=recording.start,
        result=_result(recording, run),
        missing=recording.incomplete,
        ticks=run.ticks,
        duration=duration,
        wall_duration=wall,
        real_time_factor=duration / wall if wall else None,
        distance=run.distance,
        max_speed=_largest(run.speed),
        max_wheel_speed=max(_largest(wheel.measured) for wheel in run.wheels.values() if wheel.role == "traction"),
        max_steering=max(_largest(wheel.measured) for wheel in run.wheels.values() if wheel.role == "steering"),
        cross_track_rms=run.error.rms,
        cross_track_max=run.error.max,
        source=run.source,
        true_cross_track_rms=run.true_error.rms,
        true_cross_track_max=run.true_error.max,
        given_rms=run.given_error.rms,
        given_max=run.given_error.max,
        true_given_rms=run.true_given_error.rms,
        true_given_max=run.true_given_error.max,
        position_error_end=run.error_end,
        odometry_error_max=run.odometry_error_max,
        frames=run.frames,
        charge=(float(charge[0]), float(charge[-1])) if len(charge := run.charge[np.isfinite(run.charge)]) else None,
        joules=run.joules,
        bus_load_mean=float(np.mean(run.bus_load)) if len(run.bus_load) else 0.0,
        bus_load_max=_largest(run.bus_load),
        waited=run.waited,
        ignored=tuple(entry.text for entry in run.entries if entry.kind == "obstacles"),
        max_late=_largest(run.late),
        steps=run.steps,
        faults=tuple(entry.text for entry in run.entries if entry.kind == "fault"),
        resumed=recording.resume_point.run if recording.resume_point else None,
    )


def _result(recording: Recording, run: Series) -> str:
    ends = [entry.text for entry in run.entries if entry.kind == "end"]  # a recording may end before the run does
    if outcome := recording.outcome or "".join(ends[-1:]):
        why = "; " if ": " in outcome else ": "
        return f"{outcome}{why}{run.mission.failure}" if run.mission.failure else outcome
    if run.finished:
        return "ended normally"
    mode = run.modes[-1].value if run.modes else "the beginning"
    return f"broken off in {mode}"


def consumption(facts: Summary) -> str:
    """What was taken of the battery, in words; empty: nobody knows."""
    if facts.charge is None or facts.joules is None:
        return ""
    begin, end = facts.charge
    metre = f", {facts.joules / facts.distance:.0f} J/m" if facts.distance > 1.0 else ""
    return f"{begin:.1%} to {end:.1%}, {facts.joules / 3600.0:.2f} Wh taken{metre}"


def _largest(values: Array) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(np.max(known)) if len(known) else 0.0
