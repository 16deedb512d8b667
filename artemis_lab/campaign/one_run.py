"""One seeded run under the monitor's eyes."""

from __future__ import annotations

import os
import random
import shutil
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from artemis.app import Outcome, Watch, resume_point_of, run_mission
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError, RecordingError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import core_from
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import ResumePoint
from artemis.recording.replay import replay
from artemis.sim.world import World
from artemis.states.answers import IGNORED
from artemis.values import Tick
from artemis_lab.campaign.monitor import judge
from artemis_lab.campaign.monitor.evidence import LATE_SCANS, Evidence, Injected, Stick, Violation
from artemis_lab.campaign.monitor.faults import Seen, seen
from artemis_lab.campaign.monitor.journal_reader import ReadJournal
from artemis_lab.campaign.scenario import Scenario
from artemis_lab.campaign.witness import Witness

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
"""The date on the wall when the run of seed 0 starts; each further seed starts a second later."""
ALONE = 1.5
"""A machine without a host is watched for so long [s]."""
RESTS = 0.05
"""A stick that is moved less than this lies in its dead zone."""
LATER = timedelta(hours=1)
"""After so long a run that was killed is resumed."""
LOST = 20_000
"""So much of a recording may be missing after a kill [bytes]."""
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
    kinds: tuple[str, ...] = ()
    """Steps and words of the mission, and what else was special."""
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
            "kinds": tuple(values.get("kinds", ())),
            "injected": tuple(values["injected"]),
            "seen": tuple(tuple(entry) for entry in values["seen"]),
            "violations": tuple(Violation(*entry) for entry in values["violations"]),
        }
        return cls(**{**values, **lists})


class _Killed(Exception):
    """The host process is gone."""


