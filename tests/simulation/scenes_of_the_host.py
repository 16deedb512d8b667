"""How the rows INP-.., PLG-.., SYS-.., DSK-.., PWR-.. and EST-.. are made to happen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from every_row import SETTINGS, Scene, when
from rig import TICK
from scenes_of_the_bus import BOOT
from watched import TRACTION

from artemis.drive_states import DriveState

STICK, FOLLOWER = "stick", "follower"
AT = SETTINGS["driving"].at


FELL = when(lambda truth: DriveState.OPERATION_ENABLE != truth.states[0])
"""The supply has become too low for a drive."""

CHUNK = 1.6
"""So much of a run is written to the disk at once [s]."""

HOST_SCENES: Mapping[str, Scene | Sequence[Scene]] = {
    "INP-01": Scene(device=STICK),
    "INP-03": Scene(device=STICK),
    "INP-04": Scene(device=STICK, seen=["INP-03"]),
    "INP-05": Scene(device=STICK),
    "INP-06": [Scene(device=STICK), Scene(device=STICK, options={"value": "beyond the stop"})],
    "INP-08": Scene(device=STICK, options={"duration_s": 0.6}),
    "PLG-02": [Scene(of="following", device=FOLLOWER), Scene(device=STICK, options={"input": STICK})],
    "PLG-03": [
        Scene(of="following", device=FOLLOWER, seen=["PTH-09"]),
        Scene(device=STICK, options={"input": STICK, "seconds": 0.018}),
    ],
    "PLG-04": Scene(of="following", seen=["SYS-03"], effect=1.0, alone=True),
    "PLG-06": [
        Scene(of="following", device=FOLLOWER),
        Scene(of="following", device=FOLLOWER, options={"returns": "a text"}),
        Scene(device=STICK, options={"input": STICK, "returns": "a number"}),
    ],
    "SYS-01": [
        Scene(options={"seconds": 0.1}, effect=0.1),
        Scene(
            options={"seconds": 0.044}, along=[{"at_s": AT + 0.045, "inject": "SYS-01", "seconds": 0.044}], effect=0.089
        ),
    ],
    "SYS-03": [Scene(effect=1.0, alone=True), Scene(options={"seconds": 0.18}, effect=0.18)],
    "SYS-07": Scene(seen=["SYS-03"], effect=1.0, alone=True),
    "SYS-09": Scene(options={"duration_s": 2.0}, coasts=TRACTION),
    "DSK-02": Scene(of="driving on", effect=CHUNK),
    "DSK-05": [Scene(of="driving on", effect=CHUNK), Scene(options={"files": "journal"})],
    "PWR-02": Scene(
        options={"voltage": 8.0, "within_s": 0.5}, seen=["DRV-04"], effect=FELL, device=TRACTION[0], coasts=TRACTION
    ),
    "EST-01": Scene(effect=FELL, coasts=TRACTION),
    "EST-03": Scene(of="bring-up", options={"duration_s": 3.0}, effect=BOOT + TICK, seen=["EST-01"]),
    "EST-04": Scene(of="stopping", operator=[(AT - 0.1, "quickstop")], seen=["EST-01"], effect=FELL, coasts=TRACTION),
}
