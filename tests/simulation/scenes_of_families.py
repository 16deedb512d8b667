"""Robots with drives of other families: the scenes of ARTEMIS, each with as little changed as its drives need."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from every_row import NO_LATER, Later, Scene, scenes, when
from rig import EPOS2, robot_named
from scenes_of_motion import MOTION_SCENES
from scenes_of_the_bus import BUS_SCENES
from scenes_of_the_host import HOST_SCENES
from watched import DRIVES, TRACTION

from artemis.sim.cia402 import ERRORS_402
from artemis.sim.epos2 import ERRORS_2
from artemis.sim.epos4_errors import ERRORS_4
from artemis.sim.epos_errors import EposError, Reaction
from artemis.values import Severity
from artemis_lab.injections.drives import UNKNOWN
from artemis_lab.injections.emergencies import CODES
from artemis_lab.injections.table import shows_on

LEFT = TRACTION[0]
BOOT_4 = 0.2
"""An EPOS4 boots in this time [s]."""

Change = Callable[[Scene], Scene | None]
"""The scene with what is different; None: it does not happen with these drives."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A robot with drives of one family, and what is different with them."""

    robot: str
    errors: Mapping[int, EposError]
    """What a drive does when it has an error."""
    later: Later = NO_LATER
    changed: Mapping[str, Change] = field(default_factory=dict)
    """By row."""

    @property
    def family(self) -> str:
        """Of all its drives."""
        return robot_named(self.robot).drives[LEFT].family

    def on(self, scene: Scene) -> Scene:
        """The scene on this robot."""
        units = robot_named(self.robot).drives[LEFT].tables.velocity_scale
        return replace(scene, robot=self.robot, units=units, later=self.later)

    def of_code(self, id: str, code: int, node: str, *, heard: bool = True) -> Scene:
        """A drive has this error."""
        off = code == UNKNOWN or self.errors[code].reaction is Reaction.POWER_OFF
        coasts = [node] if off and node in TRACTION else []
        return self.on(Scene(inject=id, node=node, options={"code": code, "heard": heard}, coasts=coasts))

    def of_errors(self) -> Iterator[tuple[str, Scene]]:
        """Each code, and one that nobody knows, on one drive after the other, heard and not heard.

        Not those that nothing shows: a drive goes on with a warning, or not heard with nothing.
        """
        nodes = itertools.cycle(DRIVES)
        for id, codes in {**CODES[self.family], "DRV-31": (UNKNOWN,)}.items():
            for code, heard in itertools.product(codes, (True, False)):
                reaction = self.errors[code].reaction if code != UNKNOWN else Reaction.POWER_OFF
                if reaction is Reaction.WARNING or (reaction is Reaction.NONE and not heard):
                    continue
                yield (id if heard else "COM-01"), self.of_code(id, code, next(nodes), heard=heard)

    def of_others(self) -> Iterator[tuple[str, Scene]]:
        """Faults of the bus, of motion and of the host."""
        for id, scene in scenes({**BUS_SCENES, **MOTION_SCENES, **HOST_SCENES}):
            if scene.robot is None and shows_on(id, robot_named(self.robot)):
                changed = self.changed[id](scene) if id in self.changed else scene
                if changed is not None:
                    yield id, self.on(changed)


def _unless_switched_on(scene: Scene) -> Scene | None:
    """In Switched On nobody sees a drive of CiA 402: the next set-point takes it back into operation at once."""
    return None if scene.options.get("state") == "switched on" else scene


def _slowly(scene: Scene) -> Scene:
    """A change of state may take half a second more than the row says."""
    effect = scene.effect
    assert not isinstance(effect, float)
    return replace(scene, effect=lambda run, at: effect(run, at) + 0.5)


def _lost(scene: Scene) -> Scene:
    """A drive that interpolates misses its set-points before the motion shows it."""
    return replace(scene, seen=["DRV-38"], device=scene.node, effect=0.06)


def _stalled(scene: Scene) -> Scene | None:
    """All of them do, when the computer does nothing; where it comes late by less than two periods none does."""
    if scene.options.get("seconds", 1.0) < 0.1:
        return scene
    return replace(scene, seen=["DRV-38"], device=LEFT, severity=Severity.QUICK_STOP)


def _opened(scene: Scene) -> Scene:
    """By the supply; open STO inputs tell nothing before the drives are to be enabled."""
    return replace(scene, options={**scene.options, "opens": "supply"}, effect=BOOT_4 + 0.02)


MACHINES = {
    "epos2": Machine(robot=EPOS2, errors=ERRORS_2),
    "epos4": Machine(
        robot="artemis_epos4.yaml",
        errors=ERRORS_4,
        later=Later(proving=2.36, ready=6.66, aligning=4.28),
        changed={
            "COM-02": _unless_switched_on,
            "COM-03": _slowly,
            "COM-12": _lost,
            "COM-26": lambda scene: replace(scene, effect=BOOT_4),
            "COM-31": _stalled,
            "STE-01": _lost,
            "CAL-01": lambda scene: (
                replace(scene, effect=when(lambda truth: truth.time > 21.3)) if scene.of == "measuring" else scene
            ),
            "PTH-09": _stalled,
            "PLG-03": _stalled,
            "SYS-01": _stalled,
            "EST-03": _opened,
        },
    ),
    "cia402": Machine(
        robot="artemis_cia402.yaml",
        errors=ERRORS_402,
        later=Later(proving=0.06),
        changed={"COM-02": _unless_switched_on, "COM-03": _slowly},
    ),
}
