"""How a row of the fault table is made to happen in a whole run, and what must follow whatever the row is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import pytest
from rig import BRAKING, CALIBRATE, DRIVES, TELEOP, TICK, TRACTION, Rig, Run, Seen, follow, straight, write_mission
from rig import stick as table
from watched import standing, target_velocity

from artemis.drive_states import DriveState
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Found
from artemis.values import Fault, Mode, Severity

SPEED, LIMITED = 0.4, 0.3
"""The robot drives so fast when it happens, and may while a row limits it [m/s]."""
DECELERATION, FRICTION = 1.0, 0.15
"""Of a controlled stop in the robot file, and of a simulated driven wheel without power [m/s²]."""
SETTLING = 0.15
"""A quick stop begins within 0.1 s, a wheel is at most 0.05 s behind its ramp [s]."""
WATCH = 0.201
"""The drives' watchdogs act so long after our last heartbeat at the latest [s]."""
TOLERANCE = 1e-6
READINGS = 10
"""Of each potentiometer in an alignment, instead of 100: two seconds less for each run."""
CORRIDOR = [[-3, -1.5], [9, -1.5], [9, 1.5], [-3, 1.5], [-3, -1.5]]
"""Walls around a robot with a scanner [m]."""
RPM = 60.0 / (72 * 2.1276596e-4)
"""Motor rpm per m/s of a driven wheel."""
_POWERED = (DriveState.OPERATION_ENABLE, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ENABLED)

_BY_MODES = (Found.MODE, Found.EDGE, Found.BRING_UP)

Effect = float | Callable[[Run, float], float]
"""From the injection until the machine, or what it sends, is truly as the row says [s]; of a run and the time of the
injection."""


class Setting(NamedTuple):
    """What the robot does when it happens."""

    steps: Sequence[Mapping[str, Any]]
    at: float
    """When it happens [s], between two ticks."""
    mode: Mode
    moves: bool = True
    stick: Sequence[tuple[float, float, float, int]] = ((0.0, 0.0, 0.0, 0),)
    """Time, x, y, enable button."""
    distance: float = 3.0
    """Length of the path [m]."""
    aligned: int = 0
    """So often the wheels were aligned again before."""


_FORWARD = ((0.0, 0.0, 0.0, 0), (2.4, 0.0, 1.0, 1), (4.6, 0.0, 0.0, 0), (5.2, 0.0, 0.0, 0))
_SWINGING = (
    (0.0, 0.0, 0.0, 0),
    *((2.4 + 0.8 * number, 0.6 * (-1) ** number, 0.6, 1) for number in range(4)),
    (6.0, 0.0, 0.0, 0),
    (6.8, 0.0, 0.0, 0),
)
MEASURE = {"calibrate": {"steering": {"reference_deg": {"left": 0.0, "right": 0.0}}}}
_ON = ((0.0, 0.0, 0.0, 0), (2.4, 0.0, 1.0, 1), (6.6, 0.0, 0.0, 0), (7.0, 0.0, 0.0, 0))
_NUDGED = ((0.0, 0.0, 0.0, 0), (2.4, 0.0, 1.0, 1), (3.5, 0.06, 1.0, 1), (5.0, 0.0, 0.0, 0), (5.6, 0.0, 0.0, 0))
SETTINGS = {
    "bring-up": Setting([{"wait": {"seconds": 0.4}}], 0.0, Mode.INIT, moves=False),
    "standing": Setting([{"wait": {"seconds": 1.2}}], 2.501, Mode.READY, moves=False),
    "calibrating": Setting([CALIBRATE], 2.801, Mode.CALIBRATE, moves=False),
    "measuring": Setting([MEASURE], 5.001, Mode.CALIBRATE, moves=False),
    "driving": Setting([TELEOP], 3.401, Mode.TELEOP, stick=_FORWARD),
    "driving on": Setting([TELEOP], 3.401, Mode.TELEOP, stick=_ON),
    "nudged": Setting([TELEOP], 3.401, Mode.TELEOP, stick=_NUDGED),
    "stopping": Setting([TELEOP], 3.401, Mode.QUICKSTOP, stick=_FORWARD),
    "swinging": Setting([TELEOP], 3.401, Mode.TELEOP, stick=_SWINGING),
    "following": Setting([CALIBRATE, follow(SPEED)], 4.901, Mode.FOLLOW, aligned=1),
    "held": Setting([CALIBRATE, follow(SPEED)], 4.901, Mode.QUICKSTOP, aligned=1),
    "following far": Setting([CALIBRATE, follow(SPEED)], 4.901, Mode.FOLLOW, aligned=1, distance=7.0),
    "following to the end": Setting([CALIBRATE, follow(SPEED)], 4.901, Mode.FOLLOW, aligned=1, distance=0.8),
}
"""When it happens is just after a tick has read and written: so the next one that can notice it is furthest away."""


