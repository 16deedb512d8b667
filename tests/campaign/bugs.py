"""Bugs that the monitor has to see: each a patch of the running system, planted alone."""

# ruff: noqa: ANN401  (what is replaced may be anything)

from __future__ import annotations

import dataclasses
import itertools
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

from msgspec.structs import replace

from artemis.devices.can_bus import Frame
from artemis.devices.canopen import heartbeat_frame
from artemis.devices.epos_state import Controlword
from artemis.drive_states import Goal, Nmt
from artemis.states import homing
from artemis.states.alignment import enable
from artemis.states.init import ANSWER_TIME, RESETTING, WAKING, until
from artemis.states.mode import ON
from artemis.supervision import catalogue
from artemis.values import Action, Event, Fault, Mode, Request

Change = Callable[[Any], Any]
"""Given what is there, what stands in its place."""


@dataclass(frozen=True)
class Bug:
    """A patch of the running system."""

    name: str
    scenario: str
    broken: str
    """An invariant that breaks."""
    patches: Mapping[str, Change]
    """By the full name of what is replaced."""
    replayed: bool = False
    """Shows in a replay only."""


@contextmanager
def planted(bug: Bug) -> Iterator[None]:
    """The system with the bug."""
    with ExitStack() as stack:
        for target, change in bug.patches.items():
            stack.enter_context(patch(target, change(resolve_name(target))))
        yield


# ---------------------------------------------------------------------------------------------- how things are changed


def becomes(value: Any) -> Change:
    """Whatever was there."""
    return lambda original: value


def having(**attributes: Any) -> Change:
    """A constructor after which some attributes are others."""

    def change(original: Any) -> Any:
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            original(self, *args, **kwargs)
            for name, value in attributes.items():
                setattr(self, name, value)

        return init

    return change


def with_result(alter: Callable[..., Any]) -> Change:
    """A function whose result is altered; `alter` is given the result and the arguments."""
    return lambda original: lambda *args, **kwargs: alter(original(*args, **kwargs), *args)


def without_rows(*ids: str) -> Change:
    """A measure that never gives a reading of these rows."""
    return with_result(lambda readings, *_: [reading for reading in readings if reading[0] not in ids])


def unless(condition: Callable[..., bool], instead: Any) -> Change:
    """A function that is not called where the condition on its arguments holds."""

    def change(original: Any) -> Any:
        return lambda *args: instead if condition(*args) else original(*args)

    return change


OPEN = {"artemis.devices.allow_list.AllowList.problem": becomes(lambda self, frame: None)}
"""Nothing stands behind the gate."""
GATE, GATE_LIMITS = "artemis.motion.limits.Gate.limit", "artemis.motion.limits.Gate.__init__"
CEILING = "artemis.states.plan.Shared.top_speed"
SUPERVISOR = "artemis.supervision.supervisor.Supervisor"
DRIVES, HOST = "artemis.supervision.measures.DriveMeasures.read", "artemis.supervision.measures.HostMeasures.read"
WHEELS = "artemis.supervision.wheels.Wheels.read"
WRITE = "artemis.devices.drive.Drives.write"
PROOF = "artemis.states.init.InitMode._prove_watchdog"


async def _nothing(*_: Any) -> tuple[int, ...]:
    return ()


def _unproven(self: Any, snapshot: Any, *_: Any) -> Any:
    snapshot = yield from until(lambda drive: drive.age is not None, WAKING, ANSWER_TIME, "COM-08", "", snapshot)
    return (yield from until(lambda drive: True, RESETTING, ANSWER_TIME, "COM-08", "", snapshot))


def _quick_stop_ignored(original: Any) -> Any:
    def limit(self: Any, command: Any, last: Any, *args: Any) -> Any:
        return last if command.action is not Action.RUN else original(self, command, last, *args)

    return limit


def _not_braking(original: Any) -> Any:
    def controlword(state: Any, goal: Goal, last: int = 0) -> Any:
        return original(state, Goal.ENABLED if goal is Goal.QUICK_STOPPED else goal, last)

    return controlword


