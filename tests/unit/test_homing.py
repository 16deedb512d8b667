"""Where the wheels stand without potentiometers: found by what the robot has, or refused with what was seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import groupby
from math import degrees, inf, radians
from pathlib import Path
from typing import Any

import pytest
from core_builders import PERIOD, drive, snapshot
from msgspec.structs import replace

from artemis.drive_states import DriveState, Goal
from artemis.families.family import HOME_INPUT
from artemis.mission.loading import load_model
from artemis.motion.limits import Gate
from artemis.motion.potentiometers import encoder_angle
from artemis.states.homing import AGAIN, AWAY, MEETINGS, SLOW, STRAIGHT, TRAVEL, _Held, find_angles
from artemis.states.mode import Failed
from artemis.states.plan import Plan, Shared
from artemis.values import DriveFeedback, Event, Job, JobKind, JobResult, Request, SetPoints, Snapshot, Wish
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
LEFT, RIGHT = "steer-left", "steer-right"


def described(name: str, **middle: object) -> RobotFile:
    """A robot of the examples, with other words about its steering motor."""
    robot = load_model(ROBOTS / f"{name}.yaml", RobotFile)
    if not middle:
        return robot
    steering = robot.calibration.steering.model_copy(
        update={"middle": robot.angle_source("middle").model_copy(update=middle)}
    )
    return robot.model_copy(update={"calibration": robot.calibration.model_copy(update={"steering": steering})})


def switch(on_from: float, on_side: str) -> Callable[[float], int]:
    """A home switch by the true angle of the motor [degrees]."""
    return lambda angle: HOME_INPUT if (angle >= on_from) is (on_side == "left") else 0


@dataclass(kw_only=True)
class Machine:
    """The gate of a robot, and drives that obey it at once; `angles` are the true ones [degrees] of its steering."""

    robot: RobotFile
    angles: dict[str, float]
    shows: Callable[[float], int] = lambda angle: 0
    """What the sensor at the wheel shows, by the true angle [degrees]."""
    stops: tuple[float, float] = (-180.0, 180.0)
    rate: float = inf
    """So fast the motors turn at most [degrees/s]."""
    period: float = PERIOD
    """Of the ticks [s]."""
    requests: tuple[Request, ...] = ()
    attended: bool = True
    awaited: bool = False
    states: dict[str, DriveState] = field(default_factory=dict)
    """Of the drives in the end."""
    returned: Snapshot | None = None
    seen_last: Snapshot | None = None
    counted: dict[str, float] = field(default_factory=dict)
    """What the drives count less the true angle [rad]."""
    phases: set[str] = field(default_factory=set)
    springs: float = 0.0
    """So far a motor turns by itself when it is switched off [degrees]."""
    accepts: tuple[float, float] = (0.0, inf)
    """When `requests` are made [s]."""
    meets: Callable[[Machine], None] = lambda car: None
    """Called before the motors turn: may move the stops."""
    wishes: list[tuple[Wish, SetPoints]] = field(default_factory=list)
    """Each with the set-points that its routine saw."""

    def find(self, longest: float = 120.0) -> None:
        """Let the routine run to its end."""
        shared = Shared(Plan(robot=self.robot, steps=()))
        gate, points, time, results = Gate(self.robot, self.period), SetPoints(), 0.0, tuple[JobResult, ...]()
        states = dict.fromkeys(self.robot.drives, DriveState.SWITCH_ON_DISABLED)
        routine = find_angles(shared, self.seen(time, states, points, results))
        wish: Wish = next(routine)
        while time < longest:
            time += self.period
            self.phases.add(wish.phase)
            self.wishes.append((wish, points))
            was_on = {name for name, state in states.items() if state is DriveState.OPERATION_ENABLE}
            for name, described in self.robot.drives.items():
                goal = wish.steering if described.role == "steering" else wish.traction
                states[name] = DriveState.OPERATION_ENABLE if goal is Goal.ENABLED else DriveState.SWITCH_ON_DISABLED
                if name in self.angles and name in was_on and states[name] is not DriveState.OPERATION_ENABLE:
                    self.angles[name] += self.springs
            points = gate.limit(wish.command, points, self.period)
            self.turn(points, states)
            results = tuple(
                JobResult(id=job.id, kind=job.kind, drive=job.drive, ok=True) for job in wish.jobs if self.learn(job)
            )
            if any(job.kind is JobKind.REFERENCE for job in wish.jobs):
                points = self.standing()
            seen = self.seen(time, states, points, results)
            try:
                wish = routine.send(seen)
            except StopIteration as ended:
                self.states, self.returned, self.seen_last = states, ended.value, seen
                return
        raise AssertionError(f"no end within {longest} s, in {wish.phase}")

    def turn(self, points: SetPoints, states: dict[str, DriveState]) -> None:
        """Motors that are on turn as they are told, up to the stops."""
        self.meets(self)
        for name, angle in self.angles.items():
            if states[name] is DriveState.OPERATION_ENABLE:
                told = points.steering_right if name == RIGHT else points.steering_left
                wanted = degrees(told - self.counted.get(name, 0.0))
                reached = angle + min(max(wanted - angle, -self.rate * self.period), self.rate * self.period)
                self.angles[name] = min(max(reached, self.stops[0]), self.stops[1]) if angle != wanted else angle

    def learn(self, job: Any) -> bool:  # noqa: ANN401
        if job.kind is JobKind.REFERENCE:
            self.counted[job.drive] = job.value - radians(self.angles[job.drive])
        return True

    def position(self, name: str) -> float:
        return radians(self.angles[name]) + self.counted.get(name, 0.0)

    def standing(self) -> SetPoints:
        positions = [self.position(name) for name in self.angles]
        return SetPoints(steering=positions[0], steering_left=positions[0], steering_right=positions[-1])

    def seen(
        self, time: float, states: dict[str, DriveState], points: SetPoints, results: tuple[JobResult, ...]
    ) -> Snapshot:
        said: list[DriveFeedback] = []
        for name in self.robot.drives:
            steers = name in self.angles
            values = {"position": self.position(name), "angle_sensor": self.shows(self.angles[name])} if steers else {}
            said.append(drive(name, state=states[name], potentiometers=(0.0, 0.0), frames=1, **values))
        asks = self.accepts[0] <= time <= self.accepts[1]
        more: dict[str, Any] = {"requests": self.requests if asks else ()}
        more |= {"attended": self.attended, "awaited": self.awaited}
        seen = snapshot(time, set_points=points, drives=tuple(said), results=results, **more)
        return replace(seen, dt=self.period)

    @property
    def jobs(self) -> list[Job]:
        return [job for wish, _ in self.wishes for job in wish.jobs]

    @property
    def references(self) -> list[float]:
        """Angles that a motor was told to stand at [degrees]."""
        return [round(degrees(job.value), 3) for job in self.jobs if job.kind is JobKind.REFERENCE]

    @property
    def errors(self) -> list[float]:
        """Of what the drives count at the end [degrees]."""
        return [degrees(self.position(name)) - angle for name, angle in self.angles.items()]

    def refused(self) -> tuple[str, str, str]:
        """Row, device and words of the fault with which the routine ends."""
        with pytest.raises(Failed) as caught:
            self.find()
        fault = caught.value.fault
        return fault.id, fault.device, fault.text


# -------------------------------------------------------------------------------------------------------- home switch


@pytest.mark.parametrize("on_side", ["left", "right"])
@pytest.mark.parametrize("place", [12.5, -38.0, 0.0])
@pytest.mark.parametrize("start", [-44.0, 12.4, 45.0])
def test_a_home_switch_is_found_from_wherever_the_wheel_stands(on_side: str, place: float, start: float) -> None:
    robot = described("small_car_switch", switch_deg=place, on_side=on_side)
    car = Machine(robot=robot, angles={"steering": start}, shows=switch(place, on_side))
    car.find()
    assert car.errors == pytest.approx([0.0], abs=0.006)  # half of what it creeps in a tick
    assert car.angles["steering"] == pytest.approx(0.0, abs=0.51)
    assert "looking for the home switch" in car.phases


@pytest.mark.parametrize("always", [0, HOME_INPUT])
def test_a_home_switch_that_never_changes_is_told(always: int) -> None:
    car = Machine(robot=described("small_car_switch"), angles={"steering": 7.0}, shows=lambda angle: always)
    id, device, text = car.refused()
    assert (id, device) == ("CAL-03", "steering")
    assert "no change of the home switch within 160 degrees" in text


def test_a_motor_that_is_held_before_its_switch_changes_is_told() -> None:
    car = Machine(
        robot=described("small_car_switch"), angles={"steering": 7.0}, shows=switch(40.0, "left"), stops=(-30.0, 30.0)
    )
    assert "held before its home switch changes" in car.refused()[2]


def test_a_switch_that_is_on_to_both_sides_is_told() -> None:
    """Once it was seen it stays on: it sticks."""
    passed: list[float] = []

    def stuck(angle: float) -> int:
        passed.extend([angle] if angle >= 12.5 else [])
        return HOME_INPUT if passed else 0

    car = Machine(robot=described("small_car_switch"), angles={"steering": 7.0}, shows=stuck)
    assert "its home switch is on to both sides" in car.refused()[2]


def test_a_switch_that_does_not_go_on_again_is_told() -> None:
    """A contact that closed once, or a disturbance on the cable."""
    seen: list[float] = []

    def once(angle: float) -> int:
        seen.append(angle)
        return HOME_INPUT if len(seen) == 60 else 0

    car = Machine(robot=described("small_car_switch"), angles={"steering": 7.0}, shows=once)
    assert "its home switch closes at another place than before" in car.refused()[2]


# ----------------------------------------------------------------------------------------------------------- encoders


def counts(robot: RobotFile, side: str, angle: float) -> int:
    """What a good encoder shows at a true angle [degrees], of the robot file's zero and sense of rotation."""
    source: Any = robot.angle_source(side)
    turned = -angle if source.mirrored else angle
    counts_per_turn = 1 << int(source.bits)
    return int(round((source.zero_deg + turned) / 360.0 * counts_per_turn) % counts_per_turn)


