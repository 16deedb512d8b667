"""What of a device can be taught at all, as its report descriptor says, and how long a lesson waits for the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from artemis.devices.hid.descriptor import Field
from artemis.errors import ArtemisError
from artemis.plugins.inputs.hands import AXES, Kind
from artemis.plugins.inputs.profiles import is_button, part_of

STILL = 0.03
"""An axis at rest moves by less than this share of its logical range."""
REMIND, GIVE_UP, LONGEST = 10.0, 30.0, 180.0
"""Without a usable change of any control the lesson tells after the first time [s] what it waits for, and ends after
the second; for a single action it waits no longer than the third."""
OFTEN = 1.0
"""So many undescribed reports a second, before any described one, show another mode; fewer are those of a battery."""
Result = TypeVar("Result")


class Unteachable(ArtemisError):
    """A device does not fit, or nobody did what was asked; tells which."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """What is known at a time."""

    time: float
    """[s]"""
    values: Mapping[str, int] = field(default_factory=dict)
    """Counts of all fields that were heard of."""
    heard: str | None = None
    """The device of the profile that sent a report just now."""
    undescribed: str | None = None
    """A report came that the report descriptor does not describe: what is wrong with it."""
    typed: str | None = None
    """A line that was typed: empty for Enter alone."""


Lesson = Generator[str, Moment, Result]


def axes_of(fields: Mapping[str, Field]) -> dict[str, Field]:
    """The axes that report a position."""
    return {name: field for name, field in fields.items() if _is_axis(name, field) and not field.relative}


def buttons_of(fields: Mapping[str, Field]) -> list[str]:
    """The buttons that a profile can name."""
    return [name for name, field in fields.items() if _begins(name, "button.") and is_button(field)]


def hats_of(fields: Mapping[str, Field]) -> dict[str, Field]:
    """The hat switches, also those whose directions are not known."""
    return {name: field for name, field in fields.items() if _begins(name, "hat")}


def _is_axis(name: str, field: Field) -> bool:
    return field.bits > 1 and field.maximum > field.minimum and not _begins(name, "hat", "button.", "usage.")


def _begins(name: str, *prefixes: str) -> bool:
    return part_of(name)[1].startswith(prefixes)


def kinds_for(fields: Mapping[str, Field]) -> list[Kind]:
    """For which kinds of control there are enough axes and buttons.

    Raises:
        Unteachable: for none; tells what is missing.
    """
    axes, problems = axes_of(fields), []
    kinds = [kind for kind, roles in AXES.items() if len(roles) <= len(axes)]
    if not kinds:
        moving = [name for name, field in fields.items() if _is_axis(name, field) and field.relative]
        problems.append(f"it has {_count(axes, 'axis', 'axes')} that report a position; two are needed")
        if moving:
            problems.append(f"{', '.join(moving)} report movements only, as those of a mouse or a trackball do")
    hats = [name for name, field in hats_of(fields).items() if field.step is not None]
    if len(buttons := buttons_of(fields)) + 4 * len(hats) < 2:
        problems.append(f"it has {_count(buttons, 'button', 'buttons')}; enable and quick stop need two")
    if problems:
        raise Unteachable("; ".join(problems))
    return kinds


def _count(names: Mapping[str, Field] | list[str], one: str, several: str) -> str:
    return f"{len(names)} {one if len(names) == 1 else several}" + (f" ({', '.join(names)})" if names else "")


def watched(lesson: Lesson[Result], fields: Mapping[str, Field]) -> Lesson[Result]:
    """A lesson that does not wait for ever.

    Raises:
        Unteachable: nothing usable came for too long; tells what did.
    """
    text, hint, waiting = next(lesson), "", _Waiting(fields)
    while True:
        moment = waiting.see((yield text + hint))
        try:
            asked = lesson.send(moment)
        except StopIteration as end:
            result: Result = end.value
            return result
        if asked != text:
            text, hint = asked, ""
            waiting.begin(moment)
        hint = waiting.hint(hint, text)


class _Waiting:
    """What has come since something was asked for."""

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self._fields, self._axes = fields, axes_of(fields)
        self._values: dict[str, int] = {}
        self._then: Mapping[str, int] = {}
        self._begun: float | None = None
        self._changed = self._now = 0.0
        self._described, self._undescribed = 0, Counter[str]()
        self._known = False

    def see(self, moment: Moment) -> Moment:
        """Take a moment. Returns it without values of axes that lie outside of their range: those drive nothing."""
        ranges = self._axes
        sane = {n: v for n, v in moment.values.items() if n not in ranges or _is_within(v, ranges[n])}
        self._values.update(sane)
        moment = replace(moment, values=dict(self._values))
        if self._begun is None:
            self.begin(moment)
        self._now = moment.time
        self._described += moment.heard is not None
        self._known = self._known or moment.heard is not None
        if moment.undescribed is not None:
            self._undescribed[moment.undescribed] += 1
        if moment.typed is not None or self._has_changed():
            self._changed, self._then = moment.time, moment.values
        return moment

    def begin(self, moment: Moment) -> None:
        """Something else is asked for."""
        self._begun = self._changed = moment.time
        self._then, self._described = moment.values, 0
        self._undescribed.clear()

    def _has_changed(self) -> bool:
        """Whether an axis has moved, or anything else is not as it was; what no profile can name does not count."""
        for name, value in self._values.items():
            before = self._then.get(name)
            if name in self._axes:
                axis = self._axes[name]
                if before is None or abs(value - before) > STILL * (axis.maximum - axis.minimum):
                    return True
            elif value != before and _begins(name, "hat", "button."):
                return True
        return False

    def hint(self, hint: str, asked: str) -> str:
        """What to add to what is asked for.

        Raises:
            Unteachable: it was waited for long enough.
        """
        assert self._begun is not None
        idle, asked_for = self._now - self._changed, self._now - self._begun
        if not self._known and asked_for >= REMIND and self._undescribed.total() >= OFTEN * asked_for:
            raise Unteachable(
                f"{self._what()}; another mode of the device may help (a switch, other buttons at the start)"
            )
        if idle >= GIVE_UP or asked_for >= LONGEST:
            waited = idle if idle >= GIVE_UP else asked_for
            raise Unteachable(f"{self._what()}; it was waited {waited:.0f} s for: {asked}")
        if idle < REMIND:
            return ""
        return hint or f" (still waiting: {self._what()}; the lesson ends in {GIVE_UP - REMIND:.0f} s)"

    def _what(self) -> str:
        if self._undescribed:
            kinds = ", ".join(f"{what} ({number})" for what, number in self._undescribed.most_common(3))
            known = f"; {self._described} it does" if self._described else ""
            return f"it sends reports that its report descriptor does not describe: {kinds}{known}"
        return "its reports change no axis and no button" if self._described else "no report came from it"


def _is_within(value: int, field: Field) -> bool:
    return field.minimum <= value <= field.maximum
