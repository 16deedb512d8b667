"""What a service manager is told, by its own end of the socket."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from artemis.notify import READY, WATCHDOG, ServiceManager


@pytest.fixture(autouse=True)
def closed_after(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    made: list[ServiceManager] = []
    begin = ServiceManager.__init__

    def note(manager: ServiceManager, environment: dict[str, str]) -> None:
        made.append(manager)
        begin(manager, environment)

    monkeypatch.setattr(ServiceManager, "__init__", note)
    yield
    for manager in made:
        manager.close()


@pytest.fixture
def heard(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        yield listening


def said(heard: socket.socket) -> list[str]:
    words = []
    try:
        while True:
            words.append(heard.recv(4096).decode())
    except BlockingIOError:
        return words


def test_it_is_told_that_all_is_well_twice_in_the_watchdogs_time(heard: socket.socket) -> None:
    environment = {"NOTIFY_SOCKET": heard.getsockname(), "WATCHDOG_USEC": "4000000", "WATCHDOG_PID": str(os.getpid())}
    manager = ServiceManager(environment)
    assert environment == {}, "processes that this one starts are not asked"
    manager.tell(READY, "STATUS=follow: on the path")
    for tenth in range(61):
        manager.alive(1000.0 + tenth / 10)
    assert said(heard) == ["READY=1\nSTATUS=follow: on the path", *[WATCHDOG] * 4]
    manager.close()
    manager.tell(READY)
    assert said(heard) == []


@pytest.mark.parametrize("watchdog", [{}, {"WATCHDOG_USEC": "1"}, {"WATCHDOG_USEC": "x"}])
def test_a_watchdog_of_another_process_or_none_is_not_fed(heard: socket.socket, watchdog: dict[str, str]) -> None:
    manager = ServiceManager({"NOTIFY_SOCKET": heard.getsockname(), "WATCHDOG_PID": "1", **watchdog})
    manager.alive(1.0)
    assert said(heard) == []


def test_an_abstract_name_is_known_and_nobody_there_is_no_error() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind("")  # the system gives it a name (unix(7), autobind)
        listening.setblocking(False)
        name = listening.getsockname()
        ServiceManager({"NOTIFY_SOCKET": "@" + name[1:].decode()}).tell(READY)
        assert said(listening) == [READY]
    gone = ServiceManager({"NOTIFY_SOCKET": "@" + name[1:].decode()})
    assert gone.is_there
    gone.tell(READY)
    for address in ("", "relative", "vsock:2:1234"):
        nobody = ServiceManager({"NOTIFY_SOCKET": address})
        nobody.tell(READY)
        assert not nobody.is_there


def test_who_does_not_read_is_not_waited_for(heard: socket.socket) -> None:
    manager = ServiceManager({"NOTIFY_SOCKET": heard.getsockname()})
    for _ in range(5000):
        manager.tell("STATUS=" + "x" * 1000)
    assert said(heard)
