"""A mission of one step, made for a command of the robot and the bus of another mission."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from artemis.errors import ConfigError
from artemis.mission.loading import LoadedMission, load_mission
from artemis.yaml_file import Data

_KEPT = ("robot", "bus", "tick_hz", "supervision", "record")
_LONGEST = 64
"""Characters of a mission's name."""


@contextmanager
def mission_of(
    source: Path,
    name: str,
    step: Mapping[str, object],
    *,
    pace: str | None = None,
    page: Mapping[str, object] | None = None,
) -> Iterator[tuple[LoadedMission, Path]]:
    """A mission with one step, loaded, and its file, which lies beside the mission `source` until the block ends.

    It has that mission's robot, bus and care, and its simulated machine, but no inputs, faults or operator; with a
    `page` it serves one, with these keys of its observer, which is an input, too. It goes on
    after no stop by itself: somebody may have a hand at a wheel.

    Raises:
        ConfigError: the mission or the step is refused, or no file can be written beside it.
    """
    loaded = load_mission(source)
    given = loaded.documents[str(source)].data
    assert isinstance(given, dict)
    simulation: Data = given.get("simulation", {})
    assert isinstance(simulation, dict)
    policies = loaded.mission.recovery.items()
    stricter = {id: policy.model_dump(exclude_unset=True, exclude={"resume"}) for id, policy in policies}
    simulation = {key: simulation[key] for key in ("seed", "true_robot") if key in simulation}
    mission = {
        "mission": f"{loaded.mission.mission[: _LONGEST - len(name) - 1]}-{name}",
        **{key: given[key] for key in _KEPT if key in given},
        "recovery": {id: policy for id, policy in stricter.items() if policy},
        "steps": [step],
        "simulation": {**simulation, **({} if pace is None else {"pace": pace})},
    }
    try:
        file = tempfile.NamedTemporaryFile("w", dir=source.parent, prefix=f"{name}-", suffix=".yaml", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{source.parent}: cannot be written: {error.strerror}") from error
    with file:
        json.dump(mission, file)
        file.flush()
        path = Path(file.name)
        yield load_mission(path, page=page), path
