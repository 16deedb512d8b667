"""Which plugins of a mission a run uses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def localizer_used(mission: Mapping[str, Any], *, simulated: bool) -> Any:  # noqa: ANN401 (of a file, or checked)
    """The mission's localizer; in simulation its stand-in, if there is one; None: the run has none.

    Args:
        mission: as its file or a recording has it; what is wrong in it is passed over.
        simulated: the run meets simulated drives, by the mission's bus or by `--simulate`.
    """
    simulation = mission.get("simulation") if simulated else None
    stand_in = simulation.get("localizer") if isinstance(simulation, Mapping) else None
    return stand_in or mission.get("localizer")
