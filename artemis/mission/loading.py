"""Loading a mission with the robot, plugins and files it names; everything wrong in any of them is found at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, degrees
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from artemis.axles import ByHand, HardStop
from artemis.bridges.places import clashing
from artemis.bridges.poses import INITIAL_POSE
from artemis.config import Config
from artemis.drive_schema import serial_problem
from artemis.errors import ConfigError
from artemis.families.objects import FOLLOWING_ERROR
from artemis.mission.actions import PluginUse
from artemis.mission.injector import FaultInjector, installed_injector
from artemis.mission.obstacles import Obstacles
from artemis.mission.problems import Model, by_position, checked, nearest, problems_from
from artemis.mission.reading import Configs
from artemis.mission.schema import SLOWEST, InjectedFault, Mission, RecoveryPolicy
from artemis.mission.starts import far_starts, start_pose
from artemis.mission.surroundings import SurroundingsChecks
from artemis.plugins.contracts import PluginContext, TakesInitialPose
from artemis.plugins.stated import allowed, is_pure
from artemis.progress import OWN_STEPS
from artemis.states.homing import lag_of_search
from artemis.states.outcomes import FOLLOWING
from artemis.states.outline import steps_in
from artemis.vehicle import RobotFile
from artemis.yaml_file import Data, Document, KeyPath, read, survey

if TYPE_CHECKING:
    from artemis.mission.tree import MissionTree
    from artemis.motion.route import Route
    from artemis.route_planning.floor import Destination
    from artemis.sim.grid import MapGrid
    from artemis.sim.scenery import Scenery
    from artemis.sim.world import PlantParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMission:
    """A mission that may run: everything it names is read and fits together."""

    mission: Mission
    robot: RobotFile
    robot_source: str
    """Name of the robot file, for messages."""
    true_robot: PlantParameters
    """How the simulated machine differs from the robot file."""
    scenery: Scenery | None = None
    """What the simulated scanners see; None: a hall."""
    grid: MapGrid | None = None
    """The map of that."""
    documents: Mapping[str, Document]
    """The mission and the robot file, by their names in messages."""
    files: Mapping[str, bytes]
    """Content of every file that the mission names, by the name as written there."""
    folder: FilePath
    """Where relative names start."""
    ignored: tuple[str, ...] = ()
    """Where the robot may touch what its scanners could see, in words."""
    remarks: tuple[str, ...] = ()
    """That, and what was changed in a path so that the robot can drive it."""
    routes: Mapping[int, Route]
    """What is followed by the steps that name a path file, by the step's number."""
    destinations: Mapping[int, Destination]
    """Where each `goto` leads, by the step's number."""
    tree: MissionTree
    """How its words compose its steps."""
    injector: FaultInjector | None = None
    """Makes the mission's faults happen in its simulation; None: it has none."""


def load_mission(
    path: FilePath, simulate: bool = False, *, tried: bool = True, page: Mapping[str, Any] | None = None
) -> LoadedMission:
    """Read a mission and all that it names.

    A plugin's option `file`, or one that ends in `_file`, names a file; or an earlier run: then what its inputs gave.

    Args:
        path: its file.
        simulate: to run it against simulated drives, whatever bus it names.
        tried: Plugins that open nothing are made, as they may have more to say. For a replay they are not: what they
            need may not be installed.
        page: Add a page for operators, with these keys of its observer; None: as the mission says.

    Raises:
        ConfigError: everything that is wrong in the mission, robot and path files, in the order of their lines.
    """
    return _Loading(path, simulate, page).result(tried)


def load_model(path: FilePath, model: type[Model]) -> Model:
    """Read one file that stands for itself: a robot, or what is true of a simulated one.

    Raises:
        ConfigError: everything that is wrong in it, in the order of its lines.
    """
    return model_of(read(path), str(path), model)


def model_of(raw: bytes, source: str, model: type[Model]) -> Model:
    """The content of such a file, named `source` in errors.

    Raises:
        ConfigError: everything that is wrong in it, in the order of its lines.
    """
    document, problems = survey(raw, source)
    found: Model | None = None
    try:
        found = model.model_validate(document.data)
    except ValidationError as error:
        problems = problems + problems_from(error, document, model)
    if problems or found is None:
        raise ConfigError(sorted(problems, key=by_position))
    return found


def plugin_from(group: str, use: PluginUse) -> tuple[Any, Config]:
    """The class of a plugin, and its options as the class's own `Config`.

    Raises PluginError: no such plugin, or a broken one. ConfigError: the options are wrong.
    """
    from artemis.plugins.registry import load

    plugin = load(group, use.plugin)
    config: Config = checked(plugin.Config, use.options, use.plugin)
    return plugin, config


