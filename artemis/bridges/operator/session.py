"""Which operator has the seat of a robot, and which commands are valid: rules of every link, on any transport.

A command counts if its sequence is higher than any before, and if it quotes a beat of this session that is younger than
`FRESH`; from that beat on it counts for `FRESH`. So no clocks are compared, and a link that fails in whatever manner
stops the robot by the age alone. Times, no socket, no clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Collection
from math import inf
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from artemis.bridges.operator.frames import MalformedFrame, SentCommand
from artemis.bridges.operator.quality import LinkQuality
from artemis.values import Request

AT_ONCE = 64
"""Highest number of reports that the robot takes in one call: their sender faces the network, and a tick waits."""
BEAT_EVERY = 0.05
"""Between two beats [s]."""
FRESH = 0.25
"""A command counts until the beat that it quotes is so old [s]."""
DEAD = 1.0
"""An operator without a valid frame for this time loses the seat [s]."""
KEPT_BEATS = 100
RATE, BURST = 400.0, 400.0
"""Frames of a link that are looked at, in a second and at once; more are dropped unread. At once: all that an operator
sends in `DEAD`, which a stalled link delivers together; the last may ask for a stop."""
REPLAYS = 3
"""A session with this number of them is ended."""
TOLD_EVERY = 0.2
"""Shortest interval of reports of a row of the fault table [s]: its cause lasts for 0.5 s more."""
MOST_REQUESTS = 16

Seat = Literal["free", "held", "lost"]
"""free: no operator had it, or it was given back; lost: its operator vanished without giving it back."""
Problem = tuple[str, str]
"""Row of the fault table, and what was seen."""


class Arrived(Struct, frozen=True, array_like=True):
    """A command that counts."""

    sent: float
    """When the beat that it quotes was sent [s]."""
    heard: bool
    enabled: bool
    neutral: bool
    age: float
    """Of the device's sample when the command was sent [s]."""
    speed: float
    steering: float
    axes: tuple[float, ...]


class GivenPose(Struct, frozen=True, tag="pose"):
    """A goal, or about where the robot is, in the frame `map` [m, m, rad]."""

    kind: Literal["goal_pose", "initialpose"]
    x: float
    y: float
    heading: float


class GivenAnswer(Struct, frozen=True, tag="answer"):
    """The answer to the question of a step of the mission."""

    step: int
    text: str


Given = GivenPose | GivenAnswer


class LinkReport(Struct, array_like=True):
    """What is new since the last report."""

    seat: Seat = "free"
    who: str = ""
    """The operator who has, or had, the seat."""
    since: float = 0.0
    """When it was taken, or lost [s]."""
    why: str = ""
    """Why it was lost."""
    newest: Arrived | None = None
    """The last command of the one who has the seat, also if it is not new."""
    late: tuple[float, float] | None = None
    """When a command came that was too old, and how old it was [s]."""
    requests: list[Request] = []
    problems: list[Problem] = []
    given: list[Given] = []
    asked: float = inf
    """When the oldest beat was sent that a request, or what was given, quotes [s]; a quick stop quotes none."""


class Seats:
    """All sessions of one robot; one of them may drive it."""

    def __init__(self, allow: Collection[Request] = (), fresh: float = FRESH) -> None:
        """No operator is connected.

        Args:
            allow: Requests that are obeyed besides the quick stop and those that belong to driving (done, record).
            fresh: A command counts until the beat that it quotes is so old [s].
        """
        self.allow = frozenset(allow) | {Request.QUICKSTOP, Request.DONE, Request.RECORD}
        self.fresh = fresh
        self.owner: LinkSession | None = None
        self.links: dict[LinkSession, None] = {}
        """The oldest first."""
        self.status = b""
        """JSON of what the robot does, for the next beat."""
        self.report, self.has_news = LinkReport(), False
        """What is new since the last one was taken, and whether anything is."""
        self._told: dict[str, float] = {}

    def disconnected(self, link: LinkSession, now: float, why: str = "the connection was closed") -> None:
        """It is gone; harmless when repeated."""
        link.closing = True
        self.links.pop(link, None)
        if link is self.owner:
            self._leave("lost", now, why)

    def beat(self, now: float) -> None:
        """Every `BEAT_EVERY`: send the owner a beat, disconnect silent operators, judge the link."""
        for link in list(self.links):
            link.look(now)
        if self.owner is not None:
            self.owner.beat(self.status, now)
            self.status = b""
            for row, seen in self.owner.quality.problems(now):
                self.tell(row, f"{self.owner.who}: {seen}", now)

    def begin_report(self) -> None:
        """The report was taken: begin the next."""
        report, self.has_news = self.report, False
        self.report = LinkReport(report.seat, report.who, report.since, report.why, report.newest)

    # ------------------------------------------------------------------------------------------ for the sessions

    def seat(self, link: LinkSession, now: float) -> None:
        """The link has the seat now."""
        self.owner = link
        self.report = replace(self.report, seat="held", who=link.who, since=now, why="", newest=None, late=None)
        self.has_news = True

    def release(self, link: LinkSession, now: float) -> None:
        """The operator gives the seat back."""
        if link is self.owner:
            self._leave("free", now, "")

    def took(self, arrived: Arrived) -> None:
        """A command counts."""
        self.report.newest, self.has_news = arrived, True

    def came_late(self, age: float, now: float) -> None:
        """A command came that was too old."""
        self.report.late, self.has_news = (now, age), True

    def ask(self, request: Request, sent: float = inf) -> None:
        """A permitted operator requests this, and quotes a beat that was sent then [s]."""
        if len(self.report.requests) < MOST_REQUESTS:
            self.report.requests.append(request)
        elif request is Request.QUICKSTOP:
            self.report.requests[0] = request
        self.report.asked = min(self.report.asked, sent)
        self.has_news = True

    def give(self, given: Given, sent: float) -> None:
        """The operator in the seat sends this, and quotes a beat that was sent then [s]."""
        if len(self.report.given) < MOST_REQUESTS:
            self.report.given.append(given)
            self.report.asked = min(self.report.asked, sent)
            self.has_news = True

    def tell(self, row: str, seen: str, now: float) -> None:
        """Something is wrong; not too often, and once in a report: the run may not take it for long."""
        told = any(row == other for other, _ in self.report.problems)
        if not told and now - self._told.get(row, -inf) >= TOLD_EVERY:
            self._told[row] = now
            self.report.problems.append((row, seen))
            self.has_news = True

    def _leave(self, seat: Seat, now: float, why: str) -> None:
        assert self.owner is not None
        self.report = replace(self.report, seat=seat, who=self.owner.who, since=now, why=why, newest=None)
        self.owner, self.has_news = None, True


