"""A map that is made while the robot drives: beside the ticks, in threads or at once, it is the same."""

from __future__ import annotations

import math
import re
import shutil
from contextlib import suppress
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from office import OFFICE
from test_map_readings import robot_with, scan_of, tick

from artemis.errors import ConfigError
from artemis.localisation.scan_localizer import LocalizerSettings, PlaceSearch, ScanLocalizer
from artemis.localisation.scan_map import ScanMap
from artemis.localisation.warming import warm_up
from artemis.mapping import kernels
from artemis.mapping import occupancy as occupancy_module
from artemis.mapping.drift import Drifts
from artemis.mapping.graph_file import read_graph
from artemis.mapping.key_scans import KeyScans
from artemis.mapping.likelihood import LikelihoodGrid
from artemis.mapping.map_file import read_map
from artemis.mapping.occupancy import OCCUPIED, ShownMap, occupancy
from artemis.mapping.readings import ScanReadings
from artemis.mapping.se2 import compose
from artemis.mapping.wide_loops import WideLoops
from artemis.mission.loading import load_mission
from artemis.planning import preparations
from artemis.plugins import live_map
from artemis.plugins.live_map import LiveMap
from artemis.plugins.localizers.scan_map import ScanMapLocalizer
from artemis.run_record import known_map
from artemis.values import Tick
from artemis_lab.bench.laser_worlds import SETTINGS, driven, odometry, scan, seen

MISSIONS = Path(__file__).parents[2] / "missions"
ROUND = driven([(-2, -3), (0, -3), (0, 1), (-5, 1), (-5, -1), (-2, 1.0), (0, 1), (0, -3)], step=0.25)


@pytest.fixture(scope="module")
def ticks() -> list[Tick]:
    counted = odometry(ROUND, [0.95] * (len(ROUND) - 1), np.radians(3))
    return [
        tick(0.1 * number, wheels, scan_of(seen(OFFICE, pose), 0.1 * number))
        for number, (pose, wheels) in enumerate(zip(ROUND, counted, strict=True))
    ]


def live(folder: Path, said: list[str], *, threaded: bool, resolution: float = 0.05) -> LiveMap:
    readings = ScanReadings(SETTINGS, robot_with("front"), "front")
    return LiveMap(readings, [folder / "map.yaml"], resolution, said.append, threaded=threaded)


def driven_with(making: LiveMap, ticks: list[Tick]) -> None:
    for each in ticks:
        making.see(each, [], 0.0)
    making.close()


def test_a_map_is_the_same_whether_loops_are_looked_for_beside_the_scans_or_at_once(
    tmp_path: Path, ticks: list[Tick]
) -> None:
    said: list[str] = []
    for name, threaded in (("beside", True), ("at_once", False)):
        (tmp_path / name).mkdir()
        driven_with(live(tmp_path / name, said, threaded=threaded), ticks)
    for file in ("map.yaml", "map.pgm", "map.graph"):
        assert (tmp_path / "beside" / file).read_bytes() == (tmp_path / "at_once" / file).read_bytes()
    graph = read_graph(tmp_path / "beside" / "map.graph")
    assert graph.graph.loops
    assert len(graph.trajectory) == len(ticks)
    assert OCCUPIED in read_map(tmp_path / "beside" / "map.yaml").cells
    assert said[0].startswith(f"map: {len(ticks)} scans, 0 matched nowhere; {len(graph.keys)} make it up, with ")


def test_whoever_watches_is_shown_the_map_as_it_grows_and_it_stays_the_same(
    tmp_path: Path, ticks: list[Tick], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "SHOWN_EVERY", 1.0)
    watched, beside_it = tmp_path / "watched", tmp_path / "beside"
    for folder in (watched, beside_it):
        folder.mkdir()
    making, shown = live(watched, [], threaded=False), list[ShownMap]()
    assert making.shown() is None
    ticks = ticks[:25]
    for each in ticks:
        making.see(each, [], 0.0)
        now = making.shown()
        if now is not None and (not shown or now is not shown[-1]):
            shown.append(now)
    making.close()
    assert len(shown) == 3  # the ticks are 0.1 s apart
    assert all(OCCUPIED in each.content.cells for each in shown)
    first, last = shown[0].odometry, shown[-1].odometry
    assert first is not None
    assert last is not None
    assert math.hypot(first.x, first.y) < 0.01  # at the beginning both frames are one; the wheels lie by 5 %
    assert math.hypot(last.x, last.y) > 0.05
    beside = live(beside_it, [], threaded=True)
    beside.shown()
    driven_with(beside, ticks)
    assert beside.shown() is not None
    alone = live(tmp_path, [], threaded=False)
    driven_with(alone, ticks)
    for folder in (watched, beside_it):
        assert (folder / "map.graph").read_bytes() == (tmp_path / "map.graph").read_bytes()


