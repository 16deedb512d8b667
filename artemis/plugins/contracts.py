"""All that a plugin author reads: what artemis gives a plugin, and what it wants back.

A plugin is a class, registered as an entry point in its group (`artemis.inputs`, `artemis.followers`,
`artemis.localizers`, `artemis.scanners`, `artemis.observers`, `artemis.behaviours`). It has an inner pydantic model
`Config` (a subclass of `artemis.config.Config`: the keys that a mission, or for a scanner the robot file, may write
beside `plugin:`) and is made with `Plugin(config, context)`. All but scanners and observers run inside the tick: they
must return within 15 ms, never wait, and take the time only from what they are given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

from msgspec import Struct

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.motion.path import Path
from artemis.motion.route import Route
from artemis.scan import Scan
from artemis.values import DriveCommand, LocatedPose, OperatorInput, Pose, PoseFix, Request, Snapshot, Tick, Tracking
from artemis.vehicle import RobotFile

if TYPE_CHECKING:
    from artemis.devices.can_bus import Traffic
    from artemis.devices.tcp import Dial
    from artemis.mapping.occupancy import OccupancyMap, ShownMap

CONTRACT = 1
"""Version of these contracts. A plugin may state `contract = 1`; another number is refused by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PluginContext:
    """What a plugin may know when it is made."""

    name: str
    """Its name in the mission (an input's key) or its plugin name."""
    robot: RobotFile
    folder: FilePath
    """Folder of the mission file: relative paths in the plugin's config start here."""
    files: Mapping[str, bytes] = field(default_factory=dict)
    """Contents of every file that the mission names, by the path as written there."""
    run: FilePath | None = None
    """Folder of the run, for what an observer writes; None for the others."""
    routes: Mapping[int, Route] = field(default_factory=dict)
    """The paths of the mission's steps that are known before the run, by the step's number, for an observer."""
    mission: bytes = b""
    """The mission of a run as JSON, in its file's own form, for an observer."""
    wake: Callable[[], None] = lambda: None
    """Asks for an extra tick now, off the schedule, in which every input is read: for a stop button that was pressed.
    May be called from any thread; what is asked again within 5 ms waits for the next tick."""
    typed: Callable[[Callable[[bytes], None]], bool] = lambda listener: False
    """Has `listener` called with what is typed at the run's terminal, with nothing once that is closed; False: none."""
    true_pose: Callable[[], tuple[float, Pose]] | None = None
    """Run time [s] and where a simulated robot truly is then, in the world's frame: for a localizer that simulates one.
    None: nobody knows."""
    real_time: bool = False
    """The run keeps real time: work beside the ticks is for threads. Else nothing passes while the plugin computes."""
    last_pose: Callable[[], Pose | None] = lambda: None
    """Where the robot was on the map when its last run of this mission ended; where a run is resumed, when that
    stopped. None: not known, or a run has driven the robot since. Each call is noted in the journal."""
    resumed: bool = False
    """The run resumes an earlier one: the robot stands at `last_pose`."""
    map: Callable[[], ShownMap | None] = lambda: None
    """The map of the run as it is at present, the same object until it changes, for an observer: that on which the
    localizer finds the robot, or the one that is made. None: there is none yet, or none at all."""
    ignored: Callable[[Request, Tick], str | None] = lambda request, tick: None
    """Why a request that an input gave in a tick leads to nothing; None: it counts."""
    dial: Dial | None = None
    """Connects to the simulated device that stands in for a scanner's; None: there is none, connect to the real one."""

    def top_speed(self, key: str, wanted: float | None) -> float:
        """The speed of the virtual front wheel [m/s] that a key of the plugin wants; None: the robot's limit.

        Raises:
            ConfigError: it is above the robot's limit.
        """
        limit = self.robot.limits.speed_m_s
        if wanted is not None and wanted > limit:
            raise ConfigError(f"{self.name}: {key}: {wanted:g}; the robot's limit is {limit:g}")
        return limit if wanted is None else wanted


class InputDevice(Protocol):
    """Turns a device's reports into wishes of an operator.

    Its class may state more: `NeedsRealTime`, `OpensNothing`, `ShowsState`, `TellsProblems`, `LimitsAge`,
    `NamesEnable`; its `Config`: `LimitsInput`, `NamesEnable`.
    """

    Config: ClassVar[type[Config]]

    def read(self, now: float) -> OperatorInput:
        """The newest sample, at run time `now` [s]; its age counts from the sample's arrival. Never waits.

        Raises:
            DeviceLost: the device is gone (unplugged); asked again at the next tick.
        """

    def close(self) -> None:
        """Give the device back; harmless when repeated."""


