"""What a loaded mission asks for: plan, decision core and inputs; on the robot or in simulation, how fast."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import radians
from pathlib import Path as FilePath
from pathlib import PurePosixPath
from typing import Any

from msgspec.structs import replace

from artemis.axles import ByHand
from artemis.config import Config
from artemis.errors import ConfigError, PluginError
from artemis.mission.actions import Calibrate, Follow, MeasureSteering, PluginUse, Recorded, Teleop
from artemis.mission.gains import merged
from artemis.mission.goto import MOST_OFF, Goto, goto_rules
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.obstacles import rules_for
from artemis.mission.policies import policies_from
from artemis.mission.schema import SerialWords
from artemis.plugins.contracts import PluginContext, TakesTimeOnce, declared
from artemis.plugins.guard import FOLLOWER, LOCALIZER, PLUGIN_ERRORS, told
from artemis.plugins.registry import BEHAVIOURS, FOLLOWERS, INPUTS, LOCALIZERS, OBSERVERS, behaviour_class, package_of
from artemis.plugins.stated import enable_of, follower_speed, input_speed, is_live, stale_limit
from artemis.plugins.used import localizer_used
from artemis.progress import Position
from artemis.recording.provenance import ResumePoint
from artemis.robot import Core
from artemis.scan import ObstacleRules
from artemis.states.advance import states_in
from artemis.states.gains import GainsStep, TurnStep
from artemis.states.plan import (
    BehaviourStep,
    CalibrateStep,
    FollowStep,
    GotoStep,
    Plan,
    Step,
    TeleopStep,
)
from artemis.states.steering import SteeringStep
from artemis.vehicle import RobotFile
from artemis.yaml_file import dotted, survey


def plan_from(loaded: LoadedMission) -> Plan:
    """The mission's steps, with their paths read and their followers made."""
    steps: list[Step] = []
    for number, (_, step) in enumerate(loaded.tree.steps):
        if (passive := loaded.tree.passive[number]) is not None:
            steps.append(passive)
        match action := step.action:
            case Calibrate():
                steps.append(_calibrate_step(loaded.robot, action))
            case Teleop():
                steps.append(_teleop_step(loaded, action))
            case Follow():
                steps.append(_follow_step(loaded, number, action))
            case Goto():
                steps.append(_goto_step(loaded, action))
            case dict():
                steps.append(_behaviour_step(loaded, step.behaviour, action))
    policies = policies_from(loaded.mission.recovery)
    rules = rules_for(loaded.mission.obstacles, loaded.robot) or ObstacleRules()
    found = next((step.reference for step in steps if isinstance(step, SteeringStep) and step.new), None)
    return Plan(
        robot=loaded.robot,
        steps=tuple(steps),
        tree=loaded.tree.tree,
        policies=policies,
        found=found,
        obstacles=rules,
        armed=not loaded.mission.supervision.wait_for_arm,
    )


def _calibrate_step(robot: RobotFile, action: Calibrate) -> CalibrateStep:
    if action.gains is not None:
        known = {name: robot.drives[name].known_gains for name in action.gains}
        new = {name: merged(action.gains[name], gains).numbers for name, gains in known.items() if gains is not None}
        return GainsStep(gains=new)
    if action.turn is not None:
        return TurnStep(side=action.turn.side or robot.sides("steering")[0], angle=radians(action.turn.angle_deg))
    if isinstance(asked := action.steering, MeasureSteering):
        return SteeringStep(
            sides=robot.sides("steering") if asked.wheels == "both" else (asked.wheels,),
            reference={side: radians(angle) for side, angle in asked.reference_deg if angle is not None},
            save=asked.save,
            new=asked.potentiometers == "new",
        )
    return CalibrateStep()


def _teleop_step(loaded: LoadedMission, action: Teleop) -> TeleopStep:
    used = [plugin_from("artemis.inputs", loaded.mission.inputs[name]) for name in action.names]
    speeds = [input_speed(config) for _, config in used]
    held = dict.fromkeys(enable_of(plugin, config) for plugin, config in used)
    return TeleopStep(
        input=action.names[0],
        lower=action.names[1:],
        seconds=action.until.seconds,
        speed=None if None in speeds else max(speed for speed in speeds if speed is not None),
        record=action.record or "",
        obstacles=rules_for(action.obstacles or loaded.mission.obstacles, loaded.robot, by_hand=True),
        enabled_by=" or ".join(held),
        stale=tuple(stale_limit(plugin) for plugin, _ in used),
    )


