"""Draws the modes of the robot and what changes them, by the table of `states/machine.py`: docs/images/modes.svg."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from artemis.states.machine import STEP_MODES, TRANSITIONS
from artemis.values import Event, Mode

OUT = Path(__file__).with_name("modes.svg")
USUAL = {Mode.INIT, Mode.READY, *STEP_MODES}
STARTS = {Mode.CALIBRATE: Event.CALIBRATE, Mode.TELEOP: Event.TELEOP, Mode.FOLLOW: Event.FOLLOW, Mode.ACT: Event.ACT}
DRAWN = {
    (Event.ALIGNED, Mode.READY): {Mode.INIT},
    **{(event, mode): {Mode.READY} for mode, event in STARTS.items()},
    (Event.DONE, Mode.READY): set(STEP_MODES),
    (Event.STOP, Mode.QUICKSTOP): {*USUAL, Mode.QUICKSTOP},
    (Event.FAULT, Mode.FAULT): {*USUAL, Mode.QUICKSTOP},
    (Event.REARMED, Mode.READY): {Mode.QUICKSTOP},
    (Event.ACKNOWLEDGED, Mode.INIT): {Mode.QUICKSTOP, Mode.FAULT},
    (Event.END, Mode.END): {*USUAL, Mode.QUICKSTOP, Mode.FAULT},
}
"""The arrows, from which modes: the same as the table's, or nothing is drawn."""
PLACES = {
    Mode.INIT: (70, 132),
    Mode.READY: (230, 132),
    **{mode: (460, 64 + 44 * row) for row, mode in enumerate(STARTS)},
    Mode.QUICKSTOP: (330, 316),
    Mode.FAULT: (330, 404),
    Mode.END: (330, 492),
}
WIDTH, HEIGHT, SIZE = 100, 32, (620, 540)
COLORS = {Mode.QUICKSTOP: "#d98a2b", Mode.FAULT: "#d64545", Mode.END: "#5f6771", **dict.fromkeys(STARTS, "#6fa8dc")}
FRAMES = ((34, 8, 572, 468), (44, 18, 552, 364), (54, 28, 532, 254), (444, 46, 132, 196))
"""Around the modes that have an arrow in common: left, top, width, height; an arrow leaves from the frame."""
HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="{0}" height="{1}" viewBox="0 0 {0} {1}" color="#1d2125">'
    "<style>text{{font:13px 'Helvetica Neue',Arial,'Liberation Sans',sans-serif;fill:currentColor}}"
    ".s{{font-size:11.5px}}</style>"
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    '<path d="M0 .5L8 4L0 7.5z" fill="currentColor"/></marker></defs><rect width="100%" height="100%" fill="#ffffff"/>'
)


def drawing() -> str:
    """The picture. Raises ValueError: the table has other arrows than it shows."""
    found: dict[tuple[Event, Mode], set[Mode]] = {}
    for (source, event), target in TRANSITIONS.items():
        found.setdefault((event, target), set()).add(source)
    if found != DRAWN:
        raise ValueError("the modes have other arrows than their picture: change DRAWN and the lines below it")
    return "\n".join([HEAD.format(*SIZE), *_frames(), *_modes(), *_arrows(), "</svg>\n"])


def _frames() -> Iterator[str]:
    look = 'fill="currentColor" fill-opacity=".035" stroke="currentColor" stroke-opacity=".4"'
    for x, y, width, height in FRAMES:
        yield f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="10" {look}/>'


def _modes() -> Iterator[str]:
    for mode, (x, y) in PLACES.items():
        color = COLORS.get(mode, "#8fbfa0")
        look = f'rx="7" fill="{color}" fill-opacity=".22" stroke="{color}"'
        yield f'<rect x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" {look}/>'
        yield f'<text x="{x + WIDTH // 2}" y="{y + 21}" text-anchor="middle">{mode.value}</text>'
    yield '<text class="s" x="34" y="504">an arrow from a frame leads</text>'
    yield '<text class="s" x="34" y="520">out of every mode in the frame</text>'
    yield '<circle cx="14" cy="148" r="6" fill="currentColor"/>'
    yield '<circle cx="474" cy="508" r="7" fill="none" stroke="currentColor"/>'
    yield '<circle cx="474" cy="508" r="4" fill="currentColor"/>'


def _arrows() -> Iterator[str]:
    yield _arrow("M20 148H69")
    yield _arrow("M170 148H229", Event.ALIGNED, 176, 142)
    for mode, event in STARTS.items():
        y = PLACES[mode][1] + HEIGHT // 2
        yield _arrow(f"M330 148H346V{y}H459", event, 352, y - 5)
    yield _arrow("M444 232H310V165", Event.DONE, 352, 227)
    yield _arrow("M390 282V315", Event.STOP, 396, 299)
    yield _arrow("M430 324H470V340H431", Event.STOP, 476, 336)
    yield _arrow("M330 324H270V165", Event.REARMED, 276, 319)
    yield _arrow("M330 340H140V165", Event.ACKNOWLEDGED, 146, 335)
    yield _arrow("M390 382V403", Event.FAULT, 396, 397)
    yield _arrow("M330 420H100V165", Event.ACKNOWLEDGED, 146, 415)
    yield _arrow("M390 476V491", Event.END, 396, 487)
    yield _arrow("M430 508H466")


def _arrow(path: str, event: Event | None = None, x: int = 0, y: int = 0) -> str:
    line = f'<path d="{path}" fill="none" stroke="currentColor" stroke-opacity=".75" marker-end="url(#tip)"/>'
    return line + (f'<text class="s" x="{x}" y="{y}">{event.value}</text>' if event else "")


if __name__ == "__main__":
    OUT.write_text(drawing())
    sys.stdout.write(f"{OUT}\n")