def absolute(left: float, right: float) -> Machine:
    robot = described("artemis_absolute")
    shown = {left: counts(robot, "left", left), right: counts(robot, "right", right)}
    return Machine(robot=robot, angles={LEFT: left, RIGHT: right}, shows=lambda angle: shown.get(angle, 0))


def test_absolute_encoders_are_read_once() -> None:
    car = absolute(7.0, -4.0)
    car.find()
    assert car.errors == pytest.approx([0.0, 0.0], abs=360 / 2**17)
    assert "reading absolute encoders" in car.phases


@pytest.mark.parametrize(("left", "right", "named"), [(100.0, 0.0, LEFT), (0.0, -140.0, RIGHT)])
def test_an_encoder_that_shows_what_no_wheel_turns_to_is_refused(left: float, right: float, named: str) -> None:
    id, device, text = absolute(left, right).refused()
    assert (id, device) == ("CAL-03", named)
    assert f"shows {left or right:.0f} degrees, farther than the wheel turns" in text


def test_a_full_turn_is_no_turn() -> None:
    known: Any = described("artemis_absolute").angle_source("left")
    near = known.model_copy(update={"zero_deg": 359.0, "bits": 12})
    assert degrees(encoder_angle(0, near)) == pytest.approx(1.0)
    assert degrees(encoder_angle(4095, near)) == pytest.approx(1.0 - 360 / 4096)
    assert degrees(encoder_angle(0, near.model_copy(update={"mirrored": True}))) == pytest.approx(-1.0)


