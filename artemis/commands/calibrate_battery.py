"""`artemis calibrate battery`: what runs tell of the battery and of what is taken of it; writes it down when told."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from artemis.battery import Battery
from artemis.calibration.battery_fit import FORCE, KEYS, SCALES, BatteryFit, fit_battery
from artemis.calibration.battery_log import BatteryLog, battery_logs
from artemis.commands.wholeness import tell_missing
from artemis.commands.written_values import check_yes, write_values
from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.recording.mcap_reader import Recording
from artemis.vehicle import RobotFile
from artemis.yaml_edit import Keys
from artemis.yaml_file import Data

DIGITS = 3
"""Of the numbers that are written: their intervals are a hundredth of them or more."""


def calibrate_battery(runs: Sequence[Path], hold: Sequence[str], robot_file: Path | None, *, yes: bool) -> None:
    """Fit the numbers of `battery` to runs, print old and new values, and write them if told so.

    Args:
        runs: folders of runs, or recordings, of one battery.
        hold: keys that are right in the robot file; none: `newtons_per_ampere`.
        robot_file: into which the values are written, once that is confirmed.
        yes: it is.

    Raises:
        ConfigError: wrong words or files, or nobody can confirm.
        RecordingError: a recording cannot be read, or tells no voltage.
        CalibrationError: the runs determine nothing.
    """
    check_yes(robot_file, yes=yes)
    if wrong := [key for key in hold if key not in KEYS]:
        raise ConfigError(f"--hold: {wrong[0]} is none of {', '.join(KEYS)}")
    held = list(hold) or [FORCE]
    if not set(held).intersection(SCALES):
        raise ConfigError(
            f"--hold: one of {', '.join(SCALES)} has to be known: a voltage does not separate power from capacity"
        )
    battery, logs = _read(runs)
    known = any(getattr(battery, key) for key in SCALES if key in held)
    if zeros := [key for key in KEYS if getattr(battery, key) == 0.0 and not (known and key in held)]:
        raise ConfigError(
            f"battery.{zeros[0]} is 0 in the robot file: the fit tells by what factor a number is wrong; write an"
            " estimate first"
        )
    if robot_file is not None and load_model(robot_file, RobotFile).battery != battery:
        raise ConfigError(f"{robot_file}: its battery differs from that of the runs; drive again")
    found = fit_battery(battery, logs, held)
    _tell(battery, logs, found, held)
    wanted: dict[Keys, Data] = {
        ("battery", key): float(f"{value.after:.{DIGITS}g}") for key, value in found.values.items()
    }
    write_values("calibrate battery", robot_file, wanted, yes=yes)


def _read(runs: Sequence[Path]) -> tuple[Battery, list[BatteryLog]]:
    recordings = [Recording(run) for run in runs]
    battery = recordings[0].robot.battery
    for run, recording in zip(runs, recordings, strict=True):
        if recording.robot.battery != battery:
            raise ConfigError(f"{run}: recorded with a different battery than {runs[0]}; fit them one by one")
    logs = [log for run, recording in zip(runs, recordings, strict=True) for log in battery_logs(recording, str(run))]
    for recording in recordings:
        tell_missing(recording, f"{recording.path}: ")
    assert battery is not None, "a recording without one has no logs"
    return battery, logs


def _tell(battery: Battery, logs: Sequence[BatteryLog], found: BatteryFit, held: Sequence[str]) -> None:
    """Print what was driven, and old and new values with their intervals."""
    minutes = sum(float(log.seconds.sum()) for log in logs) / 60.0
    metres = sum(float(log.metres.sum()) for log in logs)
    lines = [
        f"runs              {minutes:.0f} min, {metres:.0f} m; without load the voltage fell by {found.fallen:.2f} V",
        f"fit               measured voltages are {1e3 * found.off:.0f} mV off it, root mean square",
        f"{'battery':<18}{'old':>10}{'new':>10}{'change':>10}{'95 %':>14}",
    ]
    for key, value in found.values.items():
        change = value.after / value.before - 1.0
        width = f"+- {value.half_width:.2g}"
        lines.append(f"{key:<18}{value.before:>10.3g}{value.after:>10.3g}{change:>+10.1%}{width:>14}")
    for key, width_share in found.undetermined.items():
        why = f"not determined by these runs (+- {min(width_share, 9.99):.0%}), not written"
        lines.append(f"{key:<18}{getattr(battery, key):>10.3g}  {why}")
    lines += [f"{key:<18}{getattr(battery, key):>10.3g}  held" for key in held]
    sys.stdout.write("\n".join([*lines, ""]))
