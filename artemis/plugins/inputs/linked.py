"""What inputs share whose operator is at the other end of a link: the link's reports become samples.

A process of its own alone reads what comes from the network. A sample's age counts from the robot's beat that the
operator's command quotes, plus the age of the operator's device. After every gap, and for everyone who takes the seat,
all controls are released once before the enable button counts.
"""

from __future__ import annotations

import asyncio
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar, Protocol

import msgspec

from artemis.bridges.operator.session import FRESH, Arrived, Given, LinkReport, Problem
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.stated import STALE
from artemis.values import OperatorInput, Request

LINK_LOST, LATENCY, STALLED, SLOW = "NET-01", "NET-02", "NET-04", "NET-15"
SLOW_SHARE = 0.8
"""Of the time for which a command counts: when it is older, the robot drives slowly."""


class LinkPort(Protocol):
    """The link as the input sees it."""

    def watch(self, news: Callable[[], None]) -> None:
        """Have `news` called on the running loop when there are reports."""

    def take(self) -> list[LinkReport]:
        """The reports since the last call, oldest first. Raises DeviceLost."""

    def tell(self, status: bytes) -> None:
        """What the robot does, for the operator."""

    def close(self) -> None:
        """End it."""


class LinkedInput(ABC):
    """One operator at a time, at the other end of a link."""

    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True
    stale_s: ClassVar[float] = FRESH
    """A command counts until the beat that it quotes is so old [s]."""

    def __init__(self, context: PluginContext, port: LinkPort | None, clock: Callable[[], float] | None = None) -> None:
        """Watch the link.

        Args:
            context: Of the run.
            port: The link; None: there is none, as where a mission is only checked.
            clock: Of the link's times [s]; None: the running loop's.
        """
        self._name, self._wake, self._clock = context.name, context.wake, clock
        self._arrived: Arrived | None = None
        self._seen: Arrived | None = None
        """The command of the last sample."""
        self._report = LinkReport()
        self._late: tuple[float, float] = (-math.inf, 0.0)
        self._stops = False
        self._asked: list[LinkReport] = []
        """Reports with requests, or with what was given, that no sample has had yet."""
        self._problems: list[Problem] = []
        self._released = False
        self._port = port
        if port is not None:
            port.watch(self._hear)

    @abstractmethod
    def _wish(self, arrived: Arrived, now: float) -> tuple[float, float]:
        """Speed [m/s] and angle [rad] of the virtual front wheel that a command wishes at `now` [s]."""

    def read(self, now: float) -> OperatorInput:
        """What the operator wishes, as far as it still counts.

        Raises:
            DeviceLost: the link's process has ended, or there is none.
        """
        if self._port is None:
            raise DeviceLost(self._name, "an operator needs real time: leave `pace: fast` out of the mission")
        try:
            self._take()
        except DeviceLost:
            self._asked.clear()
            stops, self._stops = self._stops, False
            if not stops:  # a stop goes first
                raise
            return OperatorInput(source=self._name, neutral=False, requests=(Request.QUICKSTOP,))
        time = (self._clock or asyncio.get_running_loop().time)()
        requests, given = self._counting(time)
        sample = msgspec.structs.replace(self._sample(time), requests=requests)
        for each in given:
            sample = self._with(sample, each)
        return sample

    def close(self) -> None:
        """End the link."""
        if self._port is not None:
            self._port.close()

    def take_problems(self) -> list[Problem]:
        """What is wrong with the link since the last call: rows of the fault table, and what was seen."""
        problems, self._problems = self._problems, []
        return problems

    def _hear(self) -> None:
        """Between two ticks; that the process has ended is for the next `read` to say."""
        with suppress(DeviceLost):
            self._take()

    def _take(self) -> None:
        """Take the link's reports; a quick stop does not wait for the next tick."""
        assert self._port is not None
        for report in self._port.take():
            if (report.seat, report.since) != (self._report.seat, self._report.since):
                self._released, self._late = False, (-math.inf, 0.0)
            self._report, self._arrived = report, report.newest
            self._late = report.late or self._late
            self._problems += report.problems
            if report.requests or report.given:
                self._asked.append(report)
            if Request.QUICKSTOP in report.requests:
                self._stops = True
                self._wake()

    def _counting(self, now: float) -> tuple[tuple[Request, ...], list[Given]]:
        """What was asked for and given since the last sample, at `now` [s] of the link's clock.

        What waited for a run that was held up counts no longer than a command does, but for a quick stop.
        """
        asked, self._asked, self._stops = self._asked, [], False
        requests: list[Request] = []
        given: list[Given] = []
        for report in asked:
            if (age := now - report.asked) <= self.stale_s:
                requests += report.requests
                given += report.given
                continue
            late = [request.value for request in report.requests if request is not Request.QUICKSTOP]
            late += ["a pose or an answer"] * bool(report.given)
            requests += [request for request in report.requests if request is Request.QUICKSTOP]
            words = f"{report.who}: {', '.join(late)}: {age:.1f} s old, without effect; ask again"
            self._problems.append((STALLED, words))
        return tuple(requests), given

    def _with(self, sample: OperatorInput, given: Given) -> OperatorInput:
        """The sample with something that was given, where that can be used."""
        return sample

    def _sample(self, now: float) -> OperatorInput:
        """What the newest command wishes at `now` [s] of the link's clock."""
        report, arrived = self._report, self._arrived
        if report.seat == "free":
            self._released = False
            return OperatorInput(source=self._name, neutral=report.who != "", age=0.0 if report.who else None)
        if report.seat == "lost":
            self._released = False
            self._problems.append((LINK_LOST, f"{report.who}: {report.why}"))
            return OperatorInput(source=self._name, neutral=False, age=max(now - report.since, 0.0) + self.stale_s)
        quoted = max(now - (report.since if arrived is None else arrived.sent), 0.0)
        frozen = arrived is not None and arrived.age > STALE  # his device: INP-03
        age = quoted + (0.0 if arrived is None else arrived.age)
        if quoted > self.stale_s or (age > self.stale_s and not frozen):
            self._released = False
            late, how_old = self._late
            if now - late <= self.stale_s:
                self._problems.append((LATENCY, f"{report.who}: commands are {how_old * 1e3:.0f} ms old"))
            else:
                self._problems.append((LINK_LOST, f"{report.who}: nothing new for {age * 1e3:.0f} ms"))
        elif quoted > SLOW_SHARE * self.stale_s and arrived != self._seen:
            self._problems.append((SLOW, f"{report.who}: {quoted * 1e3:.0f} ms"))
        self._seen = arrived
        if arrived is None:  # just seated: the first command is on its way
            return OperatorInput(source=self._name, neutral=False, age=age)
        if not arrived.heard:
            self._released = False
            return OperatorInput(source=self._name, neutral=False)
        self._released = age <= self.stale_s and (self._released or arrived.neutral)
        speed, steering = self._wish(arrived, now)
        return OperatorInput(
            source=self._name,
            speed=speed,
            steering=steering,
            enabled=arrived.enabled and self._released,
            neutral=arrived.neutral and not arrived.enabled,
            age=age,
            raw=(arrived.speed, arrived.steering),
            axes=arrived.axes,
            buttons=(arrived.enabled,),
        )