def _other_set_points(change: Callable[[Any], Any]) -> Change:
    """The drives get other set-points than the gate let through: `change` of them."""

    def changed(original: Any) -> Any:
        def write(self: Any, tick: Any) -> None:
            original(self, replace(tick, set_points=change(tick.set_points)))

        return write

    return changed


_ONE_SPEED = _other_set_points(lambda points: replace(points, speed_left=points.speed, speed_right=points.speed))
"""Both driven wheels get the speed of the virtual wheel."""
_SWAPPED_SPEEDS = _other_set_points(
    lambda points: replace(points, speed_left=points.speed_right, speed_right=points.speed_left)
)
_SWAPPED_ANGLES = _other_set_points(
    lambda points: replace(points, steering_left=points.steering_right, steering_right=points.steering_left)
)
_STEERED_WRONG = _other_set_points(lambda points: replace(points, steering_left=-points.steering_left))
"""The left wheel's angles have the wrong sign."""


def _only_left_stops(original: Any) -> Any:
    """The right driven wheel never gets a quick stop: it is sent what it was sent last."""

    def send(self: Any, frame: Frame) -> None:
        if frame.id in (0x202, 0x302) and frame.data[0] == Controlword.QUICK_STOP:
            frame = getattr(self, "last_right", frame)
        elif frame.id == 0x202:
            self.last_right = frame
        original(self, frame)

    return send


def _beating(original: Any) -> Any:
    """A timer sends heartbeats, whatever becomes of the ticks."""

    async def run(self: Any) -> None:
        import asyncio

        loop, beat = asyncio.get_running_loop(), heartbeat_frame(127, Nmt.OPERATIONAL)
        wire = self._devices.wire

        def again() -> None:
            wire._bus.send(beat)
            loop.call_later(0.009, again)

        loop.call_later(6.0, again)
        await original(self)

    return run


def _resumed_at(**changes: Any) -> Change:
    """A resumed run begins at another position."""
    return with_result(
        lambda found, *_: (dataclasses.replace(found[0], position=replace(found[0].position, **changes)), found[1])
    )


def _passed_over(original: Any) -> Any:
    """Mode act drives on as it was told last."""
    last: list[Any] = []

    def ask(*args: Any, **keys: Any) -> Any:
        answer = original(*args, **keys)
        last[:] = last if isinstance(answer, Fault) and last else [answer]
        return last[0]

    return ask


def _steering_let_go(original: Any) -> Any:
    def controlword(state: Any, goal: Goal, last: int = 0) -> Any:
        return original(state, Goal.DISABLED if goal is Goal.HOLD else goal, last)

    return controlword


def _ready_creeps(original: Any) -> Any:
    def step(self: Any, snapshot: Any) -> Any:
        wish = original(self, snapshot)
        return replace(wish, command=replace(wish.command, speed=0.1))

    return step


def _seeing_neutral(original: Any) -> Any:
    """A mode to which every control seems released."""

    def step(self: Any, snapshot: Any) -> Any:
        inputs = tuple(replace(sample, neutral=True) for sample in snapshot.sensed.inputs)
        return original(self, replace(snapshot, sensed=replace(snapshot.sensed, inputs=inputs)))

    return step


def _holding_the_button(original: Any) -> Any:
    def step(self: Any, snapshot: Any) -> Any:
        inputs = tuple(replace(sample, enabled=True) for sample in snapshot.sensed.inputs)
        return original(self, replace(snapshot, sensed=replace(snapshot.sensed, inputs=inputs)))

    return step


def _armed_again(original: Any) -> Any:
    """Whatever led to a bring-up arms."""

    def enter(self: Any, snapshot: Any) -> None:
        self.bring_up.armed = True
        original(self, snapshot)

    return enter


def _acknowledgment_arms(original: Any) -> Any:
    def may_continue(self: Any, snapshot: Any) -> bool:
        return Request.ACKNOWLEDGE in snapshot.sensed.requests or bool(original(self, snapshot))

    return may_continue


def _misnamed(found: Fault, device: str, code: int, _: object) -> Fault:
    return catalogue.fault("DRV-01", device) if code == 0xFF06 else found


