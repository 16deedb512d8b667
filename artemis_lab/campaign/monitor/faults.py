"""Invariants of what the journal says, against what was done to the robot: I0, I3, I10, I11."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

from artemis_lab.campaign.monitor.evidence import Evidence, Injected, Violation
from artemis_lab.campaign.monitor.expected import EXPECTED, Expected, When, expectation
from artemis_lab.campaign.monitor.frames import DRIVING, WATCH_MS
from artemis_lab.campaign.monitor.journal_reader import STOPPING, JournalLine
from artemis_lab.campaign.monitor.wire import ENABLE, SetPoint
from artemis_lab.campaign.witness import SIDES

WATCHED = {"ready", "calibrate", *DRIVING}
COMMANDED = 0.2
"""Both driven wheels are clearly commanded to move [m/s]."""
ASTRAY, ASTRAY_PART, SLIPS = 0.18, 0.23, 0.5
"""A wheel runs away that turns so far beyond what it was told: [m/s], and as parts of it; one that slips, too."""
ROUNDING = 1e-6
"""Of sums of times [s]."""
LASTS = 0.15
"""A fault that ends by itself is judged only if it lasts so much longer than it takes to be noticed [s]."""
LISTENING = 0.2
"""Whatever is wrong before this time [s] is there from the beginning."""
RECOVERIES = 5
"""Automatic recoveries in a run; then a person is needed."""
AUTOMATIC = {
    **dict.fromkeys(("DRV-18", "DRV-23", "DRV-38", "COM-28", "PLG-02", "PTH-07", "COM-25"), 1),
    **dict.fromkeys(("COM-03", "COM-11", "COM-14", "COM-15", "LAS-05", "LAS-09"), 2),
    **dict.fromkeys(("COM-07", "COM-08", "COM-31", "RUN-05", "SYS-01", "INP-01", "INP-03", "INP-06"), 3),
    **dict.fromkeys(("LAS-01", "LAS-02"), 5),
}
"""Automatic recoveries of single rows in a run of less than a minute; what is forgotten together is one."""
BY_ITSELF = (
    *("COM-16", "COM-20", "COM-09", "COM-06", "RUN-12", "INP-08", "DSK-02", "DSK-03", "DSK-05"),
    *("LAS-03", "LAS-06", "LAS-07", "LAS-08"),
)
FINAL = (
    *("DRV-05", "DRV-10", "DRV-17", "DRV-21", "DRV-37", "COM-18", "COM-19", "RUN-03", "RUN-08", "STE-04", "STE-07"),
    *("PLG-05", "PLG-07", "PWR-02", "SYS-04"),
)
"""Rows that no acknowledgment clears."""
UNSUPPLIED = ("COM-32", "COM-33", "SYS-09")
"""A drive has no supply, or none has."""
FORBIDDEN = "PLG-07"
"""A frame that may not leave; no injection asks for one, and no plugin is given the bus."""
FROZEN = (("STE-07", "STE-05"),)
"""The first keeps the second from being measured: a potentiometer that is frozen says nothing of the coupling."""


class Seen(NamedTuple):
    """An injected fault that had to be noticed, and when it was."""

    injected: Injected
    latency: float
    """[s]."""
    within: float
    """[s]."""


# ---------------------------------------------------------------------------------------------- I3


def judged(e: Evidence) -> Iterator[tuple[Injected, Expected, float]]:
    """Every injected fault that had to be noticed, with its deadline [s]; a program that is gone notices nothing."""
    gone = inf if e.status is not None else e.beat_before(inf) + e.tick
    for injected in e.injected:
        expected = expectation(injected, e)
        deadline = injected.time + expected.within + e.tick + max(0.0, 2.5 * (e.tick - 0.02)) + ROUNDING
        if expected.when is When.BY_HAND:  # teleop stops at once, and is heard by the judge of the tick after
            deadline += e.tick
        deadline += _stands_still(e, injected, deadline)
        lasts = injected.until > deadline + LASTS and gone >= deadline
        new = not injected.is_counted and not _is_told(e, injected) and not _is_covered(e, injected, deadline)
        if new and lasts and _must_show(e, injected, expected, deadline):
            yield injected, expected, deadline


def _is_covered(e: Evidence, injected: Injected, deadline: float) -> bool:
    """Another fault hides it: its drive has no supply, its sensor is frozen, or the input is soon wrong otherwise."""
    for other in e.injected:
        if other is injected:
            continue
        during = other.time <= injected.time <= other.until
        if during and other.id in UNSUPPLIED and other.node in ("", injected.node):
            return True
        if during and (other.id, injected.id) in FROZEN and other.node == injected.node:
            return True
        if injected.id.startswith("INP") and other.id.startswith("INP") and injected.time <= other.time < deadline:
            return True
    return False


def _is_told(e: Evidence, injected: Injected) -> bool:
    """The journal has it already, from before, and does not say that it is over."""
    lines = (line for line in e.journal.of("fault", "cleared") if line.time < injected.time)
    told = [line.kind for line in lines if (line.data["id"], line.data["device"]) == (injected.id, injected.node)]
    return told[-1:] == ["fault"]


def _stands_still(e: Evidence, injected: Injected, end: float) -> float:
    """So long another fault has the whole process stand still [s], if that is so between an injection and `end`."""
    others = (i for i in e.injected if i is not injected)
    return sum(i.standstill for i in others if i.time < end and i.time + i.standstill > injected.time)


def _must_show(e: Evidence, injected: Injected, expected: Expected, deadline: float) -> bool:
    """The robot is in the situation of which the expectation speaks, and stays in it until the fault is noticed."""
    first = next((line.time for line in e.journal.of("fault") if line.time >= injected.time), inf)
    end = min(deadline, first)
    modes = e.journal.modes_between(injected.time, end - 1e-6)
    match expected.when:
        case When.WATCHED:
            return modes <= WATCHED and (not _opens_sto(e, injected) or _is_kept_on(e, injected, end))
        case When.ENABLED:
            return modes <= {"ready", *DRIVING}
        case When.BY_HAND:
            return modes == {"teleop"} and e.journal.phase_before(end - 1e-6) != "stopping"  # at its end
        case When.FOLLOWING:
            phase = e.journal.phase_before(end - 1e-6)  # not asked any more at the end of the path
            return (phase, modes) in (("following", {"follow"}), ("approaching", {"act"}))
        case When.MOVING:
            moving = modes <= DRIVING and _commanded(e, injected.time - 0.1, end)
            return moving and (injected.id not in ("RUN-01", "RUN-05") or _runs_away(e, injected, end))
    return False


def _opens_sto(e: Evidence, injected: Injected) -> bool:
    """Safe torque off, of one drive or by an emergency stop: of it drives tell nothing that are off."""
    by_supply = injected.options.get("opens") == "supply"
    has_inputs = all(drive.family == "epos4" for drive in e.robot.drives.values())
    return injected.id == "DRV-29" or (injected.id.startswith("EST") and has_inputs and not by_supply)


def _is_kept_on(e: Evidence, injected: Injected, end: float) -> bool:
    """One of the drives that it concerns is on, and told to stay on until then [s]."""
    look, order = (
        e.look_at(injected.time - ROUNDING),
        [(role, side) for role in ("traction", "steering") for side in SIDES],
    )
    for on, (role, side) in zip(look.enabled if look else (), order, strict=False):
        name, drive = e.robot.drive_at(role, side)
        told = [
            s.controlword for s in e.wire.nodes[drive.node_id].all(SetPoint) if injected.time - e.tick <= s.time <= end
        ]
        if on and injected.node in ("", name) and set(told) == {ENABLE}:
            return True
    return False


def _commanded(e: Evidence, begin: float, end: float) -> bool:
    """Both driven wheels are told to move all the time."""
    told = [[abs(v) for time, v in e.targets[side] if begin <= time <= end] for side in SIDES]
    return all(speeds and min(speeds) >= COMMANDED for speeds in told)


def _runs_away(e: Evidence, injected: Injected, end: float) -> bool:
    """The wheel truly turns clearly otherwise than told: one near its top speed lacks the voltage to go much faster."""
    side = next(side for side in SIDES if e.robot.drive_at("traction", side)[0] == injected.node)
    told = [speed for time, speed in e.targets[side] if injected.time - 0.1 <= time <= end]
    turned = [look.rolling[SIDES.index(side)] for look in e.looks_between(injected.time, end)]
    beyond, fastest = max(max(turned) - max(told), min(told) - min(turned)), max(map(abs, told))
    slips = injected.id == "RUN-05" and beyond > SLIPS * fastest
    return slips or beyond > max(ASTRAY, ASTRAY_PART * fastest)


def seen(e: Evidence) -> list[Seen]:
    """Every injected fault that had to be noticed and was: how fast."""
    found = []
    for injected, expected, deadline in judged(e):
        line = _first(e, injected, expected)
        if line is not None and line.time <= deadline:
            found.append(Seen(injected, line.time - injected.time, deadline - injected.time))
    return found


def _first(e: Evidence, injected: Injected, expected: Expected) -> JournalLine | None:
    """The first entry that names it."""
    shown = (line for line in e.journal.of("fault") if line.time >= injected.time)
    return next((line for line in shown if line.data["id"] in expected.shows), None)


def noticed(e: Evidence) -> Iterator[Violation]:
    """I3: an injected fault is noticed within its worst case, by its own name before any other."""
    for injected, expected, deadline in judged(e):
        line = _first(e, injected, expected)
        others = [line for line in e.journal.of("fault") if injected.time <= line.time <= deadline]
        alone = not any(i is not injected and injected.time - 3.0 < i.time < deadline for i in e.injected)
        what = " ".join(filter(None, (injected.id, injected.node)))
        if line is None or line.time > deadline:
            if alone or not others:
                late = "not at all" if line is None else f"after {line.time - injected.time:.3f} s"
                instead = f"; instead {others[0].data['id']}" if others else ""
                text = f"{what} was noticed {late}, worst case {deadline - injected.time:.3f} s{instead}"
                yield Violation("I3", injected.time, text)
        elif alone and others[0].time < line.time and others[0].data["id"] not in expected.shows:
            yield Violation("I3", injected.time, f"{what} showed as {others[0].data['id']} first")
    yield from _obeyed(e)
    yield from _from_start(e)
    yield from _without_cause(e)


def _obeyed(e: Evidence) -> Iterator[Violation]:
    """I4: what calls for a stop stops the robot, at once."""
    for line in e.journal.of("fault"):
        driving = e.journal.mode_at(line.time - 1e-6) in DRIVING
        if driving and line.stops and e.journal.modes_between(line.time, line.time + 1.5 * e.tick) <= DRIVING:
            yield Violation("I4", line.time, f"{line.text}: and the robot is not stopped")


def _from_start(e: Evidence) -> Iterator[Violation]:
    """What is wrong from the beginning shows before the robot is ready."""
    ready = e.journal.next_mode(0.0, "ready")
    for injected in e.injected:
        expected = expectation(injected, e)
        again = [other for other in e.injected if (other.id, other.node) == (injected.id, injected.node)]
        lasts = injected.until == inf and injected.options.get("count") is None and len(again) == 1  # one may end all
        if expected.when is When.FROM_START and injected.time < LISTENING and lasts and ready is not None:
            shown = [line for line in e.journal.of("fault") if line.time <= ready]
            if not any(line.data["id"] in expected.shows for line in shown):
                yield Violation("I3", ready, f"{injected.id} {injected.node} is there, and the robot is ready")


def _without_cause(e: Evidence) -> Iterator[Violation]:
    """A fault that stops a sound robot; a frame that nobody but artemis itself can have wanted to send, at any time."""
    for line in e.journal.of("fault"):
        if line.data["id"] == FORBIDDEN:
            yield Violation("I3", line.time, line.text)
            return
    causes = [i.time for i in e.injected if EXPECTED[i.id].when is not When.HARMLESS]
    first = min(causes, default=inf)
    for line in e.journal.of("fault"):
        if line.stops and line.time < first and not _ends_the_proof(e, line):
            yield Violation("I3", line.time, f"{line.text}: nothing had happened")
            return


def _ends_the_proof(e: Evidence, line: JournalLine) -> bool:
    """A drive misses our heartbeat, which was withheld on purpose when a person stopped the bring-up."""
    return line.data["id"] == "DRV-20" and any(
        time <= line.time <= time + WATCH_MS / 1000 and e.journal.phase_before(time) == "proving the watchdog"
        for time in e.acts("quickstop") + e.acts("end")
    )


# ---------------------------------------------------------------------------------------------- I10


def recoveries(e: Evidence) -> Iterator[Violation]:
    """I10: what a person has to acknowledge waits for a person; automatic recoveries stay within their budgets."""
    asked = e.acts("acknowledge") + [time for i in e.injected if i.id.startswith("OPR") for time in _presses(e, i)]
    by_itself: list[tuple[float, str]] = []
    stopping: dict[tuple[str, str], float] = {}
    for line in e.journal.lines:
        if line.kind == "fault" and line.data["severity"] in STOPPING:
            stopping[line.data["id"], line.data["device"]] = line.time
        if line.kind != "cleared":
            continue
        id, since = line.data["id"], stopping.pop((line.data["id"], line.data["device"]), None)
        if since is None:
            continue
        if id in FINAL:
            yield Violation("I10", line.time, f"{line.text} was cleared, and can never be")
        if any(since <= time <= line.time for time in asked) or id in BY_ITSELF:
            continue
        by_itself.append((line.time, id))
        spent = len({time for time, other in by_itself if other == id})
        if spent > AUTOMATIC.get(id, 0):
            yield Violation("I10", line.time, f"{line.text} was cleared without an acknowledgment (time {spent})")
    if len({time for time, _ in by_itself}) > RECOVERIES:
        yield Violation("I10", by_itself[-1][0], f"{len(by_itself)} automatic recoveries")


def _presses(e: Evidence, injected: Injected) -> list[float]:
    """When a button was heard that is pressed, or pressed again and again [s]: later where the process stood still."""
    times, rate = injected.options.get("times", 20), injected.options.get("rate_hz", 20.0)
    stood_still = sum(i.standstill for i in e.injected)
    last = injected.time + (times / rate if injected.id == "OPR-02" else 0.0) + stood_still + e.tick
    heard = [line.time for line in e.journal.of("request") if line.data["request"] == "acknowledge"]
    return [time for time in heard if injected.time <= time <= last]


# ---------------------------------------------------------------------------------------------- I11, I0


def journal_whole(e: Evidence) -> Iterator[Violation]:
    """I11: no entry is missing or damaged; each change of the mode has its cause in the journal."""
    for problem in e.journal.problems:
        yield Violation("I11", 0.0, problem)
    for expected, line in enumerate(e.journal.lines):
        if line.sequence != expected:
            yield Violation("I11", line.time, f"entry {line.sequence} where {expected} belongs")
            break
    before = ""
    for line in e.journal.of("mode"):
        source, target = line.data["from"], line.data["to"]
        if (source or "") != before:
            yield Violation("I11", line.time, f"from {before} to {source} without a word")
        before = target
        if (source, target) not in CHANGES:
            yield Violation("I11", line.time, f"a change from {source} to {target}")
        elif not _caused(e, line):
            yield Violation("I11", line.time, f"{line.text} without a cause")


_STEPS = ("calibrate", *sorted(DRIVING))
CHANGES = {
    (None, "init"),
    (None, "fault"),
    (None, "quickstop"),
    ("init", "ready"),
    ("quickstop", "ready"),
    ("quickstop", "init"),
    ("fault", "init"),
    *((step, "ready") for step in _STEPS),
    *(("ready", step) for step in _STEPS),
    *((mode, "quickstop") for mode in ("init", "ready", *_STEPS)),
    *((mode, "fault") for mode in ("init", "ready", "quickstop", *_STEPS)),
    *((mode, "end") for mode in ("init", "ready", "quickstop", "fault", *_STEPS)),
}
"""How the mode may change."""


def _caused(e: Evidence, change: JournalLine) -> bool:
    """There is an entry of the same time, or a latched one, that explains the change."""
    now = [line for line in e.journal.lines if abs(line.time - change.time) < 1e-9]
    match change.data["to"]:
        case "fault":
            return _stands(e, change)
        case "quickstop":
            return _stands(e, change) or any(line.text.startswith("quick stop") for line in now)
        case "init" if change.data["from"] == "fault":
            return any(line.kind == "cleared" for line in e.journal.lines if line.time <= change.time)
    return True


def _stands(e: Evidence, change: JournalLine) -> bool:
    """A fault that stops the robot is there, and not cleared."""
    standing: set[tuple[str, str]] = set()
    for line in e.journal.lines:
        if line.time > change.time:
            break
        if line.stops:
            standing.add((line.data["id"], line.data["device"]))
        elif line.kind == "cleared":
            standing.discard((line.data["id"], line.data["device"]))
    return bool(standing)


def ends(e: Evidence) -> Iterator[Violation]:
    """I0: a sound robot whom nobody and nothing disturbs does its whole mission."""
    disturbed = [i for i in e.injected if EXPECTED[i.id].when is not When.HARMLESS]
    stopped = e.acts("quickstop") + e.acts("end") + [i.time for i in e.injected if i.id == "INP-11"]
    blocked = any(line.data["id"] == "LAS-08" for line in e.journal.of("fault"))  # I14 says whether rightly
    if e.status and not disturbed and not stopped and not blocked:
        yield Violation("I0", 0.0, f"ended with exit status {e.status}, and nothing had happened")
