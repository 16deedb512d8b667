"""What the inputs of an earlier run gave, so that the same drive happens again: their samples as they were recorded.

As a file it is one line of JSON for each tick.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from msgspec.structs import replace

from artemis.errors import ConfigError, DeviceLost, similar
from artemis.values import OperatorInput, Request

ROUNDING = 1e-6
"""Two times that differ by less [s] are the same."""


class InputTick(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One tick."""

    time: float
    """Run time [s]."""
    inputs: tuple[OperatorInput, ...]
    """Of every input that gave one."""


def content_of(moments: Iterable[InputTick]) -> bytes:
    """The ticks of a run as the content of a file."""
    return b"".join(msgspec.json.encode(moment) + b"\n" for moment in moments)


def is_recorded(content: bytes) -> bool:
    """Whether a file is such a one: no table and no list begins so."""
    return content.startswith(b'{"time":')


class RecordedHand:
    """One input of a recorded run, tick by tick."""

    def __init__(self, content: bytes, source: str, name: str, given: str) -> None:
        """`content` of the file `source`; the input was called `name` there, and its samples go on as `given`.

        Raises:
            ConfigError: the file is damaged, or the run had no such input.
        """
        moments = _moments(content, source)
        start = moments[0].time
        self.times = [moment.time - start - ROUNDING for moment in moments]
        self._samples = [next((s for s in moment.inputs if s.source == name), None) for moment in moments]
        names = sorted({sample.source for moment in moments for sample in moment.inputs})
        if name not in names:
            there = similar(name, names) or "it had none"
            raise ConfigError(f"{given}: input: no input {name} gave anything in the run {source}; {there}")
        self.top_speed = max(abs(sample.speed) for sample in self._samples if sample is not None)
        """The highest speed that was wished [m/s]."""
        self._given, self._row = given, 0

    def go_to(self, row: int) -> tuple[Request, ...]:
        """What was asked for in the next tick."""
        self._row, sample = row, self._samples[row]
        return () if sample is None else sample.requests

    def sample(self, now: float) -> OperatorInput:
        """What it gave in the tick in force. In the last one nobody holds anything any more: the run had ended.

        Raises:
            DeviceLost: it gave nothing.
        """
        if self._row == len(self._samples) - 1:
            return OperatorInput(source=self._given, age=0.0)
        sample = self._samples[self._row]
        if sample is None:
            raise DeviceLost(self._given, "it gave nothing in the recorded run, either")
        return replace(sample, source=self._given)


def _moments(content: bytes, source: str) -> list[InputTick]:
    decode = msgspec.json.Decoder(InputTick).decode
    moments: list[InputTick] = []
    for number, line in enumerate(content.splitlines(), start=1):
        try:
            moment = decode(line)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:  # ValueError: not UTF-8, unknown request
            raise ConfigError(f"{source}:{number}:1: no tick of a recorded run: {error}") from error
        if moments and moment.time < moments[-1].time:
            raise ConfigError(f"{source}:{number}:1: time {moment.time:g} after {moments[-1].time:g}: not in order")
        moments.append(moment)
    return moments
