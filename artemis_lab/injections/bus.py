"""Faults of the CAN bus and its adapter: the other half of COM-.."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field

from artemis.config import Config
from artemis.devices.can_bus import Frame
from artemis.errors import DeviceBusy, DeviceLost
from artemis_lab.injections.fault_bus import PROCESS_DATA, RX_PDO_1, Direction, Rule
from artemis_lab.injections.stage import Count, Injection, Lasting, Needs, Positive, Stage, Undo

HEARTBEAT, RX_PDO_2, NMT = 0x700, 0x300, 0x000
OPERATIONAL = b"\x05"
SHUTDOWN = b"\x06\x00"
"""Controlword that takes a drive out of operation (firmware specification 2010, 14.59)."""
PRE_OPERATIONAL = 0x80
"""NMT command."""

Probability = Annotated[float, Field(gt=0, le=1)]


class Lost(Lasting):
    """Frames that are lost."""

    count: Count | None = None
    """So many; None: all."""


class Hit(Lasting):
    """How many frames are hit, of those that drives send as process data."""

    count: Count | None = None
    """So many; None: all."""
    probability: Probability = 1.0


class Corrupted(Hit):
    """How they are damaged."""

    count: Count | None = 3
    bits: Annotated[int, Field(ge=0, le=64)] = 0
    """So many wrong bits."""
    length: Annotated[int, Field(ge=0, le=8)] | None = 3
    """Bytes of data; None: as it is."""


class Delayed(Hit):
    """How late they come."""

    delay_s: Positive = 0.2


class Reordered(Hit):
    """How they are overtaken."""

    count: Count | None = 1
    overtaken_by: Count = 9
    """So many later frames of all drives; each sends two for a SYNC."""


class Foreign(Config):
    """What somebody else sends to a drive."""

    says: Literal["shutdown", "pre-operational"] = "shutdown"
    """A controlword, or an NMT command."""
    times: Count = 1


class ErrorFrames(Config):
    """Error frames at this rate."""

    rate_hz: Positive = 100.0
    times: Count = 100


class Replug(Config):
    """The adapter goes and comes back."""

    off_s: Positive = 0.5
    on_s: Positive = 0.5
    times: Count = 1


class Raised(Config):
    """How often reading fails."""

    times: Count | None = 1
    """None: always from now on."""


class SendRefused(Lasting):
    """How often sending is refused."""

    times: Count | None = 3
    """None: always from now on."""


def _lose_set_points(stage: Stage, node: str | None, p: Lost) -> Undo:
    rule = Rule(
        ids=RX_PDO_1, node=stage.node_id(node), direction=Direction.FROM_HOST, count=p.count, drop=True
    )  # stop frames pass
    return stage.rule(rule)


def _hit(**how: str | int) -> Callable[[Stage, str | None, Any], Undo]:
    """Rules for the drives' process data; `how`: fields of the rule, each by the parameter it comes from."""

    def hit(stage: Stage, node: str | None, p: Any) -> Undo:  # noqa: ANN401 (one of the parameters above)
        fields: dict[str, Any] = {
            name: getattr(p, where) if isinstance(where, str) else where for name, where in how.items()
        }
        rule = Rule(
            ids=PROCESS_DATA,
            node=stage.node_id(node),
            direction=Direction.TO_HOST,
            count=p.count,
            probability=p.probability,
            **fields,
        )
        return stage.rule(rule)

    return hit


def _command(stage: Stage, node: str | None, p: Foreign) -> Undo:
    drive = stage.drive(node)
    if p.says == "shutdown":
        frame = Frame(RX_PDO_2 + drive.node_id, SHUTDOWN)
    else:
        frame = Frame(NMT, bytes((PRE_OPERATIONAL, drive.node_id)))
    return stage.repeat(lambda: stage.bus.inject(frame), 0.02, p.times)


def _second_host(stage: Stage, node: str | None, _: Lasting) -> Undo:
    frame = Frame(HEARTBEAT + stage.robot.host_node_id, OPERATIONAL)
    return stage.repeat(lambda: stage.bus.inject(frame), 0.04)


def _damage(stage: Stage, node: str | None, p: ErrorFrames) -> Undo:
    return stage.repeat(stage.bus.add_error_frames, 1.0 / p.rate_hz, p.times)


def _lose(problem: str) -> Callable[[Stage, str | None, Lasting], Undo]:
    def lose(stage: Stage, node: str | None, _: Lasting) -> Undo:
        stage.bus.lose(problem)
        return stage.bus.restore

    return lose


def _replug(stage: Stage, node: str | None, p: Replug) -> Undo:
    def unplug() -> None:
        stage.bus.lose("unplugged")
        stage.loop.call_later(p.off_s, stage.bus.restore)

    return stage.repeat(unplug, p.off_s + p.on_s, p.times)


def _fail_to_read(stage: Stage, node: str | None, p: Raised) -> None:
    stage.bus.fail_receive(DeviceLost("CAN", "cannot be read: told to"), p.times)


def _refuse(stage: Stage, node: str | None, p: SendRefused) -> Undo:
    stage.bus.fail_send(DeviceBusy("CAN", "transmit buffer full"), p.times)
    return lambda: stage.bus.fail_send(DeviceBusy("CAN", "never"), 0)


def _silence(stage: Stage, node: str | None, _: Lasting) -> Undo:
    return stage.rule(Rule(direction=Direction.TO_HOST, drop=True))


BUS_INJECTIONS: dict[str, Injection] = {
    "COM-12": Injection("set-points do not arrive", _lose_set_points, Needs.SOME_DRIVE, Lost),
    "COM-13": Injection("feedback arrives twice", _hit(copies=1), Needs.SOME_DRIVE, Hit),
    "COM-14": Injection("feedback arrives damaged", _hit(flip="bits", length="length"), Needs.SOME_DRIVE, Corrupted),
    "COM-15": Injection("feedback arrives late", _hit(delay="delay_s"), Needs.SOME_DRIVE, Delayed),
    "COM-16": Injection("feedback is overtaken", _hit(behind="overtaken_by"), Needs.SOME_DRIVE, Reordered),
    "COM-17": Injection("another CANopen master commands a drive", _command, Needs.DRIVE, Foreign),
    "COM-18": Injection("another host's heartbeat is heard", _second_host, parameters=Lasting),
    "COM-20": Injection("error frames on the wire", _damage, parameters=ErrorFrames),
    "COM-21": Injection("the host's controller is bus off", _lose("bus off"), parameters=Lasting),
    "COM-22": Injection("the adapter is unplugged", _lose("unplugged"), parameters=Lasting),
    "COM-23": Injection("the adapter is unplugged and comes back", _replug, parameters=Replug),
    "COM-24": Injection("reading from the adapter fails", _fail_to_read, parameters=Raised),
    "COM-25": Injection("the transmit buffer is full", _refuse, parameters=SendRefused),
    "COM-29": Injection("nothing is heard from any drive", _silence, parameters=Lasting),
}
