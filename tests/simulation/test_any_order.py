"""The whole stack in simulated time, with whatever happens in whatever order: hypothesis chooses, the rules hold."""

from __future__ import annotations

import asyncio
from typing import Any, ClassVar

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from msgspec.structs import replace
from rig import MISSIONS, WatchedBus, WatchedWorld

from artemis import clock
from artemis.config import Config
from artemis.devices.drive import Drives
from artemis.plugins.guard import PluginGuard
from artemis.robot import Core, Robot
from artemis.states.plan import Plan, TeleopStep
from artemis.supervision.catalogue import ROWS
from artemis.values import Mode, OperatorInput, Request, Severity, Tick
from artemis.vehicle import RobotFile
from artemis.yaml_file import load
from artemis_lab.injections.bad_plugins import BadInput
from artemis_lab.injections.fault_bus import FaultBus
from artemis_lab.injections.stage import Needs, Stage
from artemis_lab.injections.table import INJECTIONS, inject

ROBOT = RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)
PERIOD = 0.02
AT_REST = (Mode.INIT, Mode.FAULT, Mode.END)
MISBEHAVING = {"RUN-01", "RUN-02", "RUN-03", "RUN-05", "RUN-09", "RUN-10", "STE-06", "SYS-10", "COM-12"}
"""The machine itself, or what reaches it, does not obey any more: its true speed proves nothing about artemis."""
HAPPENS = sorted(
    id
    for id, injection in INJECTIONS.items()
    if id not in MISBEHAVING | {"SYS-04", "SYS-05", "DSK-02", "DSK-05"}
    and injection.behaviour is None
    and (injection.families is None or "epos1" in injection.families)
    and id[:3] in ("DRV", "COM", "INP", "STE", "EST", "RUN", "SYS")
)


