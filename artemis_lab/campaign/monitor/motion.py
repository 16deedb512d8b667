"""Invariants of what truly moves: the second half of I1, I4, I6, I7, I8."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf

from artemis_lab.campaign.monitor.evidence import Evidence, Injected, Violation
from artemis_lab.campaign.monitor.expected import Expected, When, expectation
from artemis_lab.campaign.monitor.frames import DRIVING, GUIDED, WATCH_MS
from artemis_lab.campaign.monitor.wire import ENABLE, WATCHED_HOST, Boot, SetPoint, Status, Transfer
from artemis_lab.campaign.witness import SIDES, Look

STOPPED = ("fault", "quickstop", "end")
MOVING = 0.01
"""A robot that is faster moves [m/s]."""
ROLLING = 0.05
"""A robot that is slower than this [m/s] may lose its steering."""
CREEPING, RESTS_IN = 0.02, 2.7
"""A robot that nobody drives and that is faster than this [m/s] is stopped within the second [s], after its ramp: it
has two to settle, and then it brakes."""
WORTH = 0.1
"""Stopping distances are judged from this speed on [m/s]."""
REACTION = 0.06
"""From noticing to the begin of the braking [s]: a frame, a regulator, a ramp's first step."""
BRAKES = {"S1": 1.4, "S2": 0.9}
"""Deceleration that is left of the robot file's 1.5 (quick stop) and 1.0 (controlled stop) with slip and lag [m/s²]."""
COASTING = 0.1
"""Least deceleration of a robot of which a drive is off [m/s²]: rolling friction; nothing brakes that wheel."""
SLACK = 0.02
"""[m]."""
PUSHED = ("RUN-02", "RUN-03", "RUN-01", "RUN-05", "COM-12", "SYS-10", "RUN-09", "RUN-10", "STE-05", "STE-06")
"""With these a robot may move on through no fault of the host: its ground, brakes, wheels or ears are not sound."""
ROLLS_ON = 3.0
"""What comes of them is over so much later [s]."""
UNPOWERED = ("EST-01", "EST-03", "EST-04", "SYS-09", "PWR-02", "PWR-03", "COM-32", "COM-33", "DRV-04")
CUT_OFF = ("COM-21", "COM-22", "COM-23", "COM-24", "COM-25")
"""The host does not reach the drives: they notice by themselves."""
HELD = ("RUN-04", "PTH-07")
"""A driven wheel, or both, cannot turn."""
STALLS = ("SYS-01", "SYS-03", "SYS-07", "COM-31", "PLG-03", "PLG-04", "PTH-09")
HELPLESS = (*CUT_OFF, *STALLS, "COM-29", "COM-12")
ALONE = 0.12
"""A driven wheel may push so long [s] while the other is off."""
NOTICED = 0.06
"""Motion that nobody commanded is in the feedback of the second tick after it began [s]."""
FOUND = 0.5
"""A drive that is found turning at the start is stopped in this time: the host listens first [s]."""
STILL_TIME = 0.2
"""Motion for longer than this [s] is no settling."""
LYING = ("STE-03", "STE-04", "STE-06", "STE-07", "CAL-02", "RUN-10")
"""While these last, what the host is told of the wheels' angles is not true."""
SHIFTING = ("STE-05", "RUN-09")
"""At the moment of these, what it was told until then becomes untrue."""
ASKEW = 0.06
"""A wheel that is farther from straight [rad] is not aligned."""
AT_ONCE = 0.0015
"""A drive acts this soon after its time-out [s]."""


