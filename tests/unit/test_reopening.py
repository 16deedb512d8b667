"""An adapter that comes back is used again; nothing is said while it is gone."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from artemis.devices.can_bus import Frame
from artemis.devices.reopening import AGAIN, ReopeningBus
from artemis.errors import DeviceLost


class Adapter:
    def __init__(self) -> None:
        self.gone = False
        self.closed = False
        self.error_frames = 0
        self.sent: list[Frame] = []
        self.wake: Callable[[], None] | None = None

    def send(self, frame: Frame) -> None:
        if self.gone:
            raise DeviceLost("CAN", "unplugged")
        self.sent.append(frame)

    def receive(self) -> list[Frame]:
        if self.gone:
            raise DeviceLost("CAN", "unplugged")
        return [Frame(0x701, b"\x05")]

    def listen(self, wake: Callable[[], None]) -> None:
        self.wake = wake

    def close(self) -> None:
        self.closed = True


class Slot:
    """Where adapters are plugged in."""

    def __init__(self) -> None:
        self.empty = False
        self.now = 0.0
        self.adapters: list[Adapter] = []
        self.attempts = 0

    def open(self) -> Adapter:
        self.attempts += 1
        if self.empty:
            raise DeviceLost("CAN", "not there")
        self.adapters.append(Adapter())
        return self.adapters[-1]

    def unplug(self) -> None:
        self.empty = self.adapters[-1].gone = True


@pytest.fixture
def slot() -> Slot:
    return Slot()


def bus_in(slot: Slot) -> ReopeningBus:
    return ReopeningBus(slot.open, lambda: slot.now)


def test_an_adapter_that_cannot_be_opened_at_all_is_an_error_at_once(slot: Slot) -> None:
    slot.empty = True
    with pytest.raises(DeviceLost, match="not there"):
        bus_in(slot)


def test_while_the_adapter_is_there_everything_passes(slot: Slot) -> None:
    bus = bus_in(slot)
    bus.send(Frame(0x080))
    assert slot.adapters[0].sent == [Frame(0x080)]
    assert bus.receive() == [Frame(0x701, b"\x05")]


def test_a_lost_adapter_is_closed_and_looked_for_once_a_second(slot: Slot) -> None:
    bus = bus_in(slot)
    slot.unplug()
    for tick in range(101):
        slot.now = tick * 0.02
        with pytest.raises(DeviceLost):
            bus.receive()
        with pytest.raises(DeviceLost):
            bus.send(Frame(0x080))
    assert slot.adapters[0].closed
    assert slot.attempts == 1 + 2


def test_an_adapter_that_is_back_is_used_and_listened_to(slot: Slot) -> None:
    bus = bus_in(slot)

    def wake() -> None: ...

    bus.listen(wake)
    slot.adapters[0].error_frames = 3
    slot.unplug()
    with pytest.raises(DeviceLost):
        bus.receive()
    slot.empty = False
    with pytest.raises(DeviceLost):  # not yet looked for
        bus.receive()
    slot.now = AGAIN
    assert bus.receive() == [Frame(0x701, b"\x05")]
    bus.send(Frame(0x080))
    assert slot.adapters[1].sent == [Frame(0x080)]
    assert slot.adapters[1].wake is wake
    slot.adapters[1].error_frames = 2
    assert bus.error_frames == 5


def test_after_closing_nothing_is_opened_again(slot: Slot) -> None:
    bus = bus_in(slot)
    slot.unplug()
    with pytest.raises(DeviceLost):
        bus.receive()
    bus.close()
    slot.empty, slot.now = False, 10.0
    with pytest.raises(DeviceLost):
        bus.receive()
    assert slot.attempts == 1


def test_closing_closes_the_adapter(slot: Slot) -> None:
    bus = bus_in(slot)
    bus.close()
    assert slot.adapters[0].closed
