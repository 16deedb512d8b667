"""An observer in a process of its own: what it computes, and how it ends, is nothing to the ticks.

The run's end, `ObserverProcess`, is an observer like any other; its thread hands the ticks over, through a pair of
sockets. A process that ends is started again; ticks that pass meanwhile are not told, but counted.
"""

from __future__ import annotations

import pickle
import select
import socket
import struct
import sys
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import msgspec

from artemis import config
from artemis.bridges.child_process import ENDED, ChildProcess, Restarts
from artemis.clock import stopwatch
from artemis.devices.can_bus import Frame, Traffic
from artemis.errors import ConfigError, PluginError
from artemis.plugins.contracts import Observer, PluginContext
from artemis.plugins.guard import PLUGIN_ERRORS, Problem, told
from artemis.plugins.observing import Observation
from artemis.values import Tick

if TYPE_CHECKING:
    from artemis.mapping.occupancy import ShownMap

BEGIN = 20.0
"""A process has this long until its observer is made [s]."""
HANG = 5.0
"""One that takes nothing for so long is killed [s]."""
END = 4.0
"""It has this long to close its observer [s]; then it is killed."""
_LENGTH = struct.Struct("<I")
_MAIN = "from artemis.plugins.own_process import main; main()"

Shown = tuple[Tick, list[tuple[bool, Frame]], float]
TICK, MAP = b"t", b"m"
"""What a frame to the process begins with: a tick; the map of the run, where it is another one than before."""
Said = tuple[str, str, str]
"""`made`, `refused` with its reason, or a row of the fault table with name and words."""
_ENCODE = msgspec.msgpack.Encoder().encode


class _Setup(NamedTuple):
    """What a new process is told first."""

    plugin: Callable[[Any, PluginContext], Observer]
    keys: config.Config
    context: dict[str, object]


