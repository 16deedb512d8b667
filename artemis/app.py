"""The composition root: a loaded mission becomes parts, and parts a run. Only here real or simulated is picked."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from math import inf
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from msgspec import structs

from artemis import clock
from artemis.devices.can_bus import CanBus, FrameBus, Traffic
from artemis.devices.drive import Drives
from artemis.devices.host import HostWatch, usage
from artemis.devices.reopening import ReopeningBus
from artemis.errors import RecordingError
from artemis.mission.injector import Simulated
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.mission.schema import BusWords, Stop
from artemis.motion.route import Route
from artemis.motion.steering_fit import SteeringFit
from artemis.planning import inputs_used, is_fast, is_simulated, made, plan_for, setup_for
from artemis.plugins.border import Border, close
from artemis.plugins.contracts import InputDevice
from artemis.recording.disk import Disk, low_disk
from artemis.recording.journal import Entry, Journal, Level
from artemis.recording.mcap_writer import Recorder
from artemis.recording.provenance import Provenance, Resumption, first_entries
from artemis.recording.resume import BROKEN, DONE, where_it_stopped
from artemis.recording.run_folder import RunFolder, create_run_folder, keep_calibration, keep_paths
from artemis.robot import Core, Robot
from artemis.states.plan import FollowStep, with_followers
from artemis.supervision import catalogue
from artemis.values import Fault, Pose, Request, Severity, Tick

if TYPE_CHECKING:
    from artemis.sim.bus import Surroundings
    from artemis.sim.world import World

MOST_MEMORY = 1_000_000_000
"""A process that grows and takes more than this [bytes] has to stop before the system ends it (PLG-05)."""
OPERATOR_GRACE = 5.0
"""A scripted operator counts as present until this long after its last act [s]."""
REQUESTS = {
    "quickstop": Request.QUICKSTOP,
    "acknowledge": Request.ACKNOWLEDGE,
    "arm": Request.ARM,
    "end": Request.END,
    "accept": Request.ACCEPT,
    "left_degree": Request.LEFT_DEGREE,
    "right_degree": Request.RIGHT_DEGREE,
    "left_tenth": Request.LEFT_TENTH,
    "right_tenth": Request.RIGHT_TENTH,
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


Watch = Callable[[Tick, Traffic], None]
Typed = Callable[[bytes], None]
"""Is called with what is typed at the terminal; with nothing once that is closed."""
Operator = Callable[[Callable[[Request], None], Typed | None], Callable[[], None]]
"""Given where requests go, and all that is typed (None: nobody wants it), begins to listen to somebody at a terminal;
returns how to stop."""


def resumption_from(
    loaded: LoadedMission, source: FilePath, run: FilePath, simulate: bool = False
) -> tuple[Resumption, list[str]]:
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


class _Run:
    """Everything that exists for one run."""

    def __init__(
        self,
        loaded: LoadedMission,
        source: FilePath,
        *,
        simulated: bool,
        watch: Watch,
        operator: Operator | None,
        witness: Callable[[World], Surroundings],
        start: datetime | None,
        resumption: Resumption | None,
        disk: Disk,
    ) -> None:
        mission = loaded.mission
        self._loaded, self._watch, self._operator, self._witness = loaded, watch, operator, witness
        self._plan = plan_for(loaded, simulated, resumption)
        self._simulated, self._resumption, self._disk = simulated, resumption, disk
        self._virtual = is_fast(loaded, simulated)
        acts = mission.simulation.operator if simulated else ()
        self._last_act = max((act.at_s for act in acts), default=-inf)
        start = start or clock.wall_date()
        root = loaded.folder / mission.record
        warning = low_disk(root, disk)
        if warning and not (self._virtual or operator or acts):
            raise RecordingError(warning)
        files = _files(loaded, source)
        self.run = create_run_folder(root, mission.mission, start, files)
        resolved = mission.model_copy(update={"bus": "simulation"}) if simulated else mission
        provenance = Provenance(
            start=start,
            mission=resolved.model_dump_json().encode(),
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
        for entry in first_entries(mission.mission, loaded.robot.robot, provenance, warning, loaded.remarks):
            self._recorder.note(entry)
        self._interrupted: int | None = None
        self._listeners: list[Typed] = []
        self._hands = False  # somebody was heard at a device that needs a person
        self._time, self._failed = 0.0, False

    def go(self) -> Outcome:
        """Run to the end."""
        begun = clock.stopwatch()
        outcome = BROKEN
        try:
            clock.run(self._main(), simulated=self._virtual)
            outcome = "failed" if self._failed else DONE
        finally:
            self._recorder.close(outcome)
        kept = keep_paths(self.run, {name: track.as_csv() for name, track in self._results.tracks.items()})
        kept += keep_calibration(self.run, {side: fit.record for side, fit in self._results.steering.items()})
        return Outcome(
            failed=self._failed,
            interrupted=self._interrupted,
            run=self.run,
            duration=self._time,
            elapsed=clock.stopwatch() - begun,
            steering=self._results.steering,
            troubles=(*(trouble.detail for trouble in self._recorder.troubles()), *kept),
        )

    async def _main(self) -> None:
        loop = asyncio.get_running_loop()
        bus, world = self._open_bus(loop)

        def wake() -> None:
            loop.call_soon_threadsafe(robot.tick_now)

        inputs = self._inputs(wake)
        live = {name for name, device in inputs.items() if getattr(device, "live", False)}
        border = Border(inputs, loop.time)
        steps = with_followers(self._plan.steps, border.watched)
        drives = Drives(self._loaded.robot, bus)
        true_pose = self._true_pose(world)

        def observe(tick: Tick) -> None:
            self._time, self._failed, now = tick.snapshot.time, tick.failed, loop.time()
            traffic = drives.wire.take_traffic(now)
            self._recorder.observe(tick, traffic, true_pose(tick), now)
            self._report_disk(robot, tick)
            if not self._virtual and (grown := host.look(self._time)) is not None:
                robot.report(_growth(grown))
            self._hands = self._hands or any(i.source in live for i in tick.snapshot.sensed.inputs if i.age is not None)
            self._watch(tick, traffic)

        host = HostWatch()
        period = 1 / self._loaded.mission.tick_hz
        core = Core(structs.replace(self._plan, steps=steps), period)
        self._results = core.results
        robot = Robot(core, drives, border, period, observe, self._attended)
        if world is not None and (injector := self._loaded.injector) is not None:
            run = Simulated(
                robot=self._loaded.robot, world=world, bus=bus, disk=self._disk, inputs=inputs, request=robot.request
            )
            injector.begin(run, self._loaded.mission.simulation.faults, self._recorder.note)
        stop_listening = self._listen(loop, robot)
        try:
            self._show_paths()
            await robot.run()
        finally:
            stop_listening()
            for id, name, seen in close(inputs):
                text = f"{id} {name}: {seen}, when it was closed"
                self._recorder.note(Entry(time=self._time, kind="warning", text=text, level=Level.WARNING))
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
        return (bus if (injector := self._loaded.injector) is None else injector.failing_bus(bus, seed)), world

    def _inputs(self, wake: Callable[[], None]) -> dict[str, InputDevice]:
        devices: dict[str, InputDevice] = {}
        for name, use in inputs_used(self._loaded, self._simulated).items():
            plugin, config = plugin_from("artemis.inputs", use)
            setup = replace(setup_for(self._loaded, name), wake=wake, typed=self._hear)
            devices[name] = made(plugin, config, setup)
        return devices

    def _hear(self, listener: Typed) -> bool:
        self._listeners.append(listener)
        return self._operator is not None

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
        return self._operator is not None or self._hands or time <= self._last_act + OPERATOR_GRACE

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

        def tell(typed: bytes) -> None:
            for listener in self._listeners:
                listener(typed)

        if self._operator is None:
            return lambda: None
        return self._operator(robot.request, tell if self._listeners else None)

    def _show_paths(self) -> None:
        for step in self._plan.steps:
            if isinstance(step, FollowStep) and isinstance(step.route, Route):
                self._recorder.show_path(0.0, step.route.poses(0.05))


def _growth(grown: str) -> Fault:
    """The fault that a process is which has `grown`: a warning, while there is memory."""
    severity = None if usage()[0] > MOST_MEMORY else Severity.WARN
    return catalogue.fault("PLG-05", detail=grown, severity=severity)


def run_mission(
    loaded: LoadedMission,
    source: FilePath,
    *,
    simulate: bool = False,
    watch: Watch = lambda tick, traffic: None,
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
        watch: Sees every tick, and the frames since the last one, for people.
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
        disk=disk or (Disk() if loaded.injector is None else loaded.injector.failing_disk(loaded.folder)),
    ).go()
