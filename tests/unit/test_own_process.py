"""An observer in a process of its own: it sees the same, and however it ends, it is back, and that is said once."""

from __future__ import annotations

import errno
import os
import signal
import socket
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
import synthetic_run
from lateness import BACK
from process_observers import Keeper, KeeperConfig, kept

from artemis.bridges.child_process import LONGEST_PAUSE, SOONEST, ChildProcess, Restarts
from artemis.errors import ConfigError, PluginError
from artemis.mapping.occupancy import OccupancyMap, ShownMap
from artemis.mission.loading import load_model
from artemis.motion.route import route_from_csv
from artemis.plugins import own_process
from artemis.plugins.contracts import PluginContext
from artemis.plugins.own_process import ObserverProcess
from artemis.values import Pose
from artemis.vehicle import RobotFile

pytestmark = pytest.mark.realtime

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = load_model(MISSIONS / "robots/artemis.yaml", RobotFile)
SEEN = [(observed.tick, observed.frames) for observed, _ in zip(synthetic_run.run(), range(200), strict=False)]
LONG = 20.0


class Run:
    """A run that goes on, and the observer's process."""

    def __init__(self, folder: Path, **options: object) -> None:
        route = route_from_csv((MISSIONS / "paths/straight.csv").read_text(), "straight.csv")
        self.map: ShownMap | None = None
        context = PluginContext(
            name="far", robot=ROBOT, folder=folder, run=folder, routes={0: route}, map=lambda: self.map
        )
        self.folder, self.shown = folder, 0
        self.process = ObserverProcess(Keeper, KeeperConfig.model_validate(options), context)
        self.problems: list[tuple[str, str, str]] = []

    def tick(self) -> None:
        tick, frames = SEEN[self.shown % len(SEEN)]
        self.process.see(tick, frames, float(self.shown))
        self.problems += self.process.take_problems()
        self.shown += 1

    def until(self, holds: Callable[[], object]) -> None:
        end = monotonic() + LONG
        while not holds():
            assert monotonic() < end, self.problems
            self.tick()
            sleep(0.01)


Make = Callable[..., Run]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    runs = []

    def make(**options: object) -> Run:
        runs.append(Run(tmp_path, **options))
        return runs[-1]

    yield make
    for run in runs:
        run.process.close()


def test_it_sees_the_run_as_it_is_and_its_problems_come_back(make: Make, tmp_path: Path) -> None:
    run = make()
    run.process.wait()
    for _ in SEEN:
        run.tick()
    run.process.close()
    run.process.close()
    run.problems += run.process.take_problems()
    assert kept(tmp_path, 0) == [(tick, list(frames), float(n)) for n, (tick, frames) in enumerate(SEEN)]
    assert run.problems == [("NET-12", "far", "tick 2")]
    assert run.process.pid is None