# --------------------------------------------------------------------------------------------------- stops, and hands


@pytest.mark.parametrize("stop", [47.0, -47.0])
@pytest.mark.parametrize("start", [7.0, 44.0, -46.0])
def test_a_hard_stop_is_found_and_then_the_angle_is_known(stop: float, start: float) -> None:
    car = Machine(robot=described("small_car", stop_deg=stop), angles={"steering": start}, stops=(-47.0, 47.0))
    car.find()
    assert car.errors == pytest.approx([0.0], abs=degrees(SLOW) * PERIOD)


@pytest.mark.parametrize("tick_hz", [25, 50, 200])
def test_a_motor_that_turns_slower_than_it_is_told_to_is_not_held(tick_hz: int) -> None:
    car = Machine(robot=described("small_car", stop_deg=47.0), angles={"steering": 7.0}, period=1.0 / tick_hz)
    car.rate, car.stops = 0.5 * degrees(SLOW), (-47.0, 47.0)
    car.find()
    assert car.errors == pytest.approx([0.0], abs=degrees(SLOW) / tick_hz)


def test_no_hard_stop_is_told() -> None:
    car = Machine(robot=described("small_car"), angles={"steering": 7.0})
    id, device, text = car.refused()
    assert (id, device) == ("CAL-03", "steering")
    assert "no hard stop within 150 degrees" in text
    looked = [degrees(wish.command.steering) for wish, _ in car.wishes if wish.phase == "looking for the hard stop"]
    assert len(looked) == pytest.approx(2 * 75.0 / degrees(SLOW) / PERIOD, abs=2), "twice, nearly from lock to lock"
    assert (min(looked), max(looked)) == pytest.approx((-35.0, 40.0), abs=0.3)
    phases = [phase for phase, _ in groupby(wish.phase for wish, _ in car.wishes)]
    assert phases == ["switching off", "reference", "clear target", "enabling", "looking for the hard stop"] * 2