class Later(NamedTuple):
    """How much longer the drives of a robot take than those of ARTEMIS [s]."""

    proving: float = 0.0
    """Until their watchdogs are proven."""
    ready: float = 0.0
    """Until they are brought up, the wheels aligned."""
    aligning: float = 0.0
    """To align the wheels again."""


NO_LATER = Later()


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """How a row is made to happen, and what is seen of it."""

    of: str = "driving"
    """The setting."""
    at: float | None = None
    """Run time [s]; None: as the setting says."""
    inject: str | None = None
    """None: the row's own injection."""
    node: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    along: Sequence[Mapping[str, Any]] = ()
    """Other faults that belong to it, as in a mission."""
    operator: Sequence[tuple[float, str]] = ()
    """Run time [s], and what is done."""
    effect: Effect = 0.0
    seen: Sequence[str] = ()
    """Rows, one of which must be noticed; empty: the row itself, or what it shows as where it has no mark."""
    device: str | None = None
    """Of the fault; None: the node, or nobody."""
    severity: Severity | None = None
    """None: the row's."""
    coasts: Sequence[str] = ()
    """Driven wheels that the fault itself leaves without power."""
    alone: bool = False
    """Our frames do not reach the drives: their watchdogs stop them."""
    longest: float = 20.0
    scanner: bool = False
    """The robot has a laser scanner, which the mission needs."""
    localizer: bool = False
    """A simulated tracker tells where the robot is."""
    robot: str | None = None
    """Its file; None: ARTEMIS'."""
    units: float = 1.0
    """Units of velocity of the drives of its driven wheels per rpm."""
    later: Later = NO_LATER


def scenes(of: Mapping[str, Scene | Sequence[Scene]]) -> list[tuple[str, Scene]]:
    """Each scene with its row."""
    return [(id, scene) for id, some in of.items() for scene in ([some] if isinstance(some, Scene) else some)]


def cases(of: Mapping[str, Scene | Sequence[Scene]]) -> pytest.MarkDecorator:
    """A test for each scene; `make test` plays the first one of each row and severity."""
    played: set[tuple[str, Severity]] = set()
    params = []
    for id, scene in scenes(of):
        case = (id, severity_of(id, scene))
        params.append(pytest.param(id, scene, marks=[pytest.mark.exhaustive] if case in played else []))
        played.add(case)
    return pytest.mark.parametrize(("id", "scene"), params, ids=name_of)


def name_of(part: object) -> str:
    """For the names of tests."""
    return (
        part
        if isinstance(part, str)
        else "-".join(filter(None, (part.of, part.node)))
        if isinstance(part, Scene)
        else ""
    )


# ---------------------------------------------------------------------------------------------- the run


@contextmanager
def short_alignment() -> Iterator[None]:
    """Runs in which the potentiometers are read less often."""
    with patch("artemis.states.alignment.READINGS", READINGS):
        yield


