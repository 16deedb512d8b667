"""The operator's end of a link, as pure as the robot's: bytes and times in, bytes out."""

from __future__ import annotations

import secrets
from collections.abc import Callable

from artemis.bridges.operator import frames
from artemis.bridges.operator.frames import ForgedFrame, MalformedFrame, SentCommand, Splitter
from artemis.values import OperatorInput

UNHEARD = OperatorInput(source="", neutral=False)
"""Of a device that is not there."""


class RefusedLink(Exception):
    """The robot refuses this operator, or is another one; with a text for the operator."""


class OperatorEnd:
    """One connection to a robot."""

    def __init__(
        self,
        secret: bytes,
        name: str,
        role: int = frames.DRIVE,
        random: Callable[[int], bytes] = secrets.token_bytes,
    ) -> None:
        """Connected; the robot sends the first frame.

        Args:
            secret: Shared with the robot.
            name: The operator, for the robot's journal: printable, at most 40 bytes are sent.
            role: To drive, or only to stop.
            random: Gives this number of unpredictable bytes.
        """
        self.output = bytearray()
        """Bytes that are to be sent."""
        self.welcome: bytes | None = None
        """JSON of what the robot is; None: it has not let us in yet."""
        self.beat = frames.Beat(0, None, None, b"")
        """The newest."""
        self.status: bytes = b""
        """The newest that a beat carried."""
        self.over = ""
        """Why the robot ended the link; empty: it has not."""
        self._secret, self._role, self._random = secret, role, random
        self._name = name.encode()[: frames.MOST_NAME].decode("utf-8", "ignore") or "operator"
        self._keys: frames.SessionKeys | None = None
        self._splitter = Splitter(frames.MOST_FROM_ROBOT)
        self._sequence = 0
        self._beat_came: float | None = None

    @property
    def has_seat(self) -> bool:
        """Commands may be sent."""
        return self._beat_came is not None and not self.over

    def receive(self, data: bytes, now: float) -> None:
        """Take what came at `now` [s], by the operator's own clock.

        Raises:
            RefusedLink: the robot refuses; or what answers there is none, or has another secret.
        """
        try:
            for body in self._splitter.feed(data):
                self._take(body, now)
        except MalformedFrame as error:
            raise RefusedLink(str(error)) from None
        except ForgedFrame:
            raise RefusedLink("the robot did not prove the secret: pair both sides again") from None

    def silent_for(self, now: float) -> float:
        """How long the last beat is ago [s]."""
        return 0.0 if self._beat_came is None else now - self._beat_came

    def command(self, sample: OperatorInput, now: float) -> None:
        """Have what the operator wishes sent; nothing before the first beat came."""
        if self._beat_came is None or self._keys is None:
            return
        self._sequence += 1
        wanted = SentCommand(
            sequence=self._sequence,
            beat=self.beat.number,
            heard=sample.age is not None,
            enabled=sample.enabled,
            neutral=sample.neutral,
            age=sample.age or 0.0,
            hold=now - self._beat_came,
            requests=tuple(request for request in sample.requests if request in frames.REQUESTS),
            speed=sample.speed,
            steering=sample.steering,
            axes=sample.axes,
        )
        self.output += frames.sealed(self._keys.operator, frames.command(wanted))

    def release(self) -> None:
        """Give the seat back."""
        if self._keys is not None:
            self._sequence += 1
            self.output += frames.sealed(self._keys.operator, frames.release(self._sequence))

    def _take(self, body: bytes, now: float) -> None:
        if self._keys is None:
            self._claim(frames.nonce_of_hello(body))
            return
        if self.welcome is None and frames.kind_of(body) == frames.DENIED:  # it cannot be signed without the secret
            raise RefusedLink("the robot has another secret: pair both sides again")
        body = frames.opened(self._keys.robot, body)
        match frames.kind_of(body):
            case frames.WELCOME if self.welcome is None:
                self.welcome = body[1:]
            case frames.REFUSED:
                raise RefusedLink(frames.words_of(body))
            case frames.BEAT:
                beat = frames.beat_from(body)
                if beat.number <= self.beat.number:
                    raise MalformedFrame("a beat came twice")
                self.beat, self._beat_came = beat, now
                self.status = beat.status or self.status
            case frames.STOPPED | frames.BYE:
                self.over = frames.words_of(body)
            case kind:
                raise MalformedFrame(f"a frame of kind {kind}")

    def _claim(self, robot_nonce: bytes) -> None:
        nonce = self._random(frames.NONCE)
        proof = frames.proof_of(self._secret, robot_nonce, nonce, self._name, self._role)
        self.output += frames.framed(frames.claim(frames.Claim(self._role, nonce, self._name, proof)))
        self._keys = frames.session_keys(self._secret, robot_nonce, nonce, self._name)
