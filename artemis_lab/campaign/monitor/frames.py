"""Invariants of what is on the wire: I1, I2, I5."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, inf, radians

from artemis_lab.campaign.monitor.evidence import Evidence, Violation
from artemis_lab.campaign.monitor.wire import (
    HISTORY,
    IDENTITY,
    LOST_HEARTBEAT,
    MODE_SHOWN,
    VERSION,
    WATCHED_HOST,
    Boot,
    Event,
    ModeShown,
    SeenEmergency,
    SetPoint,
    Status,
    Transfer,
)
from artemis_lab.campaign.witness import SIDES

DRIVING, RESTING = {"teleop", "follow", "act"}, {"init", "fault", "end"}
QUEUED = 0.006
"""A frame may wait so long for the wire [s]: it can belong to the mode before."""
SCRUB = 0.05
"""A wheel's target may rise by this much while the robot slows down: it no longer rolls about its kingpin [m/s]."""
WATCH_MS = 200
"""A drive watches the host's heartbeat with this time-out."""
_OF_EPOS = {"traction": 3, "steering": -1}
MODES = {"epos1": _OF_EPOS, "epos2": _OF_EPOS, "epos4": {"traction": 9, "steering": 8}}
"""Modes of operation by family: profile velocity and position, or the cyclic synchronous ones. Other drives have theirs
in the robot file."""
COLLISION = 0x8150
"""Of a COB-ID collision the EPOS firmware specification 2010 (12.2) names no reaction: the drive goes on."""
SILENCE = 0.15
"""A pause of the host's heartbeat this long [s] is no jitter."""


# ---------------------------------------------------------------------------------------------- I1, I2


def targets_at_rest(e: Evidence) -> Iterator[Violation]:
    """I1: no target but zero in `init`, `fault`, `end`; elsewhere outside driving it only falls, to zero."""
    for side in SIDES:
        last = 0.0
        for time, target in e.targets[side]:
            before, last = abs(last), target
            if target == 0.0:
                continue
            modes = e.journal.modes_between(time - QUEUED, time)
            if modes & DRIVING:
                continue
            where = ", ".join(sorted(modes))
            if modes <= RESTING:
                yield Violation("I1", time, f"target {target:+.2f} m/s to the {side} wheel in {where}")
            elif abs(target) > before + (SCRUB if before else 0.0):
                yield Violation("I1", time, f"target of the {side} wheel rises to {target:+.2f} m/s in {where}")


GUIDED = ("INP-07", "INP-08", "INP-10", "INP-12")
"""With these the stick is not what moves the robot."""
_INPUT_LOST = {"INP-01": 0.06, "INP-03": 0.17, "INP-04": 0.17, "INP-05": 0.17, "INP-06": 1.02}
"""Worst case until the loss of the input is noticed [s]."""


def loss_of_input(e: Evidence) -> Iterator[Violation]:
    """I2: once the input is lost, or its enable button released, targets fall, and are zero after the ramp."""
    losses = [
        (i.time + _INPUT_LOST[i.id] + 1.5 * e.tick, f"{i.id} at {i.time:.3f} s")
        for i in e.injected
        if i.id in _INPUT_LOST and i.until > i.time + _INPUT_LOST[i.id] + 0.2 and e.journal.mode_at(i.time) == "teleop"
    ]
    for row, after in zip(e.stick, [*e.stick[1:], None], strict=False):
        again = after.time if after is not None and after.held else inf
        if not row.held and again - row.time > 1.5:
            losses.append((row.time + 2.5 * e.tick, f"release of the enable button at {row.time:.3f} s"))
    if any(i.id in GUIDED for i in e.injected):
        losses = []
    stall = [i for i in e.injected if "seconds" in i.options]
    limits, rear = e.robot.limits, e.robot.geometry.driven_axle == "rear"
    slowest = cos(radians(limits.steering_deg)) if rear else 1.0  # the faster driven wheel, where the virtual one has 1
    for since, why in losses:
        until = min([*(row.time for row in e.stick if row.held and row.time > since), inf])
        if e.journal.mode_at(since) not in {"teleop", "quickstop"} or any(abs(i.time - since) < 1.5 for i in stall):
            continue
        sent = {side: [(time, abs(v)) for time, v in e.targets[side] if since <= time < until] for side in SIDES}
        fastest = max((targets[0][1] for targets in sent.values() if targets), default=0.0)
        zero_by = since + fastest / slowest / limits.deceleration_m_s2 + 0.1 + e.tick
        for side in SIDES:
            last = inf
            for time, speed in sent[side]:
                if speed > last + SCRUB or (speed > 0.0 and time > zero_by):
                    yield Violation("I2", time, f"{side} wheel is still sent {speed:.2f} m/s after {why}")
                    break
                last = speed


