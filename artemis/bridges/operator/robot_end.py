"""The robot's end of operators' links: who has the seat, which commands count. Bytes and times, no socket, no clock.

A command counts if it proves the session's key, if its sequence is higher than any before, and if it quotes a beat of
this session that is younger than `FRESH`; from that beat on it counts for `FRESH`. So no clocks are compared, what was
recorded is worth nothing, and a link that fails in whatever manner stops the robot by the age alone.
"""

from __future__ import annotations

import hmac
import secrets
from collections import Counter, deque
from collections.abc import Callable, Collection
from math import inf
from typing import Literal

from msgspec import Struct

from artemis.bridges.operator import frames
from artemis.bridges.operator.frames import ForgedFrame, MalformedFrame, SentCommand, Splitter
from artemis.bridges.operator.quality import LinkQuality
from artemis.values import Request

BEAT_EVERY = 0.05
"""Between two beats [s]."""
FRESH = 0.25
"""A command counts until the beat that it quotes is so old [s]."""
DEAD = 1.0
"""An operator of whom nothing valid came for so long has left the seat [s]."""
CLAIM_TIME = 2.0
"""So long one may take to prove the secret [s]."""
KEPT_BEATS = 100
MOST_WAITING = 8
"""Links that have not proved the secret; of more the oldest is closed, from where most of them come."""
RATE, BURST = 400.0, 400.0
"""Frames of a link that are looked at, in a second and at once; more are dropped unread. At once: all that an operator
sends in `DEAD`, which a stalled link delivers together; the last may ask for a stop."""
REPLAYS, FORGERIES = 3, 10
"""A link that shows so many is closed."""
TOLD_EVERY = 0.2
"""A row of the fault table is told at most so often [s]: its cause lasts for 0.5 s more."""
MOST_REQUESTS = 16

Seat = Literal["free", "held", "lost"]
"""free: nobody had it, or it was given back; lost: who had it went away without a word."""
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


class LinkReport(Struct, array_like=True):
    """What there is to tell since the last report."""

    seat: Seat = "free"
    who: str = ""
    """Who has, or had, the seat."""
    since: float = 0.0
    """When it was taken, or lost [s]."""
    why: str = ""
    """Why it was lost."""
    newest: Arrived | None = None
    """The last command of the one who has the seat, also where it is not news."""
    late: tuple[float, float] | None = None
    """When a command came that was too old, and how old it was [s]."""
    requests: list[Request] = []
    problems: list[Problem] = []


