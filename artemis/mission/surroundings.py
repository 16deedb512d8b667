"""What a mission and its robot say of scanners, and of what simulated ones see."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from artemis.errors import ConfigError
from artemis.mission.problems import nearest
from artemis.mission.step_checks import StepChecks
from artemis.plugins.stated import address_of, field_of, least_range_of
from artemis.route_planning.zones import NO_MAP, zones_file
from artemis.route_planning.zones import SUFFIX as ZONES
from artemis.states.outcomes import NO_BATTERY
from artemis.yaml_file import Document, KeyPath, dotted, read, survey

if TYPE_CHECKING:
    from artemis.sim.grid import MapGrid
    from artemis.sim.scenery import Scenery
    from artemis.vehicle import RobotFile

_WORLD: KeyPath = ("simulation", "world")


def _is_map(file: Path) -> bool:
    """Whether it is the YAML file of a map, which may be replaced by another one."""
    from artemis.mapping.map_file import MapKeys

    try:
        document, problems = survey(read(file), str(file))
    except ConfigError:
        return False
    return not problems and not MapKeys(document).problems


class SurroundingsChecks(StepChecks):
    """Goes through these parts of the mission."""

    def _check_scanners(self, robot: RobotFile | None) -> None:
        """The keys of the scanners' plugins in the robot file, and their stand-ins."""
        from artemis.plugins.registry import SCANNERS, load

        owner: dict[tuple[str, str], str] = {}
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
                config = self._validated(plugin.Config, document, at, mounting.options)
                if (address := address_of(config)) is not None:
                    self._check_address(document, at, owner.setdefault((mounting.plugin, address), name), address)
                if mounting.least_range_m < (least := least_range_of(plugin)):
                    text = f"{mounting.plugin} measures nothing nearer than {least:g} m; expected at least that"
                    self._problems.append(document.problem((*at, "least_range_m"), text))
        for name in self._names("simulation", "scanners"):
            self._plugin(SCANNERS, "simulation", "scanners", name)
        for part in (("simulation", "scanners"), ("simulation", "true_robot", "scanners")):
            for name in self._names(*part):
                if robot is not None and name not in robot.scanners:
                    hint = nearest(name, robot.scanners, "scanners")
                    self._complain((*part, name), f"the robot has no such scanner{hint}")

    def _check_address(self, document: Document, at: KeyPath, owner: str, address: str) -> None:
        """That a scanner at `at` is the first one with this address."""
        if owner != at[-1]:
            text = f"{address} is the address of {owner}, too: each scanner has its own"
            self._problems.append(document.problem(at, text))

    def _check_view(self, robot: RobotFile | None) -> None:
        """That a robot that is to stop for obstacles can see them."""
        if robot is None or robot.outline is None or not robot.scanners or not self._stops_for_obstacles:
            return
        from artemis.motion.lane import unseen_ahead
        from artemis.plugins.registry import SCANNERS, load

        try:
            fields = {name: field_of(load(SCANNERS, mounting.plugin)) for name, mounting in robot.scanners.items()}
        except ConfigError:  # reported where the scanners are read
            return
        if (unseen := unseen_ahead(robot, fields)) is not None:
            right, left = (100.0 * place for place in unseen)
            where = f"from {right:+.0f} to {left:+.0f} cm, left positive"
            problem = (
                f"no scanner sees all of the ground ahead before the robot drives over it ({where}): it could not "
                "drive forwards. Correct heading_deg or mask, add a scanner that looks ahead, or write in the mission "
                "why it need not: obstacles: {mode: off, reason: ...}"
            )
            self._problems.append(self._documents[self._robot_source].problem(("scanners",), problem))

    def _check_loads(self, robot: RobotFile | None) -> None:
        """Loads on which gains act, of drives whose gains are known."""
        from artemis.mission.gains import gains_key

        at = "simulation", "true_robot", "loads"
        for role in self._names(*at):
            for name, drive in robot.drives.items() if robot is not None else ():
                if drive.role != role:
                    continue
                if drive.tables.gain_scale is None:
                    text = f"what gains do to a drive like {name} ({drive.tables.title}) is not known"
                    self._complain((*at, role), text)
                elif drive.known_gains is None:
                    text = f"only for drives with `{gains_key(drive)}` in the robot file: {name} has none"
                    self._complain((*at, role), text)

    def _check_supply(self, robot: RobotFile | None) -> None:
        """What is true of a battery that the robot file describes."""
        at = "simulation", "true_robot", "supply"
        for key in self._names(*at):
            if key in ("charger", "capacity_scale", "idle_w") and robot is not None and robot.battery is None:
                self._complain((*at, key), NO_BATTERY)
        if robot is None or robot.battery is None or robot.supply_source is None:
            return
        if unknown := [name for name, d in robot.drives.items() if d.role == "traction" and d.tables.current is None]:
            self._remarks.append(
                f"nobody measures the current of {', '.join(unknown)} (`cia402.current`): what they take of the "
                "battery is told too low, and its range only once the run has shown what is taken"
            )

    def _check_mapping(self, robot: RobotFile | None) -> None:
        """The scanner that makes a map, and the name of its file."""
        from artemis.mission.schema import Mapping

        if self._data["mapping"] is None:
            text = (
                "expected a mapping, found nothing, so no map would be made: write `mapping: {}`, or leave the key out"
            )
            self._complain(("mapping",), text)
            return
        mapping = self._part(Mapping, "mapping")
        if mapping is None or robot is None:
            return
        if mapping.scanner is None and len(robot.scanners) != 1:
            names = ", ".join(robot.scanners)
            problem = f"choose one with scanner: NAME: {names}" if names else f"{robot.robot} has no scanner"
            self._complain(("mapping",), problem)
        elif mapping.scanner is not None and mapping.scanner not in robot.scanners:
            hint = nearest(mapping.scanner, robot.scanners, "scanners")
            self._complain(("mapping", "scanner"), f"the robot has no such scanner{hint}")
        if mapping.file is not None:
            self._check_map_file(("mapping", "file"), mapping.file, mapping.replace)

    def _check_map_file(self, at: KeyPath, name: str, replace: bool) -> None:
        from artemis.mapping.graph_file import files_of

        file, root = self._folder / name, os.path.realpath(self._folder)
        there = [each for each in files_of(file) if each.exists()]
        zones = Path(zones_file(str(file)))
        if file.suffix != ".yaml":
            self._complain(at, "name the map .yaml; its image and its graph are written beside it")
        elif os.path.isabs(name) or os.path.commonpath([root, os.path.realpath(file)]) != root:
            self._complain(at, f"outside the mission's folder {self._folder}: {name}")
        elif not file.parent.is_dir():
            self._complain(at, f"no such folder: {file.parent}")
        elif name.endswith(ZONES):
            self._complain(at, f"{name}: {NO_MAP}")
        elif file.exists() and not _is_map(file):
            self._complain(at, f"{name} exists, and is no map: name another file")
        elif there and not replace:
            taken = there[0].relative_to(self._folder)
            self._complain(at, f"{taken} exists already: move it away, name another file, or add replace: true")
        elif zones.exists():
            self._remarks.append(f"{dotted(at)}: {zones.name} stays: its zones and places will count on the new map")

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
        from artemis.mapping.map_file import MapKeys, read_image
        from artemis.sim.grid import MapGrid

        at: KeyPath = (*_WORLD, "map_file")
        document = self._yaml_file(at, name)
        if document is None:
            return None
        keys = MapKeys(document)
        self._problems += keys.problems
        image = str(PurePosixPath(name).parent / keys.image)
        content = None if keys.problems else self._file(at, image, read_image)
        if content is None:
            return None
        try:
            return MapGrid(keys.map_of(content, str(self._folder / image)))
        except ConfigError as error:
            self._problems += error.problems
            return None
