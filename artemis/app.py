"""The composition root: a loaded mission becomes parts, and parts a run. Only here real or simulated is picked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from msgspec import structs

from artemis import clock
from artemis.attendance import Attendance, Operator
from artemis.devices.can_bus import CanBus, FrameBus, Traffic
from artemis.devices.drive import Drives
from artemis.devices.host import MOST_MEMORY, HostWatch, usage
from artemis.devices.reopening import ReopeningBus
from artemis.errors import RecordingError
from artemis.mission.injector import Simulated
from artemis.mission.loading import LoadedMission
from artemis.mission.schema import BusWords, Stop
from artemis.motion.route import Route
from artemis.motion.steering_fit import SteeringFit
from artemis.planning import inputs_used, is_fast, is_simulated, localizer_used, plan_for, plugin_made, setup_for
from artemis.plugins.contracts import InputDevice, Localizer, Observer, is_live
from artemis.plugins.guard import GARBAGE, PluginGuard, Problem
from artemis.plugins.observing import Observation
from artemis.plugins.process import AskedPlugin, plugins_watched
from artemis.recording.disk import Disk, low_disk
from artemis.recording.journal import Entry, Journal, Level
from artemis.recording.mcap_writer import JOURNAL, Recorder
from artemis.recording.provenance import Provenance, ResumePoint, first_entries
from artemis.recording.resume import BROKEN, DONE, where_it_stopped
from artemis.recording.run_folder import RunFolder, create_run_folder, keep_calibration, keep_paths
from artemis.robot import Core, Robot
from artemis.states.plan import FollowStep, Plan, Results, with_followers
from artemis.supervision import catalogue
from artemis.values import Fault, Pose, Severity, Tick

if TYPE_CHECKING:
    from artemis.sim.bus import Surroundings
    from artemis.sim.world import World


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
    steering: Mapping[str, SteeringFit]
    """What was measured of the potentiometers, by side."""
    troubles: tuple[str, ...] = ()
    """What the disk did to the recording."""

    @property
    def exit_status(self) -> int:
        """0 done, 1 failed or stopped, 128 + signal when interrupted."""
        if self.interrupted is not None:
            return 128 + self.interrupted
        return int(self.failed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What a run is made of where it is not as its mission says: a test hands it in."""

    machine: Callable[[], tuple[FrameBus, World | None]] | None = None
    """Opens the bus on the running loop; with the world behind it, where that is a simulated one."""
    plan: Plan | None = None
    inputs: Mapping[str, InputDevice] | None = None
    robot: Callable[..., Robot] = Robot
    disk: Disk | None = None
    """What the run is recorded on."""
    loop: type[asyncio.AbstractEventLoop] | None = None
    """In whose time it runs."""


Watch = Callable[[Tick, Traffic], None]


def resumption_from(
    loaded: LoadedMission, source: FilePath, run: FilePath, simulate: bool = False
) -> tuple[ResumePoint, list[str]]:
    """Where the run in folder `run` stopped, for going on with it; and what an operator should know before.

    Raises:
        ConfigError: it cannot be resumed.
    """
    steps = sum(not isinstance(step.action, Stop) for step in loaded.mission.steps)
    simulated, root = is_simulated(loaded, simulate), loaded.folder / loaded.mission.record
    return where_it_stopped(run, _files(loaded, source), steps, simulated=simulated, root=root)


def _files(loaded: LoadedMission, source: FilePath) -> dict[str, bytes]:
    """The mission's file and all that it names."""
    return {**loaded.files, source.name: source.read_bytes()}