def _follow_step(loaded: LoadedMission, number: int, action: Follow) -> FollowStep:
    plugin, config = plugin_from("artemis.followers", action.follower)
    recorded = action.path if isinstance(action.path, Recorded) else None
    return FollowStep(
        route=loaded.routes[number] if recorded is None else recorded.recorded,
        follower=made(plugin, config, setup_for(loaded, action.follower.plugin)),
        nearest=action.start == "nearest",
        max_cross_track=action.max_cross_track_m,
        speed=follower_speed(config),
        obstacles=None if action.obstacles is None else rules_for(action.obstacles, loaded.robot),
        laps=action.laps,
        from_end=action.from_end,
        backward=action.wanted["backward"],
    )


def _goto_step(loaded: LoadedMission, action: Goto) -> GotoStep:
    plugin, config = plugin_from(
        "artemis.followers", PluginUse(plugin=action.follower.plugin, **action.follower_options)
    )
    return GotoStep(
        route="",
        place=action.place,
        asks=action.asks,
        follower=made(plugin, config, setup_for(loaded, action.follower.plugin)),
        speed=action.speed_m_s,
        max_cross_track=MOST_OFF,
        replans=action.replans,
        obstacles=goto_rules(action, loaded.mission.obstacles, loaded.robot),
    )


def _behaviour_step(loaded: LoadedMission, name: str, options: dict[str, Any]) -> BehaviourStep:
    plugin = behaviour_class(name)
    config = plugin.Config.model_validate(options)
    return BehaviourStep(
        name=name,
        behaviour=made(plugin, config, setup_for(loaded, name)),
        declared=declared(plugin),
        speed=follower_speed(config),
    )


def core_from(loaded: LoadedMission, resume_point: ResumePoint | None = None, simulate: bool = False) -> Core:
    """The decision core for a mission, run with or without `--simulate`: what runs, and what a replay runs again."""
    return Core(plan_for(loaded, is_simulated(loaded, simulate), resume_point), 1 / loaded.mission.tick_hz)


def plan_for(loaded: LoadedMission, simulated: bool, resume_point: ResumePoint | None) -> Plan:
    """The mission's plan, with plugins that fail where it wants that, begun where an earlier run stopped."""
    plan = replace(plan_from(loaded), localized=localizer_of(loaded, simulated) is not None)
    if simulated and loaded.injector is not None:
        steps = loaded.injector.failing_plugins(plan.steps, loaded.mission.simulation.faults)
        plan = replace(plan, steps=steps)
    if resume_point is None:
        return plan
    return replace(plan, begin=resume_point.position, start=resume_point.pose, tracks=resume_point.tracks)


def unresumable(loaded: LoadedMission, position: Position) -> list[str]:
    """Why a mission cannot be resumed at a position: it is in steps whose behaviours are not resumable."""
    problems = []
    for number in dict(states_in(position)):
        path, step = loaded.tree.steps[number]
        if step.behaviour and not declared(behaviour_class(step.behaviour)).resumable:
            why = f"the run stopped in {dotted(path)}, and {step.behaviour} is not resumable"
            problems.append(f"{why}; omit --resume to start from the beginning")
    return problems


def plugin_made(group: str, use: PluginUse, context: PluginContext) -> Any:  # noqa: ANN401 (of any group)
    """The plugin that a mission uses. Raises as `made` does, and where the plugin or its configuration is wrong."""
    plugin, config = plugin_from(group, use)
    return made(plugin, config, context)


def made(plugin: Callable[[Config, PluginContext], Any], config: Config, context: PluginContext) -> Any:  # noqa: ANN401 (of any group)
    """A new plugin of the class `plugin`.

    Raises:
        ConfigError: it refuses its configuration, or cannot be made.
    """
    try:
        return plugin(config, context)
    except (ConfigError, KeyboardInterrupt):  # Ctrl-C meanwhile is the operator's wish
        raise
    except PLUGIN_ERRORS as error:
        raise PluginError(f"PLG-01 {context.name}: the plugin cannot be made: {told(error)}") from error


def setup_for(loaded: LoadedMission, name: str) -> PluginContext:
    """What a plugin of the mission may know."""
    return PluginContext(name=name, robot=loaded.robot, folder=loaded.folder, files=loaded.files)


def inputs_used(loaded: LoadedMission, simulated: bool) -> dict[str, PluginUse]:
    """The mission's inputs; in simulation those that have a stand-in by that."""
    return {**loaded.mission.inputs, **(loaded.mission.simulation.inputs if simulated else {})}


def localizer_of(loaded: LoadedMission, simulated: bool) -> PluginUse | None:
    """The localizer of a run of the mission; None: it has none."""
    mission = loaded.mission
    words = {"localizer": mission.localizer, "simulation": {"localizer": mission.simulation.localizer}}
    use: PluginUse | None = localizer_used(words, simulated=simulated)
    return use


