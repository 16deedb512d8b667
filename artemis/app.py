"""The composition root: a loaded mission becomes parts, and parts a run. Only here real or simulated is picked."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from math import inf
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from artemis import clock
from artemis.devices.can_bus import CanBus, FrameBus
from artemis.devices.drive import Drives
from artemis.devices.host import HostWatch
from artemis.devices.reopening import ReopeningBus
from artemis.errors import RecordingError
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.policies import policies_from
from artemis.mission.schema import BusWords, Calibrate, Follow, PluginUse, Stop, Teleop, Wait
from artemis.motion.path import Path, path_from_csv
from artemis.plugins.border import Border
from artemis.plugins.contracts import InputDevice, Setup
from artemis.recording.disk import Disk, low_disk
from artemis.recording.journal import Journal
from artemis.recording.mcap_writer import Recorder
from artemis.recording.provenance import Provenance, Resumption, first_entries
from artemis.recording.resume import BROKEN, DONE, where_it_stopped
from artemis.recording.run_folder import RunFolder, create_run_folder
from artemis.robot import Core, Robot
from artemis.states.mode import CalibrateStep, FollowStep, Plan, Step, TeleopStep, WaitStep, with_followers
from artemis.supervision import catalogue
from artemis.values import Pose, Request, Severity, Tick

if TYPE_CHECKING:
    from artemis.sim.bus import Surroundings
    from artemis.sim.world import World

SLACK = 10.0
"""A path may take twice its time and this [s] (PTH-08)."""
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
    troubles: tuple[str, ...] = ()
    """What the disk did to the recording."""

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
                speed: float | None = getattr(config, "speed_m_s", None)
                steps.append(
                    FollowStep(
                        path=path,
                        follower=follower,
                        max_cross_track=action.max_cross_track_m,
                        longest=inf if speed is None else 2 * path.length / speed + SLACK,
                    )
                )
    policies = policies_from(loaded.mission.recovery)
    return Plan(robot=loaded.robot, steps=tuple(steps), policies=policies)


def core_from(loaded: LoadedMission, resumption: Resumption | None = None) -> Core:
    """The robot's mind for a mission: what runs, and what a replay runs again."""
    return Core(_plan(loaded, is_simulated(loaded), resumption), 1 / loaded.mission.tick_hz)


def _plan(loaded: LoadedMission, simulated: bool, resumption: Resumption | None) -> Plan:
    """The mission's plan, with followers that fail where it wants that, begun where an earlier run stopped."""
    plan = plan_from(loaded)
    if simulated and loaded.mission.simulation.faults:
        from artemis.testing.injections import failing_followers

        plan.steps = failing_followers(plan.steps, loaded.mission.simulation.faults)
    if resumption is not None:
        plan.index, plan.done = resumption.step, resumption.done
        plan.start, plan.placed = resumption.pose, True
    return plan


def resumption_from(loaded: LoadedMission, source: FilePath, run: FilePath) -> tuple[Resumption, list[str]]:
    """Where the run in folder `run` stopped, for going on with it; and what an operator should know before.

    Raises:
        ConfigError: it cannot be resumed.
    """
    steps = sum(not isinstance(step.action, Stop) for step in loaded.mission.steps)
    return where_it_stopped(run, _files(loaded, source), steps)


def _files(loaded: LoadedMission, source: FilePath) -> dict[str, bytes]:
    """The mission's file and all that it names."""
    return {**loaded.files, source.name: source.read_bytes()}


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