def stops(e: Evidence) -> Iterator[Violation]:
    """I4: from the injection of a fault to standstill no further than v (detect + react) + v²/2a, in true metres.

    Where a drive cuts its power its wheel rolls out: then `a` is what friction does. Faults that come together, or hit
    a machine that cannot brake, have no budget.
    """
    for injected in e.injected:
        expected = expectation(injected, e)
        begin = e.look_at(injected.time)
        if begin is None or abs(begin.speed) < WORTH or not expected.stop or not _fits(e, injected, expected):
            continue
        if any(other is not injected and other.time < injected.time + 3.0 for other in e.injected):
            continue
        if injected.is_counted:
            continue
        stopped = e.journal.next_mode(injected.time, "fault", "quickstop")
        if stopped is None or stopped > injected.time + expected.within + 0.1 or injected.until < stopped:
            continue
        until = next((t for t, _ in e.journal.modes if t > stopped and e.journal.mode_at(t) in DRIVING), inf)
        looks = e.looks_between(injected.time, until)
        reaction = expected.within + e.tick + REACTION + _lag(e)
        fastest = max(abs(look.speed) for look in looks if look.time <= injected.time + reaction)
        reaction += WATCH_MS / 1000 if injected.id in CUT_OFF else 0.0
        braking = COASTING if expected.coasts else BRAKES[expected.stop]
        budget = fastest * reaction + fastest**2 / (2 * braking) + SLACK
        distance = _rolled(looks)
        if distance > budget:
            text = f"{injected.id} at {fastest:.2f} m/s: stopped after {distance:.3f} m, budget {budget:.3f} m"
            yield Violation("I4", injected.time, text)


def _fits(e: Evidence, injected: Injected, expected: Expected) -> bool:
    """The fault hits a robot that drives, in the situation in which it has to be noticed."""
    mode = e.journal.mode_at(injected.time)
    wanted = {When.BY_HAND: ("teleop",), When.FOLLOWING: ("follow", "act")}.get(expected.when, DRIVING)
    return mode in DRIVING and mode in wanted and expected.when not in (When.UNTOLD, When.HARMLESS, When.FROM_START)


def _lag(e: Evidence) -> float:
    """What slower ticks than 50 a second add to the detection [s]."""
    return max(0.0, 2.5 * (e.tick - 0.02))


def _rolled(looks: Sequence[Look]) -> float:
    """Distance of the virtual front wheel until it stands [m]."""
    distance = 0.0
    for before, look in pairwise(looks):
        distance += abs(look.speed) * (look.time - before.time)
        if abs(look.speed) < MOVING / 5:
            return distance
    return distance


def slows_down(e: Evidence) -> Iterator[Violation]:
    """I1: in `fault` and `quickstop` the true speed stays below the planned ramp, and ends at zero."""
    excused = (*PUSHED, *UNPOWERED, *CUT_OFF, *STALLS)
    for (begin, mode), (end, _) in pairwise([*e.journal.modes, (inf, "")]):
        first = e.look_at(begin)
        if mode not in ("fault", "quickstop") or first is None or _is_during(e, excused, begin, end):
            continue
        causes = [expectation(i, e) for i in e.injected if i.time < begin + 0.5]
        coasts = any(cause.coasts or not cause.stop for cause in causes)
        braking, looks = COASTING if coasts else BRAKES["S2"], e.looks_between(begin, end)
        blocked = any(i.id == "RUN-04" for i in e.injected)  # then the drives brake the other wheel from its own speed
        fastest = max((_fastest(look, blocked) for look in looks if look.time < begin + 0.1), default=0.0)
        if any(i.id in HELD and i.time < begin < i.until for i in e.injected):
            fastest = max(fastest, *(_told(e.targets[side], begin) for side in SIDES))  # once freed, it rolls as told
        for look in looks:
            ramp = max(0.0, fastest - braking * (look.time - begin - 0.1 - REACTION - e.tick))
            if abs(look.speed) > ramp + 0.05:
                yield Violation("I1", look.time, f"{look.speed:+.2f} m/s in {mode}, ramp {ramp:.2f} m/s")
                break


def _is_during(e: Evidence, ids: Sequence[str], begin: float, end: float) -> bool:
    """Whether one of these is there between two times [s], or was a short time before."""
    return any(i.id in ids and i.time <= end and i.until + ROLLS_ON >= begin for i in e.injected)


