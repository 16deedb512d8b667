"""Single words, numbers and edges of modes that whole runs show to people, or meet by chance."""

from __future__ import annotations

from itertools import count

import pytest
from core_builders import ROBOT, ROUTE, Player, StubFollower, drive, drives, judged, shared, snapshot
from msgspec.structs import replace

from artemis.drive_states import DriveState
from artemis.motion.track import Track
from artemis.progress import Position
from artemis.states.end import EndMode
from artemis.states.plan import (
    BringUp,
    CalibrateStep,
    FollowStep,
    Plan,
    Results,
    Shared,
    TeleopStep,
    WaitStep,
    with_followers,
)
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.values import DriveCommand, Event, JobKind, LocatedPose, OperatorInput, Pose, Request, SetPoints, Wish

# ---------------------------------------------------------------------------------------------- teleop

HELD = OperatorInput(source="stick", enabled=True, neutral=False, speed=0.3, steering=0.1, age=0.01)
TURNED = SetPoints(steering=0.2)
STANDS = DriveCommand(steering=0.2)


def by_hand(seconds: float | None = None, record: str = "") -> Player:
    player = Player(TeleopMode(shared(TeleopStep(input="stick", seconds=seconds, record=record))))
    player.world.update(inputs=(HELD,), set_points=TURNED)
    return player


def test_teleop_without_a_step_by_hand_is_done() -> None:
    assert Player(TeleopMode(shared(WaitStep(seconds=1.0)))).tick().event is Event.DONE


def test_step_by_hand_is_over_in_the_very_tick_of_its_time() -> None:
    for time, event in ((0.999, None), (1.0, Event.DONE)):
        mode = TeleopMode(shared(TeleopStep(input="stick", seconds=1.0)))
        mode.enter(snapshot(0.0))
        assert mode.step(snapshot(time, inputs=(HELD,))).event is event


def test_step_by_hand_says_what_it_does_and_holds_the_wheels_whenever_it_stands() -> None:
    player = by_hand()
    assert player.tick().phase == "driving"
    up = replace(HELD, enabled=False)
    wish = player.tick(inputs=(up,), standing=False)
    assert (wish.phase, wish.command) == ("hold the enable button to drive", STANDS)
    wish = player.tick(standing=False)
    assert (wish.phase, wish.command) == ("release the enable button, and press it again at standstill", STANDS)
    wish = player.tick(inputs=(replace(HELD, requests=(Request.DONE,)),), standing=False)
    assert (wish.phase, wish.command) == ("stopping", STANDS)
    wish = player.tick()
    assert (wish.event, wish.over, wish.command) == (Event.DONE, True, STANDS)


@pytest.mark.parametrize("record", ["", "way"])
def test_step_by_hand_records_between_two_presses_where_it_knows_to_be_and_only_if_it_is_to(record: str) -> None:
    player = by_hand(record=record)
    pressed = replace(HELD, requests=(Request.RECORD,))
    for number, (sample, lost) in enumerate(
        [(HELD, False), (pressed, False), (HELD, True), (HELD, False), (pressed, False), (HELD, False)]
    ):
        player.tick(inputs=(sample,), pose=LocatedPose(pose=Pose(x=0.5 * number), lost=lost))
    tracks = player.mode.shared.results.tracks
    assert {name: [pose.x for pose in track.poses] for name, track in tracks.items()} == (
        {"way": [0.5, 1.5]} if record else {}
    )


# ---------------------------------------------------------------------------------------------- end

OFF_STATES = [DriveState.SWITCH_ON_DISABLED, DriveState.FAULT, DriveState.NOT_READY, DriveState.START]


def end_after(state: DriveState, *times: float) -> list[Wish]:
    """An ordered end whose robot stands at 1 s, and one of whose drives then is in this state; wishes from then on."""
    mode = EndMode(shared(connected=True))
    mode.enter(snapshot(0.0))
    mode.step(snapshot(0.0))
    others = drives(drive("steer-left", state=state), state=DriveState.SWITCH_ON_DISABLED)
    return [mode.step(snapshot(time, drives=others)) for time in (1.0, *times)]


@pytest.mark.parametrize("state", DriveState)
def test_end_waits_half_a_second_for_every_drive_to_be_off(state: DriveState) -> None:
    first, second = end_after(state, 1.02)
    assert (first.phase, first.jobs, first.supervised) == ("ending", (), False)
    assert bool(second.jobs) is (state in OFF_STATES)
    *_, before, after = end_after(state, 1.49, 1.5) if state not in OFF_STATES else [Wish(), second]
    assert not before.jobs
    assert {job.kind for job in after.jobs} == {JobKind.DISARM}


def test_drive_that_is_not_disarmed_is_said_once_and_the_end_is_counted_as_failed() -> None:
    player = Player(EndMode(shared()))
    player.refused.add((JobKind.DISARM, "traction-left"))
    player.until(lambda wish: wish.finished)
    told = [wish for wish in player.wishes if wish.fault is not None]
    assert [(wish.fault.id, wish.fault.device, wish.failed) for wish in told if wish.fault] == [
        ("COM-34", "traction-left", True)
    ]
    assert "broken in the test" in str(told[0].fault)
    assert player.wishes[-1].phase == "ended"


