"""Frames between a robot and its operator: a length, a body that begins with its kind, and a proof of its sender.

    robot                                   operator
      HELLO     version, nonce          ->
                                        <-  CLAIM     role, nonce, name, proof of the secret
      WELCOME   what robot this is      ->            or DENIED: wrong secret; REFUSED: another drives; STOPPED
      BEAT      number, state           ->            every 50 ms
                                        <-  COMMAND   sequence, newest beat, wish, requests
                                        <-  RELEASE   the seat is free
      BYE       why                     ->

From WELCOME on each body has a tag: the first 16 bytes of HMAC-SHA256 (RFC 2104) under a key of this session and this
direction. Big endian; the length counts body and tag.
"""

from __future__ import annotations

import hmac
import struct
from hashlib import sha256
from math import isfinite
from typing import NamedTuple

from artemis.values import Request

VERSION = 1
NONCE, TAG, PROOF = 16, 16, 32
"""Lengths [bytes]."""
MOST_FROM_OPERATOR, MOST_FROM_ROBOT = 256, 0xFFFF
"""Longest body and tag [bytes]."""
MOST_NAME, MOST_AXES = 40, 16

HELLO, CLAIM, DENIED, WELCOME, REFUSED, STOPPED, BEAT, COMMAND, RELEASE, BYE = range(1, 11)
DRIVE, STOP = 0, 1
"""Roles of a claim: to take the seat; to stop the robot, whichever operator has it."""
REQUESTS = (
    Request.QUICKSTOP,
    Request.ACKNOWLEDGE,
    Request.ARM,
    Request.END,
    Request.DONE,
    Request.RECORD,
)
"""What an operator may ask for, by the bits of a command."""
NEVER = 0xFFFF
"""Milliseconds of something that has not happened."""
RUN_OVER = "the run has ended"
"""Text of a BYE after which no operator reconnects."""

_LENGTH = struct.Struct(">H")
_COMMAND = struct.Struct(">BQQBHHHddB")
_BEAT = struct.Struct(">BQHH")
_RELEASE = struct.Struct(">BQ")
_HEARD, _ENABLED, _NEUTRAL = 1, 2, 4


class MalformedFrame(ValueError):
    """Bytes that are no frame of this protocol."""


class ForgedFrame(ValueError):
    """The tag is not that of the session's key."""


class SessionKeys(NamedTuple):
    """Keys of one session, one for each direction."""

    robot: bytes
    operator: bytes


class Claim(NamedTuple):
    """Sender, role and proof."""

    role: int
    nonce: bytes
    name: str
    proof: bytes


class SentCommand(NamedTuple):
    """What an operator wishes, as sent."""

    sequence: int
    beat: int
    """The newest beat that had come."""
    heard: bool = True
    """The operator's device is there."""
    enabled: bool = False
    neutral: bool = True
    age: float = 0.0
    """Of the device's sample when it was sent [s]."""
    hold: float = 0.0
    """How long the beat had been there [s]: for the round trip only."""
    requests: tuple[Request, ...] = ()
    speed: float = 0.0
    steering: float = 0.0
    """As `OperatorInput`'s."""
    axes: tuple[float, ...] = ()


class Beat(NamedTuple):
    """The robot's sign of life."""

    number: int
    age: float | None
    """Of the newest command that counted [s]: since the beat that it quoted; None: there is none."""
    round_trip: float | None
    """Of that command [s]."""
    status: bytes
    """JSON of what the robot does; empty: as before."""


class Splitter:
    """Bodies out of a stream of bytes, whatever its pieces are."""

    def __init__(self, most: int) -> None:
        """`most`: longest body [bytes]."""
        self._most, self._rest = most, b""

    def feed(self, data: bytes) -> list[bytes]:
        """The bodies that are whole now.

        Raises:
            MalformedFrame: a length is impossible; nothing after it can be read.
        """
        data, place, bodies = self._rest + data, 0, []
        while len(data) - place >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(data, place)
            if not 0 < length <= self._most:
                raise MalformedFrame(f"a frame of {length} bytes")
            if len(data) - place - _LENGTH.size < length:
                break
            place += _LENGTH.size + length
            bodies.append(data[place - length : place])
        self._rest = data[place:]
        return bodies


def framed(body: bytes) -> bytes:
    """A body with its length before it."""
    return _LENGTH.pack(len(body)) + body


def sealed(key: bytes, body: bytes) -> bytes:
    """A framed body with its tag."""
    return framed(body + hmac.digest(key, body, "sha256")[:TAG])


def opened(key: bytes, sealed_body: bytes) -> bytes:
    """The body before a tag.

    Raises:
        ForgedFrame: the tag is another.
    """
    body, tag = sealed_body[:-TAG], sealed_body[-TAG:]
    if not body or not hmac.compare_digest(hmac.digest(key, body, "sha256")[:TAG], tag):
        raise ForgedFrame("a frame that the other side did not write")
    return body


def session_keys(secret: bytes, robot_nonce: bytes, operator_nonce: bytes, name: str) -> SessionKeys:
    """Keys from the secret and both sides' random numbers: no two sessions have the same."""
    base = hmac.digest(secret, b"session" + robot_nonce + operator_nonce + name.encode(), "sha256")
    return SessionKeys(*(hmac.digest(base, side, "sha256") for side in (b"robot", b"operator")))