def rests(e: Evidence) -> Iterator[Violation]:
    """I1: while nobody drives the robot, in `ready` or with the enable button released, it stands, or is stopped."""
    if any(i.id in GUIDED for i in e.injected):
        return
    longest = RESTS_IN + e.robot.limits.speed_m_s / e.robot.limits.deceleration_m_s2
    for (begin, mode), (end, _) in pairwise([*e.journal.modes, (inf, "")]):
        if mode not in ("ready", "teleop"):
            continue
        held = [(row.time, after.time) for row, after in pairwise(e.stick) if row.held] if mode == "teleop" else []
        since: float | None = None
        for look in e.looks_between(begin, end):
            driven = any(pressed <= look.time < released for pressed, released in held)
            still = driven or abs(look.speed) < CREEPING
            since = None if still else look.time if since is None else since
            if since is not None and look.time - since > longest:
                yield Violation("I1", look.time, f"{look.speed:+.2f} m/s though nobody drives it since {since:.2f} s")
                return


def _told(targets: Sequence[tuple[float, float]], begin: float) -> float:
    """Speed that a driven wheel was last told before `begin` [m/s]."""
    return next((abs(target) for time, target in reversed(targets) if time < begin), 0.0)


def _fastest(look: Look, blocked: bool) -> float:
    """Speed of the virtual front wheel [m/s], or of the fastest driven wheel where one is blocked."""
    return max(abs(look.speed), *map(abs, look.rolling)) if blocked else abs(look.speed)


def moves_after_acknowledgment(e: Evidence) -> Iterator[Violation]:
    """I6: after an acknowledgment the robot stands until it is armed."""
    acknowledged = e.acts("acknowledge") + [i.time for i in e.injected if i.id.startswith("OPR")]
    ignored = {line.time for line in e.journal.of("request") if line.data.get("ignored")}
    for time in acknowledged:
        if e.journal.mode_at(time) not in ("fault", "quickstop") or time in ignored:  # it was armed already
            continue
        armed = min((arm for arm in e.acts("arm") if arm > time), default=inf)
        if _is_during(e, PUSHED, time, armed):
            continue
        rested, moving_since = False, None
        for look in e.looks_between(time, armed):
            if abs(look.speed) <= MOVING:
                rested, moving_since = True, None
            elif rested:
                moving_since = look.time if moving_since is None else moving_since
                if look.time - moving_since > STILL_TIME:
                    text = f"moves with {look.speed:+.2f} m/s, acknowledged at {time:.2f} s and not armed"
                    yield Violation("I6", look.time, text)
                    break


def drives_watch(e: Evidence) -> Iterator[Violation]:
    """I7: whatever becomes of the host, a drive that watches it begins to stop 200 ms after the last heartbeat."""
    for number, (role, side) in enumerate((role, side) for role in ("traction", "steering") for side in SIDES):
        name, drive = e.robot.drive_at(role, side)
        if any(i.id == "COM-30" and i.node in ("", name) for i in e.injected):
            continue
        armed = _armed(e, drive.node_id)
        for look in e.looks:
            silent = look.time - e.beat_before(look.time)
            if silent <= WATCH_MS / 1000 + AT_ONCE or not look.enabled[number]:
                continue
            since = next((begin for begin, end in armed if begin < e.beat_before(look.time) < look.time < end), None)
            forced = any(i.id == "SYS-10" and i.node == name and 0 <= look.time - i.time < silent for i in e.injected)
            if since is not None and not forced:
                yield Violation(
                    "I7", look.time, f"{name} stays enabled {silent * 1000:.0f} ms after the last heartbeat"
                )
                break


def _armed(e: Evidence, node: int) -> list[tuple[float, float]]:
    """From when to when [s] a drive watches the host: object 0x1016 is set, and it did not restart."""
    found: list[tuple[float, float]] = []
    begin: float | None = None
    for event in e.wire.nodes[node].events:
        ends = isinstance(event, Boot)
        if isinstance(event, Transfer) and event.write and (event.object, event.sub) == (WATCHED_HOST, 1):
            ends = event.value == 0
            begin = event.time if begin is None and not ends else begin
        if ends and begin is not None:
            found.append((begin, event.time))
            begin = None
    return found if begin is None else [*found, (begin, inf)]


