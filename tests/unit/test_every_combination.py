"""Every mode x device state x event, every pair of faults: no undefined outcome; more faults never mean less."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache

import pytest
from core_builders import NAMES, PERIOD, ROBOT, ROUTE, FakeBus, StubFollower, drive, drives, shared, snapshot
from msgspec.structs import replace

from artemis.devices.drive import Drives
from artemis.devices.epos_state import controlword
from artemis.drive_states import DriveState, Goal
from artemis.motion.limits import Gate, is_sane
from artemis.states.machine import TRANSITIONS, ModeMachine
from artemis.states.modes import Modes
from artemis.states.plan import CalibrateStep, FollowStep, Step, TeleopStep, WaitStep
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Kind
from artemis.supervision.policy import WATCHED
from artemis.supervision.supervisor import Supervisor
from artemis.values import (
    Action,
    Event,
    Fault,
    Mode,
    OperatorInput,
    Request,
    Sensed,
    SetPoints,
    Severity,
    Snapshot,
    Tick,
    Verdict,
    Wish,
)

STEPS: dict[Mode, Step] = {
    Mode.CALIBRATE: CalibrateStep(),
    Mode.FOLLOW: FollowStep(route=ROUTE, follower=StubFollower()),
    Mode.TELEOP: TeleopStep(input="stick", seconds=None),
}
FAULTS = [id for id, row in catalogue.ROWS.items() if row.found in WATCHED]
VERDICTS = ["", "INP-03", "DRV-25", "RUN-03"]
SICK = ("traction-left", "steer-right")


@cache
def machine() -> ModeMachine:
    """Made once: its table takes a millisecond."""
    return ModeMachine()


@pytest.fixture(autouse=True)
def _one_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.states.modes.ModeMachine", machine)


def modes_in(mode: Mode) -> Modes:
    """The modes' logic with the machine in `mode`, just entered by a healthy robot."""
    made = Modes(shared(STEPS.get(mode, WaitStep(seconds=1.0)), connected=mode is not Mode.INIT, aligned=True))
    machine()._model.state = made.mode = mode
    made._logic[mode].enter(snapshot())
    return made


@cache
def drives_on_a_bus() -> Drives:
    return Drives(ROBOT, FakeBus())


def verdict_on(id: str) -> Verdict:
    """The supervisor's verdict on one fault at its worst; RUN-03 is the one that goes on to power off."""
    if not id:
        return Verdict()
    fault = replace(catalogue.fault(id), severity=Severity.OFF if id == "RUN-03" else catalogue.ROWS[id].severity)
    return Verdict(severity=fault.severity, faults=(fault,), to_fault=fault.to_fault)


def assert_defined(before: Mode, event: Event | None, request: Request | None, state: DriveState) -> None:
    """The tick that follows is one: a mode by the table, a wish that means something, frames that may leave."""
    for sick, id in itertools.product(SICK, VERDICTS):
        verdict = verdict_on(id)
        seen = snapshot(
            1.0,
            verdict=verdict,
            drives=drives(drive(sick, state=state)),
            requests=() if request is None else (request,),
            inputs=(OperatorInput(source="stick", age=0.0),),
        )
        logic = modes_in(before)
        logic.advance(seen, event)
        after = logic.mode
        assert after is before or any(TRANSITIONS.get((before, happened)) is after for happened in Event), (
            f"{before} -> {after} is not in the table"
        )
        if verdict.to_fault and before not in (Mode.FAULT, Mode.END):
            assert after is Mode.FAULT
        wish = logic.step(seen)
        assert isinstance(wish, Wish)
        assert is_sane(wish.command)
        if verdict.severity is Severity.OFF:
            assert (wish.traction, wish.command.action) == (Goal.DISABLED, Action.DISABLE)
        for name in NAMES:
            goal = wish.traction if name.startswith("traction") else wish.steering
            assert isinstance(controlword(state, goal), int)
        assert_may_leave(seen, after, wish)


