"""A stage without artemis: four simulated drives, enabled, under a host that only keeps them running.

It looks at frames and at the true machine, so that a test sees whether an injection happens, whatever artemis makes of
it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import yaml

from artemis.clock import run, until
from artemis.devices.can_bus import Frame
from artemis.drive_states import DriveState, Nmt
from artemis.errors import DeviceBusy, DeviceLost
from artemis.sim.bus import SimBus
from artemis.sim.epos import SimEpos
from artemis.sim.world import PlantParameters, World
from artemis.values import Request
from artemis.vehicle import RobotFile
from artemis_lab.injections.fault_bus import FaultBus
from artemis_lab.injections.stage import Stage, Undo
from artemis_lab.injections.table import inject

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
ROBOT, ROBOT_4, ROBOT_402 = (
    RobotFile.model_validate(yaml.safe_load((ROBOTS / name).read_text()))
    for name in ("artemis.yaml", "artemis_epos4.yaml", "artemis_cia402.yaml")
)
"""The same machine with drives of three families."""
MAPPED = {"epos1": (0x207C, 0x60780010), "epos4": (0x3160, 0x60770010), "cia402": (0x2401, 0x60780010)}
"""By family: index of the analog inputs, and an object of the motor current in two bytes."""
STRAIGHT = PlantParameters(start_steering_left_deg=0.0, start_steering_right_deg=0.0)
TICK = 0.02
SYNC, HEARTBEAT, EMERGENCY, SDO_ANSWER, SDO_REQUEST = Frame(0x080), 0x700, 0x080, 0x580, 0x600
ENABLE = (0x0006, 0x000F)
LEFT, RIGHT, STEER = "traction-left", "traction-right", "steer-left"
FAULT_STATES = (DriveState.FAULT, DriveState.FAULT_REACTION_DISABLED, DriveState.FAULT_REACTION_ENABLED)
RPM_PER_M_S = 60.0 / (72 * 2.1276596e-4)


class Host:
    """Set-points, SYNC and heartbeat 50 times a second; everything it hears is kept."""

    def __init__(self, robot: RobotFile = ROBOT) -> None:
        self.robot = robot
        self.first = robot is ROBOT
        """Its drives are of the first generation."""
        self.boot = 0.3 if robot is ROBOT_4 else 0.1
        """After this they have booted [s]."""
        self.steering_mode = -1 if self.first else 8
        self.steered = 0x2062 if self.first else 0x607A
        """Index of a steering drive's target."""
        self.loop = asyncio.get_running_loop()
        self.world = World(self.robot, STRAIGHT, start=self.loop.time())
        self.inner = SimBus(self.world, self.robot.bitrate, self.loop)
        self.bus = FaultBus(self.inner)
        self.requests: list[Request] = []
        self.stage = Stage(
            robot=self.robot, world=self.world, bus=self.bus, loop=self.loop, request=self.requests.append
        )
        self.heard: list[Frame] = []
        self.errors: list[Exception] = []
        self.beats = True
        self.exchanges = True
        self.words = dict.fromkeys(self.robot.drives, 0x000F)
        self.targets = dict.fromkeys(self.robot.drives, 0)
        tables = self.robot.drives[LEFT].tables
        self.units = RPM_PER_M_S * tables.velocity_scale
        """Units of velocity of a driven wheel's drive per m/s."""
        self._ramps = RPM_PER_M_S * tables.acceleration_scale
        self._deadline = self.loop.time()
        self.bus.listen(lambda: None)

    def drive(self, name: str) -> SimEpos:
        return self.world.drive(name)

    def state(self, name: str) -> DriveState:
        return self.drive(name).state

    def inject(self, id: str, node: str | None = None, **parameters: Any) -> Undo:  # noqa: ANN401 (of any row)
        return inject(self.stage, id, node, **parameters)

    def forward(self, speed: float) -> None:
        """Both driven wheels at so many m/s from the next tick on."""
        for name in self.world.driven:
            self.targets[name] = round((-1 if self.robot.drives[name].mirrored else 1) * speed * self.units)

    # ------------------------------------------------------------------------------------------ the run

    async def begin(self) -> None:
        """Boot, configure, enable."""
        await self.tick(self.boot)
        for node in self.world.nodes:
            self._configure(node)
        for word in ENABLE:
            self.words = dict.fromkeys(self.robot.drives, word)
            await self.tick(0.06)
        assert {node.state for node in self.world.nodes} == {DriveState.OPERATION_ENABLE}
        self.take()

    def _configure(self, node: SimEpos) -> None:
        drive, id = self.robot.drives[node.name], node.node_id
        traction = drive.role == "traction"
        analog, current = MAPPED[drive.family]
        details = (0x606C0020,) if traction else (analog << 16 | 0x0110, analog << 16 | 0x0210)
        for index, objects in (
            (0x1A00, (0x60410010, 0x60640020)),
            (0x1A01, (*details, current, 0x60610008)),
            (0x1600, (0x60400010, 0x60FF0020 if traction else self.steered << 16 | 0x0020)),
        ):
            node.poke(index, 0, 0)
            for place, mapped in enumerate(objects):
                node.poke(index, place + 1, mapped)
            node.poke(index, 0, len(objects))
        for index, cob_id in ((0x1800, 0x180 + id), (0x1801, 0x280 + id), (0x1400, 0x200 + id)):
            node.poke(index, 1, cob_id)
            node.poke(index, 2, 1)
        node.poke(0x1016, 1, self.robot.host_node_id << 16 | 200)
        node.poke(0x1017, 0, 100)
        node.poke(0x6060, 0, 3 if traction else self.steering_mode)
        if drive.family == "cia402":
            for option in drive.tables.option_codes:
                node.poke(option.setting.object.index, 0, option.setting.value)
        if drive.tables.interpolates:
            node.poke(0x60C2, 1, round(1000 * TICK))
        node.poke(0x6065, 0, drive.following_error_counts or 2000)
        for index in (0x6083, 0x6084):
            node.poke(index, 0, round(1.0 * self._ramps))
        node.poke(0x6085, 0, round(1.5 * self._ramps))
        node.change_nmt(Nmt.OPERATIONAL, self.loop.time())

    async def tick(self, seconds: float) -> None:
        """Exchange for so long."""
        end = self._deadline + seconds
        while self._deadline < end - 1e-9:
            if self.exchanges:
                self._write()
            self._deadline += TICK
            await until(self._deadline)
            self._read()
            self._deadline = max(self._deadline, self.loop.time())

    def _write(self) -> None:
        frames = [
            Frame(
                0x200 + self.robot.drives[name].node_id,
                self.words[name].to_bytes(2, "little") + target.to_bytes(4, "little", signed=True),
            )
            for name, target in self.targets.items()
        ]
        if self.beats:
            frames.append(Frame(HEARTBEAT + self.robot.host_node_id, b"\x05"))
        for frame in (*frames[:4], SYNC, *frames[4:]):
            try:
                self.bus.send(frame)
            except (DeviceBusy, DeviceLost) as error:
                self.errors.append(error)

    def _read(self) -> None:
        try:
            self.heard += self.bus.receive()
        except DeviceLost as error:
            self.errors.append(error)

    # ------------------------------------------------------------------------------------------ what was heard

    def take(self, identifier: int | None = None) -> list[Frame]:
        """Everything heard with this identifier (None: any) since the last call of `take` without one."""
        if identifier is not None:
            return [frame for frame in self.heard if frame.id == identifier]
        heard, self.heard = self.heard, []
        return heard

    def from_drive(self, base: int, name: str) -> list[Frame]:
        """Frames of a drive: base identifier and node."""
        return self.take(base + self.robot.drives[name].node_id)

    def statuswords(self, name: str) -> list[int]:
        return [int.from_bytes(frame.data[:2], "little") for frame in self.from_drive(0x180, name)]

    def positions(self, name: str) -> list[int]:
        return [int.from_bytes(frame.data[2:6], "little", signed=True) for frame in self.from_drive(0x180, name)]

    def volts(self, name: str) -> list[tuple[int, int]]:
        """Both analog inputs [mV]."""
        frames = self.from_drive(0x280, name)
        return [(int.from_bytes(f.data[:2], "little"), int.from_bytes(f.data[2:4], "little")) for f in frames]

    def emergencies(self, name: str) -> list[int]:
        return [int.from_bytes(frame.data[:2], "little") for frame in self.from_drive(EMERGENCY, name)]

    async def ask(self, name: str, index: int, sub: int = 0) -> list[bytes]:
        """Answers to an SDO read, within 0.2 s."""
        node = self.robot.drives[name].node_id
        self.take()
        self.bus.send(Frame(SDO_REQUEST + node, b"\x40" + index.to_bytes(2, "little") + bytes((sub,)) + bytes(4)))
        await self.tick(0.2)
        return [frame.data for frame in self.from_drive(SDO_ANSWER, name)]

    async def write_u32(self, name: str, index: int, sub: int, value: int) -> list[bytes]:
        """Answers to an SDO write, within 0.2 s."""
        node = self.robot.drives[name].node_id
        self.take()
        request = b"\x23" + index.to_bytes(2, "little") + bytes((sub,)) + value.to_bytes(4, "little")
        self.bus.send(Frame(SDO_REQUEST + node, request))
        await self.tick(0.2)
        return [frame.data for frame in self.from_drive(SDO_ANSWER, name)]


Proof = Callable[[Host], Coroutine[Any, Any, None]]
PROOFS: dict[str, Proof] = {}
"""By row of the fault table."""


def proves(*ids: str) -> Callable[[Proof], Proof]:
    """This shows that the injections of these rows happen."""

    def register(proof: Proof) -> Proof:
        assert not PROOFS.keys() & set(ids)
        PROOFS.update(dict.fromkeys(ids, proof))
        return proof

    return register


def on_stage(proof: Proof, robot: RobotFile = ROBOT) -> None:
    """Run it with the four drives enabled, on virtual time."""

    async def main() -> None:
        host = Host(robot)
        await host.begin()
        await proof(host)
        host.bus.close()

    run(main(), simulated=True)