def _not_aligned(shared: Any, snapshot: Any) -> Any:
    return (yield from enable(shared, ON, snapshot))


def _first_hold_counts(shared: Any, source: Any, snapshot: Any) -> Any:
    """Whatever holds the motor is its stop."""
    (name,) = shared.plan.drives("steering")
    towards = math.copysign(1.0, source.stop_deg)
    _, snapshot = yield from homing._search(shared, towards, homing._Held(name, towards), "looking", snapshot)
    return (yield from homing._take_held(shared, name, math.radians(source.stop_deg), snapshot))


HELD_ONCE = Bug("any hold is a stop", "", "I5", {"artemis.states.homing._from_stop": becomes(_first_hold_counts)})
"""Of a robot that looks for its stop: of none of the scenarios."""


def _no_way_to_fault(original: Any) -> Any:
    """A verdict changes no mode."""

    def advance(self: Any, snapshot: Any, wished: Any) -> Any:
        calm = replace(snapshot.verdict, to_fault=False, severity=type(snapshot.verdict.severity).NONE)
        return original(self, replace(snapshot, verdict=calm), wished)

    return advance


def _journal_without(kind: str, word: str) -> Change:
    return unless(lambda self, entry: entry.kind == kind and word in entry.text, None)


def _skipping_numbers(original: Any) -> Any:
    def write(self: Any, entry: Any) -> None:
        original(self, entry)
        self._sequence += entry.kind == "mode"

    return write


def _with_memory(original: Any) -> Any:
    """A gate that knows more than it is told."""
    calls = itertools.count()

    def limit(self: Any, *args: Any) -> Any:
        points = original(self, *args)
        return replace(points, steering=points.steering + 1e-12 * next(calls))

    return limit


def _without_stop(original: Any) -> Any:
    """A gate that steers towards what is wished, whether it is to hold the wheels or not."""

    def limit(self: Any, command: Any, last: Any, dt: float, ceiling: float, _stop: bool) -> Any:
        return original(self, command, last, dt, ceiling, False)

    return limit


def _fails_later(original: Any) -> Any:
    calls = itertools.count()

    def step(self: Any, snapshot: Any) -> Any:
        if next(calls) == 80:
            raise ZeroDivisionError("planted")
        return original(self, snapshot)

    return step


def _leaving_a_thread(original: Any) -> Any:
    def init(self: Any, *args: Any, **kwargs: Any) -> None:
        original(self, *args, **kwargs)
        threading.Thread(target=threading.Event().wait, args=(60.0,), daemon=True).start()

    return init


def _settings_without(index: int) -> Change:
    return with_result(lambda settings, *_: (setting for setting in settings if setting.object.index != index))


def _unchecked(original: Any) -> Any:
    async def write(self: Any, setting: Any) -> None:
        await self.write(setting.object, setting.value)

    return write


STOP = "artemis.motion.obstacles"
VIEW = "artemis.motion.view.View"


def _forgets(self: Any, *_: Any) -> None:
    self._kept = self._kept[:, :0]


def _always_new(original: Any) -> Any:
    return lambda self, now: 0.0 if original(self, now) < math.inf else math.inf


def _left_where_they_were(original: Any) -> Any:
    def take(self: Any, scan: Any, now: float, speed: float, turn: float, *, creeping: bool) -> None:
        original(self, scan, now, 0.0, 0.0, creeping=creeping)

    return take


# ---------------------------------------------------------------------------------------------- the bugs

