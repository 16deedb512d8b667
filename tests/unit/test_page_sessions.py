"""Operators at a page: who has the seat, what counts, what Stop needs. Words and times only."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.bridges.operator.frames import MalformedFrame
from artemis.bridges.operator.session import BEAT_EVERY, BURST, DEAD, REPLAYS
from artemis.bridges.page.session import FRESH, PageSeats, PageSession, said
from artemis.values import Request


class Page:
    """A browser, as far as its words go."""

    def __init__(self, seats: PageSeats, who: str = "10.0.0.2") -> None:
        self.told: list[dict[str, Any]] = []
        self.session = PageSession(seats, who, 0.0, self.told.append)
        self.sequence = 0

    def say(self, now: float, **words: object) -> None:
        self.session.receive(json.dumps(words), now)

    def take(self, now: float = 0.0, who: str = "phone") -> None:
        self.say(now, t="take", who=who)

    def hold(self, now: float, beat: int | None = None, **words: object) -> None:
        self.sequence += 1
        beats = [message["n"] for message in self.told if message["t"] == "beat"]
        self.say(now, t="hold", seq=self.sequence, beat=beats[-1] if beat is None else beat, **words)

    def heard(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.told if message["t"] == kind]


@pytest.fixture
def seats() -> PageSeats:
    return PageSeats()


def driving(seats: PageSeats, now: float = 1.0) -> Page:
    page = Page(seats)
    page.take(now)
    seats.beat(now)
    page.hold(now)
    return page


def test_a_command_counts_from_the_beat_that_it_quotes(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    seats.beat(1.05)
    page.hold(1.07, held=True, neutral=False, x=0.5, y=-0.25)
    newest = seats.report.newest
    assert seats.report.seat == "held"
    assert newest is not None
    assert (newest.sent, newest.enabled, newest.axes) == (1.05, True, (0.5, -0.25))


def test_a_command_that_quotes_an_old_beat_does_not_count(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    before = seats.report.newest
    seats.beat(1.2)
    page.hold(1.0 + FRESH + 0.01, beat=1, held=True, neutral=False, y=1.0)
    assert seats.report.newest is before
    assert seats.report.late is not None
    page.hold(1.4, beat=2)
    assert [row for row, _ in seats.report.problems] == ["NET-04"]


def test_only_one_has_the_seat(seats: PageSeats) -> None:
    first, second = driving(seats), Page(seats, "10.0.0.3")
    second.take(1.1)
    assert second.heard("refused") == [{"t": "refused", "why": "phone at 10.0.0.2 has control"}]
    assert ("NET-08", "10.0.0.3 was refused: phone at 10.0.0.2 has control") in seats.report.problems
    second.say(1.2, t="hold", seq=1, beat=1, held=True, neutral=False, y=1.0, ask=["end"])
    assert seats.report.requests == []
    assert seats.report.newest is not None
    assert not seats.report.newest.enabled
    first.say(1.3, t="release")
    second.take(1.4)
    assert (seats.report.seat, seats.owner) == ("held", second.session)


def test_who_takes_the_seat_again_begins_anew(seats: PageSeats) -> None:
    """Beats of the first time cannot be quoted, and numbers begin at one."""
    page = driving(seats, 1.0)
    page.say(1.1, t="release")
    assert seats.owner is None
    page.sequence = 0
    page.take(1.2)
    assert seats.report.newest is None
    page.hold(1.21, beat=1, held=True, neutral=False)
    assert seats.owner is None, "a beat that was not sent"
    assert seats.report.seat == "lost"


def test_a_page_that_is_gone_or_silent_has_lost_the_seat(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    page.session.left(1.2)
    assert (seats.report.seat, seats.report.why) == ("lost", "the connection was closed")
    page = driving(seats, 2.0)
    seats.beat(2.0 + DEAD + 0.01)
    assert (seats.report.seat, seats.report.why) == ("lost", "nothing was received for 1 s")
    assert page.heard("parted")
    page.sequence = 0
    page.take(4.0)
    assert seats.report.seat == "held"


@pytest.mark.parametrize("taken", [False, True])
def test_stop_needs_no_seat_and_counts_once_for_its_two_ways(seats: PageSeats, taken: bool) -> None:
    driver = driving(seats) if taken else None
    other = Page(seats, "10.0.0.3")
    other.say(1.5, t="stop", id="a1")
    seats.stop("10.0.0.3", said('{"t":"stop","id":"a1"}'), 1.6)  # type: ignore[arg-type]
    assert seats.report.requests == [Request.QUICKSTOP]
    assert other.heard("stopping") == [{"t": "stopping", "id": "a1"}]
    other.say(1.7, t="stop", id="a2")
    assert seats.report.requests == [Request.QUICKSTOP] * 2
    assert driver is None or seats.owner is driver.session


def test_a_stop_on_a_page_that_was_not_told_of_the_robot_is_said(seats: PageSeats) -> None:
    Page(seats).say(1.0, t="stop", id="x", stale=True)
    assert seats.report.requests == [Request.QUICKSTOP]
    assert [row for row, _ in seats.report.problems] == ["NET-11"]


def test_what_may_be_asked_for(seats: PageSeats) -> None:
    page = driving(seats)
    page.hold(1.01, ask=["acknowledge", "arm", "done", "end", "record"])
    wanted = [Request.ACKNOWLEDGE, Request.ARM, Request.DONE, Request.END, Request.RECORD]
    assert seats.report.requests == wanted


def test_requests_of_an_old_command_have_no_effect(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    page.hold(1.5, beat=1, ask=["arm"])
    assert seats.report.requests == []


def test_what_comes_again_is_dropped_and_ends_the_seat(seats: PageSeats) -> None:
    page = driving(seats)
    for _ in range(REPLAYS):
        page.say(1.01, t="hold", seq=1, beat=1, held=True, neutral=False, y=1.0)
    assert seats.report.newest is None or not seats.report.newest.enabled
    assert (seats.report.seat, [row for row, _ in seats.report.problems]) == ("lost", ["NET-06"])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        '{"t":"hold"}',
        '{"t":"hold","seq":1,"beat":1,"x":2}',
        '{"t":"hold","seq":1,"beat":1,"x":NaN}',
        '{"t":"hold","seq":-1,"beat":1}',
        '{"t":"hold","seq":1,"beat":1,"ask":["quickstop"]}',
        '{"t":"stop"}',
        '{"t":"stop","id":""}',
        '{"t":"take","who":"x","more":1}',
        '{"t":"dance"}',
    ],
)
def test_what_cannot_be_read_ends_the_session(seats: PageSeats, text: str) -> None:
    page = driving(seats)
    page.session.receive(text, 1.1)
    assert page.session.closing
    assert (seats.report.seat, [row for row, _ in seats.report.problems]) == ("lost", ["NET-09"])


@given(st.one_of(st.text(), st.binary()))
def test_no_words_raise(text: str | bytes) -> None:
    try:
        said(text)
    except MalformedFrame:
        pass


def test_a_flood_is_dropped_unread(seats: PageSeats) -> None:
    page = driving(seats)
    for _ in range(int(BURST) + 50):
        page.say(1.0, t="ping", at=0.0)
    assert len(page.heard("pong")) < BURST
    assert [row for row, _ in seats.report.problems] == ["NET-10"]


def test_a_beat_tells_how_old_the_newest_command_was(seats: PageSeats) -> None:
    page = driving(seats, 1.0)
    page.hold(1.04, waited=30.0)
    seats.beat(1.0 + BEAT_EVERY)
    told = page.heard("beat")[-1]
    assert told["age"] == pytest.approx(0.04)
    assert told["trip"] == pytest.approx(0.01)
