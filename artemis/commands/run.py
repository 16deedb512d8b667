"""`artemis run` and `artemis report`: a mission with its live view, its summary and its page."""

from __future__ import annotations

import signal
import sys
from functools import partial
from pathlib import Path

from artemis.app import Outcome, is_simulated, run_mission
from artemis.commands.live import LiveView
from artemis.commands.terminal import HINT, listen_to_keys, somebody_is_there
from artemis.errors import RecordingError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.schema import BusWords
from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report
from artemis.report.summary import Summary, summary


def run_and_report(source: Path, simulate: bool) -> int:
    """Run the mission in `source`, print the summary, write its page. Returns the exit status.

    Raises:
        ConfigError: the mission is refused; nothing has moved.
        DeviceLost: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made; nothing has moved.
    """
    loaded = load_mission(source)
    simulated = is_simulated(loaded, simulate)
    fast = simulated and loaded.mission.simulation.pace == "fast"
    operator = listen_to_keys if somebody_is_there() and not fast else None
    terminate = partial(signal.raise_signal, signal.SIGTERM)  # nobody sees what the robot does: an ordered end
    with LiveView(_title(loaded, simulated), HINT if operator else "", terminate) as view:
        try:
            outcome = run_mission(loaded, source, simulate=simulate, watch=view.show, operator=operator)
        except RecordingError as error:
            if not view.begun:
                raise
            sys.stderr.write(f"artemis: {error}\n")
            return 1
    _conclude(outcome)
    return outcome.exit_status


def write_page(run: Path) -> str:
    """Write report.html beside the recording; its path.

    Raises:
        RecordingError: the recording cannot be read, or the page not be written.
    """
    recording = Recording(run)
    page = (run if run.is_dir() else run.parent) / "report.html"
    write_report(recording, page)
    return str(page)


def _title(loaded: LoadedMission, simulated: bool) -> str:
    bus = loaded.mission.bus
    words = bus.words if isinstance(bus, BusWords) and not simulated else {}
    place = " ".join(str(words[word]) for word in ("interface", "channel") if word in words)
    return f"mission {loaded.mission.mission}: {loaded.robot.robot} on {place or 'simulated drives'}"


def _conclude(outcome: Outcome) -> None:
    """Print the summary, then write the page: drawing its figures takes longer than many a run."""
    recording = Recording(outcome.run.path)
    sys.stdout.write("\n")
    found = summary(recording)
    _print("result", _result(outcome, found))
    for label, text in _numbers(found):
        _print(label, text)
    speed = outcome.duration / outcome.elapsed
    _print("run time", f"{outcome.duration:.1f} s in {outcome.elapsed:.2f} s: {speed:.1f} x real time")
    _print("run folder", str(outcome.run.path))
    write_report(recording, outcome.run.report)
    _print("report", str(outcome.run.report))


def _print(label: str, text: str) -> None:
    sys.stdout.write(f"{label:12}  {text}\n")
    sys.stdout.flush()


def _result(outcome: Outcome, found: Summary) -> str:
    if outcome.interrupted is not None:
        released = not any(fault.startswith("COM-34") for fault in found.faults)  # else the fault says which is not
        return f"ended by {signal.Signals(outcome.interrupted).name}" + "; drives stopped and released" * released
    return "FAILED: stopped before its last step" if outcome.failed else "done"


def _numbers(found: Summary) -> list[tuple[str, str]]:
    lines = [("", found.missing)] if found.missing else []
    lines.append(("distance", f"{found.distance:.2f} m, up to {found.max_speed:.2f} m/s"))
    for name, rms, worst in (
        ("estimated", found.cross_track_rms, found.cross_track_max),
        ("true", found.true_cross_track_rms, found.true_cross_track_max),
    ):
        if rms is not None and worst is not None:
            text = f"{rms * 1000:5.1f} mm RMS, {worst * 1000:5.1f} mm at most, by the {name} pose"
            lines.append(("cross-track", text))
    if found.position_error_end is not None:
        lines.append(("odometry", f"{found.position_error_end * 1000:5.1f} mm from the true position at the end"))
    lines.append(("bus load", f"{found.bus_load_mean:.1%}, {found.bus_load_max:.1%} at most"))
    return [*lines, *(("fault", text) for text in found.faults)]
