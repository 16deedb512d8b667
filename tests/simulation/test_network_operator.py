"""Whole runs, on virtual time, whose operator is on another computer: the network fails, and the robot stops."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from link_rig import DRIVING, NEUTRAL, LinkedInput, Net, Operator
from msgspec.structs import replace
from rig import CALIBRATE, TELEOP, TICK, Rig, Run, standing, write_mission

from artemis.bridges.operator.session import FRESH
from artemis.planning import plugin_made
from artemis.recording.mcap_reader import Recording
from artemis.robot import LIMITED_SPEED
from artemis.supervision import catalogue
from artemis.values import Mode, OperatorInput, Request, Severity

pytestmark = pytest.mark.short_alignment

AT = 4.0
"""The robot drives by then [s]."""
DECELERATION = 1.0
"""Of a controlled stop in the robot file [m/s²]."""
WORST = 0.3
"""From a cut to the controlled stop [s]."""


class Driven:
    """A run whose operator drives from 3 s on, and what is done to him meanwhile."""

    def __init__(self, folder: Path, *operator: tuple[float, str], **keys: Any) -> None:  # noqa: ANN401
        self.net = Net()
        self.alice = self.net.operator()
        acts = [{"at_s": time, "do": what} for time, what in operator]
        inputs = {"stick": {"plugin": "network"}}
        mission = write_mission(folder, [TELEOP], inputs=inputs, simulation={"operator": acts} if acts else {}, **keys)
        self.rig = Rig(mission, input=LinkedInput(self.net), longest=30.0)
        self.at(3.0, self.alice, DRIVING)

    def at(self, time: float, operator: Operator, hand: OperatorInput) -> Driven:
        """He holds it so from then on."""

        def hold() -> None:
            operator.hand = hand

        self.rig.at(time, hold)
        return self

    def do(self, time: float, act: Callable[[], object]) -> Driven:
        """Something else happens."""
        self.rig.at(time, lambda: (act(), None)[1])
        return self


@pytest.fixture(autouse=True)
def _no_secret_of_ours(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def done(hand: OperatorInput = NEUTRAL) -> OperatorInput:
    return replace(hand, requests=(Request.DONE,))


def assert_stops(run: Run, row: str, at: float, within: float) -> None:
    """A controlled stop in time: the gate's ramp, drives on."""
    noticed = run.first(lambda seen: any(fault.id == row for fault in seen.tick.snapshot.verdict.faults))
    assert noticed.time - at <= within
    assert noticed.tick.snapshot.verdict.severity is Severity.CONTROLLED_STOP
    assert noticed.mode is Mode.QUICKSTOP
    assert "INP-01" not in run.fault_ids
    assert "INP-03" not in run.fault_ids
    speeds = [seen.tick.set_points.speed for seen in run.seen if seen.time >= noticed.time]
    steps = [before - after for before, after in itertools.pairwise(speeds) if before > 0.0]
    assert max(steps) <= DECELERATION * TICK + 1e-9
    assert 0.0 in speeds[: round(0.4 / DECELERATION / TICK) + 2]


def cut(operator: Operator) -> None:
    operator.to_robot.cut = operator.to_operator.cut = True


def test_drives_to_the_end_and_replays(tmp_path: Path) -> None:
    driven = Driven(tmp_path)
    run = driven.at(5.0, driven.alice, done()).rig.run()
    assert (run.status, run.fault_ids) == (0, [])
    assert max(seen.tick.set_points.speed for seen in run.seen) == pytest.approx(0.4)
    assert run.recompute().difference is None
    assert run.outcome is not None
    samples = [tick.snapshot.sensed.inputs for tick in Recording(run.outcome.run.path).ticks()]
    assert samples == [seen.tick.snapshot.sensed.inputs for seen in run.seen], "recorded as any other"


@pytest.mark.parametrize("phase", [0.001, 0.013, 0.037])
def test_a_cut_link_stops_the_robot(tmp_path: Path, phase: float) -> None:
    driven = Driven(tmp_path)
    run = driven.do(AT + phase, lambda: cut(driven.alice)).rig.run()
    assert_stops(run, "NET-01", AT + phase, WORST)
    assert run.status == 1, "nobody is there to go on"
    assert standing(run.world.truth)
    assert run.recompute().difference is None


@pytest.mark.parametrize(
    ("row", "damage"),
    [("NET-03", "stall"), ("NET-05", {"loss": 0.3}), ("NET-15", {"delay_s": 0.18})],
)
def test_a_poor_link_drives_slowly(tmp_path: Path, row: str, damage: Any) -> None:  # noqa: ANN401
    driven = Driven(tmp_path)
    line = driven.alice.to_robot
    if damage == "stall":
        for number in range(30):  # waves: what waits for 0.12 s comes at once
            driven.do(AT + 0.14 * number, lambda: setattr(line, "stall", True))
            driven.do(AT + 0.14 * number + 0.12, lambda: setattr(line, "stall", False))
    else:
        for name, value in damage.items():
            driven.do(AT, lambda name=name, value=value: setattr(line, name, value))  # type: ignore[misc]
    run = driven.at(AT + 6.0, driven.alice, done()).rig.run()
    assert (run.status, run.fault_ids) == (0, [row])
    noticed = run.first(lambda seen: any(fault.id == row for fault in seen.tick.snapshot.verdict.faults))
    assert noticed.tick.snapshot.verdict.severity is Severity.LIMIT
    within = catalogue.ROWS[row].within
    assert noticed.time - AT <= within
    assert Mode.QUICKSTOP not in run.modes
    limited = [abs(seen.tick.set_points.speed) for seen in run.seen if noticed.time + 0.3 < seen.time < AT + 3.0]
    assert max(limited) == pytest.approx(LIMITED_SPEED)
    assert max(seen.tick.set_points.speed for seen in run.seen if seen.time < AT) == pytest.approx(0.4)


