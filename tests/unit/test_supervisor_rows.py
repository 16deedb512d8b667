"""Every measured row of the fault table: just below and just above its limit, just before and just after its time."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from math import radians
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, TRACTION, volts
from msgspec.structs import replace
from supervision_rig import DRIVING, OFF, STEER_LEFT, STEER_RIGHT, STOPPING, Watch, bus

from artemis.drive_states import DriveState, Nmt
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Found
from artemis.values import DriveCommand, OperatorInput, Severity, Tracking, Wish

LEFT, RIGHT = TRACTION
WARN, LIMIT, S2, S1, S0 = list(Severity)[1:]

Ticks = Iterator[dict[str, Any]]
"""What each tick senses; the watch's robot is changed between them. Time goes on by a period before each."""


@dataclass
class Case:
    """One limit of one row."""

    id: str
    severity: Severity
    device: str
    words: str
    below: Callable[[Watch], Ticks]
    above: Callable[[Watch], Ticks]
    hold: float = 0.0
    """How long it has to be above [s]."""
    slow: float = 0.0
    """How much later that is measured, at most [s]."""


def always(watch: Watch, **changes: Any) -> Ticks:
    """The same in every tick."""
    while True:
        yield changes


def at_once(watch: Watch, **changes: Any) -> Ticks:
    """In one tick, then no more."""
    yield changes
    yield from always(watch)


def ill(name: str, **changes: Any) -> Callable[[Watch], Ticks]:
    """A drive that says this from now on."""

    def ticks(watch: Watch) -> Ticks:
        watch.ill(name, **changes)
        return always(watch)

    return ticks


def sense(once: Any = False, **changes: Any) -> Callable[[Watch], Ticks]:
    """What the edge senses from now on, or once."""
    return lambda watch: (at_once if once else always)(watch, **changes)


def said(name: str, **changes: Any) -> Callable[[Watch], Ticks]:
    """What a drive says once."""

    def ticks(watch: Watch) -> Ticks:
        watch.ill(name, **changes)
        yield {}
        watch.well()
        yield from always(watch)

    return ticks


def all_old(age: float) -> Callable[[Watch], Ticks]:
    def ticks(watch: Watch) -> Ticks:
        for name in NAMES:
            watch.ill(name, age=age)
        return always(watch)

    return ticks


def gap(seconds: float) -> Callable[[Watch], Ticks]:
    """Time that passes between two ticks."""

    def ticks(watch: Watch) -> Ticks:
        watch.time += seconds - PERIOD
        return always(watch)

    return ticks


def jumping(times: int) -> Callable[[Watch], Ticks]:
    """An axis that goes from end to end so often, in a tick each."""

    def ticks(watch: Watch) -> Ticks:
        for number in count():
            axis = (-1.0) ** min(number, times)
            yield {"inputs": (OperatorInput(source="stick", axes=(axis, 0.0)),)}

    return ticks


def supplies(*times: float) -> Callable[[Watch], Ticks]:
    """Drives that lose their supply one after the other at these times."""

    def ticks(watch: Watch) -> Ticks:
        for number in range(50):
            now = [name for name, time in zip(NAMES, times, strict=False) if round(time / PERIOD) == number]
            watch.well()
            for name in now:
                watch.ill(name, emergencies=(0x3220,))
            yield {}
        yield from always(watch)

    return ticks


def driving(commanded: float, **actual: float) -> Callable[[Watch], Ticks]:
    """A robot that drove as told, and now its wheels roll like this."""

    def ticks(watch: Watch) -> Ticks:
        watch.drive(commanded)
        watch.ticks(0.5)
        watch.speeds = actual.get("left", commanded), actual.get("right", commanded)
        return always(watch)

    return ticks


def rolling(speed: float, wish: Wish = OFF) -> Callable[[Watch], Ticks]:
    """A robot that stood, and now rolls."""

    def ticks(watch: Watch) -> Ticks:
        watch.wish = wish
        watch.ticks(0.5)
        watch.speeds = speed, speed
        return always(watch)

    return ticks


def fading(excess: float) -> Callable[[Watch], Ticks]:
    """A robot that is to stop, and is faster than planned by this as soon as it can be."""

    def ticks(watch: Watch) -> Ticks:
        watch.drive(0.6)
        watch.ticks(0.5)
        watch.wish = STOPPING
        since = 0.0
        while True:
            planned = min(0.6, 0.6 - 1.5 * (since - 0.1))
            watch.roll(max(0.0, min(0.6, planned + excess if planned > 0.0 else 0.0)))
            since += PERIOD
            yield {}

    return ticks


