"""The composition root: a loaded mission becomes parts, and parts a run. Only here real or simulated is picked."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from artemis import clock
from artemis.devices.can_bus import CanBus, FrameBus
from artemis.devices.drive import Drives
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.policies import policies_from
from artemis.mission.schema import BusWords, Calibrate, Follow, PluginUse, Teleop, Wait
from artemis.motion.path import Path, path_from_csv
from artemis.motion.poses import seen_from
from artemis.plugins.border import Border
from artemis.plugins.contracts import InputDevice, Setup
from artemis.recording.journal import Journal
from artemis.recording.mcap_writer import Provenance, Recorder
from artemis.recording.run_folder import RunFolder, create_run_folder
from artemis.robot import Core, Robot
from artemis.states.mode import CalibrateStep, FollowStep, Plan, Step, TeleopStep, WaitStep
from artemis.values import Pose, Request, Tick

if TYPE_CHECKING:
    from artemis.sim.bus import Surroundings
    from artemis.sim.world import World

OPERATOR_GRACE = 5.0
"""A scripted operator counts as present until this long after its last act [s]."""
REQUESTS = {
    "quickstop": Request.QUICKSTOP,
    "acknowledge": Request.ACKNOWLEDGE,
    "arm": Request.ARM,
    "end": Request.END,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a run ended."""

    failed: bool
    """Stopped before its last step was done."""
    interrupted: int | None
    """The signal that ended it."""
    run: RunFolder
    duration: float
    """Run time [s]."""
    elapsed: float
    """Seconds on the wall."""

    @property
    def exit_status(self) -> int:
        """0 done, 1 failed or stopped, 128 + signal when interrupted."""
        if self.interrupted is not None:
            return 128 + self.interrupted
        return int(self.failed)


Operator = Callable[[Callable[[Request], None]], Callable[[], None]]
"""Given where requests go, begins to listen to somebody at a terminal; returns how to stop."""


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
                steps.append(TeleopStep(input=action.input, seconds=action.until.seconds))
            case Follow():
                text = loaded.files[action.path].decode()
                path = path_from_csv(text, action.path).with_laps(action.laps)
                plugin, config = plugin_from("artemis.followers", action.follower)
                follower = plugin(config, _setup(loaded, action.follower.plugin))
                steps.append(FollowStep(path=path, follower=follower, max_cross_track=action.max_cross_track_m))
    policies = policies_from(loaded.mission.recovery)
    return Plan(robot=loaded.robot, steps=tuple(steps), policies=policies)


def core_from(loaded: LoadedMission) -> Core:
    """The robot's mind for a mission: what runs, and what a replay runs again."""
    plan = plan_from(loaded)
    if is_simulated(loaded):
        _let_followers_fail(plan, loaded)
    return Core(plan, 1 / loaded.mission.tick_hz)


def _let_followers_fail(plan: Plan, loaded: LoadedMission) -> None:
    if loaded.mission.simulation.faults:
        from artemis.testing.injections import failing_followers

        plan.steps = failing_followers(plan.steps, loaded.mission.simulation.faults)


def _setup(loaded: LoadedMission, name: str) -> Setup:
    return Setup(name=name, robot=loaded.robot, folder=loaded.folder, files=loaded.files)


def _inputs(loaded: LoadedMission, simulated: bool) -> dict[str, InputDevice]:
    uses: dict[str, PluginUse] = dict(loaded.mission.inputs)
    if simulated:
        uses.update(loaded.mission.simulation.inputs)
    devices: dict[str, InputDevice] = {}
    for name, use in uses.items():
        plugin, config = plugin_from("artemis.inputs", use)
        devices[name] = plugin(config, _setup(loaded, name))
    return devices


class _Truth:
    """Where the simulated robot really is, in the frame `odom`: its origin is the true pose where that was reset."""

    def __init__(self, world: World | None) -> None:
        self._world = world
        self._origin = Pose()

    def pose(self, tick: Tick) -> Pose | None:
        if self._world is None:
            return None
        if tick.wish.reset_pose:
            self._origin = self._world.pose
        return seen_from(self._origin, self._world.pose)


