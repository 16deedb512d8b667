"""Loading a mission with the robot, plugins and files it names; everything wrong in any of them is found at once."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.mission.files import files_like, read_data, read_table
from artemis.mission.injector import FaultInjector, installed_injector
from artemis.mission.problems import nearest, problems_from
from artemis.mission.schema import (
    Calibrate,
    Follow,
    FollowerUse,
    InjectedFault,
    Mission,
    PluginUse,
    Recorded,
    RecoveryPolicy,
    Step,
    Supervision,
    Teleop,
)
from artemis.plugins.contracts import PluginContext, follower_speed, input_speed, is_pure
from artemis.vehicle import RobotFile
from artemis.yaml_file import Data, Document, KeyPath, read, survey

if TYPE_CHECKING:
    from artemis.motion.route import Route
    from artemis.sim.world import PlantParameters

Model = TypeVar("Model", bound=Config)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMission:
    """A mission that may run: everything it names is read and fits together."""

    mission: Mission
    robot: RobotFile
    robot_source: str
    """Name of the robot file, for messages."""
    true_robot: PlantParameters
    """How the simulated machine differs from the robot file."""
    documents: Mapping[str, Document]
    """The mission and the robot file, by their names in messages."""
    files: Mapping[str, bytes]
    """Content of every file that the mission names, by the name as written there."""
    folder: FilePath
    """Where relative names start."""
    remarks: tuple[str, ...] = ()
    """What was changed in a path so that the robot can drive it."""
    routes: Mapping[int, Route]
    """What is followed by the steps that name a path file, by the step's number from 0."""
    injector: FaultInjector | None = None
    """Makes the mission's faults happen in its simulation; None: it has none."""


def load_mission(path: FilePath) -> LoadedMission:
    """Read a mission and all that it names.

    A plugin's option `file`, or one that ends in `_file`, names a file; or an earlier run: then what its inputs gave.

    Raises:
        ConfigError: everything that is wrong in the mission, robot and path files, in the order of their lines.
    """
    return _Loading(path).result()


def load_model(path: FilePath, model: type[Model]) -> Model:
    """Read one file that stands for itself: a robot, or what is true of a simulated one.

    Raises:
        ConfigError: everything that is wrong in it, in the order of its lines.
    """
    document, problems = survey(read(path), str(path))
    found: Model | None = None
    try:
        found = model.model_validate(document.data)
    except ValidationError as error:
        problems = problems + problems_from(error, document, model)
    if problems or found is None:
        raise ConfigError(sorted(problems, key=_by_position))
    return found


def plugin_from(group: str, use: PluginUse) -> tuple[Any, Config]:
    """The class of a plugin, and its options as the class's own `Config`.

    Raises PluginError: no such plugin, or a broken one. ValidationError: the options are wrong.
    """
    from artemis.plugins.registry import load

    plugin = load(group, use.plugin)
    config: Config = plugin.Config.model_validate(use.options)
    return plugin, config