def kerb(*ends: tuple[float, float]) -> Callable[[Machine], None]:
    """Each pair holds the motor at an angle [degrees] when it comes there from the right, for so long in all [s]."""
    left = {at: round(seconds / PERIOD) for at, seconds in ends}

    def meets(car: Machine) -> None:
        angle = car.angles["steering"]
        at = next((at for at in left if left[at] and angle >= at - 0.5), 47.0)
        if at in left and angle >= at:
            left[at] -= 1
        car.stops = (-47.0, at)

    return meets


@pytest.mark.parametrize("travel", [None, 94.0])
@pytest.mark.parametrize("held", [[(-20.0, 0.2)], [(10.0, 0.2), (30.0, 0.2)], [(46.8, 0.2)]])
def test_what_holds_a_motor_for_a_moment_is_not_its_stop(travel: float | None, held: list[tuple[float, float]]) -> None:
    car = Machine(robot=described("small_car", travel_deg=travel), angles={"steering": -30.0}, meets=kerb(*held))
    car.find()
    assert car.errors == pytest.approx([0.0], abs=degrees(SLOW) * PERIOD)


def test_a_motor_that_is_held_everywhere_is_told() -> None:
    places = [(-20.0 + 7.0 * number, 0.2) for number in range(MEETINGS)]
    car = Machine(robot=described("small_car"), angles={"steering": -30.0}, meets=kerb(*places))
    id, device, text = car.refused()
    assert (id, device) == ("CAL-03", "steering")
    assert f"held {MEETINGS} times, never twice at one place" in text


@pytest.mark.parametrize("travel", [None, 94.0])
@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize("held_at", [-30.0, 0.0, 39.0])
def test_a_kerb_before_the_stop_is_found_on_the_way_to_the_other_side(
    held_at: float, towards: float, travel: float | None
) -> None:
    robot = described("small_car", stop_deg=47.0 * towards, travel_deg=travel)
    low, high = sorted((-47.0 * towards, held_at * towards))
    car = Machine(robot=robot, angles={"steering": -40.0 * towards}, stops=(low, high))
    id, device, text = car.refused()
    assert (id, device) == ("CAL-03", "steering")
    assert f"held at {0.0 - towards * held_at:.1f} of {-40.0 * towards:.1f} degrees to the other side" in text


@pytest.mark.parametrize(
    ("other", "is_refused"), [(-45.2, False), (-44.8, True), (-48.8, False), (-49.2, True), (-60.0, True)]
)
def test_the_way_between_both_stops_is_that_of_the_robot_file(other: float, is_refused: bool) -> None:
    car = Machine(robot=described("small_car"), angles={"steering": 7.0}, stops=(other, 47.0))
    if not is_refused:
        car.find()
        assert car.errors == pytest.approx([0.0], abs=degrees(SLOW) * PERIOD)
        assert 47.0 - other == pytest.approx(94.0, abs=degrees(TRAVEL))
        return
    id, device, text = car.refused()
    assert (id, device) == ("CAL-03", "steering")
    assert f"{47.0 - other:.1f} degrees between its hard stops: the robot file says 94" in text