class RobotEnd:
    """All links of one robot."""

    def __init__(
        self,
        secret: bytes,
        welcome: bytes,
        allow: Collection[Request] = (),
        random: Callable[[int], bytes] = secrets.token_bytes,
    ) -> None:
        """Nobody is there.

        Args:
            secret: Shared with the operators.
            welcome: JSON of what this robot is.
            allow: Requests that are obeyed besides the quick stop and those that belong to driving (done, record).
            random: Gives so many unpredictable bytes.
        """
        self.secret, self.welcome, self.random = secret, welcome, random
        self.allow = frozenset(allow) | {Request.QUICKSTOP, Request.DONE, Request.RECORD}
        self.owner: RobotLink | None = None
        self.links: dict[RobotLink, None] = {}
        """The oldest first."""
        self.status = b""
        """JSON of what the robot does, for the next beat."""
        self.report, self.has_news = LinkReport(), False
        """What is new since the last one was taken, and whether anything is."""
        self._told: dict[str, float] = {}

    def connected(self, peer: str, now: float) -> RobotLink:
        """Somebody connects from the address `peer`, at `now` [s]."""
        link = RobotLink(self, peer, now)
        link.greet()
        self.links[link] = None
        waiting = [each for each in self.links if each is not self.owner]
        if len(waiting) > MOST_WAITING:
            (crowd, _), *_ = Counter(each.peer for each in waiting).most_common(1)
            self.tell("NET-10", f"more than {MOST_WAITING} connections wait, one more from {peer}", now)
            self.disconnected(next(each for each in waiting if each.peer == crowd), now)
        return link

    def disconnected(self, link: RobotLink, now: float, why: str = "the connection was closed") -> None:
        """It is gone; harmless when repeated."""
        link.closing = True
        self.links.pop(link, None)
        if link is self.owner:
            self._leave("lost", now, why)

    def beat(self, now: float) -> None:
        """Every `BEAT_EVERY`: send the owner a beat, let those go who are silent, judge the link."""
        for link in list(self.links):
            link.look(now)
        if self.owner is not None:
            self.owner.beat(self.status, now)
            self.status = b""
            for row, seen in self.owner.quality.problems(now):
                self.tell(row, f"{self.owner.who}: {seen}", now)

    def end(self, words: str) -> None:
        """The run is over."""
        for link in self.links:
            if link is self.owner:
                link.send(frames.worded(frames.BYE, words))
            link.closing = True

    def begin_report(self) -> None:
        """The report was taken: begin the next."""
        report, self.has_news = self.report, False
        self.report = LinkReport(report.seat, report.who, report.since, report.why, report.newest)

    # ------------------------------------------------------------------------------------------ for the links

    def seat(self, link: RobotLink, now: float) -> None:
        """The link has the seat now."""
        self.owner = link
        self.report = LinkReport("held", link.who, now, requests=self.report.requests, problems=self.report.problems)
        self.has_news = True

    def release(self, link: RobotLink, now: float) -> None:
        """Who has the seat gives it back."""
        if link is self.owner:
            self._leave("free", now, "")

    def took(self, arrived: Arrived) -> None:
        """A command counts."""
        self.report.newest, self.has_news = arrived, True

    def came_late(self, age: float, now: float) -> None:
        """A command came that was too old."""
        self.report.late, self.has_news = (now, age), True

    def ask(self, request: Request) -> None:
        """Somebody who may asks for this."""
        if len(self.report.requests) < MOST_REQUESTS:
            self.report.requests.append(request)
        elif request is Request.QUICKSTOP:
            self.report.requests[0] = request
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
        report = self.report
        self.report = LinkReport(
            seat, self.owner.who, now, why, late=report.late, requests=report.requests, problems=report.problems
        )
        self.owner, self.has_news = None, True


