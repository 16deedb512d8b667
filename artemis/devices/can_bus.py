"""Frames, and the bus that carries them. The only file that imports python-can, and only where a real bus is used.

Adapter libraries raise whatever they like, from ctypes errors to assertions. At this edge every exception of theirs
becomes `DeviceLost` with its text, so the calls into them catch all exceptions.
"""

from __future__ import annotations

import asyncio
import difflib
import errno
import importlib
import inspect
import logging
import re
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar

from msgspec import Struct

from artemis import clock
from artemis.devices.multicast import with_port
from artemis.errors import ConfigError, DeviceBusy, DeviceLost

if TYPE_CHECKING:
    import can
    import numpy as np
    from numpy.typing import NDArray


class Frame(Struct, frozen=True, gc=False):
    """One classic CAN data frame with an 11-bit identifier (or a remote frame, `rtr`)."""

    id: int
    data: bytes = b""
    rtr: bool = False
    time: float = 0.0
    """When it was on the bus, in the loop's time [s]; 0 before it was sent."""


Traffic: TypeAlias = Sequence[tuple[bool, Frame]]
"""Frames on the bus, each with whether we sent it: then it has no time, and was sent before the end of its tick."""
Length = TypeVar("Length", int, "NDArray[np.int64]")


def most_bits(length: Length) -> Length:
    """Most bits of a frame with an 11-bit identifier and `length` data bytes, with stuffing and the pause after it.

    Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, Real-Time Systems 35 (2007),
    equation 1 with g = 34.
    """
    return 34 + 8 * length + 13 + (34 + 8 * length - 1) // 4


class FrameBus(Protocol):
    """A bus as one node sees it: own frames never come back."""

    @property
    def error_frames(self) -> int:
        """Error frames so far: what was on the wire and could not be read as a frame."""

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire at once.

        Raises:
            DeviceBusy: no room for it; it is dropped, the next may go out.
            DeviceLost: the adapter is gone, or off the bus.
        """

    def receive(self) -> list[Frame]:
        """Everything that arrived since the last call, oldest first; never waits.

        Raises:
            DeviceLost: the adapter is gone.
        """

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the running loop call `wake` when frames wait that may be urgent (anything but process data)."""

    def close(self) -> None:
        """Give the adapter back; harmless when repeated."""


BITRATES = (1000000, 800000, 500000, 250000, 125000, 50000, 20000)
"""Rates of an EPOS [bit/s] (object 0x2001, EPOS firmware specification 2010, 14.33)."""

_WITH_DESCRIPTOR = {"socketcan", "udp_multicast"}
"""Back ends whose descriptor is readable as long as a frame waits. Others have none, or read ahead into a buffer of
their own (slcan, socketcand, serial), where a frame could wait unseen: they get a thread."""

_ECHOING = {"udp_multicast"}
"""Back ends that hand a sender its own frames back and do not mark them (`is_rx` is true)."""

_WITHOUT_ADAPTER = {"virtual", "udp_multicast"}
"""Back ends that are always there."""

_ECHO_TIME = 1.0
"""An own frame that did not come back within this time [s] was lost on the way."""

_POLL_TIME = 0.05
"""How long the reading thread waits for a frame before it looks whether it is to end [s]."""

_FRAMES_AT_ONCE = 256
"""A flood of frames lets the loop do something else after this many."""

_FIRST_PDO, _LAST_PDO = 0x180, 0x57F
"""Identifiers of process data (CiA 301 7.3.3)."""

_SOCKETCAN_BUS_OFF = 0x40
"""CAN_ERR_BUSOFF in the identifier of an error frame (Linux, uapi/linux/can/error.h)."""

_NO_ROOM: Mapping[str, frozenset[int]] = {
    "socketcan": frozenset({errno.ENOBUFS, errno.EAGAIN}),
    "kvaser": frozenset({-13}),  # canERR_TXBUFOFL
    "vector": frozenset({11}),  # XL_ERR_QUEUE_IS_FULL
    "systec": frozenset({11}),  # ERR_DLL_TXFULL
}
"""Error codes of a full transmit buffer. Other back ends, and socketcan where it did not even try, only say "full"."""


