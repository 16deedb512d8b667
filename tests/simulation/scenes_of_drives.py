"""How the rows DRV-.. are made to happen: each error of a drive, once as it is and once with its EMCY frame lost."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from every_row import Scene
from watched import DRIVES, TRACTION

from artemis.sim.epos_errors import ERRORS, Reaction
from artemis_lab.injections.drives import UNKNOWN
from artemis_lab.injections.emergencies import CODES

LEFT, RIGHT = TRACTION
SILENT = "DRV-21"
"""A drive goes on after this error; without its EMCY frame nothing tells."""
ON_EVERY_DRIVE = ("DRV-02", SILENT, "DRV-25")
"""Errors after which a drive switches off, goes on, and stops by itself."""
_CODES = {**CODES["epos1"], "DRV-31": (UNKNOWN,)}
_NODES = itertools.cycle(DRIVES)


def of_code(id: str, code: int, node: str, *, heard: bool = True, of: str = "driving") -> Scene:
    """A drive has this error."""
    switches_off = code == UNKNOWN or ERRORS[code].reaction is Reaction.POWER_OFF
    coasts = [node] if switches_off and node in TRACTION else []
    return Scene(of=of, inject=id, node=node, options={"code": code, "heard": heard}, coasts=coasts)


def _nodes(id: str, code: int) -> Sequence[str]:
    """All of them, for some errors."""
    return DRIVES if id in ON_EVERY_DRIVE and code == _CODES[id][0] else [next(_NODES)]


DRIVE_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    **{id: [of_code(id, code, node) for code in codes for node in _nodes(id, code)] for id, codes in _CODES.items()},
    "DRV-32": Scene(node=RIGHT),
    "DRV-33": Scene(node=LEFT, options={"rate_hz": 100.0}, coasts=[LEFT]),
}
UNHEARD: Mapping[str, Sequence[Scene]] = {
    "COM-01": [
        of_code(id, codes[0], node, heard=False)
        for id, codes in _CODES.items()
        if id != SILENT
        for node in _nodes(id, codes[0])
    ]
}
"""The statusword tells that there is an error; which one, the error history."""