def play(
    folder: Path, id: str, scene: Scene, *, happens: bool = True, prepare: Callable[[Rig], object] = lambda rig: None
) -> Run:
    """The run of a scene; without `happens` the same run without any fault."""
    setting = SETTINGS[scene.of]
    fault = {
        "at_s": time_of(scene),
        "inject": scene.inject or id,
        **scene.options,
        **({"node": scene.node} if scene.node else {}),
    }
    inputs = {"stick": {"plugin": "scripted", "file": "stick.csv", "max_speed_m_s": SPEED}}
    along = [{**entry, "at_s": entry["at_s"] + shift_of(scene)} for entry in scene.along]
    faults = sorted([fault, *along], key=lambda entry: entry["at_s"]) if happens else []
    simulation: dict[str, Any] = {"faults": faults}
    if scene.operator:
        simulation["operator"] = [{"at_s": time + shift_of(scene), "do": what} for time, what in scene.operator]
    rows = [(time + shift_of(scene) if time else 0.0, x, y, button) for time, x, y, button in setting.stick]
    files = {"stick.csv": table(*rows), "line.csv": straight(setting.distance)}
    keys: dict[str, Any] = {"inputs": inputs, "simulation": simulation}
    if scene.robot is not None:
        keys |= {"robot": scene.robot}
    if scene.scanner:
        keys |= {"robot": "artemis_lms100.yaml"}
        simulation["world"] = {"walls": [{"points": CORRIDOR}]}
    if scene.localizer:
        simulation["localizer"] = {"plugin": "simulated_tracker", "rate_hz": 10, "delay_s": 0.05}
    mission = write_mission(folder, setting.steps, files, **keys)
    rig = Rig(mission, longest=scene.longest + shift_of(scene))
    prepare(rig)
    with short_alignment():
        return rig.run()


def time_of(scene: Scene) -> float:
    """When it happens [s]."""
    return (SETTINGS[scene.of].at if scene.at is None else scene.at) + shift_of(scene)


def shift_of(scene: Scene) -> float:
    """How much later than on ARTEMIS it happens [s]."""
    later = scene.later
    if scene.of == "bring-up":
        return 0.0 if scene.at is None else later.proving
    return later.ready + SETTINGS[scene.of].aligned * later.aligning


# ---------------------------------------------------------------------------------------------- what must follow


class Notice(NamedTuple):
    """The tick in which a fault is first in the verdict with its severity."""

    seen: Seen
    fault: Fault | None
    before: Mode
    """The mode of the tick before."""


def notice(run: Run, ids: Sequence[str], severity: Severity, since: float) -> Notice | None:
    """The first notice of one of the rows `ids`, at least so severe, at or after the run time `since` [s]."""
    before = Mode.INIT
    for seen in run.seen:
        for fault in seen.tick.snapshot.verdict.faults:
            if seen.time >= since - TOLERANCE and fault.id in ids and fault.severity >= severity:
                return Notice(seen, fault, before)
        before = seen.mode
    return None


def assert_noticed(run: Run, id: str, scene: Scene) -> Notice:
    """In time, by the right name, of the right device."""
    row, at = ROWS[id], time_of(scene)
    assert_is_as_set(run, scene)
    ids = scene.seen or (row.shows_as if row.found is Found.ELSEWHERE else (id,))
    known = row.found is Found.ABSENT or set(ids) <= {id, *row.shows_as}
    assert known, "a row as which this one may be seen is missing in its `shows_as`"
    found = notice(run, ids, severity_of(id, scene), at)
    assert found is not None, f"not noticed; seen: {run.fault_ids}"
    assert found.fault is not None
    as_row = ROWS[found.fault.id]
    effect = scene.effect if isinstance(scene.effect, float) else scene.effect(run, at)
    within = as_row.within if row.found is Found.ABSENT else row.within
    later = 2 * TICK if as_row.found in _BY_MODES else 0.0  # a mode's fault is judged in the next tick
    latest = at + effect + within + later
    assert found.seen.time <= latest + TOLERANCE, f"noticed {found.seen.time - latest:.3f} s late; {found.fault.text}"
    assert found.fault.device == (scene.device if scene.device is not None else scene.node or "")
    return found


def severity_of(id: str, scene: Scene) -> Severity:
    """The least severity with which the scene must be noticed."""
    return ROWS[id].severity if scene.severity is None else scene.severity


def assert_is_as_set(run: Run, scene: Scene) -> None:
    """When it happens the robot does what the scene says."""
    setting, at = SETTINGS[scene.of], time_of(scene)
    if scene.at is None:
        before = [seen for seen in run.seen if seen.time < at]
        assert not before or before[-1].mode is setting.mode
        if setting.moves and before:
            assert run.truth_at(at).speed > 0.1