class Localizer(Protocol):
    """Tells where the robot is on a map: a tracker beside the floor, a scanner on the robot, another program.

    What it finds is told as a `PoseFix`, in the frame `map`, with the run time at which the robot was there; it may
    come up to two seconds late. Its class may state `SeesTicks`, and `NeedsRealTime` and `OpensNothing` as an input's.
    """

    Config: ClassVar[type[Config]]

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """What it found since the last call, at run time `now` [s]. Never waits.

        Raises:
            DeviceLost: the device is gone; asked again at the next tick. Until then the odometry carries the pose on.
        """

    def close(self) -> None:
        """Give the device back; harmless when repeated."""


class Scanner(Protocol):
    """Measures distances around the robot, again and again: a laser scanner.

    It is described in the robot file under `scanners`; `context.robot.scanners[context.name]` is its mounting. It runs
    beside the ticks, in the run's thread, so it must never block: what it waits for, it awaits. Its class may state
    `NeedsRealTime`; `field_deg`, where it measures in its frame (from, to; else all around); `least_range_m`.
    """

    Config: ClassVar[type[Config]]

    async def run(self, clock: Callable[[], float], give: Callable[[Scan], None]) -> None:
        """Connect, configure and measure until cancelled.

        Args:
            clock: run time now [s].
            give: takes each scan as soon as it is complete. Its `source` is `context.name`; its `time` the run time at
                which its first beam was measured, never later than now; its angles are those of a scanner that stands
                upright, however it is mounted.

        Raises:
            DeviceError: the device is gone or does not answer (LAS-01), `WrongDevice`: does not do what it shall
                (LAS-09). `run` is called again after a pause of 0.5 s, doubled each time up to 8 s until scans came.
        """

    def close(self) -> None:
        """Give the device back; harmless when repeated."""


class Following(Struct, frozen=True, kw_only=True):
    """A follower's answer to one snapshot."""

    command: DriveCommand
    tracking: Tracking
    finished: bool = False
    """The end of the path is reached (the command then is speed 0)."""


class Follower(Protocol):
    """Drives the robot along a path, always forwards.

    A path with reversals is given part by part. For one that is driven backwards the snapshot's pose, odometry and
    set-points are those of a robot whose other end is ahead, and the command is turned back; what was sensed stays as
    it is. Its `Config` may state `LimitsFollower`.
    """

    Config: ClassVar[type[Config]]

    def start(self, path: Path, snapshot: Snapshot) -> None:
        """Begin: `path` in the frame of the snapshot's `pose`, the robot standing there. Again at each reversal."""

    def step(self, snapshot: Snapshot) -> Following:
        """Command for this tick. Called at every scheduled tick while the mode is `follow`."""


State = tuple[int | float | str, ...]
"""What a behaviour needs to resume: at most 1000 bytes as JSON; numbers are finite."""


class Acting(Struct, frozen=True, kw_only=True, repr_omit_defaults=True):
    """A behaviour's answer to one snapshot."""

    command: DriveCommand | None = None
    """None: stand, with the wheels as they are. A behaviour that does not move gives none."""
    outcome: str | None = None
    """How it ended: `done`, or one that its class declares; the robot comes to rest then. None: it has not."""
    state: State = ()
    """Recorded with each tick, and given back to `start` when the step resumes."""
    phase: str = ""
    """What it does at present, for people: shown where it changes."""
    signals: Mapping[str, float] = {}
    """What it measures, by the names that its class declares; the others stay as they were."""


class Behaviour(Protocol):
    """A step of a mission, whose key is the plugin's name; its `Config` are the keys of the step.

    Its class states `Declared`; its `Config` may state `LimitsFollower`, and have a key `until: str | None`: a
    condition over the mission's signals, read by artemis; once it holds the robot comes to rest: `done`.
    """

    Config: ClassVar[type[Config]]

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        """Begin, the robot standing; or resume: `state` is what `step` returned last. None: the step begins."""

    def step(self, snapshot: Snapshot) -> Acting:
        """Answer for this tick. Called at every scheduled tick while the step runs, until it ends."""


class Declared(Struct, frozen=True, kw_only=True):
    """What the class of a behaviour states of itself, as attributes of these names; left out: as here."""

    outcomes: tuple[str, ...] = ()
    """What it may end with besides `done`: small letters, digits and hyphens."""
    moves: bool = True
    """It may move the robot; False: it only observes, and may run beside other steps."""
    resumable: bool = False
    """It can resume from its state in another run (`--resume`)."""
    signals: Mapping[str, str] = {}
    """What it adds for conditions: unit by name, the name ending with it, such as {"gas_ppm": "ppm"}; "": a ratio."""


def declared(plugin: object) -> Declared:
    """What the class of a behaviour states of itself."""
    return Declared(**{name: getattr(plugin, name) for name in Declared.__struct_fields__ if hasattr(plugin, name)})