class RobotLink:
    """One connection, from its first byte to its last."""

    def __init__(self, end: RobotEnd, peer: str, now: float) -> None:
        """Connected at `now` [s]."""
        self.output = bytearray()
        """Whole frames that are to be sent."""
        self.closing = False
        """It is to be closed after that."""
        self.who = self.peer = peer
        self.quality = LinkQuality(now)
        self._end, self._begun = end, now
        self._nonce, self._keys = end.random(frames.NONCE), frames.SessionKeys(b"", b"")
        self._splitter = Splitter(frames.MOST_FROM_OPERATOR)
        self._beats: deque[float] = deque(maxlen=KEPT_BEATS)
        self._beat = self._sequence = 0
        self._heard, self._tokens, self._filled = now, BURST, now
        self._unread = self._dropped = self._replays = self._forgeries = self._late = 0
        self._newest: tuple[float, float] | None = None

    def greet(self) -> None:
        """Say hello."""
        self.output += frames.framed(frames.hello(self._nonce))

    def send(self, body: bytes) -> None:
        """Have a body of the session sent."""
        self.output += frames.sealed(self._keys.robot, body)

    def receive(self, data: bytes, now: float) -> None:
        """Take what came at `now` [s]."""
        if self.closing:
            return
        try:
            for body in self._splitter.feed(data):
                if self.closing:
                    return
                if not self._keys.robot:
                    self._claimed(frames.claim_from(body), now)
                elif self._may_be_read(now):
                    self._obey(body, now)
        except MalformedFrame as error:
            self._end.tell("NET-09", f"{self.who}: {error}", now)
            self._part(now, "it sent what cannot be read")

    def beat(self, status: bytes, now: float) -> None:
        """Send a sign of life."""
        self._beat += 1
        self._beats.append(now)
        age, round_trip = self._newest or (None, None)
        self.send(frames.beat(frames.Beat(self._beat, age, round_trip, status)))

    def look(self, now: float) -> None:
        """Let go of one that is silent."""
        if not self._keys.robot:
            if now - self._begun > CLAIM_TIME:
                self._end.disconnected(self, now)
        elif now - self._heard > DEAD:
            self._part(now, f"nothing was heard for {DEAD:g} s")
        if self._dropped:
            self._end.tell("NET-10", f"{self.who}: {self._dropped} frames dropped unread", now)
            self._dropped = 0

    # ------------------------------------------------------------------------------------------ what came

    def _claimed(self, wanted: frames.Claim, now: float) -> None:
        end, proof = self._end, (self._nonce, wanted.nonce, wanted.name, wanted.role)
        if not hmac.compare_digest(frames.proof_of(end.secret, *proof), wanted.proof):
            end.tell("NET-07", f"{self.peer} has another secret", now)
            self.output += frames.framed(frames.worded(frames.DENIED, "another secret"))
            self.closing = True
            return
        self._keys = frames.session_keys(end.secret, *proof[:3])
        self.who, self._heard = f"{wanted.name} at {self.peer}", now
        if wanted.role == frames.STOP:
            end.ask(Request.QUICKSTOP)
            self.send(frames.worded(frames.STOPPED, "a quick stop was asked for"))
            self.closing = True
        elif end.owner is not None:
            end.tell("NET-08", f"{self.who} was refused: {end.owner.who} has the robot", now)
            self.send(frames.worded(frames.REFUSED, f"{end.owner.who} has the robot"))
            self.closing = True
        else:
            self.quality = LinkQuality(now)
            self.send(bytes((frames.WELCOME,)) + end.welcome)
            end.seat(self, now)

    def _may_be_read(self, now: float) -> bool:
        """Whether a frame is one of those that may come in that time; of a flood most are dropped before any work."""
        self._tokens = min(self._tokens + (now - self._filled) * RATE, BURST)
        self._filled = now
        if self._tokens < 1.0:
            self._dropped, self._unread = self._dropped + 1, self._unread + 1
            return False
        self._tokens -= 1.0
        return True

    def _obey(self, sealed_body: bytes, now: float) -> None:
        try:
            body = frames.opened(self._keys.operator, sealed_body)
        except ForgedFrame as error:
            self._forgeries += 1
            self._end.tell("NET-07", f"{self.who}: {error}", now)
            if self._forgeries >= FORGERIES:
                self._part(now, f"{FORGERIES} frames were forged")
            return
        if frames.kind_of(body) == frames.COMMAND:
            wanted = frames.command_from(body)
            if self._is_new(wanted.sequence, now):
                self._take(wanted, now)
        elif frames.kind_of(body) == frames.RELEASE:
            if self._is_new(frames.sequence_of_release(body), now):
                self._end.release(self, now)
                self.send(frames.worded(frames.BYE, "the robot is free"))
                self.closing = True
        else:
            raise MalformedFrame(f"a frame of kind {frames.kind_of(body)}")

    def _is_new(self, sequence: int, now: float) -> bool:
        if sequence <= self._sequence:
            self._replays += 1
            if self._replays >= REPLAYS:
                self._end.tell("NET-06", f"{self.who}: {REPLAYS} frames came again or in another order", now)
                self._part(now, "frames were replayed")
            return False
        self.quality.saw(now, max(sequence - self._sequence - 1 - self._unread, 0))
        self._sequence, self._heard, self._unread = sequence, now, 0
        return True

    def _take(self, wanted: SentCommand, now: float) -> None:
        age = now - self._sent(wanted.beat)
        fresh = age <= FRESH
        for request in wanted.requests:
            if request not in self._end.allow:
                words = f"{self.who} asked to {request.value}: the mission does not allow it"
                self._end.tell("NET-08", words, now)
            elif fresh or request is Request.QUICKSTOP:
                self._end.ask(request)
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

    def _part(self, now: float, why: str) -> None:
        if self._keys.robot:
            self.send(frames.worded(frames.BYE, why))
        self._end.disconnected(self, now, why)
