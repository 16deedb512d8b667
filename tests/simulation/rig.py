"""The test rig of whole runs: a mission runs in process on virtual time through the composition root, under watch.

World and bus are subclasses that write down what truly happens; a test may act on them while the run goes on (`at`,
`when`), and put another follower, input device or world in.
"""

from __future__ import annotations

import asyncio
import dataclasses
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.metadata import entry_points
from pathlib import Path as FilePath
from typing import Any, ClassVar
from unittest.mock import patch

import yaml
from msgspec.structs import replace
from watched import DRIVES as DRIVES
from watched import EMERGENCY as EMERGENCY
from watched import HEARTBEAT as HEARTBEAT
from watched import NODE as NODE
from watched import SDO_REQUEST as SDO_REQUEST
from watched import SET_POINTS as SET_POINTS
from watched import STEERING as STEERING
from watched import STOP_FRAMES as STOP_FRAMES
from watched import SYNC as SYNC
from watched import TRACTION as TRACTION
from watched import Truth as Truth
from watched import WatchedBus as WatchedBus
from watched import WatchedWorld as WatchedWorld
from watched import controlword as controlword
from watched import standing as standing
from watched import target_velocity as target_velocity

from artemis import app, clock, planning, yaml_file
from artemis.config import Config
from artemis.devices.can_bus import Frame, Traffic
from artemis.devices.device import Device
from artemis.errors import ConfigError
from artemis.mission import reading
from artemis.mission.actions import PluginUse
from artemis.mission.loading import load_mission
from artemis.plugins import registry
from artemis.plugins.contracts import Follower, InputDevice, PluginContext, TellsProblems
from artemis.recording.replay import Replayed, replay
from artemis.robot import Core, Robot
from artemis.sim.bus import Disturb
from artemis.sim.epos import SimEpos
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters
from artemis.states.plan import Plan, Results, with_followers
from artemis.values import Fault, Mode, Pose, Request, Tick
from artemis.vehicle import RobotFile
from artemis.yaml_file import Document

MISSIONS = FilePath(__file__).parents[2] / "missions"
BRAKING = 1.5
"""Deceleration of a quick stop in the robot file [m/s²]."""
TICK = 0.02
Steps = Sequence[Mapping[str, Any]]


# ---------------------------------------------------------------------------------------------- missions


def straight(length: float) -> str:
    """A straight path of `length` [m] as a file's text."""
    points = [index / 10 for index in range(round(length * 10) + 1)]
    return "x,y\n" + "".join(f"{x:.2f},0.0\n" for x in points)


def follow(speed: float = 0.2, path: str = "line.csv") -> dict[str, Any]:
    """A step of a mission."""
    return {"follow": {"path": path, "follower": {"plugin": "indiveri", "speed_m_s": speed}}}


CALIBRATE = {"calibrate": {"steering": "from_potentiometers"}}
TELEOP = {"teleop": {"input": "stick", "until": {"button": "done"}}}
STICK = {"stick": {"plugin": "scripted", "file": "stick.csv"}}


def stick(*rows: tuple[float, float, float, int]) -> str:
    """A scripted stick: rows of time [s], x, y and the enable button."""
    return "time_s,x,y,enable\n" + "".join(f"{time},{x},{y},{enable}\n" for time, x, y, enable in rows)


EPOS2 = "artemis_epos2.yaml"
"""A robot file that is made of that of ARTEMIS."""


def robot_text(robot: str) -> str:
    """A robot file of `missions`."""
    if robot != EPOS2:
        return (MISSIONS / "robots" / robot).read_text()
    text = robot_text("artemis.yaml").replace("0x6210", "0x6220").replace("0x6010", "0x6220")
    return text.replace("    node_id:", "    family: epos2\n    node_id:")


@cache
def robot_named(robot: str) -> RobotFile:
    """What a robot file of `missions` says."""
    return RobotFile.model_validate(yaml.safe_load(robot_text(robot)))