# ---------------------------------------------------------------------------------------------- I5


@dataclass(slots=True)
class _Known:
    """What the host has made sure of, of one drive."""

    vendor: bool = False
    version: bool = False
    watch: int = -1
    mode: int | None = None
    mode_before: int | None = None
    changed: float = -inf
    """When the mode last changed [s]."""
    target: int | None = None
    proof: bool = False


def enabling(e: Evidence) -> Iterator[Violation]:
    """I5: a drive is enabled only after all that has to be known of it, since it booted or was in fault."""
    for name, drive in e.robot.drives.items():
        known, last = _Known(), Status(0.0, 0, 0)
        watch = e.robot.host_node_id << 16 | WATCH_MS
        for event in e.wire.nodes[drive.node_id].events:
            if isinstance(event, Status):
                if event.enabled and not last.enabled and not _forced(e, name, event.time):
                    off = abs(known.target - event.position) if known.target is not None else -1
                    if event.time - known.changed > 1.5 * e.tick:  # else it was told to before that could be seen
                        known.mode_before = known.mode
                    wrong = _unknown(e, name, known, watch, off)
                    if wrong:
                        yield Violation("I5", event.time, f"{name} was enabled without {', '.join(wrong)}")
                if event.faulty and not last.faulty and not _proving(e, event.time):
                    known = _Known()
                last = event
            else:
                known = _learned(e, known, event)


def _learned(e: Evidence, known: _Known, event: Event) -> _Known:
    match event:
        case Boot(reset=reset):
            return _Known(proof=known.proof and reset)
        case SeenEmergency(code=code) if code == LOST_HEARTBEAT and _proving(e, event.time):
            known.proof = True
        case SeenEmergency(code=code) if code not in (0, COLLISION):
            return _Known()
        case ModeShown(mode=mode) if mode != known.mode:
            known.mode, known.mode_before, known.changed = mode, known.mode, event.time
        case SetPoint(target=target):
            known.target = target
        case Transfer(object=index, sub=sub, value=value):
            known.vendor = known.vendor or (index, sub) == (IDENTITY, 1)
            known.version = known.version or (index, sub) in ((VERSION, 1), (IDENTITY, 3))
            known.proof = known.proof or (index == HISTORY and sub > 0 and value & 0xFFFF == LOST_HEARTBEAT)
            if (index, sub) == (WATCHED_HOST, 1):
                known.watch = value
            if index == MODE_SHOWN:
                known.mode = value - (value >> 7 << 8)
    return known


def _unknown(e: Evidence, name: str, known: _Known, watch: int, off: int) -> list[str]:
    """What had to be made sure of and was not; `off`: target less position [counts], negative if none was sent."""
    drive = e.robot.drives[name]
    counts_per_turn = drive.sensor.counts_per_turn * drive.gear_ratio
    zero = known.target == 0 if drive.role == "traction" else 0 <= off <= counts_per_turn * 3 / 360
    mode = MODES[drive.family][drive.role] if drive.cia402 is None else drive.cia402.operating_mode
    checks = {
        "its identity read": known.vendor and known.version,
        "watching our heartbeat": known.watch == watch,
        "its mode of operation seen": mode in (known.mode, known.mode_before),
        "a harmless target": zero,
        "the proof that it watches": known.proof,
    }
    return [what for what, done in checks.items() if not done]


def _proving(e: Evidence, time: float) -> bool:
    """The host's heartbeat pauses on purpose: in `init`, with no drive enabled."""
    look = e.look_at(time)
    return (
        "init" in e.journal.modes_between(time - 0.5, time)
        and time - e.beat_before(time) > SILENCE
        and (look is None or not any(look.enabled))
    )


def _forced(e: Evidence, name: str, time: float) -> bool:
    """The drive was put into operation by an injection, not by the host."""
    return any(i.id == "SYS-10" and i.node == name and 0.0 <= time - i.time < 2.0 for i in e.injected)


def controls_released(e: Evidence) -> Iterator[Violation]:
    """I5: driving by hand begins with the controls released."""
    odd = any(i.id.startswith(("INP", "SYS")) for i in e.injected)
    for time, mode in e.journal.modes:
        if mode != "teleop" or odd or not e.stick:
            continue
        rows = [row for row in e.stick if row.time <= time + e.tick]
        recent = [row for row in rows if row.time >= time - 2 * e.tick]
        before = rows[: len(rows) - len(recent)][-1:]  # where the stick was when that began
        if not any(row.neutral for row in (*before, *recent)):
            yield Violation("I5", time, "driving by hand began with the controls held")
