"""`artemis calibrate steering`: where the wheels stand straight, into the drives and the robot file."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

from artemis import clock
from artemis.app import Outcome
from artemis.commands.devices import open_bus
from artemis.commands.one_step import mission_of
from artemis.commands.run import run_in_sight
from artemis.commands.terminal import HINT, JOG_KEYS, JOGGING, KEYS, somebody_is_there
from artemis.devices.can_bus import Traffic
from artemis.devices.memory import store
from artemis.errors import ConfigError, DeviceError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.motion.potentiometers import memory_numbers
from artemis.motion.steering_fit import SteeringFit, SteeringZero
from artemis.planning import check_drivable, is_simulated
from artemis.values import JobKind, Tick
from artemis.yaml_edit import edit
from artemis.yaml_file import Data, read

_KEEPING = {JobKind.WRITE_CALIBRATION: "has the new values", JobKind.STORE: "keeps the new values"}


def calibrate_steering(
    source: Path,
    side: str | None,
    reference: Mapping[str, float],
    *,
    new: bool,
    yes: bool,
    simulate: bool,
    write_simulated: bool,
    page: Mapping[str, object] | None = None,
) -> int:
    """Measure the potentiometers (or the zero of what is there instead) on the robot and bus of the mission `source`.

    Args:
        source: The mission's file.
        side: Of the robot's steering motors; None: all.
        reference: True angle of a wheel while it shows 0, by side [degrees]; for the others a person turns the wheel.
        new: Nothing that the potentiometers say now is believed.
        yes: Keep the result without asking.
        simulate: On simulated drives, whatever bus the mission names.
        write_simulated: Change the robot file also by what simulated drives showed.
        page: Serve a page for operators, with these keys of its observer; None: none.

    Returns:
        The exit status, as of a run.

    Raises:
        ConfigError: the mission is refused, or somebody at a terminal is needed; nothing has moved.
        DeviceLost: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    sides = load_mission(source).robot.sides("steering")
    if side not in (None, *sides):
        raise ConfigError(f"--side {side}: write {' or '.join(sides)}, or leave it out")
    wheels = sides if side is None else (side,)
    if unused := [one for one in reference if one not in wheels]:
        raise ConfigError(f"--reference-{unused[0]} is of a wheel that is not measured")
    alone = yes and all(one in reference for one in wheels)
    if not (alone or page is not None or somebody_is_there()):
        missing = [f"--reference-{one}" for one in wheels if one not in reference] + ["--yes"] * (not yes)
        raise ConfigError(f"calibrate steering: a person at a terminal is needed, or --page, or {', '.join(missing)}")
    step = {
        "wheels": side or "both",
        "reference_deg": dict(reference),
        "potentiometers": "new" if new else "known",
        "save": "drives" if yes else "ask",
    }
    check_drivable(load_mission(source), source, simulate)
    kept = _Kept()
    keys, hint = {**KEYS, **JOG_KEYS}, f"{HINT}; {JOGGING}"
    pace, words = None if alone and page is None else "real_time", {"calibrate": {"steering": step}}
    with mission_of(source, "calibrate-steering", words, pace=pace, page=page) as (loaded, path):
        writes = write_simulated or not is_simulated(loaded, simulate)
        file = _RobotFile(loaded.folder / loaded.mission.robot, loaded.files[loaded.mission.robot], writes)
        outcome = run_in_sight(loaded, path, simulate, watch=kept.see, keys=keys, hint=hint, then=file.write)
    kept.tell(file.told)
    return outcome.exit_status or int(file.failed)


class _RobotFile:
    """The robot file, which gets the result the moment that the run is over."""

    def __init__(self, path: Path, known: bytes, writes: bool) -> None:
        self._path, self._known, self._writes = path, known, writes
        self.failed, self.told = False, f"not changed: {path}"

    def write(self, outcome: Outcome) -> None:
        """Change it, unless the run failed."""
        if outcome.failed:
            return
        if not self._writes:
            self.told = f"not changed by simulated drives (--write-simulated does): {self._path}"
            return
        try:
            if read(self._path) != self._known:
                raise ConfigError(f"{self._path}: it was changed by another program meanwhile")
            edit(self._path, changes(outcome.steering) | zero_changes(outcome.zeros))
        except ConfigError as error:
            self.failed, self.told = True, f"NOT changed: {error}; the values are in {outcome.run.calibration}"
        else:
            self.told = f"changed: {self._path}"


def store_steering(source: Path, simulate: bool) -> int:
    """Write the robot file's calibration into the drives' memories; nothing moves. Returns 1 if one does not keep it.

    Raises:
        ConfigError: the mission is refused.
        DeviceLost: the bus cannot be opened.
    """
    loaded = load_mission(source)
    simulated, robot = is_simulated(loaded, simulate), loaded.robot
    if not robot.has_potentiometers:
        raise ConfigError(f"{source}: the robot has no potentiometers: there is nothing to store")
    sides = robot.sides("steering")
    wanted = {robot.drive_at("steering", side)[0]: memory_numbers(robot.potentiometers(side)) for side in sides}
    kept: list[str] = []
    told = "not every drive keeps what it says"
    try:
        clock.run(_store(loaded, simulated, wanted, kept), simulated=simulated)
        told = "the drives keep what it says"
    except DeviceError as error:
        told = f"{told}: {error}"
    finally:  # also if somebody stops it
        _tell([f"{name} keeps the robot file's values" for name in kept] or ["no drive was written to"], told)
    return int(len(kept) < len(wanted))


async def _store(
    loaded: LoadedMission, simulated: bool, wanted: Mapping[str, tuple[int, ...]], kept: list[str]
) -> None:
    with closing(open_bus(loaded, simulated)) as bus:
        await store(loaded.robot, bus, JobKind.WRITE_CALIBRATION, wanted, kept.append)


def changes(fits: Mapping[str, SteeringFit]) -> dict[tuple[str, ...], Data]:
    """What a calibration changes in the robot file."""
    return {
        ("calibration", "steering", side, key): list(value)
        for side, fit in fits.items()
        for key, value in (
            ("zero_v", fit.calibration.zero_v),
            ("slope_deg_per_v", fit.calibration.slope_deg_per_v),
        )
    }


def zero_changes(zeros: Mapping[str, SteeringZero]) -> dict[tuple[str, ...], Data]:
    """The same of wheels without potentiometers."""
    return {("calibration", "steering", side, zero.key): zero.after for side, zero in zeros.items()}


class _Kept:
    """What the drives' memories were told, and took."""

    def __init__(self) -> None:
        self._drives: dict[str, str] = {}

    def see(self, tick: Tick, _: Traffic) -> None:
        """A tick of the run."""
        for job in tick.wish.jobs:
            if job.kind is JobKind.WRITE_CALIBRATION:
                self._drives[job.drive] = "was about to be written"
        for result in tick.snapshot.sensed.results:
            if result.ok and result.kind in _KEEPING:
                self._drives[result.drive] = _KEEPING[result.kind]

    def tell(self, robot_file: str) -> None:
        """What is where now, in the drives and in the robot file."""
        lines = [f"{drive} {what}" for drive, what in self._drives.items()] or ["no drive was written to"]
        if any(what != _KEEPING[JobKind.STORE] for what in self._drives.values()):
            lines.append("`artemis calibrate steering MISSION --store` writes the robot file's values into all")
        _tell(lines, robot_file)


def _tell(drives: Sequence[str], robot_file: str) -> None:
    for label, text in [*zip(("calibration", *[""] * len(drives)), drives, strict=False), ("robot file", robot_file)]:
        sys.stdout.write(f"{label:12}  {text}\n")