class _Run:
    """Everything that exists for one run."""

    def __init__(
        self,
        loaded: LoadedMission,
        source: FilePath,
        *,
        simulated: bool,
        watch: Callable[[Tick], None],
        operator: Operator | None,
        witness: Callable[[World], Surroundings],
        start: datetime | None,
        resumption: Resumption | None,
        disk: Disk,
    ) -> None:
        mission = loaded.mission
        self._loaded, self._watch, self._operator, self._witness = loaded, watch, operator, witness
        self._plan = _plan(loaded, simulated, resumption)
        self._simulated, self._resumption, self._disk = simulated, resumption, disk
        self._virtual = simulated and mission.simulation.pace == "fast"
        self._last_act = max((act.at_s for act in mission.simulation.operator), default=-OPERATOR_GRACE)
        start = start or clock.wall_date()
        root = loaded.folder / mission.record
        warning = low_disk(root, disk)
        if warning and not (self._virtual or operator or (simulated and mission.simulation.operator)):
            raise RecordingError(warning)
        files = _files(loaded, source)
        self.run = create_run_folder(root, mission.mission, start, files)
        provenance = Provenance(
            start=start,
            mission=mission.model_dump_json().encode(),
            robot=loaded.robot.model_dump_json().encode(),
            files=files,
            resumption=resumption,
        )
        self._recorder = Recorder(
            self.run.recording,
            provenance,
            threaded=not self._virtual,
            journal=Journal(self.run.journal, disk),
            nodes={name: drive.node_id for name, drive in loaded.robot.drives.items()},
            disk=disk,
        )
        for entry in first_entries(mission.mission, loaded.robot.robot, provenance, warning):
            self._recorder.note(entry)
        self._interrupted: int | None = None
        self._time = 0.0

    def go(self) -> Outcome:
        """Run to the end."""
        begun = clock.stopwatch()
        outcome = BROKEN
        try:
            clock.run(self._main(), simulated=self._virtual)
            outcome = "failed" if self._plan.failed else DONE
        finally:
            self._recorder.close(outcome)
        return Outcome(
            failed=self._plan.failed,
            interrupted=self._interrupted,
            run=self.run,
            duration=self._time,
            elapsed=clock.stopwatch() - begun,
            troubles=tuple(trouble.detail for trouble in self._recorder.troubles()),
        )

    async def _main(self) -> None:
        loop = asyncio.get_running_loop()
        bus, world = self._open_bus(loop)
        inputs = _inputs(self._loaded, self._simulated)
        border = Border(inputs, loop.time)
        self._plan.steps = with_followers(self._plan.steps, border.watched)
        drives = Drives(self._loaded.robot, bus)
        true_pose = self._true_pose(world)

        def observe(tick: Tick) -> None:
            self._time, now = tick.snapshot.time, loop.time()
            self._recorder.observe(tick, drives.wire.take_traffic(now), true_pose(tick), now)
            self._report_disk(robot, tick)
            if not self._virtual and (grown := host.look(self._time)) is not None:
                robot.report(catalogue.fault("PLG-05", detail=grown))
            self._watch(tick)

        host = HostWatch()
        period = 1 / self._loaded.mission.tick_hz
        core = Core(self._plan, period)
        robot = Robot(core, drives, border, period, observe, self._attended)
        if world is not None and self._loaded.mission.simulation.faults:
            from artemis.testing.injections import schedule, stage_of

            stage = stage_of(self._loaded.robot, world, bus, inputs, self._disk, robot.request)
            schedule(stage, self._loaded.mission.simulation.faults, self._recorder.note)
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
            words = mission.bus.words
            return ReopeningBus(lambda: CanBus(words), loop.time), None
        from artemis.sim.bus import SimBus
        from artemis.sim.truth import moved_to
        from artemis.sim.world import World

        seed = mission.simulation.seed
        true, resumed = self._loaded.true_robot, self._resumption
        true = moved_to(true, resumed.true_pose or resumed.pose) if resumed else true
        world = World(robot, true, seed=seed, start=loop.time())
        bus = SimBus(self._witness(world), robot.bitrate, loop)
        if not mission.simulation.faults:
            return bus, world
        from artemis.testing.fault_bus import FaultBus

        return FaultBus(bus, seed=seed), world

    def _true_pose(self, world: World | None) -> Callable[[Tick], Pose | None]:
        """Tells where the simulated robot really is; nobody knows of a real one."""
        if world is None:
            return lambda tick: None
        from artemis.sim.truth import Truth, origin_of

        return Truth(world, origin_of(self._loaded.true_robot) if self._resumption else Pose()).pose

    def _report_disk(self, robot: Robot, tick: Tick) -> None:
        """What the disk refuses is a fault; a run without a journal and without anybody there is not gone on with."""
        for trouble in self._recorder.troubles():
            stops = trouble.journal and not tick.snapshot.sensed.attended
            severity = Severity.CONTROLLED_STOP if stops else None
            robot.report(catalogue.fault(trouble.id, detail=trouble.detail, severity=severity))

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

        if threading.current_thread() is threading.main_thread():  # no other hears signals
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
    start: datetime | None = None,
    resumption: Resumption | None = None,
    disk: Disk | None = None,
) -> Outcome:
    """Run a mission to its ordered end and leave its folder behind, with recording and journal.

    Args:
        loaded: The mission.
        source: Its file.
        simulate: Against simulated drives, whatever bus the mission names.
        watch: Sees every tick, for people.
        operator: Somebody at a terminal; None: nobody can acknowledge and arm.
        witness: Puts itself around the simulated world: hears every frame on its wire and sees what truly moves.
        start: Date and time on the wall at run time 0; None: now.
        resumption: The run to go on with.
        disk: What the run is recorded on; None: the computer's.

    Raises:
        DeviceLost: the bus cannot be opened.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    return _Run(
        loaded,
        source,
        simulated=is_simulated(loaded, simulate),
        watch=watch,
        operator=operator,
        witness=witness,
        start=start,
        resumption=resumption,
        disk=disk or _disk(loaded),
    ).go()


def _disk(loaded: LoadedMission) -> Disk:
    """The computer's; one that can be told to fail where the mission wants faults."""
    if not loaded.mission.simulation.faults:
        return Disk()
    from artemis.testing.failing_disk import FailingDisk

    return FailingDisk(free=Disk().free(loaded.folder))
