"""All robot modes by name: the one place to add a mode, beside the table in `machine.py`."""

from __future__ import annotations

from artemis.states.calibrate import CalibrateMode
from artemis.states.end import EndMode
from artemis.states.fault import FaultMode
from artemis.states.follow import FollowMode
from artemis.states.init import InitMode
from artemis.states.mode import ModeLogic, Plan
from artemis.states.quickstop import QuickstopMode
from artemis.states.ready import ReadyMode
from artemis.states.teleop import TeleopMode
from artemis.values import Mode


def modes(plan: Plan) -> dict[Mode, ModeLogic]:
    """The logic of every mode, sharing `plan`."""
    return {
        Mode.INIT: InitMode(plan),
        Mode.READY: ReadyMode(plan),
        Mode.CALIBRATE: CalibrateMode(plan),
        Mode.TELEOP: TeleopMode(plan),
        Mode.FOLLOW: FollowMode(plan),
        Mode.QUICKSTOP: QuickstopMode(plan),
        Mode.FAULT: FaultMode(plan),
        Mode.END: EndMode(plan),
    }
