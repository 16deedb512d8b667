"""What is kept of a run, and who observes it: its folder, recording and journal, and the mission's observers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import datetime
from hashlib import sha256
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from artemis.devices.can_bus import Traffic
from artemis.errors import RecordingError
from artemis.mission.actions import PluginUse
from artemis.mission.loading import LoadedMission, plugin_from
from artemis.motion.planned_route import route_poses
from artemis.motion.route import Route
from artemis.mounting import Mounting
from artemis.planning import made, setup_for
from artemis.plugins.contracts import HasMap, Observer
from artemis.plugins.guard import GARBAGE, Problem
from artemis.plugins.observing import Observation
from artemis.plugins.own_process import ObserverProcess
from artemis.plugins.process import AskedPlugin, plugins_watched
from artemis.plugins.stated import has_own_process
from artemis.recording.disk import Disk, low_disk
from artemis.recording.journal import Entry, Journal, Level
from artemis.recording.mcap_writer import JOURNAL, Recorder
from artemis.recording.provenance import Provenance, ResumePoint, first_entries
from artemis.recording.resume import BROKEN
from artemis.recording.routes import packed_routes
from artemis.recording.run_folder import create_run_folder, keep_calibration, keep_paths
from artemis.states.plan import FollowStep, Plan, Results
from artemis.supervision import catalogue
from artemis.values import Fault, JobKind, Pose, Severity, Tick

if TYPE_CHECKING:
    from artemis.mapping.occupancy import ShownMap
    from artemis.plugins.live_map import LiveMap


def place_of(mounting: Mounting) -> Pose:
    """Where a scanner sits on the robot."""
    return Pose(x=mounting.x_m, y=mounting.y_m, heading=mounting.heading)


def known_map(loaded: LoadedMission, use: PluginUse | None) -> ShownMap | None:
    """The map on which this localizer of a run finds the robot, if it has one."""
    if use is None:
        return None
    kind, config = plugin_from("artemis.localizers", use)
    if not isinstance(kind, HasMap):
        return None
    from artemis.mapping.occupancy import ShownMap

    return ShownMap(content=kind.map_of(config, setup_for(loaded, use.plugin)))


class RunRecord:
    """What is kept of one run. In real time (`threaded`) nothing of it delays a tick."""

    def __init__(
        self,
        loaded: LoadedMission,
        provenance: Provenance,
        disk: Disk,
        observers: Mapping[str, Observer],
        *,
        threaded: bool,
        alone: bool,
        localizer: PluginUse | None,
    ) -> None:
        """Make the run's folder, with enough room for a run that is left `alone`; its pose is of this `localizer`.

        Raises:
            RecordingError: it cannot be made, or has no room.
        """
        mission, root = loaded.mission.mission, loaded.folder / loaded.mission.record
        warning = low_disk(root, disk)
        if warning and alone:
            raise RecordingError(warning)
        self.disk, self.threaded = disk, threaded
        self.outcome = BROKEN
        """How the run ended, in a few words."""
        self.in_order = False
        """It ended by itself, neither failed nor interrupted."""
        self.time = 0.0
        """Run time of the last tick [s]."""
        self.maps: tuple[str, ...] = ()
        """Files of the map that was made; and of those that are wanted and were not written, why not."""
        self._loaded, self._localizer, self._mission = loaded, localizer, provenance.mission
        self._resumed = provenance.resume_point
        self._on_map: ShownMap | None = None
        self.folder = create_run_folder(root, mission, provenance.start, provenance.files)
        self.recorder = Recorder(
            self.folder.recording,
            provenance,
            threaded=threaded,
            journal=Journal(self.folder.journal, disk),
            scanners={name: place_of(mounting) for name, mounting in loaded.robot.scanners.items()},
            nodes={name: drive.node_id for name, drive in loaded.robot.drives.items()},
            errors=loaded.robot.errors,
            disk=disk,
        )
        for entry in first_entries(mission, loaded.robot.robot, provenance, warning, loaded.remarks, loaded.ignored):
            self.recorder.note(entry)

        self._observers = [
            Observation(name, observer, threaded=threaded, patience=None) for name, observer in observers.items()
        ]

    @contextmanager
    def observing(
        self, asked: AskedPlugin, patient: Callable[[], bool] | None, origin: Callable[[str], str]
    ) -> Iterator[None]:
        """Let the mission's observers see the run; at its end close them, and the recording with its outcome.

        Plugins are watched meanwhile: `asked` says which one the run waits for, `patient` whether it may take its time,
        `origin` which plugin of which package that is.
        """
        with ExitStack() as ends:
            for observer in self._observers:
                ends.callback(observer.close)
            ends.callback(lambda: self.recorder.close(self.outcome))
            shown: Callable[[], ShownMap | None] = self._shown_map
            if (live := self._map()) is not None:
                from artemis.plugins.live_map import NAME

                mapping = Observation(NAME, live, threaded=self.threaded, patience=None)
                self._observers.append(mapping)
                ends.callback(self._close_map, mapping, live)
                shown = live.shown if self._localizer is None else shown
            ours = {observer.name for observer in self._observers}
            ends.enter_context(plugins_watched(asked, ours, self._warn, patient, origin))
            begun: list[ObserverProcess] = []
            for name, use in self._loaded.mission.observers.items():
                seen_by = self._observer(name, use, shown)
                observer = Observation(name, seen_by, threaded=self.threaded, asked=asked)
                self._observers.append(observer)
                ends.callback(self._close, observer)
                begun += [seen_by] if isinstance(seen_by, ObserverProcess) else []
            for process in begun:  # they begin at the same time
                process.wait()
            yield

    def _observer(self, name: str, use: PluginUse, map: Callable[[], ShownMap | None]) -> Observer:
        """The observer `name` of the mission; in real time perhaps in a process of its own, which has begun."""
        setup = replace(setup_for(self._loaded, name), run=self.folder.path, routes=self._loaded.routes, map=map)
        setup = replace(setup, mission=self._mission)
        plugin, config = plugin_from("artemis.observers", use)
        if self.threaded and has_own_process(plugin):
            return ObserverProcess(plugin, config, setup)
        observer: Observer = made(plugin, config, setup)
        return observer

    def _shown_map(self) -> ShownMap | None:
        self._on_map = self._on_map or known_map(self._loaded, self._localizer)
        return self._on_map

    def _map(self) -> LiveMap | None:
        """Makes the map that the mission wants."""
        loaded, wanted = self._loaded, self._loaded.mission.mapping
        if wanted is None:
            return None
        from artemis.mapping.readings import ScanReadings
        from artemis.mapping.settings import MapSettings
        from artemis.plugins.live_map import LiveMap

        name = wanted.scanner or next(iter(loaded.robot.scanners))
        files = [self.folder.map, *([loaded.folder / wanted.file] if wanted.file is not None else [])]
        return LiveMap(
            ScanReadings(MapSettings(), loaded.robot, name),
            files,
            wanted.resolution_m,
            lambda text: self.recorder.note(Entry(time=self.time, kind="map", text=text)),
            threaded=self.threaded,
            refused=self._keeps_map,
        )

    def _keeps_map(self, file: FilePath) -> str:
        """Why the map is not written to a file beside the one in the run's folder; empty: it is."""
        if file == self.folder.map:
            return ""
        if self._resumed is not None:
            runs = f"{self.folder.path.with_name(self._resumed.run)} {self.folder.path}"
            return f"a resumed run maps only its own part; to make one map of both: artemis map build {runs} -o {file}"
        if not self.in_order and file.exists():
            return "kept as it was, for the run did not end in order"
        return ""

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        """Record one tick with the frames since the last one, at loop time `now` [s]."""
        self.time = tick.snapshot.time
        self.recorder.see(tick, traffic, now)
        for result in tick.snapshot.sensed.results:
            if result.kind is JobKind.PLAN and result.values:
                self.recorder.show_path(self.time, route_poses(result.values), "map")
        for observer in self._observers:
            observer.see(tick, traffic, now)

    def faults(self, attended: bool) -> Iterator[Fault]:
        """What goes wrong is a warning; no operator present and no journal: the run does not continue."""
        for id, name, seen in self.recorder.take_problems():
            severity = Severity.CONTROLLED_STOP if name == JOURNAL and not attended else None
            yield catalogue.fault(id, "", seen, severity)
        for observer in self._observers:
            for id, name, seen in observer.take_problems():
                id = id if id in catalogue.ROWS else GARBAGE
                yield catalogue.fault(id, name, seen, Severity.WARN)

    def note(self, problems: list[Problem]) -> None:
        """Keep what went wrong with plugins at the end."""
        for id, name, seen in problems:
            self._warn(f"{id} {name}: {seen}, when it was closed")

    def _warn(self, text: str) -> None:
        self.recorder.note(Entry(time=self.time, kind="warning", text=text, level=Level.WARNING))

    def show_paths(self, plan: Plan) -> None:
        """Keep the paths that are known before the run, for viewers."""
        for step in plan.steps:
            if isinstance(step, FollowStep) and isinstance(step.route, Route):
                self.recorder.show_path(0.0, step.route.poses(0.05), "map" if plan.localized else "odom")

    def conclude(self, results: Results) -> tuple[str, ...]:
        """Keep what the run found, once it is over; returns what the disk did to all that."""
        kept = keep_paths(self.folder, {name: track.as_csv() for name, track in results.tracks.items()})
        measured = {side: fit.record for side, fit in results.steering.items()}
        measured |= {side: zero.record for side, zero in results.zeros.items()}
        kept += keep_calibration(self.folder, measured)
        return (*(trouble.detail for trouble in self.recorder.troubles()), *kept)

    def _close(self, observer: Observation) -> None:
        observer.close()
        self.note(observer.take_problems())

    def _close_map(self, observer: Observation, live: LiveMap) -> None:
        self._close(observer)
        for problem in live.unmade:
            self._warn(f"map not written: {problem}")
        self.maps = (*live.made, *(f"NOT WRITTEN: {problem}" for problem in live.unmade))


def files_of(loaded: LoadedMission, source: FilePath) -> dict[str, bytes]:
    """The mission's file and all that it names."""
    return {**loaded.files, source.name: source.read_bytes()}


def content_hash(loaded: LoadedMission, source: FilePath) -> str:
    """Of the mission's file and all that it names, with their names (SHA-256)."""
    known = sha256()
    for name, content in sorted(files_of(loaded, source).items()):
        known.update(sha256(name.encode()).digest() + sha256(content).digest())
    return known.hexdigest()


def provenance_of(
    loaded: LoadedMission, source: FilePath, start: datetime, simulated: bool, resume_point: ResumePoint | None
) -> Provenance:
    """What a run is made from."""
    mission = loaded.mission.model_copy(update={"bus": "simulation"}) if simulated else loaded.mission
    return Provenance(
        start=start,
        mission=mission.model_dump_json(by_alias=True).encode(),
        robot=loaded.robot.model_dump_json().encode(),
        files=files_of(loaded, source),
        routes=packed_routes(loaded.routes) if loaded.routes else b"",
        resume_point=resume_point,
    )
