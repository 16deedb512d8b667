"""Requests that lead to nothing, and why: so that no operator waits for what will not come."""

from __future__ import annotations

from collections.abc import Mapping

from artemis.states.hands import RELEASE, hands_on
from artemis.states.homing import STRAIGHT
from artemis.states.quickstop import waits_for
from artemis.states.steering import JOGS, KEEP, START, TURN_IT
from artemis.supervision.supervisor import COVERED
from artemis.values import JobKind, Mode, Request, Tick, Verdict

_EARLY = {"listening", JobKind.SECURE.value, JobKind.CONFIGURE.value, "first contact", "proving the watchdog"}
"""Phases of the bring-up before it asks for an arm."""
_BY_HAND = {STRAIGHT, JobKind.REFERENCE.value}
"""Phases of the bring-up in which a person accepts that the wheels stand straight, and the one after it."""
_DRIVING = Mode.TELEOP, "no step by hand is running"
_MEASURING = Mode.CALIBRATE, "no wheel is being measured"
_ONLY_IN: Mapping[Request, tuple[Mode, str]] = {
    **dict.fromkeys((Request.DONE, Request.RECORD), _DRIVING),
    **dict.fromkeys((Request.ACCEPT, *JOGS), _MEASURING),
}


def by_hand(tick: Tick) -> tuple[bool, bool]:
    """Whether a person who accepts is waited for; and whether one who turns a wheel is."""
    phase = tick.wish.phase
    if tick.mode is Mode.INIT:
        return phase == STRAIGHT, False
    turns = tick.mode is Mode.CALIBRATE and phase.endswith(TURN_IT)
    return turns or (tick.mode is Mode.CALIBRATE and phase.endswith((START, KEEP))), turns


def ignored(request: Request, tick: Tick) -> str | None:
    """Why a request of this tick leads to nothing; None: it counts."""
    if request in (Request.QUICKSTOP, Request.END):
        return None
    if tick.mode is Mode.END:
        return "the run ends"
    if request is Request.ARM:
        return _arm_ignored(tick)
    if request is Request.ACKNOWLEDGE:
        return _acknowledge_ignored(tick)
    if request is Request.ACCEPT and tick.mode is Mode.INIT and tick.wish.phase in _BY_HAND:
        return None
    mode, reason = _ONLY_IN[request]
    return None if tick.mode is mode else reason


def accepted(request: Request, tick: Tick, before: Verdict) -> str | None:
    """What a request of this tick accepted, after the verdict `before`; None: nothing."""
    stopped = before.stopping
    if request is not Request.ACKNOWLEDGE or any(fault.id != COVERED for fault in stopped):
        return None
    left = [fault.device for fault in tick.snapshot.verdict.faults if fault.id == COVERED]
    taken = [fault.device for fault in stopped if fault.device not in left]
    return f"the view of scanner {', '.join(taken)} is taken as it is" if taken else None


def _arm_ignored(tick: Tick) -> str | None:
    snapshot, phase = tick.snapshot, tick.wish.phase
    held = phase if phase.startswith(RELEASE) else hands_on(snapshot.sensed.inputs)  # of lost inputs, the mode tells
    match tick.mode:
        case Mode.FAULT:
            return "acknowledge the fault first"
        case Mode.QUICKSTOP:
            return (
                "the robot is still stopping" if phase in ("stopping", "switching off") else waits_for(snapshot, held)
            )
        case Mode.INIT:
            return "it is not needed yet" if phase in _EARLY else held
    return "the drives are armed"


def _acknowledge_ignored(tick: Tick) -> str | None:
    verdict = tick.snapshot.verdict
    if tick.mode is Mode.FAULT:
        refused = tick.wish.phase.startswith(("cannot acknowledge yet", "this run cannot continue"))
        return tick.wish.phase if refused else None
    if tick.mode is not Mode.QUICKSTOP:
        return "there is no fault to acknowledge"
    if verdict.stops:
        return (
            waits_for(tick.snapshot, None) if verdict.final else f"its cause is still present: {verdict.faults[0].text}"
        )
    return None
