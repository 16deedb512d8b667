"""The reader on devices in memory: plugged in, out and in again, silent, two of a kind, forbidden."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable

import pytest
from hid_devices import STICK

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.devices.hid.reader import MOST, SEARCH_EVERY, HidReader
from artemis.errors import DeviceLost
from artemis.testing.fake_hid import FakeHandle, FakeHid

PATIENCE = 20.0
OTHER = STICK.replace(b"\x09\x30", b"\x09\x33")


def stick(path: str = "/dev/hidraw0", serial: str = "", name: str = "Stick", usage: int = 0x10004) -> HidInfo:
    return HidInfo(path, "usb", 0x046D, 0xC215, serial, name, 0, usage)


def any_device(info: HidInfo, descriptor: bytes) -> bool:
    return True


def reader_of(hid: FakeHid, wanted: Callable[[HidInfo, bytes], bool] = any_device) -> HidReader:
    return HidReader(hid, wanted, threaded=False)


def test_a_device_is_found_opened_and_read() -> None:
    hid = FakeHid()
    reader = reader_of(hid)
    assert (reader.state, reader.generation, reader.info, reader.descriptor) == ("searching", 0, None, b"")
    assert reader.take(0.0) == []
    assert (reader.state, reader.error) == ("searching", "no such device is plugged in")
    hid.plug(stick(), STICK)
    assert reader.take(SEARCH_EVERY) == []
    assert (reader.state, reader.generation, reader.error) == ("open", 1, "")
    assert (reader.info, reader.descriptor) == (stick(), STICK)
    reports = [bytes((x, 0, 0)) for x in range(5)]
    for report in reports:
        hid.send(report)
    assert reader.take(1.02) == reports
    assert reader.take(1.04) == []
    assert reader.state == "open"


def test_it_looks_once_a_second_only() -> None:
    hid = FakeHid()
    reader = reader_of(hid)
    reader.take(10.0)
    hid.plug(stick(), STICK)
    for tenths in range(1, 10):
        reader.take(10.0 + tenths / 10)
        assert reader.state == "searching"
    reader.take(11.0)
    assert reader.state == "open"


def test_a_device_that_was_plugged_out_is_lost_at_once_and_found_again() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    hid.unplug()
    assert reader.take(5.0) == []
    assert (reader.state, reader.generation) == ("lost", 1)
    assert reader.error == "Stick (usb 046d:c215, /dev/hidraw0): is gone"
    assert reader.info == stick()
    hid.plug(stick("/dev/hidraw1"), OTHER)
    reader.take(5.9)
    assert reader.state == "lost"
    reader.take(6.0)
    assert (reader.state, reader.generation, reader.error) == ("open", 2, "")
    assert (reader.info, reader.descriptor) == (stick("/dev/hidraw1"), OTHER)
    hid.send(b"abc")
    assert reader.take(6.1) == [b"abc"]


def test_nothing_of_an_earlier_plug_is_taken_for_the_new_one() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = HidReader(hid, any_device, threaded=False)
    reader.take(0.0)
    hid.send(b"old")
    reader._read(0.0)
    hid.unplug()
    reader._read(0.0)
    hid.plug(stick(), STICK)
    reader._search()
    assert reader.generation == 2
    hid.send(b"new")
    assert reader.take(0.0) == [b"new"]


def test_a_frozen_device_is_open_and_silent() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    hid.freeze()
    hid.send(b"abc")
    assert reader.take(100.0) == []
    assert (reader.state, reader.error) == ("open", "")


def test_of_too_many_reports_the_newest_are_kept_and_the_rest_counted() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    for number in range(MOST + 3):
        hid.send(number.to_bytes(3, "little"))
    for _ in range(MOST + 3):
        reader._read(0.0)
    assert reader.take(1.0) == [number.to_bytes(3, "little") for number in range(3, MOST + 3)]
    assert reader.dropped == 3


def test_without_a_thread_nobody_waits_for_a_report(monkeypatch: pytest.MonkeyPatch) -> None:
    hid, waits = FakeHid(), []
    read = FakeHandle.read

    def noted(handle: FakeHandle, timeout_s: float) -> bytes | None:
        waits.append(timeout_s)
        return read(handle, 0.0)

    monkeypatch.setattr(FakeHandle, "read", noted)
    hid.plug(stick(), STICK)
    reader_of(hid).take(0.0)
    assert waits == [0.0]


def test_a_flood_does_not_hold_a_tick_up() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = HidReader(hid, any_device, lambda report: hid.send(report), threaded=False)
    reader.take(0.0)
    hid.send(b"abc")
    assert reader.take(0.1) == [b"abc"] * MOST


# ---------------------------------------------------------------------------------------------- which device


def test_two_of_a_kind_are_named_and_none_is_used() -> None:
    hid = FakeHid()
    one, two = stick("/dev/hidraw0", "A1"), stick("/dev/hidraw1", "B2")
    hid.plug(one, STICK)
    hid.plug(two, STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    assert (reader.state, reader.generation) == ("searching", 0)
    assert reader.error == (
        "several devices match, and none is used: Stick (usb 046d:c215, serial A1, /dev/hidraw0); "
        "Stick (usb 046d:c215, serial B2, /dev/hidraw1); unplug all but one, or name its serial"
    )
    assert not hid.is_open(one)
    assert not hid.is_open(two)
    hid.unplug(one)
    reader.take(1.0)
    assert reader.info == two
    assert reader.error == ""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (stick("/dev/hidraw0", "A1"), stick("/dev/hidraw7", "A1")),  # the serial tells, whatever the path
        (stick("/dev/hidraw0"), stick("/dev/hidraw0")),
    ],
)
def test_of_several_the_one_that_was_open_before_is_preferred(before: HidInfo, after: HidInfo) -> None:
    hid = FakeHid()
    hid.plug(before, STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    hid.unplug()
    other = stick("/dev/hidraw1" if before == after else "/dev/hidraw0", "B2" if before.serial else "")
    hid.plug(other, STICK)
    hid.plug(after, STICK)
    reader.take(1.0)
    assert reader.state == "lost"
    reader.take(2.0)
    assert (reader.info, reader.generation) == (after, 2)
    assert hid.is_open(after)
    assert not hid.is_open(other)


def test_only_what_is_wanted_is_used_and_the_rest_is_asked_once() -> None:
    hid = FakeHid()
    hid.plug(stick("/dev/hidraw0", name="other"), OTHER)
    asked: list[str] = []

    def wanted(info: HidInfo, descriptor: bytes) -> bool:
        asked.append(info.name)
        return descriptor == STICK

    reader = reader_of(hid, wanted)
    for second in range(3):
        reader.take(float(second))
    assert asked == ["other"]
    assert reader.error == "no such device is plugged in"
    hid.plug(stick("/dev/hidraw1"), STICK)
    reader.take(3.0)
    assert (asked, reader.info) == (["other", "Stick"], stick("/dev/hidraw1"))
    assert not hid.is_open(stick("/dev/hidraw0"))
    hid.unplug(stick("/dev/hidraw0"))
    hid.unplug(stick("/dev/hidraw1"))
    reader.take(4.0)
    reader.take(5.0)
    hid.plug(stick("/dev/hidraw0", name="other"), STICK)  # the same words, but it was away meanwhile
    reader.take(6.0)
    assert reader.state == "open"


def test_keyboards_are_not_opened() -> None:
    hid = FakeHid()
    hid.plug(stick(name="keyboard", usage=0x10006), STICK)
    hid.plug(stick("/dev/hidraw1", name="unknown", usage=0), STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    assert reader.info is not None
    assert reader.info.name == "unknown"


def test_a_device_that_nobody_may_open_is_told_with_the_rule() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK, permitted=False)
    hid.plug(stick("/dev/hidraw1", name="Other"), STICK, permitted=False)
    reader = reader_of(hid)
    reader.take(0.0)
    assert reader.state == "searching"
    assert "no permission to open it" in reader.error
    assert "; Other (usb 046d:c215, /dev/hidraw1): no permission" in reader.error
    hid.unplug(stick("/dev/hidraw1"))
    assert 'KERNELS=="*:046D:C215.*"' in reader.error
    hid.plug(stick(), STICK)
    reader.take(1.0)
    assert (reader.state, reader.error) == ("open", "")


def test_a_descriptor_that_cannot_be_read_is_told() -> None:
    hid = FakeHid()
    hid.plug(stick(), b"\x05")

    def wanted(info: HidInfo, descriptor: bytes) -> bool:
        return bool(parse_descriptor(descriptor).fields)

    reader = reader_of(hid, wanted)
    reader.take(0.0)
    assert reader.error.endswith("report descriptor, byte 0: the item is cut off")
    assert not hid.is_open()


def test_a_computer_without_hid_is_told() -> None:
    class NoHid(FakeHid):
        def enumerate(self) -> list[HidInfo]:
            raise DeviceLost("HID", "no back end")

    reader = reader_of(NoHid())
    reader.take(0.0)
    assert (reader.state, reader.error) == ("searching", "HID: no back end")


# ---------------------------------------------------------------------------------------------- the end, and the thread


def test_a_closed_reader_gives_its_device_back_and_stays_closed() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    reader = reader_of(hid)
    reader.take(0.0)
    reader.close()
    reader.close()
    assert not hid.is_open()
    assert reader.take(10.0) == []
    assert (reader.state, reader.error) == ("lost", "is closed")


def test_the_thread_hands_reports_over_and_leaves_before_its_handle_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    hid, arrived = FakeHid(), threading.Semaphore(0)
    hid.plug(stick(), STICK)
    opened = threading.Event()

    def wanted(info: HidInfo, descriptor: bytes) -> bool:
        opened.set()
        return True

    heard: list[bytes] = []

    def on_report(report: bytes) -> None:
        heard.append(report)
        arrived.release()

    reader = HidReader(hid, wanted, on_report)
    monkeypatch.setattr(reader, "_poll", None)  # only the thread reads
    assert opened.wait(PATIENCE)  # the handle is there, and keeps what is sent from now on
    for number in range(3):
        hid.send(bytes((number, 0, 0)))
        assert arrived.acquire(timeout=PATIENCE)
    assert reader.take(0.0) == heard == [bytes((number, 0, 0)) for number in range(3)]
    assert (reader.state, reader.generation) == ("open", 1)
    reader.close()  # fails if the handle is closed while it is read
    assert "hid reader" not in {thread.name for thread in threading.enumerate()}
    assert not hid.is_open()
    assert (reader.state, reader.error) == ("lost", "is closed")


class Announcing(FakeHid):
    """Tells when a device was opened, and when it was given back."""

    def __init__(self) -> None:
        super().__init__()
        self.opened, self.closed = threading.Semaphore(0), threading.Semaphore(0)

    def open(self, info: HidInfo) -> FakeHandle:
        handle = super().open(info)
        close = handle.close

        def announce() -> None:
            close()
            self.closed.release()

        handle.close = announce  # type: ignore[method-assign]
        self.opened.release()
        return handle


def test_the_thread_finds_a_device_again_that_was_plugged_out_while_it_was_read() -> None:
    hid, arrived = Announcing(), threading.Semaphore(0)
    hid.plug(stick(), STICK)
    reader = HidReader(hid, any_device, lambda report: arrived.release())
    assert hid.opened.acquire(timeout=PATIENCE)
    hid.send(b"abc")
    assert arrived.acquire(timeout=PATIENCE)
    hid.unplug()
    assert hid.closed.acquire(timeout=PATIENCE)
    assert (reader.state, reader.generation) == ("lost", 1)
    assert reader.error.endswith("is gone")
    assert reader.take(0.0) == [b"abc"]  # what it said before still counts
    hid.plug(stick("/dev/hidraw1"), OTHER)
    assert hid.opened.acquire(timeout=PATIENCE)
    hid.send(b"def")
    assert arrived.acquire(timeout=PATIENCE)
    assert reader.take(0.0) == [b"def"]
    assert (reader.state, reader.generation, reader.descriptor) == ("open", 2, OTHER)
    reader.close()
    assert hid.closed.acquire(timeout=PATIENCE)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_callback_that_fails_ends_the_reader_in_the_open() -> None:
    hid, opened = FakeHid(), threading.Event()
    hid.plug(stick(), STICK)

    def wanted(info: HidInfo, descriptor: bytes) -> bool:
        opened.set()
        return True

    def on_report(report: bytes) -> None:
        raise KeyError(report)

    reader = HidReader(hid, wanted, on_report)
    assert opened.wait(PATIENCE)
    hid.send(b"abc")
    assert reader._thread is not None
    reader._thread.join(PATIENCE)
    assert (reader.state, reader.error) == ("lost", "the reader has failed")
    assert not hid.is_open()


def test_the_fake_notices_a_handle_that_is_closed_while_it_is_read() -> None:
    hid = FakeHid()
    hid.plug(stick(), STICK)
    handle = hid.open(stick())
    handle._reading = True
    with pytest.raises(AssertionError, match=re.escape("is closed while it is read")):
        handle.close()