class Observer(Protocol):
    """Sees what the robot does, and has no part in it.

    In real time it has a thread of its own: a slow one misses ticks, and delays none. On virtual time it sees each at
    once. After it is made, all its methods are called in one thread. Its class may state `HasOwnProcess`.
    """

    Config: ClassVar[type[Config]]

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """See a tick.

        Args:
            tick: its values.
            traffic: frames since the last one in the order on the bus, each with "sent by us"; those have the time 0.0.
            now: the time of the tick [s] by the clock of the frames; run time is `tick.snapshot.time`.
        """

    def take_problems(self) -> list[tuple[str, str, str]]:
        """What went wrong since the last call: a row of the fault table, its name in the mission, a few words.

        Asked after each tick, and after `close`; each becomes a warning.
        """

    def close(self) -> None:
        """The run is over: write what waits, and give everything back; harmless when repeated."""


# ---------------------------------------------------------------------------------------------- what may be stated


@runtime_checkable
class NeedsRealTime(Protocol):
    """An input, localizer, scanner or observer that needs a person, a wire or other programs, where `live`.

    A simulation then keeps real time.
    """

    live: bool


@runtime_checkable
class HasOwnProcess(Protocol):
    """An observer that in real time has a process of its own, where `own_process`: it computes, or talks to others.

    It is made there once more whenever the process ended. Its class and its `Config` must be importable by name.
    """

    own_process: bool


@runtime_checkable
class OpensNothing(Protocol):
    """An input or localizer that opens nothing when it is made, where `pure`: `artemis check` makes one, to try it."""

    pure: bool


@runtime_checkable
class SeesTicks(Protocol):
    """A localizer that finds the robot by what it senses itself: the scans and the odometry of each tick."""

    def see(self, tick: Tick) -> str:
        """Take what it needs of a tick, after its frames were sent. Never waits, never computes for long.

        What takes longer belongs in a thread where `PluginContext.real_time` says so. What it returns went wrong since
        the last call, in a few words: a warning (LOC-06); empty: nothing did.
        """


@runtime_checkable
class TakesInitialPose(Protocol):
    """A localizer that may be told about where the robot is: by a person, who sees it on the map."""

    def begin_at(self, initial: LocatedPose) -> None:
        """Look for the robot around this pose; without a covariance as near as it sees fit. Never waits.

        What it then finds, it tells as always. If that is not there, it goes on as before (LOC-07, `TellsProblems`).
        """


@runtime_checkable
class TakesTimeOnce(Protocol):
    """A localizer that takes long the first time: a run in real time has it prepared before the robot is touched."""

    @staticmethod
    def prepare() -> None:
        """Compile, or load what was compiled."""


@runtime_checkable
class HasMap(Protocol):
    """A localizer that finds the robot on a map of cells."""

    @staticmethod
    def map_of(config: Any, context: PluginContext) -> OccupancyMap:  # noqa: ANN401 (its own Config)
        """That map, for those who watch the run."""


@runtime_checkable
class ShowsState(Protocol):
    """An input that has its operator see or feel what the robot does: lamps, rumble, a wheel's force."""

    def show(self, tick: Tick) -> str:
        """Show a tick, after its frames were sent. Never waits.

        What it returns went wrong since the last call, in a few words: a warning (INP-16); empty: nothing did. If it
        raises, or is late three times in a row, that is a warning, and it is not asked again.
        """


@runtime_checkable
class TellsProblems(Protocol):
    """An input over a network, or a localizer, that knows more of what is wrong with it than that it is lost."""

    def take_problems(self) -> list[tuple[str, str]]:
        """What went wrong since it was last asked: of an input rows NET-.., of a localizer LOC-07, with a few words."""


@runtime_checkable
class LimitsAge(Protocol):
    """An input whose samples may be older, or must be newer, than those of a device at hand."""

    stale_s: float
    """They count until they are so old [s]."""


@runtime_checkable
class LimitsInput(Protocol):
    """Keys of an input: the robot drives no faster by hand; checked against its limit and its stopping distance."""

    max_speed_m_s: float | None
    """Of the virtual front wheel [m/s]; None: as the robot file says."""


@runtime_checkable
class NamesEnable(Protocol):
    """An input whose enable is no button: by its class, or by its keys where these choose it."""

    enable: str
    """What a person holds to drive, as the robot says it: "hold ... to drive"."""


@runtime_checkable
class AllowsRequests(Protocol):
    """Keys of an input over which others may ask for something."""

    allow: tuple[str, ...]
    """What: `goal_pose` is a goal for the step `goto`, `initialpose` about where the robot is, for the localizer."""


@runtime_checkable
class LimitsFollower(Protocol):
    """Keys of a follower or a behaviour: the robot drives no faster; along a path, and not for ever (PTH-08)."""

    speed_m_s: float | None
    """Of the virtual front wheel [m/s]; None: as the robot file says."""


@runtime_checkable
class ChoosesDevice(Protocol):
    """An input that needs real time, several of which a step may have: whether its keys can mean the same device."""

    @staticmethod
    def may_share(one: Any, other: Any, files: Mapping[str, bytes]) -> bool:  # noqa: ANN401 (its own Config)
        """Whether inputs with these keys may read one device; `files` of the mission."""
