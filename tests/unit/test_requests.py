"""Requests that lead to nothing, and why: of every request, in every mode and phase that matters."""

from __future__ import annotations

from typing import Any

import pytest
from core_builders import judged, snapshot

from artemis.states.homing import STRAIGHT
from artemis.states.requests import accepted, by_hand, ignored
from artemis.states.steering import KEEP, START, TURN_IT
from artemis.supervision import catalogue
from artemis.values import Mode, OperatorInput, Request, SetPoints, Severity, Tick, Verdict, Wish

HELD = OperatorInput(source="stick", neutral=False, age=0.0)
FAULT = "DRV-25"
NO_REPORTS = "release the controls; no reports from trainee"


def at(mode: Mode, phase: str = "", verdict: Verdict | None = None, **sensed: Any) -> Tick:  # noqa: ANN401
    return Tick(snapshot=snapshot(verdict=verdict, **sensed), mode=mode, wish=Wish(phase=phase), set_points=SetPoints())


@pytest.mark.parametrize("mode", Mode)
def test_a_stop_and_the_end_always_count(mode: Mode) -> None:
    for request in (Request.QUICKSTOP, Request.END):
        assert ignored(request, at(mode)) is None


@pytest.mark.parametrize(
    "request_", [request for request in Request if request not in (Request.QUICKSTOP, Request.END)]
)
def test_nothing_else_counts_while_the_run_ends(request_: Request) -> None:
    assert ignored(request_, at(Mode.END)) == "the run ends"


@pytest.mark.parametrize(
    ("request_", "counts", "reason"),
    [
        (Request.DONE, Mode.TELEOP, "no step by hand is running"),
        (Request.RECORD, Mode.TELEOP, "no step by hand is running"),
        (Request.ACCEPT, Mode.CALIBRATE, "no wheel is being measured"),
        (Request.LEFT_DEGREE, Mode.CALIBRATE, "no wheel is being measured"),
        (Request.RIGHT_DEGREE, Mode.CALIBRATE, "no wheel is being measured"),
        (Request.LEFT_TENTH, Mode.CALIBRATE, "no wheel is being measured"),
        (Request.RIGHT_TENTH, Mode.CALIBRATE, "no wheel is being measured"),
    ],
)
def test_what_counts_in_one_mode_only(request_: Request, counts: Mode, reason: str) -> None:
    found: dict[Mode, str | None] = {mode: ignored(request_, at(mode)) for mode in Mode if mode is not Mode.END}

    assert found.pop(counts) is None
    assert set(found.values()) == {reason}


@pytest.mark.parametrize(
    ("mode", "phase", "reason"),
    [
        (Mode.INIT, STRAIGHT, None),
        (Mode.INIT, "reference", None),
        (Mode.INIT, "first contact", "no wheel is being measured"),
        (Mode.READY, STRAIGHT, "no wheel is being measured"),
    ],
)
def test_straight_wheels_are_accepted_while_they_are_asked_for(mode: Mode, phase: str, reason: str | None) -> None:
    assert ignored(Request.ACCEPT, at(mode, phase)) == reason
    assert ignored(Request.LEFT_DEGREE, at(mode, phase)) == "no wheel is being measured"


@pytest.mark.parametrize("early", ["listening", "secure", "configure", "first contact", "proving the watchdog"])
def test_arming_is_not_needed_before_it_is_asked_for(early: str) -> None:
    assert ignored(Request.ARM, at(Mode.INIT, early)) == "it is not needed yet"


@pytest.mark.parametrize(
    ("mode", "phase", "inputs", "reason"),
    [
        (Mode.INIT, "waiting for arm", (), None),
        (Mode.INIT, "waiting for arm", (HELD,), "release the controls"),
        (Mode.INIT, NO_REPORTS, (), NO_REPORTS),
        (Mode.QUICKSTOP, NO_REPORTS, (), NO_REPORTS),
        (Mode.READY, NO_REPORTS, (), "the drives are armed"),
        (Mode.FAULT, "", (), "acknowledge the fault first"),
        (Mode.QUICKSTOP, "stopping", (), "the robot is still stopping"),
        (Mode.QUICKSTOP, "switching off", (), "the robot is still stopping"),
        (Mode.QUICKSTOP, "stopped", (), None),
        (Mode.QUICKSTOP, "stopped", (HELD,), "release the controls"),
        (Mode.READY, "listening", (), "the drives are armed"),
        (Mode.TELEOP, "", (), "the drives are armed"),
        (Mode.FOLLOW, "", (), "the drives are armed"),
    ],
)
def test_arming(mode: Mode, phase: str, inputs: tuple[OperatorInput, ...], reason: str | None) -> None:
    assert ignored(Request.ARM, at(mode, phase, inputs=inputs)) == reason


