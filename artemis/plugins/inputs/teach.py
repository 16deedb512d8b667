"""Teaching a profile: somebody moves one control after the other, and what moved is noted. Pure: fed with moments.

A lesson is a generator: it yields what to tell the person, receives the next moment, and returns what it learnt.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Mapping
from dataclasses import dataclass, field
from statistics import median_low
from typing import Literal, TypeVar

from artemis.devices.hid.descriptor import Descriptor
from artemis.plugins.inputs.chain import calibrate
from artemis.plugins.inputs.hands import AXES, BUTTONS, PEDALS, Kind
from artemis.plugins.inputs.joystick import Gate
from artemis.plugins.inputs.profiles import DIRECTIONS, AxisProfile

REST = 0.5
"""So long everything has to be left alone [s]; the centres are the medians of this time."""
STILL = 0.03
"""An axis at rest moves by less than this share of its logical range."""
MOVED = {"steering": 0.05, "gas": 0.3, "brake": 0.3, "x": 0.2, "y": 0.2}
"""Share of the logical range by which an axis has to move, a stick and a wheel to both sides."""
BACK = 0.2
"""It is back when it is nearer to its rest than this share of the way that it went."""
QUICK = 0.05
"""A device that says something at least so often at rest [s] always reports."""
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
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """What is known at a time."""

    time: float
    """[s]"""
    values: Mapping[str, int] = field(default_factory=dict)
    """Counts of all fields that were heard of."""
    heard: bool = False
    """A report came just now."""
    typed: str | None = None
    """A line that was typed: empty for Enter alone."""


Lesson = Generator[str, Moment, Result]


@dataclass(frozen=True, slots=True, kw_only=True)
class Learnt:
    """What a lesson has found."""

    axes: dict[str, AxisProfile]
    buttons: dict[str, str]
    reports: Literal["always", "on_change"]
    gate: Gate


def lesson(kind: Kind, descriptor: Descriptor) -> Lesson[Learnt]:
    """The whole lesson of a device: rest, each axis, a stick's corner, each button."""
    travels = {
        f.name: f.maximum - f.minimum
        for f in descriptor.fields
        if f.bits > 1 and not f.relative and not f.name.startswith(("hat", "button.", "usage."))
    }
    rest, reports = yield from _rest(travels)
    travels = {name: travels[name] for name in rest}
    axes: dict[str, AxisProfile] = {}
    for role in AXES[kind]:
        axes[role] = yield from _axis(role, travels, rest, {axis.field: name for name, axis in axes.items()})
    gate = (yield from _gate(axes["x"], axes["y"])) if kind == "stick" else "square"
    hats = {f.name: f.minimum for f in descriptor.fields if f.name.startswith("hat")}
    names = [f.name for f in descriptor.fields if f.name.startswith("button.")]
    buttons: dict[str, str] = {}
    down: set[str] = set()
    for role in (*NEEDED, *(role for role in BUTTONS[kind] if role not in NEEDED)):
        button = yield from _button(role, names, hats, {name: taken for taken, name in buttons.items()}, down)
        if button is not None:
            buttons[role] = button
    return Learnt(axes=axes, buttons=buttons, reports=reports, gate=gate)


def _rest(travels: Mapping[str, int]) -> Lesson[tuple[dict[str, int], Literal["always", "on_change"]]]:
    """Where every axis rests, and whether the device reports at rest, too."""
    ask = "press each pedal and button once, centre everything and let go; then press Enter"
    moment = yield ask
    while moment.typed is None or not travels.keys() & moment.values.keys():
        silent = moment.typed is not None
        moment = yield f"nothing was heard of the device yet; {ask}" if silent else ask
    travels = {name: travel for name, travel in travels.items() if name in moment.values}
    hint = "do not touch it"
    while True:
        begun = last = moment.time
        gap, seen = 0.0, [moment.values]
        while moment.time - begun < REST and _is_still(seen, travels):
            moment = yield hint
            seen.append(moment.values)
            gap = max(gap, moment.time - last)
            last = moment.time if moment.heard else last
        if _is_still(seen, travels):
            rest = {name: median_low([values[name] for values in seen]) for name in travels}
            return rest, "always" if gap <= QUICK else "on_change"
        hint = "something moves; do not touch anything"


def _is_still(seen: list[Mapping[str, int]], travels: Mapping[str, int]) -> bool:
    """Whether no axis has moved; sparse devices and noisy ones alike."""
    return all(
        max(v[name] for v in seen) - min(v[name] for v in seen) <= STILL * travel for name, travel in travels.items()
    )


def _axis(
    role: str, travels: Mapping[str, int], rest: Mapping[str, int], taken: Mapping[str, str]
) -> Lesson[AxisProfile]:
    """The axis that moves most: its ends, and which of them is right, forward or pressed."""
    ask, least = f"{role}: {ASKED[role]}", MOVED[role]
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
        sides = highest[name] - rest[name], rest[name] - lowest[name]
        travel = max(sides) if role in PEDALS else min(sides)
        is_back = abs(moment.values[name] - rest[name]) <= BACK * travel
        if travel < least * travels[name] or not is_back:
            continue
        if name in taken:
            combined = "; both pedals on one axis cannot be told apart: switch the wheel to its own mode"
            hint = f" (that was {name}, which is {taken[name]}{combined if role in PEDALS else ''})"
            lowest, highest, first = dict(rest), dict(rest), dict.fromkeys(travels, 0)
            continue
        if role not in PEDALS:
            ends = {"minimum": lowest[name], "centre": rest[name], "maximum": highest[name]}
        else:
            pressed = highest[name] if first[name] > 0 else lowest[name]
            ends = {"minimum": min(pressed, rest[name]), "maximum": max(pressed, rest[name])}
        return AxisProfile(field=name, inverted=first[name] < 0, **ends)


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


def _button(
    role: str, buttons: Collection[str], hats: Mapping[str, int], taken: Mapping[str, str], down: set[str]
) -> Lesson[str | None]:
    """The button, or direction of a hat switch, that goes down; None where it is left out. `down` is kept up."""
    optional = role not in NEEDED
    ask = f"press the button for {MEANS[role]}" + ("; or Enter to go without" if optional else "")
    hint = ""
    while True:
        moment = yield ask + hint
        before = frozenset(down)
        down.clear()
        down.update(name for name in buttons if moment.values.get(name))
        down.update(_directions(moment.values, hats))
        fresh = sorted(down - before)
        if fresh and fresh[0] not in taken:
            return fresh[0]
        if fresh:
            hint = f" ({fresh[0]} is {taken[fresh[0]]} already)"
        elif moment.typed is not None and optional:
            return None
        elif moment.typed is not None:
            hint = " (it cannot be left out)"


def _directions(values: Mapping[str, int], hats: Mapping[str, int]) -> list[str]:
    """Where hat switches point, if neither between two directions nor nowhere."""
    eighths = {name: values.get(name, minimum - 1) - minimum for name, minimum in hats.items()}
    return [f"{name}.{DIRECTIONS[eighth // 2]}" for name, eighth in eighths.items() if eighth in (0, 2, 4, 6)]