def pushes_alone(e: Evidence) -> Iterator[Violation]:
    """I8: no driven wheel pushes for longer than 120 ms while the other's drive is off and the robot moves."""
    longest = max(ALONE, 4 * e.tick)
    for side, other in ((0, 1), (1, 0)):
        since: float | None = None
        for look in e.looks:
            alone = look.pushed[side] and not look.enabled[other] and abs(look.speed) > MOVING
            since = (look.time if since is None else since) if alone else None
            if since is None:
                continue
            helpless = any(e.active(time, *HELPLESS, after=1.5) for time in (since, look.time))
            found_turning = any(i.id == "SYS-10" and abs(since - i.time) <= FOUND for i in e.injected)
            if found_turning and helpless:
                continue  # nobody can stop it
            if look.time - since > longest + (FOUND if found_turning else WATCH_MS / 1000 if helpless else 0.0):
                yield Violation("I8", look.time, f"the {SIDES[side]} wheel pushes alone since {since:.3f} s")
                break


def steering_holds(e: Evidence) -> Iterator[Violation]:
    """I8: while the robot moves, the host switches no sound steering drive off; it has done so after `t_stop_max`.

    One that is unresponsive is told again and again what was decided while the robot stood.
    """
    longest = 1.0 + 2.0 * e.robot.limits.speed_m_s / e.robot.limits.quick_stop_deceleration_m_s2
    for number, side in enumerate(SIDES, 2):
        enabled = told = False
        for event in e.wire.nodes[e.node("steering", side)].events:
            if isinstance(event, Status):
                enabled = event.enabled
            if not isinstance(event, SetPoint):
                continue
            if event.controlword == ENABLE:
                told = False
                continue
            if told or not enabled:
                continue
            look = e.look_at(event.time)
            if look is None or not look.enabled[number]:
                continue
            turning = any(i.id == "SYS-10" and 0.0 <= event.time - i.time <= NOTICED for i in e.injected)
            if abs(look.speed) < ROLLING or turning:  # a drive that is made to turn by itself is not heard of yet
                told = True
                continue
            since = max((time for time, mode in e.journal.modes if mode in STOPPED and time <= event.time), default=0.0)
            if event.time - since < longest:
                text = f"the {side} steering drive is commanded 0x{event.controlword:02X} at {look.speed:+.2f} m/s"
                yield Violation("I8", event.time, text)
                break


def heartbeats_of_ticks(e: Evidence) -> Iterator[Violation]:
    """I7: a heartbeat is the last act of a tick: in the modes that exchange set-points each follows a SYNC."""
    if any(i.id in ("COM-18", "COM-25") for i in e.injected):
        return  # another host's heartbeats, or a SYNC that the adapter did not take
    for before, beat in pairwise(e.wire.beats):
        exchanging = e.journal.modes_between(before - 0.01, beat) <= {"ready", "calibrate", *DRIVING}
        if exchanging and bisect_right(e.wire.syncs, before) == bisect_right(e.wire.syncs, beat):
            yield Violation("I7", beat, "a heartbeat without a tick")
            return


def aligned(e: Evidence) -> Iterator[Violation]:
    """I5: after a bring-up the traction drives are enabled only with the wheels truly straight.

    Unless, since that bring-up began, the host was told something else of their angles.
    """
    for before, look in pairwise(e.looks):
        if any(look.enabled[:2]) and not any(before.enabled[:2]) and e.journal.mode_at(look.time) == "init":
            askew = max(abs(angle) for angle in look.angles)
            begun = max((time for time, _ in e.journal.modes if time <= look.time), default=0.0)
            if askew > ASKEW and not any(i.id == "SYS-10" or _misleads(i, begun, look.time) for i in e.injected):
                yield Violation("I5", look.time, f"traction was enabled with a wheel at {askew:.3f} rad")


def _misleads(injected: Injected, begin: float, end: float) -> bool:
    """Between two times [s] the host could not know from what it was told where the wheels stood."""
    until = injected.time if injected.id in SHIFTING else injected.until
    return injected.id in (*LYING, *SHIFTING) and injected.time <= end and until >= begin
