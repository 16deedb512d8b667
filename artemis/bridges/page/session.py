"""Operators at pages: the rules of every link, and what a page adds. Values and times only, no socket, no clock.

Every paired browser may watch and stop the robot. Only one has the seat; others are refused until it is given
back or lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta, Struct

from artemis.bridges.operator.frames import MalformedFrame, SentCommand
from artemis.bridges.operator.session import GivenAnswer, GivenPose, LinkSession, Seat, Seats
from artemis.bridges.poses import FARTHEST
from artemis.values import Request

FRESH = 0.3
"""A page's command counts until the beat that it quotes is so old [s]: a browser's timers leave gaps of 100 to 130 ms
where they should fire every 50 ms."""
STALE_PAGE = "NET-11"
MOST_CORNERS = 40
KNOWN_STOPS = 256
"""Presses of Stop are known by their ids; each arrives on two connections."""

Metres = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
Share = Annotated[float, Meta(ge=-1.0, le=1.0)]
Count = Annotated[int, Meta(ge=0, le=1 << 53)]
Id = Annotated[str, Meta(min_length=1, max_length=40)]
Word = Literal["acknowledge", "arm", "end", "done", "record", "accept"]
REQUESTS = {word: Request[word.upper()] for word in get_args(Word)}
"""Requests of the operator in the seat."""
Send = Callable[[dict[str, Any]], None]


class Take(Struct, frozen=True, tag_field="t", tag="take", forbid_unknown_fields=True):
    """Wants the seat."""

    who: Annotated[str, Meta(max_length=40)] = ""


class GiveBack(Struct, frozen=True, tag_field="t", tag="release", forbid_unknown_fields=True):
    """Gives it back."""


class Hold(Struct, frozen=True, tag_field="t", tag="hold", forbid_unknown_fields=True):
    """State of the controls; sent every 50 ms by the page in the seat, and when they are held or released."""

    seq: Count
    beat: Count
    """The newest that came."""
    waited: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0
    """How long that had been there [ms]."""
    held: bool = False
    neutral: bool = True
    x: Share = 0.0
    """To the right."""
    y: Share = 0.0
    """Forward."""
    jog: Share = 0.0
    """The wheel that is being calibrated, to the left: slowly up to a half, else faster."""
    ask: Annotated[tuple[Word, ...], Meta(max_length=8)] = ()


class PosePress(Struct, frozen=True, tag_field="t", tag="pose", forbid_unknown_fields=True):
    """A goal for the robot, or about where it is, in the frame `map`."""

    seq: Count
    beat: Count
    kind: Literal["goal_pose", "initialpose"]
    x: Metres
    y: Metres
    heading: Annotated[float, Meta(ge=-7.0, le=7.0)]
    """[rad]"""


class AnswerPress(Struct, frozen=True, tag_field="t", tag="answer", forbid_unknown_fields=True):
    """An answer to the question of a step of the mission."""

    seq: Count
    beat: Count
    step: Count
    text: Annotated[str, Meta(min_length=1, max_length=200)]


class ZoneChange(Struct, frozen=True, tag_field="t", tag="zone", forbid_unknown_fields=True):
    """A zone to keep out of is to be added beside a map, or one of any kind removed."""

    seq: Count
    beat: Count
    map: Annotated[str, Meta(max_length=300)]
    """The map's file as the mission names it."""
    known: Annotated[str, Meta(max_length=40)]
    """What zones the page shows, by their tag."""
    name: Annotated[str, Meta(max_length=64)] = ""
    """Of a new one."""
    corners: Annotated[tuple[tuple[Metres, Metres], ...], Meta(max_length=MOST_CORNERS)] = ()
    """Of a new one, in the frame of the map [m]; none: one is removed."""
    remove: Count = 0
    """Its number, from 1."""


class StopPress(Struct, frozen=True, tag_field="t", tag="stop", forbid_unknown_fields=True):
    """A request to stop the robot."""

    id: Id
    """Of the press."""
    stale: bool = False
    """The page had received no state for a while when it was pressed."""


class Ping(Struct, frozen=True, tag_field="t", tag="ping", forbid_unknown_fields=True):
    """A request to measure the round-trip time."""

    at: float


Act = PosePress | AnswerPress | ZoneChange
Said = Take | GiveBack | Hold | Act | StopPress | Ping
ChangeZones = Callable[[ZoneChange, Callable[[str], None]], None]
"""Changes zones beside the ticks of the page, and returns why it was refused; empty: it was done."""
_DECODER = msgspec.json.Decoder(Said)


def said(text: str | bytes) -> Said:
    """A message of a page. Raises MalformedFrame."""
    found: Said = decoded(_DECODER, text)
    return found


def decoded(decoder: msgspec.json.Decoder[Any], text: str | bytes) -> Any:  # noqa: ANN401 (of the decoder's type)
    """A message of a browser, of the kinds that a decoder knows. Raises MalformedFrame."""
    try:
        return decoder.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError) as error:
        raise MalformedFrame(str(error)) from None


