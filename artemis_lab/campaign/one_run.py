"""One seeded run under the monitor's eyes."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from artemis.app import Outcome, Watch, run_mission
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import core_from
from artemis.recording.mcap_reader import Recording
from artemis.recording.replay import replay
from artemis.sim.world import World
from artemis.values import Tick
from artemis_lab.campaign.monitor import judge
from artemis_lab.campaign.monitor.evidence import Evidence, Injected, Stick, Violation
from artemis_lab.campaign.monitor.faults import seen
from artemis_lab.campaign.monitor.journal_reader import ReadJournal
from artemis_lab.campaign.scenario import Scenario
from artemis_lab.campaign.witness import Witness

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
"""The date on the wall when the run of seed 0 starts; each further seed starts a second later."""
ALONE = 1.5
"""A machine without a host is watched for so long [s]."""
RESTS = 0.05
"""A stick that is moved less than this lies in its dead zone."""
PROGRAM_FAILS = "SYS-04"
"""An injection after which the program has to fail."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What became of a run; the same for ever for the same seed."""

    seed: int
    status: int | None
    """Exit status; None: the program failed or was killed."""
    time_s: float
    """Run time."""
    injected: tuple[str, ...] = ()
    """Rows of the faults that were made to happen."""
    seen: tuple[tuple[str, float, float], ...] = ()
    """Those that had to be noticed and were: row, latency and worst case [s]."""
    violations: tuple[Violation, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Result:
        """What `as_json` gave."""
        lists = {
            "injected": tuple(values["injected"]),
            "seen": tuple(tuple(entry) for entry in values["seen"]),
            "violations": tuple(Violation(*entry) for entry in values["violations"]),
        }
        return cls(**{**values, **lists})


class _Killed(Exception):
    """The host process is gone."""


class _Endless(Exception):
    """The run does not end."""


def run_scenario(
    given: Scenario, robot: bytes, folder: Path, *, replayed: bool = False, watch: Watch | None = None
) -> Result:
    """Run a scenario in `folder` and judge it.

    Args:
        given: What to run.
        robot: Content of the robot file.
        folder: Where its files and its run are laid.
        replayed: Also recompute every command from the recording.
        watch: Sees every tick, and the frames since the last one, for people.
    """
    before = resources()
    source = given.write(folder, robot)
    loaded = load_mission(source)
    witnesses: list[Witness] = []

    def make_witness(world: World) -> Witness:
        witnesses.append(Witness(world, loaded.robot))
        return witnesses[0]

    def observe(tick: Tick, traffic: Traffic) -> None:
        if watch is not None:
            watch(tick, traffic)
        if given.killed_at is not None and tick.snapshot.time >= given.killed_at:
            raise _Killed
        if tick.snapshot.time > given.longest:
            raise _Endless(f"still running: {tick.mode.value}, {tick.wish.phase}")

    outcome, failures = _run(loaded, source, given.seed, observe, make_witness)
    witness = witnesses[0]
    end = witness.time
    if outcome is None:
        witness.go_on_alone(ALONE)
    (run,) = (folder / loaded.mission.record).iterdir()
    evidence = _evidence(given, loaded, witness, end, ReadJournal(run / "journal.jsonl"), outcome)
    violations = [*_unexpected(given, failures, evidence, end), *judge(evidence)]
    if replayed:
        difference = replay(Recording(run), core_from(loaded)).difference
        violations += [Violation("I11", end, f"replay: {difference}")] if difference else []
    del witness, witnesses[:]
    after = resources()
    if any(now > then for now, then in zip(after, before, strict=True)):
        violations.append(Violation("I12", end, f"threads and open files grew from {before} to {after}"))
    return Result(
        seed=given.seed,
        status=None if outcome is None else outcome.exit_status,
        time_s=round(end, 4),
        injected=tuple(injected.id for injected in evidence.injected),
        seen=tuple((one.injected.id, round(one.latency, 4), round(one.within, 4)) for one in seen(evidence)),
        violations=tuple(violations),
    )


def _run(
    loaded: LoadedMission,
    source: Path,
    seed: int,
    observe: Watch,
    witness: Callable[[World], Witness],
) -> tuple[Outcome | None, list[BaseException]]:
    """The outcome, or with what the program failed."""
    try:
        start = EPOCH + timedelta(seconds=seed)
        return run_mission(loaded, source, watch=observe, witness=witness, start=start), []
    except Exception as error:  # noqa: BLE001  what is under test may fail in any way; that is a finding
        return None, _leaves(error)


def _leaves(error: BaseException) -> list[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        return [leaf for part in error.exceptions for leaf in _leaves(part)]
    return [error]


def _unexpected(given: Scenario, failures: list[BaseException], evidence: Evidence, end: float) -> list[Violation]:
    """I0: how a program may not end."""
    told = [injected for injected in evidence.injected if injected.id == PROGRAM_FAILS]
    wanted = (_Killed,) if not told else (_Killed, RuntimeError)
    return [
        Violation("I0", end, f"the program failed: {failure!r}")
        for failure in failures
        if not isinstance(failure, wanted)
    ]


def _evidence(
    given: Scenario, loaded: LoadedMission, witness: Witness, end: float, journal: ReadJournal, outcome: Outcome | None
) -> Evidence:
    return Evidence(
        robot=loaded.robot,
        tick=1.0 / loaded.mission.tick_hz,
        heard=witness.heard,
        looks=witness.looks,
        journal=journal,
        injected=_injected(given, journal, end),
        operator=_acts(given, journal),
        stick=_stick(given.files.get("stick.csv", "")),
        status=None if outcome is None else outcome.exit_status,
    )


def _injected(given: Scenario, journal: ReadJournal, end: float) -> list[Injected]:
    """What was made to happen until the end; later than planned where the whole process stood still."""
    noted = list(journal.of("injected"))
    found = []
    for fault in given.faults:
        id, device, time = fault["inject"], fault.get("node", ""), fault["at_s"]
        fits = (line for line in noted if (line.data["id"], line.data["device"]) == (id, device) and line.time >= time)
        line = next(fits, None)
        if line is not None:
            noted.remove(line)
        if time <= end:  # a stall is noted when it is over
            found.append(Injected(time if line is None or "seconds" in fault else line.time, id, device, fault))
    return found


def _acts(given: Scenario, journal: ReadJournal) -> list[tuple[float, str]]:
    """What the operator did; later than planned where the whole process stood still, and the operator in it."""
    stood_still = max((fault.get("seconds", 0.0) for fault in given.faults), default=0.0)
    heard = list(journal.of("request"))
    acts = []
    for planned, what in ((act["at_s"], act["do"]) for act in given.operator):
        late = ((line, line.time - planned) for line in heard if line.data["request"].replace(" ", "") == what)
        line = next((line for line, by in late if 0.0 <= by <= stood_still), None)
        if line is not None:
            heard.remove(line)
        acts.append((planned if line is None else line.time, what))
    return acts


def _stick(table: str) -> list[Stick]:
    rows = [[float(cell) for cell in row.split(",")] for row in table.splitlines()[1:]]
    return [Stick(time, enable > 0, enable == 0 and max(abs(x), abs(y)) <= RESTS) for time, x, y, enable in rows]


def resources() -> tuple[int, int]:
    """Threads and open files of this process; (0, 0) in a worker's thread, whose process does other runs, too."""
    if threading.current_thread() is not threading.main_thread():
        return 0, 0
    descriptors = Path("/proc/self/fd")
    return threading.active_count(), len(os.listdir(descriptors)) if descriptors.exists() else 0