BUGS: tuple[Bug, ...] = (
    Bug(
        "speed is not limited",
        "follower asks for too much",
        "I9",
        {GATE_LIMITS: having(_speed=9.0, _wheel_speed=9.0), CEILING: becomes(property(lambda self: 9.0)), **OPEN},
    ),
    Bug("acceleration is not limited", "by hand", "I9", {GATE_LIMITS: having(_acceleration=5.0)}),
    Bug("deceleration is not limited", "by hand", "I9", {GATE_LIMITS: having(_deceleration=9.0)}),
    Bug("controlled stop hardly brakes", "follower raises", "I4", {GATE_LIMITS: having(_deceleration=0.15)}),
    Bug("released button hardly brakes", "by hand", "I2", {GATE_LIMITS: having(_deceleration=0.15)}),
    Bug("steering rate is not limited", "follower steers too far", "I3", {GATE_LIMITS: having(_rate=5.0)}),
    Bug(
        "set-points that were held up count as old",
        "input takes long",
        "I9",
        {"artemis.motion.pace.ORDINARY": becomes(9.0)},
    ),
    Bug("steering angle is not limited", "follower steers too far", "I9", {GATE_LIMITS: having(_steering=1.4)}),
    Bug("driven wheels are swapped", "bend", "I3", {WRITE: _SWAPPED_SPEEDS}),
    Bug("steered wheels are swapped", "bend", "I3", {WRITE: _SWAPPED_ANGLES}),
    Bug("a wheel is steered to the other side", "bend", "I3", {WRITE: _STEERED_WRONG}),
    Bug(
        "quick stop keeps the speed",
        "stopped by a person",
        "I1",
        {GATE: _quick_stop_ignored, "artemis.devices.drive.controlword": _not_braking, **OPEN},
    ),
    Bug("inner and outer wheel get one speed", "slight bend", "I9", {WRITE: _ONE_SPEED}),
    Bug(
        "only the left wheel is stopped",
        "silent drive",
        "I8",
        {"artemis.devices.bus_gateway.BusGateway.send": _only_left_stops, **OPEN},
    ),
    Bug("heartbeats come from a timer", "by hand", "I7", {"artemis.robot.Robot.run": _beating}),
    Bug("steering is let go in motion", "silent drive", "I8", {"artemis.devices.drive.controlword": _steering_let_go}),
    Bug(
        "target is not cleared before enabling",
        "by hand",
        "I1",
        {
            "artemis.motion.perception.Perception.as_they_stand": with_result(
                lambda points, _, sensed, *__: (
                    replace(points, speed_left=0.2, speed_right=0.2) if sensed.time < 4.0 else points
                )
            ),
            **OPEN,
        },
    ),
    Bug(
        "ready creeps", "stick held at the start", "I1", {"artemis.states.ready.ReadyMode.step": _ready_creeps, **OPEN}
    ),
    Bug("watchdog is not proven", "by hand", "I5", {PROOF: becomes(_unproven)}),
    Bug(
        "nobody asks who the drives are",
        "by hand",
        "I5",
        {"artemis.devices.epos_jobs.EposJobs._check_identity": becomes(_nothing)},
    ),
    Bug(
        "drives are not told to watch",
        "killed",
        "I5",
        {PROOF: becomes(_unproven), "artemis.devices.epos_jobs.settings": _settings_without(0x1016)},
    ),
    Bug("wheels are not aligned", "askew", "I5", {"artemis.states.homing.align": becomes(_not_aligned)}),
    Bug(
        "controls may be held",
        "stick held at the start",
        "I5",
        {"artemis.states.ready.ReadyMode.step": _seeing_neutral},
    ),
    Bug(
        "enable button does not matter", "by hand", "I2", {"artemis.states.teleop.TeleopMode.step": _holding_the_button}
    ),
    Bug(
        "frozen stick is not noticed",
        "frozen stick",
        "I2",
        {"artemis.planning.stale_limit": with_result(lambda *_: math.inf)},
    ),
    Bug(
        "acknowledging a fault arms",
        "over-current, acknowledged only",
        "I6",
        {"artemis.states.init.InitMode.enter": _armed_again},
    ),
    Bug(
        "acknowledging a stop arms",
        "stopped, acknowledged only",
        "I6",
        {"artemis.states.quickstop.QuickstopMode._may_continue": _acknowledgment_arms},
    ),
    Bug(
        "fault leads to ready",
        "over-current, acknowledged only",
        "I11",
        {
            "artemis.states.machine.TRANSITIONS": lambda table: {**table, (Mode.FAULT, Event.ACKNOWLEDGED): Mode.READY},
        },
    ),
    Bug("verdict is not obeyed", "runaway", "I4", {"artemis.states.modes.Modes.advance": _no_way_to_fault}),
    Bug("lost feedback is not noticed", "silent drive", "I3", {DRIVES: without_rows("COM-11")}),
    Bug("lost heartbeat is not noticed", "no heartbeat", "I3", {DRIVES: without_rows("COM-28")}),
    Bug("restart is not noticed", "restarted", "I3", {DRIVES: without_rows("COM-26")}),
    Bug("left NMT state is not noticed", "pre-operational", "I3", {DRIVES: without_rows("COM-27", "COM-11")}),
    Bug(
        "drive that is off is not noticed",
        "off by itself",
        "I3",
        {DRIVES: without_rows("COM-02"), WHEELS: without_rows("RUN-06")},
    ),
    Bug("silent bus is not noticed", "silent bus", "I3", {DRIVES: without_rows("COM-29")}),
    Bug("second master is not noticed", "second master", "I3", {HOST: without_rows("COM-17")}),
    Bug("runaway is not noticed", "runaway", "I3", {WHEELS: without_rows("RUN-01")}),
    Bug("creeping is not noticed", "last set-points lost", "I1", {WHEELS: without_rows("RUN-02")}),
    Bug("slip is not noticed", "slipping", "I3", {WHEELS: without_rows("RUN-01", "RUN-05")}),
    Bug("potentiometers are not compared", "potentiometer off", "I3", {WHEELS: without_rows("STE-03")}),
    Bug("open potentiometer is not noticed", "potentiometer open", "I3", {WHEELS: without_rows("STE-04")}),
    Bug(
        "emergencies are not heard", "limit switch", "I3", {f"{SUPERVISOR}._emergencies": becomes(lambda *_: iter(()))}
    ),
    Bug(
        "unknown error is ignored",
        "unknown error",
        "I3",
        {f"{SUPERVISOR}._emergencies": with_result(lambda found, *_: (f for f in found if f.id != "DRV-31"))},
    ),
    Bug(
        "error has another's name",
        "limit switch",
        "I3",
        {"artemis.supervision.catalogue.emergency": with_result(_misnamed)},
    ),
    Bug(
        "feedback may be old",
        "silent drive",
        "I3",
        {"artemis.supervision.measures.stale_age": becomes(lambda tick: 0.4)},
    ),
    Bug(
        "lost adapter is not noticed",
        "unplugged",
        "I3",
        {"artemis.devices.bus_gateway.BusGateway.lose": becomes(lambda self, error: None)},
    ),
    Bug("silent wheels are steered", "without power in a bend, acknowledged", "I3", {GATE: _without_stop}),
    Bug("late ticks are not noticed", "computer dozes", "I3", {HOST: without_rows("SYS-01", "SYS-03", "COM-31")}),
    Bug(
        "another product is accepted",
        "another product",
        "I3",
        {"artemis.devices.epos_jobs.EposJobs._check_identity": becomes(_nothing)},
    ),
    Bug(
        "unkept write is accepted",
        "write not kept",
        "I3",
        {"artemis.devices.epos_jobs.EposJobs._write_checked": _unchecked},
    ),
    Bug("unwatching drive is accepted", "does not watch", "I3", {PROOF: becomes(_unproven)}),
    Bug(
        "drives that are not ours yet are not looked at",
        "driven by somebody else before the bring-up",
        "I8",
        {"artemis.states.alignment.Lookout.watch": becomes(lambda self, shared, wish, snapshot: wish)},
    ),
    Bug(
        "faults are forgotten without a person",
        "over-current, not acknowledged",
        "I10",
        {f"{SUPERVISOR}._has_budget": becomes(lambda *_: True)},
    ),
    Bug(
        "recoveries have no budget",
        "stick frozen again and again",
        "I10",
        {f"{SUPERVISOR}._has_budget": becomes(lambda self, id, device, now: id == "INP-03")},
    ),
    Bug(
        "final fault is forgotten",
        "sensor supply, acknowledged",
        "I10",
        {f"{SUPERVISOR}._is_final": becomes(lambda *_: False)},
    ),
    Bug(
        "journal loses a change of mode",
        "runaway",
        "I11",
        {"artemis.recording.journal.Journal.write": _journal_without("mode", "-> fault")},
    ),
    Bug("journal skips numbers", "by hand", "I11", {"artemis.recording.journal.Journal.write": _skipping_numbers}),
    Bug(
        "journal has wrong checksums", "by hand", "I11", {"artemis.recording.journal.crc32": becomes(lambda content: 1)}
    ),
    Bug("replay would differ", "by hand", "I11", {GATE: _with_memory}, replayed=True),
    Bug(
        "outcomes are not caught",
        "words",
        "I0",
        {"artemis.states.tree.Try.names": becomes(lambda self, outcome: (outcome,))},
    ),
    Bug(
        "words begin anew in the resumed run",
        "words, resumed in the second round",
        "I13",
        {"artemis.app.where_it_stopped": _resumed_at(place="")},
    ),
    Bug(
        "resumed run does not know how far the mission came",
        "words, resumed after the break",
        "I13",
        {"artemis.app.where_it_stopped": _resumed_at(driven=0.0)},
    ),
    Bug("a behaviour that fails is passed over", "behaviour raises", "I3", {"artemis.states.act.ask": _passed_over}),
    Bug("a behaviour accelerates without limit", "behaviour", "I9", {GATE_LIMITS: having(_acceleration=5.0)}),
    Bug("a failed behaviour hardly brakes", "behaviour raises", "I4", {GATE_LIMITS: having(_deceleration=0.15)}),
    Bug("obstacles set no ceiling", "post in the way", "I14", {f"{STOP}.ObstacleStop.look": becomes(lambda *_: None)}),
    Bug("what is too near to be seen is forgotten", "post in the way", "I14", {f"{VIEW}._remember": becomes(_forgets)}),
    Bug(
        "stop for an obstacle begins too late",
        "wall in the way",
        "I14",
        {f"{STOP}.stopping_speed": lambda original: lambda distance, *rest: original(distance + 0.4, *rest)},
    ),
    Bug(
        "outline is thought to be narrower than it is",
        "post beside the path",
        "I14",
        {f"{STOP}.Rectangle": lambda original: lambda rear, front, half: original(rear, front, 0.2 * half)},
    ),
    Bug(
        "all ground behind is known",
        "box behind",
        "I14",
        {f"{STOP}.Ground.known": becomes(lambda _self, curvatures, *_, **__: [math.inf] * len(curvatures))},
    ),
    Bug("age of the newest scan is ignored", "wall in the way, late scans", "I14", {f"{VIEW}.age": _always_new}),
    Bug("points are not carried on", "wall in the way, late scans", "I14", {f"{VIEW}.take": _left_where_they_were}),
    Bug(
        "what is far seems to be near",
        "nothing in the way",
        "I14",
        {f"{VIEW}.around": with_result(lambda points, *_: [0.18 * each for each in points])},
    ),
    Bug(
        "creeps on where it should stand",
        "post in the way",
        "I14",
        {
            f"{STOP}.ObstacleStop._judged": lambda original: (
                lambda self, found, now, rules: original(self, found, now, replace(rules, mode="slow"))
            )
        },
    ),
    Bug(
        "lost scanner is not noticed",
        "scanner silent",
        "I3",
        {"artemis.supervision.scanners.ScannerMeasures.read": without_rows("LAS-01")},
    ),
    Bug(
        "frozen scanner is not noticed",
        "scanner frozen",
        "I3",
        {"artemis.supervision.scanners.ScannerMeasures.read": without_rows("LAS-02")},
    ),
    Bug(
        "covered scanner is not noticed",
        "scanner covered",
        "I3",
        {"artemis.supervision.scanners.ScannerMeasures.read": without_rows("LAS-06")},
    ),
    Bug("program fails", "by hand", "I0", {"artemis.states.teleop.TeleopMode.step": _fails_later}),
    Bug("runs leave threads behind", "by hand", "I12", {"artemis.sim.world.World.__init__": _leaving_a_thread}),
)