@dataclass(slots=True, kw_only=True)
class _Run:
    """A run under distance: what it is made of, and what is noted of it meanwhile."""

    loaded: LoadedMission
    simulated: bool
    virtual: bool
    """On virtual time."""
    resume_point: ResumePoint | None
    plan: Plan
    parts: Parts
    disk: Disk
    folder: RunFolder
    recorder: Recorder
    observers: list[Observation]
    """Those that are handed in; the mission's own are added."""
    attendance: Attendance
    watch: Watch
    witness: Callable[[World], Surroundings]
    time: float = 0.0
    """Run time [s]."""
    failed: bool = False
    results: Results = field(default_factory=Results)
    asked: AskedPlugin = field(default_factory=AskedPlugin)

    def go(self, loop: type[asyncio.AbstractEventLoop]) -> Outcome:
        """Run to the end, in the time of such a loop."""
        begun = clock.stopwatch()
        outcome = BROKEN
        with ExitStack() as ends:
            for observer in self.observers:
                ends.callback(observer.close)
            ends.callback(lambda: self.recorder.close(outcome))
            patient = self.attendance.is_undisturbed if self.virtual else None
            ours = {observer.name for observer in self.observers}
            ends.enter_context(plugins_watched(self.asked, ours, self._warn, patient))
            for name, use in self.loaded.mission.observers.items():
                setup = replace(setup_for(self.loaded, name), run=self.folder.path)
                observer = plugin_made("artemis.observers", use, setup)
                self.observers.append(Observation(name, observer, threaded=not self.virtual, asked=self.asked))
                ends.callback(self._close, self.observers[-1])
            runner = ends.enter_context(asyncio.Runner(loop_factory=loop))
            runner.run(self._main())
            outcome = "failed" if self.failed else DONE
        kept = keep_paths(self.folder, {name: track.as_csv() for name, track in self.results.tracks.items()})
        kept += keep_calibration(self.folder, {side: fit.record for side, fit in self.results.steering.items()})
        return Outcome(
            failed=self.failed,
            interrupted=self.attendance.interrupted,
            run=self.folder,
            duration=self.time,
            elapsed=clock.stopwatch() - begun,
            steering=self.results.steering,
            troubles=(*(trouble.detail for trouble in self.recorder.troubles()), *kept),
        )

    async def _main(self) -> None:
        loop = asyncio.get_running_loop()
        bus, world = self._machine(loop)

        def wake() -> None:
            loop.call_soon_threadsafe(robot.tick_now)

        inputs = self._inputs(wake)
        live = {name for name, device in inputs.items() if is_live(device)}
        localizer = self._localizer(world, loop.time())
        guard = PluginGuard(inputs, loop.time, localizer, self.asked)
        steps = with_followers(self.plan.steps, guard.watched)
        drives = Drives(self.loaded.robot, bus)
        self.recorder.true_pose = self._true_pose(world)
        host = HostWatch()

        def observe(tick: Tick) -> None:
            self.time, self.failed, now = tick.snapshot.time, tick.failed, loop.time()
            traffic = drives.wire.take_traffic(now)
            self.recorder.see(tick, traffic, now)
            for observer in self.observers:
                observer.see(tick, traffic, now)
            self._report(robot, tick.snapshot.sensed.attended)
            if not self.virtual and (grown := host.look(self.time)) is not None:
                robot.report(growth(grown, usage()[0]))
            if live and any(sample.source in live for sample in tick.snapshot.sensed.inputs if sample.age is not None):
                self.attendance.hands = True
            self.watch(tick, traffic)

        period = 1 / self.loaded.mission.tick_hz
        core = Core(structs.replace(self.plan, steps=steps), period)
        self.results = core.results
        robot = self.parts.robot(core, drives, guard, period, observe, self.attendance.there)
        if world is not None and (injector := self.loaded.injector) is not None:
            run = Simulated(
                robot=self.loaded.robot, world=world, bus=bus, disk=self.disk, inputs=inputs, request=robot.request
            )
            injector.begin(run, self.loaded.mission.simulation.faults, self.recorder.note)
        stop_listening = self.attendance.begin(loop, robot.request)
        try:
            self._show_paths()
            await robot.run()
        finally:
            stop_listening()
            self._note(guard.close())
            bus.close()

    def _close(self, observer: Observation) -> None:
        observer.close()
        self._note(observer.take_problems())

    def _note(self, problems: list[Problem]) -> None:
        """What went wrong at the end."""
        for id, name, seen in problems:
            self._warn(f"{id} {name}: {seen}, when it was closed")

    def _warn(self, text: str) -> None:
        self.recorder.note(Entry(time=self.time, kind="warning", text=text, level=Level.WARNING))

    def _machine(self, loop: asyncio.AbstractEventLoop) -> tuple[FrameBus, World | None]:
        """The bus, and the world behind it where that is simulated; one that can fail where the mission wants that."""
        mission, injector = self.loaded.mission, self.loaded.injector
        if self.parts.machine is not None:
            bus, world = self.parts.machine()
        elif isinstance(mission.bus, BusWords) and not self.simulated:
            words = mission.bus.words
            return ReopeningBus(lambda: CanBus(words), loop.time), None
        else:
            bus, world = self._simulated_machine(loop)
        if world is not None and injector is not None:
            bus = injector.failing_bus(bus, mission.simulation.seed)
        return bus, world

    def _simulated_machine(self, loop: asyncio.AbstractEventLoop) -> tuple[FrameBus, World]:
        from artemis.sim.bus import SimBus
        from artemis.sim.truth import moved_to
        from artemis.sim.world import World

        robot, true, resumed = self.loaded.robot, self.loaded.true_robot, self.resume_point
        true = moved_to(true, self._world_origin(), resumed.true_pose or resumed.pose) if resumed else true
        world = World(robot, true, seed=self.loaded.mission.simulation.seed, start=loop.time())
        return SimBus(self.witness(world), robot.bitrate, loop), world

    def _inputs(self, wake: Callable[[], None]) -> dict[str, InputDevice]:
        if self.parts.inputs is not None:
            return dict(self.parts.inputs)
        devices: dict[str, InputDevice] = {}
        for name, use in inputs_used(self.loaded, self.simulated).items():
            setup = replace(setup_for(self.loaded, name), wake=wake, typed=self.attendance.hear)
            self.asked.begin(name)
            devices[name] = plugin_made("artemis.inputs", use, setup)
        self.asked.end()
        return devices

    def _true_pose(self, world: World | None) -> Callable[[Tick], Pose | None]:
        """Tells where the simulated robot really is; nobody knows of a real one."""
        if world is None:
            return lambda tick: None
        from artemis.sim.truth import Truth

        origin = self._world_origin() if self.resume_point else Pose()
        return Truth(world, origin, fixed=self.plan.localized).pose

    def _world_origin(self) -> Pose:
        """Where a simulation's true poses count from: its map, or where the robot stands when a mission begins."""
        from artemis.sim.truth import origin_of

        return Pose() if self.plan.localized else origin_of(self.loaded.true_robot)

    def _localizer(self, world: World | None, begun: float) -> Localizer | None:
        if (use := localizer_used(self.loaded, self.simulated)) is None:
            return None
        setup = setup_for(self.loaded, use.plugin)
        if world is not None:
            setup = replace(setup, true_pose=lambda: (world.time - begun, world.pose))
        localizer: Localizer = plugin_made("artemis.localizers", use, setup)
        return localizer

    def _report(self, robot: Robot, attended: bool) -> None:
        """What goes wrong with observers is a warning; nobody there and no journal: the run is not gone on with."""
        for id, name, seen in self.recorder.take_problems():
            severity = Severity.CONTROLLED_STOP if name == JOURNAL and not attended else None
            robot.report(catalogue.fault(id, "", seen, severity))
        for observer in self.observers:
            for id, name, seen in observer.take_problems():
                id = id if id in catalogue.ROWS else GARBAGE
                robot.report(catalogue.fault(id, name, seen, Severity.WARN))

    def _show_paths(self) -> None:
        for step in self.plan.steps:
            if isinstance(step, FollowStep) and isinstance(step.route, Route):
                self.recorder.show_path(0.0, step.route.poses(0.05), "map" if self.plan.localized else "odom")


