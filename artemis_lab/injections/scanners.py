"""Laser scanners that misbehave: LAS-.."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from math import radians
from typing import Annotated, Literal

from pydantic import Field

from artemis.sim.lms100 import Lms100
from artemis.sim.scanners import SimScanner
from artemis_lab.injections.stage import Injection, Lasting, Positive, Stage, Undo, together

Share = Annotated[float, Field(gt=0, le=1)]
Sector = Annotated[tuple[float, float], Field(strict=False)]


_STEP = 0.01
"""A delay and a cover grow so often [s]."""


class OfScanner(Lasting):
    """Which of the robot's scanners; None: all."""

    scanner: str | None = None


class Loss(OfScanner):
    """How it is lost: its plug is pulled, or it says nothing more."""

    how: Literal["unplugged", "silent"] = "unplugged"


class Damage(OfScanner):
    """What becomes of its telegrams: nothing that can be read, the first half, a wrong bit, or lost on the way."""

    how: Literal["rubbish", "cut", "bit", "lost"] = "rubbish"
    share: Share = 0.8
    """Of the telegrams."""


class Pieces(OfScanner):
    """How its telegrams come."""

    bytes: Annotated[int, Field(ge=1, le=10_000)] = 7
    """So many at once."""


class Illness(OfScanner):
    """What it says of itself."""

    status: Literal["dirty", "too dirty", "error"] = "error"


class Cover(OfScanner):
    """What something on its window hides, and how long it takes to slide there from the right."""

    sector_deg: Sector = (-135.0, 135.0)
    """In the scanner's frame."""
    within_s: Annotated[float, Field(ge=0, le=60)] = 0.0


class Delay(OfScanner):
    """How much later its telegrams come, and how long it takes to become so much."""

    seconds: Positive = 0.3
    within_s: Annotated[float, Field(ge=0, le=60)] = 0.0


def _chosen(stage: Stage, name: str | None) -> Sequence[SimScanner]:
    found = stage.world.scanners
    if not found or (name is not None and name not in found):
        raise ValueError(f"needs one of the scanners {', '.join(found) or '(the robot has none)'}, not {name}")
    return list(found.values()) if name is None else [found[name]]


def _each(stage: Stage, name: str | None, act: Callable[[SimScanner], Undo]) -> Undo:
    return together([act(scanner) for scanner in _chosen(stage, name)])


def _lose(stage: Stage, node: str | None, given: Loss) -> Undo:
    def act(scanner: SimScanner) -> Undo:
        device = scanner.device
        if given.how == "silent":
            return _set(device, "silent", True, False)
        device.unplug()
        return lambda: setattr(device, "plugged_in", True)

    return _each(stage, given.scanner, act)


def _set(device: Lms100, name: str, value: object, back: object) -> Undo:
    setattr(device, name, value)
    return lambda: setattr(device, name, back)


def _freeze(stage: Stage, node: str | None, given: OfScanner) -> Undo:
    return _each(stage, given.scanner, lambda scanner: _set(scanner.device, "frozen", True, False))


def _damage(stage: Stage, node: str | None, given: Damage) -> Undo:
    def act(scanner: SimScanner) -> Undo:
        dice, device = random.Random(1), scanner.device
        intact = device.garble

        def garble(telegram: bytes) -> bytes:
            return _damaged(telegram, given.how, dice) if dice.random() < given.share else telegram

        return _set(device, "garble", garble, intact)

    return _each(stage, given.scanner, act)


def _damaged(telegram: bytes, how: str, dice: random.Random) -> bytes:
    if how == "lost":
        return b""
    if how == "cut":
        return telegram[: len(telegram) // 2]
    if how == "bit":
        at = dice.randrange(40)
        return telegram[:at] + bytes([telegram[at] ^ 0x80]) + telegram[at + 1 :]
    return dice.randbytes(40).replace(b"\x02", b"").replace(b"\x03", b"")


def _split(stage: Stage, node: str | None, given: Pieces) -> Undo:
    return _each(stage, given.scanner, lambda scanner: _set(scanner.device, "piece", given.bytes, 0))


_STATUS = {"dirty": (0, 2), "too dirty": (0, 5), "error": (0, 1)}


def _ail(stage: Stage, node: str | None, given: Illness) -> Undo:
    return _each(stage, given.scanner, lambda scanner: _set(scanner.device, "status", _STATUS[given.status], (0, 0)))


def _cover(stage: Stage, node: str | None, given: Cover) -> Undo:
    begun = stage.now
    first, last = map(radians, given.sector_deg)

    def act(scanner: SimScanner) -> Undo:
        def slide() -> None:
            share = (stage.now - begun) / given.within_s if given.within_s else 1.0
            scanner.laser.covered = first, first + (last - first) * min(1.0, share)

        def uncover() -> None:
            scanner.laser.covered = None

        slide()
        ends = stage.repeat(slide, _STEP, round(given.within_s / _STEP) + 2)
        return together([ends, uncover])

    return _each(stage, given.scanner, act)


def _delay(stage: Stage, node: str | None, given: Delay) -> Undo:
    begun = stage.now

    def act(scanner: SimScanner) -> Undo:
        device = scanner.device

        def grow() -> None:
            share = (stage.now - begun) / given.within_s if given.within_s else 1.0
            device.delay = given.seconds * min(1.0, share)

        ends = stage.repeat(grow, _STEP, round(given.within_s / _STEP) + 2)
        return together([ends, _set(device, "delay", device.delay, 0.0)])

    return _each(stage, given.scanner, act)


SCANNER_INJECTIONS: dict[str, Injection] = {
    "LAS-01": Injection("scanner is lost", _lose, parameters=Loss),
    "LAS-02": Injection("scanner sends the same scan again and again", _freeze, parameters=OfScanner),
    "LAS-03": Injection("telegrams of the scanner are damaged or lost", _damage, parameters=Damage),
    "LAS-04": Injection("telegrams of the scanner come in pieces", _split, parameters=Pieces),
    "LAS-05": Injection("scanner is not well", _ail, parameters=Illness),
    "LAS-06": Injection("scanner is covered", _cover, parameters=Cover),
    "LAS-07": Injection("scans come late", _delay, parameters=Delay),
}
