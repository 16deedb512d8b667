"""The operator's side at work: reads a device of this computer, and sends what it wishes to a robot far away."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf
from pathlib import Path

import msgspec
from msgspec.structs import replace

from artemis import clock
from artemis.bridges.operator import frames
from artemis.bridges.operator.operator_end import UNHEARD, OperatorEnd, RefusedLink
from artemis.bridges.operator.session import DEAD
from artemis.bridges.operator.status import RobotStatus, Welcome
from artemis.clock import until
from artemis.commands.live import hand_words
from artemis.commands.operator import DeviceChoice, robot_from
from artemis.commands.operator_view import OperatorView
from artemis.commands.terminal import DRIVING, listen_to_keys, somebody_is_there
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.answers import is_in_range, is_whole_input
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.progress import Answer
from artemis.values import OperatorInput, Request

POLL = 0.002
"""The device is asked so often [s]."""
SEND_EVERY = 0.02
"""Without news a command is sent so often [s]."""
NEWS_RATE, NEWS_BURST = 200.0, 10.0
"""News is sent at once, up to so often in a second; so many times also more often."""
OLD = 1.0
"""A state of the robot is shown for so long [s]."""
CONNECT_TIME = 5.0
"""A robot has this long to answer and let us in [s]."""
RETRY, PATIENCE = 0.5, 60.0
"""A link that was lost is tried again so often, and so long [s]."""
STOP_KEPT = 2 * DEAD
"""A quick stop that was sent so shortly before a link was lost [s] may not have arrived: it is asked for again."""
_LEAVE, _END_RUN = "leave", "end"
KEYS: dict[bytes, Request | str] = {
    b" ": Request.QUICKSTOP,
    b"a": Request.ACKNOWLEDGE,
    b"r": Request.ARM,
    b"e": _END_RUN,
    b"q": _LEAVE,
}
HINT = "keys: space quick stop, a acknowledge, r arm again, e end the run, q leave"


class _RobotProtocol(asyncio.Protocol):
    """The socket around an `OperatorEnd`."""

    def __init__(self, end: OperatorEnd) -> None:
        self.end = end
        self.problem: RefusedLink | None = None
        self.closed = asyncio.get_running_loop().create_future()
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        try:
            self.end.receive(data, asyncio.get_running_loop().time())
        except RefusedLink as error:
            self.problem = self.problem or error
            self.abort()
        self.flush()

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.closed.done():
            self.closed.set_result(None)

    def flush(self) -> None:
        """Send what waits."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(bytes(self.end.output))
        self.end.output.clear()

    def abort(self) -> None:
        """Close now."""
        if self._transport is not None:
            self._transport.abort()

    async def finish(self) -> None:
        """Close what is left, after what was sent."""
        if self._transport is not None:
            self._transport.close()
            with suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(self.closed), RETRY)
            self._transport.abort()
            await self.closed


