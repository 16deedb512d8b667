"""A mission as a Mermaid state diagram: words are composite states, outcomes are arrows with their names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from artemis.report.mission_boxes import AGAIN, BACK, ELSE, Arrow, Box, ends_done

_END = "[*]"


def mermaid_of(mission: Box) -> str:
    """The diagram of a mission."""
    return "\n".join([f"---\ntitle: mission {mission.text}\n---", "stateDiagram-v2", *_Diagram(mission).lines()])


class _Diagram:
    def __init__(self, mission: Box) -> None:
        self._mission = mission
        self._ids = {id(box): f"s{number}" for number, box in enumerate(mission.inside())}

    def lines(self) -> Iterator[str]:
        mission = self._mission
        yield from _indented(self._list(_END, "", mission.steps, _END))
        for arrow in mission.arrows:  # uncaught
            yield f'    state "{_escaped(f"{arrow.then}: {arrow.label}")}" as failed_{self._id(arrow)}'
            for step in mission.steps:
                if arrow.label in step.outcomes:
                    yield f"    {self._id(step)} --> failed_{self._id(arrow)}: {_escaped(arrow.label)}"

    def _id(self, of: Box | Arrow) -> str:
        return self._ids.setdefault(id(of), f"s{len(self._ids)}")

    def _list(self, source: str, label: str, steps: Sequence[Box], target: str, after: str = "") -> Iterator[str]:
        """Steps one after the other, with the arrows before the first, `label` on it, and behind the last, `after`."""
        for box in steps:
            yield from self._box(box)
        for box in steps:
            yield _arrow(source, self._id(box), label)
            source, label = self._id(box), ""
        if ends_done(steps):
            yield _arrow(source, target, after or label)

    def _box(self, box: Box) -> Iterator[str]:
        own = [*self._together(box), *self._inner(box)] if box.steps or box.beside else list(self._choices(box))
        yield f'state "{_escaped(box.name)}" as {self._id(box)}' + (" {" if own else "")
        if own:
            yield from _indented(own)
            yield "}"

    def _together(self, box: Box) -> Iterator[str]:
        for step in box.beside:
            yield from self._list(_END, "", [step], _END)
            yield "--"

    def _inner(self, box: Box) -> Iterator[str]:
        """The steps of a word, with what takes the mission out of them."""
        if not box.arrows:
            first = self._id(box.steps[0])
            loop = (box.word == "repeat") and ends_done(box.steps)
            yield from self._list(_END, "", box.steps, _END if box.done else first, "" if box.done else "next round")
            if loop and box.done:
                yield _arrow(self._id(box.steps[-1]), first, "next round")
            yield from self._left(box.steps, box.outcomes)
            return
        body = self._id(box.steps[0])
        if len(box.steps) > 1:
            body = f"{self._id(box)}_steps"
            yield f'state "steps" as {body} {{'
            yield from _indented(self._list(_END, "", box.steps, _END))
            yield "}"
            yield _arrow(_END, body)
            if ends_done(box.steps):
                yield _arrow(body, _END)
        else:
            yield from self._list(_END, "", box.steps, _END)
        for arrow in box.arrows:
            label = f"{arrow.label}, then {arrow.then}" if arrow.then and not arrow.steps else arrow.label
            label = label.removesuffix(f", then {AGAIN}")
            target, after = (body, arrow.then) if arrow.then in BACK else (_END, arrow.then)
            yield from self._list(body, label, arrow.steps, target, after if arrow.steps else label)
        caught = {arrow.label for arrow in box.arrows}
        left = {name for step in box.steps for name in step.outcomes} - caught
        for name in box.outcomes:
            if name in left:
                yield _arrow(body, _END, name)
        yield from self._left([step for arrow in box.arrows for step in arrow.steps], box.outcomes)

    def _choices(self, box: Box) -> Iterator[str]:
        """Branches of a choice; what ends a step before it is done is an arrow of the word around it."""
        if box.word != "choose":
            return
        source = f"{self._id(box)}_if"
        yield f"state {source} <<choice>>"
        yield _arrow(_END, source)
        for arrow in box.arrows:
            yield from self._list(source, arrow.label, arrow.steps, _END)
        if all(arrow.label != ELSE for arrow in box.arrows):
            yield _arrow(source, _END, ELSE)
        yield from self._left([step for arrow in box.arrows for step in arrow.steps], box.outcomes)

    def _left(self, steps: Sequence[Box], outcomes: Sequence[str]) -> Iterator[str]:
        """Outcomes of steps that end the word around them, too."""
        for step in steps:
            for name in step.outcomes:
                if name in outcomes:
                    yield _arrow(self._id(step), _END, name)


def _arrow(source: str, target: str, label: str = "") -> str:
    return f"{source} --> {target}" + (f": {_escaped(label)}" if label else "")


def _indented(lines: Iterator[str] | Sequence[str]) -> Iterator[str]:
    return (f"    {line}" for line in lines)


def _escaped(text: str) -> str:
    """Text for a label: what means something to Mermaid or HTML becomes a character's number."""
    return re.sub(r"[^\w .,?!“”'()+*/=-]", lambda found: f"#{ord(found[0])};", " ".join(text.split()))