def test_without_another_stop_nothing_is_measured() -> None:
    car = Machine(robot=described("small_car"), angles={"steering": 30.0}, stops=(-180.0, 47.0), period=0.05)
    car.stops = (-inf, 47.0)
    assert "no hard stop within 150 degrees" in car.refused()[2]


def test_a_stop_is_met_twice_and_the_motor_turns_back_in_between() -> None:
    car = Machine(robot=described("small_car", travel_deg=None), angles={"steering": 7.0}, stops=(-47.0, 47.0))
    seen: list[float] = []
    car.meets = lambda car: seen.append(car.angles["steering"])
    car.find()
    first, last = seen.index(47.0), len(seen) - seen[::-1].index(47.0)
    assert min(seen[first:last]) == pytest.approx(47.0 - degrees(AWAY), abs=0.5)
    assert min(seen[last:]) == pytest.approx(-40.0, abs=0.5), "then to the other lock"
    assert degrees(AGAIN) < degrees(AWAY)


def test_a_motor_is_held_after_three_messages() -> None:
    held = _Held("steer-left", 1.0)
    told = SetPoints(steering_left=1.0)
    still = replace(snapshot(set_points=told, drives=(drive(LEFT, position=0.0, frames=1),)), dt=0.02)
    silent = replace(snapshot(set_points=told, drives=(drive(LEFT, position=0.0),)), dt=0.02)
    assert [held(each) for each in (still, silent, still, silent, still)] == [False] * 4 + [True]


def by_hand(**changes: Any) -> Machine:  # noqa: ANN401
    robot = load_model(ROBOTS / "small_car.yaml", RobotFile).model_dump(exclude_unset=True)
    robot["calibration"]["steering"] = {"middle": {"angle": "by_hand"}}
    return Machine(robot=RobotFile.model_validate(robot), angles={"steering": 0.0}, **changes)


def asked(car: Machine) -> list[Wish]:
    return [wish for wish, _ in car.wishes if wish.phase == STRAIGHT]


def test_a_person_who_is_not_there_ends_it() -> None:
    car = by_hand(attended=False)
    with pytest.raises(AssertionError, match="no end within"):  # the mode machine ends it
        car.find(longest=1.0)
    wish, _ = car.wishes[0]
    assert (wish.event, wish.failed, wish.fault) == (Event.END, True, None)
    assert wish.phase == f"no operator can accept: {STRAIGHT}"
    assert {(each.traction, each.steering) for each, _ in car.wishes} == {(Goal.DISABLED, Goal.DISABLED)}
    assert asked(car) == []


def test_it_waits_for_a_person_who_may_still_come() -> None:
    car = by_hand(attended=False, awaited=True, requests=(Request.ACCEPT,), accepts=(0.75, inf))
    car.find()
    assert asked(car)


def test_wheels_that_a_person_set_straight_count_from_there() -> None:
    car = by_hand(requests=(Request.ACCEPT,), accepts=(0.75, inf))
    car.find()
    assert car.errors == [0.0]
    assert len(asked(car)) * PERIOD == pytest.approx(0.75, abs=0.03)
    assert {(wish.traction, wish.steering) for wish in asked(car)} == {(Goal.DISABLED, Goal.DISABLED)}
    drives = list(car.robot.drives)
    assert [(job.kind, job.drive) for job in car.jobs] == [
        (JobKind.REFERENCE, "steering"),
        *((JobKind.CLEAR_TARGET, name) for name in drives),
    ]
    assert set(car.states.values()) == {DriveState.OPERATION_ENABLE}, "traction, too, in the end"


def test_a_key_that_bounces_accepts_nothing() -> None:
    car = by_hand(requests=(Request.ACCEPT,), accepts=(0.1, 0.48))
    with pytest.raises(AssertionError, match="no end within"):
        car.find(longest=5.0)
    again = by_hand(requests=(Request.ACCEPT,), accepts=(0.495, 0.505))
    again.find(longest=5.0)
    assert len(asked(again)) == 25, "half a second exactly is enough"