def proof_of(secret: bytes, robot_nonce: bytes, operator_nonce: bytes, name: str, role: int) -> bytes:
    """Proves the secret for one claim of one session."""
    return hmac.new(secret, b"claim%c" % role + robot_nonce + operator_nonce + name.encode(), sha256).digest()


# ------------------------------------------------------------------------------------------ bodies


def kind_of(body: bytes) -> int:
    """The kind of a body."""
    return body[0]


def hello(nonce: bytes) -> bytes:
    """Body of HELLO."""
    return bytes((HELLO, VERSION)) + nonce


def nonce_of_hello(body: bytes) -> bytes:
    """The robot's nonce. Raises MalformedFrame: it is no HELLO of this version."""
    if len(body) != 2 + NONCE or body[0] != HELLO:
        raise MalformedFrame("no robot of artemis answers there")
    if body[1] != VERSION:
        raise MalformedFrame(f"the robot speaks version {body[1]} of the protocol, this artemis {VERSION}")
    return body[2:]


def claim(request: Claim) -> bytes:
    """Body of CLAIM."""
    return bytes((CLAIM, VERSION, request.role)) + request.nonce + request.proof + request.name.encode()


def claim_from(body: bytes) -> Claim:
    """The content of a body of CLAIM. Raises MalformedFrame."""
    place = 3 + NONCE + PROOF
    if len(body) <= place or len(body) > place + MOST_NAME or body[:2] != bytes((CLAIM, VERSION)):
        raise MalformedFrame("no claim of this version")
    try:
        name = body[place:].decode()
    except UnicodeDecodeError:
        raise MalformedFrame("a name that is no text") from None
    if body[2] not in (DRIVE, STOP) or not name.isprintable():
        raise MalformedFrame("a claim that cannot be")
    return Claim(body[2], body[3 : 3 + NONCE], name, body[3 + NONCE : place])


def command(given: SentCommand) -> bytes:
    """Body of COMMAND."""
    flags = _HEARD * given.heard | _ENABLED * given.enabled | _NEUTRAL * given.neutral
    bits = sum(1 << bit for bit, request in enumerate(REQUESTS) if request in given.requests)
    age, hold = _bounded(given.age * 1e3), _bounded(given.hold * 1e4)
    axes = given.axes[:MOST_AXES]
    head = _COMMAND.pack(
        COMMAND, given.sequence, given.beat, flags, age, hold, bits, given.speed, given.steering, len(axes)
    )
    return head + struct.pack(f">{len(axes)}d", *axes)


def command_from(body: bytes) -> SentCommand:
    """The content of a body of COMMAND. Raises MalformedFrame."""
    if len(body) < _COMMAND.size:
        raise MalformedFrame("a command that is too short")
    _, sequence, beat, flags, age, hold, bits, speed, steering, count = _COMMAND.unpack_from(body)
    if count > MOST_AXES or len(body) != _COMMAND.size + 8 * count or flags > 7 or bits >= 1 << len(REQUESTS):
        raise MalformedFrame("a command that cannot be")
    axes = struct.unpack_from(f">{count}d", body, _COMMAND.size)
    if not all(map(isfinite, (speed, steering, *axes))):
        raise MalformedFrame("a command with a number that is not finite")
    return SentCommand(
        sequence=sequence,
        beat=beat,
        heard=bool(flags & _HEARD),
        enabled=bool(flags & _ENABLED),
        neutral=bool(flags & _NEUTRAL),
        age=age / 1e3,
        hold=hold / 1e4,
        requests=tuple(request for bit, request in enumerate(REQUESTS) if bits >> bit & 1),
        speed=speed,
        steering=steering,
        axes=axes,
    )


def release(sequence: int) -> bytes:
    """Body of RELEASE."""
    return _RELEASE.pack(RELEASE, sequence)


def sequence_of_release(body: bytes) -> int:
    """Its sequence. Raises MalformedFrame."""
    if len(body) != _RELEASE.size:
        raise MalformedFrame("a release that cannot be")
    return int(_RELEASE.unpack(body)[1])


def beat(given: Beat) -> bytes:
    """Body of BEAT."""
    age = NEVER if given.age is None else _bounded(given.age * 1e3)
    round_trip = NEVER if given.round_trip is None else _bounded(given.round_trip * 1e4)
    return _BEAT.pack(BEAT, given.number, age, round_trip) + given.status


def beat_from(body: bytes) -> Beat:
    """The content of a body of BEAT. Raises MalformedFrame."""
    if len(body) < _BEAT.size:
        raise MalformedFrame("a beat that is too short")
    _, number, age, round_trip = _BEAT.unpack_from(body)
    return Beat(
        number,
        None if age == NEVER else age / 1e3,
        None if round_trip == NEVER else round_trip / 1e4,
        body[_BEAT.size :],
    )


def worded(kind: int, text: str) -> bytes:
    """Body of DENIED, REFUSED, STOPPED or BYE: a kind and a short text."""
    return bytes((kind,)) + text.encode()[:400]


def words_of(body: bytes) -> str:
    """The text after a kind."""
    return body[1:].decode("utf-8", "replace")


def _bounded(number: float) -> int:
    return min(max(round(number), 0), NEVER - 1)
