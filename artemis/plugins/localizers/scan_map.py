"""Where the robot is on a map, by the scans of its laser scanner.

In real time each scan is matched in a thread, and the whole map is searched in another one: no tick waits for them. On
virtual time, where nothing passes while artemis computes, both are done at once, and results are reported as late as
if they had taken their time: so the same run is the same again.
"""

from __future__ import annotations

from collections import deque
from math import degrees, inf, radians, sqrt
from pathlib import Path as FilePath
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from artemis.config import Config
from artemis.errors import ConfigError, similar
from artemis.plugins.contracts import PluginContext
from artemis.plugins.localizers.covariance import SUREST_DEG, SUREST_M
from artemis.plugins.observing import PATIENCE, Beside
from artemis.scan import Scan
from artemis.values import LocatedPose, Pose, PoseFix, Tick
from artemis.yaml_file import survey

if TYPE_CHECKING:
    from artemis.localisation.scan_localizer import PlaceSearch, ScanLocalizer, ScanPose
    from artemis.mapping.likelihood import Match
    from artemis.mapping.occupancy import OccupancyMap
    from artemis.mapping.se2 import Array
    from artemis.mapping.sighting import Sighting

MATCHING, SEARCHING = 0.02, 3.0
"""On virtual time a scan is matched, and the whole map searched, in so long [s]."""
DOUBTED = "LOC-07"
WAITING = 3
"""Scans that may wait for those before."""


class StartPose(Config):
    """Where the robot begins on the map: the centre of its rear axle."""

    x_m: float
    y_m: float
    heading_deg: float


class ScanMapConfig(Config):
    """Keys of `localizer: {plugin: scan_map, ...}`."""

    map: Annotated[str, Field(min_length=1)]
    """The YAML file of a map, as `artemis map build` writes it."""
    scanner: str | None = None
    """Its name in the robot file; None: there is only one."""
    start: Annotated[
        Annotated[StartPose, Tag("<pose>")] | Annotated[Literal["global", "last"], Tag("<word>")],
        Discriminator(lambda given: "<pose>" if isinstance(given, dict | StartPose) else "<word>"),
    ] = "global"
    """Where the robot begins; anywhere; or where the last run of this mission ended, if none has driven it since."""
    start_std_m: Annotated[float, Field(ge=SUREST_M, le=2)] = 0.3
    """Standard deviation of x and y there, also of `last`."""
    start_std_deg: Annotated[float, Field(ge=SUREST_DEG, le=90)] = 10.0
    """That of the heading."""
    map_std_m: Annotated[float, Field(ge=0, le=1)] = 0.03
    """How far walls of the map and distances of the scanner may be off: added to each fix, it counts so much less."""
    rate_hz: Annotated[float, Field(gt=0, le=50)] = 10.0
    """Scans that are matched in a second; those between are not used."""