class ObserverProcess:
    """An observer whose work is done by one of the class `plugin` in another process."""

    Config: ClassVar[type[config.Config]] = config.Config

    def __init__(
        self, plugin: Callable[[Any, PluginContext], Observer], keys: config.Config, context: PluginContext
    ) -> None:
        """Start the process; `wait` says whether its observer could be made.

        Raises:
            PluginError: what it has to be told cannot be told.
        """
        self._name = context.name
        known = {field.name: getattr(context, field.name) for field in fields(context)}
        told_of = {name: value for name, value in known.items() if not callable(value)}
        try:
            setup = pickle.dumps(_Setup(plugin, keys, told_of))
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            words = f"it cannot have a process of its own: {told(error)}"
            raise PluginError(f"PLG-01 {context.name}: the plugin cannot be made: {words}") from error
        self._map = context.map
        self._map()  # what is known is read before the run
        self._first = _framed(setup)
        self._problems: list[Problem] = []
        self._child: _Child | None = _Child(self._first)
        self._restarts, self._closed = Restarts(lambda: stopwatch()), False
        self._missed = 0

    @property
    def pid(self) -> int | None:
        """Of the process; None: there is none at present."""
        return None if self._child is None else self._child.pid

    @property
    def works(self) -> bool:
        """There is one, and its observer is made."""
        return (child := self._child) is not None and child.made

    def wait(self) -> None:
        """Wait until the observer is made, before the first tick.

        Raises:
            ConfigError: it refuses its configuration, or cannot be made.
        """
        for last in (False, True):
            child = self._child = self._child or _Child(self._first)
            child.hear(BEGIN)
            if child.made:
                self._restarts.works()
                return
            words = child.refused or child.kill() or f"it was not made within {BEGIN:g} s"
            self._child = None
            if child.refused or last:
                child.kill()
                raise ConfigError(words if child.refused else f"PLG-01 {self._name}: its process: {words}")

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Hand a tick over, if the process is there."""
        if self._child is None and not self._closed and self._restarts.due:
            self._begin_again()
        if (child := self._child) is None:
            self._missed += 1
            return
        self._listen(child)
        if child.made and not child.over and not self._tell(child, (tick, traffic, now)):
            child.over = f"took nothing for {HANG:g} s, and was killed"
        if not child.made and stopwatch() - child.begun > BEGIN:
            child.over = child.over or f"it was not made within {BEGIN:g} s"
        self._missed += not child.made
        if child.over or child.refused:
            self._end(child)

    def _begin_again(self) -> None:
        self._restarts.begin()
        try:
            self._child = _Child(self._first)
        except OSError as error:
            self._restarts.ended(f"its process cannot be started: {error.strerror}")

    def _tell(self, child: _Child, shown: tuple[Tick, Traffic, float]) -> bool:
        """Send a tick, with the map before it where that changed; False: they are not taken."""
        known = self._map()
        if known is not child.map:
            child.map = known
            if not child.say(_framed(MAP + pickle.dumps(known))):
                return False
        return child.say(_framed(TICK + _ENCODE(shown)))

    def take_problems(self) -> list[Problem]:
        """Those of the observer; that its process ended, and that it is back."""
        if self._child is not None:
            self._listen(self._child)
        self._problems += [(ENDED, self._name, words) for words in self._restarts.take()]
        problems, self._problems = self._problems, []
        return problems

    def close(self) -> None:
        """Have the observer closed, and its process end; harmless when repeated."""
        if (child := self._child) is not None:
            child.finish()
            self._take(child)
            child.kill()
            self._child = None
        self._closed = True

    def _listen(self, child: _Child) -> None:
        """Take what it said, without waiting."""
        made = child.made
        child.hear(0.0)
        if child.made and not made:
            self._restarts.works(f"; {self._missed} ticks were not shown")
            self._missed = 0
        self._take(child)

    def _take(self, child: _Child) -> None:
        self._problems += child.problems
        child.problems.clear()

    def _end(self, child: _Child) -> None:
        """It is no more; the next tick starts it again, or a later one."""
        status, self._child = child.kill(), None
        self._restarts.ended(child.refused or (child.over if child.over != _CLOSED else status))


_CLOSED = "ended"


class _Child:
    """One process, from its start to its end."""

    def __init__(self, first: bytes) -> None:
        self.begun = stopwatch()
        self.made, self.refused, self.over = False, "", ""
        self.problems: list[Problem] = []
        self.map: ShownMap | None = None
        """The newest that it was sent."""
        self._heard = bytearray()
        self._link, others = socket.socketpair()
        with others:
            self._process = ChildProcess(["-c", _MAIN], [others.fileno()])
        self.pid = self._process.pid
        self._link.settimeout(BEGIN)  # it reads once it has imported what it needs
        if not self.say(first):
            self.over = f"took nothing for {BEGIN:g} s, and was killed"
        self._link.settimeout(HANG)

    def say(self, data: bytes) -> bool:
        """Send bytes; False: they are not taken. That it has ended shows when it is heard."""
        try:
            self._link.sendall(data)
        except TimeoutError:
            return False
        except OSError:
            self.over = _CLOSED
        return True

    def hear(self, patience: float) -> None:
        """Take what it said; with `patience` [s] wait until its observer is made, or it ends."""
        self._process.trim()
        until = stopwatch() + patience
        while not self.over:
            wait = 0.0 if self.made or self.refused else max(until - stopwatch(), 0.0)
            if not select.select([self._link], [], [], wait)[0]:
                return
            self._receive()

    def finish(self) -> None:
        """Have it end, and hear its last words."""
        try:
            self._link.shutdown(socket.SHUT_WR)
        except OSError:
            return
        until = stopwatch() + END
        while self.made and not self.over and (left := until - stopwatch()) > 0:
            if select.select([self._link], [], [], left)[0]:
                self._receive()

    def kill(self) -> str:
        """How it ended; it is made to, if it has not. Harmless when repeated."""
        if self.over == _CLOSED:
            self._process.wait(1.0)  # its connection is gone: so is it
        self._link.close()
        return self._process.end()

    def _receive(self) -> None:
        try:
            data = self._link.recv(1 << 16)
        except OSError:
            data = b""
        if not data:
            self.over = self.over or _CLOSED
            return
        heard = self._heard
        heard += data
        while len(heard) >= 4 and len(heard) >= (end := 4 + _LENGTH.unpack_from(heard)[0]):
            kind, name, words = msgspec.msgpack.decode(bytes(heard[4:end]), type=Said)
            del heard[:end]
            if kind == "made":
                self.made = True
            elif kind == "refused":
                self.refused = words
            else:
                self.problems.append((kind, name, words))


def _framed(data: bytes) -> bytes:
    return _LENGTH.pack(len(data)) + data


# ------------------------------------------------------------------------------------------- in the other process


def main() -> None:
    """Be the other process: argument is the number of its socket."""
    with socket.socket(fileno=int(sys.argv[1])) as link, link.makefile("rb") as stream:
        setup: _Setup = pickle.loads(_read(stream))
        maps: list[ShownMap | None] = [None]
        context = PluginContext(**setup.context, map=lambda: maps[0])  # type: ignore[arg-type]
        try:
            observer = setup.plugin(setup.keys, context)
        except ConfigError as error:
            _say(link, "refused", "", str(error))
            return
        except PLUGIN_ERRORS as error:
            _say(link, "refused", "", f"PLG-01 {context.name}: the plugin cannot be made: {told(error)}")
            return
        _say(link, "made", "", "")
        observation = Observation(context.name, observer, threaded=False)
        decode = msgspec.msgpack.Decoder(Shown).decode
        try:
            while data := _read(stream):
                if data[:1] == MAP:
                    maps[0] = pickle.loads(data[1:])
                    continue
                observation.see(*decode(data[1:]))
                for problem in observation.take_problems():
                    _say(link, *problem)
        finally:
            observation.close()
        for problem in observation.take_problems():
            _say(link, *problem)


def _read(stream: Any) -> bytes:  # noqa: ANN401 (a file of bytes)
    """The next bytes; none: the run has ended."""
    head = stream.read(4)
    length = _LENGTH.unpack(head)[0] if len(head) == 4 else 0
    data: bytes = stream.read(length)
    return data if len(data) == length else b""


def _say(link: socket.socket, kind: str, name: str, words: str) -> None:
    try:
        link.sendall(_framed(_ENCODE((kind, name, words))))
    except OSError:
        pass  # the run is over: nobody wants to know
