"""A follower drives the robot: what it says, what it breaks, and how far it may be off."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from core_builders import (
    PATH,
    PERIOD,
    ROUTE,
    Player,
    StubFollower,
    fault_of,
    following,
    has_fault,
    powered,
    shared,
)
from msgspec.structs import replace

from artemis.battery import BatteryState
from artemis.motion.path import Path
from artemis.plugins.contracts import Following
from artemis.states.condition import Both, Compare, Has, Not
from artemis.states.follow import CERTAIN, CONTRADICTED, FollowMode
from artemis.states.plan import AskStep, FollowStep, Shared, TeleopStep, WaitStep
from artemis.values import (
    DriveCommand,
    Event,
    LocatedPose,
    Odometry,
    SetPoints,
    Snapshot,
    Wish,
)


def follow(answer: Callable[[], Any] | None = None, **options: Any) -> tuple[Player, StubFollower, Shared]:
    follower = StubFollower(answer)
    steps = shared(FollowStep(route=ROUTE, follower=follower, **options))
    return Player(FollowMode(steps)), follower, steps


def raising() -> Following:
    raise ZeroDivisionError("in the plugin")


def test_follow_does_what_the_follower_says_and_shows_where_it_is() -> None:
    player, follower, _ = follow()
    wish = player.tick()
    assert wish.command == DriveCommand(speed=0.3, steering=0.1)
    assert wish.tracking == following().tracking
    assert powered(wish)
    assert (follower.starts, follower.steps) == (1, 1)


def test_follower_that_raises_is_a_fault_and_the_robot_stands() -> None:
    player, _, _ = follow(raising)
    wish = player.tick(set_points=SetPoints(speed=0.3, steering=0.2))
    assert fault_of(wish) == ("PLG-02", "follower")
    assert "in the plugin" in str(wish.fault)
    assert wish.command == DriveCommand(speed=0.0, steering=0.2)


def test_follower_that_raises_at_its_start_is_a_fault_and_is_never_asked() -> None:
    player, follower, _ = follow()

    def start(path: Path, snapshot: Snapshot) -> None:
        raise OSError("no such table")

    follower.start = start  # type: ignore[method-assign]
    for _ in range(3):
        wish = player.tick()
        assert fault_of(wish) == ("PLG-02", "follower")
        assert wish.command.speed == 0.0
    assert follower.steps == 0


GARBAGE: dict[str, Any] = {
    "None": None,
    "number": 42,
    "command": DriveCommand(speed=0.3),
    "no tracking": replace(following(), tracking=None),
    "no command": replace(following(), command=None),
    "text for a number": following(cross_track="near"),  # type: ignore[arg-type]
    "cross-track not a number": following(cross_track=math.nan),
    "cross-track infinite": following(cross_track=math.inf),
    "arc length not a number": following(arc_length=math.nan),
}


@pytest.mark.parametrize("garbage", GARBAGE.values(), ids=GARBAGE)
def test_follower_that_returns_garbage_is_a_fault_and_the_robot_stands(garbage: Any) -> None:
    player, _, _ = follow(lambda: garbage)
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert fault_of(wish) == ("PLG-06", "follower")
    assert wish.command == DriveCommand(speed=0.0, steering=0.2)


@pytest.mark.parametrize("start", [following(cross_track=1.01), following(cross_track=-1.01),
                                   following(heading_error=math.radians(61))])  # fmt: skip
def test_path_is_not_begun_from_far_away_however_often_it_is_tried(start: Following) -> None:
    player, _, _ = follow(lambda: start)
    for _ in range(3):
        wish = player.tick()
        assert fault_of(wish) == ("PTH-05", "")
        assert wish.command.speed == 0.0
        player.enter()  # acknowledged, armed, and not moved


def test_path_is_not_gone_on_with_when_the_place_of_the_robot_is_not_known() -> None:
    player, follower, steps = follow()
    assert player.tick().fault is None
    done = steps.position.done
    for _ in range(3):
        wish = player.tick(odometry=Odometry(lost=True), set_points=SetPoints(steering=0.2))
        assert fault_of(wish) == ("RUN-08", "")
        assert wish.command == DriveCommand(speed=0.0, steering=0.2)
        player.enter()
    assert (follower.steps, steps.position.done) == (1, done)


def test_path_is_not_gone_on_with_where_fixes_say_that_the_robot_is_somewhere_else() -> None:
    player, follower, _ = follow()
    assert player.tick(pose=LocatedPose(contradicted=CONTRADICTED)).fault is None
    wish = player.tick(pose=LocatedPose(contradicted=CONTRADICTED + 0.02))
    assert fault_of(wish) == ("LOC-02", "")
    assert (wish.command.speed, follower.steps) == (0.0, 1)


def test_path_is_begun_from_nearby() -> None:
    player, _, _ = follow(lambda: following(cross_track=0.99, heading_error=math.radians(59)))
    assert player.tick().fault is None


def along(
    player: Player, answers: list[Following], follower: StubFollower, distances: Iterable[float] | None = None
) -> list[Wish]:
    """Ticks with these answers; the robot has rolled so far [m], as far as its path says if nothing is given."""
    wishes = []
    for answer, distance in zip(answers, distances or [answer.tracking.arc_length for answer in answers], strict=True):
        follower.answer = lambda answer=answer: answer
        wishes.append(player.tick(odometry=Odometry(distance=distance)))
    return wishes


@pytest.mark.parametrize("side", [1, -1])
def test_robot_off_its_path_is_a_fault_with_the_place(side: int) -> None:
    player, follower, _ = follow(max_cross_track=0.6)
    converged = [following(arc_length=distance / 10) for distance in range(12)]
    assert not any(map(has_fault, along(player, converged, follower)))
    near, off = along(
        player,
        [following(arc_length=1.2, cross_track=0.6 * side), following(arc_length=1.2, cross_track=0.601 * side)],
        follower,
    )
    assert near.fault is None
    assert fault_of(off) == ("PTH-06", "")
    assert "at 1.20 m" in str(off.fault)
    assert off.command.speed == 0.0


CIRCLING = [following(arc_length=0.5 + 0.3 * math.sin(distance / 3), cross_track=0.5) for distance in range(80)]
"""A robot that drives a decimetre in each tick, and comes no further along its path."""


@pytest.mark.parametrize("distances", [[at / 10 for at in range(80)], [-at / 10 for at in range(80)],
                                  [(at % 2) / 10 for at in range(80)]], ids=["on", "back", "to and fro"])  # fmt: skip
def test_limit_of_the_error_counts_at_the_latest_after_five_metres_wherever_they_lead(distances: list[float]) -> None:
    player, follower, _ = follow(max_cross_track=0.3)
    wishes = along(player, CIRCLING, follower, distances)
    assert [has_fault(wish) for wish in wishes].index(True) in (50, 51)
    assert fault_of(wishes[51]) == ("PTH-06", "")


def test_way_before_a_stop_does_not_count_after_it() -> None:
    player, follower, _ = follow(max_cross_track=0.3)
    distances = [10 + distance / 10 for distance in range(40)]
    assert not any(map(has_fault, along(player, CIRCLING[:40], follower, distances)))
    player.enter()
    assert not any(map(has_fault, along(player, CIRCLING[:40], follower, [distance + 5.0 for distance in distances])))


def test_limit_of_the_error_counts_from_the_first_metre_that_kept_it() -> None:
    player, follower, _ = follow(max_cross_track=0.3)
    approach = [
        following(arc_length=distance / 10, cross_track=0.5 if distance <= 10 else 0.2) for distance in range(20)
    ]
    assert not any(map(has_fault, along(player, approach, follower)))
    (still_converging,) = along(player, [following(arc_length=1.95, cross_track=0.4)], follower)
    assert still_converging.fault is None
    kept = [following(arc_length=1.95 + distance / 10, cross_track=0.2) for distance in range(1, 12)]
    assert not any(map(has_fault, along(player, kept, follower)))
    (lost,) = along(player, [following(arc_length=3.1, cross_track=0.4)], follower)
    assert fault_of(lost) == ("PTH-06", "")


def driven(player: Player, *distances: tuple[float, float]) -> list[bool]:
    """Ticks with these arc lengths and distances of the robot; whether each ended with the fault of an overrun path."""
    found = []
    for arc_length, distance in distances:
        step: Any = player.mode.shared.current
        step.follower.answer = lambda arc=arc_length: following(arc_length=arc)
        wish = player.tick(odometry=Odometry(distance=distance))
        found.append(wish.fault is not None and wish.fault.id == "PTH-08")
        assert (wish.command.speed == 0.0) is found[-1]
    return found


@pytest.mark.parametrize("sign", [1, -1])
def test_follower_that_drives_on_beyond_the_end_is_a_fault(sign: int) -> None:
    player, _, _ = follow()
    distances = [(3.9, 3.9), (3.98, 9.0), (3.991, 10.0), (4.0, 10.15), (4.0, 10.199), (4.0, 10.21)]
    assert driven(player, *((arc, sign * distance) for arc, distance in distances)) == [False] * 5 + [True]


def test_way_beyond_the_end_counts_anew_after_the_robot_came_back_to_the_path() -> None:
    player, _, _ = follow()
    assert driven(player, (4.0, 1.0), (4.0, 1.15), (3.9, 1.3), (4.0, 1.4), (4.0, 1.55)) == [False] * 5
    player.enter()
    assert driven(player, (4.0, 9.0), (4.0, 9.15), (4.0, 9.25)) == [False, False, True]


def test_path_that_takes_too_long_is_a_fault_that_counts_only_driving(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.states.follow.SLACK", 0.0)
    in_one_second = 2 * PATH.length
    player, follower, steps = follow(speed=in_one_second)
    answers = [following(arc_length=number / 100) for number in range(45)]
    assert not any(map(has_fault, along(player, answers, follower)))
    player.time += 100.0
    player.enter()  # stopped, and on its way again
    answers = [following(arc_length=0.5 + number / 100) for number in range(10)]
    told = [wish.fault is not None and wish.fault.id == "PTH-08" for wish in along(player, answers, follower)]
    assert told.index(True) in (4, 5)
    assert "0.5" in str(player.wishes[-1].fault)
    steps.plan = replace(steps.plan, steps=(FollowStep(route=ROUTE, follower=follower, speed=in_one_second),))
    player.enter()
    assert not has_fault(player.tick()), "another step has its own time"


def test_path_of_a_follower_that_tells_no_speed_is_not_driven_for_ever_either(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.states.follow.SLACK", 0.0)
    monkeypatch.setattr("artemis.states.follow.SLOWEST", 2 * PATH.length)
    player, follower, _ = follow()
    wishes = along(player, [following(arc_length=1.0 + number % 2) for number in range(60)], follower)
    told = [wish.fault is not None and wish.fault.id == "PTH-08" for wish in wishes]
    assert told.index(True) in (49, 50)


def test_follow_is_done_when_the_follower_has_finished_and_the_robot_stands() -> None:
    player, _, steps = follow(lambda: following(finished=True))
    assert player.tick(standing=False).event is None
    assert steps.current is not None
    assert player.tick().event is Event.DONE
    assert steps.current is None


def test_interrupted_path_goes_on_without_starting_the_follower_again() -> None:
    player, follower, _ = follow()
    player.tick()
    player.enter()
    player.tick()
    assert (follower.starts, follower.steps) == (1, 2)


def test_next_path_starts_its_own_follower() -> None:
    first, second = StubFollower(lambda: following(finished=True)), StubFollower()
    steps = shared(FollowStep(route=ROUTE, follower=first), FollowStep(route=ROUTE, follower=second))
    player = Player(FollowMode(steps))
    assert player.tick().event is Event.DONE
    player.enter()
    player.tick()
    assert (first.starts, second.starts) == (1, 1)


def test_same_step_twice_in_a_plan_is_started_twice() -> None:
    follower = StubFollower(lambda: following(finished=True))
    steps = shared(*(FollowStep(route=ROUTE, follower=follower) for _ in range(2)))
    player = Player(FollowMode(steps))
    player.tick()
    player.enter()
    player.tick()
    assert follower.starts == 2


# ---------------------------------------------------------------------------------------------- going on with a path


class PathTaker(StubFollower):
    """Keeps the path that it was given, and says that it is 0.5 m on its way along it."""

    def start(self, path: Path, snapshot: Snapshot) -> None:
        super().start(path, snapshot)
        self.path = path

    def step(self, snapshot: Snapshot) -> Following:
        answer = following(arc_length=0.5)
        return replace(answer, tracking=replace(answer.tracking, length=self.path.length))


def test_a_path_of_which_an_earlier_run_has_driven_a_part_is_begun_there() -> None:
    follower = PathTaker()
    steps = shared(FollowStep(route=ROUTE, follower=follower), done=1.25)
    wish = Player(FollowMode(steps)).tick()

    assert follower.path.at(0.0).x == pytest.approx(1.25, abs=PATH.spacing)
    assert follower.path.at(follower.path.length).x == pytest.approx(PATH.at(PATH.length).x)
    assert wish.tracking is not None
    assert wish.tracking.arc_length == pytest.approx(1.25 + 0.5, abs=PATH.spacing)
    assert wish.tracking.length == pytest.approx(PATH.length)


def test_the_next_path_is_begun_at_its_start() -> None:
    first, second = PathTaker(), PathTaker()
    first.answer = lambda: following(finished=True)
    first.step = lambda snapshot: following(finished=True)  # type: ignore[method-assign]
    steps = shared(FollowStep(route=ROUTE, follower=first), FollowStep(route=ROUTE, follower=second), done=1.25)
    player = Player(FollowMode(steps))
    player.tick()
    player.enter()
    wish = player.tick()

    assert second.path is PATH
    assert wish.tracking is not None
    assert (wish.tracking.arc_length, wish.tracking.length) == (0.5, PATH.length)


def test_progress_is_kept_in_the_plan_and_begins_anew_with_the_next_step() -> None:
    player, follower, steps = follow(lambda: following(arc_length=0.75))
    player.tick()
    assert steps.position.done == 0.75
    follower.answer = lambda: following(arc_length=0.8, finished=True)
    player.tick()
    assert (steps.position.step, steps.position.done) == (1, 0.0)


def test_a_robot_just_before_the_start_of_its_path_has_driven_nothing() -> None:
    player, _, steps = follow(lambda: following(arc_length=-0.02))
    player.tick()
    assert steps.position.done == 0.0


def test_a_path_that_is_too_far_away_to_begin_counts_as_no_progress() -> None:
    player, _, steps = follow(lambda: following(arc_length=0.75, cross_track=1.5))
    player.tick()
    assert steps.position.done == 0.0


# ------------------------------------------------------------------------------------------------ the battery


def reaching(metres: float, std: float = 0.5) -> BatteryState:
    return BatteryState(volts=24.0, charge=0.5, charge_std=0.1, watts=50.0, range_m=metres, range_std_m=std)


def test_battery_that_does_not_reach_any_more_ends_the_step_once_the_robot_stands() -> None:
    player, _, _ = follow()
    left = following().tracking.length - following().tracking.arc_length
    assert player.tick(battery=reaching(left + 0.1)).command.speed > 0.0
    for _ in range(round(CERTAIN / PERIOD)):
        assert player.tick(battery=reaching(left - 1.0)).command.speed > 0.0
    player.tick(battery=reaching(left - 1.0))
    moving = player.tick(battery=reaching(left - 1.0), standing=False, set_points=SetPoints(steering=0.2))
    assert (moving.command, moving.outcome) == (DriveCommand(steering=0.2), "")
    assert moving.phase.endswith(f"m to drive, the battery reaches {left - 1.0:.0f} m")
    ended = player.tick(battery=reaching(left + 5.0))
    assert (ended.outcome, ended.event, ended.fault) == ("battery-short", Event.DONE, None)


@pytest.mark.parametrize(("metres", "std", "every"), [(-0.4, 0.5, 1), (-2.0, 0.5, 200)])
def test_noise_of_the_estimate_ends_nothing(metres: float, std: float, every: int) -> None:
    """Short by less than its standard deviation, or by much for a while."""
    player, _, _ = follow()
    left = following().tracking.length - following().tracking.arc_length
    for number in range(1500):
        lacks = every == 1 or number % every
        battery = reaching(left + (metres if lacks and number else 1.0), std)
        assert player.tick(battery=battery).command.speed > 0.0


def test_a_step_that_comes_to_rest_for_something_else_does_not_end_with_battery_short() -> None:
    """The mission does already what it says for a low battery."""
    player, _, steps = follow()
    left = following().tracking.length - following().tracking.arc_length
    player.tick(battery=reaching(left + 0.1))
    for _ in range(round(CERTAIN / PERIOD) + 1):
        player.tick(battery=reaching(left - 1.0))
    steps.rests = True
    moving = player.tick(battery=reaching(left - 1.0), standing=False, set_points=SetPoints(steering=0.2))
    assert (moving.command, moving.outcome, moving.event) == (DriveCommand(steering=0.2), "", None)
    ended = player.tick(battery=reaching(left - 1.0))
    assert (ended.outcome, ended.event) == ("", Event.DONE)


def test_steps_in_which_the_battery_may_be_charged_have_no_length() -> None:
    asked = Compare("charge_percent", ">", 80.0)
    plan = shared(
        FollowStep(route=ROUTE, follower=StubFollower()),
        WaitStep(condition=Compare("run_s", ">", 80.0)),
        WaitStep(condition=Both((Not(asked), Has("stick.done")))),
        AskStep(question="charged?"),
        TeleopStep(input="stick", seconds=None),
    ).plan
    assert [plan.length_of(number) for number in range(5)] == [ROUTE.length, 0.0, None, None, None]


def test_a_path_is_begun_only_where_the_battery_reaches_all_that_is_certain_to_follow() -> None:
    step = FollowStep(route=ROUTE, follower=StubFollower())
    player = Player(FollowMode(shared(step, step)))
    player.world["battery"] = reaching(1.5 * ROUTE.length)
    player.enter()
    assert player.tick().phase == "8 m to drive, the battery reaches 6 m"
