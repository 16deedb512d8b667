"""Teaching a profile: somebody moves one control after the other, and what moved is noted. Pure: fed with moments.

A lesson is a generator: it yields what to tell the person, receives the next moment, and returns what it learnt.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from statistics import median_low

from artemis.devices.hid.descriptor import Field
from artemis.plugins.inputs.chain import calibrate
from artemis.plugins.inputs.controls import calibrated
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Kind
from artemis.plugins.inputs.joystick import Gate
from artemis.plugins.inputs.profiles import DIRECTIONS, AxisProfile, Reports, off_direction, part_of
from artemis.plugins.inputs.teachable import (
    REMIND,
    STILL,
    Lesson,
    Moment,
    Unteachable,
    axes_of,
    buttons_of,
    hats_of,
    watched,
)

REST = 0.5
"""So long everything has to be left alone [s]; the centres are the medians of this time."""
HOLD = 1.0
"""So long controls are held at their ends [s], to see whether the device reports then."""
MOVED = {"steering": 0.05, "gas": 0.3, "brake": 0.3, "x": 0.2, "y": 0.2, "speed": 0.2}
"""Share of the logical range by which an axis has to move, a stick and a wheel to both sides."""
BACK = 0.2
"""It is back when it is nearer to its rest than this share of the way that it went. So near to an end of its range a
lever for the speed rests that has no centre."""
HELD = 0.8
"""An axis beyond this share of its travel is held at its end."""
QUICK = 0.05
"""A device that says something at least so often [s], at rest and held, always reports."""
CORNER, SQUARE = 0.5, 0.85
"""A stick pushed into its corner has both axes beyond the first; beyond the second the corner is one of a square."""
NEEDED = ("enable", "quickstop")
ASKED = {
    "x": "push the stick to the right as far as it goes, then to the left, and let go",
    "y": "push the stick forward as far as it goes, then pull it back, and let go",
    "steering": "turn the wheel to the right as far as you want to turn it, then to the left, then to the middle",
    "gas": "press the gas pedal down, and let it go",
    "brake": "press the brake pedal down, and let it go",
}
ASKED_OF_LEVERS = {
    "steering": "move what steers to the right as far as it goes, then to the left, and let go",
    "speed": "move what sets the speed fully forward, then, if it rests in its middle, fully back, and let it rest",
}
AT_ITS_END: dict[Kind, tuple[tuple[str, ...], str]] = {
    "stick": (("y",), "push the stick forward as far as it goes, and hold it there"),
    "wheel": (
        ("steering", "gas"),
        "turn the wheel to the right as far as before, press the gas pedal down, and hold both",
    ),
    "levers": (
        ("steering", "speed"),
        "steer to the right and set full speed forward, both as far as they go, and hold both",
    ),
}
"""What has to be held, and how that is asked for."""
MEANS = {
    "enable": "enable, held while the robot may drive (best under an index finger)",
    "quickstop": "quick stop (best big and easily found)",
    "faster": "faster: the speed range 10 % up",
    "slower": "slower: the speed range 10 % down",
    "reverse": "reverse: the direction of travel, at standstill",
    "acknowledge": "acknowledge a fault or a stop",
    "arm": "arm: enable the drives again",
    "end": "end the run",
    "done": "done: the step is over",
    "record": "record a path: begin, and end",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Learnt:
    """What a lesson has found."""

    axes: dict[str, AxisProfile]
    buttons: dict[str, str]
    reports: dict[str, Reports]
    """Of each device; the only one has no name."""
    gate: Gate


def lesson(kind: Kind, fields: Mapping[str, Field]) -> Lesson[Learnt]:
    """The whole lesson of devices with these fields: rest, each axis, a stick's corner, controls held, each button.

    Raises:
        Unteachable: nothing usable came for too long.
    """
    return watched(_lesson(kind, fields), fields)


def _lesson(kind: Kind, fields: Mapping[str, Field]) -> Lesson[Learnt]:
    rest, silent = yield from _rest(fields)
    heard = {name: field for name, field in axes_of(fields).items() if name in rest}
    axes: dict[str, AxisProfile] = {}
    for role in AXES[kind]:
        ask = (ASKED_OF_LEVERS if kind == "levers" else ASKED)[role]
        axes[role] = yield from _axis(role, ask, heard, rest, {axis.field: name for name, axis in axes.items()})
    gate = (yield from _gate(axes["x"], axes["y"])) if kind == "stick" else "square"
    parts = {part_of(name)[0] for name in fields}
    if parts - silent:
        roles, ask = AT_ITS_END[kind]
        silent |= yield from _held([axes[role] for role in roles], ask, parts)
    buttons = yield from _buttons(kind, fields, one_sided=axes.get("speed", axes[AXES[kind][0]]).centre is None)
    reports: dict[str, Reports] = {part: "on_change" if part in silent else "always" for part in parts}
    return Learnt(axes=axes, buttons=buttons, reports=reports, gate=gate)


class _Silences:
    """The longest silence of each device."""

    def __init__(self, parts: Collection[str], begun: float) -> None:
        self._last, self._longest = dict.fromkeys(parts, begun), dict.fromkeys(parts, 0.0)

    def see(self, moment: Moment) -> None:
        for part, last in self._last.items():
            self._longest[part] = max(self._longest[part], moment.time - last)
            if moment.heard == part:
                self._last[part] = moment.time

    @property
    def silent(self) -> set[str]:
        """Those that do not always report."""
        return {part for part, longest in self._longest.items() if longest > QUICK}


def _rest(fields: Mapping[str, Field]) -> Lesson[tuple[dict[str, int], set[str]]]:
    """Where every axis rests, and which devices do not report at rest."""
    parts = sorted({part_of(name)[0] for name in fields})
    ask = "press each pedal and button once, centre everything and let go; then press Enter"
    hint = ""
    moment = yield ask
    while moment.typed is None or (unheard := _unheard(parts, moment)):
        if moment.typed is not None:
            hint = f"nothing was heard of {' and '.join(filter(None, unheard)) or 'the device'} yet; "
        moment = yield hint + ask
    axes = {name: field for name, field in axes_of(fields).items() if name in moment.values}
    hint, begun = "do not touch it", moment.time
    while True:
        since, seen, gaps = moment.time, [moment.values], _Silences(parts, moment.time)
        while moment.time - since < REST and not _moving(seen, axes):
            moment = yield hint
            seen.append(moment.values)
            gaps.see(moment)
        moving = _moving(seen, axes)
        if not moving:
            return {name: median_low([values[name] for values in seen]) for name in axes}, gaps.silent
        if moment.time - begun > REMIND:
            raise Unteachable(f"{', '.join(moving)} did not come to rest in {REMIND:.0f} s")
        hint = "something moves; do not touch anything"


def _unheard(parts: Iterable[str], moment: Moment) -> list[str]:
    heard = {part_of(name)[0] for name in moment.values}
    return [part for part in parts if part not in heard]


def _moving(seen: list[Mapping[str, int]], axes: Mapping[str, Field]) -> list[str]:
    """The axes that have moved; sparse devices and noisy ones alike."""
    return [
        name
        for name, axis in axes.items()
        if max(v[name] for v in seen) - min(v[name] for v in seen) > STILL * (axis.maximum - axis.minimum)
    ]


def _axis(
    role: str, ask: str, fields: Mapping[str, Field], rest: Mapping[str, int], taken: Mapping[str, str]
) -> Lesson[AxisProfile]:
    """The axis that moves most: its ends, and which of them is right, forward or pressed."""
    ask, least = f"{role}: {ask}", MOVED[role]
    travels = {name: field.maximum - field.minimum for name, field in fields.items()}
    lowest, highest, first = dict(rest), dict(rest), dict.fromkeys(travels, 0)
    hint = ""
    while True:
        moment = yield ask + hint
        for name in travels:
            away = moment.values[name] - rest[name]
            if first[name] == 0 and abs(away) >= least * travels[name]:
                first[name] = 1 if away > 0 else -1
            lowest[name], highest[name] = min(lowest[name], rest[name] + away), max(highest[name], rest[name] + away)
        name = max(travels, key=lambda name: (highest[name] - lowest[name]) / travels[name])
        one_sided = role in PEDALS or (role == "speed" and _rests_at_an_end(rest[name], fields[name]))
        sides = highest[name] - rest[name], rest[name] - lowest[name]
        travel = max(sides) if one_sided else min(sides)
        is_back = abs(moment.values[name] - rest[name]) <= BACK * travel
        if travel < least * travels[name] or not is_back:
            continue
        if name in taken:
            combined = "; both pedals on one axis cannot be told apart: switch the wheel to its own mode"
            hint = f" (that was {name}, which is {taken[name]}{combined if role in PEDALS else ''})"
            lowest, highest, first = dict(rest), dict(rest), dict.fromkeys(travels, 0)
            continue
        if not one_sided:
            ends = {"minimum": lowest[name], "centre": rest[name], "maximum": highest[name]}
        else:
            pressed = highest[name] if first[name] > 0 else lowest[name]
            ends = {"minimum": min(pressed, rest[name]), "maximum": max(pressed, rest[name])}
        return AxisProfile(field=name, inverted=first[name] < 0, **ends)


def _rests_at_an_end(rest: int, field: Field) -> bool:
    return min(rest - field.minimum, field.maximum - rest) <= BACK * (field.maximum - field.minimum)


def _gate(x: AxisProfile, y: AxisProfile) -> Lesson[Gate]:
    """What the stick's travel ends at: in the corner of a square both axes reach their ends, on a circle 0.7."""
    farthest = 0.0
    while True:
        moment = yield "corner: push the stick forward and right as far as it goes, and let go"
        travels = [
            abs(calibrate(moment.values[axis.field], axis.minimum, axis.centre or 0, axis.maximum, axis.inverted))
            for axis in (x, y)
        ]
        farthest = max(farthest, min(travels))
        if farthest > CORNER and max(travels) < BACK:
            return "square" if farthest > SQUARE else "round"