@pytest.mark.parametrize(
    ("phase", "reason"),
    [
        ("cannot acknowledge yet: it still moves", "cannot acknowledge yet: it still moves"),
        ("this run cannot continue: why", "this run cannot continue: why"),
        ("acknowledge", None),
    ],
)
def test_a_fault_is_acknowledged_once_that_is_possible(phase: str, reason: str | None) -> None:
    assert ignored(Request.ACKNOWLEDGE, at(Mode.FAULT, phase)) == reason


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in (Mode.FAULT, Mode.QUICKSTOP, Mode.END)])
def test_there_is_nothing_to_acknowledge_in_other_modes(mode: Mode) -> None:
    assert ignored(Request.ACKNOWLEDGE, at(mode, "cannot acknowledge yet")) == "there is no fault to acknowledge"


def test_a_stop_is_acknowledged_once_its_cause_is_gone() -> None:
    present, final = judged(FAULT, "STE-05"), judged(FAULT, final=True)
    text = present.faults[0].text

    assert ignored(Request.ACKNOWLEDGE, at(Mode.QUICKSTOP)) is None
    assert ignored(Request.ACKNOWLEDGE, at(Mode.QUICKSTOP, verdict=present)) == f"its cause is still present: {text}"
    refused = ignored(Request.ACKNOWLEDGE, at(Mode.QUICKSTOP, verdict=final))
    assert refused == f"this run cannot continue; end it: {text}"


@pytest.mark.parametrize(
    ("mode", "phase", "found"),
    [
        (Mode.INIT, STRAIGHT, (True, False)),
        (Mode.INIT, f"{STRAIGHT}.", (False, False)),
        (Mode.INIT, TURN_IT, (False, False)),
        (Mode.CALIBRATE, f"left wheel: {TURN_IT}", (True, True)),
        (Mode.CALIBRATE, f"keep clear: {START}", (True, False)),
        (Mode.CALIBRATE, f"keep this? {KEEP}", (True, False)),
        (Mode.CALIBRATE, STRAIGHT, (False, False)),
        (Mode.TELEOP, TURN_IT, (False, False)),
        (Mode.TELEOP, START, (False, False)),
    ],
)
def test_what_a_person_is_waited_for(mode: Mode, phase: str, found: tuple[bool, bool]) -> None:
    assert by_hand(at(mode, phase)) == found


@pytest.mark.parametrize(
    ("before", "after", "accepted_"),
    [
        (judged("LAS-06", device="front"), Verdict(), "the view of scanner front is taken as it is"),
        (judged("LAS-06", device="front"), judged("LAS-06", device="front"), None),
        (judged("LAS-06", "STE-05", device="front"), Verdict(), None),
        (Verdict(), Verdict(), None),
        (judged(FAULT, device="front"), Verdict(), None),
    ],
)
def test_what_an_acknowledgment_accepts_of_a_scanner(before: Verdict, after: Verdict, accepted_: str | None) -> None:
    now = at(Mode.QUICKSTOP, verdict=after)
    assert accepted(Request.ACKNOWLEDGE, now, before) == accepted_
    assert accepted(Request.ARM, now, before) is None


def test_each_scanner_that_is_accepted_is_named() -> None:
    both, rear = (
        Verdict(severity=Severity.CONTROLLED_STOP, faults=tuple(catalogue.fault("LAS-06", name) for name in names))
        for names in (("front", "rear"), ("rear",))
    )
    assert accepted(Request.ACKNOWLEDGE, at(Mode.FAULT), both) == "the view of scanner front, rear is taken as it is"
    told = accepted(Request.ACKNOWLEDGE, at(Mode.FAULT, verdict=rear), both)
    assert told == "the view of scanner front is taken as it is"