class InterruptedRun(Exception):
    """A signal ended a run of which something else is to be found out: it says nothing."""

    @property
    def signal(self) -> int:
        """Its number."""
        number: int = self.args[0]
        return number


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
    mission = _Mission(given, load_mission(source), source, watch, replayed)
    runs = [mission.run(EPOCH + timedelta(seconds=given.seed), given.killed_at)]
    kinds, violations = list(given.kinds), list(runs[0].violations)
    if runs[0].killed:
        kinds.append("killed")
    if given.resumed_after is not None and not any(isinstance(error, RuntimeError) for error in runs[0].failures):
        resumed, problems = mission.resume(runs[0])
        runs += [resumed] if resumed is not None else []
        kinds += ["resumed"] if resumed is not None else []
        kinds += ["compared"] if resumed is not None and mission.is_comparable(runs[0]) else []
        violations += problems
    last = runs[-1]
    after = resources()
    if any(now > then for now, then in zip(after, before, strict=True)):
        violations.append(Violation("I12", last.end, f"threads and open files grew from {before} to {after}"))
    found = [one for run in runs for one in run.seen]
    return Result(
        seed=given.seed,
        status=last.status,
        time_s=round(sum(run.end for run in runs), 4),
        kinds=tuple(kinds),
        injected=tuple(injected.id for run in runs for injected in run.injected),
        seen=tuple((one.injected.id, round(one.latency, 4), round(one.within, 4)) for one in found),
        violations=tuple(violations),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Done:
    """One run of a scenario's mission, judged."""

    folder: Path
    status: int | None
    failures: list[BaseException]
    end: float
    injected: Sequence[Injected]
    seen: Sequence[Seen]
    violations: list[Violation]
    events: list[tuple[float, str]]
    """What happened in the mission, and when [s]."""

    @property
    def killed(self) -> bool:
        """The host was killed in it."""
        return any(isinstance(error, _Killed) for error in self.failures)


@dataclass(frozen=True, slots=True)
class _Mission:
    """The mission of a scenario, laid out in its folder."""

    given: Scenario
    loaded: LoadedMission
    source: Path
    watch: Watch | None
    replayed: bool

    def run(self, start: datetime, killed_at: float | None = None, resume_point: ResumePoint | None = None) -> _Done:
        """Run it and judge that; nothing of the run stays in memory but what is found.

        Raises:
            InterruptedRun: a signal ended it.
        """
        given, loaded, witnesses, events = self.given, self.loaded, list[Witness](), list[tuple[float, str]]()

        def make_witness(world: World) -> Witness:
            witnesses.append(Witness(world, loaded.robot))
            return witnesses[0]

        def observe(tick: Tick, traffic: Traffic) -> None:
            if self.watch is not None:
                self.watch(tick, traffic)
            time = tick.snapshot.time
            kept = [event for event in tick.events if event.kind != IGNORED]  # a resumed run is brought up once more
            events.extend((time, f"{event.kind} {event.text} {event.place}") for event in kept)
            if killed_at is not None and time >= killed_at:
                raise _Killed
            if time > given.longest:
                raise _Endless(f"still running: {tick.mode.value}, {tick.wish.phase}")

        folders = set(self._folders())
        outcome, failures = _run(loaded, self.source, start, observe, make_witness, resume_point)
        if outcome is not None and outcome.interrupted is not None:
            raise InterruptedRun(outcome.interrupted)
        witness = witnesses[0]
        end = witness.time
        if outcome is None:
            witness.run_alone(ALONE)
        (run,) = set(self._folders()) - folders
        evidence = _evidence(given, loaded, witness, end, ReadJournal(run / "journal.jsonl"), outcome)
        violations = [*_unexpected(failures, evidence, end), *judge(evidence)]
        if self.replayed:
            difference = replay(Recording(run), core_from(loaded, resume_point)).difference
            violations += [Violation("I11", end, f"replay: {difference}")] if difference else []
        return _Done(
            folder=run,
            status=None if outcome is None else outcome.exit_status,
            failures=failures,
            end=end,
            injected=evidence.injected,
            seen=seen(evidence),
            violations=violations,
            events=events,
        )

    def is_comparable(self, done: _Done) -> bool:
        """Whether run and resumed run have to do the same: nothing went wrong, and nobody walks about."""
        return not (done.killed or self.given.disturbed or self.given.world)

    def resume(self, first: _Done) -> tuple[_Done | None, list[Violation]]:
        """Resume a run where it was killed, or would have been; None where that is refused for a reason.

        And what is wrong with it.
        """
        folder = self._left(first)
        try:
            last = Recording(folder).last_tick()
        except RecordingError:
            last = None
        try:
            point, _ = resume_point_of(self.loaded, self.source, folder)
        except ConfigError as error:
            over = last is None or last.position.step >= len(self.loaded.tree.steps) or last.snapshot.pose.lost
            return None, [] if over else [Violation("I13", first.end, f"is not resumed: {error}")]
        assert last is not None
        resumed = self.run(EPOCH + timedelta(seconds=self.given.seed) + LATER, None, point)
        violations = [v._replace(text=f"{v.text} (resumed)") for v in resumed.violations if not _follows(v, first)]
        if self.is_comparable(first):
            before = [text for time, text in first.events if time <= last.snapshot.time]
            did, does = [*before, *(text for _, text in resumed.events)], [text for _, text in first.events]
            if did != does or resumed.status != first.status:
                here = next(
                    (n for n, (a, b) in enumerate(zip(did, does, strict=False)) if a != b), min(len(did), len(does))
                )
                instead = f"{did[here : here + 1]} instead of {does[here : here + 1]}"
                instead += f", status {resumed.status} instead of {first.status}"
                violations.append(
                    Violation("I13", resumed.end, f"the mission is not done as in a whole run: {instead}")
                )
        return resumed, violations

    def _left(self, done: _Done) -> Path:
        """The folder that a kill leaves of a run: the recording cut at a byte, the journal shortly after.

        Of a run that was killed the recording less what was not on the disk yet.
        """
        dice, name = random.Random(-self.given.seed), "recording.mcap"
        whole = (done.folder / name).read_bytes()
        if done.killed:
            (done.folder / name).write_bytes(whole[: len(whole) - dice.choice((0, dice.randrange(LOST)))])
            return done.folder
        folder = done.folder.with_name(f"{done.folder.name}-cut")
        shutil.copytree(done.folder, folder, ignore=shutil.ignore_patterns(name, "report.html"))
        (folder / name).write_bytes(whole[: int((self.given.resumed_after or 0.0) * len(whole))])
        try:
            last = Recording(folder).last_tick()
        except RecordingError:
            last = None
        until = -1.0 if last is None else last.snapshot.time
        journal = folder / "journal.jsonl"
        told = sum(entry.time <= until for entry in read_journal(journal).entries)
        journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:told]))
        return folder

    def _folders(self) -> list[Path]:
        runs = self.source.parent / self.loaded.mission.record
        return list(runs.iterdir()) if runs.is_dir() else []


def _follows(violation: Violation, killed: _Done) -> bool:
    """It comes of what went wrong before the kill: the robot was off its path then."""
    return bool(killed.injected) and violation.invariant in ("I0", "I3") and "nothing had happened" in violation.text


def _run(
    loaded: LoadedMission,
    source: Path,
    start: datetime,
    observe: Watch,
    witness: Callable[[World], Witness],
    resume_point: ResumePoint | None,
) -> tuple[Outcome | None, list[BaseException]]:
    """The outcome, or with what the program failed."""
    try:
        return run_mission(loaded, source, watch=observe, witness=witness, start=start, resume_point=resume_point), []
    except Exception as error:  # noqa: BLE001  what is under test may fail in any way; that is a finding
        return None, _leaves(error)


def _leaves(error: BaseException) -> list[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        return [leaf for part in error.exceptions for leaf in _leaves(part)]
    return [error]


def _unexpected(failures: list[BaseException], evidence: Evidence, end: float) -> list[Violation]:
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
        world=given.world,
        rules=given.mission.get("obstacles", {}),
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
            stalls = "seconds" in fault and id != LATE_SCANS
            found.append(Injected(time if line is None or stalls else line.time, id, device, fault))
    return found


def _acts(given: Scenario, journal: ReadJournal) -> list[tuple[float, str]]:
    """What the operator did; later than planned where the whole process stood still, and the operator in it."""
    stalls = (fault.get("seconds", 0.0) for fault in given.faults if fault["inject"] != LATE_SCANS)
    stood_still = max(stalls, default=0.0)
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