def test_a_person_has_exactly_ten_minutes() -> None:
    routine = find_angles(Shared(Plan(robot=by_hand().robot, steps=())), snapshot(5.0))
    assert next(routine).phase == STRAIGHT
    assert routine.send(snapshot(605.0)).phase == STRAIGHT
    late = routine.send(snapshot(605.01))
    assert (late.event, late.failed, late.fault and late.fault.id) == (Event.END, True, "OPR-03")


# ------------------------------------------------------------------------------------------------------------ exactly


@pytest.mark.parametrize(
    ("side", "angle", "is_refused"),
    [
        ("left", 73.318 + 19.5, False),
        ("left", 73.318 + 20.5, True),
        ("left", -49.469 - 19.5, False),
        ("left", -49.469 - 20.5, True),
        ("right", 49.469 + 19.5, False),
        ("right", 49.469 + 20.5, True),
        ("right", -73.318 - 19.5, False),
        ("right", -73.318 - 20.5, True),
    ],
)
def test_an_encoder_may_show_20_degrees_more_than_the_gate_lets_its_wheel_turn(
    side: str, angle: float, is_refused: bool
) -> None:
    other = 0.5
    car = absolute(angle, other) if side == "left" else absolute(other, angle)
    if is_refused:
        assert car.refused()[1] == f"steer-{side}"
    else:
        car.find()
        assert car.errors == pytest.approx([0.0, 0.0], abs=0.01)
    assert car.wishes[0][0].phase == "reading absolute encoders"
    assert car.wishes[0][0].steering is Goal.DISABLED


LOCK = {1.0: 40.0, -1.0: -40.0}
"""Of the small car [degrees], by side."""


@pytest.mark.parametrize("stop", [47.0, -47.0])
def test_a_stop_is_looked_for_from_the_far_lock_and_taken_as_it_is_when_the_motor_is_off(stop: float) -> None:
    car = Machine(robot=described("small_car", stop_deg=stop), angles={"steering": 7.0}, stops=(-47.0, 47.0))
    car.springs = 0.3
    car.find()
    towards = 1.0 if stop > 0.0 else -1.0
    assert car.references[0] == pytest.approx(-towards * (car.robot.limits.steering_deg - degrees(AWAY)))
    assert car.references[1] == pytest.approx(stop + car.springs, abs=degrees(SLOW) * PERIOD)
    assert car.errors == pytest.approx([0.0], abs=degrees(SLOW) * PERIOD)
    assert {"looking for the hard stop", "switching off"} <= car.phases


def held_while_off(car: Machine) -> None:
    """Where the motor is switched off far from straight, the set-point stays where it was."""
    off = [
        (wish, points) for wish, points in car.wishes if wish.phase == "switching off" and abs(points.steering) > 0.05
    ]
    assert off
    assert all(wish.command.steering == points.steering for wish, points in off)
    assert all((wish.traction, wish.steering) == (Goal.DISABLED, Goal.DISABLED) for wish, _ in off)


def test_the_set_point_stays_where_the_motor_met_the_stop() -> None:
    car = Machine(robot=described("small_car", stop_deg=47.0), angles={"steering": 30.0}, stops=(-47.0, 47.0))
    car.find()
    held_while_off(car)
    assert car.returned is car.seen_last is not None
    assert set(car.states.values()) == {DriveState.OPERATION_ENABLE}


@pytest.mark.parametrize("on_side", ["left", "right"])
@pytest.mark.parametrize("place", [25.0, -25.0])
def test_a_switch_is_met_twice_and_taken_as_it_is_when_the_motor_is_off(on_side: str, place: float) -> None:
    robot = described("small_car_switch", switch_deg=place, on_side=on_side)
    off = -40.0 if on_side == "left" else 40.0
    car = Machine(robot=robot, angles={"steering": off}, shows=switch(place, on_side))
    car.springs = 0.4
    car.find()
    assert car.errors == pytest.approx([0.0], abs=0.006)
    towards = 1.0 if on_side == "left" else -1.0
    assert car.references[0] == pytest.approx(-towards * car.robot.limits.steering_deg)
    held_while_off(car)
    creeping = [(wish, points) for wish, points in car.wishes if wish.phase == "looking for the home switch"]
    assert len([1 for wish, _ in car.wishes if wish.phase == "switching off"]) >= 3
    assert {wish.traction for wish, _ in creeping} == {Goal.DISABLED}
