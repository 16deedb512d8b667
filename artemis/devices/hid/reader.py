"""The thread that reads one device. It only enumerates, opens, reads and hands bytes over; nothing is decided here."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Literal, NamedTuple

from artemis.devices.hid.descriptor import is_control
from artemis.devices.hid.port import HidHandle, HidInfo, HidPort
from artemis.errors import DeviceLost, HidError

MOST = 256
"""Reports that may wait to be taken; of more the newest are kept."""
SEARCH_EVERY = 1.0
"""Between two looks for the device [s]."""
READ_TIME = 0.05
"""How long the thread waits for a report before it looks whether it is to end [s]."""

State = Literal["searching", "open", "lost"]


class _Found(NamedTuple):
    """A device that is wanted, opened."""

    info: HidInfo
    descriptor: bytes
    handle: HidHandle


class HidReader:
    """Finds one device, reads it, and finds it again when it was plugged out.

    What it tells of itself is written by the thread, and may be read by any.
    """

    def __init__(
        self,
        port: HidPort,
        wanted: Callable[[HidInfo, bytes], bool],
        on_report: Callable[[bytes], None] | None = None,
        threaded: bool = True,
    ) -> None:
        """Begin to search.

        Args:
            port: Where devices are found.
            wanted: Whether this is the device, by its raw report descriptor, too. Asked once as long as it is plugged
                in; never for what its first collection says is no joystick, gamepad or wheel. May raise HidError.
            on_report: Called with each report at once, in the thread.
            threaded: Without, `take` does the work, and does not wait.
        """
        self.state: State = "searching"
        """`lost`: it was open, and is sought again."""
        self.generation = 0
        """Rises each time a device is opened: what came before is another device's, or another plug's."""
        self.error = ""
        """Why it is not open."""
        self.info: HidInfo | None = None
        """The device that is open, or was last."""
        self.descriptor = b""
        """Its raw report descriptor."""
        self.dropped = 0
        """Reports that waited too long to be taken."""
        self._port, self._wanted, self._on_report = port, wanted, on_report
        self._handle: HidHandle | None = None
        self._unwanted: set[HidInfo] = set()
        self._reports: deque[bytes] = deque(maxlen=MOST)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._search_at = 0.0
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._work, name="hid reader", daemon=True)
            self._thread.start()

    def take(self, now: float) -> list[bytes]:
        """Reports since the last call, oldest first. None are of a device before the present one.

        `now` [s], on any clock that only rises, matters without a thread.
        """
        if self._thread is None and not self._stop.is_set():
            self._poll(now)
        with self._lock:
            reports = list(self._reports)
            self._reports.clear()
        return reports

    def close(self) -> None:
        """Give the device back; harmless when repeated. The thread leaves first, within `READ_TIME`."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=SEARCH_EVERY)
        else:
            self._lose("is closed")

    # ------------------------------------------------------------------------------------------ with and without thread

    def _work(self) -> None:
        problem = "the reader has failed"
        try:
            while not self._stop.is_set():
                self._search()
                while self._handle is not None and not self._stop.is_set():
                    self._read(READ_TIME)
                self._stop.wait(SEARCH_EVERY)
            problem = "is closed"
        finally:
            self._lose(problem)

    def _poll(self, now: float) -> None:
        if self._handle is None:
            if now < self._search_at:
                return
            self._search()
        for _ in range(MOST):
            if self._handle is None or not self._read(0.0):
                break
        if self._handle is None:
            self._search_at = now + SEARCH_EVERY

    # ------------------------------------------------------------------------------------------ one device

    def _search(self) -> None:
        """Open the one device that is wanted; else say why there is none."""
        try:
            present = [info for info in self._port.enumerate() if not info.usage or is_control(info.usage)]
        except DeviceLost as error:
            self.error = str(error)
            return
        self._unwanted.intersection_update(present)
        found: list[_Found] = []
        problems: list[str] = []
        for info in present:
            try:
                found += self._opened(info)
            except DeviceLost as error:
                problems.append(str(error))
            except HidError as error:
                problems.append(f"{info}: {error}")
        chosen = self._choice(found)
        for each in found:
            if each is not chosen:
                each.handle.close()
        if chosen is not None:
            self._begin(chosen)
        elif found:
            several = "; ".join(str(each.info) for each in found)
            self.error = f"several devices match, and none is used: {several}; unplug all but one, or name its serial"
        else:
            self.error = "; ".join(problems) or "no such device is plugged in"

    def _opened(self, info: HidInfo) -> list[_Found]:
        """The device, if it is wanted."""
        if info in self._unwanted:
            return []
        handle = self._port.open(info)
        wanted = False
        try:
            descriptor = handle.descriptor()
            wanted = self._wanted(info, descriptor)
        finally:
            if not wanted:
                handle.close()
        if wanted:
            return [_Found(info, descriptor, handle)]
        self._unwanted.add(info)
        return []

    def _choice(self, found: list[_Found]) -> _Found | None:
        """The one that was open before, by its serial number or else its path; or the only one."""
        before = self.info
        if before is not None:
            for each in found:
                if before.serial and each.info.serial == before.serial:
                    return each
            for each in found:
                if each.info.path == before.path:
                    return each
        return found[0] if len(found) == 1 else None

    def _begin(self, found: _Found) -> None:
        with self._lock:
            self._reports.clear()
            self.info, self.descriptor, self._handle = found
            self.generation += 1
            self.error = ""
            self.state = "open"

    def _read(self, timeout_s: float) -> bool:
        """Wait for a report; whether there was one."""
        assert self._handle is not None
        try:
            report = self._handle.read(timeout_s)
        except DeviceLost as error:
            self._lose(str(error))
            return False
        if report is None:
            return False
        with self._lock:
            self.dropped += len(self._reports) == MOST
            self._reports.append(report)
        if self._on_report is not None:
            self._on_report(report)
        return True

    def _lose(self, problem: str) -> None:
        handle, self._handle = self._handle, None
        self.error = problem
        if handle is not None:
            self.state = "lost"
            handle.close()