class PageSeats(Seats):
    """All pages of one robot."""

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        """`changed` is called when another browser has the seat."""
        super().__init__(REQUESTS.values(), FRESH)
        self.reached = True
        """What operators want is passed on to the run."""
        self.change_zones: ChangeZones = lambda change, told: told("this run plans no routes: it has no zones")
        self._changed = changed
        self._stops: deque[str] = deque(maxlen=KNOWN_STOPS)

    def seat(self, link: LinkSession, now: float) -> None:
        """The page has the seat now."""
        super().seat(link, now)
        self.links[link] = None
        self._changed()

    def lose_run(self, now: float) -> None:
        """Nothing is passed on any more: no operator drives."""
        self.reached = False
        if self.owner is not None:
            self._leave("lost", now, "the run takes nothing from the page")

    def stop(self, who: str, press: StopPress, now: float) -> None:
        """A paired browser presses Stop; the second message of the same press changes nothing.

        It is kept for a run that is not reached yet.
        """
        if press.id in self._stops:
            return
        self._stops.append(press.id)
        self.ask(Request.QUICKSTOP)
        if press.stale:
            self.tell(STALE_PAGE, f"{who} pressed Stop while the page received nothing from the robot", now)

    def _leave(self, seat: Seat, now: float, why: str) -> None:
        if self.owner is not None:
            self.links.pop(self.owner, None)
        super()._leave(seat, now, why)
        self._changed()


class PageSession(LinkSession):
    """One page, as long as it is connected."""

    def __init__(self, end: PageSeats, who: str, now: float, send: Send) -> None:
        """`who` is its name for people; `send` sends it a message, and never waits."""
        super().__init__(end, who, now)
        self._seats, self._send = end, send

    def receive(self, text: str | bytes, now: float) -> None:
        """Take its message at `now` [s]."""
        if self.closing or not self._may_be_read(now):
            if self._dropped:
                self._seats.tell("NET-10", f"{self.who}: {self._dropped} messages dropped unread", now)
                self._dropped = 0
            return
        try:
            self._obey(said(text), now)
        except MalformedFrame as error:
            self._seats.tell("NET-09", f"{self.who}: {error}", now)
            self._part(now, "it sent what cannot be read")

    def tell(self, message: dict[str, Any]) -> None:
        """Send it a message."""
        self._send(message)

    def left(self, now: float) -> None:
        """It is gone."""
        self._seats.disconnected(self, now)

    def beat(self, status: bytes, now: float) -> None:
        """Send a sign of life to the browser in the seat."""
        age, round_trip = self.newest
        self._send({"t": "beat", "n": self._count_beat(now), "age": age, "trip": round_trip})

    def _obey(self, wanted: Said, now: float) -> None:
        match wanted:
            case StopPress():
                self._seats.stop(self.who, wanted, now)
                if self._seats.reached:
                    self._send({"t": "stopping", "id": wanted.id})
            case Ping():
                self._send({"t": "pong", "at": wanted.at})
            case Take():
                self._take_seat(wanted.who, now)
            case GiveBack():
                self._seats.release(self, now)
            case Hold() if self._seats.owner is self:
                if self._is_new(wanted.seq, now):
                    self._take(_command(wanted), now)
            case Hold():  # in transit when the seat was lost
                pass
            case PosePress() | AnswerPress() | ZoneChange():
                if self._seats.owner is not self:
                    self._answer("take control first")
                elif self._is_new(wanted.seq, now):
                    self._act(wanted, now)

    def _act(self, wanted: Act, now: float) -> None:
        """Pass on requests of the browser in the seat, while they are as young as a command must be."""
        sent = self._sent(wanted.beat)
        if now - sent > self._seats.fresh:
            self._answer("it came too late: do it again")
            return
        match wanted:
            case PosePress():
                self._seats.give(GivenPose(wanted.kind, wanted.x, wanted.y, wanted.heading), sent)
            case AnswerPress():
                self._seats.give(GivenAnswer(wanted.step, wanted.text), sent)
            case ZoneChange():
                self._seats.change_zones(wanted, self._answer)

    def _answer(self, why: str) -> None:
        """Answer why a request was refused; empty: it is done."""
        self._send({"t": "act", "why": why})

    def _take_seat(self, name: str, now: float) -> None:
        owner = self._seats.owner
        if owner is self:
            return
        if not self._seats.reached:
            self._send({"t": "refused", "why": "the run takes nothing from the page"})
            return
        if owner is not None:
            self._seats.tell("NET-08", f"{self.who} was refused: {owner.who} has control", now)
            self._send({"t": "refused", "why": f"{owner.who} has control"})
            return
        if name.isprintable() and name:
            self.who = f"{name} at {self.peer}"
        self._begin(now)
        self._seats.seat(self, now)

    def _part(self, now: float, why: str) -> None:
        self._send({"t": "parted", "why": why})
        self._seats.disconnected(self, now, why)
        self.closing = not why.startswith("nothing was received")


def _command(given: Hold) -> SentCommand:
    return SentCommand(
        sequence=given.seq,
        beat=given.beat,
        enabled=given.held,
        neutral=given.neutral,
        hold=given.waited / 1e3,
        requests=tuple(REQUESTS[word] for word in given.ask),
        axes=(given.x, given.y, given.jog) if given.jog else (given.x, given.y),
    )
