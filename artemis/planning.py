"""What a loaded mission asks for: the robot's plan, its mind, its inputs; on the robot or in simulation, how fast."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

from artemis.config import Config
from artemis.errors import ConfigError, PluginError
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.policies import policies_from
from artemis.mission.schema import Calibrate, Follow, PluginUse, Recorded, Teleop, Wait
from artemis.motion.fitting import route_for
from artemis.motion.route import Route
from artemis.plugins.border import PLUGIN_ERRORS, told
from artemis.plugins.contracts import Setup
from artemis.recording.provenance import Resumption
from artemis.robot import Core
from artemis.states.mode import CalibrateStep, FollowStep, Plan, Step, TeleopStep, WaitStep


def plan_from(loaded: LoadedMission) -> Plan:
    """The mission's steps, with their paths read and their followers made."""
    steps: list[Step] = []
    for step in loaded.mission.steps:
        action = step.action
        match action:
            case Calibrate():
                steps.append(CalibrateStep())
            case Wait():
                steps.append(WaitStep(seconds=action.seconds))
            case Teleop():
                steps.append(_teleop_step(loaded, action))
            case Follow():
                steps.append(_follow_step(loaded, action))
    policies = policies_from(loaded.mission.recovery)
    return Plan(robot=loaded.robot, steps=tuple(steps), policies=policies)


def _teleop_step(loaded: LoadedMission, action: Teleop) -> TeleopStep:
    _, config = plugin_from("artemis.inputs", loaded.mission.inputs[action.input])
    return TeleopStep(
        input=action.input,
        seconds=action.until.seconds,
        speed=getattr(config, "max_speed_m_s", None),
        record=action.record or "",
    )


def _follow_step(loaded: LoadedMission, action: Follow) -> FollowStep:
    plugin, config = plugin_from("artemis.followers", action.follower)
    route: Route | str
    backward = None if action.direction is None else action.direction == "backward"
    close_within = 0.0
    if isinstance(action.path, Recorded):
        route, close_within = action.path.recorded, action.path.close_within_m
    else:
        speed = getattr(config, "speed_m_s", loaded.robot.limits.speed_m_s)
        route, _ = route_for(loaded.files[action.path].decode(), action.path, loaded.robot, speed, **action.wanted)
    return FollowStep(
        route=route,
        follower=made(plugin, config, setup_for(loaded, action.follower.plugin)),
        laps=action.laps,
        from_end=action.from_end,
        backward=backward,
        close_within=close_within,
        round_corners=action.round_corners_m,
        allow_slowdown=action.allow_slowdown,
        nearest=action.start == "nearest",
        max_cross_track=action.max_cross_track_m,
        speed=getattr(config, "speed_m_s", None),
    )


def core_from(loaded: LoadedMission, resumption: Resumption | None = None, simulate: bool = False) -> Core:
    """The robot's mind for a mission, run with or without `--simulate`: what runs, and what a replay runs again."""
    return Core(plan_for(loaded, is_simulated(loaded, simulate), resumption), 1 / loaded.mission.tick_hz)


def plan_for(loaded: LoadedMission, simulated: bool, resumption: Resumption | None) -> Plan:
    """The mission's plan, with followers that fail where it wants that, begun where an earlier run stopped."""
    plan = plan_from(loaded)
    if simulated and loaded.mission.simulation.faults:
        from artemis.testing.injections import failing_followers

        plan.steps = failing_followers(plan.steps, loaded.mission.simulation.faults)
    if resumption is not None:
        plan.index, plan.done = resumption.step, resumption.done
        plan.start, plan.placed = resumption.pose, True
        plan.tracks = deepcopy(resumption.tracks)
    return plan


def made(plugin: Callable[[Config, Setup], Any], config: Config, setup: Setup) -> Any:  # noqa: ANN401 (of any group)
    """A new plugin of the class `plugin`.

    Raises:
        ConfigError: it refuses its configuration, or cannot be made.
    """
    try:
        return plugin(config, setup)
    except ConfigError:
        raise
    except PLUGIN_ERRORS as error:
        raise PluginError(f"PLG-01 {setup.name}: the plugin cannot be made: {told(error)}") from error


def setup_for(loaded: LoadedMission, name: str) -> Setup:
    """What a plugin of the mission may know."""
    return Setup(name=name, robot=loaded.robot, folder=loaded.folder, files=loaded.files)


def inputs_used(loaded: LoadedMission, simulated: bool) -> dict[str, PluginUse]:
    """The mission's inputs; in simulation those that have a stand-in by that."""
    return {**loaded.mission.inputs, **(loaded.mission.simulation.inputs if simulated else {})}


def is_fast(loaded: LoadedMission, simulate: bool = False) -> bool:
    """Whether a run of the mission takes place on virtual time, faster than real time."""
    if not is_simulated(loaded, simulate):
        return False
    if loaded.mission.simulation.pace is not None:
        return loaded.mission.simulation.pace == "fast"
    from artemis.plugins.registry import INPUTS, load

    used = inputs_used(loaded, simulated=True).values()
    return not any(getattr(load(INPUTS, use.plugin), "live", False) for use in used)


def is_simulated(loaded: LoadedMission, simulate: bool = False) -> bool:
    """Whether a run of this mission meets the simulated drives in process."""
    return simulate or loaded.mission.bus == "simulation"
