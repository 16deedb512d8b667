"""A mission as a picture: nested boxes from top to bottom, outcomes and conditions as arrows. Drawn without a network.

Each block is drawn from its own corner and knows its size; who contains it places it. Steps stand below each other; to
their right, behind a bracket, stands what takes the mission out of them. What is done then leaves a word along a rail
at its right.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from html import escape

from msgspec import Struct
from msgspec.structs import replace

from artemis.report.mission_boxes import AGAIN, BACK, ELSE, FAILS, Arrow, Box, ends_done
from artemis.states.tree import RESTART

LINE, SMALL, PAD, GAP, AXIS = 18, 15, 14, 24, 30
"""Height of a line and of a small one; space within a box, and between two; where arrows leave it, from its left."""
LONGEST, LONGEST_LABEL = 40, 28
"""Characters of a line."""
LOOP, BRACKET, LANE = 22, 10, 40
"""Width of what runs back beside steps that are repeated, of a bracket, and between steps side by side."""
_COLORS = {
    "calibrate": "#d9b44a",
    "follow": "#6fa8dc",
    "goto": "#5fa8a0",
    "teleop": "#a58bd0",
    "wait": "#8fbfa0",
    "ask": "#d58bb5",
    "say": "#9aa0a6",
    "end": "#5f6771",
    "stop": "#5f6771",
    "outcome": "#d98a2b",
}
_OTHER = "#6fa8dc"
_WIDTHS = {**dict.fromkeys("ijl.,:;'|!()[] ftIr/-“”", 0.4), **dict.fromkeys("mwMW@%…", 0.98)}
"""Of characters, in their size; of a font that is rather wide."""
_STYLE = (
    ".mission text{font:13px 'Helvetica Neue',Arial,'Liberation Sans',sans-serif;fill:currentColor;white-space:pre}"
    ".mission .s{font-size:11.5px}.mission .b{font-weight:600}"
)
_FAILED = "#d64545"
_INK = 'fill="none" stroke="currentColor" stroke-opacity=".75"'
_WITH_TIP = ' marker-end="url(#tip)"'
_TIP = (
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    '<path d="M0 .5L8 4L0 7.5z" fill="currentColor"/></marker></defs>'
)


def chart(mission: Box, marks: Mapping[str, str] | None = None) -> str:
    """The picture as an SVG element.

    Args:
        mission: What is drawn.
        marks: By key path, what a run says of the boxes; steps with none did not run. None: the picture is a file of
            its own, dark on light; else its ink is the text colour of the page around it.
    """
    fails = tuple(replace(arrow, label=f"{arrow.label}, not caught") for arrow in mission.arrows)
    block = _Drawing(marks).box(replace(mission, arrows=fails))
    width, height, x = round(block.width + 24), round(block.height + 68), 12 + AXIS
    parts = [_TIP, '<rect width="100%" height="100%" fill="#ffffff"/>' if marks is None else ""]
    parts += [f'<circle cx="{x}" cy="12" r="6" fill="currentColor"/>', _line(f"M{x} 18V33", tip=True)]
    parts += [block.at(12, 34)]
    if mission.done:
        parts += [_line(f"M{x} {height - 34}V{height - 21}", tip=True)]
        parts += [f'<circle cx="{x}" cy="{height - 12}" r="7" fill="none" stroke="currentColor"/>']
        parts += [f'<circle cx="{x}" cy="{height - 12}" r="4" fill="currentColor"/>']
    color = ' color="#1d2125"' if marks is None else ""
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}" style="width:{width}px"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" class="mission" {size}{color}>'
    return f"{head}<style>{_STYLE}</style>{''.join(parts)}</svg>\n"


class _Block(Struct, frozen=True):
    """A part of the picture [px]."""

    width: float
    height: float
    svg: str = ""
    entries: tuple[float, ...] = ()
    """Of branches: where their arrows come in."""
    exits: tuple[tuple[float, float], ...] = ()
    """And where those end with which the word is done."""

    def at(self, x: float, y: float) -> str:
        """The block at a place of the one around it."""
        return f'<g transform="translate({x:g} {y:g})">{self.svg}</g>'


class _Drawing:
    def __init__(self, marks: Mapping[str, str] | None) -> None:
        self._marks, self._all_ran = marks or {}, marks is None

    def box(self, box: Box) -> _Block:
        """A step or a word, with all that is in it."""
        return self._word(box) if box.steps or box.word == "choose" else self._leaf(box)

    def _leaf(self, box: Box) -> _Block:
        head, rows = self._head(box), self._rows(box.arrows, 0)
        width, height = max(head.width + 2 * PAD, 2 * AXIS), max(head.height + 12, rows.height)
        mark, color = self._marks.get(box.path), _COLORS.get(box.word, _OTHER)
        if box.text.startswith(("failed", FAILS)) and box.word in ("end", "outcome"):
            color = _FAILED
        faded = "" if self._all_ran or mark or box.word == "outcome" else ' opacity=".45"'
        corner = height / 2 if box.word == "outcome" else 7
        rect = _rect(width, height, corner, f'fill="{color}" fill-opacity=".22" stroke="{color}"')
        svg = f"<g{faded}>{rect}{head.at(PAD, (height - head.height) / 2)}</g>{rows.at(width, 0)}"
        return _Block(width + rows.width, height, svg)

    def _head(self, box: Box) -> _Block:
        """Its name, below that what a run says of it."""
        name = box.text if box.word == "outcome" else box.name
        lines = textwrap.wrap(name, LONGEST, max_lines=3, placeholder=" …")
        mark = self._marks.get(box.path, "")
        parts, y = [], 0.0
        for number, line in enumerate(lines):
            first, rest = (box.word, line.removeprefix(box.word)) if number == 0 and name == box.name else ("", line)
            word = f'<tspan class="b">{escape(first)}</tspan>' if first else ""
            parts.append(f'<text y="{y + 13:g}">{word}{escape(rest)}</text>')
            y += LINE
        if mark:
            parts.append(f'<text class="s b" opacity=".8" y="{y + 11:g}">{escape(mark)}</text>')
        width = max(_width(mark, 11.5), *(_width(line) for line in lines))
        return _Block(width, y + (SMALL if mark else 0), "".join(parts))

    def _word(self, box: Box) -> _Block:
        chooses, is_mission = box.word == "choose", box.path == ""
        head, body = self._head(box), _Block(4, 0) if chooses else self._body(box)
        rows = self._rows(box.arrows, 0 if chooses or is_mission else BRACKET)
        top, right = head.height + 20, PAD + body.width
        at = (PAD, top + body.height + GAP) if is_mission else (right, top)
        inner = at[1] + rows.height - top if is_mission and box.arrows else max(body.height, rows.height)
        below, rail = top + inner + 12, at[0] + rows.width + 12
        width = max(rail + 12 if rows.exits else rail + 2, right + PAD, head.width + 2 * PAD)
        open_end = chooses and box.arrows[-1].label != ELSE
        height = below + 10 if rows.exits or open_end else below + 2
        frame = 'fill="currentColor" fill-opacity=".035" stroke="currentColor" stroke-opacity=".4"'
        parts = [_rect(width, height, 10, frame), head.at(PAD, 8), body.at(PAD, top), rows.at(*at)]
        if chooses:
            line = f"V{below:g}H{AXIS}V{height:g}" if open_end else f"V{top + rows.entries[-1]:g}"
            parts.append(_line(f"M{right:g} {top - 8:g}{line}"))
        elif box.arrows and not is_mission:
            parts.append(_line(f"M{right + 4:g} {top:g}h6V{top + inner:g}h-6"))
        if rows.exits:
            y = min(y for _, y in rows.exits) + top + 9
            parts += [_line(f"M{right + x:g} {top + y:g}v9H{rail:g}") for x, y in rows.exits]
            parts.append(_line(f"M{rail:g} {y:g}V{below:g}H{AXIS}V{height:g}"))
            if box.steps and ends_done(box.steps):
                x = PAD + AXIS + (LOOP if _loops(box) else 0)
                parts.append(_line(f"M{x} {top + body.height:g}V{below:g}"))
        return _Block(width, height, "".join(parts))

    def _body(self, box: Box) -> _Block:
        """The steps of a word, side by side with those beside."""
        if not box.beside:
            block = self._stack(box.steps)
            if not _loops(box):
                return block
            back = _line(f"M{LOOP} {max(block.height - 12, 24):g}H4V16H{LOOP - 1}", tip=True)
            return _Block(LOOP + block.width, block.height, block.at(LOOP, 0) + back)
        lanes = [self._stack(lane) for lane in (box.steps, *((step,) for step in box.beside))]
        height, x, parts = LINE + max(lane.height for lane in lanes), 0.0, list[str]()
        for number, lane in enumerate(lanes):
            if number:
                parts.append(f'<path d="M{x - LANE / 2:g} 0V{height:g}" {_INK} stroke-dasharray="5 4"/>')
            caption = f'<text class="s" y="8" opacity=".8">{"beside" if number else "steps"}</text>'
            parts.append(_Block(0, 0, caption).at(x, 0) + lane.at(x, LINE))
            x += lane.width + LANE
        return _Block(x - LANE, height, "".join(parts))

    def _stack(self, steps: Sequence[Box]) -> _Block:
        """Below each other."""
        parts, y, width = list[str](), 0.0, 0.0
        for number, step in enumerate(steps):
            block = self.box(step)
            if number:
                parts.append(_line(f"M{AXIS} {y:g}v{GAP - 1}", tip=True) if steps[number - 1].done else "")
                y += GAP
            parts.append(block.at(0, y))
            y, width = y + block.height, max(width, block.width)
        return _Block(width, y, "".join(parts))

    def _rows(self, arrows: Sequence[Arrow], begin: float) -> _Block:
        """What takes the mission out of steps: each arrow with its label, at its end what is done then."""
        if not arrows:
            return _Block(0, 0)
        labels = [textwrap.wrap(arrow.label, LONGEST_LABEL, max_lines=4, placeholder=" …") for arrow in arrows]
        long = begin + 22 + max(_width(line, 11.5) for label in labels for line in label)
        y, width, parts, entries, exits = 0.0, 0.0, list[str](), list[float](), list[tuple[float, float]]()
        for arrow, label in zip(arrows, labels, strict=True):
            branch = self._stack(_branch(arrow))
            entry = y + max(16, SMALL * len(label) + 2)
            for number, line in enumerate(reversed(label)):
                text = f'<text class="s" x="{begin + 7}" y="{entry - 5 - SMALL * number:g}">{escape(line)}</text>'
                parts.append(text)
            parts += [_line(f"M{begin} {entry:g}H{long - 1:g}", tip=True), branch.at(long, entry - 16)]
            bottom = entry - 16 + branch.height
            if arrow.then in BACK and arrow.steps:
                back = max(bottom - 8, entry + SMALL + 12)
                parts.append(f'<text class="s" x="{begin + 12}" y="{back - 5:g}">{escape(arrow.then)}</text>')
                parts.append(_line(f"M{long:g} {bottom - 8:g}H{long - 8:g}V{back:g}H{begin + 1}", tip=True))
                bottom = max(bottom, back)
            if arrow.is_done:
                exits.append((long + AXIS, bottom))
                bottom += 12
            entries.append(entry)
            y, width = bottom + 10, max(width, long + branch.width)
        return _Block(width, y - 10, "".join(parts), tuple(entries), tuple(exits))


def _branch(arrow: Arrow) -> Sequence[Box]:
    """What is done at the end of an arrow, with the outcome that follows."""
    if not arrow.then or (arrow.then in BACK and arrow.steps):
        return arrow.steps
    text = {AGAIN: "steps again", RESTART: "steps from the beginning"}.get(arrow.then, arrow.then)
    return (*arrow.steps, Box(path="", word="outcome", text=text, done=False))


def _loops(box: Box) -> bool:
    return box.word == "repeat" and ends_done(box.steps)


def _width(text: str, size: float = 13.0) -> float:
    """About how wide a text is, rather too much [px]."""
    return size * sum(_WIDTHS.get(each, 1.1 if each > "\u2e7f" else 0.76 if each.isupper() else 0.6) for each in text)


def _rect(width: float, height: float, corner: float, look: str) -> str:
    return f'<rect width="{width:g}" height="{height:g}" rx="{corner:g}" {look}/>'


def _line(path: str, *, tip: bool = False) -> str:
    return f'<path d="{path}" {_INK}{_WITH_TIP if tip else ""}/>'
