"""A trial of regulator gains: the mission that is run for it, and what the drives did in it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from artemis.devices.can_bus import Traffic
from artemis.errors import CalibrationError
from artemis.mission.actions import NewGains
from artemis.mission.loading import LoadedMission, load_mission
from artemis.motion.step_response import StepResponse
from artemis.recording.mcap_reader import Recording
from artemis.report.responses import Trace, read_traces
from artemis.values import JobKind, Mode, Tick

DISTANCE = 0.5
"""A driven wheel is tried on so much of a straight [m], there and back."""
POINTS = 11
FREQUENCIES, FREQUENCY = (25, 40, 50, 100, 125, 200), 200
"""Ticks a second that last whole milliseconds, and those on a bus of 1 Mbit/s, if the mission says none; less on slower
ones (a third of the bus is used)."""
PATH_FILE = "straight.csv"
_STOPPED = (Mode.FAULT, Mode.QUICKSTOP)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What is to be tried."""

    drives: tuple[str, ...]
    """All of one role."""
    role: str
    side: str
    """Of the first drive."""
    step: float
    """[degrees] of a steered wheel, [m/s] of a driven one."""
    new: NewGains | None
    """None: the gains of the robot file alone."""
    repetitions: int = 1
    """Of the test, with each of the gains."""

    @property
    def steps(self) -> list[dict[str, object]]:
        """The steps of its mission: the same test with the robot file's gains, and with the new ones."""
        test = self._test * self.repetitions
        steps = test if self.role == "steering" else [_ALIGN, *test]  # a path wants that before
        if self.new is None:
            return steps
        gains = self.new.model_dump(exclude_none=True)
        return [*steps, {"calibrate": {"gains": dict.fromkeys(self.drives, gains)}}, *test]

    @property
    def _test(self) -> list[dict[str, object]]:
        if self.role == "steering":
            return [{"calibrate": {"turn": {"side": self.side, "angle_deg": self.step}}}]
        there = {"path": PATH_FILE, "follower": {"speed_m_s": self.step}}
        return [{"follow": there}, {"follow": {**there, "from_end": True}}]

    @property
    def places(self) -> dict[str, int]:
        """The step of the mission, counted from 0, in which the drives are tried with each of the gains."""
        first = 0 if self.role == "steering" else 1
        now = {"now": first}
        return now if self.new is None else {**now, "new": first + len(self._test) * self.repetitions + 1}

    @property
    def tests(self) -> dict[str, list[int]]:
        """The steps of the mission in which the drives move, by gains: all repetitions."""
        moves = len(self._test) * self.repetitions
        return {label: list(range(place, place + moves)) for label, place in self.places.items()}


_ALIGN: dict[str, object] = {"calibrate": {"steering": "align"}}