def _held(axes: list[AxisProfile], ask: str, parts: Collection[str]) -> Lesson[set[str]]:
    """The devices that fall silent while the axes are held at their ends."""
    ask = f"hold: {ask}, until the next line"
    begun, gaps, moment = None, _Silences((), 0.0), (yield ask)
    while begun is None or moment.time - begun < HOLD:
        if min(calibrated(moment.values[axis.field], axis) for axis in axes) < HELD:
            begun = None
        elif begun is None:
            begun, gaps = moment.time, _Silences(parts, moment.time)
        else:
            gaps.see(moment)
        moment = yield ask
    while max(abs(calibrated(moment.values[axis.field], axis)) for axis in axes) > BACK:
        moment = yield "let go of everything"
    return gaps.silent


def _buttons(kind: Kind, fields: Mapping[str, Field], *, one_sided: bool) -> Lesson[dict[str, str]]:
    """The button of each role; an axis for the speed that commands both directions needs none to reverse."""
    optional = [role for role in BUTTONS[kind] if role not in NEEDED]
    if kind == "levers" and not one_sided:
        optional.remove("reverse")
    buttons: dict[str, str] = {}
    down: set[str] = set()
    for role in (*NEEDED, *optional):
        button = yield from _button(role, fields, {name: taken for taken, name in buttons.items()}, down)
        if button is not None:
            buttons[role] = button
    return buttons