class _Loading:
    """Collects problems while it goes through the mission part by part; a wrong part does not hide the others."""

    def __init__(self, path: FilePath) -> None:
        self._folder = path.parent
        self._problems: list[str] = []
        self._documents: dict[str, Document] = {}
        self._files: dict[str, bytes] = {}
        self._remarks: list[str] = []
        self._routes: dict[int, Route] = {}
        self._plugins: dict[KeyPath, tuple[Any, Config]] = {}
        self._injector: FaultInjector | None = None
        self._document = self._survey(read(path), str(path))
        self._data = self._document.data if isinstance(self._document.data, dict) else {}
        self._robot_source = str(path)

    def result(self) -> LoadedMission:
        mission = self._validated(Mission, self._document)
        robot = self._robot()
        inputs = self._inputs()
        _ = [self._plugin("artemis.observers", "observers", name) for name in self._names("observers")]
        self._check_bus()
        true_robot = self._true_robot()
        self._check_steps(robot, inputs)
        self._check_faults(robot, inputs)
        self._check_policies()
        if robot is not None:
            self._check_inputs(robot)
        if self._problems or mission is None or robot is None or true_robot is None:
            raise ConfigError(sorted(dict.fromkeys(self._problems), key=_by_position))
        return LoadedMission(
            mission=mission,
            robot=robot,
            robot_source=self._robot_source,
            true_robot=true_robot,
            documents=self._documents,
            files=self._files,
            folder=self._folder,
            remarks=tuple(self._remarks),
            routes=self._routes,
            injector=self._injector,
        )

    # ------------------------------------------------------------------------------------------ reading and reporting

    def _survey(self, raw: bytes, source: str) -> Document:
        document, problems = survey(raw, source)
        self._problems += problems
        self._documents[source] = document
        return document

    def _complain(self, path: KeyPath, text: str) -> None:
        if path not in self._document.damaged:
            self._problems.append(self._document.problem(path, text))

    def _validated(
        self, model: type[Model], document: Document, at: KeyPath = (), data: Data | Mapping[str, object] = None
    ) -> Model | None:
        """The part of a document at `at` as `model`; what is wrong is noted."""
        try:
            return model.model_validate(document.data if data is None else data)
        except ValidationError as error:
            self._problems += problems_from(error, document, model, at)
            return None

    def _part(self, model: type[Model], *path: str | int) -> Model | None:
        """A part of the mission if it is right by itself; what is wrong with it, the whole mission's model says."""
        part: Any = self._data
        for key in path:
            part = part[key]
        try:
            return model.model_validate(part)
        except ValidationError:
            return None

    def _names(self, *path: str) -> list[str]:
        """Keys of a mapping in the mission; none where it is missing or something else."""
        part: Data = self._data
        for key in path:
            part = part.get(key) if isinstance(part, dict) else None
        return list(part) if isinstance(part, dict) else []

    def _file(self, path: KeyPath, name: str, reader: Callable[[FilePath], bytes] = read_table) -> bytes | None:
        """Content of a file that the mission names at `path`."""
        if name in self._files:
            return self._files[name]
        root = os.path.realpath(self._folder)
        if os.path.isabs(name) or os.path.commonpath([root, os.path.realpath(self._folder / name)]) != root:
            self._complain(path, f"outside the mission's folder {self._folder}: {name}; copy the file there")
            return None
        try:
            self._files[name] = reader(self._folder / name)
        except ConfigError as error:
            reason = str(error).removeprefix(f"{self._folder / name}: ")
            hint = nearest(name, files_like(self._folder, name), "files of that kind") if "not found" in reason else ""
            self._complain(path, f"{reason}: {name}{hint}")
        return self._files.get(name)

    # ------------------------------------------------------------------------------------------ the mission's parts

    def _robot(self) -> RobotFile | None:
        name = self._data.get("robot")
        raw = self._file(("robot",), name, read) if isinstance(name, str) and name else None
        if raw is None:
            return None
        self._robot_source = str(self._folder / str(name))
        try:
            document = self._survey(raw, self._robot_source)
        except ConfigError as error:
            self._problems += error.problems
            return None
        return self._validated(RobotFile, document)

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

    def _check_inputs(self, robot: RobotFile) -> None:
        """What is wrong in the files of inputs that open nothing, and in keys of which nobody has complained yet."""
        from artemis.mission.trial import trial

        for path, (plugin, config) in self._plugins.items():
            context = PluginContext(name=str(path[-1]), robot=robot, folder=self._folder, files=self._files)
            for key, problem in trial(plugin, config, context) if is_pure(plugin) else ():
                place = self._document.problem((*path, *key), "")
                if not key:
                    self._problems.append(problem)
                elif not any(known.startswith(place) for known in self._problems):
                    self._complain((*path, *key), problem)

    def _plugin(self, group: str, *path: str | int) -> Config | None:
        """Options of the plugin that the mission uses at `path`, with the files they name."""
        use = self._part(FollowerUse if group == "artemis.followers" else PluginUse, *path)
        if use is None:
            return None
        from artemis.plugins.registry import load

        try:
            plugin = load(group, use.plugin)
        except ConfigError as error:
            for problem in error.problems:
                self._complain((*path, "plugin"), problem)
            return None
        config: Config | None = self._validated(plugin.Config, self._document, path, use.options)
        for name, value in config or ():
            if isinstance(value, str) and (name == "file" or name.endswith("_file")):
                self._file((*path, name), value, read_data)
        if config is not None:
            self._plugins[path] = plugin, config
        return config

    def _check_bus(self) -> None:
        words = self._data.get("bus")
        if isinstance(words, dict) and isinstance(words.get("interface"), str):
            from artemis.devices.can_bus import check_bus_words

            for problem in check_bus_words(words):
                word, _, text = problem.partition(": ")
                self._complain(("bus", word), text)

    def _true_robot(self) -> PlantParameters | None:
        from artemis.sim.world import PlantParameters

        simulation = self._data.get("simulation")
        part = simulation.get("true_robot", {}) if isinstance(simulation, dict) else {}
        at = "simulation", "true_robot"
        return self._validated(PlantParameters, self._document, at, part) if isinstance(part, dict) else None

    def _check_faults(self, robot: RobotFile | None, inputs: Mapping[str, Config | None]) -> None:
        simulation, steps = self._data.get("simulation"), self._data.get("steps")
        given = simulation.get("faults") if isinstance(simulation, dict) else None
        if not isinstance(given, list) or not given:
            return
        self._injector = injector = installed_injector()
        if injector is None:
            self._complain(("simulation", "faults"), "the package artemis_lab makes them happen: it is not installed")
            return
        follows = isinstance(steps, list) and any(isinstance(step, dict) and "follow" in step for step in steps)
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

    # ------------------------------------------------------------------------------------------ the steps

    def _check_steps(self, robot: RobotFile | None, inputs: Mapping[str, Config | None]) -> None:
        steps = self._data.get("steps")
        given = steps if isinstance(steps, list) else []
        kinds = [next(iter(step), "") if isinstance(step, dict) else "" for step in given]
        recorded: list[str] = []
        for index, kind in enumerate(kinds):
            if kind == "follow" and "calibrate" not in kinds[:index]:
                self._complain(("steps", index, "follow"), "calibrate first: no step before this one does (CAL-02)")
            if kind == "stop" and index + 1 < len(kinds):
                self._complain(("steps", index, "stop"), "ends the mission: it can only be the last step")
            step = self._part(Step, "steps", index)
            if step is None:
                continue
            if isinstance(step.action, Teleop) and step.action.record:
                recorded.append(step.action.record)
            if isinstance(step.action, Follow):
                self._check_follow(index, step.action, robot, recorded)
            elif isinstance(step.action, Teleop):
                self._check_teleop(("steps", index, "teleop", "input"), step.action, robot, inputs)
            elif isinstance(step.action, Calibrate) and step.action.gains is not None and robot is not None:
                from artemis.mission.gains import check_gains

                for name, problem in check_gains(step.action.gains, robot):
                    self._complain(("steps", index, "calibrate", "gains", name), problem)

    def _check_follow(self, index: int, follow: Follow, robot: RobotFile | None, recorded: list[str]) -> None:
        at = ("steps", index, "follow")
        config = self._plugin("artemis.followers", *at, "follower")
        speed = follower_speed(config)
        if robot is not None:
            speed = robot.limits.speed_m_s if speed is None else speed
            self._check_speed((*at, "follower", "speed_m_s"), speed, robot)
        if isinstance(follow.path, Recorded):
            if (name := follow.path.recorded) not in recorded:
                hint = nearest(name, recorded, "recorded before") if recorded else "; no step before has `record:`"
                self._complain((*at, "path", "recorded"), f"no step before this one records {name}{hint}")
            return
        raw = self._file((*at, "path"), follow.path) if isinstance(follow.path, str) else b""
        if raw is None:
            return
        from artemis.mission.paths import drivable_route, named, route_of

        name = named(follow)
        try:
            route = route_of(follow, raw, str(self._folder / name))
        except UnicodeDecodeError as error:
            self._complain((*at, "path"), f"byte {error.start + 1} is not UTF-8: {name}")
            return
        except ConfigError as error:
            places = (self._document.problem((*at, "path"), problem) for problem in error.problems)
            self._problems += error.problems if raw else places
            return
        if follow.laps > 1 and not route.closed:
            how = "open: it must end where it begins" if len(route.parts) == 1 else "not: it reverses"
            self._complain((*at, "laps"), f"{follow.laps} laps need a closed path; {name} is {how}")
        elif robot is not None and config is not None and speed is not None:
            try:
                self._routes[index], remarks = drivable_route(follow, route, robot, speed)
                self._remarks += [f"{name}: {remark}" for remark in remarks]
            except ConfigError as error:
                for problem in error.problems:
                    self._complain((*at, "path"), f"{name}: {problem}")

    def _check_teleop(
        self, at: KeyPath, teleop: Teleop, robot: RobotFile | None, inputs: Mapping[str, Config | None]
    ) -> None:
        if teleop.input not in inputs:
            self._complain(at, f"no such input: {teleop.input}{nearest(teleop.input, inputs, 'inputs')}")
        elif robot is not None and (config := inputs[teleop.input]) is not None:
            speed = input_speed(config)
            place = at if speed is None else ("inputs", teleop.input, "max_speed_m_s")
            self._check_speed(place, robot.limits.speed_m_s if speed is None else speed, robot)

    def _check_speed(self, at: KeyPath, speed: float, robot: RobotFile) -> None:
        """Refuse a speed of the virtual front wheel that the machine cannot drive, or not stop from in time."""
        from artemis.mission.speeds import check_speed

        supervision = self._part(Supervision, "supervision") if "supervision" in self._data else Supervision()
        for problem in check_speed(speed, robot, math.inf if supervision is None else supervision.stop_distance_m):
            self._complain(at, problem)


def _by_position(problem: str) -> tuple[str, int, int]:
    place = re.match(r"(.*?):(\d+):(\d+): ", problem)
    return (place[1], int(place[2]), int(place[3])) if place else (problem, 0, 0)