def files_named(use: PluginUse, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Those of the mission's files that the keys of a plugin name, and the image of a map among them."""
    keys = use.model_extra or {}
    names = [name for name in keys.values() if isinstance(name, str) and name in files]
    if (name := keys.get("map")) in names and isinstance(content := survey(files[name], name)[0].data, dict):
        names.append(str(PurePosixPath(name).parent / str(content.get("image"))))
    return {name: files[name] for name in names if name in files}


def origin_of(loaded: LoadedMission, simulated: bool, name: str) -> str:
    """Which plugin, of which package, a run asks by a name of its mission, for people."""
    asked = [(name, INPUTS, use.plugin) for name, use in inputs_used(loaded, simulated).items()]
    asked += [(name, OBSERVERS, use.plugin) for name, use in loaded.mission.observers.items()]
    if (use := localizer_of(loaded, simulated)) is not None:
        asked.append((LOCALIZER, LOCALIZERS, use.plugin))
    for _, step in loaded.tree.steps:
        if step.behaviour:
            asked.append((step.behaviour, BEHAVIOURS, step.behaviour))
        elif isinstance(step.action, Follow | Goto):
            asked.append((FOLLOWER, FOLLOWERS, step.action.follower.plugin))
    found = {f"{plugin} of {package_of(group, plugin)}" for given, group, plugin in asked if given == name}
    return " or ".join(sorted(found))


def scanners_used(loaded: LoadedMission, simulated: bool) -> dict[str, PluginUse]:
    """The robot's scanners; in simulation those that have a stand-in by that."""
    named = {name: PluginUse(plugin=mount.plugin, **mount.options) for name, mount in loaded.robot.scanners.items()}
    return {**named, **(loaded.mission.simulation.scanners if simulated else {})}


def is_fast(loaded: LoadedMission, simulate: bool = False) -> bool:
    """Whether a run of the mission takes place on virtual time, faster than real time."""
    if not is_simulated(loaded, simulate):
        return False
    if loaded.mission.simulation.pace is not None:
        return loaded.mission.simulation.pace == "fast"
    acts = loaded.mission.simulation.operator
    if asks(loaded) and not any(act.answer is not None for act in acts):
        return False
    if straight_by_hand(loaded) and not any(act.do == "accept" for act in acts):
        return False
    from artemis.plugins.registry import INPUTS, LOCALIZERS, OBSERVERS, SCANNERS, load

    used = [load(INPUTS, use.plugin) for use in inputs_used(loaded, simulated=True).values()]
    if (localizer := localizer_of(loaded, simulated=True)) is not None:
        used.append(load(LOCALIZERS, localizer.plugin))
    used += [load(SCANNERS, use.plugin) for use in scanners_used(loaded, simulated=True).values()]
    used += [load(OBSERVERS, use.plugin) for use in loaded.mission.observers.values()]
    return not any(is_live(plugin) for plugin in used)


def preparations(loaded: LoadedMission, simulated: bool) -> list[Callable[[], None]]:
    """What takes long the first time, and is therefore done before the robot is touched."""
    from artemis.plugins.registry import LOCALIZERS, load

    found: list[Callable[[], None]] = []
    if loaded.mission.mapping is not None:
        from artemis.localisation.warming import warm_up

        found.append(warm_up)
    if (use := localizer_of(loaded, simulated)) is not None:
        plugin: object = load(LOCALIZERS, use.plugin)
        found += [plugin.prepare] if isinstance(plugin, TakesTimeOnce) else []
    return found


def straight_by_hand(loaded: LoadedMission) -> bool:
    """Whether a person sets the wheels straight whenever the drives are brought up."""
    return isinstance(loaded.robot.angle_source("left"), ByHand)


def asks(loaded: LoadedMission) -> bool:
    """Whether the mission asks a person."""
    return any(step.ask is not None for _, step in loaded.tree.steps)


def check_drivable(loaded: LoadedMission, source: FilePath, simulated: bool) -> None:
    """Nothing is driven over a serial line (decision 16).

    Raises:
        ConfigError: the mission `source` names one, and its drives are real.
    """
    if isinstance(loaded.mission.bus, SerialWords) and not simulated:
        why = (
            "nothing is driven over a serial line: an EPOS cannot watch the computer over it, so a wheel would turn on "
            "without end when that fails"
        )
        use = "over it `artemis devices`, `configure` and `calibrate` read and write drives; drive over CAN"
        raise ConfigError(loaded.documents[str(source)].problem(("bus",), f"{why}; {use}, or --simulate"))


def is_simulated(loaded: LoadedMission, simulate: bool = False) -> bool:
    """Whether a run of this mission meets the simulated drives in process."""
    return simulate or loaded.mission.bus == "simulation"
