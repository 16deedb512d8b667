"""Capabilities and events of an event node in the terms of a report: fields with a range, and the state of them all.

A device's capabilities, as bytes, are lines: `abs CODE MINIMUM MAXIMUM` and `key CODE`, by rising codes. They stand for
a report descriptor: profiles know a device by their hash. A report is the whole state, at each SYN_REPORT: for each
axis 32 bits, for each hat switch 8, then a bit for each button.

Fields are named as those of a report descriptor where they are the same: x, rz, hat, else by the kernel's code without
its prefix, in small letters: BTN_TL is button.tl, ABS_GAS is gas. Of the gamepad's four buttons the kernel's letters
are used: BTN_SOUTH, BTN_EAST, BTN_NORTH, BTN_WEST are button.a, .b, .x, .y (Documentation/input/gamepad.rst; the driver
xpad reports by the letters on the pad, so that its X, on the left, is BTN_NORTH).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import lru_cache
from typing import Protocol

from artemis.devices.hid.descriptor import GAMEPAD, Descriptor, Field
from artemis.errors import HidError

SYN, KEY, ABS = 0, 1, 3
SYN_REPORT, SYN_DROPPED = 0, 3
_AXES = "x y z rx ry rz throttle rudder wheel gas brake".split()
_HATS = range(0x10, 0x18, 2)
"""The horizontal axis of each; the next code is the vertical one."""
_BUTTONS = {
    **{0x100 + number: str(number) for number in range(10)},
    **{0x120 + place: name for place, name in enumerate("trigger thumb thumb2 top top2 pinkie".split())},
    **{0x126 + place: name for place, name in enumerate("base base2 base3 base4 base5 base6".split())},
    0x12F: "dead",
    **{0x130 + place: name for place, name in enumerate("a b c x y z tl tr tl2 tr2".split())},
    **{0x13A + place: name for place, name in enumerate("select start mode thumbl thumbr".split())},
    0x150: "gear_down",
    0x151: "gear_up",
    **{0x220 + place: f"dpad_{name}" for place, name in enumerate("up down left right".split())},
    **{0x2C0 + place: f"trigger_happy{place + 1}" for place in range(40)},
}
_BUTTON_CODES = range(0x100, 0x300)
"""BTN_MISC to the last BTN_TRIGGER_HAPPY; other keys are those of keyboards and remote controls."""
_EIGHTHS = {(0, -1): 0, (1, -1): 1, (1, 0): 2, (1, 1): 3, (0, 1): 4, (-1, 1): 5, (-1, 0): 6, (-1, -1): 7}
"""Direction of a hat switch, clockwise from up, by its two axes: right and down are positive."""
_RELEASED = 8


class InputEvent(Protocol):
    """What the kernel says happened (struct input_event)."""

    @property
    def type(self) -> int:
        """SYN, KEY or ABS, or another."""

    @property
    def code(self) -> int:
        """Which axis or key."""

    @property
    def value(self) -> int:
        """Where it is now; of a key 0, 1, or 2 for a repetition."""


def capabilities(axes: Mapping[int, tuple[int, int]], keys: Collection[int]) -> bytes:
    """Capabilities as bytes: ranges of the axes, and the keys, by their codes."""
    lines = [f"abs {code} {low} {high}" for code, (low, high) in sorted(axes.items())]
    return "\n".join([*lines, *(f"key {code}" for code in sorted(keys))]).encode() + b"\n"


class Reports:
    """Turns one device's events into reports."""

    def __init__(self, raw: bytes, state: Callable[[], tuple[Mapping[int, int], Collection[int]]]) -> None:
        """`raw`: its capabilities. `state` asks the kernel for the values of all axes, and the keys that are down."""
        self._axes, self._keys = _parsed(raw)
        self._hats = _hats(self._axes)
        self._state = state
        self._values: dict[int, int] = {}
        self._down: set[int] = set()
        self._dropped = False
        self._ask()  # what does not change is in no event

    def take(self, events: Iterable[InputEvent]) -> list[bytes]:
        """The reports that events complete, which were read at once.

        Where the kernel dropped some (SYN_DROPPED), what follows up to the next SYN_REPORT is half a state and is
        skipped. Then the kernel is asked for the whole, last of all: it is newer than every event that was read. What
        was pressed and released meanwhile is lost.
        """
        reports = []
        asks = False
        for event in events:
            if event.type == SYN and event.code == SYN_DROPPED:
                self._dropped = True
            elif event.type == SYN and event.code == SYN_REPORT:
                if self._dropped:
                    self._dropped, asks = False, True
                else:
                    reports.append(self._packed())
            elif not self._dropped:
                self._change(event)
        if asks:
            self._ask()
            reports.append(self._packed())
        return reports

    def _change(self, event: InputEvent) -> None:
        if event.type == ABS:
            self._values[event.code] = event.value
        elif event.type == KEY:
            (self._down.add if event.value else self._down.discard)(event.code)

    def _ask(self) -> None:
        values, down = self._state()
        self._values, self._down = dict(values), set(down)

    def _packed(self) -> bytes:
        values = self._values
        parts = [(values.get(code, 0) & 0xFFFFFFFF).to_bytes(4, "little") for code in _plain(self._axes, self._hats)]
        hats = bytes(_EIGHTHS.get((values.get(code, 0), values.get(code + 1, 0)), _RELEASED) for code in self._hats)
        bits = sum(1 << place for place, code in enumerate(self._keys) if code in self._down)
        return b"".join(parts) + hats + bits.to_bytes((len(self._keys) + 7) // 8, "little")


@lru_cache(maxsize=16)
def evdev_layout(raw: bytes) -> Descriptor:
    """What the reports of a device with these capabilities contain.

    Raises:
        HidError: they are none.
    """
    axes, keys = _parsed(raw)
    hats = _hats(axes)
    fields = [
        _field(name, 3 << 16 | code, 32 * place, 32, *axes[code])
        for place, code in enumerate(_plain(axes, hats))
        for name in [_AXES[code] if code < len(_AXES) else f"usage.0003.{code:04x}"]
    ]
    bit = 32 * len(fields)
    for place, code in enumerate(hats):
        name = "hat" if place == 0 else f"hat.{place + 1}"
        fields.append(_field(name, 3 << 16 | code, bit + 8 * place, 8, 0, 7))
    bit += 8 * len(hats)
    fields += [_field(_key_name(code), 1 << 16 | code, bit + place, 1, 0, 1) for place, code in enumerate(keys)]
    return Descriptor(tuple(fields), {0: (bit + len(keys) + 7) // 8}, False, GAMEPAD)


def _parsed(raw: bytes) -> tuple[dict[int, tuple[int, int]], list[int]]:
    axes: dict[int, tuple[int, int]] = {}
    keys = []
    for line in raw.decode("ascii", "replace").splitlines():
        match line.split():
            case ["abs", code, low, high]:
                axes[int(code)] = int(low), int(high)
            case ["key", code]:
                keys.append(int(code))
            case _:
                raise HidError(f"capabilities of an event node: {line!r:.40}")
    return axes, keys


def _hats(axes: Mapping[int, tuple[int, int]]) -> list[int]:
    return [code for code in _HATS if axes.get(code) == axes.get(code + 1) == (-1, 1)]


def _plain(axes: Mapping[int, tuple[int, int]], hats: Collection[int]) -> list[int]:
    """Codes of the axes that belong to no hat switch."""
    return [code for code in axes if code not in hats and code - 1 not in hats]


def _key_name(code: int) -> str:
    if code in _BUTTON_CODES:
        return f"button.{_BUTTONS.get(code, f'{code:x}')}"
    return f"usage.0001.{code:04x}"


def _field(name: str, usage: int, bit: int, bits: int, minimum: int, maximum: int) -> Field:
    return Field(
        name=name,
        report_id=0,
        usage=usage,
        bit=bit,
        bits=bits,
        minimum=minimum,
        maximum=maximum,
        null_state=name.startswith("hat"),
        relative=False,
        step=45.0 if name.startswith("hat") else None,
    )