def write_mission(
    folder: FilePath,
    steps: Steps,
    files: Mapping[str, str] | None = None,
    robot: str = "artemis.yaml",
    **keys: object,
) -> FilePath:
    """A mission with its robot and tables in `folder`; its path. A follow step's `line.csv` is 1.2 m straight."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "artemis.yaml").write_text(robot_text(robot))
    for name, text in {"line.csv": straight(1.2), **(files or {})}.items():
        (folder / name).write_text(text)
    mission = {"mission": "rig", "robot": "artemis.yaml", "bus": "simulation", "steps": list(steps), **keys}
    path = folder / "mission.yaml"
    path.write_text(json.dumps(mission, indent=1))
    return path


# ---------------------------------------------------------------------------------------------- what is written down


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """One tick, and what left the host since the one before."""

    tick: Tick
    now: float
    """On the loop's clock; the run's own time starts at 0."""
    sent: list[Frame]
    pose: Pose
    """True."""
    standing: bool
    """No driven wheel truly turns."""

    @property
    def mode(self) -> Mode:
        return self.tick.mode

    @property
    def time(self) -> float:
        return self.tick.snapshot.time

    @property
    def phase(self) -> str:
        return self.tick.wish.phase


@dataclass(slots=True, kw_only=True)
class Run:
    """What became of a run."""

    mission: FilePath
    seen: list[Seen]
    world: WatchedWorld
    bus: WatchedBus
    plan: Plan
    results: Results
    outcome: app.Outcome | None = None
    acts: dict[str, float] = field(default_factory=dict)
    """When the test's own acts took place, by their names."""

    @property
    def ticks(self) -> list[Tick]:
        return [seen.tick for seen in self.seen]

    @property
    def is_done(self) -> bool:
        """Every step."""
        return self.ticks[-1].position.step == len(self.plan.steps)

    @property
    def status(self) -> int | None:
        """Exit status."""
        return None if self.outcome is None else self.outcome.exit_status

    @property
    def modes(self) -> list[Mode]:
        """Modes in their order, each once."""
        return [mode for mode, _ in itertools.groupby(seen.mode for seen in self.seen)]

    @property
    def faults(self) -> list[Fault]:
        """Every fault that was in a verdict or reported by a mode, in the order of appearance."""
        found = [fault for tick in self.ticks for fault in tick.snapshot.verdict.faults]
        return list(dict.fromkeys(found))

    @property
    def fault_ids(self) -> list[str]:
        return [fault.id for fault in self.faults]

    def first(self, condition: Callable[[Seen], bool]) -> Seen:
        """The first tick that fulfils it."""
        return next(seen for seen in self.seen if condition(seen))

    def in_mode(self, *modes: Mode) -> list[Seen]:
        return [seen for seen in self.seen if seen.mode in modes]

    def truth_from(self, time: float) -> list[Truth]:
        return [truth for truth in self.world.history if truth.time >= time]

    def truth_at(self, time: float) -> Truth:
        """The machine as it was last looked at."""
        return max((t for t in self.world.history if t.time <= time), key=lambda t: t.time)

    def stands_from(self) -> float:
        """Time since when no driven wheel truly turned any more."""
        return next((t.time for t in reversed(self.world.history) if not standing(t)), 0.0)

    def cross_track(self, mode: Mode = Mode.FOLLOW) -> float:
        """The largest cross-track error by the estimate [m]."""
        return max(abs(s.tick.wish.tracking.cross_track) for s in self.in_mode(mode) if s.tick.wish.tracking)

    def recompute(self) -> Replayed:
        """Replay the recording."""
        from artemis.recording.mcap_reader import Recording

        assert self.outcome is not None
        return replay(Recording(self.outcome.run.path), planning.core_from(load_mission(self.mission)))


# ---------------------------------------------------------------------------------------------- the rig


class RunTooLong(AssertionError):
    """The run did not end in the time that the test gives it."""


