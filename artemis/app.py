"""The composition root: a loaded mission becomes parts, and parts a run."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from math import inf
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from msgspec import structs

from artemis import clock
from artemis.attendance import Attendance, Operator
from artemis.devices.can_bus import Traffic
from artemis.devices.device import Device
from artemis.devices.host import MOST_MEMORY, HostWatch, usage
from artemis.equipment import Equipment, Machine, Witness, opened
from artemis.errors import ConfigError
from artemis.mission.actions import PluginUse
from artemis.mission.injector import Simulated
from artemis.mission.loading import LoadedMission
from artemis.mission.rezoned import rezoned, zones_files
from artemis.motion.steering_fit import SteeringFit, SteeringZero
from artemis.planning import (
    check_drivable,
    files_named,
    inputs_used,
    is_fast,
    is_simulated,
    localizer_of,
    origin_of,
    plan_for,
    plugin_made,
    setup_for,
    unresumable,
)
from artemis.plugins.contracts import InputDevice, Localizer, Observer, PluginContext
from artemis.plugins.guard import LOCALIZER, PluginGuard
from artemis.plugins.process import AskedPlugin
from artemis.plugins.stated import is_live
from artemis.recording.disk import Disk
from artemis.recording.ending import Ending
from artemis.recording.journal import Entry, Level
from artemis.recording.mcap_reader import Recording
from artemis.recording.provenance import ResumePoint
from artemis.recording.record_folders import note_folder
from artemis.recording.resume import DONE, last_place, where_it_stopped
from artemis.recording.run_folder import RunFolder
from artemis.robot import Core, Robot
from artemis.run_record import RunRecord, files_of, provenance_of
from artemis.states.plan import Plan, Results, with_behaviours, with_followers
from artemis.states.requests import ignored
from artemis.supervision import catalogue
from artemis.values import Fault, Pose, Severity, Tick

if TYPE_CHECKING:
    from artemis.sim.world import World

WAKING = 0.005
"""Between two extra ticks that inputs ask for [s]: one that asks in each of them must not stop the clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How a run ended."""

    failed: bool
    """Stopped before its last step was done."""
    reason: str = ""
    """The faults and requests that stopped it; empty: it did its last step, or its mission ended itself."""
    interrupted: int | None
    """The signal that ended it."""
    run: RunFolder
    duration: float
    """Run time [s]."""
    elapsed: float
    """Seconds on the wall."""
    steering: Mapping[str, SteeringFit]
    """What was measured of the potentiometers, by side."""
    zeros: Mapping[str, SteeringZero] = field(default_factory=dict)
    """Of what else finds the angle of the steering, likewise."""
    troubles: tuple[str, ...] = ()
    """What the disk did to the recording."""
    maps: tuple[str, ...] = ()
    """Files of the map that was made; and of those that are wanted and were not written, why not."""

    @property
    def exit_status(self) -> int:
        """0 done, 1 failed or stopped, 128 + signal when interrupted."""
        if self.interrupted is not None:
            return 128 + self.interrupted
        return int(self.failed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What a run is made of where it is not as its mission says: a test hands it in."""

    machine: Machine | None = None
    sensors: Callable[[], Sequence[Device]] = lambda: ()
    """Opens devices that the robot file does not know, on the running loop."""
    plan: Plan | None = None
    inputs: Mapping[str, InputDevice] | None = None
    robot: Callable[..., Robot] = Robot
    plugins: Callable[[str, PluginUse, PluginContext], Any] = plugin_made
    """Makes an input or a localizer: of this group, as the mission uses it."""
    disk: Disk | None = None
    """What the run is recorded on."""
    loop: type[asyncio.AbstractEventLoop] | None = None
    """In whose time it runs."""


Watch = Callable[[Tick, Traffic], None]


def resume_point_of(
    loaded: LoadedMission, source: FilePath, run: FilePath, simulate: bool = False
) -> tuple[ResumePoint, list[str]]:
    """Where the run in folder `run` stopped, for resuming it; and what an operator should know before.

    Raises:
        ConfigError: it cannot be resumed.
    """
    steps = len(loaded.tree.steps)
    simulated, root = is_simulated(loaded, simulate), loaded.folder / loaded.mission.record
    zones, files = zones_files(loaded), files_of(loaded, source)
    fixed = {name: content for name, content in files.items() if name not in zones}
    found, notes = where_it_stopped(run, fixed, steps, simulated=simulated, root=root)
    if zones:
        notes += rezoned(loaded, Recording(run).files, run)
    if problems := unresumable(loaded, found.position):
        raise ConfigError([f"{run}: cannot be resumed: {problem}" for problem in problems])
    return found, notes