class OperatorDrive:
    """One operator's time at the controls, over as many connections as it takes."""

    def __init__(
        self, host: str, port: int, secret: bytes, tls: ssl.SSLContext | None, name: str, choice: DeviceChoice
    ) -> None:
        """Nothing is opened yet."""
        self._place = f"{host} port {port}"
        self._connect = partial(_connected, host, port, secret, tls, name, frames.DRIVE)
        self._choice, self._view = choice, OperatorView()
        self._device: InputDevice | None = None
        self._asked: list[Request] = []
        self._typed: list[Callable[[bytes], None]] = []
        self._leaving, self._interrupted = False, 0
        self._stop_sent = -inf

    def run(self) -> int:
        """OperatorDrive until somebody leaves; the exit status."""
        try:
            return clock.run(self._main(), simulated=False)
        finally:
            self._view.close()

    async def _main(self) -> int:
        loop = asyncio.get_running_loop()
        self._start = loop.time()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._interrupt, number)
        stop_listening: Callable[[], None] | None = None
        try:
            protocol = await self._first()
            if somebody_is_there():
                stop_listening = listen_to_keys(self._ask, self._hear if self._typed else None, KEYS)
                self._view.say("operator", HINT + (f"; {DRIVING}" if self._typed else ""))
            while True:
                words = await self._session(protocol)
                if self._leaving or protocol.end.over == frames.RUN_OVER:
                    self._view.say("link", words)
                    return 128 + self._interrupted if self._interrupted else 0
                self._view.say("link", f"LOST: {words}; the robot stops by itself; trying again")
                self._view.forget()
                if loop.time() - self._stop_sent <= STOP_KEPT:
                    self._asked.append(Request.QUICKSTOP)
                again = await self._again()
                if again is None:
                    return 128 + self._interrupted if self._interrupted else 0
                protocol = again
        finally:
            if stop_listening is not None:
                stop_listening()
            if self._device is not None:
                self._device.close()

    async def _first(self) -> _RobotProtocol:
        """The first connection: what goes wrong with it is an error."""
        try:
            protocol = await self._connect()
        except RefusedLink as error:
            raise ConfigError(f"{self._place}: refused: {error}") from None
        try:
            self._welcomed(protocol)
        except BaseException:
            await protocol.finish()
            raise
        return protocol

    async def _again(self) -> _RobotProtocol | None:
        """Another connection; None: somebody leaves.

        Raises:
            DeviceLost: the robot does not come back.
        """
        loop = asyncio.get_running_loop()
        latest, reason = loop.time() + PATIENCE, ""
        while loop.time() < latest:
            if self._leaving:
                return None
            try:
                protocol = await self._connect()
                self._asked = list(_stops(self._sample()))
                return protocol
            except (RefusedLink, DeviceLost) as error:
                if str(error) != reason:
                    reason = str(error)
                    self._view.say("link", reason)
            self._asked = list(_stops(self._sample()))  # what nobody heard is not asked for later, but for a stop
            await until(loop.time() + RETRY)
        raise DeviceLost(self._place, f"the link did not come back within {PATIENCE:g} s")

    def _welcomed(self, protocol: _RobotProtocol) -> None:
        """Make the device for the robot that lets us in."""
        welcome = msgspec.json.decode(protocol.end.welcome or b"", type=Welcome)
        robot = robot_from(bytes(welcome.robot))
        context = PluginContext(name=self._choice.name, robot=robot, folder=Path(), typed=self._listen)
        self._device = self._choice.made(context)
        extra = f"; it lets you {', '.join(welcome.allow)}" if welcome.allow else ""
        top = robot.limits.speed_m_s
        self._view.say("link", f"{robot.robot} at {self._place}: you have it, up to {top:g} m/s{extra}")

    async def _session(self, protocol: _RobotProtocol) -> str:
        """Send until the link ends or somebody leaves; why it ended."""
        loop, end = asyncio.get_running_loop(), protocol.end
        status: RobotStatus | None = None
        sent, told, last, shown = 0.0, 0.0, UNHEARD, b""
        budget, before = NEWS_BURST, loop.time()
        try:
            while not protocol.closed.done() and not end.over:
                now = loop.time()
                if end.silent_for(now) > DEAD:
                    return f"nothing was received for {DEAD:g} s"
                sample = self._sample()
                if self._leaving:
                    end.command(replace(sample, enabled=False, speed=0.0), now)
                    end.release()
                    protocol.flush()
                    return "the robot is free"
                budget = min(budget + (now - before) * NEWS_RATE, NEWS_BURST)
                before, is_news = now, budget >= 1.0 and _is_news(sample, last)
                if not end.has_seat:
                    self._asked[:0] = sample.requests  # later
                elif now - sent >= SEND_EVERY or is_news or sample.requests:
                    end.command(sample, now)
                    protocol.flush()
                    self._stop_sent = now if _stops(sample) else self._stop_sent
                    sent, last, budget = now, sample, budget - is_news
                if end.status != shown:
                    shown = end.status
                    status, told = msgspec.json.decode(shown, type=RobotStatus), now
                    self._view.see(status)
                hand = f"{'device' if sample.age is None else 'you:'} {hand_words(sample)}"
                self._view.refresh(status if now - told < OLD else None, end.beat.age, end.beat.round_trip, hand)
                await until(now + POLL)
            return end.over or str(protocol.problem or "the connection was closed")
        finally:
            await protocol.finish()

    def _sample(self) -> OperatorInput:
        """What the device says, with what was asked for by key."""
        assert self._device is not None
        problem, sample = "", UNHEARD
        try:
            sample = self._device.read(asyncio.get_running_loop().time() - self._start)
        except DeviceLost as error:
            problem = str(error)
        if not (is_whole_input(sample) and is_in_range(sample)):
            problem, sample = "sent values out of range", replace(UNHEARD, requests=_stops(sample))
        self._view.device(problem)
        asked, self._asked = tuple(self._asked), []
        return replace(sample, requests=(*asked, *sample.requests))

    def _listen(self, listener: Callable[[bytes], None]) -> bool:
        self._typed.append(listener)
        return somebody_is_there()

    def _hear(self, typed: bytes) -> None:
        for listener in self._typed:
            listener(typed)

    def _ask(self, request: Request | Answer) -> None:
        """A key; a terminal that is closed asks for a stop and the end: of the driving, not of the robot's run."""
        if request in (_LEAVE, Request.END):
            self._leaving = True
        else:
            self._asked.append(Request.END if request == _END_RUN else Request(request))

    def _interrupt(self, number: int) -> None:
        self._leaving, self._interrupted = True, self._interrupted or number