def alone(speed: float) -> Callable[[Watch], Ticks]:
    """Only the right driven wheel's drive is on; the other never was."""

    def ticks(watch: Watch) -> Ticks:
        watch.roll(speed)
        watch.ill(LEFT, state=DriveState.READY)
        return always(watch)

    return ticks


def off_angle(degrees: float) -> Callable[[Watch], Ticks]:
    def ticks(watch: Watch) -> Ticks:
        watch.angles[0] = radians(degrees)
        return always(watch)

    return ticks


def apart(degrees: float) -> Callable[[Watch], Ticks]:
    first, second = volts("right", 0.0)
    slope = ROBOT.potentiometers("right").slope_deg_per_v[1]
    return ill(STEER_RIGHT, potentiometers=(first, second + degrees / slope))


def slipped(degrees: float) -> Callable[[Watch], Ticks]:
    """The encoder of a wheel tells another angle than its potentiometers."""

    def ticks(watch: Watch) -> Ticks:
        watch.reference()
        watch.ill(STEER_LEFT, potentiometers=volts("left", radians(degrees)))
        return always(watch)

    return ticks


def crooked(degrees: float) -> Callable[[Watch], Ticks]:
    """The right wheel stands away from where the left one wants it; its potentiometers agree with it."""

    def ticks(watch: Watch) -> Ticks:
        watch.reference()
        watch.angles[1] = radians(degrees)
        return always(watch)

    return ticks


def frozen(degrees: float) -> Callable[[Watch], Ticks]:
    """A wheel turns so far, and one of its potentiometers stays."""

    def ticks(watch: Watch) -> Ticks:
        watch.reference()
        watch.ill(STEER_RIGHT, potentiometers=(volts("right", radians(degrees))[0], volts("right", 0.0)[1]))
        watch.angles[1] = radians(degrees)
        return always(watch)

    return ticks


def wishing(**changes: Any) -> Callable[[Watch], Ticks]:
    def ticks(watch: Watch) -> Ticks:
        watch.wish = replace(DRIVING, **changes)
        return always(watch)

    return ticks


def tracking(*arc_lengths: float, away: float = 0.0) -> Callable[[Watch], Ticks]:
    """Along a path at these arc lengths, again and again."""

    def ticks(watch: Watch) -> Ticks:
        command = DriveCommand(speed=0.3)
        if away:  # it was on its path
            watch.wish = replace(DRIVING, tracking=Tracking(arc_length=0.0, length=9.0, cross_track=0.0))
            watch.tick()
        while True:
            for arc in arc_lengths:
                watch.wish = replace(
                    DRIVING, command=command, tracking=Tracking(arc_length=arc, length=9.0, cross_track=away)
                )
                yield {}

    return ticks


def command(speed: float) -> dict[str, Any]:
    return {"command": DriveCommand(speed=speed)}


def volt(first: float) -> Callable[[Watch], Ticks]:
    return ill(STEER_LEFT, potentiometers=(first, 2.5))