class Rig:
    """One run of one mission. Times are the run's own [s] unless said otherwise."""

    def __init__(
        self,
        mission: FilePath,
        *,
        follower: Follower | None = None,
        input: InputDevice | None = None,
        true_robot: PlantParameters | None = None,
        settings: SimSettings | None = None,
        disturb: Disturb | None = None,
        world: WatchedWorld | None = None,
        start: float = 0.0,
        longest: float = 60.0,
        simulate: bool = True,
        sensors: Callable[[], Sequence[Device]] = lambda: (),
    ) -> None:
        """Prepare.

        Args:
            mission: Its file.
            follower: Takes the place of every follow step's follower.
            input: Takes the place of every input device.
            true_robot: Takes the place of the mission's.
            settings: How the simulated drives behave.
            disturb: Disturbs the bus from the beginning.
            world: Where another run left it; else a new one is powered on.
            start: The loop's time when the run begins.
            longest: A run that takes longer fails the test.
            simulate: As in `artemis run --simulate`.
            sensors: Devices beside the drives.
        """
        self.mission, self.world = mission, world
        with patch.multiple(registry, **_PLUGINS), patch.object(reading, "survey", survey):
            self._loaded = load_mission(mission)
            self._plan = planning.plan_for(self._loaded, planning.is_simulated(self._loaded, simulate), None)
        if true_robot is not None:
            self._loaded = dataclasses.replace(self._loaded, true_robot=true_robot)
        if follower is not None:
            self._plan = replace(self._plan, steps=with_followers(self._plan.steps, lambda _: follower))
        self._input, self._settings, self._disturb = input, settings, disturb
        self._start, self._longest, self._simulate, self._sensors = start, longest, simulate, sensors
        self._acts: list[tuple[float, str, Callable[[], None]]] = []
        self._conditions: list[tuple[Callable[[Seen], bool], float, str, Callable[[], None]]] = []
        self.plugins: Callable[[str, PluginUse, PluginContext], object] = planning.plugin_made
        """Makes inputs and localizers."""
        self._seen: list[Seen] = []
        self._done: dict[str, float] = {}
        self._taken = 0

    # ------------------------------------------------------------------------------------------ what happens meanwhile

    def at(self, time: float, act: Callable[[], None], name: str = "act") -> Rig:
        """Do something at a run time."""
        self._acts.append((time, name, act))
        return self

    def when(
        self, condition: Callable[[Seen], bool], act: Callable[[], None], *, after: float = 0.0, name: str = "act"
    ) -> Rig:
        """Do something once, `after` [s] the end of the first tick that fulfils the condition."""
        self._conditions.append((condition, after, name, act))
        return self

    def while_following(self, act: Callable[[], None], distance: float = 0.4, name: str = "act") -> Rig:
        """Do something between two ticks when so much of a path [m] is driven."""
        return self.when(lambda seen: driven(seen) >= distance, act, after=0.007, name=name)

    def request(self, request: Request) -> Callable[[], None]:
        """An act: somebody at a terminal asks for something."""
        return lambda: self.robot.request(request)

    def emergency(self, name: str, code: int) -> Callable[[], None]:
        """An act: a device error in a drive."""
        return lambda: self.drive(name).emergency(code, self.bus.loop.time())

    def drive(self, name: str) -> SimEpos:
        """A simulated drive."""
        assert self.world is not None
        return self.world.drive(name)

    # ------------------------------------------------------------------------------------------ the run

    def run(self) -> Run:
        """To the end."""
        names = self._loaded.mission.inputs
        inputs = None if self._input is None else dict.fromkeys(names, _Unattended(self._input))
        parts = app.Parts(
            machine=self._machine,
            sensors=self._sensors,
            plan=self._plan,
            inputs=inputs,
            robot=self._make_robot,
            loop=self._loop(),
            plugins=self.plugins,
        )
        with patch.multiple(registry, **_PLUGINS):
            outcome = app.run_mission(
                self._loaded, self.mission, simulate=self._simulate, watch=self._watch, parts=parts
            )
        return dataclasses.replace(self._result(), outcome=outcome)

    def run_until_killed(self) -> Run:
        """To the moment at which an act calls `kill`: the process is gone, the world stays as it is."""
        try:
            self.run()
        except* Killed:
            pass
        assert self.bus.dead, "nobody killed the host"
        return self._result()

    def kill(self) -> None:
        """Nothing of the host reaches the bus any more, and it stops ticking."""
        self.bus.dead = True
        raise Killed

    def _result(self) -> Run:
        assert self.world is not None
        return Run(
            mission=self.mission,
            seen=self._seen,
            world=self.world,
            bus=self.bus,
            plan=self._plan,
            results=self._results,
            acts=self._done,
        )

    def _loop(self) -> type[clock.SimulatedLoop]:
        start = self._start

        class Loop(clock.SimulatedLoop):
            def __init__(self) -> None:
                super().__init__()
                self.skip(start)

        return Loop

    def _machine(self) -> tuple[WatchedBus, WatchedWorld]:
        loop, robot = asyncio.get_running_loop(), self._loaded.robot
        if self.world is None:
            seed = self._loaded.mission.simulation.seed
            true = self._loaded.true_robot
            self.world = WatchedWorld(robot, true, seed=seed, start=loop.time(), settings=self._settings)
        self.bus = WatchedBus(self.world, robot.bitrate, loop, self._disturb)
        for time, name, act in self._acts:
            self._later(time, name, act)
        self.bus.loop.call_later(self._longest, self._give_up)
        return self.bus, self.world

    def _make_robot(self, core: Core, *parts: Any) -> Robot:  # noqa: ANN401 (those of a robot)
        self._results = core.results
        self.robot = Robot(core, *parts)
        return self.robot

    def _watch(self, tick: Tick, traffic: Traffic) -> None:
        assert self.world is not None
        now = self.bus.loop.time()
        sent = [frame for _, frame in self.bus.sent[self._taken :]]
        self._taken = len(self.bus.sent)
        truth = self.world.truth
        seen = Seen(tick=tick, now=now, sent=sent, pose=truth.pose, standing=standing(truth))
        self._seen.append(seen)
        for entry in [entry for entry in self._conditions if entry[0](seen)]:
            self._conditions.remove(entry)
            _, after, name, act = entry
            self._later(after, name, act)

    def _later(self, delay: float, name: str, act: Callable[[], None]) -> None:
        def do() -> None:
            self._done[name] = self.bus.loop.time()
            act()

        self.bus.loop.call_later(delay, do)

    def _give_up(self) -> None:
        last = self._seen[-1]
        raise RunTooLong(f"still running after {self._longest:g} s: {last.mode.value}, {last.phase}; {last.tick}")