def test_the_more_there_is_to_draw_the_less_often_it_is_drawn(
    tmp_path: Path, ticks: list[Tick], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "SHOWN_EVERY", 0.1)
    drawn = []
    for seconds in (0.0, 0.1):
        monkeypatch.setattr(live_map, "SHOWN_PER_KEY", seconds)
        making = live(tmp_path, [], threaded=False)
        shown = [making.shown()]
        for each in ticks[:40]:
            making.see(each, [], 0.0)
            if (now := making.shown()) is not shown[-1]:
                shown.append(now)
        drawn.append(len(shown))
    assert drawn[1] <= drawn[0] / 2


def test_where_loops_take_long_only_one_picture_of_the_map_waits_for_them(
    tmp_path: Path, ticks: list[Tick], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "SHOWN_EVERY", 1.0)
    making, gate = live(tmp_path, [], threaded=True), Event()
    making.shown()

    def held() -> None:
        assert gate.wait(60.0)

    making._closing.order(held)
    for each in ticks:
        making.see(each, [], 0.0)
    drawn = [action for action, _ in making._closing._orders if action == making._show]
    gate.set()
    making.close()
    assert len(drawn) == 1
    assert making.shown() is not None


def test_the_map_that_a_mission_is_localised_on_is_known() -> None:
    loaded = load_mission(MISSIONS / "patrol_hall.yaml")
    known = known_map(loaded, loaded.mission.localizer)
    assert known is not None
    assert (known.content.cells == read_map(MISSIONS / "maps/hall.yaml").cells).all()
    assert known.odometry is None
    loaded = load_mission(MISSIONS / "follow_by_tracker.yaml")
    assert known_map(loaded, loaded.mission.localizer) is None


def test_a_run_without_a_scan_makes_no_map(tmp_path: Path) -> None:
    making = live(tmp_path, [], threaded=False)
    driven_with(making, [tick(0.0, np.zeros(3))])
    assert making.unmade == ["no scan was seen"]
    assert list(tmp_path.iterdir()) == []


def test_a_map_that_cannot_be_written_is_said(tmp_path: Path, ticks: list[Tick]) -> None:
    said: list[str] = []
    making = live(tmp_path / "nowhere", said, threaded=False)
    driven_with(making, ticks[:3])
    assert making.made == []
    assert ["cannot be written" in each for each in making.unmade] == [True]
    assert said[0].endswith(": no file")