def test_it_has_the_map_as_it_is_and_after_a_restart_too(make: Make, tmp_path: Path) -> None:
    run = make()
    run.process.wait()
    content = OccupancyMap(cells=np.zeros((2, 3), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    for x in (1.0, 2.0):
        run.map = ShownMap(content=content, odometry=Pose(x=x))
        run.until(lambda: ("NET-12", "far", f"map {x:g}") in run.problems)  # noqa: B023 (called here)
    assert run.process.pid is not None
    os.kill(run.process.pid, signal.SIGKILL)
    run.until(lambda: any(id == "NET-13" and "back" in words for id, _, words in run.problems))
    run.problems.clear()
    run.until(lambda: ("NET-12", "far", "map 2") in run.problems)


def test_one_that_is_killed_is_back_and_says_so(make: Make, tmp_path: Path) -> None:
    run = make()
    run.process.wait()
    for round in range(2):
        run.until(lambda: kept(tmp_path, round))  # noqa: B023 (called here)
        run.problems.clear()
        assert run.process.pid is not None
        os.kill(run.process.pid, signal.SIGKILL)
        run.until(lambda: sum(id == "NET-13" for id, _, _ in run.problems) == 2)
        ended, back = (words for id, name, words in run.problems if (id, name) == ("NET-13", "far"))
        assert ended == "killed by SIGKILL; it is started again"
        assert back.startswith("it is back after ")
        assert back.endswith(" ticks were not shown")
    run.until(lambda: kept(tmp_path, 2))


def test_one_that_is_killed_again_and_again_is_back_in_time_each_time(make: Make, tmp_path: Path) -> None:
    run = make()
    run.process.wait()
    run.until(lambda: kept(tmp_path, 0))
    for number in range(1, 4):
        assert run.process.pid is not None
        os.kill(run.process.pid, signal.SIGKILL)
        killed = monotonic()
        run.until(lambda: kept(tmp_path, number))  # noqa: B023 (called here)
        assert monotonic() - killed <= BACK


def test_what_cannot_be_started_is_tried_again(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make()
    run.process.wait()
    works = own_process._Child
    assert run.process.pid is not None
    os.kill(run.process.pid, signal.SIGKILL)
    tries: list[None] = []

    def full(first: bytes) -> None:
        tries.append(None)
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(own_process, "_Child", full)
    run.until(lambda: len(tries) == 2)
    assert [words for _, _, words in run.problems] == ["killed by SIGKILL; it is started again"]
    monkeypatch.setattr(own_process, "_Child", works)
    run.until(lambda: kept(tmp_path, 1))


def test_only_what_never_works_is_begun_again_after_longer_and_longer_pauses() -> None:
    now = [0.0]
    restarts = Restarts(lambda: now[0])

    def pause(*, works: bool, after: float = 0.0) -> float:
        """From an end to the next start."""
        if works:
            restarts.works()
        now[0] += after
        restarts.ended("killed by SIGKILL")
        ended = now[0]
        while not restarts.due:
            now[0] += 0.125
        restarts.begin()
        return now[0] - ended

    assert [pause(works=True, after=5.0), pause(works=True), pause(works=True, after=0.5)] == [0, SOONEST, SOONEST / 2]
    assert [pause(works=False) for _ in range(6)] == [0, 0.5, 1, 2, LONGEST_PAUSE, LONGEST_PAUSE]
    assert [pause(works=True, after=0.25), pause(works=False)] == [SOONEST - 0.25, 0]


def test_an_end_and_the_return_are_said_once() -> None:
    now = [0.0]
    restarts = Restarts(lambda: now[0])
    restarts.works()
    assert restarts.take() == []
    restarts.ended("killed by SIGKILL")
    assert (restarts.take(), restarts.take()) == (["killed by SIGKILL; it is started again"], [])
    now[0] = 0.3
    restarts.begin()
    restarts.ended("ended with status 1")
    restarts.begin()
    assert restarts.take() == []
    now[0] = 0.5
    restarts.works("; 9 ticks were not shown")
    restarts.works()
    assert restarts.take() == []
    now[0] = 1.3
    assert (restarts.take(), restarts.take()) == (["it is back after 0.5 s; 9 ticks were not shown"], [])


def test_one_that_hangs_is_killed_and_is_back(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_process, "HANG", 0.05)
    run = make()
    run.process.wait()
    assert run.process.pid is not None
    os.kill(run.process.pid, signal.SIGSTOP)
    while len(run.problems) < 2:
        run.tick()  # until nothing more fits into its connection
    assert run.problems[0] == ("NET-13", "far", "took nothing for 0.05 s, and was killed; it is started again")
    run.until(lambda: kept(tmp_path, 1))


def test_one_that_ends_again_and_again_is_started_at_longer_and_longer_intervals(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(own_process, "stopwatch", lambda: now[0])
    begun: list[float] = []

    class Dead(own_process._Child):
        def __init__(self, first: bytes) -> None:
            begun.append(now[0])
            super().__init__(b"")  # it gets nothing, and ends

    run = make()
    run.process.wait()
    monkeypatch.setattr(own_process, "_Child", Dead)
    assert run.process.pid is not None
    os.kill(run.process.pid, signal.SIGKILL)
    while len(begun) < 6:
        run.tick()
        now[0] += 0.25
        if len(begun) < 6 and (child := run.process._child) is not None:
            child._process.end()  # as fast as it would by itself
    pauses = [after - before for before, after in pairwise(begun)]
    assert pauses == sorted(pauses)
    assert pauses[-1] >= 4.0
    assert [words for _, _, words in run.problems] == ["killed by SIGKILL; it is started again"]


def test_it_ends_by_itself_with_the_run(make: Make) -> None:
    run = make()
    run.process.wait()
    child = run.process._child
    assert child is not None
    child._link.close()  # as when the run is killed
    assert child._process.wait(LONG)
    assert child._process.end() == "ended with status 0"


def test_what_it_refuses_is_refused_before_the_run(make: Make) -> None:
    with pytest.raises(ConfigError, match="far: refuse: it was asked to"):
        make(refuse=True).process.wait()
    with pytest.raises(ConfigError, match=r"PLG-01 far: the plugin cannot be made: RuntimeError\('broken'\)"):
        make(breaks=True).process.wait()


def test_a_class_without_a_name_is_refused(tmp_path: Path) -> None:
    class Nameless(Keeper):
        pass

    context = PluginContext(name="far", robot=ROBOT, folder=tmp_path)
    with pytest.raises(PluginError, match="PLG-01 far: the plugin cannot be made: it cannot have a process of its own"):
        ObserverProcess(Nameless, KeeperConfig(), context)


def test_its_last_words_are_told_and_what_it_raises(make: Make) -> None:
    run = make(stops_at=5, raises_at=3)
    run.process.wait()
    run.until(lambda: len(run.problems) >= 2)
    assert run.problems[0] == ("NET-12", "far", "tick 2")
    ((id, name, seen),) = run.problems[1:]
    assert (id, name) == ("PLG-02", "far")
    assert seen.startswith("ValueError('no more') at process_observers.py:")
    run = make(stops_at=5)
    run.process.wait()
    run.until(lambda: len(run.problems) >= 2)
    assert run.problems[1] == ("NET-13", "far", "ended with status 3: out of luck; it is started again")


def test_one_that_never_begins_again_is_replaced(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make()
    run.process.wait()
    works = own_process._MAIN
    monkeypatch.setattr(own_process, "BEGIN", 0.3)
    monkeypatch.setattr(own_process, "_MAIN", "import time; time.sleep(1000)")
    assert run.process.pid is not None
    os.kill(run.process.pid, signal.SIGKILL)
    pids: set[int | None] = set()

    def replaced() -> bool:
        pids.add(run.process.pid)
        return len(pids) > 3 and run.process.pid is None  # the next one begins after a pause

    run.until(replaced)
    monkeypatch.setattr(own_process, "_MAIN", works)
    monkeypatch.setattr(own_process, "BEGIN", LONG)
    run.until(lambda: any("it is back" in words for _, _, words in run.problems))


def test_one_that_does_not_take_what_it_is_told_first_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_process, "BEGIN", 0.1)
    monkeypatch.setattr(own_process, "_MAIN", "import time; time.sleep(1000)")
    child = own_process._Child(bytes(1 << 24))
    assert child.over == "took nothing for 0.1 s, and was killed"
    assert child.kill() == "killed by SIGKILL"


def test_errors_of_a_process_are_kept_to_a_bound_and_its_last_words_told() -> None:
    ours, its = socket.socketpair()
    program = (
        "import os, sys; link = int(sys.argv[1]); os.write(2, bytes(1 << 18)); os.write(link, b'1');"
        "os.read(link, 1); os.write(2, b'\\nout of luck\\n')"
    )
    with ours:
        with its:
            child = ChildProcess(["-c", program], [its.fileno()])
        ours.recv(1)
        child.trim()
        assert os.fstat(child._errors.fileno()).st_size == 0
        ours.send(b"2")
        assert child.wait(LONG)
    assert child.end() == "ended with status 0: out of luck"
    assert child.end() == "ended with status 0: out of luck"


@pytest.mark.parametrize("ends", [True, False])
def test_sigterm_to_all_processes_of_a_service_is_for_the_run(ends: bool) -> None:
    first, second = socket.socketpair()
    with first, second:
        program = (
            "import signal, socket, sys; link = socket.socket(fileno=int(sys.argv[1])); link.send(b'a'); link.recv(1); "
        )
        process = ChildProcess(["-c", program + "link.send(b'b')"], [second.fileno()])
        assert first.recv(1) == b"a"
        os.kill(process.pid, signal.SIGTERM)
        if ends:
            first.send(b"go on")
            assert first.recv(1) == b"b"
            assert process.wait(60.0)
        assert process.end() == ("ended with status 0" if ends else "killed by SIGKILL")
    assert signal.SIGTERM not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