async def _connected(
    host: str,
    port: int,
    secret: bytes,
    tls: ssl.SSLContext | None,
    name: str,
    role: int,
) -> _RobotProtocol:
    """A connection that the robot has let in, or ended in peace.

    Raises:
        DeviceLost: there is no robot, or it does not answer.
        RefusedLink: it does not want us.
    """
    loop, place = asyncio.get_running_loop(), f"{host} port {port}"
    end = OperatorEnd(secret, name, role)
    protocol: _RobotProtocol | None = None
    try:
        async with asyncio.timeout(CONNECT_TIME):
            _, protocol = await loop.create_connection(
                lambda: _RobotProtocol(end), host, port, ssl=tls, server_hostname=host if tls else None
            )
            while end.welcome is None and not end.over and not protocol.closed.done():
                await until(loop.time() + POLL)
    except TimeoutError:
        if protocol is not None:
            await protocol.finish()
        raise DeviceLost(
            place, f"no answer within {CONNECT_TIME:g} s; does the run of the robot listen there?"
        ) from None
    except ssl.SSLError as error:
        raise RefusedLink(f"TLS: {error.reason or error}") from None
    except OSError as error:
        raise DeviceLost(place, f"{_reason(error)}; does the run of the robot listen there?") from None
    if end.welcome is None and not end.over:
        await protocol.finish()
        raise protocol.problem or RefusedLink("it closed the connection")
    return protocol


def _reason(error: OSError) -> str:
    if isinstance(error, socket.gaierror) or not error.errno:
        return error.strerror or str(error)
    return os.strerror(error.errno)


def ask_to_stop(host: str, port: int, secret: bytes, tls: ssl.SSLContext | None, name: str) -> int:
    """Have a robot stop, whoever drives it.

    Raises:
        ConfigError: it refuses.
        DeviceLost: it cannot be reached.
    """

    async def ask() -> str:
        protocol = await _connected(host, port, secret, tls, name, frames.STOP)
        await protocol.finish()
        return protocol.end.over

    try:
        words = clock.run(ask(), simulated=False)
    except RefusedLink as error:
        raise ConfigError(f"{host} port {port}: refused: {error}") from None
    OperatorView().say("stop", words)
    return 0


def _stops(sample: object) -> tuple[Request, ...]:
    """The quick stop in what a device says, whatever else is wrong with that."""
    requests = getattr(sample, "requests", ())
    return (Request.QUICKSTOP,) if isinstance(requests, tuple) and Request.QUICKSTOP in requests else ()


def _is_news(sample: OperatorInput, last: OperatorInput) -> bool:
    return (sample.speed, sample.steering, sample.enabled, sample.neutral) != (
        last.speed,
        last.steering,
        last.enabled,
        last.neutral,
    )
