"""What an operator at a page does besides driving: goals, poses, answers, a wheel that is turned; how old it may be."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace
from page_rig import Recorded, recorded
from test_page_input import Hand
from test_page_sessions import Page, driving

from artemis.bridges.operator.session import Arrived, Given, GivenAnswer, GivenPose, LinkReport
from artemis.bridges.page.session import FRESH, PageSeats, ZoneChange
from artemis.plugins.inputs.page import JOG_EVERY, TENTHS, PageInputConfig
from artemis.progress import Position
from artemis.states.homing import STRAIGHT
from artemis.states.requests import by_hand
from artemis.states.steering import KEEP, START, TURN_IT
from artemis.values import LocatedPose, Mode, Pose, Request, Tick

GOAL: dict[str, Any] = {"t": "pose", "kind": "goal_pose", "x": 3.0, "y": -1.5, "heading": 0.5}
ALLOWED = PageInputConfig(allow=("goal_pose", "initialpose"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return recorded("figure_eight.yaml", 9.0, tmp_path_factory.mktemp("runs"))


@pytest.fixture
def seats() -> PageSeats:
    return PageSeats()


def acts(page: Page, now: float, beat: int = 1, **words: object) -> None:
    page.sequence += 1
    page.say(now, seq=page.sequence, beat=beat, **words)


def gave(*given: Given, asked: float = 0.0) -> LinkReport:
    return LinkReport("held", "phone", 0.0, given=list(given), asked=asked)


# ---------------------------------------------------------------------------------------------------- the page's end


def test_a_pose_and_an_answer_are_passed_on_with_the_time_of_the_beat_that_they_quote(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    acts(page, 1.1, **GOAL)
    acts(page, 1.15, t="answer", step=4, text="left")
    assert seats.report.given == [GivenPose("goal_pose", 3.0, -1.5, 0.5), GivenAnswer(4, "left")]
    assert seats.report.asked == 1.0


def test_only_who_has_control_acts_and_not_by_an_old_beat(seats: PageSeats) -> None:
    page, other = driving(seats, 1.0), Page(seats, "10.0.0.3")
    acts(other, 1.1, **GOAL)
    acts(page, 1.0 + FRESH + 0.01, **GOAL)
    assert seats.report.given == []
    assert other.heard("act") == [{"t": "act", "why": "take control first"}]
    assert page.heard("act") == [{"t": "act", "why": "it came too late: do it again"}]


def test_an_act_that_comes_again_counts_once(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    acts(page, 1.1, **GOAL)
    page.say(1.12, seq=page.sequence, beat=1, **GOAL)
    assert len(seats.report.given) == 1


def test_a_pose_beyond_the_world_ends_the_connection(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    acts(page, 1.1, **{**GOAL, "x": 1e7})
    assert seats.report.given == []
    assert [row for row, _ in seats.report.problems] == ["NET-09"]


def test_zones_are_changed_where_the_page_says_and_the_reason_comes_back(seats: PageSeats) -> None:
    page, asked = driving(seats, 1.0), list[ZoneChange]()
    acts(page, 1.05, t="zone", map="hall.yaml", known="", remove=1)
    assert page.heard("act")[-1]["why"] == "this run plans no routes: it has no zones"
    seats.change_zones = lambda change, told: (asked.append(change), told(""))[1]  # type: ignore[func-returns-value]
    acts(page, 1.1, t="zone", map="hall.yaml", known="ab", name="wet", corners=[[0, 0], [1, 0], [1, 1]])
    assert page.heard("act")[-1]["why"] == ""
    assert (asked[0].name, asked[0].corners) == ("wet", ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))


# ---------------------------------------------------------------------------------------------------- the run's end


def test_a_request_that_waited_while_the_run_stalled_has_no_effect_but_a_stop_has() -> None:
    hand = Hand()
    hand.now = 5.0
    both = [Request.ARM, Request.QUICKSTOP, Request.ACKNOWLEDGE]
    hand.port.reports.append(LinkReport("held", "phone", 0.0, requests=both, asked=5.0 - FRESH - 0.01))
    assert hand.input.read(5.0).requests == (Request.QUICKSTOP,)
    (problem,) = [text for row, text in hand.input.take_problems() if row == "NET-04"]
    assert problem == "phone: arm, acknowledge: 0.3 s old, without effect; ask again"


def test_a_request_that_was_heard_between_two_ticks_grows_old_until_the_next() -> None:
    hand = Hand()
    hand.port.reports.append(LinkReport("held", "phone", 0.0, requests=[Request.ARM], asked=0.0))
    hand.port.news()
    hand.now = 2.0
    assert hand.input.read(2.0).requests == ()


def test_a_request_that_is_young_enough_counts() -> None:
    hand = Hand()
    hand.now = 1.0
    hand.port.reports.append(LinkReport("held", "phone", 0.0, requests=[Request.ARM], asked=1.0 - FRESH + 0.01))
    assert hand.input.read(1.0).requests == (Request.ARM,)


def test_poses_that_the_mission_allows_are_in_the_next_sample_once() -> None:
    hand = Hand(ALLOWED)
    hand.port.reports.append(gave(GivenPose("goal_pose", 1.0, 2.0, 0.5), GivenPose("initialpose", 3.0, 4.0, 0.1)))
    sample = hand.input.read(0.0)
    assert sample.goal == Pose(x=1.0, y=2.0, heading=0.5)
    assert sample.initial_pose == LocatedPose(pose=Pose(x=3.0, y=4.0, heading=0.1), frame="map", source="page")
    assert hand.input.read(0.02).goal is None


@pytest.mark.parametrize("kind", ["goal_pose", "initialpose"])
def test_a_pose_that_the_mission_does_not_allow_is_refused_with_the_words_that_allow_it(kind: str) -> None:
    hand = Hand()
    hand.port.reports.append(gave(GivenPose(kind, 1.0, 2.0, 0.5)))  # type: ignore[arg-type]
    sample = hand.input.read(0.0)
    assert (sample.goal, sample.initial_pose) == (None, None)
    told = f"{kind}: the mission does not allow it: inputs: page: {{allow: [{kind}]}}"
    assert ("NET-14", told) in hand.input.take_problems()


def at(run: Recorded, mode: Mode, step: int) -> Tick:
    return replace(run.ticks[0][0], mode=mode, position=Position(step=step))


def test_an_answer_counts_for_the_step_that_asks(run: Recorded) -> None:
    hand = Hand()
    hand.input.show(at(run, Mode.READY, 3))
    hand.port.reports.append(gave(GivenAnswer(3, "left")))
    assert hand.input.read(0.0).answers == ("left",)
    hand.port.reports.append(gave(GivenAnswer(2, "left")))
    assert hand.input.read(0.0).answers == ()
    assert ("NET-04", "phone: 'left' answers a question that is over") in hand.input.take_problems()


def jogs(hand: Hand, seconds: float, turn: float, *, held: bool = True) -> list[Request]:
    found: list[Request] = []
    for _ in range(round(seconds / 0.02)):
        hand.now += 0.02
        axes = (0.0, 0.0, turn) if held else (0.0, 0.0)
        newest = Arrived(hand.now, True, held, not held, 0.0, 0.0, 0.0, axes)
        hand.port.reports.append(LinkReport("held", "phone", 0.0, newest=newest))
        found += hand.input.read(hand.now).requests
    return found


@pytest.mark.parametrize(("turn", "way", "each"), [(0.2, Request.LEFT_TENTH, 1), (-1.0, Request.RIGHT_TENTH, TENTHS)])
def test_a_wheel_turns_while_its_button_is_held(run: Recorded, turn: float, way: Request, each: int) -> None:
    hand = Hand()
    hand.input.show(at(run, Mode.CALIBRATE, 0))
    assert jogs(hand, 0.5, turn) == [], "held since before"
    jogs(hand, 0.1, 0.0, held=False)
    found = jogs(hand, 1.0, turn)
    assert set(found) == {way}
    assert len(found) == pytest.approx(each / JOG_EVERY, abs=each)
    assert jogs(hand, 0.1, 0.0, held=False) == []
    jogs(hand, 0.1, turn)
    before = hand.now
    for _ in range(50):
        hand.now += 0.02
        late = hand.input.read(hand.now).requests
        assert not late or hand.now - before <= FRESH, "the link is cut, and nothing turns on"


def test_no_wheel_turns_by_hand_outside_of_a_calibration(run: Recorded) -> None:
    hand = Hand()
    hand.input.show(at(run, Mode.TELEOP, 0))
    jogs(hand, 0.1, 0.0, held=False)
    assert jogs(hand, 0.5, 0.2) == []
    assert hand.input.read(hand.now).speed == 0.0


@pytest.mark.parametrize(
    ("mode", "phase", "found"),
    [
        (Mode.INIT, STRAIGHT, (True, False)),
        (Mode.INIT, "first contact", (False, False)),
        (Mode.CALIBRATE, f"left wheel at +0.0 deg: {TURN_IT}", (True, True)),
        (Mode.CALIBRATE, f"keep clear: {START}", (True, False)),
        (Mode.CALIBRATE, f"keep this? {KEEP}", (True, False)),
        (Mode.CALIBRATE, "reading the left wheel", (False, False)),
        (Mode.TELEOP, TURN_IT, (False, False)),
    ],
)
def test_a_page_knows_what_a_person_is_waited_for(
    run: Recorded, mode: Mode, phase: str, found: tuple[bool, bool]
) -> None:
    tick = at(run, mode, 0)
    assert by_hand(replace(tick, wish=replace(tick.wish, phase=phase))) == found