class _Unattended:
    """An input device, of which it does not count that a person holds it."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, device: InputDevice) -> None:
        self.read, self.close = device.read, device.close
        if isinstance(device, TellsProblems):
            self.take_problems = device.take_problems


class Killed(Exception):
    """The host process is gone."""


_PLUGINS: dict[str, Any] = {"entry_points": cache(entry_points), "_owner": cache(registry._owner)}
"""What is installed stays: it is looked up once, not again for every run."""


def survey(raw: bytes, source: str) -> tuple[Document, list[str]]:
    """What `yaml_file.survey` finds; it takes the same robot file apart once, not again for every run."""
    known = _flawless(raw)
    if known is None:
        return yaml_file.survey(raw, source)
    return dataclasses.replace(known, source=source, data=deepcopy(known.data)), []


@lru_cache(8)
def _flawless(raw: bytes) -> Document | None:
    try:
        found, problems = yaml_file.survey(raw, "")
    except ConfigError:
        return None
    return None if problems else found


def run(mission: FilePath, **keys: Any) -> Run:  # noqa: ANN401 (whatever `Rig` takes)
    """Run a mission under watch; keywords as of `Rig`."""
    return Rig(mission, **keys).run()


# ---------------------------------------------------------------------------------------------- reading what happened


def driven(seen: Seen) -> float:
    """How much of its path the robot has driven [m]; -1 if it follows none."""
    tracking = seen.tick.wish.tracking
    return -1.0 if tracking is None or seen.mode is not Mode.FOLLOW else tracking.arc_length


def degrees(angles: tuple[float, float]) -> tuple[float, float]:
    left, right = angles
    return math.degrees(left), math.degrees(right)
