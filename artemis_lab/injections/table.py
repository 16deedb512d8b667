"""Every fault that can be made to happen in a simulated run, by its row in the fault table; and why others cannot."""

from __future__ import annotations

from typing import Any

from artemis.supervision.catalogue import ROWS
from artemis.vehicle import RobotFile
from artemis_lab.injections.bus import BUS_INJECTIONS
from artemis_lab.injections.drives import DRIVE_INJECTIONS
from artemis_lab.injections.host import HOST_INJECTIONS
from artemis_lab.injections.localizers import LOCALIZER_INJECTIONS
from artemis_lab.injections.motion import MOTION_INJECTIONS
from artemis_lab.injections.scanners import SCANNER_INJECTIONS
from artemis_lab.injections.stage import Injection, Needs, Stage, Undo

INJECTIONS: dict[str, Injection] = dict(
    sorted(
        {
            **DRIVE_INJECTIONS,
            **BUS_INJECTIONS,
            **MOTION_INJECTIONS,
            **HOST_INJECTIONS,
            **SCANNER_INJECTIONS,
            **LOCALIZER_INJECTIONS,
        }.items()
    )
)
"""By row of the fault table."""

_FILE = "is found in a file, before a run"
_NETWORK = "needs an operator on a network: `artemis_lab.injections.damaged_link`"
_SERIAL = "needs a serial line, which no run has: `artemis_lab.injections.damaged_serial`"
_PROCESS = "would end the simulated drives with it: they share the process"
_DEVICE = "needs a device: `artemis.testing.fake_hid`"

NOT_INJECTED: dict[str, str] = {
    "RUN-07": "LOC-02 makes the localizer contradict the odometry",
    "RUN-08": "COM-26 makes it happen, where the robot moves",
    "CAL-03": "needs a hard stop, a home switch or an absolute encoder that is not where the robot file says",
    "INP-02": _DEVICE,
    "INP-13": "a lower input takes over at standstill; a higher one at once, within the limits of the gate",
    "INP-14": _DEVICE,
    "INP-15": _DEVICE,
    "INP-16": _DEVICE,
    **{f"NET-{number:02}": _NETWORK for number in (*range(1, 11), 15)},
    **{f"SER-{number:02}": _SERIAL for number in range(1, 6)},
    "NET-11": "needs an operator at a page whose link is held up",
    "NET-12": "needs programs of others: a master that goes, a subscriber that hangs",
    "NET-13": "needs an observer with a process of its own: a simulation that keeps real time",
    **dict.fromkeys(("NET-14", "LOC-07"), "needs an operator who gives goals and poses"),
    "LAS-08": "needs something in the robot's way",
    "LAS-09": "a scanner is configured when it is connected",
    "LOC-06": "on virtual time a localizer takes no time",
    **{f"PTH-{number:02}": _FILE for number in range(1, 5)},
    "PTH-05": "a path begins where the robot stands",
    "PTH-10": "on virtual time nothing is planned or fitted in another process",
    "PTH-11": "the files of a map are no part of the simulated world",
    **{f"MIS-{number:02}": _FILE for number in range(1, 8)},
    "PLG-01": "a plugin is made before a run",
    "PLG-07": "a plugin is never given the bus",
    "SYS-02": "nothing in a run reads the wall clock",
    "SYS-06": _PROCESS,
    "SYS-08": _PROCESS,
    "SYS-11": "no common way to read a computer's temperature",
    "DSK-01": "is looked for before a run",
    "DSK-03": "in virtual time a recording waits for its disk, however slow",
    "DSK-04": "is found when a journal is read",
    "EST-02": "needs an input pair",
    "OPR-03": "happens by itself when no operator acts",
}
"""Rows that no injection can make happen, each with the reason."""


def shows_on(id: str, robot: RobotFile) -> bool:
    """Whether a row can be injected there; what happens to no single drive may show as another row, too."""
    return INJECTIONS[id].needs is Needs.NOTHING or not ROWS[id].is_missed_by(robot)


def inject(stage: Stage, id: str, node: str | None = None, **parameters: Any) -> Undo:  # noqa: ANN401 (of any row)
    """Make the fault of row `id` happen now; what it returns ends it (where it can end).

    Raises:
        KeyError: no such injection.
        ValidationError: wrong parameters.
        ValueError: no such drive or input, or none where one is needed.
    """
    injection = INJECTIONS[id]
    checked = injection.parameters.model_validate(parameters)
    stage.bus.catch_up()
    undo = injection.act(stage, node, checked)
    duration = getattr(checked, "duration_s", None)
    if undo is None:
        return lambda: None
    if duration is not None:
        stage.loop.call_later(duration, undo)
    return undo
