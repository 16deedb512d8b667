"""The robot's end of operators' links: bytes and times, no socket, no clock.

A command counts if it proves the session's key, so what was recorded is worth nothing; and by the rules of `session`.
"""

from __future__ import annotations

import hmac
import secrets
from collections import Counter
from collections.abc import Callable, Collection

from artemis.bridges.operator import frames
from artemis.bridges.operator.frames import ForgedFrame, MalformedFrame, Splitter
from artemis.bridges.operator.quality import LinkQuality
from artemis.bridges.operator.session import LinkSession, Seats
from artemis.values import Request

CLAIM_TIME = 2.0
"""Time to prove the secret [s]."""
MOST_WAITING = 8
"""Links that have not proved the secret; of more the oldest is closed, from where most of them come."""
FORGERIES = 10
"""A link with this number of them is closed."""


class RobotEnd(Seats):
    """All links of one robot."""

    def __init__(
        self,
        secret: bytes,
        welcome: bytes,
        allow: Collection[Request] = (),
        random: Callable[[int], bytes] = secrets.token_bytes,
    ) -> None:
        """No operator is connected.

        Args:
            secret: Shared with the operators.
            welcome: JSON of what this robot is.
            allow: Requests that are obeyed besides the quick stop and those that belong to driving (done, record).
            random: Gives this number of unpredictable bytes.
        """
        super().__init__(allow)
        self.secret, self.welcome, self.random = secret, welcome, random

    def connected(self, peer: str, now: float) -> RobotLink:
        """A connection from the address `peer`, at `now` [s]."""
        link = RobotLink(self, peer, now)
        link.greet()
        self.links[link] = None
        waiting = [each for each in self.links if each is not self.owner]
        if len(waiting) > MOST_WAITING:
            (crowd, _), *_ = Counter(each.peer for each in waiting).most_common(1)
            self.tell("NET-10", f"more than {MOST_WAITING} connections wait, one more from {peer}", now)
            self.disconnected(next(each for each in waiting if each.peer == crowd), now)
        return link

    def end(self, words: str) -> None:
        """The run has ended."""
        for link in self.links:
            if link is self.owner and isinstance(link, RobotLink):
                link.send(frames.worded(frames.BYE, words))
            link.closing = True


class RobotLink(LinkSession):
    """One connection, from its first byte to its last."""

    def __init__(self, end: RobotEnd, peer: str, now: float) -> None:
        """Connected at `now` [s]."""
        super().__init__(end, peer, now)
        self.output = bytearray()
        """Whole frames that are to be sent, before it is closed."""
        self._robot, self._begun = end, now
        self._nonce, self._keys = end.random(frames.NONCE), frames.SessionKeys(b"", b"")
        self._splitter = Splitter(frames.MOST_FROM_OPERATOR)
        self._forgeries = 0

    def greet(self) -> None:
        """Send the first frame."""
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
        self.send(frames.beat(frames.Beat(self._count_beat(now), *self.newest, status)))

    def look(self, now: float) -> None:
        """Let go of one that is silent, or does not prove the secret."""
        if self._keys.robot:
            super().look(now)
        elif now - self._begun > CLAIM_TIME:
            self._end.disconnected(self, now)

    # ------------------------------------------------------------------------------------------ what came

    def _claimed(self, wanted: frames.Claim, now: float) -> None:
        end, proof = self._robot, (self._nonce, wanted.nonce, wanted.name, wanted.role)
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

    def _part(self, now: float, why: str) -> None:
        if self._keys.robot:
            self.send(frames.worded(frames.BYE, why))
        self._end.disconnected(self, now, why)