class _Run:
    """Everything that exists for one run."""

    def __init__(
        self,
        loaded: LoadedMission,
        source: FilePath,
        simulated: bool,
        watch: Callable[[Tick], None],
        operator: Operator | None,
        witness: Callable[[World], Surroundings],
    ) -> None:
        mission = loaded.mission
        self._loaded, self._watch, self._operator, self._witness = loaded, watch, operator, witness
        self._plan = plan_from(loaded)
        if simulated:
            _let_followers_fail(self._plan, loaded)
        self._simulated = simulated
        self._virtual = simulated and mission.simulation.pace == "fast"
        self._last_act = max((act.at_s for act in mission.simulation.operator), default=-OPERATOR_GRACE)
        start = clock.wall_date()
        files = {**loaded.files, source.name: source.read_bytes()}
        self.run = create_run_folder(loaded.folder / mission.record, mission.mission, start, files)
        provenance = Provenance(
            start=start,
            mission=mission.model_dump_json().encode(),
            robot=loaded.robot.model_dump_json().encode(),
            files=files,
        )
        journal = Journal(self.run.journal)
        self._recorder = Recorder(self.run.recording, provenance, threaded=not self._virtual, journal=journal)
        self._interrupted: int | None = None
        self._time = 0.0

    def go(self) -> Outcome:
        """Run to the end."""
        begun = clock.stopwatch()
        problem = "did not end in order"
        try:
            clock.run(self._main(), simulated=self._virtual)
            problem = "failed" if self._plan.failed else "done"
        finally:
            self._recorder.close(problem)
        return Outcome(
            failed=self._plan.failed,
            interrupted=self._interrupted,
            run=self.run,
            duration=self._time,
            elapsed=clock.stopwatch() - begun,
        )

    async def _main(self) -> None:
        loop = asyncio.get_running_loop()
        bus, world = self._open_bus(loop)
        inputs = _inputs(self._loaded, self._simulated)
        border = Border(inputs, loop.time)
        self._plan.steps = tuple(
            replace(step, follower=border.watched(step.follower)) if isinstance(step, FollowStep) else step
            for step in self._plan.steps
        )
        drives = Drives(self._loaded.robot, bus)
        truth = _Truth(world)

        def observe(tick: Tick) -> None:
            self._time = tick.snapshot.time
            self._recorder.observe(tick, drives.wire.take_traffic(loop.time()), truth.pose(tick))
            self._watch(tick)

        period = 1 / self._loaded.mission.tick_hz
        core = Core(self._plan, period)
        robot = Robot(core, drives, border, period, observe, self._attended)
        if world is not None and self._loaded.mission.simulation.faults:
            self._let_fail(loop, bus, world, inputs, robot)
        stop_listening = self._listen(loop, robot)
        try:
            self._show_paths()
            await robot.run()
        finally:
            stop_listening()
            for device in inputs.values():
                device.close()
            bus.close()

    def _open_bus(self, loop: asyncio.AbstractEventLoop) -> tuple[FrameBus, World | None]:
        mission, robot = self._loaded.mission, self._loaded.robot
        if isinstance(mission.bus, BusWords) and not self._simulated:
            return CanBus(mission.bus.words), None
        from artemis.sim.bus import SimBus
        from artemis.sim.world import World

        seed = mission.simulation.seed
        world = World(robot, self._loaded.true_robot, seed=seed, start=loop.time())
        bus = SimBus(self._witness(world), robot.bitrate, loop)
        if not mission.simulation.faults:
            return bus, world
        from artemis.testing.fault_bus import FaultBus

        return FaultBus(bus, seed=seed), world

    def _let_fail(
        self,
        loop: asyncio.AbstractEventLoop,
        bus: FrameBus,
        world: World,
        inputs: dict[str, InputDevice],
        robot: Robot,
    ) -> None:
        """Schedule what the mission wants to go wrong, and write it to the journal as it happens."""
        from artemis.testing.bad_plugins import BadInput
        from artemis.testing.fault_bus import FaultBus
        from artemis.testing.injections import schedule
        from artemis.testing.stage import Stage

        assert isinstance(bus, FaultBus)
        bad = {name: BadInput(device) for name, device in inputs.items()}
        inputs.update(bad)
        stage = Stage(robot=self._loaded.robot, world=world, bus=bus, loop=loop, inputs=bad, request=robot.request)
        schedule(stage, self._loaded.mission.simulation.faults, self._recorder.note)

    def _attended(self, time: float) -> bool:
        return self._operator is not None or time <= self._last_act + OPERATOR_GRACE

    def _listen(self, loop: asyncio.AbstractEventLoop, robot: Robot) -> Callable[[], None]:
        """Signals, the scripted operator of a simulated run, and somebody at the terminal."""
        if self._simulated:
            for act in self._loaded.mission.simulation.operator:
                loop.call_later(act.at_s, robot.request, REQUESTS[act.do])

        def interrupt(number: int) -> None:
            again, self._interrupted = self._interrupted is not None, number
            robot.request(Request.END)
            if again:
                robot.request(Request.QUICKSTOP)

        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, interrupt, number)
        return self._operator(robot.request) if self._operator is not None else lambda: None

    def _show_paths(self) -> None:
        for step in self._plan.steps:
            if isinstance(step, FollowStep):
                self._recorder.show_path(0.0, _poses(step.path))


def _poses(path: Path) -> list[Pose]:
    """The path as poses about every 5 cm, for viewers."""
    count = max(2, min(2000, round(path.length / 0.05)))
    points = (path.at(path.length * number / (count - 1)) for number in range(count))
    return [Pose(x=point.x, y=point.y, heading=point.heading) for point in points]


def is_simulated(loaded: LoadedMission, simulate: bool = False) -> bool:
    """Whether a run of this mission meets the simulated drives in process."""
    return simulate or loaded.mission.bus == "simulation"


def run_mission(
    loaded: LoadedMission,
    source: FilePath,
    *,
    simulate: bool = False,
    watch: Callable[[Tick], None] = lambda tick: None,
    operator: Operator | None = None,
    witness: Callable[[World], Surroundings] = lambda world: world,
) -> Outcome:
    """Run a mission to its ordered end and leave its folder behind, with recording and journal.

    Args:
        loaded: The mission.
        source: Its file.
        simulate: Against simulated drives, whatever bus the mission names.
        watch: Sees every tick, for people.
        operator: Somebody at a terminal; None: nobody can acknowledge and arm.
        witness: Puts itself around the simulated world: hears every frame on its wire and sees what truly moves.
    """
    return _Run(loaded, source, is_simulated(loaded, simulate), watch, operator, witness).go()
