"""CanBus beside the contract: words that are refused, adapters that fail. Back ends here are stand-ins."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import threading
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from typing import Any

import can
import pytest
from can.interfaces import BACKENDS
from frame_bus_suite import PATIENCE, arrived, bare

from artemis import clock
from artemis.clock import run
from artemis.devices.can_bus import CanBus, Frame, check_bus_words
from artemis.errors import ConfigError, DeviceBusy, DeviceError, DeviceLost


class StandIn(can.BusABC):
    """A back end that plays what the test has put into `script`: messages, or exceptions to raise."""

    script: list[can.Message | Exception]
    send_error: Exception | None = None
    closed = 0
    opened: StandIn

    def __init__(self, channel: str, bitrate: int = 500000, **kwargs: object) -> None:
        self.fetched = kwargs.get("fetched", 0)
        type(self).opened = self
        super().__init__(channel)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self.script:
            return None, False
        item = self.script.pop(0)
        if isinstance(item, Exception):
            raise item
        return item, True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.send_error is not None:
            raise self.send_error

    def shutdown(self) -> None:
        super().shutdown()
        type(self).closed += 1


class WithDescriptor(StandIn):
    """The same behind a descriptor, `readable` from the start."""

    readable = True

    def __init__(self, channel: str, **kwargs: object) -> None:
        super().__init__(channel)
        self.near, self.far = socket.socketpair()
        if self.readable:
            self.far.send(b"x")

    def fileno(self) -> int:
        return self.near.fileno()

    def shutdown(self) -> None:
        super().shutdown()
        self.near.close()
        self.far.close()


class Unopenable(can.BusABC):
    """The adapter is not there."""

    def __init__(self, channel: str) -> None:
        raise can.CanInitializationError("no such device")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Never called."""


Install = Callable[..., dict[str, Any]]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Puts a stand-in into python-can's table; returns the words that open it."""

    def install_as(
        interface: str, backend: type, *script: can.Message | Exception, **attributes: object
    ) -> dict[str, Any]:
        class_ = type(backend.__name__, (backend,), {"script": list(script), "closed": 0, **attributes})
        monkeypatch.setitem(globals(), "installed", class_)
        monkeypatch.setitem(BACKENDS, interface, (__name__, "installed"))
        return {"interface": interface, "channel": "0"}

    return install_as


def message(identifier: int, data: bytes = b"", **flags: bool) -> can.Message:
    words: dict[str, Any] = {"is_extended_id": False, **flags}
    return can.Message(arbitration_id=identifier, data=data, **words)


def in_real_time(main: Coroutine[None, None, None]) -> None:
    run(main, simulated=False)