class LinkSession(ABC):
    """One operator's, from the first word to the last."""

    def __init__(self, end: Seats, who: str, now: float) -> None:
        """Started at `now` [s], from the address `who`."""
        self.who = self.peer = who
        self.closing = False
        """It is to be closed."""
        self._end = end
        self._tokens, self._filled, self._dropped = BURST, now, 0
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Begin to count at `now` [s]: beats and commands of the time before are nothing any more."""
        self.quality = LinkQuality(now)
        self._beats: deque[float] = deque(maxlen=KEPT_BEATS)
        self._beat = self._sequence = 0
        self._heard = now
        self._unread = self._replays = self._late = 0
        self._newest: tuple[float, float] | None = None

    @property
    def newest(self) -> tuple[float | None, float | None]:
        """Age and round trip of the newest command that counted [s]; None: there is none."""
        return self._newest or (None, None)

    @abstractmethod
    def beat(self, status: bytes, now: float) -> None:
        """Send a sign of life."""

    @abstractmethod
    def _part(self, now: float, why: str) -> None:
        """End it."""

    def look(self, now: float) -> None:
        """Let go of one that is silent."""
        if now - self._heard > DEAD:
            self._part(now, f"nothing was received for {DEAD:g} s")
        if self._dropped:
            self._end.tell("NET-10", f"{self.who}: {self._dropped} frames dropped unread", now)
            self._dropped = 0

    def _count_beat(self, now: float) -> int:
        """The number of a beat that is sent now."""
        self._beat += 1
        self._beats.append(now)
        return self._beat

    def _may_be_read(self, now: float) -> bool:
        """Whether a frame is one of those that may come in that time; of a flood most are dropped before any work."""
        self._tokens = min(self._tokens + (now - self._filled) * RATE, BURST)
        self._filled = now
        if self._tokens < 1.0:
            self._dropped, self._unread = self._dropped + 1, self._unread + 1
            return False
        self._tokens -= 1.0
        return True

    def _is_new(self, sequence: int, now: float) -> bool:
        if sequence <= self._sequence:
            self._replays += 1
            if self._replays >= REPLAYS:
                self._end.tell("NET-06", f"{self.who}: {REPLAYS} frames were repeated or reordered", now)
                self._part(now, "frames were replayed")
            return False
        self.quality.saw(now, max(sequence - self._sequence - 1 - self._unread, 0))
        self._sequence, self._heard, self._unread = sequence, now, 0
        return True

    def _take(self, wanted: SentCommand, now: float) -> None:
        age = now - self._sent(wanted.beat)
        fresh = age <= self._end.fresh
        for request in wanted.requests:
            if request not in self._end.allow:
                words = f"{self.who} asked to {request.value}: the mission does not allow it"
                self._end.tell("NET-08", words, now)
            elif fresh or request is Request.QUICKSTOP:
                self._end.ask(request, now - age)
        if not fresh:
            self._late += 1
            self._end.came_late(age, now)
            return
        if self._late:
            self._end.tell("NET-04", f"{self.who}: {self._late} old commands came late, and were dropped", now)
            self._late = 0
        self._newest = age, max(age - wanted.hold, 0.0)
        sent = now - age
        self._end.took(
            Arrived(
                sent,
                wanted.heard,
                wanted.enabled,
                wanted.neutral,
                wanted.age,
                wanted.speed,
                wanted.steering,
                wanted.axes,
            )
        )

    def _sent(self, beat: int) -> float:
        """When a beat was sent [s]; one long ago: never. Raises MalformedFrame: it has not been sent."""
        if beat > self._beat or beat < 1:
            raise MalformedFrame(f"a command that quotes beat {beat} of {self._beat}")
        back = self._beat - beat
        return self._beats[-1 - back] if back < len(self._beats) else -inf