def test_a_map_with_too_many_cells_is_written_with_larger_ones(
    tmp_path: Path, ticks: list[Tick], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(occupancy_module, "MOST_CELLS", 1_000_000)
    said: list[str] = []
    making = live(tmp_path, said, threaded=False, resolution=0.005)
    driven_with(making, ticks[:3])
    assert (len(making.made), making.unmade) == (1, [])
    cells = read_map(tmp_path / "map.yaml").cells
    assert occupancy_module.MOST_CELLS / 4 < cells.size < occupancy_module.MOST_CELLS
    assert said[0] == "map: cells of 0.02 m: with 0.005 m there would be more than 1000000"
    assert read_graph(tmp_path / "map.graph").keys


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_what_fails_beside_the_scans_is_not_lost(tmp_path: Path, ticks: list[Tick]) -> None:
    making = live(tmp_path, [], threaded=True)

    def fails(key: object) -> None:
        raise ArithmeticError("singular")

    making._mapper._closer.add = fails  # type: ignore[method-assign]
    with pytest.raises(ArithmeticError, match="singular"):
        driven_with(making, ticks[:3])
    with suppress(ArithmeticError):
        making.close()  # its thread has ended when the next test begins


class Watched:
    """The inner loops, and with which types each was called."""

    def __init__(self) -> None:
        self._real, self.called = kernels.LOOPS, set[tuple[object, ...]]()

    def __getattr__(self, name: str) -> object:
        def call(*given: object) -> object:
            self.called.add((name, *(typed(each) for each in given)))
            return getattr(self._real, name)(*given)

        return call


def typed(value: object) -> object:
    """What a compiler makes a version of its own for."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.ndim, value.flags.c_contiguous, value.flags.writeable
    return "float" if isinstance(value, float) else type(value)


def test_nothing_is_compiled_while_the_robot_drives(
    tmp_path: Path, ticks: list[Tick], monkeypatch: pytest.MonkeyPatch
) -> None:
    before, then = Watched(), Watched()
    monkeypatch.setattr(kernels, "LOOPS", before)
    warm_up()
    monkeypatch.setattr(kernels, "LOOPS", then)
    driven_with(live(tmp_path, [], threaded=False), ticks)
    assert len({each[0] for each in then.called}) > 5
    assert then.called <= before.called


def test_nothing_is_compiled_while_the_robot_is_followed_and_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    before, then = Watched(), Watched()
    monkeypatch.setattr(kernels, "LOOPS", before)
    warm_up()
    monkeypatch.setattr(kernels, "LOOPS", then)
    points = scan(OFFICE, ROUND[0])
    grown = np.concatenate([points] * 4)
    keys = KeyScans()
    keys.append(points, ROUND[0], np.zeros(2))
    known = ScanMap.of_cells(occupancy(keys), SETTINGS)
    localizer = ScanLocalizer(known, LocalizerSettings(gather_scans=1), ROUND[0], (0.3, 0.2))
    localizer.update(points, ROUND[0])
    localizer.update(points, compose(ROUND[0], [0.1, 0.0, 0.0]))
    localizer.look(PlaceSearch(points=grown, at=ROUND[0], since=0))
    keys = KeyScans()
    for pose in ROUND[:40]:
        keys.append(points, pose, np.zeros(2))
    sure = Drifts(np.tile(np.eye(2), (25, 1, 1)), np.ones(25), np.ones(25))
    WideLoops(SETTINGS, keys, LikelihoodGrid(SETTINGS)).find(2.0, 0.1, sure)
    assert {"search", "refine", "raise_levels"} <= {each[0] for each in then.called}
    assert then.called <= before.called


def test_what_takes_long_the_first_time_is_known_before_the_robot_is_touched() -> None:
    by_map, by_wheels, maps = (
        preparations(load_mission(MISSIONS / f"{name}.yaml"), simulated=True)
        for name in ("patrol_hall", "figure_eight", "map_hall")
    )
    assert (by_map, by_wheels, maps) == ([ScanMapLocalizer.prepare], [], [warm_up])


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ("{scanner: rear}", "mapping.scanner: the robot has no such scanner"),
        ("{file: hall.png}", "mapping.file: name the map .yaml"),
        ("{file: ../hall.yaml}", "mapping.file: outside the mission's folder"),
        ("{file: nowhere/hall.yaml}", "mapping.file: no such folder"),
        ("{file: maps/hall.yaml}", "mapping.file: maps/hall.yaml exists already: move it away, name another file"),
        ("{file: map_hall.yaml, replace: true}", "mapping.file: map_hall.yaml exists, and is no map"),
        ("{file: robots/artemis.yaml, replace: true}", "mapping.file: robots/artemis.yaml exists, and is no map"),
        ("{file: hall.zones.yaml}", "mapping.file: hall.zones.yaml: a map's zones and places have such a name"),
        ("{resolution_m: 7}", "mapping.resolution_m"),
        ("{colour: red}", "mapping.colour: unknown key"),
        ("", "mapping: expected a mapping, found nothing, so no map would be made: write `mapping: {}`"),
    ],
)
def test_a_map_that_cannot_be_made_is_refused_before_anything_moves(tmp_path: Path, keys: str, problem: str) -> None:
    missions = shutil.copytree(MISSIONS, tmp_path / "missions", ignore=shutil.ignore_patterns("runs"))
    mission = missions / "map_hall.yaml"
    mission.write_text(re.sub(r"mapping: \{\}.*", f"mapping: {keys}", mission.read_text()))
    with pytest.raises(ConfigError, match=re.escape(problem)):
        load_mission(mission)


def test_a_robot_without_a_scanner_makes_no_map(tmp_path: Path) -> None:
    missions = shutil.copytree(MISSIONS, tmp_path / "missions", ignore=shutil.ignore_patterns("runs"))
    mission = missions / "map_hall.yaml"
    mission.write_text(mission.read_text().replace("artemis_lms100", "artemis"))
    with pytest.raises(ConfigError, match=r"mapping: .* has no scanner"):
        load_mission(mission)