def growth(grown: str, memory: int) -> Fault:
    """The fault that a process is which has `grown` and now takes `memory` [bytes]: a warning, while there is some."""
    severity = None if memory > MOST_MEMORY else Severity.WARN
    return catalogue.fault("PLG-05", detail=grown, severity=severity)


def run_mission(
    loaded: LoadedMission,
    source: FilePath,
    *,
    simulate: bool = False,
    watch: Watch = lambda tick, traffic: None,
    observers: Mapping[str, Observer] | None = None,
    operator: Operator | None = None,
    witness: Callable[[World], Surroundings] = lambda world: world,
    start: datetime | None = None,
    resume_point: ResumePoint | None = None,
    parts: Parts | None = None,
) -> Outcome:
    """Run a mission to its ordered end and leave its folder behind, with recording and journal.

    Args:
        loaded: The mission.
        source: Its file.
        simulate: Against simulated drives, whatever bus the mission names.
        watch: Sees every tick, and the frames since the last one, inside the tick.
        observers: See the run beside the ticks; closed at its end.
        operator: Somebody at a terminal; None: nobody can acknowledge and arm.
        witness: Puts itself around the simulated world: hears every frame on its wire and sees what truly moves.
        start: Date and time on the wall at run time 0; None: now.
        resume_point: The run to go on with.
        parts: What is to be another than the mission says.

    Raises:
        DeviceLost: the bus cannot be opened.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    parts, simulated = parts or Parts(), is_simulated(loaded, simulate)
    loop = parts.loop or (clock.SimulatedLoop if is_fast(loaded, simulated) else asyncio.SelectorEventLoop)
    virtual = issubclass(loop, clock.SimulatedLoop)
    injector = loaded.injector if simulated else None
    plan = parts.plan or plan_for(loaded, simulated, resume_point)
    disk = parts.disk or (Disk() if injector is None else injector.failing_disk(loaded.folder))
    provenance = _provenance(loaded, source, start or clock.wall_date(), simulated, resume_point)
    attendance = Attendance(loaded.mission.simulation.operator if simulated else (), operator)
    folder, recorder = _recorder(loaded, provenance, disk, virtual, alone=not (virtual or attendance.expected))
    run = _Run(
        loaded=loaded,
        simulated=simulated,
        virtual=virtual,
        resume_point=resume_point,
        plan=plan,
        parts=parts,
        disk=disk,
        folder=folder,
        recorder=recorder,
        observers=[
            Observation(name, observer, threaded=not virtual, patience=None)
            for name, observer in (observers or {}).items()
        ],
        attendance=attendance,
        watch=watch,
        witness=witness,
    )
    return run.go(loop)


def _provenance(
    loaded: LoadedMission, source: FilePath, start: datetime, simulated: bool, resume_point: ResumePoint | None
) -> Provenance:
    mission = loaded.mission.model_copy(update={"bus": "simulation"}) if simulated else loaded.mission
    return Provenance(
        start=start,
        mission=mission.model_dump_json().encode(),
        robot=loaded.robot.model_dump_json().encode(),
        files=_files(loaded, source),
        resume_point=resume_point,
    )


def _recorder(
    loaded: LoadedMission, provenance: Provenance, disk: Disk, virtual: bool, alone: bool
) -> tuple[RunFolder, Recorder]:
    """Make the folder of a run, and what writes into it; with enough room for one that is left `alone`."""
    mission, root = loaded.mission.mission, loaded.folder / loaded.mission.record
    warning = low_disk(root, disk)
    if warning and alone:
        raise RecordingError(warning)
    folder = create_run_folder(root, mission, provenance.start, provenance.files)
    recorder = Recorder(
        folder.recording,
        provenance,
        threaded=not virtual,
        journal=Journal(folder.journal, disk),
        nodes={name: drive.node_id for name, drive in loaded.robot.drives.items()},
        disk=disk,
    )
    for entry in first_entries(mission, loaded.robot.robot, provenance, warning, loaded.remarks):
        recorder.note(entry)
    return folder, recorder
