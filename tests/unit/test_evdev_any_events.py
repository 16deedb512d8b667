"""Events of an event node, in any order and cut anywhere, with some dropped: what is reported is what the device is."""

from __future__ import annotations

from evdev_devices import DROPPED, REPORT, EventDevice, Happened
from hypothesis import given
from hypothesis import strategies as st

from artemis.devices.evdev.layout import Reports, capabilities, evdev_layout

CODES = st.sampled_from([0, 1, 0x10, 0x11, 0x130, 0x131, 0x136])


@st.composite
def changes(draw: st.DrawFn) -> dict[int, int]:
    codes = draw(st.lists(CODES, min_size=1, max_size=4, unique=True))
    highest = {code: 1 if code >= 0x10 else 32767 for code in codes}
    lowest = {code: 0 if code >= 0x100 else -1 if code >= 0x10 else -32768 for code in codes}
    return {code: draw(st.integers(lowest[code], highest[code])) for code in codes}


@given(st.lists(st.tuples(changes(), st.sampled_from(["sent", "sent", "sent", "lost"])), min_size=1), st.data())
def test_the_last_report_is_the_state(steps: list[tuple[dict[int, int], str]], data: st.DataObject) -> None:
    device = EventDevice()
    raw = capabilities(device.axes, device.keys)
    reports = Reports(raw, lambda: (device.values, device.down))
    found: list[bytes] = []
    waiting: list[Happened] = []
    for change, fate in steps:
        events = device.change(change)
        waiting += (
            events if fate == "sent" else [DROPPED, *events[: data.draw(st.integers(0, len(events)))][:-1], REPORT]
        )
        if data.draw(st.booleans()):
            found += reports.take(waiting)
            waiting = []
    found += reports.take([*waiting, *device.change({3: 12345})])
    values = evdev_layout(raw).decode(found[-1])
    assert values is not None
    assert (values["x"], values["y"]) == (device.values.get(0, 0), device.values.get(1, 0))
    assert {name: values[f"button.{name}"] for name in ("a", "b", "tl")} == {
        name: int(code in device.down) for name, code in (("a", 0x130), ("b", 0x131), ("tl", 0x136))
    }
    assert values["rx"] == 12345


@given(st.lists(st.builds(Happened, st.integers(0, 5), st.integers(0, 0x2FF), st.integers(-(2**31), 2**31 - 1))))
def test_whatever_comes_is_a_report_or_nothing(events: list[Happened]) -> None:
    device = EventDevice()
    raw = capabilities(device.axes, device.keys)
    for report in Reports(raw, lambda: (device.values, device.down)).take(events):
        assert evdev_layout(raw).decode(report) is not None