def assert_may_leave(seen: Snapshot, mode: Mode, wish: Wish) -> None:
    """What the wish makes of the wires is on the allow-list."""
    gate = Gate(ROBOT, PERIOD)
    points = gate.limit(wish.command, SetPoints(), PERIOD, stop=seen.verdict.stops)
    robot = drives_on_a_bus()
    robot.write(Tick(snapshot=seen, mode=mode, wish=wish, set_points=points))
    assert robot.wire.health().blocked == ()


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_with_every_device_state_and_event_has_a_defined_outcome(mode: Mode) -> None:
    for state in DriveState:
        for event in (None, *Event):
            assert_defined(mode, event, None, state)
        for request in Request:
            assert_defined(mode, None, request, state)


def judged(*faults: Fault) -> Verdict:
    """The verdict of a new supervisor on faults that are found in one tick, in this order."""
    sensed = Sensed(index=0, time=1.0, drives=drives(), faults=faults)
    return Supervisor(ROBOT, PERIOD).judge(sensed, Wish(), Mode.FOLLOW, SetPoints())


def pairs() -> Iterator[tuple[Fault, Fault]]:
    for first, second in itertools.combinations(FAULTS, 2):
        yield catalogue.fault(first, "traction-left"), catalogue.fault(second, "steer-right")


@pytest.mark.slow
def test_two_faults_at_once_are_met_at_least_as_severely_as_each_of_them() -> None:
    alone = {id: judged(catalogue.fault(id, "traction-left")) for id in FAULTS}
    for first, second in pairs():
        both, turned = judged(first, second), judged(second, first)
        one, other = alone[first.id], alone[second.id]
        assert both.severity is max(one.severity, other.severity), (first.id, second.id)
        assert both.to_fault is (one.to_fault or other.to_fault), (first.id, second.id)
        assert both.final is (one.final or other.final), (first.id, second.id)
        stops = [verdict for verdict in (one, other) if verdict.stops]
        assert both.recovers is (bool(stops) and all(v.recovers for v in stops)) or not both.recovers
        assert set(both.faults) == set(turned.faults), (first.id, second.id)
        assert (both.severity, both.to_fault, both.final, both.recovers) == (
            turned.severity,
            turned.to_fault,
            turned.final,
            turned.recovers,
        )


STRICTNESS = {Goal.ENABLED: 0, Goal.HOLD: 1, Goal.QUICK_STOPPED: 2, Goal.FAULT_RESET: 3, Goal.DISABLED: 3}


def reaction(mode: Mode, verdict: Verdict) -> tuple[Mode, int]:
    """Where a verdict leads, and how strict the driven wheels are held then."""
    logic = modes_in(mode)
    seen = snapshot(1.0, verdict=verdict, inputs=(OperatorInput(source="stick", age=0.0),))
    logic.advance(seen, None)
    return logic.mode, STRICTNESS[logic.step(seen).traction]


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.END])
def test_reactions_to_two_faults_are_never_milder_than_to_one(mode: Mode) -> None:
    """By kinds: rows of one severity, destination and finality lead to the same."""
    kinds = {(v.severity, v.to_fault, v.final): v for v in (judged(catalogue.fault(id)) for id in FAULTS)}
    alone = {kind: reaction(mode, verdict) for kind, verdict in kinds.items()}
    for one, other in itertools.product(kinds, repeat=2):
        both = judged(*kinds[one].faults, *kinds[other].faults)
        after, strict = reaction(mode, both)
        stops = [alone[kind][1] for kind in (one, other) if kind[0] >= Severity.CONTROLLED_STOP]
        assert strict >= max(stops, default=0), (one, other)  # what does not stop leaves the mode what it does
        if Mode.FAULT in (alone[one][0], alone[other][0]):
            assert after is Mode.FAULT


def test_every_row_that_is_noticed_takes_part() -> None:
    assert len(FAULTS) > 80
    assert {catalogue.ROWS[id].recovery.kind for id in FAULTS} == set(Kind)
