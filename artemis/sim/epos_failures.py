"""What a simulated drive can be made to do wrong while it runs. None of it costs anything before it is used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from artemis.devices.can_bus import Frame
from artemis.sim.dictionary import SIGNED, SIZES, Dictionary, Refusal
from artemis.sim.epos_error_control import ErrorControl
from artemis.sim.epos_motion import Motion
from artemis.sim.epos_pdo import ProcessData
from artemis.sim.epos_power import PowerStage
from artemis.values import DriveState

Sending = tuple[float, Frame]
"""A frame and the time at which it is ready [s]."""
Post = Callable[[Sending], None]
"""Takes what a drive sends."""


class Speech(Enum):
    """Kinds of frames that a drive sends."""

    EMERGENCY = "emergency"
    PROCESS_DATA = "process data"
    SDO = "SDO answer"
    HEARTBEAT = "heartbeat or boot-up"


def kind_of(frame: Frame) -> Speech:
    """Which kind of a drive's frames this is (predefined connection set, CiA 301 7.3.3)."""
    if frame.id < 0x180:
        return Speech.EMERGENCY
    if frame.id < 0x580:
        return Speech.PROCESS_DATA
    return Speech.SDO if frame.id < 0x700 else Speech.HEARTBEAT


@dataclass(slots=True, kw_only=True)
class Impediment:
    """What happens to the frames of one kind."""

    copies: int
    """How often each is sent; 0: never."""
    late: float
    """[s]."""
    left: int | None
    """So many more frames; None: all."""


Undo = Callable[[], None]
"""Ends a failure."""


class EposFailures:
    """The failures of one drive. Each method may be called at any time; what lasts is ended by what it returns."""

    def __init__(
        self,
        dictionary: Dictionary,
        motion: Motion,
        power: PowerStage,
        control: ErrorControl,
        pdos: ProcessData,
        outbox: list[Sending],
        send_through: Callable[[Post], None],
    ) -> None:
        """`send_through` has the drive hand its frames to a function, which puts into `outbox` what becomes of them."""
        self._dictionary = dictionary
        self._motion = motion
        self._power = power
        self._control = control
        self._pdos = pdos
        self._outbox = outbox
        self._send_through = send_through
        self._impediments: dict[Speech, Impediment] = {}

    def impede(self, kind: Speech, *, copies: int = 0, late: float = 0.0, count: int | None = None) -> Undo:
        """The next `count` frames of a kind (None: all) are sent `late` [s], `copies` times; 0: not at all."""
        self._impediments[kind] = Impediment(copies=copies, late=late, left=count)
        self._send_through(self._post)

        def free() -> None:
            self._impediments.pop(kind, None)

        return free

    def misreport(self, index: int, sub: int, shown: Callable[[int], int]) -> Undo:
        """An object reads as what `shown` makes of its true value, over SDO and in PDOs, cut to the object's size.

        Raises:
            Abort: no such object.
        """
        entry = self._dictionary.find(index, sub)
        getters, key, bits = self._dictionary.getters, entry.key, 8 * SIZES[entry.type]
        former, true = getters.get(key), self._dictionary.getter(key)
        lowest = -(1 << bits - 1) if entry.type in SIGNED else 0
        getters[key] = lambda: (shown(true()) - lowest) % (1 << bits) + lowest
        self._pdos.rebuild_transmitted()

        def tell_truth() -> None:
            if former is None:
                del getters[key]
            else:
                getters[key] = former
            self._pdos.rebuild_transmitted()

        return tell_truth

    def refuse_object(self, index: int, sub: int, code: int, count: int | None = None) -> Undo:
        """The next `count` SDO requests (None: all) for an object are aborted with this code.

        Raises:
            Abort: no such object.
        """
        key = self._dictionary.find(index, sub).key
        self._dictionary.refusals[key] = Refusal(code=code, left=count)

        def accept() -> None:
            self._dictionary.refusals.pop(key, None)

        return accept

    def ignore_writes(self, index: int, sub: int) -> Undo:
        """SDO writes of an object are confirmed, and change nothing.

        Raises:
            Abort: no such object.
        """
        key = self._dictionary.find(index, sub).key
        self._dictionary.ignored.add(key)
        return lambda: self._dictionary.ignored.discard(key)

    def refuse_states(self, *states: DriveState) -> Undo:
        """Commands that lead to one of these device states are not obeyed."""
        self._power.refuse(frozenset(states))
        return lambda: self._power.refuse(frozenset())

    def force_state(self, state: DriveState) -> None:
        """The device changes its state by itself, and tells nobody."""
        self._power.force(state)

    def count_on_from(self, position: int) -> None:
        """The counter jumps: object 0x6064 is `position` [counts] where the shaft is."""
        self._motion.count_on_from(position)

    def ignore_heartbeats(self) -> Undo:
        """The drive no longer watches anybody, whatever object 0x1016 says."""
        self._control.watch(False)
        return lambda: self._control.watch(True)

    def _post(self, item: Sending) -> None:
        """Put into the outbox what becomes of a frame."""
        ready, frame = item
        kind = kind_of(frame)
        impediment = self._impediments.get(kind)
        if impediment is None:
            self._outbox.append(item)
            return
        if impediment.left is not None:
            impediment.left -= 1
            if impediment.left <= 0:
                del self._impediments[kind]
        for _ in range(impediment.copies):
            self._outbox.append((ready + impediment.late, frame))
