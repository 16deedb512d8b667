"""`artemis run`: a mission with its live view, its summary and its page."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from math import degrees
from pathlib import Path
from shlex import quote
from typing import Any

from artemis.app import Outcome, Watch, resume_point_of, run_mission
from artemis.attendance import Operator
from artemis.commands.answering import Answering
from artemis.commands.live import LiveView
from artemis.commands.page import announce, page_of
from artemis.commands.started import page_that_started, report_unbroken, told_to
from artemis.commands.terminal import (
    ACCEPT_KEYS,
    ANSWER_KEYS,
    ANSWERING,
    DRIVING,
    HINT,
    KEYS,
    somebody_is_there,
)
from artemis.devices.multicast import INTERFACE, free_group, place_of
from artemis.errors import ConfigError, RecordingError
from artemis.mission.extras import slower_without_numba
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import BusWords
from artemis.notify import STATUS, ServiceManager
from artemis.planning import (
    asks,
    check_drivable,
    inputs_used,
    is_fast,
    is_simulated,
    preparations,
    straight_by_hand,
)
from artemis.recording.disk import Disk, low_disk
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import ResumePoint
from artemis.recording.resume import unfinished_run
from artemis.report.mission_times import MissionTimes
from artemis.report.page import write_report
from artemis.report.series import read_series
from artemis.report.summary import Summary, consumption, summary
from artemis.run_record import content_hash
from artemis.values import Request


def run_and_report(
    source: Path,
    simulate: bool,
    resume: Path | None = None,
    page: Mapping[str, Any] | None = None,
    checked: str | None = None,
) -> int:
    """Run the mission in `source`, print the summary, write its report. Returns the exit status.

    `resume` is an earlier run of it, to be resumed where that stopped; `page`: serve a page for operators, with these
    keys of its observer. A run that `artemis page` starts is of what was `checked` there (`content_hash`).

    Raises:
        ConfigError: the mission, or its resume_point, is refused; nothing has moved.
        DeviceLost: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    loaded = load_mission(source, simulate, page=page)
    if checked is not None and checked != content_hash(loaded, source):
        raise ConfigError(f"{source}: it, or a file that it names, has changed since it was checked: check it again")
    resume_point = _resume_point(loaded, source, resume, simulate)
    started_by = None if checked is None else page_that_started()
    outcome = run_in_sight(loaded, source, simulate, resume_point, started_by=started_by)
    if outcome.failed:
        with suppress(ConfigError):  # then it cannot be resumed; `--resume` says why
            resume_point_of(loaded, source, outcome.run.path, simulate)
            _print("resume", _command(source, outcome.run.path, simulate))
    return outcome.exit_status


def _with_answers(
    loaded: LoadedMission, keys: Mapping[bytes, Request | str], hint: str, simulated: bool
) -> tuple[Mapping[bytes, Request | str], str]:
    """Keys and their hint, with those for what the mission, or the bring-up of its robot, asks a person."""
    if asks(loaded):
        keys, hint = {**keys, **ANSWER_KEYS}, f"{hint}; {ANSWERING}"
    if straight_by_hand(loaded):
        keys, hint = {**keys, **ACCEPT_KEYS}, f"{hint}; enter accepts that the wheels stand straight"
    driving = any(use.plugin == "keyboard" for use in inputs_used(loaded, simulated).values())
    return keys, f"{hint}; {DRIVING}" if driving else hint