SICK = STEER_LEFT
BLOCKED = driving(0.3, left=0.0, right=0.0)
FAULT = DriveState.FAULT
CASES = [
    Case("COM-01", S1, SICK, "reason was not heard", ill(SICK, state=FAULT, emergencies=(0,)), ill(SICK, state=FAULT)),
    Case("COM-02", S1, SICK, "now ready to switch on", ill(SICK), ill(SICK, state=DriveState.READY)),
    Case("COM-03", S1, SICK, "stuck in ready", ill(SICK), ill(SICK, state=DriveState.READY), hold=1.0),
    Case("COM-04", S1, LEFT, "mode 1, expected 3", ill(LEFT, mode=3), ill(LEFT, mode=1)),
    Case("COM-05", S1, SICK, "0x0165", ill(SICK), ill(SICK, state=DriveState.UNKNOWN, statusword=0x0165)),
    Case("COM-09", WARN, SICK, "answered late", said(SICK, stray=0), said(SICK, stray=1)),
    Case("COM-11", S1, SICK, "80 ms old", ill(SICK, age=0.08), ill(SICK, age=0.0801)),
    Case("COM-11", S1, SICK, "never heard", ill(SICK, age=0.08), ill(SICK, age=None)),
    Case("COM-14", S2, "", "3 in a second", said(SICK, malformed=2), said(SICK, malformed=3)),
    Case("COM-15", S1, SICK, "3 at once", ill(SICK, frames=2), ill(SICK, frames=3), hold=0.08),
    Case("COM-16", S2, SICK, "wrong order", said(SICK, disordered=0), said(SICK, disordered=1)),
    Case("COM-17", S1, "", "0x201", sense(**bus()), sense(once=True, **bus(foreign=(0x201,)))),
    Case("COM-18", S1, "", "0x77F", sense(**bus()), sense(once=True, **bus(foreign=(0x77F,)))),
    Case("COM-19", S1, SICK, "26 answers", said(SICK, stray=25), said(SICK, stray=26)),
    Case("COM-20", LIMIT, "", "1 error frames", sense(**bus()), sense(once=True, **bus(error_frames=1))),
    Case("COM-25", S1, "", "refuses frames", sense(**bus(refused=2)), sense(once=True, **bus(refused=3))),
    Case("COM-26", S1, RIGHT, "restarted", said(RIGHT, boots=0), said(RIGHT, boots=1)),
    Case("COM-27", S1, SICK, "PRE_OPERATIONAL", ill(SICK), ill(SICK, nmt=Nmt.PRE_OPERATIONAL)),
    Case("COM-27", S1, SICK, "never heard", ill(SICK), ill(SICK, nmt=None)),
    Case("COM-28", S1, SICK, "250 ms old", ill(SICK, heartbeat_age=0.25), ill(SICK, heartbeat_age=0.2501)),
    Case("COM-28", S1, SICK, "never heard", ill(SICK, heartbeat_age=0.25), ill(SICK, heartbeat_age=None)),
    Case("COM-29", S1, "", "80 ms old", all_old(0.08), all_old(0.0801)),
    Case("COM-31", WARN, "", "100 ms after", gap(0.0999), gap(0.1001)),
    Case("COM-31", S2, "", "150 ms after", gap(0.1499), gap(0.1501)),
    Case("DRV-33", S1, SICK, "21 in a second", said(SICK, emergencies=(0,) * 20), said(SICK, emergencies=(0,) * 21)),
    Case("EST-01", S1, "", "2 drives", supplies(0.0, 0.06), supplies(0.0, 0.02), hold=0.02),
    Case("INP-08", WARN, "stick", "faster than a hand", jumping(1), jumping(2), hold=0.04),
    Case("PLG-07", S1, "", "why", sense(**bus()), sense(once=True, **bus(blocked=("why",)))),
    Case("SYS-01", S2, "", "20 ms", sense(late=0.02), sense(late=0.0201), hold=0.039),
    Case("SYS-01", S2, "", "61 ms", sense(once=True, late=0.06), sense(once=True, late=0.061)),
    Case("SYS-03", S1, "", "for 151 ms", sense(late=0.15), sense(once=True, late=0.151)),
    Case("RUN-01", S1, LEFT, "commanded +0.30", driving(0.3, left=0.44), driving(0.3, left=0.46), 0.079, slow=0.04),
    Case("RUN-01", S1, RIGHT, "commanded -0.30", driving(-0.3, right=0.14), driving(-0.3, right=0.16), 0.079, 0.04),
    Case("RUN-02", S1, "", "0.05 m/s", rolling(0.049), rolling(0.055), hold=0.18, slow=0.04),
    Case("RUN-02", S1, "", "0.05 m/s", rolling(-0.049, DRIVING), rolling(-0.055, DRIVING), hold=0.18, slow=0.04),
    Case("RUN-02", S1, "", "0.01 m/s", rolling(0.009), rolling(0.012, DRIVING), hold=2.0, slow=0.04),
    Case("RUN-03", S0, "", "EMERGENCY STOP", fading(0.08), fading(0.2), hold=0.18, slow=0.25),
    Case("RUN-04", S2, RIGHT, "commanded +0.30", driving(0.3, left=0.1, right=0.1), BLOCKED, 0.94, 0.04),
    Case("RUN-05", LIMIT, "", "29%", driving(0.4, left=0.305), driving(0.4, left=0.285), 0.12, slow=0.2),
    Case("RUN-05", S2, "", "29%", driving(0.4, left=0.305), driving(0.4, left=0.285), 2.0, slow=0.2),
    Case("RUN-05", S2, "", "5", driving(0.4, left=0.205), driving(0.4, left=0.18), 0.12, slow=0.2),
    Case("RUN-06", S1, RIGHT, "drives while", alone(0.049), alone(0.051), hold=0.059, slow=0.04),
    Case("RUN-10", S1, SICK, "jumped", ill(SICK, jumps=1), ill(SICK, jumps=2)),
    Case("RUN-12", WARN, "", "+0.72 m/s", wishing(**command(0.713)), wishing(**command(0.716)), hold=1.0),
    Case("PTH-06", LIMIT, "", "+0.31 m", tracking(1.0, 2.0, away=0.299), tracking(1.0, 2.0, away=0.3051), hold=0.28),
    Case("PTH-07", S2, "", "at 1.00 m", tracking(1.0, 1.011), tracking(1.0, 1.009), hold=3.0, slow=0.02),
    Case("STE-01", S1, SICK, "3.1 degrees", off_angle(2.95), off_angle(3.06), hold=0.38),
    Case("STE-02", S1, SICK, "+1.82 A", ill(SICK, current=1.79), ill(SICK, current=1.82), hold=0.28),
    Case("STE-03", S1, STEER_RIGHT, "degrees", apart(2.95), apart(3.05), hold=0.08),
    Case("STE-04", S1, SICK, "0.09 V", volt(0.11), volt(0.09), 0.02),
    Case("STE-05", S1, SICK, "4.1 degrees", slipped(3.95), slipped(4.06), hold=0.18),
    Case("STE-06", S1, "", "0.0 and 4.1 degrees", crooked(3.95), crooked(4.06), hold=0.18),
    Case("STE-07", S1, STEER_RIGHT, "over 10 degrees", frozen(9.9), frozen(10.1)),
]  # fmt: skip