@dataclass(slots=True, kw_only=True)
class _Run:
    """A run under way: what it is made of, and what is noted of it meanwhile."""

    loaded: LoadedMission
    simulated: bool
    plan: Plan
    parts: Parts
    equip: Callable[[], Equipment]
    """Opens the devices on the running loop."""
    record: RunRecord
    attendance: Attendance
    watch: Watch
    tell: Callable[[str], None]
    resume_point: ResumePoint | None
    failed: bool = False
    ending: Ending = field(default_factory=Ending)
    results: Results = field(default_factory=Results)
    asked: AskedPlugin = field(default_factory=AskedPlugin)

    def go(self, loop: type[asyncio.AbstractEventLoop]) -> Outcome:
        """Run to the end, in the time of such a loop."""
        begun = clock.stopwatch()
        patient = None if self.record.threaded else self.attendance.is_undisturbed
        with self.attendance.holding_signals():
            origin = partial(origin_of, self.loaded, self.simulated)
            with self.record.observing(self.asked, patient, origin), asyncio.Runner(loop_factory=loop) as runner:
                runner.run(self._main())
                reason = self.ending.reason if self.failed else ""
                self.record.outcome = f"failed: {reason}".removesuffix(": ") if self.failed else DONE
                self.record.in_order = not self.failed and self.attendance.interrupted is None
            troubles = self.record.conclude(self.results)
        return Outcome(
            failed=self.failed,
            reason=reason,
            interrupted=self.attendance.interrupted,
            run=self.record.folder,
            duration=self.record.time,
            elapsed=clock.stopwatch() - begun,
            steering=self.results.steering,
            zeros=self.results.zeros,
            troubles=troubles,
            maps=self.record.maps,
        )

    async def _main(self) -> None:
        equipment = self.equip()
        if not self.simulated:
            note_folder(self.record.folder.path.parent)
        try:
            await self._drive(equipment)
        finally:
            equipment.devices.close()

    async def _drive(self, equipment: Equipment) -> None:
        loop, record = asyncio.get_running_loop(), self.record

        woken = -inf

        def tick_now() -> None:
            nonlocal woken
            if loop.time() - woken >= WAKING:
                woken = loop.time()
                robot.tick_now()

        def wake() -> None:
            loop.call_soon_threadsafe(tick_now)

        inputs = self._inputs(wake)
        live = {name for name, device in inputs.items() if is_live(device)}
        self.attendance.awaited = bool(live)
        localizer = self._localizer(equipment.world, loop.time())
        if localizer is not None and equipment.world is not None and self.loaded.injector is not None:
            localizer = self.loaded.injector.failing_localizer(localizer)
        guard = PluginGuard(inputs, loop.time, localizer, self.asked)
        steps = with_behaviours(with_followers(self.plan.steps, guard.watched), guard.watched_behaviour)
        record.recorder.true_pose = equipment.true_pose
        host = HostWatch()

        def observe(tick: Tick) -> None:
            self.failed, now = tick.failed, loop.time()
            if tick.cause is not None or tick.wish.failed:
                self.ending.see(tick)
            traffic = equipment.traffic()
            record.see(tick, traffic, now)
            for fault in record.faults(tick.snapshot.sensed.attended):
                robot.report(fault)
            if record.threaded and (grown := host.look(record.time)) is not None:
                robot.report(growth(grown, usage()[0]))
            if live and any(sample.source in live for sample in tick.snapshot.sensed.inputs if sample.age is not None):
                self.attendance.hands = True
            self.watch(tick, traffic)

        period = 1 / self.loaded.mission.tick_hz
        core = Core(structs.replace(self.plan, steps=steps), period)
        self.results = core.results
        robot = self.parts.robot(core, equipment.devices, guard, period, observe, self.attendance.there)
        self._begin_faults(equipment, inputs, localizer, robot)
        stop_listening = self.attendance.begin(loop, robot.request)
        try:
            record.show_paths(self.plan)
            await robot.run()
        finally:
            stop_listening()
            record.note(guard.close())

    def _begin_faults(
        self, equipment: Equipment, inputs: dict[str, InputDevice], localizer: Localizer | None, robot: Robot
    ) -> None:
        """Those that the mission wants; only in a simulated world."""
        loaded, world = self.loaded, equipment.world
        if world is not None and (injector := loaded.injector) is not None:
            run = Simulated(
                robot=loaded.robot,
                world=world,
                bus=equipment.bus,
                disk=self.record.disk,
                inputs=inputs,
                localizer=localizer,
                request=robot.request,
            )
            injector.begin(run, loaded.mission.simulation.faults, self.record.recorder.note)

    def _inputs(self, wake: Callable[[], None]) -> dict[str, InputDevice]:
        if self.parts.inputs is not None:
            return dict(self.parts.inputs)
        devices: dict[str, InputDevice] = {}
        with ExitStack() as made:  # where one cannot be made, those before are closed
            for name, use in inputs_used(self.loaded, self.simulated).items():
                setup = replace(setup_for(self.loaded, name), wake=wake, typed=self.attendance.hear, ignored=ignored)
                setup = replace(setup, real_time=self.record.threaded)
                devices[name] = self._made(name, "artemis.inputs", use, setup)
                made.callback(devices[name].close)
            made.pop_all()
        return devices

    def _localizer(self, world: World | None, begun: float) -> Localizer | None:
        if (use := localizer_of(self.loaded, self.simulated)) is None:
            return None
        setup = replace(setup_for(self.loaded, use.plugin), real_time=self.record.threaded, last_pose=self._last_pose)
        setup = replace(setup, resumed=self.resume_point is not None)
        if world is not None:
            setup = replace(setup, true_pose=lambda: (world.time - begun, world.pose))
        localizer: Localizer = self._made(LOCALIZER, "artemis.localizers", use, setup)
        return localizer

    def _last_pose(self) -> Pose | None:
        """Where the run that is resumed stopped, or the last one of this mission ended, on the map."""
        if self.resume_point is not None:
            return self.resume_point.pose
        use = localizer_of(self.loaded, self.simulated)
        files = files_named(use, self.loaded.files) if use is not None else {}
        mine, mission, robot = self.record.folder.path, self.loaded.mission.mission, self.loaded.robot.robot
        found = last_place(mine, mission, robot, files, simulated=self.simulated)
        known = found.pose is not None
        told = found.told if known else f"the robot is looked for on the whole map: {found.told}"
        level = Level.INFO if known else Level.WARNING
        self.record.recorder.note(Entry(time=0.0, kind="place", text=told, level=level))
        self.tell(told)
        return found.pose

    def _made(self, name: str, group: str, use: PluginUse, context: PluginContext) -> Any:  # noqa: ANN401 (of any group)
        """The plugin that the mission uses, asked by its name."""
        self.asked.begin(name)
        try:
            return self.parts.plugins(group, use, context)
        finally:
            self.asked.end()


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
    witness: Witness = lambda world: world,
    tell: Callable[[str], None] = lambda text: None,
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
        tell: Is told where the run takes the robot to be, if an earlier run knows.
        start: Date and time on the wall at run time 0; None: now.
        resume_point: The run to resume.
        parts: What is to be another than the mission says.

    Raises:
        ConfigError, DeviceLost: nothing is driven over its bus; it cannot be opened.
        RecordingError: the run's folder cannot be made, or has no room; nothing has moved.
    """
    parts, simulated = parts or Parts(), is_simulated(loaded, simulate)
    check_drivable(loaded, source, simulated)
    loop = parts.loop or (clock.SimulatedLoop if is_fast(loaded, simulated) else clock.RealTimeLoop)
    virtual = issubclass(loop, clock.SimulatedLoop)
    injector = loaded.injector if simulated else None
    plan = parts.plan or plan_for(loaded, simulated, resume_point)
    disk = parts.disk or (Disk() if injector is None else injector.failing_disk(loaded.folder))
    attendance = Attendance(loaded.mission.simulation.operator if simulated else (), operator)
    provenance = provenance_of(loaded, source, start or clock.wall_date(), simulated, resume_point)
    alone = not (virtual or attendance.expected)
    use = localizer_of(loaded, simulated)
    record = RunRecord(loaded, provenance, disk, observers or {}, threaded=not virtual, alone=alone, localizer=use)
    equip = partial(opened, loaded, resume_point, witness, parts.machine, parts.sensors, simulated=simulated)
    return _Run(
        loaded=loaded,
        simulated=simulated,
        plan=plan,
        parts=parts,
        equip=partial(equip, localized=plan.localized),
        record=record,
        attendance=attendance,
        watch=watch,
        tell=tell,
        resume_point=resume_point,
    ).go(loop)