def _button(role: str, fields: Mapping[str, Field], taken: Mapping[str, str], down: set[str]) -> Lesson[str | None]:
    """The button, or direction of a hat switch, that goes down; None where it is left out. `down` is kept up."""
    optional = role not in NEEDED
    ask = f"press the button for {MEANS[role]}" + ("; or Enter to go without" if optional else "")
    hint = ""
    names, hats = buttons_of(fields), hats_of(fields)
    unknown = [name for name, hat in hats.items() if hat.step is None]
    before_hats: Mapping[str, int] | None = None
    while True:
        moment = yield ask + hint
        before = frozenset(down)
        down.clear()
        down.update(name for name in names if moment.values.get(name))
        down.update(_directions(moment.values, hats))
        fresh = sorted(down - before)
        if fresh and fresh[0] not in taken:
            return fresh[0]
        now = {name: moment.values[name] for name in unknown if name in moment.values}
        turned = [name for name, value in now.items() if before_hats is not None and before_hats.get(name) != value]
        before_hats = now
        if fresh:
            hint = f" ({fresh[0]} is {taken[fresh[0]]} already)"
        elif turned:
            hat = hats[turned[0]]
            hint = f" ({turned[0]} goes from {hat.minimum} to {hat.maximum}, and not in degrees: it cannot be used)"
        elif moment.typed is not None and optional:
            return None
        elif moment.typed is not None:
            hint = " (it cannot be left out)"


def _directions(values: Mapping[str, int], hats: Mapping[str, Field]) -> list[str]:
    """Where hat switches point, if neither between two directions nor nowhere."""
    return [
        f"{name}.{direction}"
        for name, hat in hats.items()
        for number, direction in enumerate(DIRECTIONS)
        if name in values and off_direction(values[name], hat, 90.0 * number) < 22.5
    ]
