"""What the steering drives keep of their potentiometers, beside the robot file, which is the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec.structs import replace

from artemis.drive_states import POWERED
from artemis.motion.potentiometers import memory_numbers, memory_words
from artemis.states.alignment import switch_off
from artemis.states.mode import OFF, Failed, Routine, failure, finish_jobs
from artemis.states.plan import CalibrateStep, Plan, Shared
from artemis.supervision import catalogue
from artemis.values import Fault, JobKind, JobResult, Snapshot

LARGEST = 2**31
"""What a drive keeps is smaller, without sign: 32 bit."""


def keep(shared: Shared, wanted: Mapping[str, tuple[int, ...]], snapshot: Snapshot) -> Routine:
    """Switch all drives off; write numbers into some, one after the other: each is read back, then kept for ever."""
    snapshot = yield from switch_off(shared, OFF, snapshot)
    if on := [drive.name for drive in snapshot.sensed.drives if drive.state in POWERED]:
        raise Failed(OFF, catalogue.fault("COM-03", on[0], "stays on"))
    before, snapshot = yield from finish_jobs(
        replace(OFF, phase="reading what the drives keep"), shared.bring_up.jobs(JobKind.READ_CALIBRATION, wanted)
    )
    if fault := failure(before):
        raise Failed(OFF, fault)
    done: list[str] = []
    for name, numbers in wanted.items():
        if max(map(abs, numbers)) >= LARGEST:
            fault = catalogue.fault("CAL-01", name, f"too large for the drive's memory: {memory_words(numbers)}")
            raise Failed(OFF, fault)
        for kind, values in ((JobKind.WRITE_CALIBRATION, numbers), (JobKind.STORE, ())):
            job = shared.bring_up.job(kind, name, *values)
            (result,), snapshot = yield from finish_jobs(replace(OFF, phase=f"{kind.value} {name}"), job)
            if not result.ok:
                raise Failed(OFF, catalogue.fault("CAL-01", name, _told(result, before, done)))
        shared.results.kept[name] = numbers
        done.append(name)
    return snapshot


def _told(failed: JobResult, before: Iterable[JobResult], done: Iterable[str]) -> str:
    """What went wrong, and what is where now."""
    kept = {result.drive: memory_words(result.values) for result in before}
    told = [f"{failed.kind.value}: {failed.detail}", f"before it kept {kept[failed.drive]}"]
    told += [f"{name} keeps the new values already, before {kept[name]}" for name in done]
    return "; ".join([*told, "the robot file is as it was, `artemis calibrate steering --store` brings it back"])


def contradiction(shared: Shared, results: Iterable[JobResult]) -> Fault | None:
    """A drive that keeps another calibration than the robot file's; zeros: none was ever stored.

    No fault of a drive into which the run is there to write another one.
    """
    replaced = shared.current.replaces if isinstance(shared.current, CalibrateStep) else ()
    for result in results:
        if result.kind is JobKind.READ_CALIBRATION and any(result.values):
            if shared.plan.robot.drives[result.drive].side in replaced:
                continue
            known = shared.results.kept.get(result.drive) or _from_file(shared.plan, result.drive)
            if result.values != known:
                seen = f"keeps {memory_words(result.values)}; the robot file says {memory_words(known)}"
                return catalogue.fault("CAL-02", result.drive, seen)
    return None


def _from_file(plan: Plan, name: str) -> tuple[int, ...]:
    return memory_numbers(plan.robot.potentiometers(plan.robot.drives[name].side))