async def lost(bus: CanBus) -> str:
    """The text of the DeviceLost that `receive` comes to raise."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                bus.receive()
            except DeviceLost as error:
                return str(error)
            await asyncio.sleep(0.002)


@pytest.mark.parametrize("interface", ["plain", "socketcan"])
def test_reader_that_fails_is_reported_by_both_calls_and_wakes(install: Install, interface: str) -> None:
    backend = WithDescriptor if interface == "socketcan" else StandIn

    async def main() -> None:
        bus = CanBus(install(interface, backend, can.CanOperationError("cable pulled")))
        woken = asyncio.Event()
        bus.listen(woken.set)
        async with asyncio.timeout(PATIENCE):
            await woken.wait()
        assert await lost(bus) == f"CAN {interface} 0: cannot be read: CanOperationError: cable pulled"
        with pytest.raises(DeviceLost, match="cable pulled"):
            bus.send(Frame(0x80))
        if backend is WithDescriptor:
            assert not asyncio.get_running_loop().remove_reader(globals()["installed"].opened.fileno())
        bus.close()

    in_real_time(main())


def test_error_of_the_vendors_library_is_not_silent_either(install: Install) -> None:
    async def main() -> None:
        bus = CanBus(install("plain", StandIn, AssertionError("handle")))
        assert "AssertionError: handle" in await lost(bus)
        bus.close()

    in_real_time(main())


def test_refused_frame_is_told_with_the_adapters_text(install: Install) -> None:
    async def main() -> None:
        bus = CanBus(install("plain", StandIn, send_error=can.CanOperationError("no such device")))
        with pytest.raises(DeviceLost, match="CAN plain 0: frame 0x201 was not sent: no such device"):
            bus.send(Frame(0x201, b"\1"))
        bus.close()

    in_real_time(main())


NO_ROOM = [
    ("socketcan", can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS), DeviceBusy),
    ("socketcan", can.CanOperationError("Failed to transmit: Try again", errno.EAGAIN), DeviceBusy),
    ("socketcan", can.CanOperationError("Transmit buffer full"), DeviceBusy),
    ("socketcan", can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN), DeviceLost),
    ("pcan", can.CanOperationError("Failed to send: The transmit queue is full"), DeviceBusy),
    ("pcan", can.CanOperationError("Failed to send: The handle is not valid"), DeviceLost),
    ("kvaser", can.CanOperationError("Function canWrite failed - Transmit buffer overflow", -13), DeviceBusy),
    ("kvaser", can.CanOperationError("Function canWrite failed - Handle is invalid", -10), DeviceLost),
    ("vector", can.CanOperationError("xlCanTransmit failed (XL_ERR_QUEUE_IS_FULL)", 11), DeviceBusy),
    ("systec", can.CanError("UcanWriteCanMsgEx: did not fit into the transmit buffer", 11), DeviceBusy),
    ("ixxat", can.CanOperationError("canChannelPostMessage failed (the transmit FIFO is full)"), DeviceBusy),
]


@pytest.mark.parametrize(("interface", "error", "expected"), NO_ROOM, ids=str)
def test_full_transmit_buffer_loses_a_frame_and_not_the_adapter(
    install: Install, interface: str, error: can.CanError, expected: type[DeviceError]
) -> None:
    backend = WithDescriptor if interface == "socketcan" else StandIn

    async def main() -> None:
        bus = CanBus(install(interface, backend, send_error=error))
        with pytest.raises(expected) as caught:
            bus.send(Frame(0x201, b"\1"))
        assert type(caught.value) is expected
        globals()["installed"].send_error = None
        bus.send(Frame(0x201, b"\1"))
        assert bus.receive() == []
        bus.close()

    in_real_time(main())


def test_frame_that_was_refused_is_not_awaited_as_an_echo(install: Install) -> None:
    async def main() -> None:
        words = install("udp_multicast", WithDescriptor, send_error=can.CanOperationError("Transmit buffer full"))
        bus = CanBus(words)
        with pytest.raises(DeviceBusy):
            bus.send(Frame(0x701, b"\5"))
        globals()["installed"].script.append(message(0x701, b"\5"))
        assert bare(bus.receive()) == [Frame(0x701, b"\5")]
        bus.close()

    in_real_time(main())


def test_adapter_that_is_not_there(install: Install) -> None:
    async def main() -> None:
        with pytest.raises(DeviceLost, match="cannot be opened: CanInitializationError: no such device; is it plugged"):
            CanBus(install("plain", Unopenable))

    in_real_time(main())


@pytest.mark.parametrize("interface", ["plain", "socketcan"])
def test_error_frames_are_counted_and_not_delivered(install: Install, interface: str) -> None:
    backend = WithDescriptor if interface == "socketcan" else StandIn
    errors = [message(0x04, bytes(8), is_error_frame=True)] * 3

    async def main() -> None:
        bus = CanBus(install(interface, backend, *errors, message(0x181, b"\1")))
        assert bare(await arrived(bus, 1)) == [Frame(0x181, b"\1")]
        assert bus.error_frames == 3
        bus.close()

    in_real_time(main())


def test_bus_off_is_the_loss_of_the_bus(install: Install) -> None:
    async def main() -> None:
        bus = CanBus(install("socketcan", WithDescriptor, message(0x40, bytes(8), is_error_frame=True)))
        assert "bus off" in await lost(bus)
        assert bus.error_frames == 1
        bus.close()

    in_real_time(main())


def test_what_is_no_classic_frame_of_another_node_is_dropped(install: Install) -> None:
    odd = [
        message(0x181, b"\1", is_extended_id=True),
        message(0x181, b"\2", is_fd=True),
        message(0x181, b"\3", is_rx=False),
    ]

    async def main() -> None:
        bus = CanBus(install("plain", StandIn, *odd, message(0x181, b"\4")))
        assert bare(await arrived(bus, 1)) == [Frame(0x181, b"\4")]
        bus.close()

    in_real_time(main())


def test_socketcan_hears_other_processes_of_this_host(install: Install) -> None:
    local = message(
        0x181, b"\3", is_rx=False
    )  # the kernel marks what was sent on this host, by whomever (MSG_DONTROUTE)

    async def main() -> None:
        bus = CanBus(install("socketcan", WithDescriptor, local))
        assert bare(await arrived(bus, 1)) == [Frame(0x181, b"\3")]
        bus.close()

    in_real_time(main())


def test_own_frames_that_were_asked_for_do_not_come_back_either() -> None:
    async def main() -> None:
        words = {"interface": "virtual", "channel": "echo", "receive_own_messages": True}
        bus, peer = CanBus(words), CanBus(words)
        bus.send(Frame(0x601, b"\1"))
        assert bare(await arrived(peer, 1)) == [Frame(0x601, b"\1")]
        peer.send(Frame(0x581, b"\2"))
        assert bare(await arrived(bus, 1)) == [Frame(0x581, b"\2")]
        bus.close()
        peer.close()

    in_real_time(main())


@pytest.mark.parametrize("interface", ["plain", "socketcan"])
def test_closed_bus_is_given_back_once_and_says_so(install: Install, interface: str) -> None:
    backend = WithDescriptor if interface == "socketcan" else StandIn

    async def main() -> None:
        words = install(interface, backend)
        bus = CanBus(words)
        bus.close()
        bus.close()
        assert globals()["installed"].closed == 1
        assert bus.name not in {thread.name for thread in threading.enumerate()}
        with pytest.raises(DeviceLost, match="is closed"):
            bus.receive()
        with pytest.raises(DeviceLost, match="is closed"):
            bus.send(Frame(0x80))

    in_real_time(main())


def test_adapter_that_cannot_be_closed_is_logged(install: Install, caplog: pytest.LogCaptureFixture) -> None:
    def shutdown(backend: can.BusABC) -> None:
        can.BusABC.shutdown(backend)
        raise can.CanOperationError("already gone")

    async def main() -> None:
        CanBus(install("plain", StandIn, shutdown=shutdown)).close()
        assert "CAN plain 0 did not close: already gone" in caplog.text

    in_real_time(main())


def test_equal_frames_of_other_nodes_pass_between_own_ones_on_a_bus_that_echoes(install: Install) -> None:
    first, second = Frame(0x601, b"\1"), Frame(0x602, b"\2")

    async def main() -> None:
        bus = CanBus(install("udp_multicast", WithDescriptor, readable=False))
        bus.send(first)
        bus.send(second)
        for identifier, data in ((0x602, b"\2"), (0x601, b"\1"), (0x602, b"\2")):
            globals()["installed"].script.append(message(identifier, data))
        assert bare(bus.receive()) == [second]
        bus.close()

    run(main(), simulated=True)


def test_own_frame_that_got_lost_does_not_swallow_an_equal_one_later(install: Install) -> None:
    async def main() -> None:
        bus = CanBus(install("udp_multicast", WithDescriptor, readable=False))
        bus.send(Frame(0x601, b"\1"))
        bus.send(Frame(0x602, b"\2"))
        await asyncio.sleep(1.1)
        globals()["installed"].script.append(message(0x601, b"\1"))
        assert bare(bus.receive()) == [Frame(0x601, b"\1")]
        bus.close()

    run(main(), simulated=True)


@pytest.mark.parametrize(("clock_set", "time"), [(0.0, 0.9), (3600.0, 0.5), (-3600.0, 1.0)])
def test_frame_bears_the_time_at_which_the_kernel_took_it_in_whoever_sets_the_clock(
    install: Install, monkeypatch: pytest.MonkeyPatch, clock_set: float, time: float
) -> None:
    epoch = 1.7e9

    async def main() -> None:
        now = asyncio.get_running_loop().time
        bus = CanBus(install("socketcan", WithDescriptor, readable=False))
        await asyncio.sleep(0.5)
        assert bus.receive() == []
        await asyncio.sleep(0.5)
        late = message(0x181)
        late.timestamp = epoch + 0.9
        globals()["installed"].script.append(late)
        monkeypatch.setattr(clock, "wall_date", lambda: datetime.fromtimestamp(epoch + now() + clock_set, UTC))
        (frame,) = bus.receive()
        assert frame.time == pytest.approx(time, abs=1e-5)
        bus.close()

    run(main(), simulated=True)


def test_flood_lets_the_loop_go_on(install: Install) -> None:
    async def main() -> None:
        flood = [message(0x181, bytes((n % 256,))) for n in range(1000)]
        bus = CanBus(install("socketcan", WithDescriptor, *flood))
        first = bus.receive()
        assert 0 < len(first) < 1000
        frames = first + await arrived(bus, 1000 - len(first))
        assert [frame.data[0] for frame in frames] == [n % 256 for n in range(1000)]
        bus.close()

    in_real_time(main())


# ---------------------------------------------------------------------------------------------- words


def test_a_channel_without_an_adapter_asks_for_none() -> None:
    async def main() -> None:
        with pytest.raises(DeviceLost) as caught:
            CanBus({"interface": "udp_multicast", "channel": "127.0.0.1"})
        assert "check channel and port" in str(caught.value)
        assert "plugged in" not in str(caught.value)

    in_real_time(main())


def test_misspelt_word_is_refused_before_anything_opens() -> None:
    async def main() -> None:
        with pytest.raises(ConfigError) as caught:
            CanBus({"interface": "virtual", "channel": "x", "recieve_own_messages": True})
        assert "recieve_own_messages: no option of the virtual interface" in str(caught.value)
        assert "did you mean 'receive_own_messages'?" in str(caught.value)

    in_real_time(main())


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ({}, "interface: python-can has no None"),
        ({"interface": "pcn"}, "did you mean 'pcan'?"),
        ({"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrat": 1000000}, "did you mean 'bitrate'?"),
        ({"interface": "pcan", "bitrate": 1000}, "bitrate: 1000 is not a rate of an EPOS"),
        ({"interface": "socketcan", "channel": "can0", "bitrate": 1000000}, "as the system has set it"),
        ({"interface": "socketcand", "channel": "can0", "host": "robot"}, "port: the socketcand interface needs it"),
    ],
)
def test_wrong_words_are_named(words: dict[str, Any], problem: str) -> None:
    (found,) = check_bus_words(words)
    assert problem in found


@pytest.mark.parametrize(
    "words",
    [
        {"interface": "virtual", "channel": "x", "can_filters": []},
        {"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 1000000, "auto_reset": True},
        {"interface": "socketcan", "channel": "can0"},
        {"interface": "udp_multicast", "channel": "239.74.163.2", "hop_limit": 0, "port": 43113},
        {"interface": "kvaser", "channel": 0, "bitrate": 1000000, "driver_mode": True},
        {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1000000, "tty_baudrate": 115200},
        {"interface": "systec", "channel": 0, "bitrate": 1000000, "device_number": 3},
    ],
)
def test_words_of_the_back_end_pass_even_where_its_signature_hides_them(words: dict[str, Any]) -> None:
    assert check_bus_words(words) == []


def test_several_problems_are_told_at_once(install: Install) -> None:
    words = {**install("plain", StandIn), "fetchd": 1, "rate": 2, "bitrate": 3, "fetched": 4}
    del words["channel"]
    assert [problem.split(":")[0] for problem in check_bus_words(words)] == ["fetchd", "rate", "channel", "bitrate"]


def test_back_end_that_cannot_be_loaded_here_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(BACKENDS, "vendor", ("a_vendors_library_that_is_not_installed", "Bus"))
    assert check_bus_words({"interface": "vendor", "whatever": 1}) == []


def test_nothing_of_python_can_is_imported_for_a_frame() -> None:
    import subprocess
    import sys

    code = "import sys, artemis.devices.can_bus; sys.exit('can' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], env=dict(os.environ), check=False).returncode == 0
