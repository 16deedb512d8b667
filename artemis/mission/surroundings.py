"""What a mission and its robot say of scanners, and of what simulated ones see."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from artemis.errors import ConfigError
from artemis.mission.problems import nearest
from artemis.mission.step_checks import StepChecks
from artemis.yaml_file import KeyPath, read

if TYPE_CHECKING:
    from artemis.sim.grid import MapGrid
    from artemis.sim.scenery import Scenery
    from artemis.vehicle import RobotFile

_WORLD: KeyPath = ("simulation", "world")


class SurroundingsChecks(StepChecks):
    """Goes through these parts of the mission."""

    def _check_scanners(self, robot: RobotFile | None) -> None:
        """The keys of the scanners' plugins in the robot file, and their stand-ins."""
        from artemis.plugins.registry import SCANNERS, load

        for name, mounting in robot.scanners.items() if robot is not None else ():
            for kind in ("inputs", "observers"):
                if name in self._names(kind):
                    self._complain((kind, name), "a scanner of the robot has this name: choose another one")
            document, at = self._documents[self._robot_source], ("scanners", name)
            try:
                plugin = load(SCANNERS, mounting.plugin)
            except ConfigError as error:
                self._problems += [document.problem((*at, "plugin"), problem) for problem in error.problems]
            else:
                self._validated(plugin.Config, document, at, mounting.options)
        for name in self._names("simulation", "scanners"):
            self._plugin(SCANNERS, "simulation", "scanners", name)
            if robot is not None and name not in robot.scanners:
                hint = nearest(name, robot.scanners, "scanners")
                self._complain(("simulation", "scanners", name), f"the robot has no such scanner{hint}")

    def _scenery(self) -> tuple[Scenery | None, MapGrid | None]:
        """The world of simulated scanners, and the map in it."""
        simulation = self._data.get("simulation")
        part = simulation.get("world") if isinstance(simulation, dict) else None
        if not isinstance(part, dict):
            return None, None
        from artemis.sim.scenery import Scenery

        scenery = self._validated(Scenery, self._document, _WORLD, part)
        if scenery is None or scenery.map_file is None:
            return scenery, None
        return scenery, self._grid(scenery.map_file)

    def _grid(self, name: str) -> MapGrid | None:
        """The map in a YAML file, with the image that this names."""
        from artemis.sim.grid import MapWords, grid_from, image_from

        at: KeyPath = (*_WORLD, "map_file")
        raw = self._file(at, name, read)
        if raw is None:
            return None
        try:
            document = self._survey(raw, str(self._folder / name))
        except ConfigError as error:
            self._problems += error.problems
            return None
        words = self._validated(MapWords, document)
        image = str(PurePosixPath(name).parent / words.image) if words is not None else ""
        content = self._file(at, image) if image else None
        if words is None or content is None:
            return None
        try:
            return grid_from(words, image_from(content, image))
        except ConfigError as error:
            self._problems += [document.problem(("image",), problem) for problem in error.problems]
            return None
