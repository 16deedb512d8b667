"""Who watches whom: heartbeats of the drive and of others, node guarding.

Sources: CiA 301 7.2.8.3; EPOS communication guide 2006, 7.5; EPOS firmware specification 2010, 11.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from artemis.sim.dictionary import AbortCode, AccessRefused, Dictionary, key_of

MILLISECOND = 1e-3
TOGGLE = 0x80
CONSUMERS = (1, 2)
"""Sub-indices of object 0x1016."""


@dataclass(slots=True, kw_only=True)
class Consumer:
    """One node whose heartbeat the drive expects."""

    producer: int
    time: float
    """Longest silence [s]."""
    deadline: float = math.inf
    """inf until the first heartbeat was heard, and again after a time-out."""


class ErrorControl:
    """Timers of heartbeat producer, heartbeat consumers and life guarding.

    `changed` is told when the watched producers are others.
    """

    def __init__(self, dictionary: Dictionary, clock: Callable[[], float], changed: Callable[[], None]) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._changed = changed
        self.consumers: dict[int, Consumer] = {}
        """By producer."""
        self._watching = True
        self._heartbeat_due = math.inf
        self._heartbeat_time = 0.0
        self._life_deadline = math.inf
        self._toggle = 0
        self._guarded = key_of(0x100C, 0) in dictionary.entries
        for sub in CONSUMERS:
            dictionary.checks[key_of(0x1016, sub)] = self._consumer_judge(sub)
            dictionary.written[key_of(0x1016, sub)] = lambda _: self._read_consumers()
        dictionary.written[key_of(0x1017, 0)] = lambda _: self._read_producer()

    def start(self) -> None:
        """The node leaves Initialising: all watching begins anew."""
        self._toggle = 0
        self._read_consumers()
        self._read_producer()

    def stop(self) -> None:
        """The node is initialising: nobody is watched, nothing is sent."""
        self._heartbeat_due = self._life_deadline = math.inf
        self.consumers.clear()

    @property
    def due(self) -> float:
        """Time of the next heartbeat or time-out [s]."""
        due = min(self._heartbeat_due, self._life_deadline)
        for consumer in self.consumers.values():
            if consumer.deadline < due:
                due = consumer.deadline
        return due

    def hear(self, producer: int, now: float) -> float:
        """A watched node sent its heartbeat; returns its new deadline [s]."""
        consumer = self.consumers[producer]
        consumer.deadline = now + consumer.time
        return consumer.deadline

    def watch(self, watching: bool) -> None:
        """Failure: nobody is watched, whatever object 0x1016 says; or is again, from the next heartbeat on."""
        self._watching = watching
        self.consumers.clear()
        self._read_consumers()

    def answer_guard(self, state: int, now: float) -> int | None:
        """Answer to a guarding request: state and toggle bit; None while a heartbeat is produced instead, or always."""
        if self._heartbeat_time or not self._guarded:
            return None
        answer = state | self._toggle
        self._toggle ^= TOGGLE
        number = self._dictionary.number
        life = number(0x100C) * number(0x100D) * MILLISECOND
        self._life_deadline = now + life if life else math.inf
        return answer

    def advance(self, now: float) -> tuple[bool, bool]:
        """Run the timers; returns whether a heartbeat is to be sent, and whether somebody fell silent."""
        beat, silent = False, False
        if self._heartbeat_due <= now:
            beat = True
            self._heartbeat_due += self._heartbeat_time
        if self._life_deadline <= now:
            self._life_deadline, silent = math.inf, True
        for consumer in self.consumers.values():
            if consumer.deadline <= now:
                consumer.deadline, silent = math.inf, True
        return beat, silent

    def _read_producer(self) -> None:
        self._heartbeat_time = self._dictionary.number(0x1017) * MILLISECOND
        self._heartbeat_due = self._clock() if self._heartbeat_time else math.inf
        if self._heartbeat_time:
            self._life_deadline = math.inf

    def _read_consumers(self) -> None:
        """Take over 0x1016; a consumer that did not change goes on."""
        consumers = {}
        for sub in CONSUMERS:
            value = self._dictionary.number(0x1016, sub)
            producer, time = value >> 16 & 0x7F, (value & 0xFFFF) * MILLISECOND
            if not time or not self._watching:
                continue
            known = self.consumers.get(producer)
            consumers[producer] = (
                known if known is not None and known.time == time else Consumer(producer=producer, time=time)
            )
        self.consumers = consumers
        self._changed()

    def _consumer_judge(self, sub: int) -> Callable[[int], None]:
        def judge(value: int) -> None:
            producer = value >> 16 & 0xFF
            if value >> 24 or (value & 0xFFFF and not 1 <= producer <= 127):
                raise AccessRefused(AbortCode.RANGE)
            other = self._dictionary.number(0x1016, 3 - sub)
            if value & 0xFFFF and other & 0xFFFF and other >> 16 == producer:
                raise AccessRefused(AbortCode.INCOMPATIBLE)

        return judge