def run_in_sight(
    loaded: LoadedMission,
    source: Path,
    simulate: bool,
    resume_point: ResumePoint | None = None,
    watch: Watch = lambda tick, traffic: None,
    keys: Mapping[bytes, Request | str] = KEYS,
    hint: str = HINT,
    then: Callable[[Outcome], None] = lambda outcome: None,
    started_by: Operator | None = None,
) -> Outcome:
    """Run a loaded mission with its live view, print the summary, write its page.

    Args:
        loaded: The mission.
        source: Its file.
        simulate: Against simulated drives, whatever its bus.
        resume_point: The run to go on with.
        watch: Sees every tick, too.
        keys: What the keys of the terminal ask for.
        hint: Names them.
        then: Is called as soon as the run is over, before the summary: what must not be missed if that breaks off.
        started_by: Listens to the program that started it, and attends it; None: a terminal, or nobody, does.

    Raises:
        ConfigError: nothing is driven over its bus; nothing has moved.
        DeviceLost: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    simulated, fast = is_simulated(loaded, simulate), is_fast(loaded, simulate)
    check_drivable(loaded, source, simulated)
    keys, hint = _with_answers(loaded, keys, hint, simulated)
    answering = Answering([number for number, (_, step) in enumerate(loaded.tree.steps) if step.ask is not None])
    at_keys = partial(answering.listen, keys=keys) if somebody_is_there() and not fast else None
    operator = started_by or at_keys
    terminate = partial(signal.raise_signal, signal.SIGTERM)  # nobody sees what the robot does: an ordered end
    _forewarn(loaded, low_disk(loaded.folder / loaded.mission.record, Disk()) if operator or fast else None)
    robot, keys_heard = loaded.robot, hint if at_keys and not started_by else ""
    view = LiveView(_title(loaded, simulated), keys_heard, terminate, robot.bitrate, robot.errors, _times(loaded))
    for prepare in () if fast else preparations(loaded, simulated):
        _print("prepares", "scan matching, before the robot is touched: compiled, half a minute the first time")
        prepare()
    if not started_by:
        announce(page_of(loaded))
    manager = ServiceManager()
    outcome = run_mission(
        loaded,
        source,
        simulate=simulate,
        watch=told_to(manager, answering.beside(watch)),
        observers={"live view": view},
        operator=operator,
        tell=partial(_print, "start"),
        resume_point=resume_point,
    )
    with report_unbroken():
        then(outcome)
        _conclude(outcome, "" if simulated else _another_bus(loaded, outcome), manager)
    return outcome


def _forewarn(loaded: LoadedMission, warning: str | None) -> None:
    if warning:
        _print("warning", warning)
    for remark in (*loaded.remarks, *slower_without_numba(loaded)):
        _print("remark", remark)


def _resume_point(loaded: LoadedMission, source: Path, resume: Path | None, simulate: bool) -> ResumePoint | None:
    """Where to go on, told to whoever starts it; without an earlier run, whether the last one was left unfinished."""
    if resume is None:
        root, simulated = loaded.folder / loaded.mission.record, is_simulated(loaded, simulate)
        if left := unfinished_run(root, loaded.mission.mission, simulated=simulated):
            run, until = left
            if until is None:
                _print("last run", f"{run} is still under way")
            else:
                command = _command(source, run, simulate)
                _print("last run", f"ended without shutdown at {until:.2f} s; to resume it: {command}")
        return None
    found, notes = resume_point_of(loaded, source, resume, simulate)
    at = found.position
    _, step = loaded.tree.steps[at.step]
    done, what = f"{at.done:.2f} {'m' if step.word == 'follow' else 's'}", step.word
    _print("resuming", f"{found.run}: step {at.step + 1} ({what}), {done} of it done")
    pose = found.pose
    _print("", f"where it stopped: x {pose.x:.2f} m, y {pose.y:.2f} m, heading {degrees(pose.heading):.0f} deg")
    _print("", "the robot must not have been moved since: the odometry continues from there")
    for note in notes:
        _print("warning", note)
    return found


def _command(source: Path, run: Path, simulate: bool) -> str:
    return f"artemis run {quote(str(source))}{' --simulate' * simulate} --resume {quote(str(run))}"


def _times(loaded: LoadedMission) -> MissionTimes | None:
    """What the live view knows of a mission with words; None: it has none."""
    written = loaded.mission.model_dump(mode="json", by_alias=True)
    return None if loaded.tree.tree.is_list else MissionTimes(written)


def _title(loaded: LoadedMission, simulated: bool) -> str:
    bus = loaded.mission.bus
    place = place_of(bus.words) if isinstance(bus, BusWords) and not simulated else ""
    return f"mission {loaded.mission.mission}: {loaded.robot.robot} on {place or 'simulated drives'}"


def _another_bus(loaded: LoadedMission, outcome: Outcome) -> str:
    """Where a run that found another artemis on its bus can go instead."""
    bus = loaded.mission.bus
    if "COM-18" not in outcome.reason or not isinstance(bus, BusWords) or bus.words.get("interface") != INTERFACE:
        return ""
    return f"to run beside the other one, take a free group: bus: {{interface: {INTERFACE}, channel: {free_group()}}}"


def _conclude(outcome: Outcome, advice: str, manager: ServiceManager) -> None:
    """Print the summary, then write the page: drawing its figures takes longer than many a run."""

    def print_result(faults: Sequence[str], failure: str) -> None:
        words = _result(outcome, faults, failure)
        _print("result", words)
        manager.tell(STATUS + " ".join(words.splitlines()))

    sys.stdout.write("\n")
    try:
        recording = Recording(outcome.run.path)
        series = read_series(recording)
        found = summary(recording, series)
    except RecordingError as error:  # the disk failed; how the run ended is known all the same
        print_result((), "")
        _print("recording", str(error))
        return
    print_result(found.faults, series.mission.failure)
    if advice:
        _print("", advice)
    if series.mission.remedy:
        _print("", series.mission.remedy)
    for label, text in _numbers(found):
        _print(label, text)
    speed = outcome.duration / outcome.elapsed
    _print("run time", f"{outcome.duration:.1f} s in {outcome.elapsed:.2f} s: {speed:.1f} x real time")
    _print("run folder", str(outcome.run.path))
    for text in outcome.maps:
        _print("map", text)
    for trouble in outcome.troubles:
        _print("recording", f"not whole: {trouble}")
    try:
        write_report(recording, outcome.run.report, series)
    except RecordingError as error:
        _print("report", str(error))
    else:
        _print("report", str(outcome.run.report))


def _print(label: str, text: str) -> None:
    sys.stdout.write(f"{label:12}  {text}\n")
    sys.stdout.flush()


def _result(outcome: Outcome, faults: Sequence[str], failure: str) -> str:
    if outcome.interrupted is not None:
        released = not any(fault.startswith("COM-34") for fault in faults)  # else the fault says which is not
        return f"ended by {signal.Signals(outcome.interrupted).name}" + "; drives stopped and released" * released
    why = "; ".join(filter(None, (outcome.reason, failure))) or "stopped before its last step"
    return f"FAILED: {why}" if outcome.failed else "done"


def _numbers(found: Summary) -> list[tuple[str, str]]:
    lines = (
        [("recording", f"not whole: {found.missing}; the numbers below are of what could be read")]
        if found.missing
        else []
    )
    lines.append(("distance", f"{found.distance:.2f} m, up to {found.max_speed:.2f} m/s"))
    for label, name, rms, worst in (
        ("cross-track", "estimated", found.cross_track_rms, found.cross_track_max),
        ("cross-track", "true", found.true_cross_track_rms, found.true_cross_track_max),
        ("as given", "estimated", found.given_rms, found.given_max),
        ("as given", "true", found.true_given_rms, found.true_given_max),
    ):
        if rms is not None and worst is not None:
            path = ", from the path before it was smoothed and rounded" if label == "as given" else ""
            text = f"{rms * 1000:5.1f} mm RMS, {worst * 1000:5.1f} mm at most, by the {name} pose{path}"
            lines.append((label, text))
    if found.position_error_end is not None:
        lines.append((found.source, f"{found.position_error_end * 1000:5.1f} mm from the true position at the end"))
    if found.odometry_error_max is not None:
        lines.append(("odometry", f"alone {found.odometry_error_max:.2f} m from the true position at most"))
    if taken := consumption(found):
        lines.append(("battery", taken))
    lines.append(("bus load", f"{found.bus_load_mean:.1%}, {found.bus_load_max:.1%} at most"))
    return [*lines, *(("fault", text) for text in found.faults)]