def assert_follows(run: Run, scene: Scene, found: Notice) -> None:
    """The reaction: mode, targets on the wire, and what the machine truly does."""
    verdict = found.seen.tick.snapshot.verdict
    severity = verdict.severity  # of the worst
    if severity < Severity.CONTROLLED_STOP:
        assert found.seen.mode is found.before, "a warning changes no mode"
        if severity is Severity.LIMIT:
            assert_slow(run, found)
        return
    if found.before not in (Mode.FAULT, Mode.END):
        assert found.seen.mode is (Mode.FAULT if verdict.to_fault else Mode.QUICKSTOP)
    if severity is Severity.CONTROLLED_STOP:
        assert_ramps_down(run, scene, found)
    else:
        assert_quick_stop(run, scene, found)
    assert run.status == 1 or verdict.recovers, "nobody is there: the run ends as failed"
    assert standing(run.world.truth)


def targets(run: Run, scene: Scene, found: Notice) -> list[tuple[float, float]]:
    """What is asked of driven wheels from that tick on: time, speed without sign [m/s]."""
    ticks = run.seen[run.seen.index(found.seen) :]
    return [(seen.now, target / scene.units) for seen in ticks for target in ramp(seen)]


def ramp(seen: Seen) -> list[float]:
    """What is asked of driven wheels in one tick, without sign [m/s, of drives that count rpm]."""
    asked = [target_velocity(frame) for frame in seen.sent]
    return [abs(target) / RPM for target in asked if target is not None]


def assert_quick_stop(run: Run, scene: Scene, found: Notice) -> None:
    """No target any more; wheels with power stop by the drives' ramp, those without by friction; then they stay."""
    now = found.seen.now
    assert not [target for _, target in targets(run, scene, found) if target]
    if scene.alone:
        now = time_of(scene) + WATCH
    truths = run.truth_from(now)
    for place, name in enumerate(TRACTION):
        speed = abs(truths[0].wheel_speeds[place])
        stop = speed / (FRICTION if name in scene.coasts else BRAKING) + SETTLING
        late = [truth for truth in truths if truth.time > now + stop and abs(truth.wheel_speeds[place]) > 2e-4]
        assert not late, f"{name} still turns {late[-1].time - now:.2f} s later, {stop:.2f} s are enough"
        if name not in scene.coasts:
            moving = {t.states[DRIVES.index(name)] for t in truths if abs(t.wheel_speeds[place]) > 0.05}
            assert moving <= set(_POWERED), f"{name} coasts"


def assert_ramps_down(run: Run, scene: Scene, found: Notice) -> None:
    """Targets fall by the gate's ramp and never rise; drives stay on until the robot stands; then it stays."""
    now = found.seen.now
    asked = targets(run, scene, found)
    speed = max((target for _, target in asked[:2]), default=0.0)
    end = now + speed / DECELERATION + SETTLING
    assert max((target for _, target in asked), default=0.0) <= speed + TOLERANCE
    assert not [target for time, target in asked if time > end and target]
    assert all(standing(truth) for truth in run.truth_from(end))
    for truth in run.truth_from(now):
        if not standing(truth):
            assert truth.states == (DriveState.OPERATION_ENABLE,) * 4


def assert_slow(run: Run, found: Notice) -> None:
    """Not faster than the limit once the gate's ramp is over."""
    since = found.seen.now + (SPEED - LIMITED) / DECELERATION + TICK
    limited = [
        seen.tick.set_points.speed for seen in run.seen if seen.tick.snapshot.verdict.limits and seen.now > since
    ]
    assert limited
    assert max(map(abs, limited)) <= LIMITED + TOLERANCE


# ---------------------------------------------------------------------------------------------- the true machine


def when(condition: Callable[[Any], bool]) -> Effect:
    """The effect is there when the true machine first fulfils this."""

    def effect(run: Run, at: float) -> float:
        return next(truth.time for truth in run.truth_from(at) if condition(truth)) - at

    return effect


def once(condition: Callable[[Seen], bool], later: float = 0.0) -> Effect:
    """The effect is there `later` [s] than the first tick that fulfils this."""

    def effect(run: Run, at: float) -> float:
        return next(seen.time for seen in run.seen if seen.time >= at and condition(seen)) + later - at

    return effect


def in_phase(phase: str, later: float = 0.0) -> Effect:
    """The effect is there `later` [s] than the run has come to a phase."""
    return once(lambda seen: seen.phase == phase, later)