def test_latency_stops_the_robot(tmp_path: Path) -> None:
    driven = Driven(tmp_path)

    def late() -> None:
        driven.alice.to_operator.cut = True

    run = driven.do(AT, late).rig.run()
    assert_stops(run, "NET-02", AT, WORST)


def test_after_a_loss_the_robot_goes_on_once_it_is_armed_with_the_controls_released(tmp_path: Path) -> None:
    driven = Driven(tmp_path, (8.0, "arm"), (20.0, "acknowledge"))
    net = driven.net
    driven.do(AT, lambda: cut(driven.alice))

    def again() -> None:
        net.operator("bob")

    driven.do(6.0, again)
    driven.do(9.0, lambda: setattr(net.operators[1], "hand", DRIVING))
    driven.do(10.0, lambda: setattr(net.operators[1], "hand", done()))
    run = driven.rig.run()
    assert (run.status, run.fault_ids) == (0, ["NET-01"])
    assert not [seen for seen in run.seen if 4.8 < seen.time < 8.95 and seen.tick.set_points.speed]
    assert [seen for seen in run.seen if 9.2 < seen.time < 10.0 and seen.tick.set_points.speed > 0.1]


def test_replayed_commands_stop_the_robot_until_they_are_acknowledged(tmp_path: Path) -> None:
    driven = Driven(tmp_path, (6.0, "arm"), (7.0, "acknowledge"), (8.0, "arm"))
    driven.do(AT, lambda: setattr(driven.alice.to_robot, "replay", 20))
    driven.do(4.5, lambda: driven.net.operator("alice again"))
    driven.do(9.0, lambda: setattr(driven.net.operators[1], "hand", done()))
    run = driven.rig.run()
    assert_stops(run, "NET-06", AT, 0.1)
    assert run.status == 0
    assert run.in_mode(Mode.QUICKSTOP)[-1].time == pytest.approx(8.0, abs=0.3), "an arm before is refused"


def test_hand_over_between_operators_is_release_take_neutral(tmp_path: Path) -> None:
    driven = Driven(tmp_path)
    net = driven.net
    driven.do(4.0, driven.alice.leave)

    def bob(hand: OperatorInput) -> None:
        net.operators[-1].hand = hand

    def take() -> None:
        net.operator("bob")
        bob(DRIVING)

    driven.do(5.0, take)
    driven.do(6.0, lambda: bob(NEUTRAL)).do(6.2, lambda: bob(DRIVING)).do(7.0, lambda: bob(done()))
    run = driven.rig.run()
    assert (run.status, run.fault_ids) == (0, [])
    assert Mode.QUICKSTOP not in run.modes
    moves = [seen.time for seen in run.seen if seen.tick.set_points.speed > 0.05]
    assert not [time for time in moves if 4.5 < time < 6.2]
    assert [time for time in moves if 6.3 < time < 7.0]


def test_a_quick_stop_acts_at_once(tmp_path: Path) -> None:
    driven = Driven(tmp_path)
    run = driven.at(AT, driven.alice, replace(DRIVING, requests=(Request.QUICKSTOP,))).rig.run()
    stop = run.first(lambda seen: Request.QUICKSTOP in seen.tick.snapshot.sensed.requests)
    assert stop.mode is Mode.QUICKSTOP
    assert stop.time - AT <= 0.02 + 2 * TICK


def test_a_lower_input_over_the_network_that_is_lost_is_a_warning(tmp_path: Path) -> None:
    net = Net()
    alice = net.operator()
    step = {"teleop": {"inputs": ["pilot", "stick"], "until": {"seconds": 4.0}}}
    inputs = {"pilot": {"plugin": "scripted", "file": "pilot.csv"}, "stick": {"plugin": "network"}}
    files = {"pilot.csv": "time_s,x,y,enable\n0,0,0,0\n60,0,0,0\n"}
    mission = write_mission(tmp_path, [CALIBRATE, step], files, inputs=inputs)
    rig = Rig(mission, longest=30.0)
    linked = LinkedInput(net)
    rig.when(lambda seen: seen.mode is Mode.TELEOP, lambda: cut(alice), after=1.0)
    rig.plugins = _made_with(linked)
    run = rig.run()
    assert run.status == 0
    assert [(fault.id, fault.severity) for fault in run.faults if fault.id == "NET-01"] == [("NET-01", Severity.WARN)]
    assert Mode.QUICKSTOP not in run.modes


def _made_with(linked: LinkedInput) -> Callable[..., Any]:
    return lambda group, use, context: linked if use.plugin == "network" else plugin_made(group, use, context)


def test_the_operator_is_told_what_the_robot_does(tmp_path: Path) -> None:
    from artemis.bridges.operator.status import status_of

    driven = Driven(tmp_path)
    run = driven.at(5.0, driven.alice, done()).rig.run()
    told = [status_of(seen.tick, "stick") for seen in run.seen]
    assert {(status.mode, status.counts) for status in told if status.phase == "driving"} == {("teleop", True)}
    assert not any(status.counts for status in told if status.phase != "driving")
    assert max(status.speed for status in told) == pytest.approx(0.4, abs=0.02)
    assert FRESH < WORST