def test_every_measured_row_has_its_case() -> None:
    """Those of scanners, localizers, batteries: `test_supervisor_scanners`, `test_supervisor_poses`, `test_battery`."""
    measured = {
        id for id, row in catalogue.ROWS.items() if row.found is Found.MEASURED and id[:3] not in ("LAS", "LOC", "PWR")
    }
    assert {case.id for case in CASES} == measured | {"PTH-06"}
    for id in measured:
        limits = {stage.severity for stage in catalogue.ROWS[id].stages}
        assert {case.severity for case in CASES if case.id == id} >= limits - ({S1} if id == "RUN-03" else set())


def name_of(case: Case) -> str:
    return f"{case.id}-{case.severity.name}-{case.device or 'robot'}"


def watch_for(case: Case) -> Watch:
    """A healthy run, but for a drive that must not have been enabled yet."""
    watch = Watch()
    if case.id not in ("COM-03", "RUN-06"):
        watch.ticks(0.2)
    return watch


def play(watch: Watch, case: Case, ticks: Ticks, longest: float) -> float | None:
    """The time from the first of these ticks to the fault [s]; None: never."""
    begun = None
    for changes in ticks:
        watch.tick(**changes)
        begun = watch.time if begun is None else begun
        if watch.severity(case.id) >= case.severity:
            return watch.time - begun
        if watch.time - begun > longest:
            return None
    raise AssertionError


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_row_is_not_found_below_its_limit_however_long(case: Case) -> None:
    watch = watch_for(case)
    assert play(watch, case, case.below(watch), 2 * case.hold + 1.0) is None


@pytest.mark.parametrize("case", CASES, ids=name_of)
def test_row_is_found_above_its_limit_after_its_time(case: Case) -> None:
    watch = watch_for(case)
    took = play(watch, case, case.above(watch), 2 * case.hold + 1.0)
    assert took is not None
    assert case.hold - 1e-6 <= took <= case.hold + case.slow + PERIOD
    (fault,) = [fault for fault in watch.verdict.faults if fault.id == case.id and fault.device == case.device]
    row = catalogue.ROWS[case.id]
    assert fault.severity is case.severity
    assert row.text in fault.text
    assert case.words in fault.text
    assert fault.text.startswith(f"{case.device}: " if case.device else row.text)
    assert fault.to_fault is (row.to_fault and case.severity >= row.severity)
    assert watch.verdict.severity >= case.severity


@pytest.mark.parametrize("case", [case for case in CASES if case.hold >= 0.1], ids=name_of)
def test_time_begins_anew_after_a_tick_below_the_limit(case: Case) -> None:
    watch = watch_for(case)
    ticks = case.above(watch)
    watch.tick(**next(ticks))
    begun = watch.time
    while watch.time + PERIOD - begun < case.hold - 1e-6:
        watch.tick(**next(ticks))
        assert watch.severity(case.id) < case.severity
    ill, watch.wish = watch.wish, DRIVING
    watch.tick(drives=Watch().sense().drives)
    watch.wish = ill
    if case.id not in ("RUN-02", "RUN-03", "RUN-05"):  # a position that jumps looks like motion
        assert play(watch, case, ticks, case.hold - 3 * PERIOD) is None


def test_faults_of_all_drives_are_told_each() -> None:
    watch = Watch()
    for name in NAMES:
        watch.ill(name, boots=1)
    watch.tick()
    assert watch.found() == sorted(("COM-26", name) for name in NAMES)
