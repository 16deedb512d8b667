"""Mode follow to the centimetre and the tick: limits, times, and what of a path is left."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from core_builders import (
    PATH,
    ROBOT,
    ROUTE,
    Player,
    StubFollower,
    fault_of,
    following,
    has_fault,
    shared,
    snapshot,
)
from msgspec.structs import replace
from test_mode_follow import PathTaker, along, driven, follow
from test_mode_goto import VALUES

from artemis.battery import BatteryState
from artemis.drive_states import Goal
from artemis.motion.path import path_from_points
from artemis.motion.planned_route import packed_route
from artemis.motion.route import Part, Route
from artemis.motion.track import Track
from artemis.plugins.contracts import Following
from artemis.progress import SHORT
from artemis.scan import Clearance
from artemis.states.follow import FollowMode, place_fault
from artemis.states.plan import FollowStep, GotoStep, Shared, WaitStep
from artemis.supervision import catalogue
from artemis.values import (
    DriveCommand,
    Event,
    Fault,
    LocatedPose,
    Odometry,
    Pose,
    SetPoints,
    Severity,
    Snapshot,
    Verdict,
    Wish,
)


def stepped(mode: FollowMode, time: float, dt: float = 0.02, **changes: Any) -> Wish:
    return mode.step(replace(snapshot(time, **changes), dt=dt))


def fault_at(mode: FollowMode, time: float, dt: float) -> str | None:
    fault = stepped(mode, time, dt).fault
    return None if fault is None else fault.id


@pytest.mark.parametrize(("speed", "longest"), [(None, 2 * 4.0 / 0.05 + 10.0), (0.4, 2 * 4.0 / 0.4 + 10.0)])
def test_a_path_may_take_twice_its_time_and_ten_seconds(speed: float | None, longest: float) -> None:
    _, _, steps = follow(lambda: following(arc_length=1.5), speed=speed)
    mode = FollowMode(steps)
    mode.enter(snapshot())
    assert fault_at(mode, 1.0, longest) is None
    wish = stepped(mode, 2.0, 0.01)
    assert fault_of(wish) == ("PTH-08", "")
    assert wish.fault is not None
    assert wish.fault.text.endswith(f"(at 1.50 m of 4.00 m after {longest:.0f} s)")


def test_each_part_of_a_path_has_ten_seconds_more() -> None:
    route = Route((Part(path=PATH), Part(path=PATH, backward=True)))
    mode = FollowMode(
        shared(FollowStep(route=route, follower=StubFollower(lambda: following(arc_length=1.0)), speed=0.4))
    )
    mode.enter(snapshot())
    assert fault_at(mode, 1.0, 2 * 8.0 / 0.4 + 20.0) is None
    assert fault_at(mode, 1.02, 0.01) == "PTH-08"


def test_time_that_an_obstacle_takes_does_not_count() -> None:
    _, _, steps = follow(lambda: following(arc_length=1.0), speed=0.4)
    mode = FollowMode(steps)
    mode.enter(snapshot())
    blocked = SetPoints(clearance=Clearance(distance=0.1, blocked=1.0))
    assert stepped(mode, 1.0, 1000.0, set_points=blocked).fault is None
    assert fault_at(mode, 2.0, 29.5) is None
    assert fault_at(mode, 3.0, 2.0) == "PTH-08"


def test_time_in_which_a_fault_keeps_the_robot_slow_counts_as_much_as_it_drives() -> None:
    _, _, steps = follow(lambda: following(arc_length=1.0), speed=0.4)
    mode = FollowMode(steps)
    mode.enter(snapshot())
    slow = {"set_points": SetPoints(speed=-0.1), "verdict": Verdict(severity=Severity.LIMIT)}
    assert stepped(mode, 1.0, 4 * 29.5, **slow).fault is None
    assert fault_at(mode, 2.0, 1.0) == "PTH-08"


@pytest.mark.parametrize(("arc", "ends"), [(3.9905, True), (3.9895, False)])
def test_a_part_is_over_a_centimetre_before_its_end(arc: float, ends: bool) -> None:
    player, _, _ = follow()
    assert driven(player, (arc, 1.0), (arc, 1.3)) == [False, ends]


def test_beyond_the_end_is_told_with_how_far() -> None:
    player, _, _ = follow(lambda: following(arc_length=4.0))
    assert player.tick(odometry=Odometry(distance=0.0)).fault is None
    assert player.tick(odometry=Odometry(distance=0.2)).fault is None, "two decimetres"
    wish = player.tick(odometry=Odometry(distance=0.25))
    assert fault_of(wish) == ("PTH-08", "")
    assert wish.fault is not None
    assert wish.fault.text.endswith("(0.25 m beyond the end)")


def test_a_centimetre_before_the_end_counts_as_there() -> None:
    answer = following(arc_length=0.0)
    player, _, _ = follow(lambda: replace(answer, tracking=replace(answer.tracking, length=0.01)))
    assert player.tick(odometry=Odometry(distance=0.0)).fault is None
    assert fault_of(player.tick(odometry=Odometry(distance=0.3))) == ("PTH-08", "")


@pytest.mark.parametrize(
    ("start", "is_refused"),
    [
        (following(cross_track=1.0), False),
        (following(heading_error=math.radians(60)), False),
        (following(heading_error=-math.radians(61)), True),
        (following(cross_track=1.0001), True),
    ],
)
def test_how_far_away_a_path_may_be_begun(start: Following, is_refused: bool) -> None:
    player, _, _ = follow(lambda: start, max_cross_track=2.0)
    assert has_fault(player.tick()) is is_refused


def test_a_place_is_told_with_side_angle_and_distance() -> None:
    player, _, _ = follow(lambda: following(cross_track=-1.5, heading_error=0.5, arc_length=0.7))
    wish = player.tick()
    assert wish.fault is not None
    assert wish.fault.text.endswith("(-1.50 m, +29 degrees at 0.70 m)")
    assert wish.tracking == following(cross_track=-1.5, heading_error=0.5, arc_length=0.7).tracking


def test_a_metre_that_kept_the_limit_arms_it_exactly() -> None:
    player, follower, _ = follow(max_cross_track=0.3)
    near, far = following(cross_track=0.3), following(cross_track=0.31)
    assert not any(map(has_fault, along(player, [near, near, far], follower, [0.0, 0.999, 0.999])))
    player, follower, _ = follow(max_cross_track=0.3)
    assert [has_fault(wish) for wish in along(player, [near, near, far], follower, [0.0, 1.0, 1.0])] == [False] * 2 + [
        True
    ]


def test_five_metres_arm_the_limit_exactly() -> None:
    far = following(cross_track=0.5)
    for distance, is_lost in ((4.999, False), (5.0, True)):
        player, follower, _ = follow(max_cross_track=0.3)
        assert [has_fault(wish) for wish in along(player, [far, far], follower, [0.0, distance])] == [False, is_lost]


def test_where_the_robot_is_has_to_be_known() -> None:
    known = LocatedPose()
    assert place_fault(snapshot(pose=known), localized=True) is None
    assert place_fault(snapshot(pose=replace(known, contradicted=0.35)), localized=True) is None
    assert place_fault(snapshot(pose=replace(known, contradicted=0.36)), localized=True) is not None
    contradicted = place_fault(snapshot(pose=replace(known, contradicted=0.44)), localized=True)
    assert contradicted is not None
    assert contradicted.id == "LOC-02"
    assert contradicted.text.endswith("(for 0.4 s)")
    unlocalized = place_fault(snapshot(pose=replace(known, lost=True)), localized=False)
    assert unlocalized is not None
    assert (unlocalized.id, unlocalized.device) == ("RUN-08", "")
    for age, words in ((None, "no fix yet"), (1.26, "the last fix is 1.3 s old")):
        lost = place_fault(snapshot(pose=replace(known, lost=True, age=age)), localized=True)
        assert lost is not None
        assert (lost.id, lost.device) == ("LOC-01", "")
        assert lost.text.endswith(f"({words})")


def test_a_robot_that_a_localizer_places_waits_for_its_fix() -> None:
    steps = shared(FollowStep(route=ROUTE, follower=StubFollower()))
    steps.plan = replace(steps.plan, localized=True)
    wish = Player(FollowMode(steps)).tick(pose=LocatedPose(lost=True))
    assert fault_of(wish) == ("LOC-01", "")


def test_a_step_of_another_kind_is_over_for_it() -> None:
    player = Player(FollowMode(shared(WaitStep(seconds=1.0))))
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert (wish.event, wish.command) == (Event.DONE, DriveCommand(steering=0.2))


def test_a_mode_that_was_not_entered_stands() -> None:
    wish = stepped(FollowMode(follow()[2]), 0.0, set_points=SetPoints(steering=0.2))
    assert (wish.command, wish.fault, wish.event) == (DriveCommand(steering=0.2), None, None)


def recorded(**options: Any) -> tuple[FollowMode, PathTaker]:
    follower = PathTaker()
    steps = shared(FollowStep(route="shown", follower=follower, **options))
    track = Track()
    for x in np.arange(0.0, 3.01, 0.05):
        track.add(Pose(x=float(x)))
    steps.route.drive(packed_route(track.route(ROBOT, None)))
    mode = FollowMode(steps)
    mode.enter(snapshot())
    stepped(mode, 0.0)
    return mode, follower


def test_a_recorded_path_is_followed_as_its_step_says() -> None:
    _, there = recorded()
    assert there.path.at(0.0).x == pytest.approx(0.0, abs=0.01)
    assert there.path.length == pytest.approx(3.0, abs=0.02)
    assert there.path.speed_at(1.0) is None or there.path.speed is None
    _, back = recorded(from_end=True)
    assert back.path.at(0.0).x == pytest.approx(3.0, abs=0.01)
    mode, _ = recorded(backward=True)
    assert stepped(mode, 0.1).command.speed == pytest.approx(-0.3)


def test_laps_of_a_recorded_path_that_is_open_are_a_fault() -> None:
    follower = PathTaker()
    steps = shared(FollowStep(route="shown", follower=follower, laps=2))
    steps.route.drive(packed_route(ROUTE))
    player = Player(FollowMode(steps))
    for _ in range(2):
        wish = player.tick(set_points=SetPoints(steering=0.2))
        assert fault_of(wish) == ("PTH-01", "")
        assert wish.fault is not None
        assert wish.fault.severity is Severity.CONTROLLED_STOP
        assert "laps: 2" in wish.fault.text
        assert wish.command == DriveCommand(steering=0.2)


@pytest.mark.parametrize(("changes", "again"), [({}, False), ({"entry": 1}, True), ({"planned": (1, 2)}, True)])
def test_what_was_interrupted_goes_on_unless_it_was_begun_anew(changes: dict[str, Any], again: bool) -> None:
    player, follower, steps = follow()
    player.tick()
    steps.entry = changes.get("entry", steps.entry)
    steps.route.drive(changes.get("planned", steps.route.planned))
    player.enter()
    player.tick()
    assert follower.starts == 1 + again


def test_wheels_are_turned_again_after_an_interruption() -> None:
    player, _, _ = follow()
    assert player.tick().command.speed == 0.3, "its 6 degrees are near enough"
    player.enter()
    assert player.tick(odometry=Odometry(steering=-0.5)).command == DriveCommand(speed=0.0, steering=0.1)


def test_a_new_step_has_its_own_time() -> None:
    answer = following(arc_length=1.0)
    steps = shared(*(FollowStep(route=ROUTE, follower=StubFollower(lambda: answer), speed=0.4) for _ in range(2)))
    mode = FollowMode(steps)
    mode.enter(snapshot())
    assert fault_at(mode, 1.0, 29.0) is None
    mode.enter(snapshot(2.0))
    assert fault_at(mode, 2.0, 2.0) == "PTH-08", "an interruption does not begin it anew"
    steps.position = replace(steps.position, step=1)
    mode.enter(snapshot(3.0))
    assert fault_at(mode, 3.0, 29.0) is None


def test_gains_on_trial_are_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    shaking = catalogue.fault("CAL-01", "traction-left", "oscillates")
    made = []

    class Detector:
        def __init__(self, *given: Any) -> None:
            made.append(given)

        def look(self, seen: Snapshot) -> Fault | None:
            return shaking

    monkeypatch.setattr("artemis.states.follow.OscillationDetector", Detector)
    player, _, steps = follow()
    assert player.tick().fault is None
    assert not made
    steps.results.tried["traction-left"] = (1, 2, 3, 4, 5, 6, 7)
    seen = snapshot(player.time)
    player.enter(seen)
    assert made == [(steps.plan, steps.results.tried, seen)]
    wish = player.tick(set_points=SetPoints(steering=0.2))
    assert (wish.fault, wish.command) == (shaking, DriveCommand(steering=0.2))
    assert wish.tracking is not None
    steps.results.tried.clear()
    player.enter()
    assert player.tick().fault is None


def with_battery(range_m: float) -> BatteryState:
    return BatteryState(volts=24.0, charge=0.5, charge_std=0.01, watts=10.0, range_m=range_m)


@pytest.mark.parametrize(("range_m", "is_short"), [(3.99, True), (4.0, False)])
def test_a_path_that_the_battery_does_not_reach_is_not_begun(range_m: float, is_short: bool) -> None:
    _, follower, steps = follow()
    mode = FollowMode(steps)
    seen = replace(snapshot(set_points=SetPoints(steering=0.2)), battery=with_battery(range_m))
    mode.enter(seen)
    moving = mode.step(replace(seen, standing=False))
    wish = mode.step(seen)
    assert (follower.steps == 0) is is_short
    if is_short:
        assert (moving.event, moving.outcome, moving.phase) == (None, "", "4 m to drive, the battery reaches 4 m")
        assert (wish.event, wish.outcome, wish.command) == (Event.DONE, SHORT, DriveCommand(steering=0.2))
        mode.enter(snapshot())
        assert mode.step(snapshot()).event is None, "it is looked at anew"
        assert follower.steps == 1


def test_the_paths_of_later_steps_count_for_the_battery() -> None:
    steps = shared(*(FollowStep(route=ROUTE, follower=StubFollower()) for _ in range(2)))
    mode = FollowMode(steps)
    mode.enter(replace(snapshot(), battery=with_battery(7.9)))
    assert mode.step(snapshot()).outcome == SHORT


def test_the_step_rests_where_something_else_is_next() -> None:
    player, _, steps = follow()
    player.tick()
    steps.rests = True
    moving = player.tick(standing=False, set_points=SetPoints(steering=0.2))
    assert (moving.event, moving.command, moving.over) == (None, DriveCommand(steering=0.2), False)
    steps.rests = True
    still = player.tick()
    assert (still.event, still.over, still.tracking) == (Event.DONE, False, following().tracking)


def test_what_it_wants_of_the_drives() -> None:
    player, _, _ = follow()
    wish = player.tick()
    assert (wish.traction, wish.steering, wish.phase) == (Goal.ENABLED, Goal.ENABLED, "following")
    ended, _, _ = follow(lambda: following(finished=True, arc_length=3.9))
    moving = ended.tick(standing=False, set_points=SetPoints(steering=0.3))
    assert (moving.over, moving.command) == (False, DriveCommand(steering=0.3))
    still = ended.tick(set_points=SetPoints(steering=0.3))
    assert (still.over, still.event, still.command) == (True, Event.DONE, DriveCommand(steering=0.3))


@pytest.mark.parametrize(("done", "begins"), [(0.0, 1.0), (1.25, 1.25)])
def test_the_nearest_place_counts_until_something_is_done(done: float, begins: float) -> None:
    follower = PathTaker()
    steps = shared(FollowStep(route=ROUTE, follower=follower, nearest=True), done=done)
    Player(FollowMode(steps)).tick(odometry=Odometry(pose=Pose(x=1.0)))
    assert follower.path.at(0.0).x == pytest.approx(begins, abs=PATH.spacing)


def test_on_a_closed_path_the_nearest_place_always_counts() -> None:
    angles = np.linspace(0.0, math.tau, 60)
    circle = path_from_points(np.sin(angles), 1.0 - np.cos(angles), closed=True)
    follower = PathTaker()
    steps = shared(FollowStep(route=Route((Part(path=circle),)), follower=follower, nearest=True), done=1.0)
    Player(FollowMode(steps)).tick(odometry=Odometry(pose=Pose(x=0.0, y=2.0, heading=math.pi)))
    assert (follower.path.at(0.0).x, follower.path.at(0.0).y) == pytest.approx((0.0, 2.0), abs=0.1)
    assert follower.path.length == pytest.approx(circle.length - 1.0, abs=0.1)


# ---------------------------------------------------------------------------------------------- to a place


def going() -> tuple[FollowMode, Shared]:
    steps = shared(GotoStep(route="", place="gate", follower=PathTaker(), speed=0.4))
    steps.route.drive(VALUES)
    mode = FollowMode(steps)
    mode.enter(snapshot())
    return mode, steps


def test_another_goal_is_waited_for_at_rest() -> None:
    mode, steps = going()
    stepped(mode, 0.0)
    steps.route.drive(())
    moving, still = (stepped(mode, 0.1, standing=standing) for standing in (False, True))
    assert (moving.event, moving.command.speed) == (None, 0.0)
    assert (still.event, still.over) == (Event.DONE, False)