class _Loading(SurroundingsChecks):
    """Goes through the mission part by part."""

    def result(self, tried: bool) -> LoadedMission:
        mission = self._validated(Mission, self._document)
        robot = self._robot()
        if robot is not None:
            self._check_drives(robot)
        inputs = self._inputs()
        _ = [self._plugin("artemis.observers", "observers", name) for name in self._names("observers")]
        self._check_bus(robot)
        if robot is not None and isinstance(robot.angle_source("left"), ByHand):
            self._check_acceptance()
        true_robot = self._true_robot()
        if "obstacles" in self._data:
            self._check_obstacles((), self._part(Obstacles, "obstacles"), robot)
        self._check_scanners(robot)
        self._check_loads(robot)
        self._check_supply(robot)
        if "mapping" in self._data:
            self._check_mapping(robot)
        scenery, grid = self._scenery()
        self._check_steps(robot, inputs)
        self._check_answers()
        self._check_view(robot)
        self._check_initial_poses(inputs)
        self._check_faults(robot, inputs)
        self._check_policies()
        if robot is not None and tried:
            self._check_inputs(robot, mission)
        if tried:
            self._check_record(self._data.get("record"))
        if self._problems or mission is None or robot is None or true_robot is None:
            raise ConfigError(sorted(dict.fromkeys(self._problems), key=by_position))
        from artemis.mission.tree import mission_tree

        pose = start_pose(self._data, true_robot, simulated=self._simulated)
        starts = far_starts(self._data["steps"], self._routes, pose)
        return LoadedMission(
            mission=mission,
            robot=robot,
            robot_source=self._robot_source,
            true_robot=true_robot,
            scenery=scenery,
            grid=grid,
            documents=self._documents,
            files=self._files,
            folder=self._folder,
            ignored=tuple(self._ignored),
            remarks=(*self._ignored, *self._remarks, *self._checks.remarks, *starts),
            routes=self._routes,
            destinations=self._destinations,
            tree=mission_tree(mission, self._checks),
            injector=self._injector,
        )

    # ------------------------------------------------------------------------------------------ the mission's parts

    def _robot(self) -> RobotFile | None:
        document = self._yaml_file(("robot",), self._data.get("robot"))
        if document is None:
            return None
        self._robot_source = document.source
        return self._validated(RobotFile, document)

    def _check_record(self, name: Data) -> None:
        """The folder of the runs is there, or can be made: no file stands in its place."""
        if not isinstance(name, str):
            return
        folder = self._folder / name
        there = next(place for place in (folder, *folder.parents) if place.exists())
        if not there.is_dir():
            self._complain(("record",), f"is a file, expected a folder: {there}")

    def _check_drives(self, robot: RobotFile) -> None:
        """Drives that interpolate are given the period of set-points in whole ms."""
        interpolating = [name for name, drive in robot.drives.items() if drive.interpolates]
        tick_hz = self._data.get("tick_hz")
        if interpolating and isinstance(tick_hz, int) and tick_hz > 0 and 1000 % tick_hz:
            rates = ", ".join(str(rate) for rate in range(25, 201) if not 1000 % rate)
            period = f"a period of {1000 / tick_hz:.3g} ms"
            text = f"{period}; {interpolating[0]} interpolates over whole milliseconds: expected one of {rates}"
            self._complain(("tick_hz",), text)
        if isinstance(source := robot.angle_source("left"), HardStop):
            tick_hz = self._data.get("tick_hz", Mission.model_fields["tick_hz"].default)
            if isinstance(tick_hz, int) and tick_hz >= SLOWEST:
                self._check_search(robot, source, tick_hz)

    def _check_search(self, robot: RobotFile, source: HardStop, tick_hz: int) -> None:
        """A drive lets its motor lag as far as the search for a hard stop has it held."""
        name, drive = robot.drive_at("steering", "left")
        degree = drive.counts_per_wheel_turn / 360.0 / source.scale
        needed = ceil(degrees(lag_of_search(1.0 / tick_hz)) * degree)
        if drive.lag_counts < needed and any(object == FOLLOWING_ERROR for object, _ in drive.tables.configuration):
            text = (
                f"{drive.lag_counts} counts are {drive.lag_counts / degree:.3g} degrees: the search for the hard stop"
            )
            text += f" holds the motor until it is {needed / degree:.3g} degrees behind, at {tick_hz} ticks a second:"
            place = ("drives", name, "following_error_counts")
            text = f"{text} expected at least {needed}, or leave it out"
            self._problems.append(self._documents[self._robot_source].problem(place, text))

    def _inputs(self) -> dict[str, Config | None]:
        """Options of the mission's inputs by name; None where they are wrong."""
        inputs = {name: self._plugin("artemis.inputs", "inputs", name) for name in self._names("inputs")}
        for name in self._names("simulation", "inputs"):
            self._plugin("artemis.inputs", "simulation", "inputs", name)
            if name not in inputs:
                self._complain(("simulation", "inputs", name), f"no such input{nearest(name, inputs, 'inputs')}")
        for at in ((), ("simulation",)):
            if "localizer" in self._names(*at):
                self._plugin("artemis.localizers", *at, "localizer")
        return inputs

    def _check_inputs(self, robot: RobotFile, mission: Mission | None) -> None:
        """What is wrong in the files of plugins that open nothing, and in keys without a problem so far."""
        from artemis.mission.trial import trial

        for at, problem in clashing(self._plugins):
            self._complain(at, problem)
        words = b"" if mission is None else mission.model_dump_json(by_alias=True).encode()
        base = PluginContext(name="", robot=robot, folder=self._folder, files=self._files, mission=words)
        for path, (plugin, config) in self._plugins.items():
            context = replace(base, name=str(path[-1]))
            for key, problem in trial(plugin, config, context) if is_pure(plugin) else ():
                place = self._document.problem((*path, *key), "")
                if not key:
                    self._problems.append(problem)
                elif not any(known.startswith(place) for known in self._problems):
                    self._complain((*path, *key), problem)

    def _check_initial_poses(self, inputs: Configs) -> None:
        """Whether a localizer takes those that inputs give."""
        localizers = [self._plugins[at] for at in (("localizer",), ("simulation", "localizer")) if at in self._plugins]
        if any(isinstance(plugin, TakesInitialPose) for plugin, _ in localizers):
            return
        for name, config in inputs.items():
            if INITIAL_POSE in allowed(config):
                what = "the mission's localizer takes none" if localizers else "the mission has no localizer"
                self._complain(("inputs", name, "allow"), f"{INITIAL_POSE}: {what}")

    def _check_bus(self, robot: RobotFile | None) -> None:
        words = self._data.get("bus")
        if not isinstance(words, dict):
            return
        if "serial" in words:
            protocol = words.get("protocol", "epos1")
            if robot is not None and (problem := serial_problem(robot.drives, protocol, "protocol:")):
                self._complain(("bus", "protocol") if "protocol" in words else ("bus",), problem)
        elif isinstance(words.get("interface"), str):
            from artemis.devices.can_bus import check_bus_words

            for problem in check_bus_words(words):
                word, _, text = problem.partition(": ")
                self._complain(("bus", word), text)

    def _check_acceptance(self) -> None:
        """Somebody has to accept that the wheels stand straight; a simulated run may have nobody."""
        simulation = self._data.get("simulation")
        acts = simulation.get("operator") if isinstance(simulation, dict) else None
        accepts = isinstance(acts, list) and any(isinstance(act, dict) and act.get("do") == "accept" for act in acts)
        if self._simulated and not accepts:
            self._remarks.append(
                "simulation.operator: only a person can accept that the wheels stand straight (`angle: by_hand`); for "
                "a run without one, write an act such as {at_s: 4.0, do: accept}"
            )

    def _true_robot(self) -> PlantParameters | None:
        from artemis.sim.world import PlantParameters

        simulation = self._data.get("simulation")
        part = simulation.get("true_robot", {}) if isinstance(simulation, dict) else {}
        at = "simulation", "true_robot"
        return self._validated(PlantParameters, self._document, at, part) if isinstance(part, dict) else None

    def _check_faults(self, robot: RobotFile | None, inputs: Configs) -> None:
        simulation, steps = self._data.get("simulation"), self._data.get("steps")
        given = simulation.get("faults") if isinstance(simulation, dict) else None
        if not isinstance(given, list) or not given:
            return
        self._injector = injector = installed_injector()
        if injector is None:
            self._complain(("simulation", "faults"), "the package artemis_lab makes them happen: it is not installed")
            return
        follows = any(word in FOLLOWING or word not in OWN_STEPS for _, word, _ in steps_in(steps))
        for index in range(len(given)):
            at: KeyPath = ("simulation", "faults", index)
            if (fault := self._part(InjectedFault, *at)) is None:
                continue
            for key, problem in injector.problems(fault, robot, inputs, follows):
                self._complain((*at, key), problem)
            if (parameters := injector.parameters(fault.inject)) is not None:
                self._validated(parameters, self._document, at, fault.options)

    def _check_policies(self) -> None:
        names = self._names("recovery")
        if not names:
            return
        from artemis.mission.policies import check_policy

        for id in names:
            said = self._part(RecoveryPolicy, "recovery", id)
            for key, problem in check_policy(id, said) if said is not None else ():
                self._complain(("recovery", id, key) if key else ("recovery", id), problem)