class CanBus:
    """A `FrameBus` on a python-can back end, read by the running loop (or by one thread that only hands over).

    Error frames are counted; extended, FD and own frames are dropped. `Frame.time` is the loop's time when the kernel
    took the frame in, or where it does not tell, when it was read.
    """

    def __init__(self, words: Mapping[str, Any]) -> None:
        """Open the bus named by python-can's own words: interface, channel, and what else the back end knows.

        Raises:
            ConfigError: a word that the back end does not know, or one that it misses.
            DeviceLost: the adapter cannot be opened.
        """
        if problems := check_bus_words(words):
            raise ConfigError(problems)
        import can

        words = with_port(words)
        interface = str(words["interface"])
        self.name = f"CAN {interface} {words.get('channel', '')}".rstrip()
        self.error_frames = 0
        self._loop = asyncio.get_running_loop()
        self._emptied = self._loop.time()
        try:
            self._bus = can.Bus(ignore_config=True, **words)
        except Exception as error:
            adapter = "is it plugged in, is its driver installed, does another program use it?"
            advice = "check channel and port" if interface in _WITHOUT_ADAPTER else adapter
            raise DeviceLost(self.name, f"cannot be opened: {type(error).__name__}: {error}; {advice}") from error
        self._message = can.Message
        self._interface, self._socketcan = interface, interface == "socketcan"
        self._marks_own = not self._socketcan  # there, what is not `is_rx` came from any process of this host
        self._arrived: list[Frame] = []
        self._sent: deque[tuple[int, bytes, bool, float]] | None = None
        if interface in _ECHOING or words.get("receive_own_messages"):
            self._sent = deque()
        self._problem: str | None = None
        self._wake: Callable[[], None] | None = None
        self._stop = threading.Event()
        self._descriptor = self._bus.fileno() if interface in _WITH_DESCRIPTOR else -1
        self._thread: threading.Thread | None = None
        if self._descriptor >= 0:
            self._loop.add_reader(self._descriptor, self._read)
        else:
            self._thread = threading.Thread(target=self._read_forever, name=self.name, daemon=True)
            self._thread.start()

    def send(self, frame: Frame) -> None:
        """Queue a frame for the wire at once.

        Raises:
            DeviceBusy: no room for it; it is dropped, the next may go out.
            DeviceLost: the adapter is gone, or off the bus.
        """
        if self._problem is not None:
            raise DeviceLost(self.name, self._problem)
        try:
            self._bus.send(
                self._message(arbitration_id=frame.id, data=frame.data, is_extended_id=False, is_remote_frame=frame.rtr)
            )
        except Exception as error:
            refusal = DeviceBusy if self._has_no_room(error) else DeviceLost
            raise refusal(self.name, f"frame 0x{frame.id:03X} was not sent: {error}") from error
        if self._sent is not None:
            self._sent.append((frame.id, b"" if frame.rtr else frame.data, frame.rtr, self._loop.time()))

    def receive(self) -> list[Frame]:
        """Everything that arrived since the last call, oldest first; never waits.

        Raises:
            DeviceLost: the adapter is gone.
        """
        if self._descriptor >= 0:
            self._take(self._waiting(), wake=False)
        if self._problem is not None:
            raise DeviceLost(self.name, self._problem)
        frames, self._arrived = self._arrived, []
        return frames

    def listen(self, wake: Callable[[], None]) -> None:
        """Have the running loop call `wake` when anything but process data arrived, or when the bus is lost."""
        self._wake = wake

    def close(self) -> None:
        """Give the adapter back; harmless when repeated. Afterwards `send` and `receive` raise DeviceLost."""
        if self._stop.is_set():
            return
        self._stop.set()
        self._wake = None
        self._lose("is closed")
        if self._thread is not None:
            self._thread.join(timeout=1.0)
        try:
            self._bus.shutdown()
        except Exception as error:  # noqa: BLE001
            logging.getLogger(__name__).warning("%s did not close: %s", self.name, error)

    def _has_no_room(self, error: Exception) -> bool:
        """Whether a frame was refused only because the transmit buffer is full."""
        code = getattr(error, "error_code", None)  # of python-can's own exceptions
        return code in _NO_ROOM.get(self._interface, ()) or (code is None and "full" in str(error).lower())

    def _read(self) -> None:
        """The loop's reader of the descriptor, and what the reading thread hands over."""
        self._take(self._waiting(), wake=True)

    def _waiting(self) -> Iterable[can.Message]:
        try:
            for _ in range(_FRAMES_AT_ONCE):
                message = self._bus.recv(0)
                if message is None:
                    self._emptied = self._loop.time()
                    return
                yield message
        except Exception as error:  # noqa: BLE001
            self._lose(f"cannot be read: {type(error).__name__}: {error}")

    def _read_forever(self) -> None:
        """The reading thread."""
        try:
            while not self._stop.is_set():
                message = self._bus.recv(_POLL_TIME)
                if message is not None:
                    self._hand_over(partial(self._take, (message,), wake=True))
        except Exception as error:  # noqa: BLE001
            self._hand_over(partial(self._lose, f"cannot be read: {type(error).__name__}: {error}"))

    def _hand_over(self, act: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the loop was closed before the bus: nobody is left to tell
            self._loop.call_soon_threadsafe(act)

    def _take(self, messages: Iterable[can.Message], *, wake: bool) -> None:
        date, now = clock.wall_date().timestamp(), self._loop.time()  # in this order: never too early
        urgent = False
        for message in messages:
            if message.is_error_frame:
                self.error_frames += 1
                if self._socketcan and message.arbitration_id & _SOCKETCAN_BUS_OFF:
                    self._lose("bus off; are the wiring, both terminating resistors and the bit rate right?")
                continue
            time = now
            if self._descriptor >= 0 and message.timestamp:  # by the wall's clock, which somebody may set
                time = max(self._emptied, min(now, now - date + message.timestamp))
            frame = Frame(message.arbitration_id, bytes(message.data), message.is_remote_frame, time)
            own = self._is_echo(frame) or (self._marks_own and not message.is_rx)
            if own or message.is_extended_id or message.is_fd:
                continue
            self._arrived.append(frame)
            urgent = urgent or not _FIRST_PDO <= frame.id <= _LAST_PDO
        if urgent and wake and self._wake is not None:
            self._wake()

    def _is_echo(self, frame: Frame) -> bool:
        """Whether this is an own frame on its way back; another node's equal frame only takes its place."""
        if not self._sent:
            return False
        while self._sent and self._sent[0][3] < frame.time - _ECHO_TIME:
            self._sent.popleft()
        for position, sent in enumerate(self._sent):
            if sent[:3] == (frame.id, frame.data, frame.rtr):
                del self._sent[position]
                return True
        return False

    def _lose(self, problem: str) -> None:
        if self._problem is not None:
            return
        self._problem = problem
        if self._descriptor >= 0:
            self._loop.remove_reader(self._descriptor)
            self._descriptor = -1
        if self._wake is not None:
            self._wake()


def detected_adapters() -> list[Mapping[str, object]]:
    """Each adapter that python-can finds on this computer, in its own words, as they may stand behind `bus:`.

    Takes seconds. Many back ends cannot look for their adapters.

    Raises:
        DeviceLost: a back end failed.
    """
    import can

    try:
        found = can.detect_available_configs()
    except Exception as error:
        raise DeviceLost("CAN", f"adapters cannot be looked for: {type(error).__name__}: {error}") from error
    return [words for words in found if words["interface"] not in _WITHOUT_ADAPTER]


def check_bus_words(words: Mapping[str, Any]) -> list[str]:
    """What is wrong with python-can's words for a bus, one line each; nothing is opened.

    A back end that cannot be loaded on this machine (its vendor's library is missing) is not judged: a mission must
    be simulated where there is no adapter. Opening the bus will tell.
    """
    from can.interfaces import BACKENDS

    interface = words.get("interface")
    if not isinstance(interface, str) or interface not in BACKENDS:
        return [f"interface: python-can has no {interface!r}{_nearest(interface, BACKENDS)}"]
    module, name = BACKENDS[interface]
    try:
        backend = getattr(importlib.import_module(module), name)
    except Exception:  # noqa: BLE001
        return []
    known, needed = _words_of(backend)
    problems = [
        f"{word}: no option of the {interface} interface{_nearest(word, known)} (it knows {', '.join(sorted(known))})"
        for word in words
        if word not in known and word not in ("interface", "bitrate")
    ]
    if "bitrate" in words and "bitrate" not in known:
        problems.append(f"bitrate: {interface} takes the rate as the system has set it (`ip link` for socketcan)")
    problems += [f"{word}: the {interface} interface needs it" for word in sorted(needed) if word not in words]
    if "bitrate" in known and words.get("bitrate", BITRATES[0]) not in BITRATES:
        problems.append(f"bitrate: {words['bitrate']!r} is not a rate of an EPOS, which knows {BITRATES} bit/s")
    return problems


_FETCHED = r"""\bkwargs(?:\.get\(|\.pop\(|\[)\s*["']([a-z]\w*)"""


def _words_of(backend: type) -> tuple[set[str], set[str]]:
    """Words that the back end's constructor knows, and those that it cannot do without.

    They stand in its signature, in those of the classes to which it passes the rest on, or (kvaser, systec, pcan) are
    fetched from `kwargs` one by one, which only its source tells.
    """
    known: set[str] = set()
    needed: set[str] = set()
    found = False
    for class_ in backend.__mro__[:-1]:
        constructor = vars(class_).get("__init__")
        if constructor is None:
            continue
        parameters = list(inspect.signature(constructor).parameters.values())[1:]
        named = [p for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
        known |= {p.name for p in named}
        if not found:
            needed = {p.name for p in named if p.default is p.empty}
        found = True
        with suppress(OSError):  # no source at hand
            known |= set(re.findall(_FETCHED, inspect.getsource(constructor)))
        if len(named) == len(parameters):
            break
    return known, needed


def _nearest(word: object, known: Iterable[str]) -> str:
    found = difflib.get_close_matches(str(word), known, n=1, cutoff=0.5)
    return f"; did you mean {found[0]!r}?" if found else ""
