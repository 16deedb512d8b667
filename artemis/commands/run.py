"""`artemis run` and `artemis report`: a mission with its live view, its summary and its page."""

from __future__ import annotations

import sys
from pathlib import Path

from artemis.app import Outcome, is_simulated, run_mission
from artemis.commands.live import LiveView
from artemis.commands.terminal import listen_to_keys
from artemis.mission.loading import load_mission
from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report
from artemis.report.summary import Summary, summary


def run_and_report(source: Path, simulate: bool) -> int:
    """Run the mission in `source`, write its page, print the summary. Returns the exit status."""
    loaded = load_mission(source)
    fast = is_simulated(loaded, simulate) and loaded.mission.simulation.pace == "fast"
    operator = listen_to_keys if sys.stdin.isatty() and not fast else None
    with LiveView(loaded.mission.mission) as view:
        outcome = run_mission(loaded, source, simulate=simulate, watch=view.show, operator=operator)
    _print_summary(outcome)
    return outcome.exit_status


def write_page(run: Path) -> str:
    """Write report.html beside the recording; its path."""
    recording = Recording(run)
    page = (run if run.is_dir() else run.parent) / "report.html"
    write_report(recording, page)
    return str(page)


def _print_summary(outcome: Outcome) -> None:
    recording = Recording(outcome.run.path)
    write_report(recording, outcome.run.report)
    lines = [f"result        {_result(outcome)}", *_numbers(summary(recording))]
    speed = outcome.duration / outcome.elapsed
    lines += [
        f"run time      {outcome.duration:.1f} s in {outcome.elapsed:.2f} s: {speed:.1f} x real time",
        f"run folder    {outcome.run.path}",
        f"report        {outcome.run.report}",
    ]
    sys.stdout.write("\n".join(lines) + "\n")


def _result(outcome: Outcome) -> str:
    if outcome.interrupted is not None:
        return f"interrupted by signal {outcome.interrupted}; drives stopped and released"
    return "FAILED: stopped before its last step" if outcome.failed else "done"


def _numbers(found: Summary) -> list[str]:
    lines = [f"distance      {found.distance:.2f} m, up to {found.max_speed:.2f} m/s; bus load {found.bus_load_mean:.1%}"]
    for name, rms, worst in (
        ("estimated", found.cross_track_rms, found.cross_track_max),
        ("true", found.true_cross_track_rms, found.true_cross_track_max),
    ):
        if rms is not None and worst is not None:
            against = f"by the {name} pose".ljust(21)
            lines.append(f"cross-track   {against} {rms * 1000:6.1f} mm RMS, {worst * 1000:6.1f} mm at most")
    if found.position_error_end is not None:
        lines.append(f"odometry      ended {found.position_error_end * 1000:.1f} mm from the true position")
    return [*lines, *(f"fault         {text}" for text in found.faults)]
