"""The steps of a mission, one by one, and how its words compose them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from artemis.axles import ByHand
from artemis.errors import ConfigError
from artemis.mission.actions import Calibrate, Follow, MeasureSteering, Recorded, Teleop
from artemis.mission.goto import Goto
from artemis.mission.goto_checks import GotoChecks
from artemis.mission.obstacles import Obstacles, check_obstacles, ignored
from artemis.mission.order import CALIBRATED, TIME, Facts, why_not
from artemis.mission.problems import nearest
from artemis.mission.reading import Configs
from artemis.mission.schema import Supervision
from artemis.mission.word_checks import WordChecks
from artemis.mission.words import Step
from artemis.plugins.contracts import declared
from artemis.plugins.registry import behaviour_class, declarations
from artemis.plugins.stated import STALE, follower_speed, input_speed, rounds_corners, stale_limit
from artemis.states.answers import given_answer
from artemis.states.outcomes import step_facts
from artemis.states.outline import behaviours_in, keys_of, numbered, parts_of, steps_in
from artemis.vehicle import RobotFile
from artemis.yaml_file import KeyPath, dotted

NO_RECORD = "; no step before has `record:`"


class StepChecks(GotoChecks):
    """Notes what is wrong in the steps."""

    def __init__(self, path: Path, simulate: bool = False, page: Mapping[str, Any] | None = None) -> None:
        super().__init__(path, simulate, page)
        self._stops_for_obstacles = False
        """In one of them, at least."""
        self._ignored: list[str] = []
        """Where the robot may touch obstacles."""

    def _check_obstacles(self, at: KeyPath, obstacles: Obstacles | None, robot: RobotFile | None) -> None:
        if obstacles is not None and robot is not None:
            for problem in check_obstacles(obstacles, robot, simulated=self._simulated):
                self._complain((*at, "obstacles"), problem)
            if (words := ignored(obstacles, robot)) is not None:
                self._ignored.append(f"{dotted((*at, 'obstacles'))}: {words}")

    def _check_steps(self, robot: RobotFile | None, inputs: Configs) -> None:
        steps = self._data.get("steps")
        given = steps if isinstance(steps, list) else []
        facts = step_facts(declarations(behaviours_in(given)), robot)
        wrong = [*self._wrong, *self._document.damaged]
        self._checks = WordChecks(given, self._names("inputs"), facts, wrong)
        for path, problem in self._checks.problems:
            self._complain(path, problem)
        timed, every = numbered(given), list(steps_in(given))
        if every and not timed and not self._checks.order.unread:
            self._complain(("steps",), "no step takes time, so there is nothing to do; add one, such as wait")
        before = self._checks.order.before
        for path, word, _ in every:
            if facts.follows(word) and CALIBRATED not in before.get(path, [CALIBRATED]):
                why = why_not(given, CALIBRATED, path) or "no step before this one does"
                self._complain(path, f"calibrate first: {why}")
            if word == "stop" and path != ("steps", len(given) - 1, "stop"):
                self._complain(path, "ends the mission: it can only be the last step")
        usual = self._part(Obstacles, "obstacles") if "obstacles" in self._data else Obstacles()
        alone = len(every) == 1
        for number, (path, word, _) in enumerate(timed):
            step = self._part(Step, *path[:-1])
            if step is None:
                continue
            own = step.action.obstacles if isinstance(step.action, Follow | Goto | Teleop) else None
            self._check_obstacles(path, own, robot)
            rules = own or usual
            if (word == "teleop" or facts.follows(word)) and rules is not None and rules.mode == "stop":
                self._stops_for_obstacles = True
            if isinstance(step.action, Follow) and isinstance(step.action.path, Recorded) and path in before:
                self._check_recorded(path, step.action.path.recorded, before[path], given)
            self._check_step(number, path, step, robot, inputs, alone=alone)

    def _check_answers(self) -> None:
        """Those of the simulation's operator, to questions of the mission."""
        asked = self._checks.signals.get("answer")
        for index, act in enumerate(parts_of(keys_of(self._data.get("simulation")).get("operator"))):
            answer, at = keys_of(act).get("answer"), ("simulation", "operator", index, "answer")
            if not isinstance(answer, str):
                continue
            if asked is None:
                self._complain(at, "no step of the mission asks a question: it needs `ask`")
            elif asked.values and not given_answer(answer, asked.values):
                hint = nearest(answer, asked.values, "answers")
                self._complain(at, f"no question of the mission has this answer{hint}")

    def _check_step(
        self, number: int, at: KeyPath, step: Step, robot: RobotFile | None, inputs: Configs, *, alone: bool
    ) -> None:
        """What is wrong in a step that takes time; `alone`: it is the only one."""
        match step.action:
            case Follow():
                self._check_follow(number, at, step.action, robot)
            case Goto(speed_m_s=speed):
                self._check_goto(number, at, step.action, robot, inputs)
                if robot is not None:
                    self._check_speed((*at, "speed_m_s"), speed, robot)
            case Teleop():
                self._check_teleop(at, step.action, robot, inputs)
            case Calibrate():
                self._check_calibrate(at, step.action, robot, alone=alone)
            case dict():
                self._check_behaviour(at, step, robot)

    def _check_calibrate(self, at: KeyPath, step: Calibrate, robot: RobotFile | None, *, alone: bool) -> None:
        if isinstance(step.steering, MeasureSteering) and not alone:
            if step.steering.potentiometers == "new":
                problem = "new potentiometers are calibrated in a mission of their own, without other steps"
                self._complain(("steps",), problem)
            if step.steering.save != "nothing":
                problem = "what is saved holds from the next start on: no other step may stand beside a calibration "
                self._complain(("steps",), problem + "with save: drives or ask")
        if robot is not None:
            if step.steering not in (None, "align") and not robot.has_potentiometers:
                self._check_zero(at, step.steering, robot)
            for key, side in step.sides:
                if side not in robot.sides("steering"):
                    problem = f"the robot's steering motors are: {', '.join(robot.sides('steering'))}; found {side}"
                    self._complain((*at, *key), problem)
        if step.gains is not None and robot is not None:
            from artemis.mission.gains import check_gains

            for name, problem in check_gains(step.gains, robot):
                self._complain((*at, "gains", name), problem)

    def _check_zero(self, at: KeyPath, asked: object, robot: RobotFile) -> None:
        """What of a robot without potentiometers is to be measured."""
        if not isinstance(asked, MeasureSteering) or asked.potentiometers == "new":
            self._complain((*at, "steering"), "the robot has no potentiometers: write `align`")
        elif isinstance(robot.angle_source("left"), ByHand):
            problem = "a person sets the wheels straight at each start: there is nothing to measure"
            self._complain((*at, "steering"), problem)

    def _check_recorded(self, at: KeyPath, name: str, before: Facts, steps: list[Any]) -> None:
        if name in before:
            return
        hint, names = why_not(steps, name, at), before - {CALIBRATED, TIME}
        hint = f": {hint}" if hint else nearest(name, names, "recorded before") if names else NO_RECORD
        self._complain((*at, "path", "recorded"), f"no step before this one records {name}{hint}")

    def _check_follow(self, number: int, at: KeyPath, follow: Follow, robot: RobotFile | None) -> None:
        config = self._plugin("artemis.followers", *at, "follower")
        speed = follower_speed(config)
        if robot is not None:
            speed = robot.limits.speed_m_s if speed is None else speed
            self._check_speed((*at, "follower", "speed_m_s"), speed, robot)
        if isinstance(follow.path, Recorded):
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
            self._problems += error.problems if isinstance(follow.path, str) else places
            return
        if follow.laps > 1 and not route.closed:
            how = "open: it must end where it begins" if len(route.parts) == 1 else "not: it reverses"
            self._complain((*at, "laps"), f"{follow.laps} laps need a closed path; {name} is {how}")
        elif robot is not None and config is not None and speed is not None:
            try:
                reserve = rounds_corners(self._plugins[*at, "follower"][0])
                self._routes[number], remarks = drivable_route(follow, route, robot, speed, reserve=reserve)
                self._remarks += [f"{name}: {remark}" for remark in remarks]
            except ConfigError as error:
                for problem in error.problems:
                    self._complain((*at, "path"), f"{name}: {problem}")

    def _check_teleop(self, at: KeyPath, teleop: Teleop, robot: RobotFile | None, inputs: Configs) -> None:
        for number, name in enumerate(teleop.names):
            here: KeyPath = (*at, "input") if teleop.inputs is None else (*at, "inputs", number)
            if name not in inputs:
                self._complain(here, f"no such input: {name}{nearest(name, inputs, 'inputs')}")
            elif robot is not None and (config := inputs[name]) is not None:
                speed = input_speed(config)
                place = here if speed is None else ("inputs", name, "max_speed_m_s")
                plugin, _ = self._plugins["inputs", name]
                top = robot.limits.speed_m_s if speed is None else speed
                self._check_speed(place, top, robot, stale_limit(plugin) - STALE)
        if teleop.inputs is not None:
            from artemis.mission.trial import shared_devices

            for problem in shared_devices(teleop.inputs, self._plugins, self._files):
                self._complain((*at, "inputs"), problem)

    def _check_behaviour(self, at: KeyPath, step: Step, robot: RobotFile | None) -> None:
        try:
            plugin = behaviour_class(step.behaviour)
        except ConfigError as error:
            for problem in error.problems:
                self._complain(at, problem)
            return
        config = self._options(plugin, at, step.action)
        speed = follower_speed(config)
        if robot is not None and config is not None and declared(plugin).moves:
            place = at if speed is None else (*at, "speed_m_s")
            self._check_speed(place, robot.limits.speed_m_s if speed is None else speed, robot)

    def _check_speed(self, at: KeyPath, speed: float, robot: RobotFile, later: float = 0.0) -> None:
        """Refuse a speed of the virtual front wheel that the machine cannot drive, or not stop from in time.

        A loss is noticed so much `later` [s] than that of a device on this computer.
        """
        from artemis.mission.speeds import check_speed

        supervision = self._part(Supervision, "supervision") if "supervision" in self._data else Supervision()
        distance = math.inf if supervision is None else supervision.stop_distance_m
        for problem in check_speed(speed, robot, distance, later):
            self._complain(at, problem)