def write_mission(loaded: LoadedMission, source: Path, trial: Trial, folder: Path) -> tuple[LoadedMission, Path]:
    """A mission with the robot, bus and simulation of another one that does nothing but the trial; and its file.

    Raises:
        ConfigError: the other mission has faults injected that cannot be in this one.
    """
    data = loaded.documents[str(source)].data
    assert isinstance(data, dict)
    kept = {key: value for key, value in data.items() if key not in ("inputs", "steps")}
    if isinstance(simulation := kept.get("simulation"), dict):
        kept["simulation"] = {key: value for key, value in simulation.items() if key != "inputs"}
    bearable = max(FREQUENCIES[0], FREQUENCY * loaded.robot.bitrate // 1_000_000)
    frequency = max(each for each in FREQUENCIES if each <= bearable)
    kept = {"tick_hz": frequency, **kept, "mission": "gains"}
    files = {name: loaded.files[name] for name in (loaded.mission.robot,)}
    if trial.role == "traction":
        rows = (f"{DISTANCE * index / (POINTS - 1):.3f},0.0" for index in range(POINTS))
        files[PATH_FILE] = "\n".join(("x_m,y_m", *rows, "")).encode()
    text = json.dumps({**kept, "steps": trial.steps}, indent=2, ensure_ascii=False)
    files["gains.yaml"] = f"# A trial of gains, made of {source.name}.\n{text}\n".encode()
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return replace(load_mission(folder / "gains.yaml"), folder=loaded.folder), folder / "gains.yaml"


class GainsWatch:
    """Sees every tick of a trial as it happens, whatever becomes of the recording."""

    def __init__(self) -> None:
        self.stopped = False
        """Something stopped the robot on the distance: what was tried after it was not tried whole."""
        self.restored: set[str] = set()
        """Drives that had other gains, and have those of the robot file again: read back after they were written."""
        self.unrestored: dict[str, str] = {}
        """Drives that may have other gains still, and why."""
        self._restoring: set[int] = set()

    def see(self, tick: Tick, _: Traffic) -> None:
        """The next tick."""
        self.stopped = self.stopped or tick.mode in _STOPPED
        for result in tick.snapshot.sensed.results:
            if result.id not in self._restoring:
                continue
            if result.ok:
                self.restored.add(result.drive)
                del self.unrestored[result.drive]
            else:
                self.unrestored[result.drive] = result.detail
        for job in tick.wish.jobs:
            if job.kind is JobKind.WRITE_GAINS:
                self.unrestored[job.drive] = "the run ended before they were taken back"
                if tick.mode is Mode.END:
                    self._restoring.add(job.id)


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the recording of a trial shows."""

    traces: dict[str, list[Trace]]
    """Of each drive, by what was tried."""
    responses: dict[str, list[StepResponse]]
    missing: str | None = None
    """What the recording lacks; None: it is whole."""

    @property
    def settled(self) -> bool:
        """Every drive was seen to settle with the new gains."""
        return "new" in self.responses and all(each.settled_5 is not None for each in self.responses["new"])


def findings(recording: Recording, trial: Trial) -> Findings:
    """Read what the drives did; what was not reached is left out.

    Raises:
        RecordingError: the recording is not understood.
    """
    found = read_traces(recording, trial.drives, list(trial.places.values()))
    traces: dict[str, list[Trace]] = {}
    responses: dict[str, list[StepResponse]] = {}
    for label, place in trial.places.items():
        shown = [found[drive, place] for drive in trial.drives if (drive, place) in found]
        try:
            answers = [trace.response() for trace in shown]
        except CalibrationError:
            continue
        if len(answers) == len(trial.drives):
            traces[label], responses[label] = shown, answers
    return Findings(traces=traces, responses=responses, missing=recording.missing)


def table(found: Findings, trial: Trial, gains: dict[str, dict[str, str]]) -> Iterator[str]:
    """The numbers of each drive, side by side; `gains`: in words, by what was tried and drive."""
    labels = list(found.responses)
    for index, drive in enumerate(trial.drives):
        columns = [found.responses[label][index] for label in labels]
        unit = found.traces[labels[0]][index].unit
        yield f"{drive}: {_step(columns[0], unit)}"
        yield _row("", labels)
        for name, words in _rows(columns, unit):
            yield _row(name, words)
        for label in labels:
            yield (
                f"  {label:<10}{gains[label][drive]}" if "predicted" in labels else f"  {label:<5}{gains[label][drive]}"
            )


def _step(response: StepResponse, unit: str) -> str:
    size = f"{abs(response.step):.1f} degrees" if unit == "deg" else f"{abs(response.step):.2f} m/s"
    return f"a step of {size}, of which the gate makes a ramp of {response.ramp:.2f} s"


def _rows(columns: Sequence[StepResponse], unit: str) -> Iterator[tuple[str, list[str]]]:
    digits = 2 if unit == "deg" else 3
    yield "rise, 10 to 90 %", [_seconds(each.rise, "does not follow") for each in columns]
    yield "overshoot", ["-" if each.overshoot is None else f"{each.overshoot:.1%}" for each in columns]
    yield "settled within 5 %", [_seconds(each.settled_5, "not settled") for each in columns]
    yield "settled within 2 %", [_seconds(each.settled_2, "not settled") for each in columns]
    yield "error at the end", [f"{round(each.steady_error, digits) + 0.0:.{digits}f} {unit}" for each in columns]
    yield "largest error", [f"{each.largest_error:.{digits}f} {unit}" for each in columns]
    yield "largest current", [f"{each.peak_current:.1f} A" for each in columns]


def _seconds(time: float | None, otherwise: str) -> str:
    return otherwise if time is None else f"{time:.3f} s"


def _row(name: str, words: Sequence[str]) -> str:
    return f"  {name:<20}" + "".join(f"{word:>16}" for word in words)