class ScanMapLocalizer:
    """Matches scans on a map, beside the ticks."""

    Config: ClassVar[type[Config]] = ScanMapConfig
    contract: ClassVar[int] = 1
    pure: ClassVar[bool] = True

    def __init__(self, config: ScanMapConfig, context: PluginContext) -> None:
        """Take the map from the mission's files.

        Raises:
            ConfigError: everything that is wrong in it, or the robot has no such scanner.
        """
        from artemis.mapping.recent_odometry import RecentOdometry

        self._config, self._context, self._name = config, context, context.name
        self._scanner = _scanner(config.scanner, context)
        self._known = _map(config.map, context)
        if isinstance(config.start, StartPose) and not self._known.contains(config.start.x_m, config.start.y_m):
            place = f"({config.start.x_m:g}, {config.start.y_m:g})"
            raise ConfigError(f"{self._name}: start: {place} lies outside of {config.map}")
        self._start = self._given_start()
        self._odometry = RecentOdometry(context.robot)
        self._waiting: Scan | None = None
        self._next = -inf
        self._made: ScanLocalizer | None = None
        self._found: deque[tuple[float, PoseFix]] = deque()
        """With the time from which on it may be reported [s]."""
        self._looked: deque[tuple[float, PlaceSearch, Match | None]] = deque()
        self._given: deque[LocatedPose] = deque(maxlen=1)
        self._doubts: deque[str] = deque()
        """The pose that was given; and what speaks against one."""
        self._error: BaseException | None = None
        self._dropped = self._gaps = 0
        threaded = context.real_time
        self._delays = (-inf, -inf) if threaded else (MATCHING, SEARCHING)
        self._matching: Beside[tuple[float, Sighting]] = Beside(
            "scan matching", self._match, threaded=threaded, bound=WAITING, failed=self._fail
        )
        self._searching: Beside[tuple[float, PlaceSearch]] = Beside(
            "map search", self._search, threaded=threaded, bound=1, failed=self._fail
        )
        if threaded:
            self._matching.order(self._prepare)  # the map is made while the robot is brought up

    @staticmethod
    def map_of(config: ScanMapConfig, context: PluginContext) -> OccupancyMap:
        """The map, for those who watch the run.

        Raises:
            ConfigError: everything that is wrong in it.
        """
        return _map(config.map, context)

    @staticmethod
    def prepare() -> None:
        """Compile, or load what was compiled, before the robot is touched."""
        from artemis.localisation.warming import warm_up

        warm_up()

    def see(self, tick: Tick) -> str:
        """Hand over a scan with the odometry around it, as soon as that is known."""
        if self._error is not None:
            raise self._error
        self._odometry.see(tick)
        for scan in tick.snapshot.sensed.scans:
            if scan.source == self._scanner and self._waiting is None and scan.time >= self._next:
                self._waiting = scan
        if self._waiting is None or (seen := self._odometry.sighting(self._waiting)) is None:
            return ""
        period = 1 / self._config.rate_hz
        self._next = max(self._next + period, self._waiting.time + period / 2)
        self._waiting = None
        if self._matching.put((tick.snapshot.time, seen)) is None:
            return ""
        self._dropped += 1
        return f"matching is too slow: {self._dropped} scans were dropped"

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """What was found since the last call, at run time `now` [s]."""
        found = []
        while self._found and self._found[0][0] <= now:
            found.append(self._found.popleft()[1])
        return tuple(found)

    def begin_at(self, initial: LocatedPose) -> None:
        """Search the next scan around this pose; without a covariance as at the start."""
        self._given.append(initial)

    def take_problems(self) -> list[tuple[str, str]]:
        """Poses that were given and do not fit, or fit no better than others."""
        return [(DOUBTED, self._doubts.popleft()) for _ in range(len(self._doubts))]

    def close(self) -> None:
        """Let both threads end."""
        for work in (self._matching, self._searching):
            work.close(PATIENCE)

    # ------------------------------------------------------------------------------------------ beside the ticks

    def _prepare(self) -> None:
        self._localizer()

    def _localizer(self) -> ScanLocalizer:
        if self._made is None:
            self._made = self._begun()
        return self._made

    def _given_start(self) -> Pose | None:
        """Where the robot begins; None: anywhere."""
        start = self._config.start
        if start == "last" or self._context.resumed:
            return self._context.last_pose()
        if isinstance(start, StartPose):
            return Pose(x=start.x_m, y=start.y_m, heading=radians(start.heading_deg))
        return None

    def _begun(self) -> ScanLocalizer:
        import numpy as np

        from artemis.localisation.scan_localizer import LocalizerSettings, ScanLocalizer
        from artemis.localisation.scan_map import ScanMap

        config, settings, given = self._config, LocalizerSettings(), self._start
        return ScanLocalizer(
            ScanMap.of_cells(self._known, settings.matching),
            settings,
            None if given is None else np.array([given.x, given.y, given.heading]),
            (config.start_std_m, radians(config.start_std_deg)),
        )

    def _match(self, handed: tuple[float, Sighting]) -> None:
        """Match one scan, and report the pose."""
        import numpy as np

        from artemis.mapping.sighting import points_of

        now, seen = handed
        localizer = self._localizer()
        while self._looked and self._looked[0][0] <= now:
            _, search, found = self._looked.popleft()
            localizer.take(search, found)
            if localizer.rival is not None:
                x, y, heading = localizer.rival.tolist()
                self._doubts.append(f"x {x:.2f} m, y {y:.2f} m, heading {degrees(heading):.0f} deg fits as well")
        points = points_of(seen, self._context.robot.scanners[self._scanner], localizer.settings.matching)
        if self._given:
            initial = self._given.popleft()
            localizer.begin_at(*self._around(initial))
        pose = seen.middle
        odometry = np.array([pose.x, pose.y, pose.heading]) if seen.gaps == self._gaps else None
        self._gaps = seen.gaps
        matched, delay = localizer.update(points, odometry), self._delays[0]
        self._found.append((now + delay, self._fix(matched, seen.time)))
        if localizer.refused is not None:
            self._doubts.append(f"a scan fits {localizer.refused:.0%} at best there")
        if (wanted := localizer.wanted()) is not None:
            self._searching.put((now, wanted))

    def _around(self, initial: LocatedPose) -> tuple[Array, tuple[float, float]]:
        """Where to search for the robot, and how far away: standard deviations [m, rad]."""
        import numpy as np

        pose, std = initial.pose, (self._config.start_std_m, radians(self._config.start_std_deg))
        if initial.covariance:
            xx, _, _, yy, _, hh = initial.covariance
            std = sqrt(max(xx, yy)), sqrt(hh)
        return np.array([pose.x, pose.y, pose.heading]), std

    def _fix(self, found: ScanPose, time: float) -> PoseFix:
        from artemis.localisation.scan_map import common_covariance

        x, y, heading = found.pose.tolist()
        covariance: tuple[float, ...] = ()
        common: tuple[float, ...] = ()
        if found.measured is not None:
            (xx, xy, xh), (_, yy, yh), (_, _, hh) = found.measured.tolist()
            place, turn = common_covariance(self._known.resolution)
            weight = max(place, self._config.map_std_m**2)
            covariance = (xx + weight, xy, xh, yy + weight, yh, hh + turn)
            common = (place, 0.0, 0.0, place, 0.0, turn)
        return PoseFix(
            time=time,
            pose=Pose(x=x, y=y, heading=heading),
            covariance=covariance,
            source=self._name,
            quality=min(1.0, found.quality),
            doubt=found.doubt,
            common=common,
        )

    def _search(self, handed: tuple[float, PlaceSearch]) -> None:
        now, search = handed
        found = self._localizer().look(search)
        self._looked.append((now + self._delays[1], search, found))

    def _fail(self, error: BaseException) -> None:
        self._error = error


def _scanner(name: str | None, context: PluginContext) -> str:
    """The name of the scanner to use."""
    scanners = context.robot.scanners
    if name is None:
        if len(scanners) == 1:
            return next(iter(scanners))
        problem = f"choose one of {', '.join(scanners)}" if scanners else "the robot has none"
        raise ConfigError(f"{context.name}: scanner: {problem}")
    if name not in scanners:
        hint = similar(name, scanners) if scanners else "the robot has none"
        raise ConfigError(f"{context.name}: scanner: no such scanner: {name}; {hint}")
    return name


def _map(name: str, context: PluginContext) -> OccupancyMap:
    """The map of a YAML file among the mission's files."""
    from artemis.mapping.map_file import map_from

    folder, beside = context.folder, PurePosixPath(name).parent

    def content(file: str) -> bytes:
        if file not in context.files:
            raise ConfigError(f"{context.name}: map: no '{file}' among the mission's files")
        return context.files[file]

    document, problems = survey(content(name), str(folder / name))
    if problems:
        raise ConfigError(problems)
    known = map_from(document, FilePath(folder / beside), lambda image: content(str(beside / image)))
    if not len(known.points()):
        raise ConfigError(f"{folder / name}: nothing is occupied in the map")
    return known
