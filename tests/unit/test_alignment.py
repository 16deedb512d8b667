"""Wheels that are aligned from their potentiometers: each job, each turn, and what is refused."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from itertools import groupby, pairwise
from math import degrees, radians
from pathlib import Path
from typing import Any

import pytest
from core_builders import (
    NAMES,
    ROBOT,
    STEERING,
    TRACTION,
    ObedientDrives,
    drive,
    drives,
    judged,
    shared,
    snapshot,
    volts,
)
from msgspec.structs import replace
from routine_rig import OVER, RoutinePlayer, calm

from artemis.drive_states import DriveState, Goal
from artemis.mission.loading import load_model
from artemis.states.alignment import (
    READINGS,
    REST,
    STEP_TICKS,
    STRAIGHT,
    Lookout,
    _seek_edges,
    align,
    do,
    enable,
    steer,
    switch_off,
)
from artemis.states.mode import OFF, ON, STEERING_ON, Failed, Routine
from artemis.states.plan import Plan, Shared
from artemis.values import DriveFeedback, Fault, Job, JobKind, JobResult, SetPoints, Snapshot, Wish
from artemis.vehicle import RobotFile

LEFT, RIGHT = STEERING
SIDES = ("left", "right")
EPOS4 = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_epos4.yaml", RobotFile)
CIA402 = load_model(Path(__file__).parents[2] / "missions" / "robots" / "artemis_cia402.yaml", RobotFile)
REFERENCE, CLEAR, HALT = JobKind.REFERENCE, JobKind.CLEAR_TARGET, JobKind.HALT
AT_REST = {LEFT: radians(7.0), RIGHT: radians(-4.0)}
"""Where `ObedientDrives` find the wheels."""


class Wheels(ObedientDrives):
    """Encoders count what they are told at a reference; potentiometers misread by so much while the drives are off."""

    def __init__(self, step: float = 0.0, **misread_deg: float) -> None:
        super().__init__()
        self.misread = {name: radians(misread_deg.get(ROBOT.drives[name].side, 0.0)) for name in STEERING}
        self.counted = dict.fromkeys(STEERING, 0.0)
        """Of the encoders less the true angle."""
        self.step = step
        """Of the analog inputs [V]; 0: none."""
        self.extra = dict.fromkeys(STEERING, 0.0)
        """By which the potentiometers misread at the next tick [V]."""

    def react(self, wish: Wish, points: SetPoints) -> tuple[DriveFeedback, ...]:
        told = replace(
            points,
            steering_left=points.steering_left - self.counted[LEFT],
            steering_right=points.steering_right - self.counted[RIGHT],
        )
        return tuple(self._seen(feedback) for feedback in super().react(wish, told))

    def _seen(self, feedback: DriveFeedback) -> DriveFeedback:
        name = feedback.name
        if name not in STEERING:
            return feedback
        off = 0.0 if feedback.state is DriveState.OPERATION_ENABLE else self.misread[name]
        shown = tuple(v + self.extra[name] for v in volts(ROBOT.drives[name].side, self.angles[name] + off))
        exact = tuple(round(v / self.step) * self.step for v in shown) if self.step else shown
        position = self.angles[name] + self.counted[name]
        changes: dict[str, Any] = {"position": position, "potentiometers": exact, **self.changes[name]}
        return replace(feedback, **changes)

    def learn(self, job: Job) -> None:
        if job.kind is REFERENCE:
            self.counted[job.drive] = job.value - self.angles[job.drive]


class AlignPlayer(RoutinePlayer):
    def __init__(self, wheels: Wheels | None = None, **plan: Any) -> None:
        made = Shared(Plan(**{"robot": ROBOT, "steps": (), **plan}))
        self.wheels = wheels or Wheels()
        super().__init__(made, align, self.wheels)

    def _perform(self, job: Job) -> JobResult:
        self.wheels.learn(job)
        return super()._perform(job)

    def references(self) -> list[tuple[str, float]]:
        return [(job.drive, round(degrees(job.value), 3)) for job in self.jobs if job.kind is REFERENCE]


def refused(player: RoutinePlayer) -> Fault:
    fault = player.play()
    assert fault is not None
    return fault


# ---------------------------------------------------------------------------------------------- the whole alignment


def test_wheels_are_read_told_swept_told_again_and_enabled() -> None:
    player = AlignPlayer()

    assert player.play() is None

    assert [phase for phase, _ in groupby(wish.phase for wish in player.wishes)] == [
        "reading potentiometers",
        "reference",
        "clear target",
        "enabling",
        "aligning",
        "reference",
        "aligning",
        "enabling",
        OVER,
    ]
    assert player.kinds == [
        *((REFERENCE, name) for name in STEERING),
        *((CLEAR, name) for name in NAMES),
        *((REFERENCE, name) for name in STEERING),
    ]
    assert player.references() == [(LEFT, 7.0), (RIGHT, -4.0), (LEFT, 0.0), (RIGHT, 0.0)]
    reading = [wish for wish in player.wishes if wish.phase == "reading potentiometers"]
    assert len(reading) == READINGS == 100
    assert {(wish.traction, wish.steering) for wish in reading} == {(Goal.DISABLED, Goal.DISABLED)}
    turning = [wish for wish in player.wishes if wish.phase == "aligning"]
    assert {(wish.traction, wish.steering) for wish in turning} == {(Goal.DISABLED, Goal.ENABLED)}
    targets = list(dict.fromkeys(degrees(wish.command.steering) for wish in turning))
    assert targets == pytest.approx([5.0, -5.0, 0.0])
    assert len(turning) == 4, "obedient wheels are there at once"
    enabling = [(wish.traction, wish.steering) for wish in player.wishes if wish.phase == "enabling"]
    assert list(dict.fromkeys(enabling)) == [(Goal.DISABLED, Goal.ENABLED), (Goal.ENABLED, Goal.ENABLED)]
    assert all(wish.command.speed == 0.0 for wish in player.wishes)
    assert set(player.drives.states.values()) == {DriveState.OPERATION_ENABLE} or player.wishes[-1].phase == OVER


def test_the_wheels_stay_as_they_are_until_they_are_turned() -> None:
    player = AlignPlayer()
    player.world["set_points"] = SetPoints(steering=0.1)
    for _ in range(READINGS):
        assert calm(player.tick()) == (0.0, 0.1)
    assert player.wishes[-1].phase == "reading potentiometers"
    assert calm(player.until(lambda wish: wish.phase == "enabling")) == (0.0, 0.1)


def test_the_mean_of_all_readings_counts() -> None:
    player = AlignPlayer()
    for number in range(READINGS + 1):
        player.wheels.extra = {LEFT: 0.02 if number % 2 else 0.0, RIGHT: 0.0}
        player.tick()
    slopes = ROBOT.potentiometers("left").slope_deg_per_v
    assert sum(slopes) == 0.0, "both potentiometers of ARTEMIS turn against each other"
    assert player.references()[:2] == [(LEFT, 7.0), (RIGHT, -4.0)]


def test_readings_before_and_after_do_not_count() -> None:
    player = AlignPlayer()
    player.wheels.misread = {LEFT: radians(0.5), RIGHT: radians(-0.3)}
    player.tick()
    for _ in range(READINGS):
        player.tick()
    assert player.references() == [(LEFT, 7.5), (RIGHT, -4.3)]


@pytest.mark.parametrize(("left", "right"), [(0.4, -0.3), (0.99, 0.0), (0.0, -0.99)])
def test_what_the_encoders_lack_is_found_by_the_sweep(left: float, right: float) -> None:
    player = AlignPlayer(Wheels(left=left, right=right))
    assert player.play() is None
    first, second = player.references()[:2], dict(player.references()[2:])
    assert first == [(LEFT, round(7.0 + left, 3)), (RIGHT, round(-4.0 + right, 3))]
    true = {name: round(degrees(player.wheels.angles[name]), 3) for name in STEERING}
    assert true == {LEFT: 0.0, RIGHT: 0.0}, "they are truly straight in the end"
    assert second == pytest.approx({LEFT: -left, RIGHT: -right}, abs=1e-3)


@pytest.mark.parametrize(("side", "name"), [("left", LEFT), ("right", RIGHT)])
@pytest.mark.parametrize("lacks", [1.01, -1.01])
def test_encoders_that_lack_more_than_a_degree_are_refused(side: str, name: str, lacks: float) -> None:
    fault = refused(player := AlignPlayer(Wheels(**{side: lacks})))
    assert (fault.id, fault.device) == ("STE-05", name)
    assert fault.text.endswith(f"(by {-lacks:.1f} degrees)")
    assert (player.wishes[-1].traction, player.wishes[-1].steering) == (Goal.DISABLED, Goal.ENABLED)


def test_the_edges_of_analog_inputs_tell_more_than_the_sweep() -> None:
    step = EPOS4.drives[LEFT].tables.analog_step
    assert step is not None
    player = AlignPlayer(Wheels(step, left=0.4, right=-0.3), robot=EPOS4)
    assert player.play() is None
    true = {name: degrees(player.wheels.angles[name]) for name in STEERING}
    assert true == pytest.approx({LEFT: 0.0, RIGHT: 0.0}, abs=0.01)
    slope = max(abs(each) for side in ("left", "right") for each in EPOS4.potentiometers(side).slope_deg_per_v)
    told = next(index for index, wish in enumerate(player.wishes) if wish.jobs and index > READINGS + 10)
    turned = [degrees(wish.command.steering) for wish in player.wishes[:told] if wish.phase == "aligning"]
    slow, rest = turned[3:-11], turned[-11:]
    assert rest == [0.0] * 11, "straight again, and ten ticks more"
    assert len(slow) == round(12 * STEP_TICKS) == 199
    assert slow[0] == pytest.approx(0.0)
    assert (min(slow), max(slow)) == pytest.approx((-2 * slope * step, 2 * slope * step), rel=0.05)
    assert max(abs(b - a) for a, b in pairwise(slow)) == pytest.approx(slope * step / STEP_TICKS)


def test_the_larger_step_of_the_analog_inputs_counts_whatever_its_sign() -> None:
    steering = EPOS4.calibration.steering
    steep = {side: getattr(steering, side).model_copy(update={"slope_deg_per_v": (50.0, -80.0)}) for side in SIDES}
    calibration = EPOS4.calibration.model_copy(update={"steering": steering.model_copy(update=steep)})
    robot = EPOS4.model_copy(update={"calibration": calibration})

    def make(made: Shared, seen: Snapshot) -> Routine:
        _, seen = yield from _seek_edges(made.plan, seen)
        return seen

    player = RoutinePlayer(Shared(Plan(robot=robot, steps=())), make, Wheels())
    assert player.play() is None
    step = EPOS4.drives[LEFT].tables.analog_step
    assert step is not None
    assert max(degrees(wish.command.steering) for wish in player.wishes) == pytest.approx(2 * 80 * step, rel=0.05)


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(("name", "pots"), [(LEFT, (0.05, 2.48)), (RIGHT, (2.49, 4.95))])
def test_a_potentiometer_at_a_rail_is_refused_before_anything_is_enabled(name: str, pots: tuple[float, float]) -> None:
    player = AlignPlayer()
    player.wheels.changes[name] = {"potentiometers": pots}
    fault = refused(player)
    assert (fault.id, fault.device) == ("STE-04", name)
    assert fault.text.endswith(f"({pots[0]:.2f} V and {pots[1]:.2f} V)")
    assert not player.jobs
    assert Goal.ENABLED not in {wish.steering for wish in player.wishes}


@pytest.mark.parametrize(("apart", "is_refused"), [(2.95, False), (3.1, True), (-3.1, True)])
def test_potentiometers_that_disagree_are_refused(apart: float, is_refused: bool) -> None:
    player = AlignPlayer()
    first, second = volts("right", radians(-4.0))
    slope = ROBOT.potentiometers("right").slope_deg_per_v[0]
    player.wheels.changes[RIGHT] = {"potentiometers": (first + apart / slope, second)}
    fault = player.until(lambda wish: wish.fault is not None or wish.phase == "enabling").fault
    assert (fault is not None) is is_refused
    if fault is not None:
        assert (fault.id, fault.device) == ("STE-03", RIGHT)
        assert fault.text.endswith(f"({-4.0 + apart:.1f} and -4.0 degrees)")


# ---------------------------------------------------------------------------------------------- new potentiometers


def test_wheels_with_new_potentiometers_are_taken_as_they_are_found() -> None:
    player = AlignPlayer(found={"right": radians(3.0)})
    player.wheels.changes[LEFT] = {"potentiometers": (1.0, 2.0)}  # which disagree
    assert player.play() is None
    assert player.references() == [(LEFT, 0.0), (RIGHT, 3.0)]
    assert player.phases == ["reading potentiometers", "reference", "clear target", "enabling", OVER]
    assert all(wish.traction is Goal.DISABLED for wish in player.wishes)
    assert player.mode.shared.bring_up.taken


def test_wheels_that_were_taken_as_measured_may_have_been_turned_since() -> None:
    player = AlignPlayer(found={"left": radians(1.0)})
    player.mode.shared.bring_up.taken = True
    fault = refused(player)
    assert (fault.id, fault.device) == ("CAL-01", "")
    assert "the wheels may have been turned since their angles were measured from outside: start again" in fault.text
    assert not player.jobs
    again = AlignPlayer(found={})
    again.mode.shared.bring_up.taken = True
    assert again.play() is None, "a person turns these straight"


def test_wheels_that_are_known_may_be_aligned_again() -> None:
    player = AlignPlayer()
    assert player.play() is None
    assert not player.mode.shared.bring_up.taken
    player.mode.shared.bring_up.taken = True
    again = AlignPlayer()
    again.mode.shared.bring_up.taken = True
    assert again.play() is None


def test_an_open_potentiometer_is_refused_even_where_it_is_new() -> None:
    player = AlignPlayer(found={})
    player.wheels.changes[LEFT] = {"potentiometers": (0.0, 2.5)}
    assert refused(player).id == "STE-04"


# --------------------------------------------------------------------------------------------- jobs, enabling, steering


def played(make: Any, wheels: Wheels | None = None) -> RoutinePlayer:
    return RoutinePlayer(shared(), make, wheels or Wheels())


def test_a_job_that_fails_is_its_own_fault() -> None:
    player = played(lambda s, seen: do(STEERING_ON, s.bring_up.jobs(CLEAR, NAMES), seen))
    player.refused = {(CLEAR, TRACTION[1])}
    fault = refused(player)
    assert (fault.id, fault.device) == ("COM-08", TRACTION[1])
    assert fault.text.endswith("(broken in the test)")
    assert player.phases[0] == "clear target"
    assert player.wishes[-1].steering is Goal.ENABLED, "it stands by with the wish that it was given"


def test_a_target_that_was_left_is_a_warning_of_its_drive() -> None:
    player = played(lambda s, seen: do(OFF, s.bring_up.jobs(CLEAR, NAMES), seen))
    player.told = {(CLEAR, LEFT): (5, 6)}
    found = []
    while (wish := player.tick()).phase != OVER:
        found += [wish.fault] if wish.fault else []
    (fault,) = found
    assert (fault.id, fault.device) == ("COM-06", LEFT)
    assert fault.text.endswith("(5 units)")
    told = played(lambda s, seen: do(OFF, s.bring_up.jobs(REFERENCE, STEERING, [0.0, 0.0]), seen))
    told.told = {(REFERENCE, LEFT): (5,)}
    assert told.play() is None


def test_enabling_waits_for_those_that_are_wanted() -> None:
    wheels = Wheels()
    player = played(lambda s, seen: enable(s, STEERING_ON, seen), wheels)
    wheels.lazy = {RIGHT}
    for _ in range(50):
        assert player.tick().phase == "enabling"
    wheels.lazy = set()
    assert player.play() is None
    assert wheels.states[TRACTION[0]] is DriveState.SWITCH_ON_DISABLED
    both = played(lambda s, seen: enable(s, ON, seen))
    both.drives.lazy = {TRACTION[1]}
    for _ in range(50):
        assert both.tick().phase == "enabling"
    held = played(lambda s, seen: enable(s, replace(ON, traction=Goal.HOLD), seen))
    held.drives.lazy = set(TRACTION)
    assert held.play() is None


@pytest.mark.parametrize(
    ("opened", "found"),
    [
        (NAMES, ("EST-01", "", "the STO inputs of all drives are open")),
        ([LEFT], ("DRV-29", LEFT, "they read 0x02")),
        (STEERING, ("DRV-29", LEFT, f"they read 0x02; open at {RIGHT}, too")),
    ],
)
def test_a_drive_that_stays_off_is_asked_for_its_sto_inputs(opened: list[str], found: tuple[str, str, str]) -> None:
    player = RoutinePlayer(Shared(Plan(robot=EPOS4, steps=())), lambda s, seen: enable(s, ON, seen))
    player.drives.lazy = {LEFT}
    player.told = {(JobKind.READ_STO, name): (2,) for name in opened}
    fault = refused(player)
    assert (fault.id, fault.device) == found[:2]
    assert found[2] in fault.text
    assert [name for kind, name in player.kinds if kind is JobKind.READ_STO] == list(EPOS4.drives)


@pytest.mark.parametrize("robot", [ROBOT, EPOS4])
def test_a_drive_that_stays_off_for_another_reason_is_waited_for(robot: RobotFile) -> None:
    player = RoutinePlayer(Shared(Plan(robot=robot, steps=())), lambda s, seen: enable(s, ON, seen))
    player.drives.lazy = {LEFT}
    for _ in range(50):
        assert player.tick().fault is None
    player.drives.lazy = set()
    assert player.play() is None
    assert len(player.jobs) == (len(EPOS4.drives) if robot is EPOS4 else 0), "once"


def to(target: float, errors: dict[str, list[float]] | None = None) -> Any:
    return lambda s, seen: steer(s.plan, target, seen, {} if errors is None else errors, "turning")


def test_steering_ends_where_wheels_and_set_points_are() -> None:
    player = played(to(0.3))
    assert player.play() is None
    turning = [wish for wish in player.wishes if wish.phase == "turning"]
    assert len(turning) == 1, "these are there at once"
    assert all(calm(wish) == (0.0, 0.3) for wish in turning)


def test_steering_tells_what_the_potentiometers_say_beside_the_encoders() -> None:
    errors: dict[str, list[float]] = {RIGHT: []}
    wheels = Wheels()
    wheels.counted[RIGHT] = radians(0.7)
    player = played(to(0.0, errors), wheels)
    assert player.play() is None
    assert errors[RIGHT] == pytest.approx([radians(-0.7)] * len(errors[RIGHT]))
    assert len(errors[RIGHT]) == len([wish for wish in player.wishes if wish.phase == "turning"])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("away", "waits"), [(0.49, False), (0.51, True)])
def test_a_wheel_has_to_reach_its_angle(side: float, away: float, waits: bool) -> None:
    wheels = Wheels()
    player = played(to(0.0), wheels)
    wheels.changes[LEFT] = {"position": radians(side * away)}
    fault = player.play()
    assert (fault is not None) is waits
    if fault is not None:
        assert (fault.id, fault.device) == ("STE-01", LEFT)
        assert fault.text.endswith(f"({-side * 0.5:.1f} degrees away)")
        assert player.time == pytest.approx(12.0, abs=0.1)
        assert player.wishes[-1].steering is Goal.ENABLED


@pytest.mark.parametrize("name", STEERING)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("rate", "waits"), [(0.19, False), (0.21, True)])
def test_a_wheel_has_to_rest(name: str, side: float, rate: float, waits: bool) -> None:
    wheels = Wheels()
    player = played(to(0.0), wheels)
    wheels.changes[name] = {"velocity": radians(side * rate)}
    fault = player.play()
    assert (fault is not None) is waits
    if fault is not None:
        assert (fault.id, fault.device) == ("STE-01", "")
        assert fault.text.endswith("(keeps turning)")


def test_driven_wheels_may_roll_while_the_steering_turns() -> None:
    wheels = Wheels()
    player = played(to(0.0), wheels)
    wheels.changes[TRACTION[0]] = {"velocity": 0.5, "position": 3.0}
    assert player.play() is None


def test_a_set_point_that_the_gate_holds_is_waited_for() -> None:
    wheels = Wheels()
    player = played(to(0.3), wheels)
    wheels.changes = {name: {"position": 0.2} if name in STEERING else {} for name in NAMES}
    player.world["set_points"] = SetPoints(steering=0.2, steering_left=0.2, steering_right=0.2)
    assert refused(player).text.endswith("(keeps turning)")


@pytest.mark.parametrize("changes", [{"position": STRAIGHT}, {"velocity": REST}])
def test_what_just_counts_as_there_is_not_waited_for(changes: dict[str, float]) -> None:
    wheels = Wheels()
    player = played(to(0.0), wheels)
    wheels.changes[LEFT] = changes
    assert player.play() is None


def test_the_first_of_several_wheels_that_are_away_is_named() -> None:
    wheels = Wheels()
    player = played(to(0.0), wheels)
    wheels.changes = {LEFT: {"position": 0.1}, RIGHT: {"position": -0.2}, **{name: {} for name in TRACTION}}
    fault = refused(player)
    assert fault.device == LEFT
    assert fault.text.endswith("(-5.7 degrees away)")


def test_a_wheel_has_exactly_12_seconds_to_get_there() -> None:
    away = drives(drive(LEFT, position=1.0))
    routine = steer(shared().plan, 0.0, snapshot(3.0), {})
    next(routine)
    routine.send(snapshot(15.0, drives=away))
    with pytest.raises(Failed, match="degrees away"):
        routine.send(snapshot(15.001, drives=away))


# ---------------------------------------------------------------------------------------------- switching off


def off(wish: Wish = OFF) -> Any:
    return lambda s, seen: switch_off(s, wish, seen)


def enabled() -> Wheels:
    wheels = Wheels()
    wheels.states = dict.fromkeys(NAMES, DriveState.OPERATION_ENABLE)
    return wheels


def test_drives_that_obey_are_off_after_a_tick() -> None:
    player = played(off(), enabled())
    assert player.play() is None
    assert [wish.phase for wish in player.wishes] == ["switching off", OVER]
    assert not player.jobs


def test_drives_that_stay_on_are_halted_once_each_after_a_while_and_a_second_is_enough() -> None:
    wheels = enabled()
    wheels.lazy = {RIGHT, TRACTION[0]}
    player = played(off(), wheels)
    assert player.play() is None
    assert player.kinds == [(HALT, TRACTION[0]), (HALT, RIGHT)]
    assert all(wish.heartbeat for wish in player.wishes)


def test_drives_are_halted_after_exactly_a_fifth_of_a_second_and_given_up_after_one() -> None:
    on = drives(drive(RIGHT), state=DriveState.SWITCH_ON_DISABLED)
    for begun in (0.0, 4.0):
        routine = switch_off(shared(), OFF, snapshot(begun, drives=on))
        assert next(routine).phase == "switching off"
        assert not routine.send(snapshot(begun + 0.19, drives=on)).jobs
        assert [job.kind for job in routine.send(snapshot(begun + 0.2 + begun / 1e6, drives=on)).jobs] == [HALT]
        assert not routine.send(snapshot(begun + 0.999, drives=on)).jobs
        with pytest.raises(StopIteration):
            routine.send(snapshot(begun + 1.0, drives=on))


def test_a_drive_that_is_heard_may_take_as_long_as_its_robot_file_says_to_be_off() -> None:
    """One that is not heard is given up after a second, as before."""
    words = CIA402.drives[RIGHT].cia402
    assert words is not None
    slow = CIA402.drives[RIGHT].model_copy(update={"cia402": words.model_copy(update={"state_time_s": 5.0})})
    plan = Plan(robot=CIA402.model_copy(update={"drives": {**CIA402.drives, RIGHT: slow}}), steps=())
    heard = drives(drive(RIGHT), state=DriveState.SWITCH_ON_DISABLED)
    lost = drives(drive(RIGHT, age=1.0), state=DriveState.SWITCH_ON_DISABLED)
    for on, given_up in ((heard, 5.0), (lost, 1.0)):
        routine = switch_off(Shared(plan), OFF, snapshot(drives=on))
        assert next(routine).phase == "switching off"
        assert routine.send(snapshot(given_up - 0.001, drives=on)).phase == "switching off"
        with pytest.raises(StopIteration):
            routine.send(snapshot(given_up, drives=on))


def test_drives_that_are_off_are_told_so_once_more() -> None:
    player = played(off())
    assert player.play() is None
    assert [wish.phase for wish in player.wishes] == ["switching off", OVER]


def test_where_a_halt_fails_our_silence_has_to_stop_the_drive() -> None:
    wheels = enabled()
    wheels.lazy = {RIGHT}
    player = played(off(), wheels)
    player.refused = {(HALT, RIGHT)}
    assert player.play() is None
    silent = [wish.heartbeat for wish in player.wishes if wish.phase == "switching off"]
    begun = silent.index(False)
    assert begun * 0.02 == pytest.approx(0.22, abs=0.021)
    assert not any(silent[begun:])
    quiet = played(off(replace(OFF, heartbeat=False)), enabled())
    quiet.play()
    assert not any(wish.heartbeat for wish in quiet.wishes if wish.phase == "switching off")


def test_another_job_that_fails_meanwhile_silences_nothing() -> None:
    wheels = enabled()
    wheels.lazy = {RIGHT}
    player = played(off(), wheels)
    failed = JobResult(id=99, kind=CLEAR, drive=LEFT, ok=False)
    for _ in range(10):
        player.tick(results=(failed,))
    assert all(wish.heartbeat for wish in player.wishes)


# --------------------------------------------------------------------------------------------- drives that are not ours


def keeps_off(name: str, id: int, *values: int) -> JobResult:
    return JobResult(id=id, kind=JobKind.KEEP_OFF, drive=name, ok=True, values=values)


def watched(look: Lookout, made: Shared, time: float, **changes: Any) -> Wish:
    return look.watch(made, replace(OFF, phase="waiting"), snapshot(time, **changes))


def test_drives_that_are_not_ours_are_asked_again_and_again() -> None:
    look, made = Lookout(), shared(connected=False)
    first = watched(look, made, 0.0)
    assert [(job.kind, job.drive) for job in first.jobs] == [(JobKind.KEEP_OFF, name) for name in NAMES]
    assert first.phase == "waiting"
    assert not watched(look, made, 0.2).jobs, "all have to answer first"
    answers = [keeps_off(job.drive, job.id) for job in first.jobs]
    assert not watched(look, made, 0.3, results=tuple(answers[:3])).jobs
    assert len(watched(look, made, 0.4, results=tuple(answers[3:])).jobs) == 4
    second = watched(look, made, 0.42)
    assert not second.jobs


def test_they_are_asked_a_tenth_of_a_second_apart_at_the_soonest() -> None:
    look, made = Lookout(), shared(connected=False)
    jobs = watched(look, made, 1.0).jobs
    answers = tuple(keeps_off(job.drive, job.id) for job in jobs)
    assert not watched(look, made, 1.02, results=answers).jobs
    assert not watched(look, made, 1.099).jobs
    assert watched(look, made, 1.1).jobs


def test_one_that_a_stranger_had_switched_on_is_named() -> None:
    look, made = Lookout(), shared(connected=False)
    jobs = watched(look, made, 0.0).jobs
    stranger = JobResult(id=1000, kind=JobKind.KEEP_OFF, drive=RIGHT, ok=True, values=(1,))
    answers = tuple(keeps_off(job.drive, job.id, *[1] * (job.drive in (LEFT, TRACTION[0]))) for job in jobs)
    wish = watched(look, made, 0.02, results=(*answers, stranger))
    assert wish.phase == f"stopped what another master switched on: {TRACTION[0]}, {LEFT}"
    assert watched(look, made, 0.04, results=answers).phase == "waiting", "once"


def test_jobs_of_the_mode_stay_beside_them() -> None:
    look, made = Lookout(), shared(connected=False)
    own = made.bring_up.jobs(CLEAR, [LEFT])
    wish = look.watch(made, replace(OFF, jobs=own), snapshot(0.0))
    assert wish.jobs[0] is own[0]
    assert len(wish.jobs) == 5


@pytest.mark.parametrize(("connected", "verdict"), [(True, None), (False, judged("COM-18"))])
def test_drives_that_are_ours_or_of_another_artemis_are_sent_nothing(connected: bool, verdict: Any) -> None:
    look, made = Lookout(), shared(connected=connected)
    assert not watched(look, made, 0.0, verdict=verdict).jobs


def test_the_robot_of_these_tests_has_no_steps_of_analog_inputs() -> None:
    assert ROBOT.drives[LEFT].tables.analog_step is None