class Hand:
    """What the operator's stick says now."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self) -> None:
        self.sample = OperatorInput(source="stick", age=0.0, axes=(0.0, 0.0))

    def read(self, now: float) -> OperatorInput:
        return self.sample

    def close(self) -> None: ...


class AnyOrder(RuleBasedStateMachine):
    """A robot driven by hand, an operator who does anything, and a world in which anything fails."""

    @initialize(seed=st.integers(0, 1000))
    def power_on(self, seed: int) -> None:
        self.loop = clock.SimulatedLoop()
        self.world = WatchedWorld(ROBOT, seed=seed)
        self.wire = WatchedBus(self.world, ROBOT.bitrate, self.loop)
        self.hand = Hand()
        stick = BadInput(self.hand)
        self.ticks: list[Tick] = []
        self.checked = 0
        self.injected: set[str] = set()
        plan = Plan(robot=ROBOT, steps=(TeleopStep(input="stick", seconds=None),))
        self.run_task = self.loop.create_task(self.start(plan, stick, seed))
        self.loop.run_until_complete(asyncio.sleep(0))

    async def start(self, plan: Plan, stick: BadInput, seed: int) -> None:
        self.bus = FaultBus(self.wire, seed=seed)
        guard = PluginGuard({"stick": stick}, self.loop.time)
        drives = Drives(ROBOT, self.bus)
        self.robot = Robot(Core(plan, PERIOD), drives, guard, PERIOD, self.observe, lambda time: (True, False))
        self.stage = Stage(
            robot=ROBOT, world=self.world, bus=self.bus, loop=self.loop, inputs={"stick": stick}, request=self.ask
        )
        self.drives = drives
        await self.robot.run()

    def observe(self, tick: Tick) -> None:
        self.drives.wire.take_traffic()
        self.ticks.append(tick)

    def ask(self, request: Request) -> None:
        if not self.run_task.done():
            self.loop.call_soon(self.robot.request, request)

    def pass_time(self, seconds: float) -> None:
        self.loop.run_until_complete(asyncio.sleep(seconds))

    # ------------------------------------------------------------------------------------------ what may happen

    @rule(seconds=st.sampled_from([0.013, 0.1, 0.7, 5.0]))
    def time_passes(self, seconds: float) -> None:
        self.pass_time(seconds)

    @rule(
        speed=st.sampled_from([-0.7, -0.3, 0.0, 0.3, 0.7, 9.0]),
        steering=st.sampled_from([-1.2, -0.4, 0.0, 0.4, 1.2]),
        enabled=st.booleans(),
    )
    def the_stick_moves(self, speed: float, steering: float, enabled: bool) -> None:
        neutral = not enabled and speed == 0.0 and steering == 0.0
        self.hand.sample = replace(
            self.hand.sample, speed=speed, steering=steering, enabled=enabled, neutral=neutral, axes=(0.1, speed / 10)
        )
        self.pass_time(0.3)

    @rule()
    def the_stick_is_released(self) -> None:
        self.hand.sample = OperatorInput(source="stick", age=0.0, axes=(0.0, 0.0))
        self.pass_time(0.3)

    @rule(request=st.sampled_from([Request.QUICKSTOP, Request.ACKNOWLEDGE, Request.ARM]))
    def the_operator_asks(self, request: Request) -> None:
        self.ask(request)
        self.pass_time(0.1)

    @rule(id=st.sampled_from(HAPPENS), which=st.integers(0, 3), seconds=st.sampled_from([0.0, 0.05, 2.0]))
    def something_fails(self, id: str, which: int, seconds: float) -> None:
        if self.run_task.done():
            return
        injection = INJECTIONS[id]
        role = {Needs.TRACTION: "traction", Needs.STEERING: "steer"}.get(injection.needs, "")
        nodes = [name for name in ROBOT.drives if name.startswith(role)]
        node = None if injection.needs is Needs.NOTHING else nodes[which % len(nodes)]
        options: dict[str, Any] = {"duration_s": 1.0} if "duration_s" in injection.parameters.model_fields else {}
        self.loop.call_soon(lambda: inject(self.stage, id, node, **options))
        self.injected.add(id)
        self.pass_time(seconds)

    # ------------------------------------------------------------------------------------------ what always holds

    @invariant()
    def the_program_goes_on(self) -> None:
        if hasattr(self, "run_task") and self.run_task.done():
            self.run_task.result()  # raises what the run raised

    @invariant()
    def nothing_drives_where_nothing_may(self) -> None:
        """In init, fault and end no driven wheel is asked to turn; no frame had to be held back; the gate holds."""
        for tick in self.ticks[self.checked :]:
            if tick.mode in AT_REST:
                assert (tick.set_points.speed_left, tick.set_points.speed_right) == (0.0, 0.0)
            assert not tick.snapshot.sensed.bus.blocked
            top = ROBOT.limits.wheel_speed_m_s * 1.02
            assert max(abs(tick.set_points.speed_left), abs(tick.set_points.speed_right)) <= top
            if tick.snapshot.verdict.severity >= Severity.QUICK_STOP and tick.mode is not Mode.QUICKSTOP:
                assert tick.mode in (Mode.FAULT, Mode.END)
        self.checked = len(self.ticks)

    @invariant()
    def an_acknowledgment_moves_nothing(self) -> None:
        """From a fault to motion it takes an arm, again after each one.

        Starting the run is the first arm. A fault that ends a bring-up before it came to arming leaves it in place: a
        row that recovers automatically may then go on to `ready`, where motion still waits for a released and pressed
        enable button.
        """
        armed = True
        for before, tick in zip(self.ticks, self.ticks[1:], strict=False):
            if tick.mode is Mode.FAULT or Request.QUICKSTOP in tick.snapshot.sensed.requests:
                armed = before.mode is Mode.INIT and armed and tick.mode is Mode.FAULT
            if Request.ARM in tick.snapshot.sensed.requests:
                armed = True
            assert armed or tick.mode is not Mode.TELEOP

    def teardown(self) -> None:
        """Whatever happened, the run ends in order, and the robot stands."""
        if not hasattr(self, "run_task"):
            return
        try:
            self.ask(Request.END)
            for _ in range(90):
                if self.run_task.done():
                    break
                self.pass_time(1.0)
            assert self.run_task.done(), (self.ticks[-1].mode, self.ticks[-1].wish.phase, self.injected)
            self.run_task.result()
            self.pass_time(3.0)
            assert max(abs(speed) for speed in self.world.truth.wheel_speeds) < 0.01
        finally:
            self.run_task.cancel()
            self.pass_time(0.1)
            self.bus.close()
            self.loop.close()


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(
    max_examples=max(8, settings().max_examples // 20),
    stateful_step_count=18,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


def test_what_happens_are_rows_of_the_table() -> None:
    assert len(HAPPENS) > 60
    assert set(HAPPENS) <= set(ROWS)