@pytest.mark.parametrize("second", [False, True])
def test_end_gives_the_robot_files_gains_back_unless_another_artemis_has_the_drives(second: bool) -> None:
    steps = shared()
    gains = ROBOT.drives["steer-left"].gains
    assert gains is not None
    steps.results.tried["steer-left"] = (1, 2, 3, 4, 5, 6, 7)
    player = Player(EndMode(steps))
    if second:
        player.world["verdict"] = judged("COM-18", final=True)
    player.until(lambda wish: wish.finished)
    written = [job for job in player.jobs if job.kind is JobKind.WRITE_GAINS]
    assert [(job.drive, job.values) for job in written] == ([] if second else [("steer-left", gains.numbers)])
    assert not any(wish.exchange for wish in player.wishes)


# ---------------------------------------------------------------------------------------------- ready


@pytest.mark.parametrize("done", [0.0, 3.0])
def test_controls_that_nobody_releases_are_waited_for_ten_minutes_and_not_a_tick_longer(done: float) -> None:
    mode = ReadyMode(shared(TeleopStep(input="stick", seconds=None), done=done))
    mode.enter(snapshot(8.0))
    for time, event in ((8.0, None), (607.98, None), (608.0, None), (608.02, Event.END)):
        wish = mode.step(snapshot(time, inputs=(HELD,)))
        assert (wish.event, wish.phase) == (event, "release the controls")


def test_wait_is_over_in_the_very_tick_of_its_time_and_says_what_it_does() -> None:
    for time, over in ((1.98, False), (2.0, True)):
        mode = ReadyMode(shared(WaitStep(seconds=2.0)))
        mode.enter(snapshot(0.0))
        wish = mode.step(snapshot(time))
        assert (wish.over, wish.done, wish.phase) == (over, time, "waiting")


# ---------------------------------------------------------------------------------------------- the plan


def test_followers_are_changed_and_other_steps_are_not() -> None:
    steps = (CalibrateStep(), FollowStep(route=ROUTE, follower=StubFollower()), WaitStep(seconds=1.0))
    other = StubFollower()
    changed = with_followers(steps, lambda follower: other)
    assert (changed[0], changed[2]) == (steps[0], steps[2])
    assert isinstance(changed[1], FollowStep)
    assert changed[1].follower is other


def test_jobs_have_ids_of_their_own_whichever_way_they_are_made() -> None:
    bring_up = BringUp()
    first = bring_up.jobs(JobKind.SECURE, ("a", "b"), (1.0, 2.0))
    (alone,) = bring_up.job(JobKind.WRITE_GAINS, "c", 7, 8)
    last = bring_up.jobs(JobKind.CONFIGURE, ("d",))
    assert [(job.kind, job.drive, job.value, job.values) for job in (*first, alone, *last)] == [
        (JobKind.SECURE, "a", 1.0, ()),
        (JobKind.SECURE, "b", 2.0, ()),
        (JobKind.WRITE_GAINS, "c", 0.0, (7, 8)),
        (JobKind.CONFIGURE, "d", 0.0, ()),
    ]
    assert [job.id for job in (*first, alone, *last)] == [1, 2, 3, 4]
    with pytest.raises(ValueError, match="shorter"):
        bring_up.jobs(JobKind.SECURE, ("a", "b"), (1.0,))


def test_what_a_step_does_not_say_is_the_usual() -> None:
    follower = StubFollower()
    assert FollowStep(route=ROUTE, follower=follower) == FollowStep(
        route=ROUTE,
        follower=follower,
        laps=1,
        from_end=False,
        backward=None,
        nearest=False,
        max_cross_track=0.6,
        speed=None,
    )
    assert TeleopStep(input="stick", seconds=None) == TeleopStep(input="stick", seconds=None, speed=None, record="")
    assert CalibrateStep().replaces == ()


def test_run_that_is_gone_on_with_begins_where_the_earlier_one_ended_and_keeps_what_that_recorded() -> None:
    track = Track(poses=[Pose(x=1.0)])
    plan = Plan(robot=ROBOT, steps=(), begin=Position(step=2, done=0.5), start=Pose(x=3.0), tracks={"way": track})
    later, first = Shared(plan), Shared(Plan(robot=ROBOT, steps=()))
    assert (later.bring_up.placed, first.bring_up.placed) == (True, False)
    assert (later.position, first.position) == (Position(step=2, done=0.5), Position())
    assert (later.results.tracks, first.results.tracks) == ({"way": track}, {})
    assert later.results.tracks["way"] is not track, "the plan never changes"


def test_what_nobody_has_said_of_a_bring_up_or_of_a_run_is_not_so() -> None:
    assert BringUp(_ids=(ids := count(1))) == BringUp(
        armed=True, connected=False, aligned=False, placed=False, held=False, taken=False, stop=None, _ids=ids
    )
    assert Results() == Results(tracks={}, steering={}, kept={}, tried={})
    assert [Plan(robot=ROBOT, steps=(), found=found).blind for found in (None, {}, {"left": 0.1})] == [
        False, True, True,
    ]  # fmt: skip
