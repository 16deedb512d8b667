"""How the rows DRV-.. are made to happen: each error of a drive, once as it is and once with its EMCY frame lost."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from every_row import Scene
from watched import DRIVES, TRACTION

from artemis.sim.epos_errors import ERRORS, Reaction
from artemis.testing.drive_injections import CODES, UNKNOWN

LEFT, RIGHT = TRACTION
SILENT = "DRV-21"
"""A drive goes on after this error; without the EMCY frame nothing tells."""
ON_EVERY_DRIVE = ("DRV-02", "DRV-21", "DRV-25")
"""Errors after which a drive switches off, goes on, and stops by itself."""


def of_code(code: int, node: str, *, heard: bool = True, of: str = "driving") -> Scene:
    """A drive has this error; where its EMCY frame is lost, the statusword tells that there is one."""
    switches_off = code == UNKNOWN or ERRORS[code].reaction is Reaction.POWER_OFF
    return Scene(
        of=of,
        node=node,
        options={"code": code, "heard": heard},
        seen=() if heard else ["COM-01"],
        coasts=[node] if switches_off and node in TRACTION else [],
    )


_NODES = itertools.cycle(DRIVES)
HEARD: Mapping[str, Sequence[Scene]] = {
    id: [
        of_code(code, node)
        for code in codes
        for node in (DRIVES if id in ON_EVERY_DRIVE and code == codes[0] else [next(_NODES)])
    ]
    for id, (_, codes) in {**CODES, "DRV-31": ("", (UNKNOWN,))}.items()
}
UNHEARD: Mapping[str, Sequence[Scene]] = {
    id: [
        of_code(codes[0], node, heard=False) for node in (DRIVES if id in ON_EVERY_DRIVE else [next(_NODES)])
    ]
    for id, (_, codes) in CODES.items()
    if id != SILENT
}
OTHERS: Mapping[str, Scene] = {
    "DRV-32": Scene(node=RIGHT),
    "DRV-33": Scene(node=LEFT, options={"rate_hz": 100.0}, coasts=[LEFT]),
}
DRIVE_SCENES: Mapping[str, Scene | Sequence[Scene]] = {**HEARD, **OTHERS}
